"""Trajectories: the events of one motion from its start, as plain arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.data.dataset import Dataset
from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.modes.mode import Mode, transformed
from dynkit.systems.impact.simulation.state import ImpactState

Indices = NDArray[np.intp]

_ROWS = 1 << 16
"""Impacts whose states are computed in one step; an interrupt takes effect between steps."""


class Ending(Enum):
    """Why a simulation ended; the value of each is what the user reads."""

    COUNT_REACHED = "the number of impacts was reached"
    NO_FURTHER_CONTACT = "no mass can reach a stop any more"
    CONTACT_FOR_EVER = "the mass stays on the stop for ever"
    SEARCH_LIMIT = "no further impact was found within the search limit"
    DIED_OUT = "the motion has died out on the stop, its impacts too small for doubles"
    JAMMED = "the machine is jammed: a stop is in the way of what others hold"
    COLLAPSED = "stops are hit in turn without end, and in no time"
    HANGS = "a mass hangs at the edge of a preloaded stop, which it crosses without end"
    CYCLE_ENDED = "nothing drives the motion, and it does not return to its section any more"
    PARADOX = "friction at a contact is so large that the contact force has no unique value"
    REPEATS = "the motion repeats itself without an impact"


@final
@dataclass(frozen=True, eq=False)
class Events:
    """All events of a motion in the order of time: impacts, contacts, releases, other switches.

    The errors of the record's impacts hold for the events as well.

    Attributes
    ----------
    time : (k,)
        Times from the start. Contact after omitted bounces begins at their end.
    kind : (k,) of int
        0 for an impact, 1 for the beginning of contact, 2 for its end, 3 for another change of
        regime, as in ``systems.impact.elements.element.EventKind``.
    element : (k,) of int
        Number of the element: 0 is the table, 1 the far stop of a play. Of ``elements``, the hard
        stops come first in their order, then the others.
    mode : (k,) of int
        Number of the mode after the event; 0 is free flight.
    position, velocity : (k, N)
        Positions and velocities of all coordinates just after the event.
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
    """Stored data of impacts.

    Attributes
    ----------
    time, speed : (n,)
        Times of the impacts, and rates of the gap just after them.
    guard : (n,)
        Number of the guard that was zero at each impact.
    states : (n, 2, slots)
        States just after the impacts.
    turn : (n, 2)
        Sine and cosine of the phase if states do not contain them, else no rows.
    """

    time: Array
    speed: Array
    guard: Indices
    states: Array
    turn: Array

    def part(self, low: int, high: int) -> Impacts:
        """The impacts from number `low` to number `high` - 1."""
        return Impacts(*(array[low:high] for array in vars(self).values()))


@final
@dataclass(frozen=True, eq=False)
class Switches:
    """Stored data of changes of the mode.

    Attributes
    ----------
    time, rest : (k,)
        Time of the change, and duration of the bounces that are omitted after it. Contact begins
        at the last impact that is not omitted.
    speed : (k,)
        Speed of the first omitted bounce.
    before : (k,)
        Number of impacts before the change.
    guard : (k,)
        Number of the guard that was zero.
    states : (k, 2, slots)
        States in the new mode; slots beyond those of the mode hold zeros.
    """

    time: Array
    rest: Array
    speed: Array
    before: Indices
    guard: Indices
    states: Array

    def until(self, count: int) -> Switches:
        """The first `count` changes."""
        return Switches(*(array[:count] for array in vars(self).values()))


@final
@dataclass(frozen=True, eq=False)
class Segments:
    """Parts of a motion, each in one mode: the first from the start, the others from an event.

    Attributes
    ----------
    begin : (k,)
        Times at which the segments start.
    point : (k,)
        Number of impacts before the segment.
    mode, element : (k,)
        Number of the mode, and of the element whose event starts the segment.
    guard : (k,)
        Number of the guard of this event; for the start of the motion, a guard of its element.
    rest, speed : (k,)
        Duration of the bounces omitted at the start of the segment, and speed of the first one.
    kind : (k,) of int
        Kind of the event, see `EventKind`; the start of the motion counts as an impact.
    states : (k, 2, slots)
        States at the start of the segment; slots beyond those of the mode hold zeros.
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
        """States (n, 2, slots) at the start of some segments, all in this mode."""
        return np.ascontiguousarray(self.states[some, :, : mode.layout.slots])


@final
@dataclass(frozen=True, eq=False)
class Trajectory:
    """Events of one motion: impacts, and switches between the modes of its oscillator.

    Points are the start and the impacts. Contact number k begins after point ``before[k]``.
    Elements are numbered with the hard stops first; the far stop of a play is number 1.

    Attributes
    ----------
    start, final : ImpactState
    log : Impacts
        Empty if impacts are not stored.
    switches : Switches
    regimes : tuple of tuple
        Regimes of all elements in each mode.
    guards : (g, 4)
        For each guard: its mode, its element, the mode that follows, and the kind of the event.
    impacts : int
        Number of impacts, stored or not.
    ending : Ending
    chatter_error, cells, touches, seconds
        Error by omitted bounces, number of search cells, number of touching impacts, and wall-clock
        time in seconds.
    longest : float
        Duration of the longest flight or contact.
    duration : float
        Time of the last event.
    searched : float
        Time up to which events were searched. It exceeds `duration` if Taylor's method has found no
        further event.
    ambiguous : int
        Number of impacts before the first one whose outcome is not unique; -1 if all are unique.
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
    searched: float

    def _restored(self) -> Trajectory:
        """The trajectory, renumbered as its oscillator now numbers modes and guards.

        Raises
        ------
        ValueError
            When the oscillator does not have these modes and guards, or arrays do not fit together.
        """
        self._refuse_misfits()
        automaton = self.start._system._automaton
        for regimes in self.regimes:
            automaton.checked_mode(regimes)
        numbers = np.array([automaton.regimes.index(regimes) for regimes in self.regimes])
        mode, element, target, kind = self.guards.T
        first = np.array([automaton.guard(k, -1) for k in numbers.tolist()])
        guards = np.arange(len(mode)) - np.searchsorted(mode, mode) + first[mode]
        for k in guards[target >= 0].tolist():
            automaton.enter(k)
        table = automaton.parts.table(automaton.regimes, automaton.guards)
        known = np.stack([numbers[mode], element, np.append(numbers, -1)[target], kind], axis=1)
        same = (table[guards] == known) | (np.arange(4) == 2) & (known < 0)
        if not same.all():
            raise ValueError("its guards are not those of the system")
        for events, entered in ((self.log, mode), (self.switches, target)):
            for k in np.unique(entered[events.guard]).tolist():
                slots = automaton.modes[numbers[k]].layout.slots
                if k < 0 or events.states.shape[2] < slots:
                    raise ValueError(f"states of {slots} slots are {events.states.shape}")
        log = replace(self.log, guard=guards[self.log.guard])
        switches = replace(self.switches, guard=guards[self.switches.guard])
        own = {"regimes": tuple(automaton.regimes), "guards": table}
        return replace(self, log=log, switches=switches, **own)

    def __reduce__(self) -> tuple[Any, ...]:
        # In another process the oscillator may number its modes in another order.
        return _numbered, tuple(getattr(self, entry.name) for entry in fields(self))

    def _refuse_misfits(self) -> None:
        """Raise ValueError when arrays do not fit together."""
        turn, both = {"turn": (("turned", "part"), self.log.turn)}, {"part": ("part", [0, 1])}
        for each, own, more in (
            ("impact", vars(self.log), turn),
            ("switch", vars(self.switches), {}),
        ):
            flat = {name: (each, own[name]) for name in own.keys() - {"states", "turn"}}
            states = {"states": ((each, "part", "slot"), own["states"])}
            Dataset(both, {**flat, **more, **states}, {})
        stored = len(self.log.time)
        if self.impacts < stored or len(self.log.turn) not in (0, stored):
            raise ValueError(f"{self.impacts} impacts, {stored} stored, {len(self.log.turn)} turns")
        for name, numbers, most in (
            ("guard", self.log.guard, len(self.guards)),
            ("guard", self.switches.guard, len(self.guards)),
            ("before", self.switches.before, self.impacts + 1),
            ("mode", self.guards[:, 0], len(self.regimes)),
        ):
            if numbers.size and not 0 <= numbers.min() <= numbers.max() < most:
                raise ValueError(f"{name} must be numbers below {most}; got {numbers}")

    def part(self, low: int, high: int) -> Trajectory:
        """The same trajectory with only the impacts from number `low` to `high` - 1."""
        log = self.log.part(low, high)
        return replace(self, log=log, impacts=len(log.time))

    def holding(self, log: Impacts) -> Trajectory:
        """The same trajectory with another log of impacts, which may be in modes built since."""
        automaton = self.start._system._automaton
        regimes, guards = tuple(automaton.regimes), automaton.table
        return replace(self, log=log, impacts=len(log.time), regimes=regimes, guards=guards)

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of impacts, search cells, contacts and touches (impacts at double roots)."""
        contacts = len(self.before) if len(self.switches.time) else 0
        own = {"impacts": self.impacts, "cells": self.cells}
        return own | {"contacts": contacts, "touches": self.touches}

    # --- impacts (n,) -----------------------------------------------------------------------------

    @property
    def time(self) -> Array:
        """Times of the impacts."""
        return self.log.time

    @property
    def element(self) -> Indices:
        """Number of the stop of each impact."""
        return np.asarray(self.guards[self.log.guard, 1])

    @property
    def relative_velocity(self) -> Array:
        """Rates of the gap just after the impacts; negative at the far stop of a play."""
        if not self.start._system._faces:
            return self.log.speed
        return np.where(self.element == 1, -self.log.speed, self.log.speed)

    @property
    def coordinates(self) -> tuple[Array, Array, Array]:
        """Modal coordinates (n, 2, N), sine and cosine of the phase (n,)."""
        q, sine, cosine = self.start._system._free.parts(self._free_impacts)
        return (q, *self.log.turn.T) if len(self.log.turn) else (q, sine, cosine)

    @property
    def _free_impacts(self) -> Array:
        """States (n, 2, slots) just after the impacts, in the coordinates of free flight."""
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
        """Rates of the gap just after the points, at the stop of each."""
        return np.append(self.start.speed, self.log.speed)

    @property
    def sides(self) -> Indices:
        """Number of the stop at each point."""
        return np.append(self.start.element, self.element)

    @property
    def free_states(self) -> Array:
        """States (n + 1, 2, slots) just after the points, in the coordinates of free flight."""
        return np.concatenate([self._begin[None], self._free_impacts])

    @property
    def _begin(self) -> Array:
        free = self.start._system._free
        return np.asarray(free.states(self.start._coordinates, *self.start._turn))

    # --- segments (k,) ----------------------------------------------------------------------------

    @cached_property
    def segments(self) -> Segments:
        """The segments of the motion, each in one mode."""
        s, point = self.switches, np.arange(len(self.log.time) + 1)
        none, impacts = np.zeros(len(point)), np.full(len(point), EventKind.IMPACT)
        states = np.concatenate([self._begin[None], self.log.states])
        given = (
            (self.times, s.time),
            (point, s.before),
            (np.append(self.start.element, self.log.guard), s.guard),
            (none, s.rest),
            (none, s.speed),
            (impacts, self.guards[s.guard, 3]),
        )
        if len(s.time):
            order = np.argsort(np.concatenate([point, s.before + 0.5]), kind="stable")
            wider = s.states.shape[2] - states.shape[2]
            both = np.pad(states, ((0, 0), (0, 0), (0, wider))), s.states
            ordered = [np.concatenate(pair)[order] for pair in (*given, both)]
        else:
            ordered = [*(own for own, _ in given), states]
        begin, point, guards, rest, speed, kind, states = ordered
        after = np.where(kind == EventKind.IMPACT, 0, 2)
        mode, element = self.guards[guards, after], self.guards[guards, 1]
        return Segments(begin, point, mode, element, rest, speed, kind, states, guards)

    def closed(self, guard: int) -> list[int]:
        """Numbers of the elements that hold or stick in a guard's mode: see `Parts.holding`."""
        automaton = self.start._system._automaton
        held: list[int] = automaton.parts.holding(self.regimes[self.guards[guard, 0]])
        return held

    def modes(self, numbers: Indices) -> Iterator[tuple[Mode, Any]]:
        """The modes of some segments, each with a mask of the segments in it."""
        automaton = self.start._system._automaton
        for number in np.unique(numbers).tolist():
            yield automaton.mode(self.regimes[number]), numbers == number

    # --- contacts (k,) ----------------------------------------------------------------------------

    @cached_property
    def contacts(self) -> Array:
        """Times of beginning, after omitted bounces, and end (k, 2); infinite if it never ends."""
        s = self.switches
        if not len(s.time):
            return np.empty((0, 2))
        held, element = self._held, self.guards[s.guard, 1]
        ends = np.full(len(held), np.inf)
        for number in np.unique(element).tolist():
            (own,) = np.nonzero(element == number)
            ends[own[:-1]] = s.time[own[1:]]
        return np.stack([s.time[held] + s.rest[held], ends[held]], axis=1)

    @cached_property
    def before(self) -> Indices:
        """Number of the point after which each contact begins."""
        return np.asarray(self.switches.before[self._held])

    @cached_property
    def _held(self) -> Any:
        """Mask of the switches to contact."""
        return self.guards[self.switches.guard, 3] == EventKind.CONTACT

    @property
    def durations(self) -> tuple[Array, Array]:
        """Durations (n,) of the flights before impacts, and (j,) of the contacts before flights."""
        flights = self.time.copy()
        flights[1:] -= self.time[:-1]
        if not len(self.switches.time):
            return flights, np.empty(0)
        count = self.ended
        before = self.before[:count]
        held = self.contacts[:count, 1] - self.times[before]
        flights[before] -= held
        return flights, held

    @property
    def ended(self) -> int:
        """Number of contacts that an impact follows."""
        return int(np.searchsorted(self.before, self.impacts))


def grouped(numbers: Indices) -> Iterator[tuple[int, Any]]:
    """Each different value in numbers (n,), and its indices; a full slice if all are equal."""
    if len(numbers) and (numbers == numbers[0]).all():
        yield int(numbers[0]), slice(None)
        return
    for number in np.unique(numbers).tolist():
        yield number, np.flatnonzero(numbers == number)


def in_steps(count: int) -> Iterator[slice]:
    """Slices of at most `_ROWS` successive impacts."""
    return (slice(low, low + _ROWS) for low in range(0, count, _ROWS))


def _numbered(*parts: Any) -> Trajectory:
    return Trajectory(*parts)._restored()
