"""Benchmark of Lyapunov spectra: processor time per impact, beside the motion alone."""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import numpy as np

from dynkit.systems import BouncingBall, ImpactChain
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from tests.benchmarks.report import table

CASES: tuple[tuple[str, ImpactOscillator], ...] = (
    ("1 mass without spring, chaos", BouncingBall(amplitude=1.0, frequency=3.0, restitution=0.95)),
    ("3 masses, chaos", ImpactChain(masses=3, frequency=1.4)),
    ("10 masses, chaos", ImpactChain(frequency=1.346)),
    ("10 masses, P(1,3)", ImpactChain(frequency=0.87)),
    ("10 masses, sticking", ImpactChain(frequency=0.408)),
    ("10 masses, every impact sticks", ImpactChain(frequency=0.408, restitution=0.0)),
    (
        "10 masses, dashpots apart",
        ImpactChain(frequency=0.87, damping=tuple(np.linspace(0.01, 0.2, 10).tolist())),
    ),
    ("10 masses, overdamped", ImpactChain(frequency=0.87, damping=5.0)),
    ("30 masses", ImpactChain(masses=30, frequency=0.87)),
    ("100 masses", ImpactChain(masses=100, frequency=0.87)),
)


def processor_time(call: Callable[[], object], runs: int = 5) -> float:
    best = np.inf
    for _ in range(runs):
        began = process_time()
        call()
        best = min(best, process_time() - began)
    return float(best)


def lyapunov_speed() -> None:
    rows = []
    for name, system in CASES:
        n = system.degrees_of_freedom
        count = max(20_000 // n, 200)
        state = system.attractor(transient=500, impacts=1).states[-1]
        start = system.impact_state(state)
        found = system.stretching(state, count)
        assert found.times is not None
        both = processor_time(lambda: system.stretching(state, count))  # noqa: B023
        alone = processor_time(lambda: system.simulate(impacts=count, start=start))  # noqa: B023
        trace = float(np.trace(np.linalg.solve(system.mass, system.damping_matrix)))
        with np.errstate(divide="ignore", invalid="ignore"):
            expected = 2.0 * np.log(system.restitution) - trace * found.times
            gaps = abs(found.logs.sum(axis=1) - expected)
        gaps = gaps[np.isfinite(gaps)]
        error = f"{gaps.max():.0e}" if gaps.size else ""
        rows.append((name, 2 * n, f"{1e6 * alone / count:.2f}", f"{1e6 * both / count:.1f}", error))
    table(
        "Lyapunov spectrum, processor time in microseconds per impact",
        ("motion", "exponents", "motion alone", "with all exponents", "largest error of the sum"),
        rows,
    )


if __name__ == "__main__":
    lyapunov_speed()
