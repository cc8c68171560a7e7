"""Small work for executors, and its bits."""

import hashlib
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from threading import Condition, Thread
from typing import Any

import numpy as np

from dynkit import Basins, Network, ParameterMap, Sweep, basins, explore, parameter_map, sweep
from dynkit.core.no_motion import Refused
from dynkit.core.validation import Array
from dynkit.systems import Henon, Logistic

SHORT: dict[str, Any] = {"transient": 60, "keep": 30, "progress": False}
VALUES = {"a": np.linspace(0.2, 1.3, 7), "b": np.linspace(-0.3, 0.3, 6)}
START = [0.1, 0.1]
STARTS = np.stack(np.meshgrid(*2 * [np.linspace(-2.0, 2.0, 6)], indexing="ij"), axis=-1)


def swept(executor: Executor | None = None, **more: Any) -> Sweep:
    """Henon's map at eleven values of a."""
    return sweep(
        Henon(),
        "a",
        np.linspace(0.2, 1.3, 11),
        start=START,
        follow=False,
        executor=executor,
        **SHORT,
        **more,
    )


def mapped(
    executor: Executor | None = None, system: Henon | None = None, **more: Any
) -> ParameterMap:
    """Henon's map at 7 x 6 values of a and b."""
    family = Henon() if system is None else system
    return parameter_map(family, VALUES, start=START, executor=executor, **{**SHORT, **more})


def attracted(executor: Executor | None = None, **more: Any) -> Basins:
    """Henon's map from 6 x 6 starts."""
    return basins(Henon(a=1.0), STARTS, executor=executor, **SHORT, **more)


def explored(executor: Executor | None = None, **more: Any) -> Network:
    """The logistic map through a period doubling."""
    arguments: dict[str, Any] = {"iterates": 2, "values": 2, "box": [(0.1, 1.0)], **more}
    return explore(Logistic(rate=2.9), "rate", (2.8, 3.3), executor=executor, **arguments)


def bits(found: Sweep | ParameterMap | Basins | Network) -> str:
    """A hash of all that was found, but for seconds."""
    parts: list[object] = []
    if isinstance(found, Sweep):
        parts += [found.observable(name) for name in found.observables]
        parts += [found.counts, found.endings, found.cost.counts]
    elif isinstance(found, ParameterMap):
        parts += [found.names, found.iterates, found.periods, found.error, found.endings]
        parts += [*map(found.largest, found.observables), found.cost.counts]
    elif isinstance(found, Basins):
        parts += [found.numbers, found.error, found.cost.counts]
        parts += [part for b in found.basins for part in (str(b.label), b.start, b.states)]
    else:
        parts += [found.links, found.unexplored, found.message, found.cost.counts]
        for branch in found.branches:
            parts += [branch.label, branch.parameter, branch.unknowns, branch.stable]
            parts += [(b.kind, b.value, b.error) for b in branch.bifurcations]
    digest = hashlib.sha256()
    for part in parts:
        array = isinstance(part, np.ndarray) and part.dtype.kind != "U"
        digest.update(part.tobytes() if array else repr(_plain(part)).encode())  # type: ignore[attr-defined]
    return digest.hexdigest()


def _plain(part: object) -> object:
    return part.tolist() if isinstance(part, np.ndarray) else part


ALL: dict[str, Callable[[Executor | None], Sweep | ParameterMap | Basins | Network]] = {
    "sweep": swept,
    "parameter_map": mapped,
    "basins": attracted,
    "explore": explored,
}


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """Processes that start from nothing, as on all platforms."""
    from concurrent.futures import ProcessPoolExecutor

    with ProcessPoolExecutor(count, get_context("spawn")) as executor:
        yield executor


@dataclass(frozen=True)
class Deadly(Henon):
    """Kills its process, once: where a is large, when there is a certain file."""

    file: str = ""

    def __call__(self, state: Array) -> Array:
        if self.a > 0.9:
            try:
                Path(self.file).unlink()
            except FileNotFoundError:
                pass
            else:
                os.kill(os.getpid(), signal.SIGKILL)
        return super().__call__(state)


@dataclass(frozen=True)
class Refusing(Henon):
    """Has no state where a is large: says so late, and the later values at once."""

    def __call__(self, state: Array) -> Array:
        if self.a > 0.9:
            raise Refused(f"a must be small; got {self.a}")
        return super().__call__(state)


class Backwards(Executor):
    """One thread that does what came last first; counts how much it holds."""

    def __init__(self) -> None:
        self.most = 0
        self._held: list[tuple[Future[Any], Callable[[], Any]]] = []
        self._more = Condition()
        self._ended = False
        self._thread = Thread(target=self._work)
        self._thread.start()

    def submit(self, call: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        future: Future[Any] = Future()
        with self._more:
            self._held.append((future, partial(call, *arguments, **named)))
            self.most = max(self.most, len(self._held))
            self._more.notify()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        with self._more:
            self._ended = True
            self._more.notify()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._more:
                self._more.wait_for(lambda: self._held or self._ended)
                if not self._held:
                    return
                future, call = self._held.pop()
            if future.set_running_or_notify_cancel():
                future.set_result(call())
