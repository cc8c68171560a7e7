"""The contract of events: numbers that are zero where a branch meets a border of its own kind."""

# ruff: noqa: ARG002 (arguments that a default has no use for)

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.kinds import BifurcationKind


@final
@dataclass(frozen=True)
class Event:
    """A number that changes its sign where a branch meets a border of its own kind.

    Parameters
    ----------
    kind : BifurcationKind
        GR or CB.
    part : int
        Which part of the orbit it belongs to.
    value : float
        Positive on the admissible side, zero on the border; infinite where there is nothing to
        watch, NaN where its sign would tell nothing.
    ends : bool
        Whether there are no such orbits beyond, admissible or not.
    """

    kind: BifurcationKind
    part: int
    value: float
    ends: bool = False


class Condition(ABC):
    """One equation more, g(x, e, p) = 0, that holds at a border, with e unknowns of its own.

    `size` = e + 1 equations in all.
    """

    unknowns: int
    """The number e of unknowns of its own."""
    unit: float = 1.0
    """What g is measured in."""
    noise: float = 0.0
    """What errors of calls leave in g."""
    unfolding: Any = None
    """What times the first of the own unknowns is added to the orbit's equations, (m,), or None."""
    rounding: float = 0.0
    """What rounding leaves in g / `unit`, where that is more than in the orbit's equations."""

    @abstractmethod
    def residual(self, x: Array, own: Array, p: Array) -> Array:
        """Return the equations, (e + 1,), at unknowns (m,), own ones (e,) and parameters (k,)."""


class WatchedProblem(Problem):
    """A problem with events, and solutions that are no motions of the system.

    A subclass must implement

    1. ``events(x, p)``, always as many and in the same order;
    2. ``condition(event, x, p)``, what holds where one of them is zero;
    3. ``admissible(x, p)``, whether a solution is a motion of the system;

    and may offer

    4. ``touching``, where and when it happens;
    5. ``neighbours``, solutions of other kinds that meet this one there.
    """

    @abstractmethod
    def events(self, x: Array, p: Array) -> list[Event]:
        """Return what is to be watched along a branch, always as many and in the same order."""

    @abstractmethod
    def condition(self, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
        """Return what holds where event number `event` is zero, and a guess of its own unknowns.

        The guess is made from a solution nearby.
        """

    @abstractmethod
    def admissible(self, x: Array, p: Array) -> bool:
        """Whether a solution is a motion of the system, and no impact was left out or pulls."""

    def touching(
        self,
        event: int,
        x: Array,
        own: Array,
        p: Array,
    ) -> Mapping[str, float]:
        """Return where and when it touches, by name, at a zero of event number `event`.

        `own` are the unknowns (e,) of the event's condition. Nothing, unless a subclass tells.
        """
        return {}

    def neighbours(
        self,
        event: int,
        x: Array,
        p: Array,
    ) -> list[tuple[Problem, Array, Array]]:
        """Return guesses of orbits of other kinds that meet this one at a zero of an event.

        Each is a problem with the same free parameters, unknowns and parameters. None, unless a
        subclass knows some.
        """
        return []


def events_of(problem: Problem, x: Array, p: Array) -> tuple[Event, ...]:
    """Return the events of any problem; those that have not the contract have none."""
    return tuple(problem.events(x, p)) if isinstance(problem, WatchedProblem) else ()


def is_admissible(problem: Problem, x: Array, p: Array) -> bool:
    """Whether a solution of any problem is a motion of the system: without the contract all are."""
    return problem.admissible(x, p) if isinstance(problem, WatchedProblem) else True
