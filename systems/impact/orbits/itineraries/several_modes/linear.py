"""Motions through several linear modes: flights are matrix exponentials."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from dynkit.core.differences import STEP
from dynkit.core.kept import cached_property, kept
from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.exponentials import (
    changed,
    exponentials,
    gained,
    moved,
)
from dynkit.systems.impact.orbits.flights import Curve
from dynkit.systems.impact.orbits.itineraries.several_modes.shooting import ShootingSolution
from dynkit.systems.impact.orbits.machine import Numbers

_ROUNDING = 2.0**-52


@final
class LinearSolution(ShootingSolution):
    """The motion of an itinerary where flights are linear."""

    @cached_property
    def flows(self) -> Any:
        """State matrices A (n, D, D) of the modes that follow the events, and their chatters."""
        return np.array([self.machine.flow(event.mode) for event in self.following])

    @cached_property
    def _ahead(self) -> Any:
        """exp(A t), (D, D), of the flights without a chatter before, by the numbers of events."""
        own = [i for i, event in enumerate(self.itinerary) if not event.chatters]
        flown = moved(self.flows[own], self.durations[own], self.measures)
        return dict(zip(own, flown, strict=True))

    def _flight(self, i: int, z: Any, lasts: Any) -> tuple[Any, Any]:
        if self._still is not None or self.itinerary[i].chatters:
            return super()._flight(i, z, lasts)
        return self._ahead[i] @ z, self._ahead[i]

    @cached_property
    def _gained(self) -> Array:
        assert self._still is not None
        out, d = np.zeros((self.events, len(self.measures))), self.dimension
        # phases are unknowns: a change of the frequency matters only if it acts on the state
        acting = self.flows[:, :d].imag.any(axis=2) | self.flows[:, :d, d:-1].any(axis=2)
        own = np.flatnonzero(acting.any(axis=1)).tolist()
        begun = np.array([self._still.begun(i) for i in own]).reshape(-1, len(self.measures))
        lasts = self.durations.real[own] - [self._still._late(i) for i in own]
        out[own] = gained(self.flows[own], begun, lasts, self.measures)
        return out

    def acceleration(self, i: int) -> tuple[float, float]:
        k = self.hits[i]
        row = self.machine.rate(int(self.sides[i])) @ self.flows[k]
        return float(row @ self.after[k]), 64.0 * _ROUNDING * float(abs(row) @ abs(self.after[k]))

    def _curve(self, i: int, element: int, guard: int) -> Curve:
        mode = self.following[i].mode
        row, flow = self.machine.watched(mode, element, guard), self.flows[i]
        lasts, rate = float(self.durations[i]) - self._late(i), row @ flow
        rows = np.stack([row, rate, rate @ flow])

        def values(times: Array, orders: int) -> Array:
            return np.asarray(rows[:orders] @ self._through(i, times).T)

        ends = np.maximum(abs(self.begun(i)), abs(self.reached[i]))
        sizes = float(abs(rows[0]) @ ends), float(abs(rows[2]) @ ends)
        return Curve(values, lasts, sizes)

    @kept
    def _through(self, i: int, times: Array) -> Array:
        """States (k, D) at times (k,) after event `i`, or its chatter; all guards share them."""
        states: Array = self._modes[i].states(self.begun(i), times)
        return states

    # --- divided differences ----------------------------------------------------------------------

    def quotient(self, j: int, i: int, q: int) -> Any:
        return self._rows(j, i, q)[q] @ (np.linalg.matrix_power(self.flows[j], q) @ self.after[j])

    def quotient_change(self, j: int, i: int, q: int) -> tuple[Any, float]:
        rows, flow = self._rows(j, i, q + 1), self.flows[j]
        power = np.linalg.matrix_power(flow, q)
        late = (rows[q] - q * rows[q + 1]) @ (flow @ (power @ self.after[j]))
        return rows[q] @ power, float(late)

    def quotient_rounding(self, j: int, i: int, q: int) -> float:
        sizes = abs(self.after[j])
        for _ in range(q):
            sizes = abs(self.flows[j]) @ sizes
        level = float(abs(self._rows(j, i, q)[q]) @ sizes)
        return _ROUNDING * (4.0 + float(self.norms[j])) * level

    @cached_property
    def _risen(self) -> tuple[Any, Any]:
        """exp(A t) - 1, (n, D, D), of all flights, and products (n, D) with their first states."""
        if self._still is None:
            found = changed(self.flows, self.durations, self.measures)
            return found, (found @ self.after[:, :, None])[..., 0]
        found, risen = self._still._risen
        more = (found @ self.after.imag[:, :, None])[..., 0] / STEP + self._gained
        more += self._still.moving * self.durations.imag[:, None] / STEP
        more[:, self.dimension :] = 0.0  # phases do not change: they are unknowns
        return found, risen + 1j * STEP * more

    def rise(self, j: int, i: int) -> Any:
        if j in self.chatters:
            return self.guards[i] @ (self.reached[j] - self.after[j])
        return self.guards[i] @ self._risen[1][j]

    def rise_change(self, j: int, i: int) -> Any:
        if j in self.chatters:
            return self.guards[i] @ self.transitions[j] - self.guards[i]
        return self.guards[i] @ self._risen[0][j]

    def _rows(self, j: int, i: int, most: int) -> list[Any]:
        """Rows h, h phi_1(A t), ..., h phi_most(A t), with the flight A t after event `j`.

        The row h is the guard of event `i`. phi_0 is the exponential function, and
        x phi_k+1(x) = phi_k(x) - 1/k!.
        """
        row = self.guards[i]
        m, d = self.measures, len(row)
        big = np.zeros((most + d, most + d), dtype=np.result_type(row, self.flows, self.durations))
        big[: most - 1, 1:most] = np.eye(most - 1)
        big[most:, most:] = self.flows[j] * m / m[:, None] * self.durations[j]
        # entries far above the others would cause rounding errors
        unit = max(1.0, float(abs(row) @ m) / max(1.0, float(abs(big).max())))
        big[most - 1, most:] = row * m / unit
        found = exponentials(big[None])[0, :most, most:] / m * unit
        return [row, *found[::-1]]

    @cached_property
    def rounded(self) -> Array:
        ends = np.maximum(abs(self.after), abs(self.reached))[:, :, None]
        rough = np.array([self.machine.roughness(event.mode) for event in self.following])
        grown = (abs(self._flown) @ (rough @ ends))[:, :, 0]
        grown *= 2.0 * _ROUNDING * abs(self.durations)[:, None]
        return np.asarray(super().rounded + grown)

    @property
    def norms(self) -> Array:
        scaled = abs(self.flows) * self.measures / self.measures[:, None]
        return np.asarray(scaled.sum(axis=1).max(axis=1) * abs(self.durations))

    # --- the motion -------------------------------------------------------------------------------

    def change(self, change: tuple[Array, Numbers]) -> Array | None:
        """Derivative (m,) of the residual by a change of all numbers."""
        scene = self.scene._replace(machine=self.machine.changed(self.oscillator, change))
        given = self.course, self.lap, self.pairs, self.driven, self
        there = LinearSolution(scene, *given)
        with np.errstate(all="ignore"):
            return np.asarray(there.left.imag / STEP)
