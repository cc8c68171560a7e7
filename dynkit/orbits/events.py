"""The contract of events: test functions for the borders of a kind of orbits."""

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
    """A test function that changes its sign where a branch meets a border of its kind of orbits.

    Parameters
    ----------
    kind : BifurcationKind
        GR or CB.
    part : int
        Index of the part of the orbit, such as an impact.
    value : float
        Positive on the admissible side, zero on the border; infinite where the test function is not
        defined, NaN where its sign has no meaning.
    ends : bool
        Whether no orbits of this kind, admissible or not, exist beyond the border.
    """

    kind: BifurcationKind
    part: int
    value: float
    ends: bool = False


class Condition(ABC):
    """The condition g(x, e, p) = 0 of a border: e + 1 equations with e additional unknowns."""

    unknowns: int
    """The number e of additional unknowns."""
    unit: float = 1.0
    """Unit of g."""
    noise: float = 0.0
    """Error of g from errors of calls."""
    unfolding: Any = None
    """Vector (m,), or None: the orbit's equations get this times the first additional unknown."""
    rounding: float = 0.0
    """Rounding error of g / `unit`, where it exceeds that of the orbit's equations."""

    @abstractmethod
    def residual(self, x: Array, own: Array, p: Array) -> Array:
        """Return g, (e + 1,), at the unknowns x (m,), additional ones (e,) and parameters (k,)."""


class WatchedProblem(Problem):
    """A problem with events, and with solutions that need not be motions of the system.

    A subclass must implement:

    1. ``events(x, p)``, always the same number in the same order;
    2. ``condition(event, x, p)``, the condition of the zeros of one of them;
    3. ``admissible(x, p)``, whether a solution is a motion of the system.

    A subclass may implement:

    4. ``event``, one of the events, computed faster;
    5. ``touching``, place and time of the contact at a zero;
    6. ``neighbours``, orbits of other kinds that meet this one at a zero.
    """

    @abstractmethod
    def events(self, x: Array, p: Array) -> list[Event]:
        """Return the events of a solution, always the same number in the same order."""

    @abstractmethod
    def condition(self, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
        """Return the condition of zeros of event number `event`, and guesses of its unknowns (e,).

        The guesses are made from a solution near the zero.
        """

    @abstractmethod
    def admissible(self, x: Array, p: Array) -> bool:
        """Whether a solution is a motion of the system: no missing impact, no tensile impulse."""

    def event(self, number: int, x: Array, p: Array) -> Event:
        """Return event number `number` of a solution."""
        return self.events(x, p)[number]

    def touching(
        self,
        event: int,
        x: Array,
        own: Array,
        p: Array,
    ) -> Mapping[str, float]:
        """Return place and time of the contact, by name, at a zero of event number `event`.

        `own` are the additional unknowns (e,) of the event's condition. By default it is empty.
        """
        return {}

    def neighbours(
        self,
        event: int,
        x: Array,
        p: Array,
    ) -> list[tuple[Problem, Array, Array]]:
        """Return guesses of orbits of other kinds that meet this one at a zero of an event.

        Each is a problem with the same free parameters, unknowns and parameters. Guesses with the
        same problem object are of one branch: they are tried until one of them converges. By
        default there are none.
        """
        return []


def events_of(problem: Problem, x: Array, p: Array) -> tuple[Event, ...]:
    """Return the events of any problem; one that is not a `WatchedProblem` has none."""
    return tuple(problem.events(x, p)) if isinstance(problem, WatchedProblem) else ()


def is_admissible(problem: Problem, x: Array, p: Array) -> bool:
    """Whether a solution is admissible; all solutions of a plain problem are."""
    return problem.admissible(x, p) if isinstance(problem, WatchedProblem) else True
