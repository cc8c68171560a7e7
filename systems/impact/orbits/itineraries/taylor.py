"""Motions of several modes of structures whose energies are not quadratic: by Taylor's method."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev, polynomial
from scipy.special import factorial

from dynkit.core.differences import numerical_derivative
from dynkit.core.no_motion import CannotFollow, Diverged
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.orbits.flights import Curve
from dynkit.systems.impact.orbits.itineraries.divided import Pair
from dynkit.systems.impact.orbits.itineraries.itinerary import Course, Happening, guard_of
from dynkit.systems.impact.orbits.itineraries.motion import ROUNDING, Lap
from dynkit.systems.impact.orbits.itineraries.shooting import Scene, ShootingSolution
from dynkit.systems.impact.orbits.machine import STEP, Machine, Numbers
from dynkit.systems.impact.variational.taylor_derivative import DIFFERENCES, gradient

if TYPE_CHECKING:
    from dynkit.systems.impact.elements.element import Watch
    from dynkit.systems.impact.modes.taylor_mode import Path, TaylorMode
    from dynkit.systems.impact.orbits.machine import Regimes

_POINTS = 24
"""Points of a step of Taylor's method at which what is watched is interpolated."""

_SMALL = 2.0**-50
"""Of the largest term: a series whose last terms are smaller is summed."""

_LEAST = 1e-4
"""Turns of the phase over two pi: derivatives of divided differences are taken over no less."""

_NORM = 4.0
"""Bound of the norm of a step's derivative: order 20 of a series whose terms fall to rounding."""


@final
class TaylorSolution(ShootingSolution):
    """The motion of an itinerary where flights are those of Taylor's method.

    States (D,) are positions, velocities, sine and cosine of the phase, and 1, as of those that are
    linear. Rows of gaps and of their rates are the same as well. What differs are the flights, with
    their derivatives by variational equations, contact forces, and kicks where the mass varies.

    With imaginary changes of the numbers of the machine it takes the motion without them, `still`,
    and the changes of the numbers of flights by modes.
    """

    def __init__(
        self,
        scene: Scene,
        course: Course,
        lap: Lap,
        pairs: list[Pair | None],
        driven: bool,
        still: TaylorSolution | None = None,
        flights: Any = None,
    ) -> None:
        super().__init__(scene, course, lap, pairs, driven)
        self._still, self._flights = still, flights
        self._kicks: dict[int, Array] = {}
        self._turned: dict[int, Array] = {}

    @cached_property
    def modes(self) -> list[TaylorMode]:
        """The modes (n,) that follow the events."""
        return [self._mode(event.mode) for event in self.following]

    def _mode(self, mode: Regimes) -> Any:
        return self.oscillator._automaton.mode(mode.numbers)

    def _short(self, z: Array) -> Array:
        """A state (2, N + 1) of whole states (D,)."""
        x, v = z[: self.dimension].reshape(2, -1)
        return np.stack([np.append(x, z[-3]), np.append(v, z[-2])])

    def _wide(self, rows: Array, z: Array) -> Array:
        """Rows (..., D) of rows (..., 2N + 1) that end with derivatives by the phase of a state."""
        by_phase = rows[..., -1:]
        ends = by_phase * z[-2], -by_phase * z[-3], 0.0 * by_phase
        return np.concatenate([rows[..., :-1], *ends], axis=-1)

    def _rate(self, mode: TaylorMode, z: Array) -> Array:
        """Rate (D,) of a state."""
        (found,) = mode.rate(self._short(z)[None])
        return np.concatenate([*found[:, :-1], found[:, -1], [0.0]])

    def _tangent(self, j: int) -> Array:
        """Derivative (D, D) of the rate of the state by the one after event `j`."""
        z, n, d = self.after[j].real, self.dimension // 2, self.dimension
        out, w = np.zeros((d + 3, d + 3)), self.clock.real
        out[:n, n:d] = np.eye(n)
        out[n:d] = self._wide(self.modes[j].gradients(self._short(z), rates=True), z)
        out[-3, -2], out[-2, -3] = w, -w
        return out

    # --- on the way -------------------------------------------------------------------------------

    @cached_property
    def _way(self) -> tuple[Any, Any, Any, Any, dict[int, Any]]:
        n, d, kind = self.events, self.dimension, np.result_type(self.machine.frequency)
        before, after, reached = np.empty((3, n, d + 3), dtype=kind)
        flown = np.zeros((n, d + 3, d + 3))
        state: Any = None
        for i, event in enumerate(self.itinerary):
            state = self.lap.states[self._node_of[i]] if i in self._node_of else state
            before[i, :d], before[i, d:] = state, self._turning[i]
            pushed = before[i]
            if event.kicked:
                impulse = self.impulses[self.impulse_of[i]]
                pushed = pushed + impulse * self._kick(i, event.kicked, before[i])
            caught = self.machine.caught(event.mode, self.following[i].mode)
            after[i] = caught @ pushed
            reached[i], flown[i] = self._flight(i, after[i])
            state = reached[i, :d]
        return before, after, reached, flown, {}

    def _kick(self, i: int, kicked: Regimes, z: Array) -> Array:
        mode, k, n = self._mode(kicked), self.itinerary[i].element, self.dimension // 2
        if mode.constant_kicks:
            self._kicks[i] = self.machine.kick(kicked, k)
            return np.asarray(self._kicks[i])
        out = np.zeros(len(z))

        def kick(given: Array) -> Array:
            return np.asarray(mode.kick(k, given[:n], float(given[n])))

        here = np.append(z[:n], np.arctan2(z[-3], z[-2]))
        out[n : 2 * n] = kick(here)
        by_place = numerical_derivative(kick, here, accuracy=DIFFERENCES)[0]
        rows = np.zeros((n, 2 * n + 1))
        rows[:, :n], rows[:, -1] = by_place[:, :n], by_place[:, n]
        self._turned[i] = self._wide(rows, z)
        self._kicks[i] = out
        return out

    def _flight(self, i: int, z: Array) -> tuple[Array, Array]:
        """State (D,) at the next event, and derivative (D, D) by the one after event `i`."""
        if self._still is not None:
            return self._changed(self._still, i, z.imag / STEP), self._still.transitions[i]
        return self._moved(i, z, float(self.durations[i]))

    def _moved(self, i: int, z: Array, lasts: float) -> tuple[Array, Array]:
        try:
            end, flow = self.modes[i].flow(self._short(z), lasts, self.itinerary[i].element)
        except (Diverged, CannotFollow) as refusal:
            raise NoSolution(str(refusal)) from refusal
        out, (x, v) = np.zeros((len(z), len(z))), self.modes[i].motion(end)
        out[: self.dimension] = self._wide(flow[:-1], z)
        angle = self.clock * lasts
        s, c = np.sin(angle), np.cos(angle)
        out[-3:-1, -3:-1] = [[c, s], [-s, c]]
        out[-1, -1] = 1.0
        return np.concatenate([x, v, end[:, -1], [1.0]]), out

    def _changed(self, still: TaylorSolution, i: int, change: Array) -> Array:
        """The state (D,) at the next event, with imaginary changes by those after event `i`."""
        start, lasts = self._short(still.after[i]), self.durations[i]
        numbers = self._flights[self.following[i].mode]
        out = still.transitions[i] @ change + still.moving[i] * lasts.imag / STEP
        out[: self.dimension] += still.modes[i].changed(start, float(lasts.real), numbers)
        out[self.dimension :] = 0.0  # phases are given
        return np.asarray(still.reached[i] + 1j * STEP * out)

    @property
    def kicks(self) -> Any:
        none = np.zeros(self.dimension + 3)
        before = self.before
        return np.array([self._kicks.get(i, none) for i in range(len(before))])

    @cached_property
    def resets(self) -> Any:
        n, out = self.dimension // 2, []
        for i, (event, after) in enumerate(zip(self.itinerary, self.following, strict=True)):
            reset = np.eye(self.dimension + 3)
            if len(self.before) and i in self._turned:
                reset[n : 2 * n] += self.impulses[self.impulse_of[i]] * self._turned[i]
            out.append(self.machine.caught(event.mode, after.mode) @ reset)
        return np.array(out)

    @cached_property
    def moving(self) -> Any:
        return np.array([self._rate(*pair) for pair in zip(self.modes, self.reached, strict=True)])

    # --- what is watched --------------------------------------------------------------------------

    def _observed(self, event: Happening) -> Watch:
        """What is zero at an event."""
        own = self.machine.elements[event.element].regimes[event.mode.numbers[event.element]]
        return own.guards[event.guard]

    def watch(self, mode: Regimes, element: int, guard: int, z: Array) -> tuple[Any, Array]:
        if not self._observed(Happening(mode, element, guard)).force:
            row = self.machine.watched(mode, element, guard)
            return row @ z, row
        there, now = self._mode(mode), z.real
        number, state = guard_of(self.oscillator, mode, element, guard), self._short(now)
        value, row = there.watched(number, state)[0], gradient(there, number, state)
        row = self._wide(row, now)
        if self._still is None:
            return value, row
        by = there.gradients(state, self._flights[mode], rates=False)[number]
        return value + 1j * (row @ z.imag + STEP * by), row

    @cached_property
    def _watched(self) -> tuple[Array, Array]:
        rows = np.zeros_like(self.before)
        values = rows[:, 0].copy()
        for i, (event, z) in enumerate(zip(self.itinerary, self.before, strict=True)):
            if event.element >= 0:
                values[i], rows[i] = self.watch(event.mode, event.element, event.guard, z)
        return values, rows

    @property
    def guards(self) -> Any:
        return self._watched[1]

    @property
    def guarded(self) -> Any:
        return self._watched[0]

    def acceleration(self, i: int) -> tuple[float, float]:
        k, row = self.hits[i], self.machine.rate(int(self.sides[i]))
        terms = row * self._rate(self.modes[k], self.after[k])
        return float(terms.sum()), ROUNDING * float(abs(terms).sum())

    def _path(self, i: int) -> Path:
        """The flight after event `i`."""
        return self.modes[i].path(self._short(self.after[i]), max(float(self.durations[i]), 0.0))

    def _at(self, i: int, durations: Array) -> Array:
        """States (k, D) at durations (k,) after event `i`."""
        return self._whole(self._path(i).states(durations))

    def _whole(self, states: Array) -> Array:
        x, v = states[:, 0, :-1], states[:, 1, :-1]
        return np.concatenate([x, v, states[..., -1], np.ones((len(x), 1))], axis=1)

    def curve(self, i: int, element: int, guard: int = 0) -> Curve:
        mode, path = self.following[i].mode, self._path(i)
        watch = self._observed(Happening(mode, element, guard))
        row, parts, size = self.machine.watched(mode, element, guard), [], 0.0
        for begin, end in pairwise([*path.ends[:-1].tolist(), path.reach]):
            z = self._whole(path.states(0.5 * (begin + end) + 0.5 * (end - begin) * _PLACES))
            values = z @ row
            if watch.force:
                values = np.array([self.watch(mode, element, guard, here)[0] for here in z])
            size = max(size, float((abs(z) @ abs(row)).max()))
            parts.append(Chebyshev(_COEFFICIENTS @ values, domain=[begin, end]))
        orders = [[part.deriv(k) if k else part for part in parts] for k in range(3)]

        def at(times: Array, count: int) -> Array:
            which = np.searchsorted(path.ends[1:-1], times, side="right")
            out = np.empty((count, len(times)))
            for k in np.unique(which).tolist():
                here = which == k
                out[:, here] = [own[k](times[here]) for own in orders[:count]]
            return out

        lasts = float(self.durations[i])
        bend = max(float(abs(own(own.linspace(9)[0])).max()) for own in orders[2])
        return Curve(at, lasts, (size, bend))

    @cached_property
    def norms(self) -> Array:
        return np.array([_NORM * (len(self._path(i).ends) - 1) for i in range(self.events)])

    # --- divided differences ----------------------------------------------------------------------

    def _series(self, j: int, row: Array) -> tuple[Array, bool]:
        """Taylor coefficients (k,) of a row at the begin of a flight; whether its end is near."""
        path, w = self._path(j), self.oscillator.frequency
        order = np.arange(path.coefficients.shape[2])
        z, weights = path.coefficients[0].T, w**order / factorial(order)
        phase = np.arctan2(*self.after[j, -3:-1]) + 0.5 * np.pi * order
        sines, cosines = weights * np.sin(phase), weights * np.cos(phase)
        one = (order == 0) * 1.0
        motion = np.concatenate(path.chart.motion(z, sines, cosines, one), axis=1)
        found = motion @ row[:-3] + sines * row[-3] + cosines * row[-2]
        found[0] += row[-1]
        if self.durations[j] > 0.0:
            return found, len(path.ends) == 2
        terms = abs(motion) @ abs(row[:-3]) * abs(self.durations[j]) ** order
        return found, bool(terms[-2:].max() <= _SMALL * terms.max())

    def quotient(self, j: int, row: Any, q: int) -> Any:
        t = self.durations[j]
        if self._still is None:
            series, near = self._series(j, row)
            if near:
                return polynomial.polyval(t, series[q:])
        rise = self.rise(j, row)
        return (rise if q == 1 else rise - t * (row @ self._begun(j))) / t**q

    def _begun(self, j: int) -> Any:
        """Rate (D,) of the state after event `j`."""
        mode, z, n = self.modes[j], self.after[j], self.dimension // 2
        found = self._rate(mode, z.real)
        if self._still is None:
            return found
        by = self._tangent(j) @ z.imag
        changes = self._flights[self.following[j].mode]
        by[n : 2 * n] += STEP * mode.gradients(self._short(z.real), changes, rates=True)
        by[-3:-1] += self.clock.imag * np.array([z[-2].real, -z[-3].real])
        return found + 1j * by

    def quotient_change(self, j: int, row: Any, q: int) -> tuple[Any, float]:
        t = float(self.durations[j])
        series, near = self._series(j, row)
        value, start = self.quotient(j, row, q), self.after[j]
        if near:
            late = polynomial.polyval(t, polynomial.polyder(series[q:]))
        else:
            begun = row @ self._begun(j) if q > 1 else 0.0
            late = ((row @ self.moving[j] - begun) / t ** (q - 1) - q * value) / t
        least, flown = _LEAST / self.clock, self.transitions[j]
        if abs(t) < least:  # there it hardly depends on the duration
            t = least
            _, flown = self._moved(j, start, t)
        by_state = row @ flown - row
        if q > 1:
            by_state -= t * (row @ self._tangent(j))
        return by_state / t**q, float(late)

    def quotient_rounding(self, j: int, row: Any, q: int) -> float:
        series, near = self._series(j, row)
        t = abs(float(self.durations[j]))
        level = polynomial.polyval(t, abs(series[q:])) if near else 0.0
        size = float(abs(row) @ np.maximum(abs(self.after[j]), abs(self.reached[j])))
        return ROUNDING * float(level if near else size / t**q)

    def rise(self, j: int, row: Any) -> Any:
        return row @ (self.reached[j] - self.after[j])

    def rise_change(self, j: int, row: Any) -> Any:
        return row @ self.transitions[j] - row

    # --- the motion -------------------------------------------------------------------------------

    def change(self, change: tuple[Array, Numbers]) -> Array | None:
        """Their derivative (m,) by a change of all numbers; None where it is not known.

        That is where masses vary.
        """
        if not all(mode.constant_kicks for mode in self.modes):
            return None
        modes = sorted({event.mode for event in self.itinerary})
        flights = {mode: self._mode(mode).numbers for mode in modes}
        ends = np.cumsum([len(numbers) for numbers in flights.values()])
        parts = dict(zip(flights, np.split(change[1].flights, ends[:-1]), strict=True))
        scene = self.scene._replace(machine=Machine(self.oscillator, change[0]))
        given = scene, self.course, self.lap, self.pairs, self.driven
        there = TaylorSolution(*given, self, parts)
        return np.asarray(there.left.imag / STEP)

    def passed(self, since: Array) -> Array:
        begin = (self.event_phases - self.event_phases[0]) / self.clock
        which = np.clip(np.searchsorted(begin, since, side="right") - 1, 0, None)
        out = np.empty((len(since), self.dimension))
        for i in np.unique(which).tolist():
            here = which == i
            out[here] = self._at(i, np.maximum(since[here] - begin[i], 0.0))[:, :-3]
        return out

    def flown(self, i: int, phase: float) -> Array:
        late = np.array([(phase - self.event_phases[i]) / self.clock])
        return np.asarray(self._at(i, late)[0, :-3])


_PLACES = np.cos(np.pi * (np.arange(_POINTS) + 0.5) / _POINTS)
_COEFFICIENTS = np.linalg.inv(chebyshev.chebvander(_PLACES, _POINTS - 1))
