"""Throughput of maps of two parameters and of basins, by number of processes.

``python tests/benchmarks/scaling.py 200`` makes a map of 200 x 200 pairs of values by two processes
and writes it to ``map.png`` and ``map.h5`` in the folder where it is called.
``python tests/benchmarks/scaling.py`` measures a map and basins by one process and by two,
and writes their table into ``docs/_static/scaling.txt``, which a page of the documentation shows.
"""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from time import perf_counter
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from dynkit import Basins, ParameterMap, basins, parameter_map
from dynkit.plotting.figures import new_figure, print_style
from dynkit.systems import ImpactChain, SingleImpactOscillator
from tests.benchmarks.report import Line, markdown

TRANSIENT, KEEP = 900, 100
PAGE = Path(__file__).parents[2] / "docs" / "_static" / "scaling.txt"


def the_map(size: int, executor: Executor, store: str | None = None) -> ParameterMap:
    """Frequencies and dampings of the chain."""
    values = {"frequency": np.linspace(0.2, 1.8, size), "damping": np.linspace(0.02, 0.3, size)}
    return parameter_map(
        ImpactChain(frequency=1.0),
        values,
        transient=TRANSIENT,
        keep=KEEP,
        executor=executor,
        store=store,
        progress=store is not None,
    )


def the_basins(size: int, executor: Executor) -> Basins:
    """Starts of the one-mass oscillator."""
    starts = np.zeros((size, size, 3))
    starts[..., 0] = np.linspace(-1.5, -0.05, size)[:, None]
    starts[..., 1] = np.linspace(-1.0, 1.0, size)
    one = SingleImpactOscillator(frequency=2.2, restitution=0.8)
    return basins(one, starts, transient=200, keep=50, executor=executor, progress=False)


@dataclass(frozen=True)
class Run:
    """Seconds of a run by some processes: by the wall clock, and of processors."""

    workers: int
    wall: float
    within: float
    """Of the workers."""
    outside: float
    """Of the process that calls."""

    @property
    def processors(self) -> float:
        """Of all processes."""
        return self.within + self.outside

    def cells(self, what: str, count: int, one: Run | None = None) -> list[str]:
        """The row of the table, beside the run by one process."""
        single = one or self
        return [
            what,
            str(self.workers),
            f"{self.wall:.1f}",
            f"{self.within:.1f}",
            f"{self.outside:.1f}",
            f"{1e3 * self.processors / count:.3f}",
            f"{100 * single.wall / (self.workers * self.wall):.0f} %",
            f"{100 * single.processors / self.processors:.0f} %",
        ]


def _spent(who: int) -> float:
    used = getrusage(who)
    return used.ru_utime + used.ru_stime


def timed(workers: int, make: Callable[[Executor], Any]) -> tuple[Any, Run]:
    """What was made, and its seconds; the start of the processes is included."""
    ways = RUSAGE_CHILDREN, RUSAGE_SELF
    began, before = perf_counter(), [_spent(who) for who in ways]
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as executor:
        found = make(executor)
    wall = perf_counter() - began
    within, outside = (_spent(who) - old for who, old in zip(ways, before, strict=True))
    return found, Run(workers, wall, within, outside)


HEAD = (
    *("job", "processes", "s", "processor s of workers", "of the caller", "ms a point"),
    *("efficiency", "by processor time"),
)

Pairs = list[tuple[str, int, Run, Run]]


def by_one_and_two(pairs: int, cells: int) -> Pairs:
    """Return the runs of a map of pairs x pairs, and of cells x cells starts, by one and by two.

    Each is run twice, in turns, and the run of less time by the wall clock counts.
    """
    jobs = (
        (f"map, {pairs} x {pairs}", pairs**2, partial(the_map, pairs)),
        (f"basins, {cells} x {cells}", cells**2, partial(the_basins, cells)),
    )
    found: Pairs = []
    for what, count, make in jobs:
        runs = [timed(workers, make)[1] for _ in range(2) for workers in (1, 2)]
        one, two = (min(runs[k::2], key=lambda run: run.wall) for k in (0, 1))
        found.append((what, count, one, two))
    return found


def scaling() -> Iterator[Line]:
    """The lines of this file; the processes' start is included."""
    for what, _, one, two in by_one_and_two(40, 200):
        yield Line(f"{what}, by two processes", two.processors, "by one", one.processors)


def main() -> None:
    if len(sys.argv) < 2:
        rows: list[list[str]] = []
        for what, count, one, two in by_one_and_two(40, 300):
            rows += [one.cells(what, count), two.cells(what, count, one)]
        PAGE.write_text(markdown(HEAD, rows) + "\n", encoding="utf-8")
        return
    size = int(sys.argv[1])
    found, run = timed(2, partial(the_map, size, store="map.h5"))
    print(markdown(HEAD, [run.cells(f"map, {size} x {size}", size**2)]))
    print(f"\n{found}")
    figure, (axes,) = new_figure(height=3.2)
    with print_style():
        found.plot(axes)
        figure.savefig("map.png", dpi=600)


if __name__ == "__main__":
    main()
