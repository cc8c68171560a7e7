"""Trajectories: the events of one motion, from its start on, in plain arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.modes.mode import Mode, transformed
from dynkit.systems.impact.simulation.state import ImpactState

Indices = NDArray[np.intp]

_ROWS = 1 << 16
"""Impacts whose states are worked out in one step: an interrupt is heard between steps."""


class Ending(Enum):
    """Why a simulation ended; the value of each is what the user reads."""

    COUNT_REACHED = "the number of impacts was reached"
    NO_FURTHER_CONTACT = "the mass cannot reach the table any more"
    CONTACT_FOR_EVER = "the mass stays on the table for ever"
    SEARCH_LIMIT = "no further impact was found within the search limit"
    DIED_OUT = "the motion has died out on the table, its impacts too small for doubles"
    JAMMED = "the machine is jammed: a stop is in the way of what others hold"
    COLLAPSED = "stops are hit in turn without end, and in no time"


@final
@dataclass(frozen=True, eq=False)
class Events:
    """All events of a motion in their order: impacts, contacts, releases, and other switches.

    They are as wrong as the impacts of their record.

    Attributes
    ----------
    time : (k,)
        From the start; of a contact whose chatter was cut, when its bounces have come to an end.
    kind : (k,) of int
        0 for an impact, 1 for the begin of contact, 2 for its end, 3 for another regime of an
        element, as in ``systems.impact.elements.element.EventKind``.
    element : (k,) of int
        With what: 0 is the table, 1 the far stop of a play; of ``elements`` the hard stops in their
        order, and then the soft ones.
    mode : (k,) of int
        In which mode the motion goes on: 0 is free flight.
    position, velocity : (k, N)
        Of all coordinates, just after the event.
    """

    time: Array
    kind: Indices
    element: Indices
    mode: Indices
    position: Array
    velocity: Array

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        impacts, contacts, releases, others = (int((self.kind == k).sum()) for k in EventKind)
        more = f", {others} other switches" if others else ""
        return f"<Events: {impacts} impacts, {contacts} contacts, {releases} releases{more}>"


@final
@dataclass(frozen=True, eq=False)
class Impacts:
    """What is kept of impacts.

    Attributes
    ----------
    time, speed : (n,)
        Times, and rates of the gap just after them.
    guard : (n,)
        Number of the guard that each of them was at.
    states : (n, 2, slots)
        States just after them.
    turn : (n, 2)
        Sine and cosine of the phase where states do not hold them, else no rows.
    """

    time: Array
    speed: Array
    guard: Indices
    states: Array
    turn: Array

    def part(self, low: int, high: int) -> Impacts:
        """Some of them."""
        now = slice(low, high)
        return Impacts(
            self.time[now], self.speed[now], self.guard[now], self.states[now], self.turn[now]
        )


@final
@dataclass(frozen=True, eq=False)
class Switches:
    """Changes of the mode.

    Attributes
    ----------
    time, rest : (k,)
        When they happen, for contact at the last impact that is not left out, and how long the
        bounces last that are left out.
    speed : (k,)
        How fast the first of these is.
    before : (k,)
        Number of impacts before.
    guard : (k,)
        Number of the guard that each of them was at.
    states : (k, 2, slots)
        States in that mode; slots beyond its own hold zeros.
    """

    time: Array
    rest: Array
    speed: Array
    before: Indices
    guard: Indices
    states: Array

    def until(self, count: int) -> Switches:
        """The first ones."""
        return Switches(
            self.time[:count],
            self.rest[:count],
            self.speed[:count],
            self.before[:count],
            self.guard[:count],
            self.states[:count],
        )


@final
@dataclass(frozen=True, eq=False)
class Segments:
    """Parts of a motion, in one mode each: from the start, and from every event on.

    Attributes
    ----------
    begin : (k,)
        Times at which they begin.
    point : (k,)
        Number of impacts before.
    mode, element : (k,)
        Numbers of the mode, and of the element of the event that they begin with.
    guard : (k,)
        Number of the guard of that event; of the start, of an element.
    rest, speed : (k,)
        How long bounces last that are left out at first, and how fast the first of them is.
    kind : (k,) of int
        Of that event, see `EventKind`; the start counts as an impact.
    states : (k, 2, slots)
        States at the begin; slots beyond those of the mode hold zeros.
    """

    begin: Array
    point: Indices
    mode: Indices
    element: Indices
    rest: Array
    speed: Array
    kind: Indices
    states: Array
    guard: Indices

    def of(self, mode: Mode, some: Any) -> Array:
        """States (n, 2, slots) of some of them, which are in this mode."""
        return np.ascontiguousarray(self.states[some, :, : mode.layout.slots])


@final
@dataclass(frozen=True, eq=False)
class Trajectory:
    """Events of one motion: impacts, and switches between the modes of its oscillator.

    Points are the start and the impacts. Contact number k begins after point ``before[k]``.
    Elements are numbered: hard stops first, 1 is the far stop of a play.

    Attributes
    ----------
    start, final : ImpactState
    log : Impacts
        None in it when not asked for.
    switches : Switches
    regimes : tuple of tuple
        Of each mode, numbered from zero, those of all elements.
    guards : (g, 4)
        Of each guard its mode, its element, and the mode that a switch leads to, and its kind.
    impacts : int
    ending : Ending
    chatter_error, cells, touches, seconds
        What it lost and cost.
    longest : float
        The longest flight, or contact, of all.
    duration : float
        Of all up to the last event.
    ambiguous : int
        How many impacts there were before the first one whose outcome is a choice of law: it pushed
        against a closed stop, or others happened with it; -1 where there is none.
    """

    start: ImpactState
    final: ImpactState
    log: Impacts
    switches: Switches
    regimes: tuple[tuple[int, ...], ...]
    guards: Indices
    impacts: int
    ending: Ending
    chatter_error: float
    cells: int
    touches: int
    seconds: float
    longest: float
    duration: float
    ambiguous: int

    def part(self, low: int, high: int) -> Trajectory:
        """Some of the impacts; all else is that of the whole."""
        return self.holding(self.log.part(low, high))

    def holding(self, log: Impacts) -> Trajectory:
        """The same with other impacts."""
        return replace(self, log=log, impacts=len(log.time))

    # --- impacts (n,) -----------------------------------------------------------------------------

    @property
    def time(self) -> Array:
        """Times of the impacts."""
        return self.log.time

    @property
    def element(self) -> Indices:
        """The stop of each of them."""
        return np.asarray(self.guards[self.log.guard, 1])

    @property
    def relative_velocity(self) -> Array:
        """Rates of the gap just after them; negative at the far stop of a play."""
        far = (self.element == 1) & self.start._system._faces
        return np.where(far, -self.log.speed, self.log.speed)

    @property
    def coordinates(self) -> tuple[Array, Array, Array]:
        """Modal coordinates (n, 2, N), sine and cosine of the phase (n,)."""
        q, sine, cosine = self.start._system._free.parts(self._free_impacts)
        return (q, *self.log.turn.T) if len(self.log.turn) else (q, sine, cosine)

    @property
    def _free_impacts(self) -> Array:
        """States (n, 2, slots) just after them as those of free flight."""
        modes = self.guards[self.log.guard, 0]
        if not modes.any():
            return self.log.states
        automaton, out = self.start._system._automaton, self.log.states.copy()
        for number in np.unique(modes[modes > 0]).tolist():
            here, mode = modes == number, automaton.mode(self.regimes[number])
            change = automaton.modes[0].seen_from(mode)
            out[here] = transformed(change, self.log.states[here, :, : mode.layout.slots])
        return out

    # --- points (n + 1,) --------------------------------------------------------------------------

    @property
    def times(self) -> Array:
        """Times of the points."""
        return np.append(0.0, self.time)

    @property
    def speeds(self) -> Array:
        """Rates of the gap of the stop that is left, just after the points."""
        return np.append(self.start.speed, self.log.speed)

    @property
    def sides(self) -> Indices:
        """The stop at each point."""
        return np.append(self.start.element, self.element)

    @property
    def free_states(self) -> Array:
        """States (n + 1, 2, slots) in free flight just after the points."""
        return np.concatenate([self._begin[None], self._free_impacts])

    @property
    def _begin(self) -> Array:
        return self.start._system._free.states(self.start._coordinates, *self.start._turn)

    # --- segments (k,) ----------------------------------------------------------------------------

    @cached_property
    def segments(self) -> Segments:
        """The parts of the motion in one mode each, from the start and from every event on."""
        s, place = self.switches, self.switches.before + 1
        point = np.arange(len(self.log.time) + 1)
        guards = np.insert(np.append(self.start.element, self.log.guard), place, s.guard)
        impact = EventKind.IMPACT
        kind = np.insert(np.full(len(point), impact), place, self.guards[s.guard, 3])
        states = np.concatenate([self._begin[None], self.log.states])
        if len(place):
            wider = s.states.shape[2] - states.shape[2]
            states = np.pad(states, ((0, 0), (0, 0), (0, wider)))
            states = np.insert(states, place, s.states, axis=0)
        return Segments(
            np.insert(self.times, place, s.time),
            np.insert(point, place, s.before),
            np.where(kind == impact, self.guards[guards, 0], self.guards[guards, 2]),
            np.asarray(self.guards[guards, 1]),
            np.insert(np.zeros(len(point)), place, s.rest),
            np.insert(np.zeros(len(point)), place, s.speed),
            kind,
            states,
            guards,
        )

    def closed(self, guard: int) -> list[int]:
        """The stops that are in contact in the mode of a guard."""
        automaton = self.start._system._automaton
        return automaton.parts.holding(self.regimes[self.guards[guard, 0]])

    def gap(self, number: int) -> tuple[Any, Mode]:
        """The gap that guard number `number` of this motion watches, and the mode of that."""
        own, element = self.guards[number, :2].tolist()
        automaton = self.start._system._automaton
        return automaton.gap(self.regimes[own], element), automaton.mode(self.regimes[own])

    def modes(self, numbers: Indices) -> Iterator[tuple[Mode, Any]]:
        """The modes of some segments, and which of these are in each."""
        automaton = self.start._system._automaton
        for number in np.unique(numbers).tolist():
            yield automaton.mode(self.regimes[number]), numbers == number

    # --- contacts (k,) ----------------------------------------------------------------------------

    @cached_property
    def contacts(self) -> Array:
        """Begin, after the bounces that are left out, and end (k, 2), infinite for ever."""
        s = self.switches
        if not len(s.time):
            return np.empty((0, 2))
        held, element = self._held, self.guards[s.guard, 1]
        ends = np.full(len(held), np.inf)
        for number in np.unique(element).tolist():
            (own,) = np.nonzero(element == number)
            ends[own[:-1]] = s.time[own[1:]]
        return np.stack([s.time[held] + s.rest[held], ends[held]], axis=1)

    @property
    def before(self) -> Indices:
        """The point after which each contact begins."""
        return np.asarray(self.switches.before[self._held])

    @cached_property
    def _held(self) -> Any:
        """Which of the switches are to contact."""
        return self.guards[self.switches.guard, 3] == EventKind.CONTACT

    @property
    def contact_sides(self) -> Indices:
        """The stop of each contact."""
        return np.asarray(self.guards[self.switches.guard[self._held], 1])

    @property
    def durations(self) -> tuple[Array, Array]:
        """Durations (n,) of the flights before impacts, and (j,) of the contacts before these."""
        count, flights = self.ended, np.diff(self.time, prepend=0.0)
        before = self.before[:count]
        held = self.contacts[:count, 1] - self.times[before]
        flights[before] -= held
        return flights, held

    @property
    def ended(self) -> int:
        """How many of the contacts are before an impact."""
        return int(np.searchsorted(self.before, self.impacts))


def in_steps(count: int) -> Iterator[slice]:
    """Successive parts of so many impacts, each of them quickly worked out."""
    return (slice(low, low + _ROWS) for low in range(0, count, _ROWS))
