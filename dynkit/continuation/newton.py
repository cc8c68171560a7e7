"""Newton's method for equations with one unknown more than there are equations, or as many."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np
from scipy.linalg.lapack import dgesv

from dynkit.continuation.problem import NoSolution
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.continuation.problem import Problem

ROUNDING = 2.0**-52
# Residuals below are rounding; above the second they are wrong, whatever Newton's method says.
_FLOOR, _ACCEPTABLE = 16.0 * ROUNDING, 1e-10


class NoConvergence(RuntimeError):
    """Newton's method found no solution; the message says how far it came."""


class Outcome(Enum):
    """How Newton's method ended."""

    CONVERGED = "the residual is near rounding"
    STALLED = "the residual no longer falls"
    SINGULAR = "the derivative is singular"
    LIMIT = "the number of steps was used up"
    UNDEFINED = "the equations are not defined there"


class Equations(ABC):
    """Equations R(y) = 0; the unknowns are scaled by `scale`."""

    @abstractmethod
    def residual(self, y: Array) -> Array:
        """Return the equations, (n,); may raise `NoSolution`."""

    @abstractmethod
    def jacobian(self, y: Array) -> Array:
        """Return their derivative, (n, number of unknowns); may raise `NoSolution`."""

    @abstractmethod
    def scale(self, y: Array) -> Array:
        """Return typical sizes of the unknowns, all positive."""


@final
class Correction(NamedTuple):
    """What Newton's method found: unknowns, outcome, and largest residuals step by step."""

    y: Array
    outcome: Outcome
    history: tuple[float, ...]
    message: str = ""

    @property
    def converged(self) -> bool:
        """Whether it is a solution."""
        return self.outcome is Outcome.CONVERGED


def correct(
    equations: Equations,
    y: Array,
    scale: Array,
    row: Array | None = None,
    *,
    level: float = _FLOOR,
    steps: int = 10,
    halvings: int = 3,
) -> Correction:
    """Solve R(y) = 0 from a guess by damped Newton steps.

    It goes on until the residual is at most `level`, or no longer falls and is near rounding.

    Parameters
    ----------
    equations : Equations
    y : (q,) array
        The guess.
    scale : (q,) array
        What the unknowns are measured in.
    row : (q,) array, optional
        In scaled unknowns: the steps are orthogonal to it. It is owed where there is one unknown
        more than equations.
    level : float
        Largest residual that needs no further step.
    steps, halvings : int
        How many steps at most, and how often one of them is halved.
    """
    history: list[float] = []
    try:
        f = equations.residual(y)
        size = float(abs(f).max())
        history.append(size)
        for _ in range(steps):
            if size <= level:
                return Correction(y, Outcome.CONVERGED, tuple(history))
            if not size < np.inf:
                return Correction(y, Outcome.UNDEFINED, tuple(history))
            step = _newton_step(equations.jacobian(y), f, scale, row)
            if step is None:
                return Correction(y, Outcome.SINGULAR, tuple(history))
            trial, f_trial, size_trial = _damped(equations, y, step, size, halvings)
            if not size_trial < size:
                near = size <= _ACCEPTABLE
                outcome = Outcome.CONVERGED if near else Outcome.STALLED
                return Correction(y, outcome, tuple(history))
            slow = size_trial > 0.5 * size
            y, f, size = trial, f_trial, size_trial
            history.append(size)
            if slow and size <= _ACCEPTABLE:
                return Correction(y, Outcome.CONVERGED, tuple(history))
    except NoSolution as refusal:
        return Correction(y, Outcome.UNDEFINED, tuple(history), str(refusal))
    outcome = Outcome.CONVERGED if size <= _ACCEPTABLE else Outcome.LIMIT
    return Correction(y, outcome, tuple(history))


def _newton_step(jacobian: Array, f: Array, scale: Array, row: Array | None) -> Array | None:
    n, q = jacobian.shape
    matrix = np.empty((q, q), order="F")
    np.multiply(jacobian, scale, out=matrix[:n])
    target = np.zeros(q)
    np.negative(f, out=target[:n])
    if row is not None:
        matrix[n] = row
    _, _, step, info = dgesv(matrix, target, overwrite_a=True, overwrite_b=True)
    if info != 0 or not np.isfinite(step).all():
        return None
    return np.asarray(step * scale)


def _damped(
    equations: Equations, y: Array, step: Array, size: float, halvings: int
) -> tuple[Array, Array, float]:
    """Return the first of y + step, y + step / 2, ... whose residual is smaller, or the last."""
    refusal = None
    for halving in range(halvings + 1):
        trial = y + step * 0.5**halving
        try:
            f = equations.residual(trial)
        except NoSolution as failure:
            refusal = failure
            continue
        size_trial = float(abs(f).max())
        # at rounding level a shorter step is no better
        if size_trial < size or size <= _ACCEPTABLE:
            return trial, f, size_trial
    if refusal is not None:
        raise refusal
    return trial, f, size_trial


def bordered_tangent(jacobian: Array, scale: Array, row: Array) -> tuple[Array, float] | None:
    """Return the unit null vector of a scaled derivative, along a row, and a determinant's sign.

    Parameters
    ----------
    jacobian : (n, n + 1) array
    scale, row : (n + 1,) arrays
        The row is in scaled unknowns; null vector and row make a sharp angle.

    Returns
    -------
    tuple of (n + 1,) array and float, or None
        In scaled unknowns; the determinant is that of the derivative with the vector as last row.
        None where it cannot be told.
    """
    n, q = jacobian.shape
    matrix = np.empty((q, q), order="F")
    np.multiply(jacobian, scale, out=matrix[:n])
    matrix[n] = row
    target = np.zeros(q)
    target[n] = 1.0
    factors, pivots, vector, info = dgesv(matrix, target, overwrite_a=True, overwrite_b=True)
    length = float(np.sqrt(vector @ vector))
    if info != 0 or not 0.0 < length < np.inf:
        return None
    exchanges = np.count_nonzero(pivots != np.arange(q))
    negative = np.count_nonzero(factors.diagonal() < 0.0)
    return vector / length, -1.0 if (exchanges + negative) % 2 else 1.0


def error_bound(
    jacobian: Array, f: Array, scale: Array, row: Array | None, rounding: Any = 4.0 * ROUNDING
) -> Array:
    """Return how far a solution with residual f may be from the exact one, unknown by unknown.

    It is twice |inverse of the derivative| (|f| + rounding): to first order a bound when the
    equations are right to `rounding`.
    """
    n, q = jacobian.shape
    matrix = np.empty((q, q))
    np.multiply(jacobian, scale, out=matrix[:n])
    if row is not None:
        matrix[n] = row
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return np.full(q, np.inf)
    return np.asarray(2.0 * scale * (abs(inverse[:, :n]) @ (abs(f) + rounding)))


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


def solve(problem: Problem, guess: Array, p: Array) -> tuple[Array, tuple[float, ...]]:
    """Return the unknowns of one orbit at given parameters, and the history of residuals.

    Raises
    ------
    NoConvergence
        When Newton's method does not get there from the guess.
    """
    equations = FixedParameters(problem, p)
    found = correct(equations, guess, problem.scale(guess), steps=50, halvings=12)
    if not found.converged:
        why = found.message or found.outcome.value
        how_far = f", residual {found.history[-1]:.1e}" if found.history else ""
        steps = max(len(found.history) - 1, 0)
        raise NoConvergence(
            f"no periodic orbit found from the guess after {steps} steps: {why}{how_far}"
        )
    return found.y, found.history
