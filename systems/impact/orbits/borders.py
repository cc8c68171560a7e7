"""Borders of a branch of orbits: what is watched, and what holds where it is zero."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import Condition
from dynkit.orbits.kinds import BifurcationKind
from dynkit.systems.impact.orbits.flights import Curve


class Border(Condition):
    """A number that is watched, and the condition that it is zero.

    A subclass must implement what is abstract here.

    Parameters
    ----------
    problem : ImpactProblem
    part : int
        Number of the state of the orbit after which it happens.
    number : int
        Number of the impact, or of the flight.
    side : int
        Number of the stop that a flight is watched from.
    """

    kind = BifurcationKind.CB
    ends = True
    """Whether there is no such orbit beyond."""
    unknowns = 0
    power = 1.0
    """Power of the distance from the border to which the number is proportional."""

    def __init__(self, problem: Any, part: int, number: int = 0, side: int = 0) -> None:
        self.problem, self.part, self.number, self.side = problem, part, number, side

    @abstractmethod
    def value(self, solution: Any) -> float:
        """What is watched: positive on the admissible side; see `Event`."""

    def left(self, solution: Any, own: Array) -> Any:  # noqa: ARG002
        """What is left of the equations, (e + 1,), at own unknowns (e,)."""
        return [self.value(solution) / self.size(solution)]

    def size(self, solution: Any) -> float:  # noqa: ARG002
        """What the number is measured in."""
        return 1.0

    @final
    def residual(self, x: Array, own: Array, p: Array) -> Array:
        return np.asarray(self.left(self.problem.at(x, p), own))

    def begin(self, solution: Any) -> Array:  # noqa: ARG002
        """Guess of the own unknowns, (e,), from a solution nearby."""
        return np.empty(0)

    def place(self, solution: Any, own: Array) -> tuple[float, int]:  # noqa: ARG002
        """Phase and stop at which it happens: those of the impact."""
        return float(solution.impact_phases[self.number]), int(solution.sides[self.number])

    def neighbour(self, x: Array, p: Array) -> tuple[Problem, Array] | None:  # noqa: ARG002
        """Equations and unknowns of an orbit that meets this one; None where there is none."""
        return None


class OfImpact(Border):
    """A velocity at an impact. Beyond, the same orbit is no motion."""

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
        found: tuple[Problem, Array] | None = self.problem.without_impact(x, p, self.number)
        return found


@final
class VanishingAcceleration(Border):
    """The acceleration of the gap is zero just after an impact without rebound.

    With rebound accelerations do not matter. P(n,m) goes on beyond as no motion of the oscillator.
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
    """Of the gap just after an impact that does not rebound; infinite where it does."""
    return solution.acceleration(i)[0] if solution.restitutions[i] == 0.0 else math.inf


class Touching(Border):
    """A curve is zero where it has its minimum, at a phase of its own.

    A subclass says which curve, from which phase on, and what it and its rate are measured in.
    """

    ends, unknowns = False, 1

    @abstractmethod
    def curve(self, solution: Any) -> tuple[Curve, float]:
        """The curve, and the phase at which it begins."""

    @abstractmethod
    def measures(self, solution: Any) -> Array:
        """What the curve and its rate are measured in."""

    def begin(self, solution: Any) -> Array:
        curve, begins = self.curve(solution)
        return np.array([begins + solution.frequency * curve.smallest[1]])

    def left(self, solution: Any, own: Array) -> Any:
        curve, begins = self.curve(solution)
        return curve.values((own - begins) / solution.frequency, 2)[:, 0] / self.measures(solution)
