"""Borders of a branch of orbits: test functions, and the conditions of their zeros."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import Condition
from dynkit.orbits.kinds import BifurcationKind


class Border(Condition):
    """A test function along a branch, and the condition that it is zero.

    A subclass must implement the abstract methods.

    Parameters
    ----------
    problem : ImpactProblem
    part : int
        Number of the orbit's state after which the zero occurs.
    number : int
        Number of the impact, or of the flight.
    side : int
        Number of the stop whose gap is watched.
    """

    kind = BifurcationKind.CB
    ends = True
    """Whether no orbit of this kind exists beyond the border."""
    unknowns = 0

    def __init__(self, problem: Any, part: int, number: int = 0, side: int = 0) -> None:
        self.problem, self.part, self.number, self.side = problem, part, number, side

    @abstractmethod
    def value(self, solution: Any) -> float:
        """Value of the test function, positive on the admissible side: see `Event`."""

    def left(self, solution: Any, own: Array) -> Any:  # noqa: ARG002
        """Residual (e + 1,) of the condition at its own unknowns (e,)."""
        return [self.value(solution) / self.size(solution)]

    def size(self, solution: Any) -> float:  # noqa: ARG002
        """Unit of the test function."""
        return 1.0

    @final
    def residual(self, x: Array, own: Array, p: Array) -> Array:
        return np.asarray(self.left(self.problem.at(x, p), own))

    def begin(self, solution: Any) -> Array:  # noqa: ARG002
        """Guess of the condition's own unknowns, (e,), from a solution near the zero."""
        return np.empty(0)

    def place(self, solution: Any, own: Array) -> tuple[float, int]:  # noqa: ARG002
        """Phase and stop of the zero: those of the impact."""
        return float(solution.impact_phases[self.number]), int(solution.sides[self.number])

    def neighbour(self, x: Array, p: Array) -> tuple[Problem, Array] | None:  # noqa: ARG002
        """Equations and unknowns of an orbit that meets this one; None where there is none."""
        return None


class OfImpact(Border):
    """A test function that is a velocity at an impact; beyond its zero orbits are inadmissible."""

    kind, ends = BifurcationKind.GR, False

    @final
    def size(self, solution: Any) -> float:
        return float(self.problem.units(solution)[1])


@final
class VanishingImpulse(OfImpact):
    """An impulse is zero."""

    def value(self, solution: Any) -> float:
        return float(solution.impulses[self.number])

    def neighbour(self, x: Array, p: Array) -> tuple[Problem, Array] | None:
        s = self.problem.at(x, p)
        k = s.hits[self.number]
        found: tuple[Problem, Array] | None = None
        if s.following[k].mode == s.itinerary[k].mode:
            found = self.problem.without(x, p, [k])
        return found


@final
class VanishingAcceleration(Border):
    """The acceleration of the gap is zero just after an impact without rebound.

    With rebound the acceleration does not matter: the value is infinite. Beyond the border P(n,m)
    continues as an inadmissible orbit.
    """

    def value(self, solution: Any) -> float:
        self.ends = self.problem.sticks
        return acceleration(solution, self.number)

    def begin(self, solution: Any) -> Array:
        unit = self.problem.units(solution)[2]
        self.rounding = solution.acceleration(self.number)[1] / unit
        return np.empty(0)

    def left(self, solution: Any, own: Array) -> Any:  # noqa: ARG002
        return [solution.acceleration(self.number)[0] / self.problem.units(solution)[2]]


def acceleration(solution: Any, i: int) -> float:
    """Acceleration of the gap just after impact `i` without rebound; infinite with rebound."""
    return solution.acceleration(i)[0] if solution.restitutions[i] == 0.0 else math.inf
