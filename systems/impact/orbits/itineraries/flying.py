"""Flights in one mode: rates of states, guards and impacts, with derivatives by the state."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.differences import STEP
from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Watch
from dynkit.systems.impact.modes.constrained import pushes
from dynkit.systems.impact.modes.taylor.mode import FREQUENCY, Path, TaylorMode
from dynkit.systems.impact.modes.taylor.scene import Scene
from dynkit.systems.impact.orbits.exponentials import carried, lifted, moved, run_through
from dynkit.systems.impact.orbits.machine import Machine, Regimes, Rubs

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.itineraries.happening import Happening

_GAUSS = 0.5 + np.array([-0.5, 0.5]) / math.sqrt(3.0)
"""Nodes of Gauss-Legendre quadrature of two points over a unit of time."""

_SHORT = 1e-3
"""Norm of the tangent matrix times duration below which a flight's derivative is a series."""


@final
class LinearFlights:
    """Flights of a linear mode; the machine's numbers may have imaginary changes.

    `measures` (D,) are units of the states.
    """

    varies = False

    def __init__(self, machine: Machine, mode: Regimes, measures: Array) -> None:
        self.machine, self.mode, self._measures = machine, mode, measures
        self._flow = machine.flow(mode)

    def passed(self, z: Any, lasts: Any) -> tuple[Any, Any]:
        """The state (D,) after a flight from state `z`, and its derivative (D, D) by `z`."""
        (flown,) = moved(self._flow[None], np.array([lasts]), self._measures)
        return flown @ z, flown

    def states(self, z: Array, times: Array) -> Array:
        """States (k, D) at times (k,) after a state `z`."""
        return run_through(self._flow, z, times, self._measures)

    def rates(self, states: Array) -> Array:
        """Rates (n, D) of states (n, D)."""
        return np.asarray(states @ self._flow.real.T)

    def bends(self, element: int, states: Array) -> tuple[Array, Array]:
        """Second and third derivatives (n,) of a gap by time, at states (n, D)."""
        first = self.machine.rate(element).real @ self._flow.real
        return states @ first, states @ (first @ self._flow.real)

    def lifted(self, states: Array, times: Array) -> tuple[Array, Array]:
        """Derivatives minus identity (n, D, D) of short flights, and states (n, D) after them."""
        flown = lifted(self._flow.real, times)
        return flown, states + (flown @ states[:, :, None])[..., 0]

    def carried(self, states: Array, times: Array) -> Array:
        """Changes (n, D) of states (n, D) after short flights, due to changes of the numbers."""
        return carried(self._flow, states, times)

    def observed(self, element: int, guard: int, z: Any) -> tuple[Any, Any]:
        """Value of guard number `guard` of an element at state `z`, and its derivative (D,)."""
        row = self.machine.watched(self.mode, element, guard)
        return row @ z, row

    def gap_of(self, element: int, z: Any) -> tuple[Any, Any]:
        """Gap of a stop at state `z`, and its derivative (D,)."""
        row = self.machine.gap(element)
        return row @ z, row

    def rate_of(self, element: int, z: Any) -> tuple[Any, Any]:
        """Rate of the gap of a stop at state `z`, and its derivative (D,)."""
        row = self.machine.rate(element)
        return z @ row, row

    def rubs(self, guard: Any, z: Any) -> list[int] | None:  # noqa: ARG002
        """Friction elements at an impact; None if the masses do not determine their effect."""
        return None if guard.ambiguous else [part.element for part in guard.scrapes]

    def kick(self, element: int, z: Any, rubs: Rubs = ()) -> Any:  # noqa: ARG002
        """Change (D,) of a state by an impulse that changes the rate of a gap by one."""
        return self.machine.kick(self.mode, element, rubs)

    def takes(self, friction: int, z: Any) -> float:  # noqa: ARG002
        """Largest change of a slip velocity by an impact, over the change of the gap's rate."""
        return float(self.machine.takes(self.mode, friction).real)

    def stopped(self, rubs: Rubs, z: Any) -> tuple[Any, Any]:
        """The state (D,) without the slips that an impact stops; derivative (D, D) by `z`."""
        matrix = self.machine.stopped(self.mode, rubs)
        return matrix @ z, matrix.real

    def begun(self, event: Happening, z: Any) -> tuple[Any, Any]:
        """The state (D,) with which the mode begins after an event, and derivative (D, D) by `z`.

        Relative velocities of elements that begin to hold or to stick become zero. If a chatter
        follows, positions are moved so that the gap is zero instead.
        """
        put = self.machine.put_on(event.element)
        matrix = put if event.chatters else self.machine.caught(event.mode, self.mode)
        return matrix @ z, matrix.real

    def force(self, element: int, state: Array) -> tuple[float, float]:
        """Constraint force of an element that holds, and its rate."""
        row = self.force_row(element, state)
        return float((row @ state).real), float((row @ self._flow @ state).real)

    def force_row(self, element: int, state: Any) -> Any:  # noqa: ARG002
        """Derivative (D,) of the constraint force of an element that holds."""
        return self.machine.force(self.mode, element)


@final
class TaylorFlights:
    """Flights by Taylor's method.

    Parameters
    ----------
    oscillator : ImpactMap
    machine : Machine
        Machine of the oscillator, with imaginary changes of its numbers if `changes` are given.
    mode : Regimes
    changes : (j,), optional
        Changes of the numbers of flights in this mode.
    """

    def __init__(
        self, oscillator: Any, machine: Machine, mode: Regimes, changes: Array | None = None
    ) -> None:
        self.mode: TaylorMode = oscillator._automaton.mode(mode.numbers)
        self._oscillator, self.machine, self._regimes = oscillator, machine, mode
        self.changes, self._clock = changes, oscillator.frequency
        self._n = oscillator.degrees_of_freedom

    def short(self, z: Array) -> Array:
        """The state (2, N + J + 1) of Taylor's method for a whole state (D,)."""
        n = self._n
        x = np.concatenate([z[:n], z[2 * n : -3]])
        return self.mode.state(x, z[n : 2 * n], z[-3], z[-2])

    def whole(self, states: Array) -> Array:
        """The whole states (k, D) for states (k, 2, N + J + 1) of Taylor's method."""
        x, v = self.mode.motion(states)
        parts = x, v, self.mode.sliders(states), states[..., -1], np.ones((len(x), 1))
        return np.concatenate(parts, axis=1)

    def wide(self, rows: Array, z: Array) -> Array:
        """Rows (..., D) from rows (..., 2 N + J + 1) that end with the derivative by the phase."""
        by_phase = rows[..., -1:]
        ends = by_phase * z[-2], -by_phase * z[-3], 0.0 * by_phase
        return np.concatenate([rows[..., :-1], *ends], axis=-1)

    def rate(self, z: Array) -> Array:
        """Rate (D,) of a whole state."""
        (found,) = self.whole(self.mode.rate(self.short(z)[None]))
        return np.append(found[:-1], 0.0)

    def tangent(self, z: Array) -> Array:
        """Derivative (D, D) of the rate of a state by the state."""
        n, out = self._n, np.zeros((len(z), len(z)))
        out[:n, n : 2 * n] = np.eye(n)
        out[n : 2 * n] = self.wide(self.mode.gradients(self.short(z), rates=True), z)
        out[-3, -2], out[-2, -3] = self._clock, -self._clock
        for j, k in enumerate(self.mode.scene.sliders):
            sign = self.mode.scene.elements[k].sign
            if self.mode.regimes[k].anchored:
                out[2 * n + j] = -sign * self.machine.rate(k).real
                out[2 * n + j, n : 2 * n] = 0.0
            else:
                out[2 * n + j, : 2 * n] = sign * self.mode.rate_row(k, self.short(z))[: 2 * n]
        return out

    def path(self, z: Array, lasts: float) -> Path:
        """The flight from a state over a duration."""
        return self.mode.path(self.short(z), max(lasts, 0.0))

    def states(self, z: Array, times: Array) -> Array:
        """States (k, D) at times (k,) after a state `z`."""
        return self.whole(self.path(z, float(times.max(initial=0.0))).states(times))

    def passed(self, z: Array, lasts: float) -> tuple[Array, Array]:
        """The state (D,) after a flight from state `z`, and its derivative (D, D) by `z`.

        Held elements prescribe accelerations only; so the derivative covers changes of `z` that
        violate the constraints.

        Raises
        ------
        Diverged, CannotFollow
        """
        end, flow = self.mode.flow(self.short(z), lasts)
        out = np.eye(len(z))
        out[:-3] = self.wide(flow[:-1], z)
        s, c = math.sin(self._clock * lasts), math.cos(self._clock * lasts)
        out[-3:-1, -3:-1] = [[c, s], [-s, c]]
        return self.whole(end[None])[0], out

    def changed(self, z: Array, lasts: float) -> Array:
        """Change (D,) of the state after a flight, due to the changes of the numbers."""
        out = np.zeros(len(z))
        if self.changes is not None:
            out[:-3] = self.mode.changed(self.short(z), lasts, self.changes)
            turned = math.atan2(z[-3], z[-2]) + self._clock * lasts
            later = lasts * float(self.changes[FREQUENCY])
            out[-3:-1] = later * math.cos(turned), -later * math.sin(turned)
        return out

    def rate_changed(self, z: Array) -> Array:
        """Change (D,) of the rate of a state by changed numbers; the phase's rate is left out."""
        out, n = np.zeros(len(z)), self._n
        if self.changes is not None:
            out[n : 2 * n] = self.mode.gradients(self.short(z), self.changes, rates=True)
            for j, k in enumerate(self.mode.scene.sliders):
                if self.mode.regimes[k].anchored:
                    row = self.mode.scene.elements[k].sign * self.machine.rate(k)
                    out[2 * n + j] = -float((row @ z).imag) / STEP
                elif k in self._scene.curves:
                    along = self._scene.curves[k].gradient(z[:n]) @ z[n : 2 * n]
                    out[2 * n + j] = float(along.imag) / STEP
        return out

    # --- elements, also with imaginary changes of states and numbers ------------------------------

    @property
    def varies(self) -> bool:
        """Whether rows and kicks depend on the state."""
        return not self.mode.constant_kicks

    @cached_property
    def _scene(self) -> Scene:
        """Scene of the mode, with imaginary changes of its numbers."""
        if self.changes is None:
            return self.mode.scene
        return self.mode.scene.changed(STEP * self.changes[FREQUENCY + 1 :])

    def _watch(self, element: int, guard: int) -> Watch:
        regimes = self.mode.scene.elements[element].regimes
        return regimes[self._regimes.numbers[element]].guards[guard]

    def _guard(self, element: int, watch: Watch) -> int:
        """Number of a guard of an element among those of the mode."""
        guards = self.mode.guards
        return next(i for i, (k, own) in enumerate(guards) if k == element and same(own, watch))

    def observed(self, element: int, guard: int, z: Any) -> tuple[Any, Any]:
        """Value of guard number `guard` of an element at state `z`, and its derivative (D,)."""
        watch, now = self._watch(element, guard), z.real
        if not watch.force:
            row = self.machine.watched(self._regimes, element, guard)
            weights = self.machine.weights(self._regimes, element, guard)
            return self._along(element, z, row, weights[0] + weights[3], weights[1])
        number, state = self._guard(element, watch), self.short(now)
        value = self.mode.watched(number, state)[0]
        row = self.wide(self.mode.gradient(number, state), now)
        if not np.iscomplexobj(z):
            return value, row
        by = 0.0
        if self.changes is not None:
            by = self.mode.gradients(state, self.changes, rates=False)[number]
        return value + 1j * (row @ z.imag + STEP * by), row

    def seen(self, element: int, guard: int, states: Array) -> tuple[Array, Array]:
        """Values of a guard at states (n, D), and derivatives (n, D), or (D,) at the middle one."""
        watch = self._watch(element, guard)
        if not watch.force:
            return self.observed(element, guard, states)
        number = self._guard(element, watch)
        values = [self.mode.watched(number, self.short(z))[0] for z in states]
        return np.array(values), self.observed(element, guard, states[len(states) // 2])[1]

    def _along(self, k: int, z: Any, row: Any, gap: Any, rate: Any) -> tuple[Any, Any]:
        """Product of a row and states (..., D), plus the terms of a stop's curve; derivative."""
        value = z @ row
        if k in self._scene.curves:
            n, own, sign = self._n, self._scene.curves[k], self.mode.scene.elements[k].sign
            x, v, still = z[..., :n], z[..., n : 2 * n], self.mode.scene.curves[k]
            value = value + sign * (gap * own(x) + rate * (own.gradient(x) * v).sum(axis=-1))
            row, along = np.broadcast_to(row, z.shape).copy(), sign * still.gradient(x.real)
            bend = sign * still.bend(x.real, v.real)
            row[..., :n] += gap.real * along + rate.real * bend
            row[..., n : 2 * n] += rate.real * along
        return value, row

    def gap_of(self, element: int, z: Any) -> tuple[Any, Any]:
        """Gap of a stop at state `z`, and its derivative (D,)."""
        return self._along(element, z, self.machine.gap(element), 1.0, 0.0)

    def rate_of(self, element: int, z: Any) -> tuple[Any, Any]:
        """Rate of the gap of a stop at state `z`, and its derivative (D,)."""
        return self._along(element, z, self.machine.rate(element), 0.0, 1.0)

    def rubs(self, guard: Any, z: Any) -> list[int] | None:
        """Friction elements at an impact; None if the masses do not determine their effect."""
        automaton, where = self._oscillator._automaton, (z[: self._n], _phase(z))
        ambiguous = guard.ambiguous or (self.varies and automaton.outcome(guard, *where)[1])
        return None if ambiguous else [part.element for part in automaton.scrapes(guard, *where)]

    def kick(self, element: int, z: Any, rubs: Rubs = ()) -> Any:
        """Change (D,) of a state by an impulse that changes the rate of a gap by one."""
        if not self.varies:
            return self.machine.kick(self._regimes, element, rubs)
        pulls = [(k, way * self.machine.coefficient(k)) for k, way in rubs if way]
        kick = self.mode.kick_in(self._scene, element, z[: self._n], _phase(z), pulls)
        out = np.zeros(len(z), dtype=kick.dtype)
        out[self._n : 2 * self._n] = kick
        return out

    def takes(self, friction: int, z: Any) -> float:
        """Largest change of a slip velocity by an impact, over the change of the gap's rate."""
        now = z.real
        return float(self.mode.takes(friction, now[: self._n], _phase(now)))

    def stopped(self, rubs: Rubs, z: Any) -> tuple[Any, Any]:
        """The state (D,) without the slips that an impact stops; derivative (D, D) by `z`."""
        if not self.varies:
            matrix = self.machine.stopped(self._regimes, rubs)
            return matrix @ z, matrix.real

        def moved(there: Any) -> Any:
            lost = [self.kick(k, there) * self.rate_of(k, there)[0] for k, way in rubs if not way]
            return there - sum(lost)

        return moved(z), _derivative(moved, z)

    def turned(self, element: int, z: Array, rubs: Rubs = ()) -> Array:
        """Derivative (D, D) of a kick by the state."""
        n, rows, out = self._n, np.zeros((self._n, len(z) - 2)), np.zeros((len(z), len(z)))
        pulls = [(k, way * float(self.machine.coefficient(k).real)) for k, way in rubs if way]
        by_place = self.mode.kick_by_place(element, z[:n], _phase(z), pulls)
        rows[:, :n], rows[:, -1] = by_place[:, :n], by_place[:, n]
        out[n : 2 * n] = self.wide(rows, z)
        return out

    def begun(self, event: Happening, z: Any) -> tuple[Any, Any]:
        """The state (D,) with which the mode begins after an event, and derivative (D, D) by `z`.

        Relative velocities of elements that begin to hold or to stick become zero. If a chatter
        follows, positions are moved so that the gap is zero instead.
        """
        if not self.varies:
            put = self.machine.put_on(event.element)
            matrix = put if event.chatters else self.machine.caught(event.mode, self._regimes)
            return matrix @ z, matrix.real
        caught = not event.chatters and bool(set(self._regimes.held) - set(event.mode.held))
        if not (event.chatters or caught or self._bends):
            slid = self.machine.slid(self._regimes)
            return slid @ z, slid.real

        def moved(there: Any) -> Any:
            if event.chatters:
                return self._put(event.element, there)
            return self._slid(self._caught(there) if caught else there)

        return moved(z), _derivative(moved, z)

    def _put(self, k: int, z: Any) -> Any:
        """Move the positions along the gradient of a gap so that it is zero."""
        if k not in self._scene.curves:
            return self.machine.put_on(k) @ z
        function, x = self._scene.curves[k], z[: self._n]
        put, way = x.real.copy(), function.gradient(x)
        rest = self.mode.scene.elements[k].sign * (self.machine.gap(k) @ z)
        self._oscillator._contacts[k].put(put, -float(rest.real))
        there = x + way * float((put - x.real) @ way.real / (way.real @ way.real))
        left, slope = function(there) + rest, function.gradient(there) @ way
        moved = there - way * (1j * (left / slope).imag)
        return np.concatenate([put + (1j * moved.imag if moved.imag.any() else 0.0), z[self._n :]])

    def _caught(self, z: Any) -> Any:
        """Make the relative velocities of held elements zero, by impulses along all of them."""
        n, held, elements = self._n, list(self._regimes.held), self.mode.scene.elements
        mass, rows = self._scene.inertia(z[:n], _phase(z))
        rates = np.array([elements[k].sign * self.rate_of(k, z)[0] for k in held])
        slips = self.machine.slips(self._regimes, rows)
        response = np.linalg.solve(mass, pushes(rows[held], slips))
        lost = response @ np.linalg.solve(rows[held] @ response, rates)
        return np.concatenate([z[:n], z[n : 2 * n] - lost, z[2 * n :]])

    @cached_property
    def _bends(self) -> list[tuple[int, int]]:
        """Sliders that slip along functions, with their indices in a whole state."""
        scene, first = self.mode.scene, 2 * self._n
        pairs = ((k, first + j) for j, k in enumerate(scene.sliders) if k in scene.curves)
        return [(k, place) for k, place in pairs if not self.mode.regimes[k].anchored]

    def _slid(self, z: Any) -> Any:
        """Put each slider that slips where its spring balances the friction."""
        out = self.machine.slid(self._regimes) @ z
        for k, place in self._bends:
            along = self._scene.curves[k](z[: self._n])
            out = out.astype(np.result_type(out, along))
            out[place] += along
        return out

    # --- in a chatter -----------------------------------------------------------------------------

    def rates(self, states: Array) -> Array:
        """Rates (n, D) of states (n, D)."""
        return np.array([self.rate(z) for z in states]).reshape(states.shape)

    def bends(self, element: int, states: Array) -> tuple[Array, Array]:
        """Second and third derivatives (n,) of a gap by time, at states (n, D)."""
        found = [self.mode.series(element, self.short(z))[0] for z in states]
        series = np.array(found).reshape(len(states), -1)
        return 2.0 * series[:, 2], 6.0 * series[:, 3]

    def lifted(self, states: Array, times: Array) -> tuple[Array, Array]:
        """Derivatives minus identity (n, D, D) of short flights, and states (n, D) after them.

        For short flights they are Magnus' series from two Gauss points, so that nothing cancels.
        """
        out = np.empty((len(states), *2 * states.shape[1:]))
        for i, (z, lasts) in enumerate(zip(states, times.tolist(), strict=True)):
            own = self.tangent(z)
            if abs(own).sum(axis=1).max() * lasts > _SHORT:
                out[i] = self.passed(z, lasts)[1] - np.eye(len(z))
                continue
            places = lasts * _GAUSS
            a, b = (self.tangent(there) for there in self.whole(self.path(z, lasts).states(places)))
            turned = math.sqrt(3.0) / 12.0 * lasts * (b @ a - a @ b)
            (out[i],) = lifted(0.5 * (a + b) + turned, np.array([lasts]))
        ends = [self.states(*pair) for pair in zip(states, times[:, None], strict=True)]
        return out, np.concatenate(ends)

    def carried(self, states: Array, times: Array) -> Array:
        """Changes (n, D) of states (n, D) after short flights, due to changes of the numbers."""
        found = [self.changed(*pair) for pair in zip(states, times, strict=True)]
        return np.array(found).reshape(states.shape)

    def rolled(self, element: int, states: Array, times: Array) -> tuple[Array, Array]:
        """Changes along flights: of the gradient of a gap, (n, D), and of its change by numbers.

        The latter, (n,), is the change of the function of the coordinates along which the stop
        acts; without a function both are zero. For short flights they are integrals of rates, so
        that nothing cancels.
        """
        rows, gaps = np.zeros(states.shape), np.zeros(len(states))
        if element not in self._scene.curves:
            return rows, gaps
        n, sign = self._n, self.mode.scene.elements[element].sign
        own, still = self._scene.curves[element], self.mode.scene.curves[element]
        for i, (z, lasts) in enumerate(zip(states, times.tolist(), strict=True)):
            brief = abs(self.tangent(z)).sum(axis=1).max() * lasts <= _SHORT
            places = lasts * (_GAUSS if brief else np.array([0.0, 1.0]))
            x, v = np.split(self.whole(self.path(z, lasts).states(places))[:, : 2 * n], 2, axis=1)
            weights = np.array([0.5, 0.5]) * lasts if brief else np.array([-1.0, 1.0])
            turned = still.bend(x, v) if brief else still.gradient(x)
            rows[i, :n] = sign * (weights @ turned)
            if self.changes is not None:
                seen = [own.gradient(a) @ b if brief else own(a) for a, b in zip(x, v, strict=True)]
                gaps[i] = sign * (weights @ np.array(seen).imag) / STEP
        return rows, gaps

    def force(self, element: int, state: Array) -> tuple[float, float]:
        """Constraint force of an element that holds, and its rate."""
        force = self.mode.balance(self.short(state))[1][element]
        return float(force), float(self.force_row(element, state) @ self.rate(state))

    def force_row(self, element: int, state: Array) -> Array:
        """Derivative (D,) of the constraint force of an element that holds."""
        guards = enumerate(self.mode.guards)
        number, watch = next((i, w) for i, (k, w) in guards if k == element and w.force)
        found = self.mode.gradients(self.short(state), rates=False)[number] / watch.force
        return self.wide(found, state)


Flights = LinearFlights | TaylorFlights


def laid(flights: Flights, closed: Sequence[int], z: Any) -> tuple[Any, Any]:
    """Move a state (D,) so that gaps and their rates are zero; with derivative (D, D) by `z`.

    For stops along functions this is one step of Newton's method, exact for states on the stops.
    """
    n, by = flights.machine.size, np.eye(len(z))
    for begin, seen in ((0, flights.gap_of), (n, flights.rate_of)) if closed else ():
        gaps, rows = map(np.array, zip(*(seen(k, z) for k in closed), strict=True))
        away = np.zeros((len(z), len(closed)))
        away[begin : begin + n] = np.linalg.pinv(rows[:, begin : begin + n].real)
        z, by = z - away @ gaps, by - away @ (rows.real @ by)
    return z, by


def _derivative(moved: Callable[[Any], Any], z: Any) -> Array:
    """Derivative (D, D) of a function of states, by complex steps."""
    here = moved(z.real + 0j)
    there = [moved(z.real + 1j * STEP * unit) for unit in np.eye(len(z))[:-1]]
    by = (np.array(there) - here).imag.T / STEP
    return np.column_stack([by, np.eye(len(z))[-1]])


def _phase(z: Any) -> Any:
    """Phase of a state (D,), with its imaginary change."""
    (s, c), phase = z[-3:-1].real, math.atan2(*z[-3:-1].real)
    if not np.iscomplexobj(z):
        return phase
    return phase + 1j * float(c * z[-3].imag - s * z[-2].imag) / float(s * s + c * c)


def same(a: Any, b: Any) -> bool:
    """Whether two guards of a regime are the same; levels of friction may differ."""
    pairs = ((getattr(a, n), getattr(b, n)) for n in ("to", "gap", "rate", "force", "stretch"))
    return all(one == two for one, two in pairs)


def number_of(guards: Sequence[Any], watch: Any) -> int:
    """Number of the guard among the guards of a regime."""
    return next(k for k, own in enumerate(guards) if same(own, watch))


def flights_of(
    oscillator: Any,
    machine: Machine,
    mode: Regimes,
    measures: Array | None = None,
    changes: Array | None = None,
) -> Flights:
    """The flights of an oscillator in one mode; see `LinearFlights` and `TaylorFlights`."""
    if oscillator._motion is not None:
        return TaylorFlights(oscillator, machine, mode, changes)
    units = np.ones(2 * machine.size + len(machine.sliders) + 3) if measures is None else measures
    return LinearFlights(machine, mode, units)
