"""Processes that sweep with a store, and are killed or started together; forked, so they are cheap.

Run as a program of its own, which has one thread and has imported and done everything once:
``python -m tests.sweeps.killing CAMPAIGN FOLDER SEED`` writes what happened as JSON.
"""

import json
import os
import random
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import dynkit.data.store
from dynkit import Sweep, sweep
from dynkit.engine import collecting
from dynkit.systems import Logistic
from tests.sweeps.cases import CHAIN, FREQUENCIES, SHORT

KILLS, ROUNDS, WRITERS = 200, 10, 4
MOMENTS: list[tuple[str, float]] = [
    ("fsync", 1),  # the first file is written, but not yet in its place
    ("replace", 9),
    ("fsync", 16),  # in its place, the folder not yet flushed
    *(("any", delay) for delay in np.random.default_rng(1).uniform(0.0, 0.03, 5).tolist()),
]
"""When sweeps of a chain die: at a call of the system, or so many seconds after the first write."""

RATES = np.linspace(3.4, 3.9, 8)


def swept(store: Path | None) -> Sweep:
    return sweep(
        Logistic(3.5),
        "rate",
        RATES,
        start=[0.3],
        transient=20,
        keep=10,
        store=store,
        progress=False,
    )


def rows_of(store: Path) -> dict[str, Any]:
    return {name: array.tolist() for name, array in dynkit.data.store.read(store).arrays.items()}


def forked(work: Callable[..., None], *arguments: Any) -> int:
    """Start a process that does the work and ends; its number."""
    number = os.fork()
    if number == 0:
        try:
            work(*arguments)
        finally:
            os._exit(0)
    return number


def kill(folder: Path, seed: int) -> dict[str, Any]:
    """Kill sweeps of one store, each going on where the last was killed, until 200 are dead."""
    store, draw = folder / "x.h5", random.Random(seed)
    collecting._LEAST_INTERVAL, collecting._SHARE = 0.0, np.inf
    for _ in range(2):  # the first imports
        store.unlink(missing_ok=True)
        began = time.monotonic()
        swept(store)
        lasts = time.monotonic() - began
    whole = rows_of(store)
    store.unlink()
    killed: list[dict[str, Any]] = []
    finished: list[dict[str, Any]] = []
    while len(killed) < KILLS:
        told, tell = os.pipe()
        by_itself = draw.random() < 0.5
        seed = draw.randrange(2**32)
        number = forked(_sweep_and_tell, store, tell, seed if by_itself else None)
        os.close(tell)
        if not by_itself:
            time.sleep(draw.uniform(0.0, lasts))
            os.kill(number, signal.SIGKILL)
        _, status = os.waitpid(number, 0)
        with os.fdopen(told, "rb") as stream:
            reported = list(stream.read())
        if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL:
            killed.append(_found(store, whole, reported))
        elif os.WEXITSTATUS(status) == 0:
            finished.append(_found(store, whole, reported))
            store.unlink()
    swept(store)
    finished.append(_found(store, whole, []))
    return {"killed": killed, "finished": finished}


def _found(store: Path, whole: dict[str, Any], reported: list[int]) -> dict[str, Any]:
    rows = rows_of(store) if store.exists() else None
    survived = 0 if rows is None else len(rows["done"])
    return {
        "reported": reported[-1] if reported else 0,
        "survived": survived,
        "right": rows is None
        or (
            (rows.keys() == whole.keys() or not rows["done"])
            and all(found == whole[name][: len(found)] for name, found in rows.items())
        ),
        "left": sorted(path.name for path in store.parent.iterdir()),
    }


def _sweep_and_tell(store: Path, tell: int, seed: int | None) -> None:
    """Sweep; tell how much is stored after each write; die at some call of the system."""
    write = dynkit.data.store.write

    def write_and_tell(path: Path, archive: dynkit.data.store.Archive) -> None:
        write(path, archive)
        os.write(tell, bytes([len(archive.arrays["done"])]))

    dynkit.data.store.write = write_and_tell
    if seed is not None:
        _die_at(random.Random(seed))
    swept(store)


def _die_at(draw: random.Random) -> None:
    calls = draw.randrange(1, 40)

    def die() -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    def dying(name: str) -> Callable[..., Any]:
        call = getattr(os, name)

        def counted(*arguments: Any, **options: Any) -> Any:
            nonlocal calls
            calls -= 1
            if calls:
                return call(*arguments, **options)
            if name == "fsync" and draw.random() < 0.5:  # as if killed in the midst of writing
                file = arguments[0]
                os.ftruncate(file, draw.randrange(os.fstat(file).st_size))
            elif draw.random() < 0.5:
                call(*arguments, **options)
            return die()

        return counted

    for name in ("open", "fsync", "replace", "unlink", "close"):
        setattr(os, name, dying(name))


def moments(folder: Path, seed: int) -> list[int]:
    """Kill sweeps of a chain, each with a store of its own: how many values survived."""
    collecting._LEAST_INTERVAL, collecting._SHARE = 0.0, np.inf
    sweep(CHAIN, "frequency", FREQUENCIES, store=folder / "warm.h5", **SHORT)
    survived = []
    for place, (moment, number) in enumerate(MOMENTS):
        store = folder / f"{place}.h5"
        _, status = os.waitpid(forked(_sweep_until, store, moment, number), 0)
        assert os.WIFSIGNALED(status)
        assert os.WTERMSIG(status) == signal.SIGKILL
        survived.append(len(rows_of(store)["done"]) if store.exists() else 0)
    return survived


def _sweep_until(store: Path, moment: str, number: float) -> None:
    if moment == "any":
        threading.Thread(target=_die_after, args=(store, number), daemon=True).start()
    else:
        call, count = getattr(os, moment), 0

        def counted(*arguments: Any) -> Any:
            nonlocal count
            count += 1
            return os.kill(os.getpid(), signal.SIGKILL) if count == number else call(*arguments)

        setattr(os, moment, counted)
    sweep(CHAIN, "frequency", FREQUENCIES, store=store, **SHORT)
    time.sleep(60)


def _die_after(store: Path, delay: float) -> None:
    while not store.exists():
        time.sleep(0.0001)
    empty = store.stat().st_mtime_ns
    while store.stat().st_mtime_ns == empty:
        time.sleep(0.0001)
    time.sleep(delay)
    os.kill(os.getpid(), signal.SIGKILL)


def race(folder: Path, seed: int) -> dict[str, Any]:
    """Start writers of one store all at once, again and again: what each of them found."""
    expected = swept(None).observable("state[0]").tolist()
    swept(folder / "warm.h5")
    outcomes = []
    for number in range(ROUNDS):
        store = folder / f"{number}.h5"
        wait, go = os.pipe()
        told, tell = os.pipe()

        numbers = [forked(_compete, store, expected, (wait, go), tell) for _ in range(WRITERS)]
        for handle in (wait, go, tell):
            os.close(handle)
        for each in numbers:
            os.waitpid(each, 0)
        with os.fdopen(told, "r") as stream:
            outcomes.append(sorted(stream.read().splitlines()))
    left = sorted(path.name for path in folder.iterdir())
    same = [rows_of(folder / name) == rows_of(folder / "warm.h5") for name in left]
    return {"outcomes": outcomes, "left": left, "same": same}


def _compete(store: Path, expected: Any, gate: tuple[int, int], tell: int) -> None:
    wait, go = gate
    os.close(go)
    os.read(wait, 1)  # until the last of those who could write there has closed it
    try:
        found = swept(store).observable("state[0]").tolist()
        said = "right" if found == expected else "wrong"
    except ValueError as refusal:
        said = str(refusal).replace(str(store.parent), "")
    os.write(tell, f"{said}\n".encode())


if __name__ == "__main__":
    campaigns: dict[str, Callable[..., Any]] = {"kill": kill, "moments": moments, "race": race}
    json.dump(campaigns[sys.argv[1]](Path(sys.argv[2]), int(sys.argv[3])), sys.stdout)
