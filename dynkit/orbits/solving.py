"""One solution of a problem at given parameters: Newton's method, and the error of the result."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.newton import Equations, NoConvergence, correct, error_bound


@final
class FixedParameters(Equations):
    """Equations of one orbit at given parameters."""

    def __init__(self, problem: Problem, p: Array) -> None:
        self._problem = problem
        self._p = p

    def residual(self, y: Array) -> Array:
        return self._problem.residual(y, self._p)

    def jacobian(self, y: Array) -> Array:
        return np.asarray(self._problem.linearization(y, self._p))

    def scale(self, y: Array) -> Array:
        return self._problem.scale(y)

    def rounding(self, y: Array) -> Array:
        return self._problem.rounding(y, self._p)

    def linearization_error(self, y: Array) -> Any:
        return self._problem.linearization_error(y, self._p)


def orbit_bound(problem: Problem, x: Array, p: Array) -> Array:
    """Return the `error_bound` (m,) of the unknowns of one orbit at given parameters.

    Raises
    ------
    NoMotion
        When the equations have no derivative at x.
    """
    equations = FixedParameters(problem, p)
    return error_bound(equations, equations.jacobian(x), x, equations.scale(x), None)


def solve(
    problem: Problem, guess: Array, p: Array, what: str = "no periodic orbit"
) -> tuple[Array, tuple[float, ...]]:
    """Return the unknowns of one solution at given parameters, and the history of residuals.

    The message begins with the text `what` when no solution is found.

    Raises
    ------
    NoConvergence
        When Newton's method does not converge from the guess.
    """
    equations = FixedParameters(problem, p)
    found = correct(equations, guess, problem.scale(guess), steps=50, halvings=12)
    if not found.converged:
        why = found.message or found.outcome.value
        how_far = f", residual {found.history[-1]:.1e}" if found.history else ""
        steps = max(len(found.history) - 1, 0)
        raise NoConvergence(f"{what} found from the guess after {steps} steps: {why}{how_far}")
    return found.y, found.history
