import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import dynkit.store
from dynkit import Sweep, sweep
from dynkit.sweeps import archive
from dynkit.systems import ImpactChain
from dynkit.validation import Array
from tests.example_systems import Henon, Logistic

CHAIN = ImpactChain(masses=3, frequency=0.9)
FREQUENCIES = np.linspace(0.5, 1.5, 12)
SHORT: dict[str, Any] = {"transient": 30, "keep": 20, "progress": False}
RATES = np.linspace(3.4, 3.9, 40)
START = [0.3]


@dataclass(frozen=True)
class Counted(Logistic):
    """Counts its calls, and does something else instead at one of them."""

    calls: ClassVar[int] = 0
    trap: ClassVar[tuple[int, type[BaseException]] | None] = None

    def __call__(self, state: Array) -> Array:
        Counted.calls += 1
        if self.trap is not None and Counted.calls == self.trap[0]:
            raise self.trap[1]
        return super().__call__(state)


class SoftChain(ImpactChain):
    """Another class, with the energies of the chain."""


@pytest.fixture(autouse=True)
def _fresh_counter() -> None:
    Counted.calls, Counted.trap = 0, None


def sweep_rates(store: Path | None = None, **changed: Any) -> Sweep:
    arguments: dict[str, Any] = {
        "transient": 50,
        "keep": 20,
        "start": START,
        "progress": False,
        **changed,
    }
    return sweep(Counted(3.5), "rate", RATES, store=store, **arguments)


def assert_same_bits(a: Sweep, b: Sweep) -> None:
    for name in a.observables:
        assert a.observable(name).tobytes() == b.observable(name).tobytes()
    assert a.counts.tolist() == b.counts.tolist()
    assert a.endings == b.endings
    assert a.cost.counts == b.cost.counts


# --- following -----------------------------------------------------------------------------------


def test_each_value_starts_from_the_last_state_before() -> None:
    found = sweep(CHAIN, "frequency", FREQUENCIES, **SHORT)
    start = None
    for row, frequency in zip(found.observable("relative_velocity"), FREQUENCIES, strict=True):
        chain = CHAIN.replace(frequency=float(frequency))
        attractor = chain.attractor(transient=30, impacts=20, start=start)
        start = attractor.final
        assert row.tobytes() == attractor.record.relative_velocity.tobytes()


def test_a_map_follows_from_its_start() -> None:
    found = sweep(Henon(), "a", [1.2, 1.3], transient=3, keep=4, start=[0.1, 0.2], progress=False)
    last = Henon(a=1.2).iterate(np.array([0.1, 0.2]), 6)
    expected = Henon(a=1.3).iterate(last[-1], 6)[3:]
    assert found.observable("state[0]")[1].tobytes() == expected[:, 0].tobytes()


def test_values_may_go_up_and_down() -> None:
    found = sweep(CHAIN, "frequency", [0.9, 0.7, 0.9], **SHORT)
    assert found.values.tolist() == [0.9, 0.7, 0.9]


def test_a_sweep_starts_where_it_is_told() -> None:
    start = CHAIN.state(position=[0.1, 0.2, 0.9], velocity=[0.0, 0.1, 0.2], phase=0.3)
    found = sweep(CHAIN, "restitution", [0.7], start=start, **SHORT)
    expected = CHAIN.replace(restitution=0.7).attractor(transient=30, impacts=20, start=start)
    row = found.observable("relative_velocity")[0]
    assert row.tobytes() == expected.record.relative_velocity.tobytes()


def test_all_observables_of_impacts_can_be_kept() -> None:
    found = sweep(CHAIN, "frequency", [0.7], observables=CHAIN.observables, **SHORT)
    record = CHAIN.replace(frequency=0.7).attractor(transient=30, impacts=20).record
    for name in ("relative_velocity", "phase", "energy", "time"):
        assert found.observable(name)[0].tobytes() == getattr(record, name).tobytes()


def test_attractors_are_the_ones_that_were_swept() -> None:
    found = sweep(CHAIN, "frequency", FREQUENCIES, **SHORT)
    for place in (0, 5, 11):
        states = found.attractor(place).states
        assert states[:, -2].tobytes() == found.observable("relative_velocity")[place].tobytes()


def test_labels_are_those_of_the_attractors() -> None:
    found = sweep_rates()
    assert str(found.label(0)) == "P(2)"
    assert found.labels[-1] == found.attractor(len(RATES) - 1).label


def test_labels_are_worked_out_once() -> None:
    found = sweep_rates()
    assert found.labels[0] is found.labels[0]


def test_nothing_is_simulated_for_labels_nobody_asks_for() -> None:
    sweep_rates()
    assert Counted.calls == len(RATES) * 69


def test_errors_are_those_of_the_attractors() -> None:
    found = sweep(CHAIN, "frequency", FREQUENCIES[:3], **SHORT)
    expected = [found.attractor(place).error for place in range(3)]
    assert found.error.tolist() == expected


def test_costs_add_up() -> None:
    assert sweep_rates().cost.counts == {"iterates": len(RATES) * 69}


def test_what_a_motion_that_ended_has_not_got_is_nan() -> None:
    chain = CHAIN.replace(amplitude=0.02, restitution=0.5)
    found = sweep(chain, "offset", [-0.3, -0.2, 0.0], transient=0, keep=50, progress=False)
    assert found.counts.tolist() == [1, 3, 50]
    missing = np.isnan(found.observable("relative_velocity"))
    assert missing.tolist() == [[j >= n for j in range(50)] for n in found.counts.tolist()]


def test_endings_say_why_a_motion_ended() -> None:
    chain = CHAIN.replace(amplitude=0.0, offset=-2.0)
    found = sweep(chain, "frequency", [0.5, 0.6], **SHORT)
    assert found.endings == ("the mass cannot reach the table any more",) * 2


# --- stores --------------------------------------------------------------------------------------


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


CHILD = """
import os, signal, sys, threading, time
import numpy as np
from dynkit import sweep
from dynkit.sweeps import archive
from dynkit.systems import ImpactChain

archive._LEAST_INTERVAL, archive._SHARE = 0.0, np.inf

def die():
    os.kill(os.getpid(), signal.SIGKILL)

store, moment, number = sys.argv[1], sys.argv[2], float(sys.argv[3])
def die_later():
    while not os.path.exists(store):
        time.sleep(0.0001)
    empty = os.stat(store).st_mtime_ns
    while os.stat(store).st_mtime_ns == empty:
        time.sleep(0.0001)
    time.sleep(number)
    die()

if moment == "any":
    threading.Thread(target=die_later, daemon=True).start()
else:
    call, count = getattr(os, moment), 0
    def counted(*arguments):
        global count
        count += 1
        return die() if count == number else call(*arguments)
    setattr(os, moment, counted)
sweep(ImpactChain(masses=3, frequency=0.9), "frequency", np.linspace(0.5, 1.5, 12),
      transient=30, keep=20, progress=False, store=store)
time.sleep(60)
"""


def killed(store: Path, moment: str, number: float) -> int:
    """Sweep in a process that kills itself, and return how many values survived."""
    command = [sys.executable, "-c", CHILD, str(store), moment, str(number)]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    return len(dynkit.store.read(store).arrays["count"]) if store.exists() else 0


@pytest.mark.parametrize(
    ("moment", "number", "survive"),
    [
        ("fsync", 1, 0),  # the first file is written, but not yet in its place
        ("replace", 9, 7),
        ("fsync", 16, 7),  # in its place, the folder not yet flushed
        *(
            ("any", delay, None)
            for delay in np.random.default_rng(1).uniform(0.0, 0.03, 5).tolist()
        ),
    ],
)
def test_a_killed_sweep_goes_on_where_it_was(
    tmp_path: Path, moment: str, number: float, survive: int | None
) -> None:
    store = tmp_path / "x.h5"
    survived = killed(store, moment, number)
    assert survive is None or survived == survive
    resumed = sweep(CHAIN, "frequency", FREQUENCIES, store=store, **SHORT)
    assert_same_bits(resumed, sweep(CHAIN, "frequency", FREQUENCIES, **SHORT))
    assert [file.name for file in tmp_path.iterdir()] == ["x.h5"]


# --- refused stores ------------------------------------------------------------------------------


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
        ({"values": FREQUENCIES[:-1]}, "12 values; got 11"),
        ({"values": FREQUENCIES[::-1]}, r"values\[0\] 0\.5; got 1\.5"),
        ({"transient": 31}, "transient 30; got 31"),
        ({"keep": 10}, "keep 20; got 10"),
        ({"observables": ["energy"]}, r"observables \['relative_velocity'\]; got \['energy'\]"),
        ({"start": CHAIN.state(phase=0.1)}, "another start"),
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


@pytest.mark.parametrize("content", [b"", b"All that I have.\n" * 100, b"\x89HDF\r\n\x1a\n"])
def test_a_foreign_file_is_refused_untouched(tmp_path: Path, content: bytes) -> None:
    store = tmp_path / "x.h5"
    store.write_bytes(content)
    with pytest.raises(ValueError, match=r"store must be a file that dynkit wrote; got .*x\.h5"):
        sweep_rates(store)
    assert store.read_bytes() == content
    assert Counted.calls == 0


def test_a_damaged_store_is_refused_untouched(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    sweep_rates(store)
    damaged = bytearray(store.read_bytes())
    damaged[len(damaged) // 2] ^= 4
    store.write_bytes(damaged)
    with pytest.raises(ValueError, match="store must be whole"):
        sweep_rates(store)
    assert store.read_bytes() == damaged


def test_a_store_of_something_else_is_refused(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    dynkit.store.write(store, dynkit.store.Archive({"kind": "branch"}, {}))
    with pytest.raises(ValueError, match=r"store must hold a following sweep; got .*x\.h5"):
        sweep_rates(store)


def test_an_unfinished_store_of_another_version_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Counted.trap = (700, KeyboardInterrupt)
    with monkeypatch.context() as older:
        older.setattr(archive, "__version__", "0.0.1")
        with pytest.raises(KeyboardInterrupt):
            sweep_rates(tmp_path / "x.h5")
    with pytest.raises(ValueError, match=r"made with dynkit 0\.0\.1, and is not finished; got 0\."):
        sweep_rates(tmp_path / "x.h5")


def test_a_store_in_use_is_refused(tmp_path: Path) -> None:
    with (
        dynkit.store.locked(tmp_path / "x.h5"),
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
        full.setattr(archive, "_LEAST_INTERVAL", 0.0)
        full.setattr(archive, "_SHARE", np.inf)
        with pytest.raises(OSError, match="No space left"):
            sweep_rates(store)
    assert len(dynkit.store.read(store).arrays["count"]) == 4
    assert_same_bits(sweep_rates(store), sweep_rates())


def no_space(handle: int) -> None:
    raise OSError(28, "No space left on device")


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


# --- loading -------------------------------------------------------------------------------------


def test_a_loaded_sweep_is_the_one_that_was_stored(tmp_path: Path) -> None:
    found = sweep_rates(tmp_path / "x.h5")
    assert_same_bits(found, Sweep.load(tmp_path / "x.h5"))


def test_loading_writes_and_simulates_nothing(tmp_path: Path) -> None:
    sweep_rates(tmp_path / "x.h5")
    before = (tmp_path / "x.h5").stat()
    Counted.calls = 0
    Sweep.load(tmp_path / "x.h5")
    assert (tmp_path / "x.h5").stat() == before
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
    arrays = dict(dynkit.store.read(tmp_path / "x.h5").arrays)
    assert arrays.pop("observables/relative_velocity").nbytes == 8 * 12 * 20
    state = CHAIN.pack_state(CHAIN.state()).nbytes
    value, count, ending = 8, 8, 8
    assert sum(rows.nbytes for rows in arrays.values()) == 12 * (value + state + count + ending)


# --- progress ------------------------------------------------------------------------------------


def test_progress_shows_parameter_and_label(capsys: pytest.CaptureFixture[str]) -> None:
    sweep_rates(progress=True, keep=64)
    shown = capsys.readouterr()
    assert "40/40" in shown.err
    assert "rate 3.9: ..." in shown.err
    assert shown.out == ""


def test_progress_tells_the_label_of_a_period(
    capsys: pytest.CaptureFixture[str],
) -> None:
    sweep(Logistic(3.0), "rate", [3.2], start=START, transient=200, keep=50)
    assert "rate 3.2: P(2)" in capsys.readouterr().err


def test_progress_simulates_nothing_for_labels() -> None:
    sweep_rates(progress=True)
    assert Counted.calls == len(RATES) * 69


def test_without_progress_a_sweep_is_silent(capfd: pytest.CaptureFixture[str]) -> None:
    sweep_rates()
    assert capfd.readouterr() == ("", "")


def test_libraries_are_imported_only_when_used() -> None:
    code = """
import sys
from dynkit import sweep
from tests.example_systems import Logistic
sweep(Logistic(3.0), "rate", [3.2], start=[0.3], progress=False)
print(sorted({"h5py", "tqdm"} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# --- bad input -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"values": []}, "values must hold at least one number; got none"),
        ({"values": [0.5, np.nan]}, r"values\[1\] must be a finite number; got nan"),
        ({"values": [np.inf]}, r"values\[0\] must be a finite number; got inf"),
        ({"values": [[0.5]]}, r"values must have shape \(any,\); got shape \(1, 1\)"),
        ({"values": 0.5}, r"values must have shape \(any,\); got shape \(\)"),
        ({"values": ["0.5"]}, "values must be an array of real numbers"),
        ({"values": [0.5, 0.0]}, r"frequency must be positive; got 0\.0 in values\[1\]"),
        ({"parameter": "speed"}, r"parameter must be one of: frequency, .*; got 'speed'"),
        ({"parameter": "masses"}, r"parameter must be one of: .*; got 'masses'"),
        ({"transient": -1}, "transient must be zero or a positive integer; got -1"),
        ({"transient": 7.0}, r"transient must be zero or a positive integer; got 7\.0"),
        ({"keep": 0}, "keep must be a positive integer; got 0"),
        ({"keep": "100"}, "keep must be a positive integer; got '100'"),
        (
            {"observables": ["speed"]},
            "observables must be among .*, time; got 'speed'",
        ),
        ({"observables": "energy"}, "observables must be a sequence of names; got 'energy'"),
        ({"observables": []}, r"observables must be a sequence of names; got \[\]"),
        ({"start": [1.0, 2.0]}, r"start must be an ImpactState; got \[1\.0, 2\.0\]"),
        ({"start": CHAIN.replace(masses=4).state()}, "start must have 3 masses; got 4"),
        ({"system": "chain"}, "system must be a Map or Sweepable; got 'chain'"),
    ],
)
def test_bad_input_is_refused_by_name_and_nothing_is_written(
    tmp_path: Path, changed: dict[str, Any], message: str
) -> None:
    usual: dict[str, Any] = {"system": CHAIN, "parameter": "frequency", "values": FREQUENCIES}
    with pytest.raises(ValueError, match=message):
        sweep(**{**usual, **SHORT, **changed}, store=tmp_path / "x.h5")
    assert list(tmp_path.iterdir()) == []


def test_a_map_needs_a_start() -> None:
    with pytest.raises(ValueError, match=r"start must be a state of the map, \(1,\); got None"):
        sweep_rates(start=None)


def test_a_motion_that_is_refused_on_the_way_keeps_what_was_finished(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    with pytest.raises(ValueError, match=r"start must lead to a motion that .*, at rate 4\.5"):
        sweep(Logistic(3.0), "rate", [3.2, 4.5], start=START, store=store, progress=False)
    assert len(dynkit.store.read(store).arrays["count"]) == 1


@pytest.mark.parametrize("place", [-1, 40])
def test_a_place_beyond_the_values_is_refused(place: int) -> None:
    with pytest.raises(ValueError, match=rf"place must lie in \[0, 39\]; got {place}"):
        sweep_rates().label(place)


def test_an_observable_that_was_not_kept_is_refused() -> None:
    with pytest.raises(ValueError, match=r"name must be one of: state\[0\]; got 'energy'"):
        sweep_rates().observable("energy")


def test_what_was_found_cannot_be_changed() -> None:
    found = sweep_rates()
    with pytest.raises(ValueError, match="read-only"):
        found.observable("state[0]")[0, 0] = 1.0
