"""Moreau's time stepping with fixed steps, as rigid body programs do it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import final

import numpy as np

from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.methods import (
    FoundImpacts,
    GaveUp,
    ImpactMethod,
    OverBudget,
    Simulation,
)
from dynkit.analysis.work_precision.models import ImpactModel
from dynkit.core.validation import Array

MOST = 20_000
"""Impacts that are kept."""

TEN = 10
"""Coordinates for which the budget is meant."""


@final
class MoreauTimeStepping(ImpactMethod):
    """Moreau's and Jean's method with theta = 1/2, compiled; its tolerance is the step.

    The step is given as a part of the table's period. An impact is where an impulse acts after a
    step without one, at the end of its step: its time has an error of the first order in the step.
    Sticking needs no case of its own, and bounces that are shorter than a step are never resolved.

    Parameters
    ----------
    tolerances : sequence of float
    budget : int
        Steps of ten coordinates; of more coordinates fewer, as one step takes N^2 products.

    References
    ----------
    V. Acary, B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, Springer (2008),
    chapter 10.
    """

    name = "Moreau"

    def __init__(
        self,
        tolerances: Sequence[float] = (1e-2, 1e-3, 1e-4, 1e-5),
        budget: int = 5_000_000,
    ) -> None:
        self.tolerances = tuple(tolerances)
        self.budget = budget

    def prepare(self, exact: ExactImpacts, tolerance: float) -> Simulation:
        from tests.benchmarks.peers.moreau_kernels import DONE, step_through

        model = ImpactModel.of(exact)
        n, h = model.size, tolerance * exact.period
        steps = math.ceil(model.until / h)
        half = 0.5 * h
        whole = model.mass + half * model.damping + half * half * model.stiffness
        inverse = np.linalg.inv(whole)
        by_velocity = np.eye(n) - h * inverse @ (model.damping + half * model.stiffness)
        by_position = -h * inverse @ model.stiffness
        acting = np.array([model.harmonic.real, model.harmonic.imag, model.constant], float).T
        forcing: Array = h * inverse @ acting
        pushed = np.ascontiguousarray(inverse[:, model.contact])
        table = np.array([model.amplitude, model.offset, model.frequency, model.phase])

        def through(steps: int) -> FoundImpacts:
            times, states, releases = np.empty(MOST), np.empty((MOST, 2, n)), np.empty(MOST)
            status, impacts, released = step_through(
                by_velocity, by_position, forcing, pushed, table, model.contact, model.sign,
                model.restitution, h, steps, np.stack([model.position, model.velocity]),
                np.empty(n), times, states, releases,
            )  # fmt: skip
            if status != DONE:
                raise GaveUp(f"gave up after {MOST} impacts")
            x, v = states[:impacts, 0], states[:impacts, 1]
            if not np.isfinite(x).all() or not np.isfinite(v).all():
                raise GaveUp("gave up: not finite")
            return FoundImpacts(times[:impacts], x, v, releases[:released], {"steps": steps})

        def simulate(budget: int) -> FoundImpacts:
            most = budget * TEN * TEN // max(n, TEN) ** 2
            if steps > most:
                raise OverBudget("steps")
            return through(steps)

        through(1)  # compiles
        return simulate
