"""Throughput of maps of two parameters: impacts per second, by number of processes.

``python tests/benchmarks/scaling.py 200`` makes a map of 200 x 200 pairs of values by two processes
and writes it to ``map.png`` and ``map.h5`` in the folder where it is called.
"""

from __future__ import annotations

import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from dynkit import ParameterMap, parameter_map
from dynkit.plotting.figures import new_figure, print_style
from dynkit.systems import ImpactChain
from tests.benchmarks.report import table

TRANSIENT, KEEP = 900, 100


def the_map(size: int, workers: int, store: str | None = None) -> tuple[ParameterMap, float, float]:
    """The map, and seconds by the wall clock and of all processors."""
    values = {"frequency": np.linspace(0.2, 1.8, size), "damping": np.linspace(0.02, 0.3, size)}
    began = perf_counter(), _processors()
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as executor:
        found = parameter_map(
            ImpactChain(frequency=1.0),
            values,
            transient=TRANSIENT,
            keep=KEEP,
            executor=executor,
            store=store,
            progress=store is not None,
        )
    return found, perf_counter() - began[0], _processors() - began[1]


def _processors() -> float:
    used = [getrusage(who) for who in (RUSAGE_SELF, RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def row(size: int, workers: int, store: str | None = None) -> tuple[ParameterMap, list[str]]:
    found, wall, processors = the_map(size, workers, store)
    pairs = size * size
    impacts = pairs * (TRANSIENT + KEEP)
    return found, [
        f"{size} x {size}",
        str(workers),
        f"{wall:.1f}",
        f"{processors:.1f}",
        f"{1e3 * processors / pairs:.2f}",
        f"{impacts / wall:,.0f}",
        f"{impacts / processors:,.0f}",
    ]


HEAD = ("pairs", "processes", "s", "processor s", "ms a pair", "impacts/s", "impacts/processor s")


def scaling() -> None:
    """Print the table of a small map."""
    rows = [row(40, workers)[1] for workers in (1, 2)]
    table("Maps of frequency and damping, N = 10, start-up of the processes included", HEAD, rows)


def main() -> None:
    found, cells = row(int(sys.argv[1]), 2, "map.h5")
    table("Map of frequency and damping, N = 10", HEAD, [cells])
    print(f"\n{found}")
    figure, (axes,) = new_figure(height=3.2)
    with print_style():
        found.plot(axes)
        figure.savefig("map.png", dpi=600)


if __name__ == "__main__":
    main()
