"""Lyapunov spectra, beside the motion alone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynkit.systems import BouncingBall, DryFriction, HardStop, ImpactChain, SoftStop
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from tests.benchmarks.report import Line, in_turns

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
    (
        "10 masses, two stops, soft stop and belt",
        ImpactChain(
            frequency=0.87,
            elements=[
                HardStop(9, amplitude=0.1, restitution=0.85),
                HardStop(4, offset=-0.15, restitution=0.7),
                SoftStop(2, offset=-0.1, stiffness=50.0, damping=0.2),
                DryFriction(0, force=0.002, velocity=0.05),
            ],
        ),
    ),
)


def lyapunov_speed() -> Iterator[Line]:
    """All exponents of some motions, beside the motion alone."""
    for name, system in CASES:
        n = system.degrees_of_freedom
        count = max(20_000 // n, 200)
        state = system.attractor(transient=500, impacts=1).states[-1]
        start = system.impact_state(state)
        system.stretching(state, count)
        both, alone = in_turns(
            lambda: system.stretching(state, count),  # noqa: B023
            lambda: system.simulate(impacts=count, start=start),  # noqa: B023
        )
        yield Line(
            f"impact with all exponents, {name}", both / count, "the motion alone", alone / count
        )
