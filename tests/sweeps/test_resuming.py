from pathlib import Path

import pytest

import dynkit.data.store
from dynkit import Sweep, sweep
from tests.sweeps.cases import (
    CHAIN,
    FREQUENCIES,
    RATES,
    SHORT,
    Counted,
    assert_same_bits,
    sweep_rates,
)


def test_a_finished_sweep_is_not_simulated_again(tmp_path: Path) -> None:
    first = sweep_rates(tmp_path / "x.h5")
    Counted.calls = 0
    assert_same_bits(first, sweep_rates(tmp_path / "x.h5"))
    assert Counted.calls == 0


def test_a_finished_sweep_leaves_its_store_and_nothing_else(tmp_path: Path) -> None:
    sweep_rates(tmp_path / "x.h5")
    assert [file.name for file in tmp_path.iterdir()] == ["x.h5"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
@pytest.mark.parametrize("call", [1, 69, 70, 69 * 17 + 5, 69 * 40])
def test_an_interrupted_sweep_goes_on_where_it_was(
    tmp_path: Path, error: type[BaseException], call: int
) -> None:
    store = tmp_path / "x.h5"
    Counted.trap = (call, error)
    with pytest.raises(error):
        sweep_rates(store)
    Counted.trap, Counted.calls = None, 0
    resumed = sweep_rates(store)
    assert Counted.calls == 69 * (len(RATES) - (call - 1) // 69)
    assert_same_bits(resumed, sweep_rates())


def test_a_loaded_sweep_is_the_one_that_was_stored(tmp_path: Path) -> None:
    found = sweep_rates(tmp_path / "x.h5")
    assert_same_bits(found, Sweep.load(tmp_path / "x.h5"))


def test_loading_writes_and_simulates_nothing(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    sweep_rates(store)
    bytes_before, written = store.read_bytes(), store.stat()
    Counted.calls = 0
    Sweep.load(store)
    after = store.stat()
    # reading changes the time of access
    assert (after.st_ino, after.st_mtime_ns) == (written.st_ino, written.st_mtime_ns)
    assert store.read_bytes() == bytes_before
    assert Counted.calls == 0


def test_a_sweep_loaded_with_its_system_tells_labels(tmp_path: Path) -> None:
    found = sweep(CHAIN, "frequency", FREQUENCIES, store=tmp_path / "x.h5", **SHORT)
    loaded = Sweep.load(tmp_path / "x.h5", CHAIN.replace(frequency=2.0))
    assert loaded.labels == found.labels


def test_a_sweep_loaded_without_its_system_says_so(tmp_path: Path) -> None:
    sweep_rates(tmp_path / "x.h5")
    with pytest.raises(ValueError, match="system must be given to load a sweep"):
        Sweep.load(tmp_path / "x.h5").label(0)


def test_loading_with_another_system_is_refused(tmp_path: Path) -> None:
    sweep(CHAIN, "frequency", FREQUENCIES, store=tmp_path / "x.h5", **SHORT)
    with pytest.raises(ValueError, match=r"was made with restitution 0\.85; got 0\.5"):
        Sweep.load(tmp_path / "x.h5", CHAIN.replace(restitution=0.5))


def test_loading_an_unfinished_sweep_is_refused(tmp_path: Path) -> None:
    Counted.trap = (69 * 17 + 5, KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        sweep_rates(tmp_path / "x.h5")
    with pytest.raises(ValueError, match="store must hold a finished sweep; got 17 of 40 values"):
        Sweep.load(tmp_path / "x.h5")


def test_only_what_was_asked_for_is_stored(tmp_path: Path) -> None:
    sweep(CHAIN, "frequency", FREQUENCIES, store=tmp_path / "x.h5", **SHORT)
    arrays = dict(dynkit.data.store.read(tmp_path / "x.h5").arrays)
    assert arrays.pop("found/observables/relative_velocity").nbytes == 8 * 12 * 20
    state = CHAIN.pack_state(CHAIN.state()).nbytes
    value, count, ending, number, displaced = 8, 8, 8, 8, 1
    each = value + state + count + ending + number + displaced
    assert sum(rows.nbytes for rows in arrays.values()) == 12 * each
