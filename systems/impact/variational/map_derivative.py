"""Exact derivative of the impact map, also through contact and release."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.no_motion import NoCrossing, NoDerivative, TangentCrossing
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import HALT, IMPACT
from dynkit.systems.impact.elements.friction import FORWARD, STICKS
from dynkit.systems.impact.elements.laws import ImpactLaw
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.mode import Mode
from dynkit.systems.impact.simulation.state import ImpactState
from dynkit.systems.impact.simulation.trajectory import grouped
from dynkit.systems.impact.variational.order import check_order
from dynkit.systems.impact.variational.saltation import along, comes_by_itself, struck
from dynkit.systems.impact.variational.taylor_derivative import followed, hit, rubbed, rubs_on

_ORDERS = 16
"""Number of terms of Taylor series over the smallest step; the remainder is below 3e-17."""

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure
    from dynkit.systems.impact.simulation.trajectory import Trajectory


def derivatives(oscillator: DrivenStructure, run: Trajectory) -> Array:
    """Derivatives (n, d, d) in section coordinates, from each point of a run to the next.

    Each is a product of derivatives: of free coordinates by section coordinates, of each mode on
    the way up to the zero of its guard, and of the impact law. A mode that is entered at the start
    counts as entered for all neighbouring starts. After the omitted bounces of a chatter, the
    motion no longer depends on the relative velocity. If the energies are not quadratic, the run
    must have one impact.
    """
    if not run.impacts:
        raise NoCrossing(f"there is no next impact: {run.ending.value}")
    if run.ambiguous >= 0:
        raise NoDerivative("the outcome of the next impact is a choice of law")
    check_order(oscillator, run)
    if oscillator._motion is not None:
        return _by_variations(oscillator, run.start, run)[None]
    way, shape = _Way(oscillator, run), (run.impacts, oscillator.dimension)
    begin, laws, times = way.lifted(), np.empty(shape), np.empty(shape)
    ends = np.empty_like(begin)
    for points in way.alike():
        ends[points], laws[points], times[points] = way.passed(points, begin[points])
    return way.in_section(ends, laws, times)


@final
class _Way:
    """The modes along a run, and their derivatives up to the zeros of their guards.

    Each segment of the run begins a flight, which ends where the next segment begins.

    Attributes
    ----------
    first : list of int
        The first flight after each point.
    reached : (K,)
        Guard whose zero ends each flight. For an event that a simultaneous impact causes, it is the
        guard of this impact.
    flown : {int: (ends, flows, rates)}
        For each mode, the states (k, 2, slots) at the ends of its flights of positive duration,
        their derivatives (k, 2 slots, 2 slots) by the states at the begins, and their rates (k, 2
        slots).
    place : (K,)
        Number of each flight among those of its mode.
    low : (K,)
        Whether a flight returns to its stop in less than the smallest step of the gap. For such low
        bounces, the gap and its rate would be differences that are lost in rounding.
    turns : (2, n + 1)
        Sine and cosine of the phase at the points.
    """

    def __init__(self, oscillator: DrivenStructure, run: Trajectory) -> None:
        self.oscillator, self.run, self.hit = oscillator, run, not oscillator._strobed
        automaton, s = oscillator._automaton, run.segments
        self.modes, self.guards = automaton.modes, automaton.guards
        self.first = np.searchsorted(s.point, np.arange(run.impacts + 1)).tolist()
        turns = run.coordinates[1:] if run.impacts > 1 else run.final._turn
        self.turns = np.column_stack([run.start._turn, turns])
        self.reached, self.lasts = s.guard[1:].copy(), np.diff(s.begin)
        if self.hit:  # events that a simultaneous impact causes
            inner = s.point[1:] == s.point[:-1]
            at_once = inner & (s.begin[1:] == run.time[s.point[:-1]])
            for k in np.flatnonzero(at_once).tolist():
                guard = self.guards[self.reached[k]]
                if guard.watch.force:
                    side = int(run.element[s.point[k]])
                    self.reached[k] = automaton.guard(guard.mode, side)
        count = len(self.lasts)
        self.place, self.low = np.zeros(count, dtype=np.intp), np.zeros(count, dtype=bool)
        self.flown: dict[int, tuple[Array, Array, Array]] = {}
        for number, where in grouped(s.mode[:-1]):
            mode, here = self.modes[number], np.arange(count)[where]
            here = here[self.lasts[here] > 0.0]
            slots, lasts = np.arange(mode.layout.slots), self.lasts[here]
            ends = mode.after(s.of(mode, here), np.arange(len(here)), lasts)
            flows = mode.transitions(lasts, slots).matrices(slots)
            self.flown[number] = ends, flows, mode.rate(ends).reshape(len(here), 2 * len(slots))
            self.place[here] = np.arange(len(here))
        if self.hit:
            left = np.array(self.first[:-1])
            left = left[run.speeds[:-1] > 0.0]  # flights from an impact
            for number, where in grouped(self.reached[left]):
                guard, here = self.guards[number], left[where]
                if guard.watch.event == IMPACT:
                    back = run.sides[s.point[here]] == guard.element
                    self.low[here] = back & (self.lasts[here] < guard.sum.smallest)
        self._seen: dict[tuple[int, int], Array] = {}

    def lifted(self) -> Array:
        """Derivatives (n, 2 slots, d) of the free states at the points, by section coordinates."""
        oscillator, start, sides = self.oscillator, self.run.start, self.run.sides[:-1]
        if len(sides) == 1:
            return _lift(oscillator, start)[None]
        out = np.empty((len(sides), 2 * oscillator._free.layout.slots, oscillator.dimension))
        for side, where in grouped(sides):
            out[where] = _lift(oscillator, replace(start, element=side))
            if self.hit:
                out[where, :, -1] = _turned(oscillator, side, *self.turns[:, :-1][:, where])
        return out

    def alike(self) -> Iterator[Any]:
        """Groups (m,) of points with the same modes and events on their ways to the next points."""
        s, first = self.run.segments, np.array(self.first)
        told = s.mode[:-1], s.guard[1:], self.reached, self.lasts > 0.0, self.low, s.speed[1:] > 0.0
        # for friction that sticks before any time has passed
        at_once = s.begin[1:] == s.begin[first[s.point[:-1]]]
        flights = np.unique(np.column_stack([*told, at_once]), axis=0, return_inverse=True)[1]
        kinds, found = flights.reshape(-1).astype(np.int64), dict[bytes, list[int]]()
        for point, (begin, end) in enumerate(pairwise(self.first)):
            found.setdefault(kinds[begin:end].tobytes(), []).append(point)
        return map(np.array, found.values())

    def passed(self, points: Any, derivative: Array) -> tuple[Array, Array, Array]:
        """Derivatives at the next points, after points that are `alike`.

        They are those of the free states (m, 2 slots, d), of the gap's rates after the impacts and
        of the times (m, d). `derivative` is that of the free states before, (m, 2 slots, d).
        """
        oscillator, s = self.oscillator, self.run.segments
        first = np.array(self.first)[points]
        count = self.first[points[0] + 1] - self.first[points[0]]
        derivative = self._seen_from(int(s.mode[first[0]]), 0, derivative)
        time = np.zeros(derivative[:, 0].shape)
        for step in range(count):
            k = first + step
            guard, last = self.guards[s.guard[k[0] + 1]], step == count - 1
            # the end of a forcing period has a fixed time
            closes = last and not self.hit and not oscillator._cycled
            y, rate, derivative, later = self._flown(
                points, k, derivative, -time if closes else None
            )
            # Time also moves the phase: it is part of the rate, through sine and cosine.
            derivative = derivative + rate[:, :, None] * later[:, None]
            time += later
            if not last:
                if guard.watch.event == HALT and s.begin[k[0] + 1] == s.begin[first[0]]:
                    derivative = _held_fast(oscillator, guard, derivative)
                if guard.scrapes and s.speed[k[0] + 1] > 0.0:
                    for i, number in enumerate(k.tolist()):
                        _kept_slipping(oscillator, self.run, number + 1, y[i], derivative[i])
                derivative = guard.change[:, :-1] @ derivative
        law = 0.0 * time
        if self.hit:
            stop = oscillator._stops[int(self.run.element[points[0]])]
            row, states = along(guard.sum, 2), y.reshape(len(y), -1)
            law = row @ derivative
            slope = _slopes(stop, states @ row, self.run.log.speed[points])
            derivative = derivative + struck(oscillator, guard, slope, y, derivative)
            law = -slope[:, None] * law
        return self._seen_from(0, guard.mode, derivative), law, time

    def in_section(self, derivatives: Array, laws: Array, times: Array) -> Array:
        """Derivatives (n, d, d) in section coordinates, from the results of `passed`."""
        oscillator, free, d = self.oscillator, self.oscillator._free, self.oscillator.dimension
        states = derivatives.swapaxes(1, 2).reshape(-1, 2, free.layout.slots)
        q, *by_turn = free.parts(states)
        shape = len(laws), d, -1
        x = free.forced.displacements(q, *by_turn).reshape(shape).swapaxes(1, 2)
        v = free.forced.speeds(q, *by_turn).reshape(shape).swapaxes(1, 2)
        sliders = x[:, oscillator.degrees_of_freedom :]
        if not self.hit:
            positions, velocities = oscillator._crossed.kept
            return np.concatenate([x[:, positions], v[:, velocities], sliders], axis=1)
        phase = oscillator.frequency * times + np.eye(d)[-1]
        if free.layout.table >= 0:
            by_sine, by_cosine = (part.reshape(len(laws), d) for part in by_turn)
            sine, cosine = self.turns[:, 1:, None]
            phase = cosine * by_sine - sine * by_cosine
        out = np.empty((len(laws), d, d))
        for side, where in grouped(self.run.element):
            others = oscillator._others[side]
            own = -laws[where] if side == 1 and oscillator._faces else laws[where]
            parts = x[where][:, others], v[where][:, others], sliders[where], own[:, None]
            out[where] = np.concatenate([*parts, phase[where][:, None]], axis=1)
        return out

    def _flown(
        self, points: Any, k: Any, derivative: Array, given: Array | None
    ) -> tuple[Array, Array, Array, Array]:
        """States, rates and derivatives (m, 2 slots, d) after flights, and those of the end times.

        The derivatives (m, d) of the end times may be given.
        """
        s, reached = self.run.segments, self.guards[self.reached[k[0]]]
        mode, row, count = self.modes[reached.mode], along(reached.sum, 0), len(k)
        if self.lasts[k[0]] > 0.0 and not self.low[k[0]]:
            y, flows, rate = (each[self.place[k]] for each in self.flown[int(s.mode[k[0]])])
            derivative = flows @ derivative
            later = _later(row @ derivative, rate @ row) if given is None else given
            return y, rate, derivative, later
        begin = s.of(mode, k)
        if self.low[k[0]]:
            risen, moved = _low_flights(mode, begin, derivative, self.lasts[k])
            speeds = self.run.speeds[points] + risen.reshape(count, -1) @ along(reached.sum, 2)
            y, derivative = begin + risen, derivative + moved
            return y, mode.rate(y).reshape(count, -1), derivative, _later(row @ moved, speeds)
        rate, risen = mode.rate(begin).reshape(count, -1), row @ derivative
        later = 0.0 * risen if given is None else given
        values = begin.reshape(count, -1) @ row + reached.sum.offset
        for i in range(count) if given is None else ():
            own = s, int(k[i]), reached, float(values[i]), row * rate[i], self.oscillator.frequency
            if comes_by_itself(*own):
                later[i] = -risen[i] / float(row @ rate[i])
        return begin, rate, derivative, later

    def _seen_from(self, number: int, other: int, derivative: Array) -> Array:
        """Convert a derivative (2 slots, d) of states to a mode's basis from another one."""
        if number == other:
            return derivative
        if (number, other) not in self._seen:
            self._seen[number, other] = self.modes[number].seen_from(self.modes[other])[:, :-1]
        return np.asarray(self._seen[number, other] @ derivative)


def tangent(oscillator: DrivenStructure, state: ImpactState) -> Array:
    """Orthonormal disturbances (d, d - 2) of section coordinates that keep a state on its stop.

    The stop acts along a function of the coordinates. Without hard stops, they are (d, d - 1) and
    keep the state on the section.
    """
    n, d, hit = oscillator.degrees_of_freedom, oscillator.dimension, not oscillator._strobed
    lifted = _lift(oscillator, state).reshape(2, -1, d)
    first = lifted[0, :n], lifted[1, :n], lifted[0, n:-1]
    put = np.concatenate([*first, np.eye(d)[d - 2 * hit :]])
    return np.asarray(np.linalg.svd(put)[0][:, : d - 1 - hit])


def _by_variations(oscillator: DrivenStructure, state: ImpactState, run: Trajectory) -> Array:
    """The derivative (d, d) of a run with one impact, if the energies are not quadratic."""
    side, n = run.final.element, oscillator.degrees_of_freedom
    out, end = followed(oscillator, run, _lift(oscillator, state))
    if oscillator._strobed:
        positions, velocities = oscillator._crossed.kept
        return np.vstack([out[positions], out[n + velocities], out[2 * n : -1]])
    guard = oscillator._automaton.guards[int(run.log.guard[-1])]
    mode = oscillator._automaton.modes[guard.mode]
    stop, speed, rate = oscillator._stops[side], float(run.log.speed[-1]), mode.gap_at(side, end)[1]
    slope = float(_slopes(stop, np.array([rate]), np.array([speed]))[0])
    if isinstance(stop.restitution, float):
        r, rate = slope, -speed / slope if slope else rate
    else:
        r = -speed / rate
    rubs = rubbed(oscillator, guard, end, out, slope, r, rate)
    out, before = hit(mode, side, end, out, slope, r)
    out = out + rubs
    own = slope if side == 1 and oscillator._faces else -slope
    others = oscillator._others[side]
    return np.vstack([out[others], out[n + others], out[2 * n : -1], own * before, out[-1]])


def _held_fast(oscillator: DrivenStructure, guard: Any, derivative: Array) -> Array:
    """The derivative after friction that sticks from the start on has stopped its slip.

    A neighbouring start slips at a small velocity, which an impulse of the friction makes zero.
    Friction that sticks already has impulses, too, so that it continues to stick.
    """
    automaton, mode = oscillator._automaton, oscillator._automaton.modes[guard.mode]
    sticking = [*automaton.parts.grips(automaton.regimes[guard.mode])[1], guard.element]
    rows = np.array([oscillator._elements[k].row(oscillator._size) for k in sticking])
    pushes = np.array([mode.pushed(row) for row in rows]).T
    kicks = [mode.placed(mode.contact(row).kick[:2]).ravel() for row in rows]
    kick = np.linalg.solve(rows @ pushes, np.eye(len(rows))[-1]) @ kicks
    slip = along(guard.sum, 0) / (guard.watch.rate * oscillator._elements[guard.element].sign)
    return np.asarray(derivative - kick[:, None] * (slip @ derivative)[:, None])


def _kept_slipping(
    oscillator: DrivenStructure, run: Any, k: int, y: Array, derivative: Array
) -> None:
    """Change a derivative, in place, by friction in bounces that contact replaces.

    Friction in contact takes more slip velocity than it would in the bounces, by `ratio` times the
    speed of the first bounce. Slipping friction gets this excess back. If friction sticks, its
    disturbance of the slip velocity becomes zero.
    """
    automaton, s = oscillator._automaton, run.segments
    switched = s.point == s.point[k]  # later impacts have their own friction
    times, guards = s.begin[k:][switched[k:]], s.guard[k:][switched[k:]]
    guard = automaton.guards[int(s.guard[k])]
    for part in guard.scrapes:
        to = rubs_on(automaton, times, guards, part.element)
        if to == STICKS:
            by = -along(part.slip, 0)
            change = float(by @ y.ravel()) - part.slip.offset
        else:
            by = (1.0 if to == FORWARD else -1.0) * part.ratio * along(guard.sum, 2)
            change = float(by @ y.ravel())
        derivative += np.outer(part.kick[:2], by @ derivative)
        y = y + change * part.kick[:2]


def _slopes(stop: HardStop, rates: Array, speeds: Array) -> Array:
    """Derivatives (m,) of the rebound velocity by the approach velocity."""
    law = stop.restitution
    if not isinstance(law, ImpactLaw):
        return np.full(len(rates), law)
    approach = law.approach(-rates, speeds)
    for velocity in approach.tolist():
        if law.jumps(velocity):
            raise NoDerivative(f"the impact law jumps at the approach velocity {velocity}")
    return np.asarray(law.slope(approach))


def _lift(oscillator: DrivenStructure, state: ImpactState) -> Array:
    """Derivative (2 slots, d) of the free state, table included, by the section coordinates."""
    free, n, d = oscillator._free, oscillator.degrees_of_freedom, oscillator.dimension
    x, v = np.zeros((2, d, oscillator._size))
    by_sine, by_cosine = np.zeros((2, d))
    sliders = range(n, oscillator._size)
    if oscillator._strobed:
        positions, velocities = oscillator._crossed.kept
        ends = np.cumsum([len(positions), len(velocities)])
        x[: ends[0], positions] = np.eye(len(positions))
        v[ends[0] : ends[1], velocities] = np.eye(len(velocities))
        x[ends[1] :, sliders] = np.eye(len(sliders))
        oscillator._crossed.put_changes(x, v, state.position, state.velocity)
    else:
        contact, stop = oscillator._contacts[state.element], oscillator._stops[state.element]
        sine, cosine = state._turn
        others = oscillator._others[state.element]
        m = len(others)
        x[np.arange(m), others] = 1.0
        v[np.arange(m) + m, others] = 1.0
        x[2 * m : -2, sliders] = np.eye(len(sliders))
        place, moving = np.zeros((2, d))
        far = state.element == 1 and oscillator._faces
        moving[-2] = -stop.sign if far else stop.sign
        # derivatives by the phase: sine and cosine a quarter of a turn ahead
        place[-1] = stop.swing(cosine, -sine)
        moving[-1] = stop.swing_rate(oscillator.frequency, cosine, -sine)
        if oscillator._bent:
            moved = x[:, :n], v[:, :n], place, moving
            x[:, :n], v[:, :n] = contact.lifted(state.position, state.velocity, moved)
        else:
            contact.put(x, place)
            contact.put(v, moving)
        by_sine[-1], by_cosine[-1] = cosine, -sine
    q = free.coordinates(x, v, by_sine, by_cosine, np.zeros(d))
    out = free.states(q, by_sine, by_cosine)
    if free.layout.constant >= 0:
        out[:, 0, free.layout.constant] = 0.0
    return np.asarray(out.reshape(d, -1).T)


def _turned(oscillator: DrivenStructure, side: int, sine: Array, cosine: Array) -> Array:
    """Derivatives (n, 2 slots) of free states on a stop by the phase: see `_lift`."""
    free, stop, contact = oscillator._free, oscillator._stops[side], oscillator._contacts[side]
    x, v = np.zeros((2, len(sine), oscillator._size))
    contact.put(x, stop.swing(cosine, -sine))
    contact.put(v, stop.swing_rate(oscillator.frequency, cosine, -sine))
    out = free.states(free.coordinates(x, v, cosine, -sine, 0.0 * sine), cosine, -sine)
    if free.layout.constant >= 0:
        out[:, 0, free.layout.constant] = 0.0
    return np.asarray(out.reshape(len(sine), -1))


def _later(risen: Array, speeds: Array) -> Array:
    """Derivatives (m, d) of event times, from those of the guards and from their rates (m,)."""
    if not speeds.all():
        raise TangentCrossing("an event of the motion grazes, to rounding")
    return -risen / speeds[:, None]


def _low_flights(mode: Mode, y: Array, derivative: Array, durations: Array) -> tuple[Array, Array]:
    """Changes of states (m, 2, slots), and of their derivatives (m, 2 slots, d), over flights.

    They are sums of Taylor series, so that changes much smaller than the state keep their digits.
    """
    count, slots, d = derivative.shape
    others = derivative.swapaxes(1, 2).reshape(count, d, *y.shape[1:])
    term = np.concatenate([y[:, None], others], axis=1)
    total = np.zeros_like(term)
    for k in range(1, _ORDERS):
        term = mode.rate(term) * (durations / k)[:, None, None, None]
        total += term
    return total[:, 0], total[:, 1:].reshape(count, d, slots).swapaxes(1, 2)
