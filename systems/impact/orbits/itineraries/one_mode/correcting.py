"""Newton's method with a parameter of the table as an unknown, for impacts of one mode."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.newton import ACCEPTABLE, SHORT, Correction, Direction, Outcome
from dynkit.systems.impact.orbits.itineraries.one_mode.terms import Terms
from dynkit.systems.impact.simulation.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.itineraries.one_mode.responses import Windows

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


@final
class TableCorrector:
    """A corrector that takes all steps of Newton's method in one kernel.

    Parameters
    ----------
    windows : Windows
    clock, numbers : (2,), (2, e, 4)
        Frequency of the phase and numbers of the table: constant part, and factor of the parameter.
    within : (float, float)
        Range of the parameter.
    turn : float
        Phase of a period.
    sides, units : (n,), (2n,)
    """

    def __init__(
        self,
        windows: Windows,
        clock: Array,
        numbers: Array,
        within: tuple[float, float],
        turn: float,
        sides: Any,
        units: Array,
    ) -> None:
        from dynkit.systems.impact.orbits.itineraries.one_mode.correction_kernels import (
            Buffers,
            Family,
        )
        from dynkit.systems.impact.orbits.itineraries.one_mode.response_kernels import Assembled

        mode, kicks, empty = windows.motion.mode, windows.kicks, np.empty
        alone, n = mode.layout.modes, len(sides)
        q, shape = 2 * n + 1, kicks.shape
        self._mode = mode
        self._family = Family(
            *within, clock, numbers, turn, sides, alone, kicks, windows.rows, units
        )
        self._buffers = Buffers(
            Assembled.of(n, shape[1:]),
            np.zeros((1, 2, 2, shape[2])),
            empty((1, 2, 0, 0)),
            empty(shape),
            empty(shape),
            empty(1),
            empty(numbers.shape[1:]),
            *(empty(q - 1), empty(q), empty(q)),
            *(empty((q, q)), empty((q, 2))),
        )

    def __call__(
        self, guess: Array, scale: Array, row: Array, level: float, steps: int, halvings: int
    ) -> Correction | None:
        """Return the result of `dynkit.orbits.newton.correct`; None unless it converges."""
        from dynkit.systems.impact.orbits.itineraries.one_mode.correction_kernels import correct

        y, history, tangent = guess.copy(), np.empty(steps + 1), np.empty(len(guess))
        kept = self._mode.propagators.ladder, self._mode.work, self._family, y, scale, row
        found = history, tangent, self._buffers
        count, turn = correct(*kept, level, ACCEPTABLE, SHORT, halvings, *found)
        if not count:
            return None
        residuals = tuple(history[:count].tolist())
        return Correction(y, Outcome.CONVERGED, residuals, Direction(tangent, turn), 0.0)


def corrector_of(problem: Any) -> TableCorrector | None:
    """Return the corrector of a problem with one free parameter; None where it does not apply."""
    sides, names = problem.sides, problem.names
    if not (problem.responds and len(names) == 1 and problem.plain and len(sides) <= _MOST):
        return None
    windows, own, (name,) = problem.windows, problem.oscillator, names
    mode, terms = windows.motion.mode, Terms.of(own)
    if len(np.intersect1d(mode.propagators.links, mode.layout.modes)):
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
    own = TWO_PI * problem.periods, sides, problem.units_of_equations
    return TableCorrector(windows, clock, numbers, _RANGES[name], *own)
