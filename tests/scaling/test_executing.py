"""What goes to an executor, how much at a time, and what becomes of errors."""

import json
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dynkit.data.store
from dynkit import Sweep, WorkerLost, explore, parameter_map, sweep
from dynkit.core.no_motion import Refused
from dynkit.engine import executors as executing
from dynkit.engine.collecting import chunks_of
from dynkit.engine.executors import finished
from dynkit.systems import Henon, Logistic
from tests.scaling.cases import (
    SHORT,
    START,
    VALUES,
    Backwards,
    Deadly,
    Refusing,
    bits,
    mapped,
    processes,
    swept,
)

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("count", [1, 7, 255, 256, 1000, 40_000])
def test_chunks_cover_all_points_once_and_are_of_one_size(count: int) -> None:
    chunks = chunks_of(count)
    assert [place for chunk in chunks for place in range(*chunk)] == list(range(count))
    assert len({last - first for first, last in chunks[:-1]}) <= 1
    assert max(last - first for first, last in chunks) <= 32


def double(number: int) -> int:
    return 2 * number


def third_and_later_fail(number: int) -> int:
    if number > 2:
        raise ValueError(f"number must be small; got {number}")
    return number


def test_what_an_executor_holds_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executing, "IN_FLIGHT", 5)
    with Backwards() as executor:
        assert dict(finished(double, range(100), executor)) == {i: 2 * i for i in range(100)}
        assert executor.most <= 5


def test_the_first_task_that_fails_is_the_one_that_is_told() -> None:
    found: dict[int, int] = {}
    with Backwards() as executor:
        results = finished(third_and_later_fail, range(50), executor)
        with pytest.raises(ValueError, match="small; got 3"):
            found.update(results)
    assert found == {0: 0, 1: 1, 2: 2}


def test_a_refusal_reads_as_it_does_without_an_executor() -> None:
    arguments: dict[str, Any] = {"start": START, "follow": False, **SHORT}
    with (
        Backwards() as executor,
        pytest.raises(Refused, match=r"got 1\.0\nat a 1\.0\n") as told,
    ):
        sweep(Refusing(), "a", [0.2, 1.0, 1.1], executor=executor, **arguments)
    with pytest.raises(Refused, match=r"got 1\.0\nat a 1\.0$") as here:
        sweep(Refusing(), "a", [0.2, 1.0, 1.1], **arguments)
    assert str(told.value) == str(here.value)


def test_a_refusal_says_where_the_worker_was() -> None:
    with processes(1) as executor, pytest.raises(Refused, match="at a") as told:
        sweep(Refusing(), "a", [1.0], start=START, follow=False, executor=executor, **SHORT)
    assert "cases.py" in told.value.__notes__[1]


def test_a_worker_that_dies_has_an_error_of_its_own_and_the_store_the_rest(tmp_path: Path) -> None:
    file, store = tmp_path / "deadly", tmp_path / "x.h5"
    file.touch()
    system = Deadly(file=str(file))
    with processes(1) as executor, pytest.raises(WorkerLost, match="BrokenProcessPool"):
        mapped(executor, system, store=store)
    with ThreadPoolExecutor(2) as executor:
        resumed = mapped(executor, system, store=store)
    assert bits(resumed) == bits(mapped(system=system))


def test_a_pool_that_was_shut_down_is_a_lost_one() -> None:
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    with pytest.raises(WorkerLost, match="after shutdown"):
        mapped(executor)


@pytest.mark.parametrize("executor", [4, "processes", object()])
def test_what_is_no_executor_is_refused(executor: Any) -> None:
    with pytest.raises(ValueError, match=r"executor must be a concurrent\.futures\.Executor"):
        mapped(executor=executor)


def test_values_that_follow_one_another_take_no_executor() -> None:
    with ThreadPoolExecutor(1) as executor, pytest.raises(ValueError, match="follow=False makes"):
        sweep(Henon(), "a", [0.2], start=START, executor=executor, **SHORT)


def test_a_system_that_cannot_be_sent_is_refused() -> None:
    class Local(Henon):
        pass

    with ThreadPoolExecutor(1) as executor, pytest.raises(ValueError, match="must be picklable"):
        mapped(executor, Local())


MAIN = """
import json
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from dynkit import explore, sweep
from dynkit.systems import Logistic

class Mine(Logistic):
    pass

def refusal(call, *arguments, **options):
    with ProcessPoolExecutor(1, get_context("spawn")) as executor:
        try:
            call(Mine(), "rate", *arguments, executor=executor, **options)
        except ValueError as error:
            return str(error)

swept = refusal(sweep, [3.2], start=[0.3], follow=False, progress=False)
print(json.dumps({"sweep": swept, "explore": refusal(explore, (2.8, 3.5), box=[(0.1, 1.0)])}))
"""


@cache
def refusals() -> dict[str, str]:
    """What is said of a class of a program that is given as text."""
    done = subprocess.run(
        [sys.executable, "-c", MAIN], capture_output=True, text=True, check=True, timeout=120
    )
    found: dict[str, str] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("name", ["sweep", "explore"])
def test_a_class_that_workers_cannot_import_is_refused_by_name(name: str) -> None:
    said = refusals()[name]
    assert "system must be of a class that the workers of the executor can import" in said
    assert "'Mine'" in said


INTERRUPTED = """
import os, signal, sys, threading, time
from tests.scaling.cases import mapped, processes

def interrupt(after):
    # Python drops an interrupt that comes while it removes an object: then comes another one
    while True:
        time.sleep(after)
        os.kill(os.getpid(), signal.SIGINT)
        after = 20.0

if __name__ == "__main__":
    # shells let what runs in the background ignore it
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with processes(1) as executor:
        mapped(executor)  # now it is awake
        threading.Thread(target=interrupt, args=[{after}], daemon=True).start()
        for _ in range(100_000):
            mapped(executor, store=sys.argv[1])
            os.unlink(sys.argv[1])
"""


def test_an_interrupt_leaves_a_store_that_can_be_resumed(tmp_path: Path) -> None:
    script, store = tmp_path / "script.py", tmp_path / "x.h5"
    script.write_text(INTERRUPTED.format(after=0.2))
    done = subprocess.run(
        [sys.executable, str(script), str(store)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == -signal.SIGINT, done.stderr
    assert bits(mapped(store=store)) == bits(mapped())
    assert [file.name for file in tmp_path.iterdir()].count("x.h5") == 1


def test_finished_chunks_are_not_done_again(tmp_path: Path) -> None:
    first = mapped(store=tmp_path / "x.h5")
    lost = ThreadPoolExecutor(1)
    lost.shutdown()
    assert bits(mapped(lost, store=tmp_path / "x.h5")) == bits(first)


def test_threads_simulate_beside_one_another() -> None:
    """Both are in the work at once: each waits for the other."""
    with ThreadPoolExecutor(2) as executor:
        together = threading.Barrier(2, timeout=60.0)
        _BARRIERS.append(together)
        assert len(dict(finished(meet, range(2), executor))) == 2


_BARRIERS: list[threading.Barrier] = []


def meet(_: int) -> int:
    return _BARRIERS[-1].wait()


def test_a_network_that_loses_its_workers_is_told_as_far_as_it_came(tmp_path: Path) -> None:
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    with pytest.raises(WorkerLost):
        explore(Logistic(rate=2.9), "rate", (2.8, 3.5), box=[(0.1, 1.0)], executor=executor)


def test_the_store_of_other_values_is_refused(tmp_path: Path) -> None:
    mapped(store=tmp_path / "x.h5")
    other = {"a": VALUES["a"] * [1, 1, 1, 1, 1, 1, 0.9], "b": VALUES["b"]}
    with pytest.raises(ValueError, match=r"store .*x\.h5 was made with values of a\[6\] 1\.3"):
        parameter_map(Henon(), other, start=START, store=tmp_path / "x.h5", **SHORT)


def test_a_store_that_lacks_a_part_is_refused(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    mapped(store=store)
    archive = dynkit.data.store.read(store)
    arrays = {name: array for name, array in archive.arrays.items() if name != "done"}
    dynkit.data.store.write(store, dynkit.data.store.Archive(archive.entries, arrays))
    with pytest.raises(ValueError, match="store must hold all of a map of two parameters"):
        mapped(store=store)


def test_a_sweep_of_independent_starts_is_loaded_as_it_was_stored(tmp_path: Path) -> None:
    found = swept(store=tmp_path / "x.h5")
    loaded = Sweep.load(tmp_path / "x.h5", Henon())
    assert bits(loaded) == bits(found)
    assert loaded.labels == found.labels
    with pytest.raises(ValueError, match=r"was made with b 0\.3; got 0\.2"):
        Sweep.load(tmp_path / "x.h5", Henon(b=0.2))


def test_independent_values_all_start_from_the_start() -> None:
    found = swept()
    for place, a in enumerate(found.values.tolist()):
        alone = found.attractor(place).states
        expected = Henon(a=a).iterate(np.array(START), 89)[60:]
        assert alone.tobytes() == expected.tobytes()
        assert found.observable("state[0]")[place].tobytes() == expected[:, 0].tobytes()


def test_rows_of_a_store_that_would_broadcast_are_refused(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    mapped(store=store)
    archive = dynkit.data.store.read(store)
    for name in ("found/largest", "found/sizes", "texts/ending"):
        arrays = {**archive.arrays, name: archive.arrays[name][:1]}
        dynkit.data.store.write(store, dynkit.data.store.Archive(archive.entries, arrays))
        with pytest.raises(ValueError, match=f"all of a map of two parameters.*{name[6:]} has 1"):
            mapped(store=store)
    narrow = {**archive.arrays, "found/sizes": archive.arrays["found/sizes"][:, :1]}
    dynkit.data.store.write(store, dynkit.data.store.Archive(archive.entries, narrow))
    with pytest.raises(ValueError, match="sizes is float64"):
        mapped(store=store)
    dynkit.data.store.write(
        store, dynkit.data.store.Archive({**archive.entries, "points": str(10**15)}, archive.arrays)
    )
    with pytest.raises(ValueError, match="1000000000000000 points"):
        mapped(store=store)
