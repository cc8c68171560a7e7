"""Newton's method with a parameter of the table as an unknown, for impacts of one mode."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.newton import ACCEPTABLE, SHORT, Correction, Direction, Outcome
from dynkit.systems.impact.orbits.itineraries.one_mode.terms import Terms
from dynkit.systems.impact.simulation.state import TWO_PI

_POSITIVE = 5e-324, math.inf
_RANGES = {
    "frequency": _POSITIVE,
    "restitution": (0.0, 1.0),
    "amplitude": (0.0, math.inf),
    "offset": (-math.inf, math.inf),
    "play": _POSITIVE,
}
"""Ranges of the parameters that are `EXACT`."""

_MOST = 20
"""Largest number of impacts for the kernel: for more, LAPACK solves the equations faster."""


Corrector = Callable[[Array, Array, Array, float, int, int], Correction | None]
"""From guess, scale, row, level, steps and halvings to the result of `newton.correct`.

None unless it converges.
"""


def corrector_of(problem: Any) -> Corrector | None:
    """Return a corrector that takes all steps of Newton's method in one kernel.

    It serves problems with one free parameter of the table; None for others.
    """
    sides, names = problem.sides, problem.names
    if not (problem.responds and len(names) == 1 and problem.plain and len(sides) <= _MOST):
        return None
    windows, own, (name,) = problem.windows, problem.oscillator, names
    mode, terms = windows.motion.mode, Terms.of(own)
    alone = mode.layout.modes
    if len(np.intersect1d(mode.propagators.links, alone)):
        return None
    clock, numbers = np.array([terms.frequency, 0.0]), np.zeros((2, *terms.numbers.shape))
    numbers[0] = terms.numbers
    if name != "frequency":
        first = 1.0 if name == "play" else 0.0
        here, there = (Terms.of(own, {name: first + k}).numbers for k in (0.0, 1.0))
        numbers = np.stack([here - first * (there - here), there - here])
    elif terms.shape.any():
        return None
    else:
        clock = np.array([0.0, 1.0])
    from dynkit.systems.impact.orbits.itineraries.one_mode.correction_kernels import (
        Family,
        buffers_of,
        correct,
    )

    turn, units, kicks = TWO_PI * problem.periods, problem.units_of_equations, windows.kicks
    table = *_RANGES[name], clock, numbers, turn
    family = Family(*table, sides, alone, kicks, windows.rows, units)
    buffers = buffers_of(family)

    def corrected(
        guess: Array, scale: Array, row: Array, level: float, steps: int, halvings: int
    ) -> Correction | None:
        y, history, tangent = guess.copy(), np.empty(steps + 1), np.empty(len(guess))
        kept = mode.propagators.ladder, mode.work, family, y, scale, row
        found = history, tangent, buffers
        count, turned = correct(*kept, level, ACCEPTABLE, SHORT, halvings, *found)
        if not count:
            return None
        residuals = tuple(history[:count].tolist())
        return Correction(y, Outcome.CONVERGED, residuals, Direction(tangent, turned), 0.0)

    return corrected
