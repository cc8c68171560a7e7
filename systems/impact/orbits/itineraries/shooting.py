"""Motions of several modes: from unknown states before some events to the next of these."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple, final

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.orbits.multipliers import product_eigenvalues
from dynkit.systems.impact.orbits.flights import Curve
from dynkit.systems.impact.orbits.itineraries import divided
from dynkit.systems.impact.orbits.itineraries.itinerary import Course, Seen, events_seen
from dynkit.systems.impact.orbits.itineraries.motion import ItinerarySolution, Lap
from dynkit.systems.impact.orbits.machine import STEP, Machine, Numbers, exponentials
from dynkit.systems.impact.orbits.solution import SAME
from dynkit.systems.impact.simulation.state import TWO_PI

_ROUNDING = 2.0**-52


class Scene(NamedTuple):
    """The machine at some parameters, the oscillator, and what states are measured in, (D,)."""

    machine: Machine
    oscillator: Any
    measures: Array


@final
class ShootingSolution(ItinerarySolution):
    """The motion of an itinerary from the states at its nodes, given phases and impulses.

    Nothing is eliminated, so that no mode is neutral. Impulses are given, so that no impact
    stretches on the way.

    Parameters
    ----------
    scene : Scene
    course : Course
    lap : Lap
    pairs : list of divided.Pair or None
        Of each event the one before at which its guard is zero by nature.
    driven : bool
    """

    blind = True

    def __init__(
        self,
        scene: Scene,
        course: Course,
        lap: Lap,
        pairs: list[divided.Pair | None],
        driven: bool,
    ) -> None:
        self.scene, self.machine, self.pairs, self.driven = scene, scene.machine, pairs, driven
        clock = scene.machine.frequency if driven else TWO_PI / lap.turn
        super().__init__(scene.oscillator, scene.measures, course, lap, clock)
        self.dimension = lap.states.shape[1]
        self._node_of = dict(zip(course.nodes, range(len(course.nodes)), strict=True))

    # --- on the way; with complex numbers of a machine complex ------------------------------------

    @cached_property
    def durations(self) -> Any:
        return np.diff(self.lap.phases) / self.clock

    @cached_property
    def _turning(self) -> Array:
        """Sine and cosine of the phases of the events, and one: (n, 3)."""
        phases = self.event_phases
        return np.stack([np.sin(phases), np.cos(phases), np.ones_like(phases)], axis=1)

    @cached_property
    def kicks(self) -> Any:
        """Changes (n, D) by unit impulses; zero where there is none."""
        none = np.zeros(self.dimension + 3)
        kicks = [
            self.machine.kick(e.kicked, e.element) if e.kicked else none for e in self.itinerary
        ]
        return np.array(kicks)

    @cached_property
    def resets(self) -> Any:
        """(n, D, D): rates of what begins to hold, or to stick, are lost."""
        pairs = zip(self.itinerary, self.following, strict=True)
        return np.array([self.machine.caught(event.mode, after.mode) for event, after in pairs])

    @cached_property
    def flows(self) -> Any:
        """A, (n, D, D), of the modes that follow the events."""
        return np.array([self.machine.flow(event.mode) for event in self.following])

    @cached_property
    def transitions(self) -> Any:
        """(n, D, D) from just after each event to just before the next."""
        return moved(self.flows, self.durations, self.measures)

    @cached_property
    def _way(self) -> tuple[Any, Any, Any]:
        """Whole states (n, D) before and after the events, and before the next ones."""
        n, d = self.events, self.dimension
        before, after, reached = np.empty((3, n, d + 3), dtype=self.transitions.dtype)
        state: Any = None
        for i in range(n):
            state = self.lap.states[self._node_of[i]] if i in self._node_of else state
            before[i, :d], before[i, d:] = state, self._turning[i]
            pushed = before[i]
            if i in self.impulse_of:
                pushed = pushed + self.impulses[self.impulse_of[i]] * self.kicks[i]
            after[i] = self.resets[i] @ pushed
            reached[i] = self.transitions[i] @ after[i]
            state = reached[i, :d]
        return before, after, reached

    @property
    def before(self) -> Any:
        """Positions and velocities (n, 2N), or more, just before the events."""
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
        return np.asarray(self.after)

    @cached_property
    def guards(self) -> Any:
        """Rows (n, D) of what is zero at the events; zero where a period begins."""
        none = np.zeros(self.dimension + 3)
        return np.array(
            [
                self.machine.watched(e.mode, e.element, e.guard) if e.element >= 0 else none
                for e in self.itinerary
            ]
        )

    @cached_property
    def rates(self) -> Any:
        """Rows (k, D) of the rates of the gaps that impacts close."""
        rows = [self.machine.rate(int(side)) for side in self.sides]
        return np.array(rows).reshape(len(rows), self.dimension + 3)

    @cached_property
    def restitutions(self) -> Any:
        return np.array([self.machine.restitution(int(side)) for side in self.sides])

    # --- equations --------------------------------------------------------------------------------

    @property
    def left(self) -> Any:
        """What is left of the equations, (m,)."""
        found = (self.guards * self.before).sum(axis=1)
        for i, event in enumerate(self.itinerary):
            if event.element < 0:
                turns = np.rint(self.event_phases[i] / TWO_PI)
                found[i] = self.event_phases[i] - TWO_PI * turns
            elif (pair := self.pairs[i]) is not None:
                found[i] = divided.value(self, i, pair)
        rates = (self.rates * self.before[self.hits]).sum(axis=1)
        rates = rates + self.impulses / (1.0 + self.restitutions)
        ended = self.reached[[node - 1 for node in self.course.nodes], : self.dimension]
        missing = np.roll(ended, -1, axis=0) - np.roll(self.lap.states, -1, axis=0)
        return np.concatenate([found, rates, missing.ravel()])

    def jacobian(self, multiplier: complex) -> Any:
        """Their derivative D(multiplier), (m, m)."""
        n, d, k, last = self.events, self.dimension, len(self.hits), len(self.course.nodes) - 1
        kind: Any = np.result_type(multiplier, 1.0)
        size = n + k + d * (last + 1)
        out = np.zeros((size, size), dtype=kind)
        # changes of the state before and after an event, at one time, by all unknowns
        change, changes, node = np.zeros((d, size), dtype=kind), [], -1
        for i, event in enumerate(self.itinerary):
            if i in self._node_of:
                node = self._node_of[i]
                change = np.zeros_like(change)
                change[:, self._own(node)] = np.eye(d)
            turned = np.array([self._turning[i, 1], -self._turning[i, 0]])
            row, reset, free = self.guards[i], self.resets[i, :d], self._phase_is_free(i)
            if event.element < 0:
                out[i, i] = 1.0
            elif self.pairs[i] is None:
                out[i] += row[:d] @ change
                out[i, i] += free * (row[d : d + 2] @ turned)
            after = reset[:, :d] @ change
            if i in self.impulse_of:
                j = self.impulse_of[i]
                out[n + j] += self.rates[j, :d] @ change
                out[n + j, i] += free * (self.rates[j, d : d + 2] @ turned)
                out[n + j, n + j] += 1.0 / (1.0 + self.restitutions[j])
                after[:, n + j] += reset @ self.kicks[i]
            if free:
                after[:, i] += reset[:, d : d + 2] @ turned
                after[:, i] -= (self.flows[i] @ self.after[i])[:d] / self.clock
            changes.append(after)
            change = self.transitions[i, :d, :d] @ after
            moving = (self.flows[i] @ self.reached[i])[:d]
            for column, part in self._ends(i, multiplier):
                change[:, column] += part * moving
            if i == n - 1 or i + 1 in self._node_of:
                there = 0 if node == last else node + 1
                out[self._own(node)] = change
                out[self._own(node), self._own(there)] -= np.eye(d) * (1.0 if there else multiplier)
        for i, pair in enumerate(self.pairs):
            if pair is not None:
                self._divide(out, i, pair, changes, multiplier)
        return out

    def _own(self, node: int) -> slice:
        """Which unknowns are the state at a node; which equations tell the next one."""
        begin = self.events + len(self.hits) + self.dimension * node
        return slice(begin, begin + self.dimension)

    def _phase_is_free(self, i: int) -> bool:
        return self.driven or i > 0

    def _ends(self, i: int, mu: Any) -> Iterator[tuple[int, Any]]:
        """Derivatives of the time from event `i`, at its phase, to the next one, by columns."""
        after = (i + 1) % self.events
        if self._phase_is_free(after):
            yield after, (mu if after == 0 else 1.0) / self.clock
        if not self.driven:
            yield 0, self.durations[i] / self.lap.turn

    def _divide(self, out: Any, i: int, pair: divided.Pair, changes: list[Any], mu: Any) -> None:
        """Add the row of a divided difference."""
        begun = pair.first > i
        for j, by_state, by_time in divided.derivatives(self, i, pair):
            # what began before the period began: all in terms of the period before
            factor = mu if begun and j <= i else 1.0
            out[i] += factor * (by_state[: self.dimension] @ changes[j])
            if self._phase_is_free(j):
                rate = by_state @ (self.flows[j] @ self.after[j])
                out[i, j] += factor * (rate - by_time) / self.clock
            for column, part in self._ends(j, mu):
                out[i, column] += factor * by_time * part

    @cached_property
    def rounded(self) -> Array:
        """What rounding may make of `reached`, (n, D), from `after`, to first order."""
        m = self.measures
        scaled = abs(self.flows) * m / m[:, None]
        norms = scaled.sum(axis=1).max(axis=1) * abs(self.durations)
        sizes = abs(self.transitions) @ abs(self.after)[:, :, None]
        level = (sizes[:, :, 0] / m).max(axis=1, keepdims=True)
        turned = 1.0 + abs(self.lap.phases).max()
        late = turned / self.clock * abs(self.flows @ self.reached[:, :, None])[:, :, 0]
        return np.asarray(_ROUNDING * ((8.0 + norms[:, None]) * level * m + 2.0 * late))

    @cached_property
    def rounding(self) -> Array:
        """What rounding may make of them, (m,), to first order."""
        n, k, d = self.events, len(self.hits), self.dimension
        turned = 8.0 + abs(self.event_phases)
        own = np.empty(n + k + self.lap.states.size)
        own[:n] = turned * (abs(self.guards) * abs(self.before)).sum(axis=1)
        rates = (abs(self.rates) * abs(self.before[self.hits])).sum(axis=1)
        own[n : n + k] = turned[self.hits] * rates + 4.0 * abs(self.impulses)
        own[n + k :] = abs(self.lap.states).ravel()
        for i, event in enumerate(self.itinerary):
            if event.element < 0:
                own[i] = turned[i]
            elif (pair := self.pairs[i]) is not None:
                own[i] = divided.rounding(self, i, pair) / _ROUNDING
        # rows through which errors of a state reach the equations of later events
        rows, out = np.zeros((len(own), d)), _ROUNDING * own
        for j in reversed(range(n)):
            if j == n - 1 or j + 1 in self._node_of:
                node = max(number for at, number in self._node_of.items() if at <= j)
                rows[:] = 0.0
                rows[self._own(node)] = np.eye(d)
            out += abs(rows) @ self.rounded[j, :d]
            rows = rows @ (self.transitions[j, :d, :d] @ self.resets[j, :d, :d])
            if self.itinerary[j].element >= 0 and self.pairs[j] is None:
                rows[j] = self.guards[j, :d]
            if j in self.impulse_of:
                rows[n + self.impulse_of[j]] = self.rates[self.impulse_of[j], :d]
        return out

    @cached_property
    def state_rounding(self) -> Array:
        """What rounding may make of states, to first order."""
        out, error = np.zeros((self.events, self.dimension)), np.zeros(self.dimension)
        for i in range(self.events):
            out[i] = error = 0.0 * error if i in self._node_of else error
            step = self.transitions[i] @ self.resets[i]
            error = abs(step[: self.dimension, : self.dimension]) @ error
            error += self.rounded[i, : self.dimension]
        return out

    def change(self, change: tuple[Array, Numbers]) -> Array | None:
        """Their derivative (m,) by a change of all numbers; None where it is not known."""
        scene = self.scene._replace(machine=Machine(self.oscillator, change[0]))
        there = ShootingSolution(scene, self.course, self.lap, self.pairs, self.driven)
        with np.errstate(all="ignore"):
            return np.asarray(there.left.imag / STEP)

    # --- the motion -------------------------------------------------------------------------------

    def passed(self, since: Array) -> Array:
        begin = (self.event_phases - self.event_phases[0]) / self.clock
        which = np.clip(np.searchsorted(begin, since, side="right") - 1, 0, None)
        z = moved(self.flows[which], since - begin[which], self.measures)
        return np.asarray((z @ self.after[which][:, :, None])[:, : self.dimension, 0])

    def flown(self, i: int, phase: float) -> Array:
        """The state (2N,) at a phase after event `i`."""
        late = np.array([(phase - self.event_phases[i]) / self.clock])
        z = moved(self.flows[i : i + 1], late, self.measures)[0] @ self.after[i]
        return np.asarray(z[:-3])

    # --- what is watched --------------------------------------------------------------------------

    def curve(self, i: int, element: int, guard: int = 0) -> Curve:
        mode = self.following[i].mode
        row, flow = self.machine.watched(mode, element, guard), self.flows[i]
        start, m = self.after[i], self.measures
        rows = [row, row @ flow, row @ flow @ flow]

        def values(times: Array, orders: int) -> Array:
            states = _run_through(flow, start, times, m)
            return np.array([r @ states.T for r in rows[:orders]])

        ends = np.maximum(abs(start), abs(self.reached[i]))
        sizes = float(abs(rows[0]) @ ends), float(abs(rows[2]) @ ends)
        return Curve(values, float(self.durations[i]), sizes)

    def size_of(self, i: int, element: int, guard: int) -> float:
        row = self.machine.watched(self.following[i].mode, element, guard)
        return float(abs(row) @ self.measures)

    def acceleration(self, i: int) -> tuple[float, float]:
        k = self.hits[i]
        row = self.machine.gap(int(self.sides[i])) @ self.flows[k] @ self.flows[k]
        return float(row @ self.after[k]), 64.0 * _ROUNDING * float(abs(row) @ abs(self.after[k]))

    # --- the orbit --------------------------------------------------------------------------------

    @property
    def multipliers(self) -> Any:
        """Floquet multipliers (2N,), the largest modulus first."""
        found = product_eigenvalues(self.factors[0])
        return found if self.driven else found[:-1]

    @cached_property
    def factors(self) -> tuple[Array, Array]:
        """From just before each event, at its phase, to just before the next one.

        Of what nothing drives from the guard of the first event to itself, along the motion.
        """
        d, found = self.dimension, []
        for i in range(self.events):
            moving = self.flows[i - 1] @ self.before[i]
            passed = self.resets[i].copy()
            if i in self.impulse_of:
                j = self.impulse_of[i]
                own = np.outer(self.kicks[i], self.rates[j]) * (1.0 + self.restitutions[j])
                passed = self.resets[i] @ (np.eye(len(own)) - own)
            rate = float(self.guards[i] @ moving)
            if rate and (self.driven or i):
                late = self.flows[i] @ self.after[i] - passed @ moving
                passed = passed + np.outer(late, self.guards[i] / rate)
            found.append((self.transitions[i] @ passed)[:d, :d])
        if not self.driven:
            moving = (self.flows[-1] @ self.reached[-1])[:d]
            row = self.guards[0][:d]
            found[-1] -= np.outer(moving / (row @ moving), row @ found[-1])
        factors = np.array(found)
        m = self.measures[:d]
        factors = factors * m / m[:, None]
        scaled = abs(self.flows) * self.measures / self.measures[:, None]
        grown = 16.0 + scaled.sum(axis=1).max(axis=1) * abs(self.durations)
        return factors, _ROUNDING * grown * abs(factors).max(axis=(1, 2))

    @property
    def admissible(self) -> bool:
        """Whether simulation finds the same events."""
        if (self.impulses < 0.0).any() or (self.durations < 0.0).any():
            return False
        i = int(np.argmax(self.durations))
        since = float(self.event_phases[i] - self.event_phases[0]) / self.clock
        since += 0.5 * float(self.durations[i])
        (z,), n = self.passed(np.array([since])), self.dimension // 2
        phase = float(self.event_phases[0]) + self.clock * since if self.driven else 0.0
        try:
            start = self.oscillator.state(z[:n], z[n:], phase % TWO_PI)
            seen = simulated(self.oscillator, start, self.period)
        except (NoMotion, NotImplementedError):
            return False
        return self._follows(seen, since)

    def _follows(self, seen: Seen, since: float) -> bool:
        """Whether events seen from a time on are those of the orbit."""
        times = np.asarray((self.event_phases - self.event_phases[0]) / self.clock)
        due = (times - since) % self.period
        order = [i for i in np.argsort(due).tolist() if self.itinerary[i].element >= 0]
        if len(seen.events) != len(order):
            return False
        same = all(
            (a.element, a.guard, a.mode.numbers) == (b.element, b.guard, b.mode.numbers)
            for a, b in zip(seen.events, (self.itinerary[i] for i in order), strict=True)
        )
        return same and bool((abs(seen.times - due[order]) <= SAME * self.period).all())


def simulated(system: Any, start: Any, length: float) -> Seen:
    """The events of a motion from a state on, for some time."""
    count = 4
    while True:
        run = system._run(start, count, store=True)
        if run.duration > length or run.impacts < count:
            break
        count *= 4
    seen = events_seen(system, run)
    return seen.part(0, int(np.searchsorted(seen.times, length)))


def _run_through(flow: Array, start: Array, times: Array, measures: Array) -> Array:
    """States (k, D) at times (k,) from a start; of equal steps from zero on by doubling."""
    count, step = len(times), float(times[-1]) / max(len(times) - 1, 1)
    if count < 4 or times[0] != 0.0 or (abs(np.diff(times) - step) > 1e-12 * times[-1]).any():
        each = np.broadcast_to(flow, (count, *flow.shape))
        return np.asarray(moved(each, times, measures) @ start)
    matrix, out = moved(flow[None], np.array([step]), measures)[0], start[None]
    while len(out) < count:
        out = np.concatenate([out, out @ matrix.T])
        matrix = matrix @ matrix
    return out[:count]


def moved(flows: Any, lasts: Any, measures: Array) -> Any:
    """exp(A t), (n, D, D), in units in which states are of order one."""
    scaled = flows * measures / measures[:, None] * np.asarray(lasts)[:, None, None]
    return np.asarray(exponentials(scaled)) * measures[:, None] / measures
