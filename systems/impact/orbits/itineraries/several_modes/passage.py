"""Motions through several modes, from the unknown states at nodes to the next nodes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import numpy as np

from dynkit.core.differences import STEP
from dynkit.core.kept import cached_property, kept
from dynkit.core.validation import Array
from dynkit.exponential.propagators import padded
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.orbits.itineraries.flying import Flights, flights_of, laid
from dynkit.systems.impact.orbits.itineraries.itinerary import Course
from dynkit.systems.impact.orbits.itineraries.motion import ItinerarySolution, Lap
from dynkit.systems.impact.orbits.itineraries.several_modes import divided
from dynkit.systems.impact.orbits.itineraries.several_modes.chatter import Chatter
from dynkit.systems.impact.orbits.itineraries.several_modes.crossings import factors_of
from dynkit.systems.impact.orbits.itineraries.simulated import is_motion
from dynkit.systems.impact.orbits.machine import Machine, Regimes
from dynkit.systems.impact.simulation.sampling import sample_run, sample_sliders
from dynkit.systems.impact.simulation.state import TWO_PI, turning

ROUNDING = 2.0**-52
"""Relative rounding error of a number."""

_NO_CHANGES: Mapping[Regimes, Array] = {}


class Scene(NamedTuple):
    """The machine at some parameters, the oscillator, and the units (D,) of states."""

    machine: Machine
    oscillator: Any
    measures: Array


class Passage(ItinerarySolution):
    """The motion of an itinerary from the states at its nodes, with given phases and impulses.

    States are not eliminated, so a neutral mode causes no singular matrix. Impulses are unknowns,
    so the derivatives are finite at a grazing impact. A subclass must implement the abstract
    methods, for flights and rows.

    Parameters
    ----------
    scene : Scene
    course : Course
    lap : Lap
    pairs : list of divided.Pair or None
        For each event the earlier event at which its guard is zero for any motion.
    driven : bool
    still : Passage, optional
        The same motion of the machine without the imaginary changes of its numbers.
    changes : mapping of Regimes to arrays, optional
        These changes of the numbers of flights by Taylor's method, by modes.
    """

    blind = True

    def __init__(
        self,
        scene: Scene,
        course: Course,
        lap: Lap,
        pairs: list[divided.Pair | None],
        driven: bool,
        still: Self | None = None,
        changes: Mapping[Regimes, Array] = _NO_CHANGES,
    ) -> None:
        self._still, self._changes = still, changes
        self.scene, self.machine, self.pairs, self.driven = scene, scene.machine, pairs, driven
        clock = scene.machine.frequency if driven else TWO_PI / lap.turn
        super().__init__(scene.oscillator, scene.measures, course, lap, clock)
        self.dimension = lap.states.shape[1]
        self._kicks: dict[int, Any] = {}
        self._put: dict[int, Array] = {}
        self._node_of = dict(zip(course.nodes, range(len(course.nodes)), strict=True))

    # --- states, complex if the machine's numbers are ---------------------------------------------

    @cached_property
    def durations(self) -> Any:
        phases = self.lap.phases
        return (phases[1:] - phases[:-1]) / self.clock

    @cached_property
    def _turning(self) -> Array:
        """Sine and cosine of the phases of the events, and one: (n, 3)."""
        return turning(self.event_phases)

    @cached_property
    def transitions(self) -> Any:
        """Transition matrices (n, D, D) from just after each event to just before the next.

        For chatters they are the derivatives for states on the stop.
        """
        out = self._flown.copy()
        for i, chatter in self.chatters.items():
            d = len(out[i])
            out[i] = out[i] @ self._carried(i, chatter, np.eye(d, padded(d)))[:, :d]
        return out

    def _carried(self, i: int, chatter: Chatter, changes: Array) -> Any:
        """Changes (D, k) of the contact state at a fixed time, by those just after event `i`."""
        flying = self.itinerary[i].kicked
        assert flying is not None
        flights, held = self.flights(flying), self.flights(self.following[i].mode)
        changes, later = chatter.carried(self.machine, flights, held, changes)
        (rate,) = held.rates(chatter.begin[None])
        return changes - rate[:, None] * later

    @property
    def _flown(self) -> Any:
        """Transition matrices (n, D, D), for chatters from the begin of contact."""
        return self._way[3]

    @property
    def chatters(self) -> dict[int, Chatter]:
        """The chatters, by the numbers of the impacts before them."""
        return self._way[4]

    def _chatter(self, i: int, state: Any) -> Chatter:
        if self._still is not None:
            return self._still.chatters[i]
        if self.impulses[self.impulse_of[i]] < 0.0:
            raise NoSolution("the chatter must begin with an impact that pushes")
        event, held = self.itinerary[i], self.following[i].mode
        assert event.kicked is not None
        flights = self.flights(event.kicked), self.flights(held)
        pushed = float(self.impulses[self.impulse_of[i]])
        rate = float(flights[0].rate_of(event.element, state)[0]) - pushed
        r, _ = self.machine.rebound(event.element, event.piece, rate)
        own = event, flights, state, float(abs(self.impulses).max()), r > 0.0
        found = Chatter(self.oscillator, self.machine, *own)
        if found.run.impacts and self.durations[i] < found.lasts:
            raise NoSolution("the chatter must be complete before the next event")
        return found

    def _begun_on(self, i: int, chatter: Chatter, state: Any) -> Any:
        """State (D,) with which contact begins, with its imaginary change at a fixed time."""
        if not np.iscomplexobj(state):
            return chatter.begin
        return (
            chatter.begin + 1j * STEP * self._carried(i, chatter, state.imag[:, None] / STEP)[:, 0]
        )

    @cached_property
    def _modes(self) -> list[Any]:
        """Flights of the n modes after the events."""
        return [self.flights(event.mode) for event in self.following]

    @cached_property
    def _closed(self) -> list[int]:
        """Stops that never open: their gaps and gap rates are set to zero at nodes."""
        held = set(self.itinerary[0].mode.held).intersection(*(e.mode.held for e in self.itinerary))
        return sorted(k for k in held if k < len(self.oscillator._stops))

    @cached_property
    def _way(self) -> tuple[Any, Any, Any, Any, dict[int, Chatter]]:
        """Whole states (n, D) before and after the events, and before the next ones.

        The last two items are `_flown` and `chatters`.
        """
        n, d, m = self.events, self.dimension, self.machine
        kind = np.result_type(m.frequency)
        before, after, reached = np.empty((3, n, d + 3), dtype=kind)
        flown, chatters = np.zeros((n, d + 3, d + 3), dtype=kind), {}
        state: Any = None
        for i, event in enumerate(self.itinerary):
            node = i in self._node_of
            state = self.lap.states[self._node_of[i]] if node else state
            before[i, :d], before[i, d:] = state, self._turning[i]
            pushed = before[i]
            if event.kicked:
                flights = self.flights(event.kicked)
                self._kicks[i] = flights.kick(event.element, before[i], event.rubs)
                pushed = pushed + self.impulses[self.impulse_of[i]] * self._kicks[i]
            moved = []  # derivatives of the state after each change
            if node and self._closed:
                pushed, by = laid(self._modes[i], self._closed, pushed)
                moved.append(by)
            if event.kicked and event.rubs:
                pushed, by = flights.stopped(event.rubs, pushed)
                moved.append(by)
            after[i], self._put[i] = self._modes[i].begun(event, pushed)
            for by in reversed(moved):
                self._put[i] = self._put[i] @ by
            start, lasts = after[i], self.durations[i]
            if event.chatters:
                chatters[i] = self._chatter(i, after[i])
                start = self._begun_on(i, chatters[i], after[i])
                lasts = lasts - chatters[i].lasts
            reached[i], flown[i] = self._flight(i, start, lasts)
            state = reached[i, :d]
        return before, after, reached, flown, chatters

    @property
    def kicks(self) -> Any:
        """Changes (n, D) of the states by unit impulses; zero for events that are no impacts."""
        none = np.zeros(self.dimension + 3)
        before = self.before
        return np.array([self._kicks.get(i, none) for i in range(len(before))])

    @cached_property
    def resets(self) -> Any:
        """Derivatives (n, D, D) of the states just after the events by those just before.

        Impulses are fixed. See `begun` of the flights.
        """
        before, out = self.before, []
        for i, event in enumerate(self.itinerary):
            reset = self._put[i]
            flights: Any = self.flights(event.kicked) if event.kicked else None
            if flights and flights.varies:
                turned = flights.turned(event.element, before[i], event.rubs)
                reset = reset @ (np.eye(len(reset)) + self.impulses[self.impulse_of[i]] * turned)
            out.append(reset)
        return np.array(out)

    @cached_property
    def moving(self) -> Any:
        """Rates (n, D) of the states just before the next events."""
        pairs = zip(self._modes, self.reached, strict=True)
        return np.array([flights.rates(z[None])[0] for flights, z in pairs])

    @cached_property
    def _watched(self) -> tuple[Any, Any]:
        """Values (n,) of the guards at the events, and `guards`."""
        rows = np.zeros_like(self.before)
        values = rows[:, 0].copy()
        for i, (event, z) in enumerate(zip(self.itinerary, self.before, strict=True)):
            if event.element >= 0:
                values[i], rows[i] = self.guard_at(i, z)
        return values, rows

    def guard_at(self, i: int, z: Any) -> tuple[Any, Any]:
        """The guard of event `i` at a state (D,), and its derivative (D,)."""
        event = self.itinerary[i]
        return self.watch(event.mode, event.element, event.guard, z)

    @property
    def guards(self) -> Any:
        """Rows (n, D) of the guards at the events; zero for the begin of a period."""
        return self._watched[1]

    @cached_property
    def _approach(self) -> tuple[Any, Any]:
        own = [(self.itinerary[i], self.before[i]) for i in self.hits]
        found = [self.flights(event.mode).rate_of(event.element, z) for event, z in own]
        rates = np.array([rate for rate, _ in found])
        return rates, np.array([row for _, row in found]).reshape(len(own), self.dimension + 3)

    @property
    def closing(self) -> Any:
        """Rates (k,) of the gaps just before the impacts."""
        return self._approach[0]

    @property
    def rates(self) -> Any:
        """Derivatives (k, D) of `closing` by the states just before the impacts."""
        return self._approach[1]

    @property
    def before(self) -> Any:
        """Whole states (n, D) just before the events."""
        return self._way[0]

    @property
    def after(self) -> Any:
        """Whole states (n, D) just after the events."""
        return self._way[1]

    @property
    def reached(self) -> Any:
        """Whole states (n, D) just before the next events."""
        return self._way[2]

    @property
    def whole(self) -> Array:
        found = np.array([self._stilled(i, z[None])[0] for i, z in enumerate(self.after)])
        if self.progression.shift.size:
            found[:, : self.dimension] += self._elsewhere[:-1]
        return found

    @cached_property
    def rebounds(self) -> Any:
        """Restitutions, and derivatives of rebound velocities by approach velocities: (2, k)."""
        approach = self.closing
        pieces = [self.itinerary[i].piece for i in self.hits]
        own = zip(self.sides.tolist(), pieces, approach, strict=True)
        found = [self.machine.rebound(*hit) for hit in own]
        return np.array(found).reshape(len(found), 2).T

    @property
    def restitutions(self) -> Any:
        return self.rebounds[0]

    @property
    def late(self) -> Array:
        """Rounding errors (n,) of the times between events."""
        out = abs(self.durations)
        out[-1] += 2.0 * abs(self.lap.phases[-1]) / self.clock
        return np.asarray(ROUNDING * out)

    @cached_property
    def rounded(self) -> Array:
        """Bounds (n, D) of the rounding errors of `reached`, from `after`, to first order."""
        m = self.measures
        sizes = abs(self.transitions) @ abs(self.after)[:, :, None]
        level = (sizes[:, :, 0] / m).max(axis=1, keepdims=True)
        out = ROUNDING * (4.0 + self.norms[:, None]) * level * m
        out += self.late[:, None] * abs(self.moving)
        for i, chatter in self.chatters.items():
            # each impact adds rounding errors, and the last bounces are omitted
            out[i] += ROUNDING * chatter.run.impacts * level[i] * m + chatter.error
        return np.asarray(out)

    # --- flights ----------------------------------------------------------------------------------

    @property
    @abstractmethod
    def norms(self) -> Array:
        """Norms (n,) of the flights: durations times the fastest rate. Rounding grows with them."""

    @kept
    def flights(self, mode: Regimes) -> Flights:
        """The flights in a mode."""
        changes = self._changes.get(mode)
        return flights_of(self.oscillator, self.machine, mode, self.measures, changes)

    def _flight(self, i: int, z: Any, lasts: Any) -> tuple[Any, Any]:
        """State (D,) at the next event after a flight from `z`, and its derivative (D, D) by `z`.

        Both `z` and the duration may have imaginary changes.
        """
        still = self._still
        if still is None:
            flown: tuple[Any, Any] = self._modes[i].passed(z, lasts)
            return flown
        flown = still._flown[i]
        out = flown @ z.imag / STEP + still.moving[i] * lasts.imag / STEP + self._gained[i]
        out[self.dimension :] = 0.0  # phases do not change: they are unknowns
        return still.reached[i] + 1j * STEP * out, flown

    @property
    @abstractmethod
    def _gained(self) -> Array:
        """Changes (n, D) of states at the next events by changed numbers, at fixed durations."""

    @abstractmethod
    def quotient(self, j: int, i: int, q: int) -> Any:
        """Remainder of the guard of event `i` after flight `j`, over its duration to the power q.

        The remainder is the guard minus the terms below order q of its Taylor series at the begin
        of the flight. See `divided`.
        """

    @abstractmethod
    def quotient_change(self, j: int, i: int, q: int) -> tuple[Any, float]:
        """Derivatives of `quotient` by the state (D,) at the begin, and by the duration."""

    @abstractmethod
    def quotient_rounding(self, j: int, i: int, q: int) -> float:
        """Rounding error of `quotient`."""

    @abstractmethod
    def rise(self, j: int, i: int) -> Any:
        """Change of the guard of event `i` in flight `j`."""

    @abstractmethod
    def rise_change(self, j: int, i: int) -> Any:
        """Derivative (D,) of `rise` by the state at the begin."""

    def _passed(self, i: int, durations: Array) -> Array:
        """States (k, 2N + J) at times (k,) after event `i`; after a chatter those in contact."""
        times = np.maximum(durations - self._late(i), 0.0)
        states: Array = self._modes[i].states(self.begun(i), times)
        return states[:, : self.dimension]

    def flown(self, i: int, phase: float) -> Array:
        """The state (2N + J,) at a phase after event `i`."""
        late = np.array([(phase - self.event_phases[i]) / self.clock])
        return np.asarray(self._passed(i, late)[0])

    # --- the motion -------------------------------------------------------------------------------

    def passed(self, since: Array) -> Array:
        begin = (self.event_phases - self.event_phases[0]) / self.clock
        which = np.clip(np.searchsorted(begin, since, side="right") - 1, 0, None)
        after, out = since - begin[which], np.empty((len(since), self.dimension))
        turns = turning(self.event_phases[0] + self.clock * since)
        for i in np.unique(which).tolist():
            z = np.concatenate([self._passed(i, after[which == i]), turns[which == i]], axis=1)
            out[which == i] = self._stilled(i, z)[:, :-3]
        for i, chatter in self.chatters.items():
            here = np.flatnonzero((which == i) & (after < chatter.lasts))
            own = self.oscillator, chatter.run, after[here]
            out[here] = np.concatenate([*sample_run(*own), sample_sliders(*own)], axis=1)
        if self.progression.shift.size:
            out += self._elsewhere[which]
        return out

    def _stilled(self, i: int, states: Array) -> Array:
        """Set slips of sticking elements to zero in states (k, D) after event `i`, in place.

        With a static force above the kinetic force, a motion from a state with a slip of rounding
        size would continue to slip.
        """
        n, stops = self.machine.size, len(self.oscillator._stops)
        mode, found, shape = self.following[i].mode, [], states.shape
        for k in (k for k in mode.held if k >= stops):
            slip, rows = self.flights(mode).rate_of(k, states)
            found.append((slip, np.broadcast_to(rows, shape)[:, n : 2 * n]))
        if found:
            slips, along = (np.stack(part, axis=1) for part in zip(*found, strict=True))
            left = np.linalg.solve(along @ along.transpose(0, 2, 1), slips[..., None])
            states[:, n : 2 * n] -= (left * along).sum(axis=1)
        return states

    # --- guards between events --------------------------------------------------------------------

    def begun(self, i: int) -> Array:
        """The state (D,) with which the mode after event number `i`, or its chatter, begins."""
        return self.chatters[i].begin if i in self.chatters else np.asarray(self.after[i])

    def _late(self, i: int) -> float:
        """Time from event number `i` to the begin of the next mode: the duration of its chatter."""
        return self.chatters[i].lasts if i in self.chatters else 0.0

    def begins(self, i: int) -> float:
        return float(self.event_phases[i] + self.clock * self._late(i))

    def watch(self, mode: Regimes, element: int, guard: int, z: Any) -> tuple[Any, Any]:
        """Guard of an element in a mode at a state (D,), and its derivative (D,)."""
        return self.flights(mode).observed(element, guard, z)

    def size_of(self, i: int, element: int, guard: int) -> float:
        _, row = self.watch(self.following[i].mode, element, guard, self.begun(i))
        return float(abs(row) @ self.measures)

    def force_unit(self, i: int, element: int) -> float:
        """Unit of a contact force after event `i`."""
        row = self.flights(self.following[i].mode).force_row(element, self.begun(i))
        return float(abs(row) @ self.measures)

    @property
    def bounces(self) -> tuple[Array, Array]:
        phases, speeds, at = self.impact_phases, self.relative_velocity, self.hits
        for i, chatter in reversed(self.chatters.items()):
            k = at.index(i) + 1
            later = self.event_phases[i] + self.clock * chatter.run.time
            phases = np.insert(phases, k, later)
            speeds = np.insert(speeds, k, chatter.run.relative_velocity)
        return phases, speeds

    @property
    def chatter_error(self) -> float:
        return max((chatter.error for chatter in self.chatters.values()), default=0.0)

    # --- the orbit --------------------------------------------------------------------------------

    @cached_property
    def factors(self) -> tuple[Array, Array]:
        """See `factors_of`."""
        return factors_of(self)

    @property
    def admissible(self) -> bool:
        """Whether simulation finds the same events."""
        return is_motion(self)
