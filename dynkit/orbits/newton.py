"""Newton's method for n equations with n or n + 1 unknowns."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from typing import Any, NamedTuple, final

import numpy as np
from scipy.linalg.lapack import dgesv

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array, all_finite

ROUNDING = 2.0**-52
# A residual below _FLOOR is rounding. A solution has a residual below ACCEPTABLE; a solution of
# stiff equations may have one below _STIFF, if each residual is at most four rounding errors.
_FLOOR, ACCEPTABLE, _STIFF = 16.0 * ROUNDING, 1e-10, 1e-8
# Relative rounding error of the unknowns in the error bound.
_OF_UNKNOWNS = 4.0 * ROUNDING
SHORT = 1e-8
"""After a last step below this, in scaled unknowns, the direction need not be computed again."""


class NoSolution(NoMotion):
    """The equations of an orbit are not defined at these unknowns and parameters."""


class NoConvergence(RuntimeError):
    """Newton's method did not converge; the message has the last residual."""


class Outcome(Enum):
    """Outcome of Newton's method."""

    CONVERGED = "the residual is near rounding"
    STALLED = "the residual no longer falls"
    SINGULAR = "the derivative is singular"
    LIMIT = "the number of steps was used up"
    UNDEFINED = "the equations are not defined there"


@final
class Direction(NamedTuple):
    """Direction of a curve: `tangent`, of unit length in scaled unknowns, along a given row.

    `turn` is the sign of the determinant of the derivative with the tangent as last row.
    """

    tangent: Array
    turn: float


class Equations(ABC):
    """Equations R(y) = 0; the unknowns are scaled by `scale`."""

    @abstractmethod
    def residual(self, y: Array) -> Array:
        """Return the equations, (n,); may raise `NoMotion`."""

    @abstractmethod
    def jacobian(self, y: Array) -> Array:
        """Return their derivative, (n, number of unknowns); may raise `NoMotion`."""

    @abstractmethod
    def scale(self, y: Array) -> Array:
        """Return typical sizes of the unknowns, all positive."""

    @abstractmethod
    def rounding(self, y: Array) -> Array:
        """Return the rounding error of each equation."""

    @abstractmethod
    def linearization_error(self, y: Array) -> Any:
        """Return the error beyond rounding of the derivative's first m rows and columns, (m, m).

        Zero for a derivative with rounding errors only.
        """

    def corrected(
        self,
        y: Array,  # noqa: ARG002
        scale: Array,  # noqa: ARG002
        row: Array,  # noqa: ARG002
        limits: tuple[float, int, int],  # noqa: ARG002
    ) -> Correction | None:
        """Return the result of `correct` along a row, computed faster; by default None.

        `limits` are its level, steps and halvings. None also where it does not converge.
        """
        return None


@final
class Correction(NamedTuple):
    """Result of Newton's method: unknowns, outcome, and the largest residual at each step.

    `direction` is the `Direction` at an iterate, `moved` the length of the steps after it in scaled
    unknowns.
    """

    y: Array
    outcome: Outcome
    history: tuple[float, ...]
    direction: Direction | None = None
    moved: float = np.inf
    message: str = ""

    @property
    def converged(self) -> bool:
        """Whether Newton's method converged."""
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

    The iteration ends when the residual is at most `level`, or is near rounding and no longer falls
    by half.

    Parameters
    ----------
    equations : Equations
    y : (q,) array
        The guess.
    scale : (q,) array
        Units of the unknowns.
    row : (q,) array, optional
        Vector in scaled unknowns to which the steps are orthogonal; required for q - 1 equations.
    level : float
        Largest residual that needs no further step.
    steps, halvings : int
        Largest number of steps, and of halvings of one step.
    """
    if row is not None:
        found = equations.corrected(y, scale, row, (level, steps, halvings))
        if found is not None:
            return found
    history: list[float] = []
    direction, moved = None, np.inf

    def ended(outcome: Outcome, message: str = "") -> Correction:
        return Correction(y, outcome, tuple(history), direction, moved, message)

    try:
        f = equations.residual(y)
        size = float(abs(f).max())
        history.append(size)
        for _ in range(steps):
            if size <= level:
                return ended(Outcome.CONVERGED)
            if not size < np.inf:
                return ended(Outcome.UNDEFINED)
            step, direction = _newton_step(equations.jacobian(y), f, scale, row)
            if step is None:
                return ended(Outcome.SINGULAR)
            trial, f_trial, size_trial = _damped(equations, y, step * scale, size, halvings)
            if not size_trial < size:
                moved, near = 0.0, size <= ACCEPTABLE
                if ACCEPTABLE < size < _STIFF:
                    near = bool((abs(f) <= 4.0 * equations.rounding(y)).all())
                return ended(Outcome.CONVERGED if near else Outcome.STALLED)
            slow = size_trial > 0.5 * size
            moved = float(np.sqrt(step @ step))
            y, f, size = trial, f_trial, size_trial
            history.append(size)
            if slow and size <= ACCEPTABLE:
                return ended(Outcome.CONVERGED)
    except NoMotion as refusal:
        return ended(Outcome.UNDEFINED, str(refusal))
    return ended(Outcome.CONVERGED if size <= ACCEPTABLE else Outcome.LIMIT)


def _newton_step(
    jacobian: Array, f: Array, scale: Array, row: Array | None
) -> tuple[Array | None, Direction | None]:
    """Return the step in scaled unknowns and, with a row, the direction along it."""
    if row is None:
        try:
            step = np.asarray(np.linalg.solve(jacobian * scale, -f))
        except np.linalg.LinAlgError:
            return None, None
        return (step, None) if all_finite(step) else (None, None)
    solved = _bordered(jacobian, f, scale, row)
    return (None, None) if solved is None else solved


def _bordered(
    jacobian: Array, f: Array | float, scale: Array, row: Array
) -> tuple[Array, Direction] | None:
    n, q = jacobian.shape
    matrix = np.empty((q, q), order="F")
    np.multiply(jacobian, scale, out=matrix[:n])
    matrix[n] = row
    targets = np.zeros((q, 2), order="F")
    targets[:n, 0] = -f
    targets[n, 1] = 1.0
    factors, pivots, solved, info = dgesv(matrix, targets, overwrite_a=True, overwrite_b=True)
    if info != 0 or not all_finite(solved):
        return None
    vector = solved[:, 1]
    exchanges = np.count_nonzero(pivots != np.arange(q))
    negative = np.count_nonzero(factors.diagonal() < 0.0)
    turn = -1.0 if (exchanges + negative) % 2 else 1.0
    return solved[:, 0], Direction(vector / np.sqrt(vector @ vector), turn)


def _damped(
    equations: Equations, y: Array, step: Array, size: float, halvings: int
) -> tuple[Array, Array, float]:
    """Return the first of y + step, y + step / 2, ... whose residual is smaller, or the last."""
    refusal = None
    for halving in range(halvings + 1):
        trial = y + step * 0.5**halving
        try:
            f = equations.residual(trial)
        except NoMotion as failure:
            refusal = failure
            continue
        size_trial = float(abs(f).max())
        # near rounding a shorter step does not reduce the residual
        if size_trial < size or size <= ACCEPTABLE:
            return trial, f, size_trial
    if refusal is not None:
        raise refusal
    return trial, f, size_trial


def bordered_direction(jacobian: Array, scale: Array, row: Array) -> Direction | None:
    """Return the direction of a curve from its derivative (n, n + 1); None if that is singular.

    The row, (n + 1,), is in scaled unknowns; the tangent makes an acute angle with it.
    """
    solved = _bordered(jacobian, 0.0, scale, row)
    return None if solved is None else solved[1]


def error_bound(
    equations: Equations, jacobian: Array, y: Array, scale: Array, row: Array | None
) -> Array:
    """Return a bound of the error of each unknown of a solution y.

    It is 2 |inverse of the derivative| (|residual| + rounding): a bound to first order when errors
    of the equations are at most `rounding` plus four roundings of |derivative| |y|. The inverse is
    the largest within the error of the derivative; the bound is infinite where the derivative may
    be singular.
    """
    f, rounding, off = (
        asked(y)
        for asked in (equations.residual, equations.rounding, equations.linearization_error)
    )
    n, q = jacobian.shape
    matrix = np.empty((q, q))
    np.multiply(jacobian, scale, out=matrix[:n])
    if row is not None:
        matrix[n] = row
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return np.full(q, np.inf)
    left = abs(f) + rounding + _OF_UNKNOWNS * (abs(jacobian) @ abs(y))
    bound = np.asarray(2.0 * scale * (abs(inverse[:, :n]) @ left))
    if np.any(off):
        # |1 / (A + E)| <= |1 / A| + |1 / A| |E| |1 / (A + E)|
        m, grown = len(off), np.zeros((q, q))
        grown[:, :m] = abs(inverse[:, :m]) @ (off * scale[:m])
        if not grown.sum(axis=1).max() < 1.0:
            return np.full(q, np.inf)
        bound = scale * np.linalg.solve(np.eye(q) - grown, bound / scale)
    return bound
