"""Flights in one mode: rates of states, and what short flights make of changes of the state."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, final

import numpy as np

from dynkit.core.no_motion import CannotFollow, Diverged
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.modes.taylor_mode import FREQUENCY, Path, TaylorMode
from dynkit.systems.impact.orbits.machine import STEP, Machine, Regimes, lifted, moved

_SHORT = 1e-3
"""Of the time in which a state changes by itself: derivatives of shorter flights are series."""


@final
class LinearFlights:
    """Those of a machine, whose numbers may have imaginary changes; measures as of a solution."""

    def __init__(self, machine: Machine, mode: Regimes, measures: Array) -> None:
        self.machine, self.mode, self._measures = machine, mode, measures
        self._flow = machine.flow(mode)

    def passed(self, z: Array, lasts: float) -> tuple[Array, Array]:
        """The state (D,) after a flight from one, and its derivative (D, D) by that."""
        (flown,) = moved(self._flow.real[None], np.array([lasts]), self._measures)
        return flown @ z, flown

    def rates(self, states: Array) -> Array:
        """Rates (n, D) of states (n, D)."""
        return np.asarray(states @ self._flow.real.T)

    def bends(self, row: Array, states: Array) -> tuple[Array, Array]:
        """First and second derivatives (n,) of a row by time."""
        first = row @ self._flow.real
        return states @ first, states @ (first @ self._flow.real)

    def lifted(self, states: Array, times: Array) -> tuple[Array, Array]:
        """Derivatives (n, D, D) less 1 of short flights, and changes (n, D) by those of numbers."""
        flown = lifted(self._flow, times)
        return flown.real, (flown.imag / STEP @ states[:, :, None])[..., 0]

    def watched(self, element: int, guard: int, z: Array) -> float:
        """What an element watches at a state: guard number `guard` of its regime."""
        return float(self.machine.watched(self.mode, element, guard) @ z)

    def force(self, element: int, state: Array) -> tuple[float, float]:
        """Force by which an element holds, and its rate."""
        row = self.machine.force(self.mode, element)
        return float((row @ state).real), float((row @ self._flow @ state).real)


@final
class TaylorFlights:
    """Those of Taylor's method.

    Parameters
    ----------
    oscillator : ImpactMap
    mode : Regimes
    changes : (j,), optional
        Changes of the numbers of flights.
    """

    def __init__(self, oscillator: Any, mode: Regimes, changes: Array | None = None) -> None:
        self.mode: TaylorMode = oscillator._automaton.mode(mode.numbers)
        self._regimes = mode
        self.changes, self._clock = changes, oscillator.frequency
        self._n = oscillator.degrees_of_freedom

    def short(self, z: Array) -> Array:
        """A state (2, N + 1) of a whole state (D,)."""
        x, v = z[:-3].reshape(2, -1)
        return np.stack([np.append(x, z[-3]), np.append(v, z[-2])])

    def whole(self, states: Array) -> Array:
        """Whole states (k, D) of states (k, 2, N + 1)."""
        x, v = states[:, 0, :-1], states[:, 1, :-1]
        return np.concatenate([x, v, states[..., -1], np.ones((len(x), 1))], axis=1)

    def wide(self, rows: Array, z: Array) -> Array:
        """Rows (..., D) of rows (..., 2N + 1) that end with derivatives by the phase of a state."""
        by_phase = rows[..., -1:]
        ends = by_phase * z[-2], -by_phase * z[-3], 0.0 * by_phase
        return np.concatenate([rows[..., :-1], *ends], axis=-1)

    def rate(self, z: Array) -> Array:
        """Rate (D,) of a state."""
        (found,) = self.mode.rate(self.short(z)[None])
        return np.concatenate([*found[:, :-1], found[:, -1], [0.0]])

    def tangent(self, z: Array) -> Array:
        """Derivative (D, D) of the rate of a state by it."""
        n, out = self._n, np.zeros((len(z), len(z)))
        out[:n, n : 2 * n] = np.eye(n)
        out[n : 2 * n] = self.wide(self.mode.gradients(self.short(z), rates=True), z)
        out[-3, -2], out[-2, -3] = self._clock, -self._clock
        return out

    def path(self, z: Array, lasts: float) -> Path:
        """The flight from a state over a duration."""
        return self.mode.path(self.short(z), max(lasts, 0.0))

    def passed(self, z: Array, lasts: float) -> tuple[Array, Array]:
        """The state (D,) after a flight from one, and its derivative (D, D) by that.

        What holds keeps its acceleration; so a change that leaves it is a motion along it.

        Raises
        ------
        NoSolution
            When it cannot be followed.
        """
        try:
            end, flow = self.mode.flow(self.short(z), lasts)
        except (Diverged, CannotFollow) as refusal:
            raise NoSolution(str(refusal)) from refusal
        out = np.eye(len(z))
        out[: 2 * self._n] = self.wide(flow[:-1], z)
        s, c = math.sin(self._clock * lasts), math.cos(self._clock * lasts)
        out[-3:-1, -3:-1] = [[c, s], [-s, c]]
        return self.whole(end[None])[0], out

    def changed(self, z: Array, lasts: float) -> Array:
        """Change (D,) of the state after a flight by the changes of numbers."""
        out = np.zeros(len(z))
        if self.changes is not None:
            out[: 2 * self._n] = self.mode.changed(self.short(z), lasts, self.changes)
            turned = math.atan2(z[-3], z[-2]) + self._clock * lasts
            later = lasts * float(self.changes[FREQUENCY])
            out[-3:-1] = later * math.cos(turned), -later * math.sin(turned)
        return out

    def rate_changed(self, z: Array) -> Array:
        """Change (D,) of the rate of a state by the changes of numbers, but for the frequency's."""
        out, n = np.zeros(len(z)), self._n
        if self.changes is not None:
            out[n : 2 * n] = self.mode.gradients(self.short(z), self.changes, rates=True)
        return out

    def guard(self, element: int, guard: int) -> int:
        """Number of a guard among those of the mode, by its number in its element's regime."""
        own = self.mode.scene.elements[element].regimes[self._regimes.numbers[element]].guards
        guards = self.mode.guards
        found = (k == element and number_of(own, watch) == guard for k, watch in guards)
        return list(found).index(True)

    def watched(self, element: int, guard: int, z: Array) -> float:
        """What an element watches at a state: guard number `guard` of its regime."""
        return self.mode.watched(self.guard(element, guard), self.short(z))[0]

    # --- in a chatter -----------------------------------------------------------------------------

    def rates(self, states: Array) -> Array:
        """Rates (n, D) of states (n, D)."""
        return np.array([self.rate(z) for z in states]).reshape(states.shape)

    def bends(self, row: Array, states: Array) -> tuple[Array, Array]:
        """First and second derivatives (n,) of a row by time."""
        rates = self.rates(states)
        pairs = zip(states, rates, strict=True)
        return rates @ row, np.array([row @ self.tangent(z) @ rate for z, rate in pairs])

    def lifted(self, states: Array, times: Array) -> tuple[Array, Array]:
        """Derivatives (n, D, D) less 1 of short flights, and changes (n, D) by those of numbers.

        From the begin and the end of short ones by Magnus' series, so that nothing cancels.
        """
        out = np.empty((len(states), *2 * states.shape[1:]))
        added = np.array([self.changed(*pair) for pair in zip(states, times, strict=True)])
        for i, (z, lasts) in enumerate(zip(states, times.tolist(), strict=True)):
            own = self.tangent(z)
            if abs(own).sum(axis=1).max() * lasts > _SHORT:
                out[i] = self.passed(z, lasts)[1] - np.eye(len(z))
                continue
            places = lasts * (0.5 + np.array([-0.5, 0.5]) / math.sqrt(3.0))
            a, b = (self.tangent(there) for there in self.whole(self.path(z, lasts).states(places)))
            turned = math.sqrt(3.0) / 12.0 * lasts * (b @ a - a @ b)
            (out[i],) = lifted(0.5 * (a + b) + turned, np.array([lasts]))
        return out, added.reshape(states.shape)

    def force(self, element: int, state: Array) -> tuple[float, float]:
        """Force by which an element holds, and its rate."""
        guards = enumerate(self.mode.guards)
        number, watch = next((i, w) for i, (k, w) in guards if k == element and w.force)
        row = self.wide(self.mode.gradients(self.short(state), rates=False)[number], state)
        force = self.mode.balance(self.short(state))[1][element]
        return float(force), float(row @ self.rate(state)) / watch.force


Flights = LinearFlights | TaylorFlights


def number_of(guards: Sequence[Any], watch: Any) -> int:
    """Which of the guards of a regime it is: what it does may depend on what others hold."""
    own = watch.to, watch.gap, watch.rate, watch.force, watch.level
    return [(w.to, w.gap, w.rate, w.force, w.level) for w in guards].index(own)


def flights_of(oscillator: Any, machine: Machine, mode: Regimes) -> Flights:
    """The flights of an oscillator in one mode."""
    linear = oscillator._motion is None
    measures = np.ones(len(machine.flow(mode)))
    return LinearFlights(machine, mode, measures) if linear else TaylorFlights(oscillator, mode)
