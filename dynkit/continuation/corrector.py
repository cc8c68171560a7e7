"""Correctors: from a guess to a point of the curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, final

from dynkit.continuation.points import LEAST_LEVEL, Point, rescaled
from dynkit.continuation.termination import Reason
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.orbits.newton import (
    SHORT,
    Correction,
    Direction,
    Equations,
    Outcome,
    bordered_direction,
    correct,
)

# Largest residual that is accepted as the rounding level of a point.
_LARGEST_LEVEL = 1e-12


@final
class Failure(NamedTuple):
    """Why there is no point, or none that is accepted."""

    reason: Reason
    message: str


class Corrector(Protocol):
    """Finds the point of R(y) = 0 on the plane through a guess (q,) that is orthogonal to a row.

    The row (q,) is in units of the scale of a near point.
    """

    def __call__(
        self, equations: Equations, guess: Array, near: Point, row: Array
    ) -> Point | Failure:
        """Return the point, or why there is none."""
        ...


@final
@dataclass(frozen=True)
class NewtonCorrector:
    """Damped Newton steps, with limits of their number and of the halvings of each.

    References
    ----------
    H. B. Keller, as in `continue_orbit`.
    """

    steps: int = 10
    halvings: int = 3

    def __call__(
        self, equations: Equations, guess: Array, near: Point, row: Array
    ) -> Point | Failure:
        solution = correct(
            equations,
            guess,
            near.scale,
            row,
            level=near.level,
            steps=self.steps,
            halvings=self.halvings,
        )
        if not solution.converged:
            undefined = solution.outcome is Outcome.UNDEFINED
            reason = Reason.NO_SOLUTION if undefined else Reason.NO_CONVERGENCE
            return Failure(reason, solution.message or solution.outcome.value)
        scale = near.scale
        wanted = equations.scale(solution.y)
        ratio = wanted / scale
        if ratio.max() > 2.0 or ratio.min() < 0.5:
            scale = wanted
        direction = _direction(equations, solution, near, row, scale)
        if isinstance(direction, Failure):
            return direction
        residual = solution.history[-1]
        return Point(
            solution.y,
            scale,
            *direction,
            residual,
            iterations=len(solution.history) - 1,
            level=min(max(LEAST_LEVEL, 2.0 * residual), _LARGEST_LEVEL),
        )


def _direction(
    equations: Equations, solution: Correction, near: Point, row: Array, scale: Array
) -> Direction | Failure:
    # after such a short step the direction at the previous iterate is accurate enough
    if row is near.tangent and scale is near.scale and solution.moved < SHORT:
        if solution.direction is not None:
            return solution.direction
        return Failure(Reason.NO_CONVERGENCE, "the curve has no direction there")
    try:
        jacobian = equations.jacobian(solution.y)
    except NoMotion as refusal:
        return Failure(Reason.NO_SOLUTION, str(refusal))
    direction = bordered_direction(jacobian, scale, rescaled(near, scale))
    return direction or Failure(Reason.NO_CONVERGENCE, "the curve has no direction there")
