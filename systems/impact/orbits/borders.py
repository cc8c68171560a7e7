"""Borders of a branch of orbits: what is watched, and what holds where it is zero.

GR: impulses that vanish, gaps that touch zero in a flight. CB: accelerations of the gap after
impacts that do not rebound; contact forces where a chatter ends, the smallest of each contact, and
how fast they fall at releases.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar, Protocol, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import Condition
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.orbits.flights import Curve, Flight


class BorderedEquations(Protocol):
    """What borders ask of the equations of an orbit."""

    sticks: ClassVar[bool]

    def at(self, x: Array, p: Array) -> Any:
        """The `Solution` that unknowns stand for; one that sticks has `passages`."""

    def units(self, solution: Any) -> tuple[float, float, float]:
        """What gaps, their rates and their accelerations are measured in."""

    def with_impact(self, x: Array, flight: Flight, phase: float) -> tuple[Problem, Array]:
        """Equations and unknowns with one impact more, where a gap touches zero."""

    def without_impact(self, x: Array, p: Array, i: int) -> tuple[Problem, Array] | None:
        """Equations and unknowns with one impact less; None where it cannot be left out."""


class Border(Condition):
    """A number that is watched, and the condition that it is zero.

    A subclass must implement what is abstract here.

    Parameters
    ----------
    problem : BorderedEquations
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

    def __init__(
        self, problem: BorderedEquations, part: int, number: int = 0, side: int = 0
    ) -> None:
        self.problem, self.part, self.number, self.side = problem, part, number, side

    @abstractmethod
    def value(self, solution: Any) -> float:
        """What is watched: positive on the admissible side; see `Event`."""

    @abstractmethod
    def left(self, solution: Any, own: Array) -> Any:
        """What is left of the equations, (e + 1,), at own unknowns (e,)."""

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


@final
class VanishingImpulse(Border):
    """An impulse is zero."""

    kind, ends = BifurcationKind.GR, False

    def value(self, solution: Any) -> float:
        return float(solution.impulses[self.number])

    def left(self, solution: Any, own: Array) -> Any:  # noqa: ARG002
        return [self.value(solution) / self.problem.units(solution)[1]]

    def neighbour(self, x: Array, p: Array) -> tuple[Problem, Array] | None:
        return self.problem.without_impact(x, p, self.number)


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


@final
class TouchingGap(Touching):
    """The gap of a stop touches zero.

    Flights from or to an impact that pulls, and so begin or end beyond the stop, tell nothing. Nor
    do those that without rebound begin into the stop.
    """

    kind = BifurcationKind.GR

    def curve(self, solution: Any) -> tuple[Curve, float]:
        flight = solution.flight(self.number, self.side)
        return flight.gap, flight.begins

    def measures(self, solution: Any) -> Array:
        return np.array(self.problem.units(solution)[:2])

    def value(self, solution: Any) -> float:
        flight = self._flight(solution)
        impacts = [i for i in (flight.start, flight.end) if i >= 0]
        if (solution.impulses[impacts] < 0.0).any():
            return math.nan
        if flight.start >= 0 and acceleration(solution, flight.start) < 0.0:
            return math.nan
        return flight.gap.seen if self.problem.sticks else flight.gap.smallest[0]

    def place(self, solution: Any, own: Array) -> tuple[float, int]:  # noqa: ARG002
        return float(own[0]), self.side

    def neighbour(self, x: Array, p: Array) -> tuple[Problem, Array] | None:
        solution = self.problem.at(x, p)
        return self.problem.with_impact(x, self._flight(solution), float(self.begin(solution)[0]))

    def _flight(self, solution: Any) -> Flight:
        flight: Flight = solution.flights[self.number * solution.stops + self.side]
        return flight


@final
class TouchingForce(Touching):
    """The contact force touches zero during contact."""

    def curve(self, solution: Any) -> tuple[Curve, float]:
        passage = solution.passages[self.part]
        return passage.force, passage.contact_phase

    def measures(self, solution: Any) -> Array:
        return _force(self.problem, solution) * np.array([1.0, solution.frequency])

    def value(self, solution: Any) -> float:
        return float(solution.passages[self.part].force.seen)

    def place(self, solution: Any, own: Array) -> tuple[float, int]:
        return float(own[0]), solution.passages[self.part].word.sides[-1]


@final
class ChatterEnd(Border):
    """The contact force is zero where contact begins."""

    def value(self, solution: Any) -> float:
        return float(solution.passages[self.part].pressing)

    def left(self, solution: Any, own: Array) -> Any:  # noqa: ARG002
        return [self.value(solution) / _force(self.problem, solution)]

    def begin(self, solution: Any) -> Array:
        if solution.restitution > 0.0:
            raise NoSolution("the force where an endless chatter ends is not smooth there")
        return np.empty(0)

    def place(self, solution: Any, own: Array) -> tuple[float, int]:  # noqa: ARG002
        passage = solution.passages[self.part]
        return passage.contact_phase, passage.word.sides[-1]


@final
class FlatRelease(Border):
    """The contact force does not fall where it is zero, at a release."""

    def value(self, solution: Any) -> float:
        return -float(solution.passages[self.part].force_rate)

    def left(self, solution: Any, own: Array) -> Any:  # noqa: ARG002
        return [self.value(solution) / (_force(self.problem, solution) * solution.frequency)]

    def place(self, solution: Any, own: Array) -> tuple[float, int]:  # noqa: ARG002
        return float(solution.phases[self.part]), solution.passages[self.part].word.start


def _force(problem: BorderedEquations, solution: Any) -> float:
    """What contact forces are measured in."""
    mass = solution.passages[0].scene.system._structure.mass
    return problem.units(solution)[2] * float(mass.max())


def borders(problem: BorderedEquations, solution: Any) -> list[Border]:
    """All that is watched: impulses, flights and accelerations, then contacts and releases."""
    found: list[Border] = []
    sides = range(solution.stops)
    for k, part in enumerate(solution.parts):
        numbers = [(k if problem.sticks else i, i) for i in part]
        # a chatter begins with the last impact of a passage
        free = numbers[:-1] if problem.sticks else numbers
        found += [VanishingImpulse(problem, *n) for n in numbers]
        found += [TouchingGap(problem, *n, side) for n in numbers for side in sides]
        found += [VanishingAcceleration(problem, *n) for n in free]
        if problem.sticks:
            found += [kind(problem, k) for kind in (ChatterEnd, TouchingForce, FlatRelease)]
    return found
