"""Benchmarks: speed beside accuracy, as Markdown tables. Run by ``make bench``.

Error against run time is drawn too: ``results/error-time.png``, the figure of the README, and
``results/error-time-flows.png``.

Times are minima over several runs on one core of whatever machine this is; ratios within one run
are what may be compared. Nothing here is asserted.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np

from dynkit.systems import ImpactChain
from tests.benchmarks.continuation import continuation
from tests.benchmarks.dimension import dimensions
from tests.benchmarks.extremes import extremes
from tests.benchmarks.flows import flows
from tests.benchmarks.lyapunov import lyapunov_speed
from tests.benchmarks.machines import machines
from tests.benchmarks.overheads import overheads
from tests.benchmarks.report import table
from tests.benchmarks.scaling import scaling
from tests.benchmarks.sticking import sticking
from tests.benchmarks.structures import structures
from tests.benchmarks.symbols import symbols
from tests.benchmarks.work_precision import work_precision

RESULTS = Path("results")
"""Where the figure of error against run time goes."""


def fastest(call: Callable[[], object], runs: int = 7) -> float:
    best = np.inf
    for _ in range(runs):
        began = perf_counter()
        call()
        best = min(best, perf_counter() - began)
    return float(best)


def impact_speed() -> None:
    rows = []
    for frequency, motion in ((0.35, "chaos"), (0.87, "P(1,3)"), (0.408, "sticking")):
        chain = ImpactChain(frequency=frequency)
        start = chain.simulate(impacts=3000).final
        record = chain.simulate(impacts=20_000, start=start)
        seconds = fastest(partial(chain.simulate, impacts=20_000, start=start))
        cells = record.cost.counts["cells"] / len(record)
        rows.append((frequency, motion, f"{1e6 * seconds / len(record):.2f}", f"{cells:.1f}"))
    table("Microseconds per impact, N = 10", ("frequency", "motion", "us", "cells"), rows)


def growth_with_size() -> None:
    rows = []
    for masses in (10, 30, 100, 300, 1000):
        chain = ImpactChain(masses=masses, frequency=0.35)
        began = perf_counter()
        start = chain.state(np.zeros(masses), np.zeros(masses), phase=np.pi)
        prepared = perf_counter() - began
        start = chain.simulate(impacts=100, start=start).final
        count = max(100_000 // masses, 300)
        record = chain.simulate(impacts=count, start=start)
        seconds = fastest(partial(chain.simulate, impacts=count, start=start), 3)
        flight = float(record.time[-1]) / count
        rows.append(
            (
                masses,
                f"{prepared:.2f}",
                f"{1e6 * seconds / count:.2f}",
                f"{flight:.1f}",
                f"{record.cost.counts['cells'] / count:.1f}",
                f"{1e9 * seconds / flight / count / masses:.2f}",
            )
        )
    head = ("N", "set-up (s)", "us per impact", "flight time", "cells", "ns per mass and unit time")
    table("Growth with the number of masses, frequency 0.35, from rest", head, rows)


def start_up() -> None:
    simulate = (
        "from dynkit.systems import ImpactChain; ImpactChain(frequency=0.87).simulate(impacts=100)"
    )
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        for name, code in (
            ("python alone", "pass"),
            ("import dynkit", "import dynkit"),
            ("first simulate, compilation included", simulate),
            ("simulate in a second process", simulate),
        ):
            began = perf_counter()
            subprocess.run([sys.executable, "-c", code], env=environment, check=True)
            rows.append((name, f"{perf_counter() - began:.2f}"))
    table("Seconds of a whole process", ("process", "s"), rows)


def main() -> None:
    impact_speed()
    overheads()
    lyapunov_speed()
    growth_with_size()
    structures()
    continuation()
    sticking()
    dimensions()
    symbols()
    scaling()
    start_up()
    print("\n### Error against run time\n", flush=True)
    RESULTS.mkdir(exist_ok=True)
    work_precision(str(RESULTS / "error-time.png"), log=sys.stdout)
    flows(RESULTS / "error-time-flows.png")
    machines()
    print("\n### Extreme cases\n", flush=True)
    extremes(log=sys.stdout)


if __name__ == "__main__":
    main()
