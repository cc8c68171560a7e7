"""Throughput of maps of two parameters and of basins, by number of processes.

``python tests/benchmarks/scaling.py 200`` makes a map of 200 x 200 pairs of values by two processes
and writes it to ``map.png`` and ``map.h5`` in the folder where it is called.
``python tests/benchmarks/scaling.py`` prints larger maps and basins by one process and by two.
"""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
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
from tests.benchmarks.report import table

TRANSIENT, KEEP = 900, 100


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


def _processors() -> float:
    used = [getrusage(who) for who in (RUSAGE_SELF, RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def row(
    what: str, count: int, workers: int, make: Callable[[Executor], Any]
) -> tuple[Any, list[str]]:
    """What was made, and its row: seconds by the wall clock, and of all processors."""
    began = perf_counter(), _processors()
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as executor:
        found = make(executor)
    wall, processors = perf_counter() - began[0], _processors() - began[1]
    return found, [
        what,
        str(workers),
        f"{wall:.1f}",
        f"{processors:.1f}",
        f"{1e3 * processors / count:.3f}",
        f"{count / wall:,.0f}",
    ]


HEAD = ("job", "processes", "s", "processor s", "ms a point", "points/s")
TITLE = (
    "Maps of frequency and damping, N = 10, and basins of one mass; the processes' start included"
)


def scaling(pairs: int = 40, cells: int = 200) -> None:
    """Print a map of pairs x pairs, and cells x cells starts, by one process and by two."""
    jobs = (
        (f"map, {pairs} x {pairs}", pairs**2, partial(the_map, pairs)),
        (f"basins, {cells} x {cells}", cells**2, partial(the_basins, cells)),
    )
    table(TITLE, HEAD, [row(*job[:2], workers, job[2])[1] for job in jobs for workers in (1, 2)])


def main() -> None:
    if len(sys.argv) < 2:
        scaling(100, 1000)
        return
    size = int(sys.argv[1])
    make = partial(the_map, size, store="map.h5")
    found, cells = row(f"map, {size} x {size}", size**2, 2, make)
    table("Map of frequency and damping, N = 10", HEAD, [cells])
    print(f"\n{found}")
    figure, (axes,) = new_figure(height=3.2)
    with print_style():
        found.plot(axes)
        figure.savefig("map.png", dpi=600)


if __name__ == "__main__":
    main()
