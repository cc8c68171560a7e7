import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dynkit.data.atomic_files
import dynkit.data.store
from dynkit import sweep
from dynkit.engine import collecting
from dynkit.systems import Logistic
from tests.sweeps.cases import (
    CHAIN,
    FREQUENCIES,
    RATES,
    SHORT,
    START,
    Counted,
    SoftChain,
    assert_same_bits,
    no_space,
    sweep_rates,
)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"system": CHAIN.replace(restitution=0.8)}, r"restitution 0\.85; got 0\.8"),
        ({"system": CHAIN.replace(chatter_tolerance=0.0)}, r"chatter_tolerance 1e-16; got 0\.0"),
        ({"system": CHAIN.replace(masses=4)}, "masses 3; got 4"),
        (
            {"system": CHAIN.replace(springs=(1.0, 1.0, 2.0))},
            r"springs 1\.0; got \(1\.0, 1\.0, 2\.0\)",
        ),
        (
            {"system": SoftChain(masses=3, frequency=0.9)},
            r"system .*ImpactChain; got .*Soft",
        ),
        ({"parameter": "damping"}, "parameter frequency; got damping"),
        ({"values": FREQUENCIES[:-1]}, r"points 12; got 11"),
        ({"values": FREQUENCIES[::-1]}, r"values\[0\] 0\.5; got 1\.5"),
        ({"transient": 31}, "transient 30; got 31"),
        ({"keep": 10}, "keep 20; got 10"),
        ({"observables": ["energy"]}, r'observables \["relative_velocity"\]; got \["energy"\]'),
        ({"start": CHAIN.state(phase=0.1)}, "start the system's own; got given"),
    ],
)
def test_the_store_of_another_sweep_is_refused_by_name(
    tmp_path: Path, changed: dict[str, Any], message: str
) -> None:
    store = tmp_path / "x.h5"
    usual: dict[str, Any] = {"system": CHAIN, "parameter": "frequency", "values": FREQUENCIES}
    sweep(**usual, store=store, **SHORT)
    before = store.read_bytes()
    with pytest.raises(ValueError, match=rf"store .*x\.h5 was made with {message}"):
        sweep(**{**usual, **SHORT, **changed}, store=store)
    assert store.read_bytes() == before


def test_the_swept_parameter_of_the_system_has_no_effect(tmp_path: Path) -> None:
    first = sweep_rates(tmp_path / "x.h5")
    again = sweep(
        Counted(1.0),
        "rate",
        RATES,
        start=START,
        transient=50,
        keep=20,
        progress=False,
        store=tmp_path / "x.h5",
    )
    assert_same_bits(first, again)


def test_an_unfinished_store_of_another_version_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Counted.trap = (700, KeyboardInterrupt)
    with monkeypatch.context() as older:
        older.setattr(collecting, "__version__", "0.0.1")
        with pytest.raises(KeyboardInterrupt):
            sweep_rates(tmp_path / "x.h5")
    with pytest.raises(ValueError, match=r"made with dynkit 0\.0\.1, and is not finished; got 0\."):
        sweep_rates(tmp_path / "x.h5")


def test_a_store_in_use_is_refused(tmp_path: Path) -> None:
    with (
        dynkit.data.atomic_files.locked("store", tmp_path / "x.h5"),
        pytest.raises(ValueError, match=r"store must not be in use by another writer; got .*x\.h5"),
    ):
        sweep_rates(tmp_path / "x.h5")
    assert Counted.calls == 0


def test_a_full_disk_is_noticed_before_anything_is_simulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(ValueError, match=r"can be written; got .*x\.h5 \(No space left"):
        sweep_rates(tmp_path / "x.h5")
    assert Counted.calls == 0
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_fills_up_leaves_what_was_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "x.h5"
    fsync, calls = os.fsync, 0

    def fills_up(handle: int) -> None:
        nonlocal calls
        calls += 1
        return fsync(handle) if calls < 10 else no_space(handle)

    with monkeypatch.context() as full:
        full.setattr(os, "fsync", fills_up)
        full.setattr(collecting, "_LEAST_INTERVAL", 0.0)
        full.setattr(collecting, "_SHARE", np.inf)
        with pytest.raises(OSError, match="No space left"):
            sweep_rates(store)
    assert len(dynkit.data.store.read(store).arrays["done"]) == 4
    assert_same_bits(sweep_rates(store), sweep_rates())


@pytest.mark.parametrize("name", ["", "none/x.h5"])
def test_a_place_that_can_hold_no_store_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match="store must be"):
        sweep_rates(tmp_path / name)
    assert Counted.calls == 0


def test_a_system_that_cannot_be_told_apart_is_refused_a_store(tmp_path: Path) -> None:
    @dataclass(frozen=True)
    class Odd(Logistic):
        rule: object = sum

    with pytest.raises(ValueError, match="whose rule is no number, string or array; got <built-in"):
        sweep(Odd(3.5), "rate", RATES, start=START, progress=False, store=tmp_path / "x.h5")


def test_a_store_that_leaves_out_a_value_before_others_is_refused(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    sweep_rates(store)
    whole = dynkit.data.store.read(store)
    rest = {
        name: rows if name.startswith("given/") else np.delete(rows, 3, axis=0)
        for name, rows in whole.arrays.items()
    }
    dynkit.data.store.write(store, dynkit.data.store.Archive(whole.entries, rest))
    with pytest.raises(
        ValueError, match=r"all of a sweep.*done lacks a point on which later points depend"
    ):
        sweep_rates(store)
