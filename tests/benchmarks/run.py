"""Benchmarks: speed beside accuracy, as Markdown tables. Run by ``make bench``.

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
from mpmath import mp
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from dynkit import sweep
from dynkit.systems import ImpactChain
from tests.benchmarks.continuation import continuation
from tests.benchmarks.dimension import dimensions
from tests.benchmarks.lyapunov import lyapunov_speed
from tests.benchmarks.report import table
from tests.benchmarks.scaling import scaling
from tests.benchmarks.sticking import sticking
from tests.benchmarks.structures import structures
from tests.reference import solve_ivp_peer
from tests.reference.values import PAPER_CHAIN

Array = NDArray[np.float64]

METHODS: tuple[tuple[solve_ivp_peer.Method, float], ...] = (
    ("RK45", 1e-6),
    ("RK45", 1e-10),
    ("DOP853", 1e-10),
    ("DOP853", 1e-13),
    ("LSODA", 1e-10),
    ("Radau", 1e-8),
)


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
    values = np.linspace(0.14, 2.0, 931)
    chain = ImpactChain(frequency=0.14)
    seconds = fastest(lambda: sweep(chain, "frequency", values, progress=False), 3)
    print(f"\nFigure 4, 931 x 800 impacts: {seconds:.2f} s")


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


def error_of(time: float, tip: float, key: tuple[float, int]) -> float:
    """Largest error of time (relative) and tip position (absolute) against many digits."""
    exact = PAPER_CHAIN[key]
    with mp.workdps(30):
        late = abs(mp.mpf(time) / mp.mpf(exact.time) - 1)
        off = abs(mp.mpf(tip) - mp.mpf(exact.tip))
        return float(max(late, off))


def beside_solve_ivp() -> None:
    chain = ImpactChain(frequency=0.87)
    rows: list[tuple[object, ...]] = []
    for count in (10, 50):
        record = chain.simulate(impacts=count)
        seconds = fastest(partial(chain.simulate, impacts=count))
        error = error_of(record.time[-1], record.position[-1, -1], (0.87, count))
        rows.append(("dynkit", "", count, f"{count / seconds:,.0f}", f"{error:.1e}"))
    start = chain.state()
    for method, rtol in METHODS:
        run = solve_ivp_peer.simulate(
            np.ones(10),
            np.ones(10),
            damping=0.1,
            restitution=0.85,
            amplitude=0.1,
            offset=0.0,
            frequency=0.87,
            position=start.position,
            velocity=start.velocity,
            impacts=10,
            method=method,
            rtol=rtol,
            atol=0.01 * rtol,
        )
        error = error_of(run.time[-1], run.position[-1, -1], (0.87, 10))
        rows.append(
            (f"solve_ivp {method}", f"{rtol:.0e}", 10, f"{10 / run.seconds:,.0f}", f"{error:.1e}")
        )
    head = ("method", "rtol", "impacts", "impacts per second", "error")
    table("The same impacts by other means, frequency 0.87, start of mode 1", head, rows)


def grazing(count: int = 200, depth: float = 1e-9) -> None:
    """Starts whose first dip is `depth` deep: how many impacts are missed?"""
    rng = np.random.default_rng(0)
    away = ImpactChain(frequency=0.87, offset=-100.0, damping=0.02)
    times = np.linspace(0.0, 30.0, 3001)
    missed = {"dynkit": 0, "solve_ivp DOP853 1e-10": 0}
    done = 0
    while done < count:
        start = away.state(0.3 * rng.normal(size=10), 0.3 * rng.normal(size=10), phase=0.0)
        flight = away.simulate(impacts=1, start=start)
        gap = flight.sample(times)[0][:, -1] - 0.1 * np.sin(0.87 * times)
        k = int(np.argmin(gap))
        if not 50 < k < len(times) - 50:
            continue
        fine = np.linspace(times[k - 1], times[k + 1], 20_001)
        lowest = flight.sample(fine)[0][:, -1] - 0.1 * np.sin(0.87 * fine)
        at, offset = float(fine[np.argmin(lowest)]), float(lowest.min()) + depth
        chain = away.replace(offset=offset)
        done += 1
        record = chain.simulate(impacts=1, start=chain.state(start.position, start.velocity))
        missed["dynkit"] += not (len(record) and abs(record.time[0] - at) < 1e-3)
        run = solve_ivp_peer.simulate(
            np.ones(10),
            np.ones(10),
            damping=0.02,
            restitution=0.85,
            amplitude=0.1,
            offset=offset,
            frequency=0.87,
            position=start.position,
            velocity=start.velocity,
            impacts=1,
        )
        found = run.time.size and abs(run.time[0] - at) < 1e-3
        missed["solve_ivp DOP853 1e-10"] += not found
    table(
        f"Impacts missed out of {count} starts that graze {depth:g} deep",
        ("method", "missed"),
        missed.items(),
    )


def main() -> None:
    impact_speed()
    lyapunov_speed()
    growth_with_size()
    structures()
    continuation()
    sticking()
    dimensions()
    scaling()
    start_up()
    beside_solve_ivp()
    grazing()


if __name__ == "__main__":
    main()
