"""`measure`: one pass, a store that is read meanwhile, and runs that are interrupted."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from dynkit import Map, NoCrossing
from dynkit.analysis import (
    POD,
    Histogram,
    LyapunovSpectrum,
    Measures,
    PowerSpectrum,
    Running,
    RunningExponents,
    RunningHistogram,
    RunningPOD,
    RunningSample,
    RunningSpectrum,
    measure,
)
from dynkit.analysis.dimension.dimension import CorrelationDimension
from dynkit.core.validation import Array
from dynkit.data import store as stores
from dynkit.engine import collecting
from dynkit.systems import Henon, ImpactChain, Logistic, MatrixOscillator


class Shaky(Map):
    """The logistic map at 4, which is interrupted at one of its calls."""

    dimension = 1
    calls: ClassVar = 0
    last: ClassVar = 10**9

    def __call__(self, state: Array) -> Array:
        Shaky.calls += 1
        if Shaky.calls >= Shaky.last:
            Shaky.last = Shaky.calls + 10**9  # what a method assigns is not compared
            raise KeyboardInterrupt
        return np.asarray(4.0 * state * (1.0 - state))


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stores are written after every block."""
    monkeypatch.setattr(collecting, "_LEAST_INTERVAL", 0.0)
    monkeypatch.setattr(collecting, "_SHARE", np.inf)
    Shaky.calls, Shaky.last = 0, 10**9


def every(observable: str = "state[0]") -> dict[str, Running]:
    return {
        "histogram": RunningHistogram(observable, low=-1.0, high=1.0, bins=20),
        "pod": RunningPOD(about="mean"),
        "exponents": RunningExponents(settling=10),
        "spectrum": RunningSpectrum(interval=1.0, length=32),
        "sample": RunningSample(200),
    }


CLASSES = {
    "histogram": Histogram,
    "pod": POD,
    "exponents": LyapunovSpectrum,
    "spectrum": PowerSpectrum,
    "sample": CorrelationDimension,
}


def numbers(found: Measures) -> dict[str, bytes]:
    """The bits of what has been accumulated, without costs."""
    arrays: dict[str, Any] = {}
    tree = json.loads(json.dumps(stores_tree(found, arrays)))
    for each in tree["_slots"].values():
        for slot in each.values():
            if slot is not None:
                del slot["cost"]
    del tree["cost"]
    rest = {name: array.tobytes() for name, array in arrays.items()}
    return {**rest, "": json.dumps(tree).encode()}


def stores_tree(found: Measures, arrays: dict[str, Any]) -> Any:
    from dynkit.data.codec import encoded

    return encoded("", found, arrays)


def run(system: Any, keep: int, store: Path | None, block: int = 100, **others: Any) -> Measures:
    observable = "relative_velocity" if isinstance(system, ImpactChain) else "state[0]"
    start = None if isinstance(system, ImpactChain) else [0.1] * system.dimension
    stream = system.stream(start=start, transient=50, keep=keep, block=block)
    return measure(stream, every(observable), store=store, progress=False, **others)


SYSTEMS = {"henon": Henon(), "chain": ImpactChain(masses=3, frequency=1.346), "own": Shaky()}


# --- one pass -------------------------------------------------------------------------------------


def test_results_have_the_classes_of_the_measures() -> None:
    found = run(Henon(), 500, None)
    assert {name: type(each) for name, each in found.items()} == CLASSES
    assert (found.states, found.keep, len(found)) == (500, 500, 5)
    assert found.cost.counts["iterates"] == 549
    assert repr(found) == (
        "<Measures histogram, pod, exponents, spectrum, sample: 500 of 500 states>"
    )


def test_given_measures_remain_new() -> None:
    wanted = every()
    measure(Henon().stream(start=[0.1, 0.1], keep=300), wanted, progress=False)
    assert [each.states for each in wanted.values()] == [0] * 5


def test_a_measure_of_ones_own_serves_without_a_store(tmp_path: Path) -> None:
    class Largest(Running):
        largest: float

        def __init__(self) -> None:
            self.largest = -np.inf

        def accumulate(self, block: Any) -> None:
            self.largest = max(self.largest, float(block.states.max()))

        def result(self) -> float:
            return self.largest

    stream = Logistic(rate=4.0).stream(start=[0.3], keep=1000, block=100)
    found = measure(stream, {"largest": Largest()}, progress=False)
    assert 0.99 < found["largest"] <= 1.0
    with pytest.raises(ValueError, match=r"store must be None for largest, which is Largest\(\)"):
        measure(stream, {"largest": Largest()}, store=tmp_path / "x.h5", progress=False)


def test_a_measure_of_ones_own_is_not_stored_as_one_of_the_same_name(tmp_path: Path) -> None:
    class RunningPOD(Running):
        def accumulate(self, block: Any) -> None:
            pass

        def result(self) -> None:
            return None

    stream = Logistic(rate=4.0).stream(start=[0.3], keep=100)
    with pytest.raises(ValueError, match="store must be None for pod"):
        measure(stream, {"pod": RunningPOD()}, store=tmp_path / "x.h5", progress=False)


@pytest.mark.parametrize("block", [1, 7, 100])
def test_a_motion_that_repeats_itself_is_noticed(block: int) -> None:
    """P(3) of the logistic map at 3.83."""
    stream = Logistic(rate=3.83).stream(start=[0.3], transient=2000, keep=300, block=block)
    found = measure(stream, {"x": RunningPOD()}, progress=False)
    assert found.repeats is not None  # its rounding may repeat after a multiple of the period
    assert found.repeats % 3 == 0
    assert repr(found).endswith(f"; repeats itself after {found.repeats}>")
    assert run(Henon(), 300, None).repeats is None


def test_chaos_that_rounding_repeats_is_noticed() -> None:
    """With twelve binary digits in each state, cycles are short."""

    class Coarse(Map):
        dimension = 1

        def __call__(self, state: Array) -> Array:
            return np.rint(4.0 * state * (1.0 - state) * 2.0**12) / 2.0**12

    stream = Coarse().stream(start=[0.3], transient=0, keep=3000, block=50)
    found = measure(stream, {"x": RunningPOD()}, progress=False)
    states = Coarse().iterate(np.array([0.3]), 3000)[:, 0]
    assert found.repeats is not None
    assert states[-1] == states[-1 - found.repeats]


def test_a_bar_counts_states(capfd: pytest.CaptureFixture[str]) -> None:
    stream = Logistic(rate=4.0).stream(start=[0.3], keep=1000, block=500)
    measure(stream, {"x": RunningPOD()})
    assert "1000/1000" in capfd.readouterr().err


# --- stores ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_store_holds_the_same_measures(name: str, tmp_path: Path) -> None:
    found = run(SYSTEMS[name], 400, tmp_path / "long.h5")
    again = Measures.load(tmp_path / "long.h5")
    assert numbers(again) == numbers(found) == numbers(run(SYSTEMS[name], 400, None))
    assert again["pod"].power.tobytes() == found["pod"].power.tobytes()
    assert again.cost == found.cost


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_longer_stream_goes_on_with_the_same_bits(name: str, tmp_path: Path) -> None:
    store = tmp_path / "long.h5"
    run(SYSTEMS[name], 300, store)
    found = run(SYSTEMS[name], 700, store)
    assert numbers(found) == numbers(run(SYSTEMS[name], 700, None))


def test_an_interrupted_run_goes_on_with_the_same_bits(tmp_path: Path) -> None:
    store = tmp_path / "long.h5"
    Shaky.last = 51 + 450  # differences for exponents call as well
    with pytest.raises(KeyboardInterrupt):
        run(Shaky(), 700, store)
    done = Measures.load(store).states
    assert 0 <= done < 700
    Shaky.last = Shaky.calls + 3000
    with pytest.raises(KeyboardInterrupt):
        run(Shaky(), 700, store)
    assert done < Measures.load(store).states < 700
    Shaky.last = 10**9
    found = run(Shaky(), 700, store)
    assert numbers(found) == numbers(Measures.load(store)) == numbers(run(Shaky(), 700, None))


def test_an_interruption_inside_a_measure_leaves_the_last_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, take, taken = tmp_path / "long.h5", RunningExponents.accumulate, [0]

    def interrupted(self: RunningExponents, block: Any) -> None:
        taken[0] += 1
        if taken[0] == 4:
            raise KeyboardInterrupt
        take(self, block)

    monkeypatch.setattr(RunningExponents, "accumulate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(Henon(), 700, store)
    assert {each.states for each in Measures.load(store).running.values()} == {300}
    found = run(Henon(), 700, store)
    assert numbers(found) == numbers(run(Henon(), 700, None))


KILLED = """
import sys
from dynkit.engine import collecting
from tests.analysis.test_measures import run, SYSTEMS
from pathlib import Path
collecting._LEAST_INTERVAL = 0.0
run(SYSTEMS[sys.argv[1]], 10**8, Path(sys.argv[2]))
"""


@pytest.mark.parametrize("name", ["henon", "chain"])
def test_a_store_is_read_meanwhile_and_survives_a_kill(name: str, tmp_path: Path) -> None:
    store = tmp_path / "long.h5"
    root = str(Path(__file__).parents[2])
    path = os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED, name, str(store)], env={**os.environ, "PYTHONPATH": path}
    )
    try:
        seen: list[int] = []
        while len(set(seen)) < 4 or seen[-1] < 500:
            assert process.poll() is None
            if store.exists():
                found = Measures.load(store)
                seen.append(found.states)
                assert {each.states for each in found.running.values()} == {found.states}
            time.sleep(0.02)
        with pytest.raises(ValueError, match="store must not be in use by another writer"):
            run(SYSTEMS[name], 10**8, store)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == -signal.SIGKILL
    assert seen == sorted(seen)
    done = Measures.load(store).states
    assert done >= seen[-1]
    found = run(SYSTEMS[name], done + 250, store)
    assert numbers(found) == numbers(run(SYSTEMS[name], done + 250, None))


def test_a_finished_store_needs_no_motion(tmp_path: Path) -> None:
    store = tmp_path / "long.h5"
    run(Shaky(), 300, store)
    before, Shaky.last = store.read_bytes(), Shaky.calls
    run(Shaky(), 300, store)
    assert store.read_bytes() == before


def test_the_states_before_the_end_of_a_motion_are_kept(tmp_path: Path) -> None:
    system = MatrixOscillator(
        M=[[1.0]], C=[[0.2]], K=[[1.0]], frequency=1.0, amplitude=0.0, restitution=0.5
    )
    start = system.state([2.0], [0.0])
    stream = system.stream(start=start, transient=0, keep=10**6, block=3)
    store = tmp_path / "long.h5"
    with pytest.raises(NoCrossing, match="there is no next state"):
        measure(stream, {"pod": RunningPOD()}, store=store, progress=False)
    kept = len(system.attractor(start=start, transient=0, keep=10**4).states)
    assert Measures.load(store).states == kept > 3


def test_a_run_that_measures_nothing_leaves_no_store(tmp_path: Path) -> None:
    """It would refuse the mended call."""
    stream, store = Logistic(rate=4.0).stream(start=[0.3], keep=100), tmp_path / "x.h5"
    wrong = {"x": RunningHistogram("speed", low=0.0, high=1.0)}
    with pytest.raises(ValueError, match=r"must be one of: state\[0\]; got 'speed'"):
        measure(stream, wrong, store=store, progress=False)
    assert not list(tmp_path.iterdir())
    mended = {"x": RunningHistogram("state[0]", low=0.0, high=1.0)}
    assert measure(stream, mended, store=store, progress=False).states == 100


def test_the_size_of_a_store_does_not_grow_with_the_blocks(tmp_path: Path) -> None:
    sizes = []
    for keep in (1 << 13, 1 << 16):  # with the same numbers of batches
        run(Henon(), keep, tmp_path / f"{keep}.h5", block=4096)
        sizes.append((tmp_path / f"{keep}.h5").stat().st_size)
    assert sizes[1] < 1.1 * sizes[0]


# --- wrong input ----------------------------------------------------------------------------------


def test_another_stream_or_other_measures_are_refused(tmp_path: Path) -> None:
    store = tmp_path / "long.h5"

    def refused(message: str, system: Any, wanted: Any = None, **stream: Any) -> None:
        given = {"start": [0.1, 0.1], "transient": 50, "keep": 500, "block": 100, **stream}
        with pytest.raises(ValueError, match=message):
            measure(system.stream(**given), wanted or every(), store=store, progress=False)

    run(Henon(), 300, store)
    refused("was made with a 1.4; got 1.3", Henon(a=1.3))
    refused(r"was made with stream.block 100; got 50", Henon(), block=50)
    refused("was made with stream.transient 50; got 60", Henon(), transient=60)
    refused("was made with stream.start .*; got ", Henon(), start=[0.1, 0.2])
    refused("keep must be 300 or more, as .* has; got 200", Henon(), keep=200)
    other = {**every(), "pod": RunningPOD()}
    refused(r"was made with measure pod RunningPOD\(about='mean'\); got R", Henon(), other)
    refused("was made with measures .*; got pod", Henon(), {"pod": RunningPOD(about="mean")})


def test_a_store_of_another_version_is_refused_unless_it_is_finished(tmp_path: Path) -> None:
    store = tmp_path / "long.h5"
    run(Henon(), 300, store)
    archive = stores.read(store)
    stores.write(store, stores.Archive({**archive.entries, "dynkit": "0.0.1"}, archive.arrays))
    assert run(Henon(), 300, store).states == 300
    with pytest.raises(ValueError, match=r"was made with dynkit 0.0.1, and is not finished; got"):
        run(Henon(), 400, store)


@pytest.mark.parametrize("missing", ["json", "_slots/pod/RunningPOD/_moments/sums"])
def test_a_store_without_an_array_is_refused(missing: str, tmp_path: Path) -> None:
    store = tmp_path / "long.h5"
    run(Henon(), 300, store)
    archive = stores.read(store)
    arrays = {name: array for name, array in archive.arrays.items() if name != missing}
    stores.write(store, stores.Archive(archive.entries, arrays))
    with pytest.raises(ValueError, match="store must hold all of a Measures"):
        Measures.load(store)


def test_a_store_without_a_measure_is_refused(tmp_path: Path) -> None:
    store = tmp_path / "long.h5"
    run(Henon(), 300, store)
    archive = stores.read(store)
    tree = json.loads(archive.arrays["json"].tobytes())
    tree["_slots"]["pod"]["RunningPOD"] = None
    arrays = {**archive.arrays, "json": np.frombuffer(json.dumps(tree).encode(), dtype=np.uint8)}
    stores.write(store, stores.Archive(archive.entries, arrays))
    for read in (Measures.load, lambda path: run(Henon(), 500, path)):
        with pytest.raises(ValueError, match=r"store must hold all of a Measures; .* is missing"):
            read(store)


@pytest.mark.parametrize(
    ("stream", "measures", "message"),
    [
        (Henon(), every(), r"stream must be a Stream, as system.stream\(\) returns; got Henon"),
        (None, {}, "measures must be a mapping of names to measures; got {}"),
        (None, [RunningPOD()], "measures must be a mapping of names to measures; got "),
        (None, {"pod": POD}, r"measures\['pod'\] must be a Running measure; got <class"),
        (None, {3: RunningPOD()}, r"measures\[3\] must be a Running measure; got RunningPOD"),
    ],
)
def test_wrong_arguments_are_refused(stream: Any, measures: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        measure(stream or Henon().stream(start=[0.1, 0.1], keep=10), measures)


def test_used_measures_are_refused() -> None:
    used = RunningPOD()
    used.add(Henon().attractor(start=[0.1, 0.1], keep=10))
    with pytest.raises(ValueError, match=r"measures\['pod'\] must be new; got .* of 10 states"):
        measure(Henon().stream(start=[0.1, 0.1], keep=10), {"pod": used})


# --- disks ----------------------------------------------------------------------------------------


def test_a_full_disk_leaves_the_blocks_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, write, written = tmp_path / "long.h5", stores.write, [0]

    def full(path: Path, archive: stores.Archive) -> None:
        written[0] += 1
        if written[0] >= 4:
            raise OSError(28, "store must be a file that can be written")
        write(path, archive)

    monkeypatch.setattr(stores, "write", full)
    with pytest.raises(OSError, match="store must be a file that can be written"):
        run(Henon(), 700, store)
    assert Measures.load(store).states == 200
    monkeypatch.setattr(stores, "write", write)
    assert numbers(run(Henon(), 700, store)) == numbers(run(Henon(), 700, None))


def test_a_store_that_cannot_be_written_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, archive: stores.Archive) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(stores, "write", full)
    with pytest.raises(ValueError, match="No space left on device"):
        run(Shaky(), 700, tmp_path / "long.h5")
    assert Shaky.calls == 0
    with pytest.raises(ValueError, match="store must be in a folder that exists"):
        run(Shaky(), 700, tmp_path / "none" / "long.h5")
