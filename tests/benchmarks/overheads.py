"""What surrounds the kernel of impacts: sweeps, short runs, cells of basins, points of planes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from dynkit import basins, parameter_map, sweep
from dynkit.systems import ImpactChain, SingleImpactOscillator
from dynkit.systems.impact.simulation import ensemble_kernels, loop_kernels
from tests.benchmarks.report import table

SWEPT = np.linspace(0.14, 2.0, 931)
"""Frequencies of figure 4."""


def shares(call: Callable[[], object], runs: int = 3) -> tuple[float, float]:
    """Least processor seconds of a call, and those of the kernels of impacts in it."""
    inside = 0.0

    def timed(plain: Any, *arguments: Any) -> Any:
        nonlocal inside
        began = process_time()
        try:
            return plain(*arguments)
        finally:
            inside += process_time() - began

    best = np.inf, np.inf
    kernels: Any = (loop_kernels, "run"), (ensemble_kernels, "arrive")
    plains = [getattr(module, name) for module, name in kernels]
    for (module, name), plain in zip(kernels, plains, strict=True):
        setattr(module, name, partial(timed, plain))
    try:
        for _ in range(runs):
            inside, began = 0.0, process_time()
            call()
            best = min(best, (process_time() - began, inside))
    finally:
        for (module, name), plain in zip(kernels, plains, strict=True):
            setattr(module, name, plain)
    return best


def overheads() -> None:
    """Print the table."""
    chain = ImpactChain(frequency=0.87)
    start = chain.simulate(impacts=3000).final
    calls = 300
    short = partial(chain.simulate, impacts=10, start=start)
    ten, _ = shares(lambda: [short() for _ in range(calls)])
    many, _ = shares(partial(chain.simulate, impacts=20_000, start=start))

    one = SingleImpactOscillator(frequency=2.2, restitution=0.8)
    starts = np.zeros((120, 120, 3))
    starts[..., 0] = np.linspace(-1.5, -0.05, 120)[:, None]
    starts[..., 1] = np.linspace(-1.0, 1.0, 120)
    plane = {"frequency": np.linspace(0.2, 1.8, 12), "restitution": np.linspace(0.3, 0.9, 12)}
    cases = (
        (
            "value of figure 4's sweep, N = 10, 800 impacts",
            SWEPT.size,
            partial(sweep, chain, "frequency", SWEPT, progress=False),
            "1.5",
        ),
        (
            "cell of a basin, one mass, until it arrives at P(1,1)",
            14_400,
            partial(basins, one, starts, transient=200, keep=50, progress=False),
            "",
        ),
        (
            "point of a plane, N = 10, 1000 impacts and a label",
            144,
            partial(parameter_map, chain, plane, transient=900, keep=100, progress=False),
            "1.18",
        ),
    )
    rows = []
    for what, count, call, limit in cases:
        call()
        whole, inside = shares(call)
        times = f"{1e3 * whole / count:.2f}", f"{1e3 * inside / count:.2f}"
        rows.append((what, *times, f"{whole / inside:.2f}", limit))
    impact = many / 20_000
    rows.append(
        (
            "`simulate(impacts=10)`, in impacts of a long run",
            f"{1e3 * ten / calls:.3f}",
            f"{1e3 * impact:.5f}",
            f"{ten / calls / impact:.0f}",
            "80",
        )
    )
    head = ("job", "ms", "ms in the kernel", "ratio", "limit")
    table("Processor time of a job over that of the kernel of impacts in it", head, rows)


if __name__ == "__main__":
    overheads()
