"""Guards during a flight by Taylor's method, which are never negative."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, final

import numpy as np

from dynkit.core.kept import cached_property, kept
from dynkit.core.validation import Array
from dynkit.systems.impact.modes.taylor.equations import WATCHED

ROUNDING = 2.0**-44
"""Rounding error of a sum, relative to the sum of its absolute terms."""

_BACK = 0.5 ** np.arange(40)
"""Parts of a step before its end at which the depth of a guard is evaluated."""


@final
class Signs:
    """Signs of the guards of a `Chart` at the end of a flight.

    Guards that depend on gaps, rates and stretches alone are affine functions of the state of the
    integrator. Those with forces, and all rounding errors, are evaluated by the mode.
    """

    def __init__(self, chart: Any) -> None:
        self._chart, self._state = chart, chart.integrator.state
        plan, self._half = chart.plan, len(chart.to_x) + len(chart._more)
        end = plan.size
        self._watches = chart._pars[end - WATCHED * len(plan.guards) : end].reshape(-1, WATCHED)
        self._careful = plan.careful
        affine = (self._watches[:, [2, 5]] == 0.0).all(axis=1)
        self._known: list[int] = np.flatnonzero(affine).tolist()
        self._forces: list[int] = np.flatnonzero(~affine).tolist()
        self._places = {i: n for n, i in enumerate(self._known)}
        self._impacts = [self._places[i] for i in plan.impacts]

    @cached_property
    def _lines(self) -> tuple[Array, Array]:
        """Guards (m,) as affine functions of the integrator's state: (m, M) and (m,)."""
        rows, starts = np.zeros((len(self._known), len(self._state))), np.empty(len(self._known))
        for n, i in enumerate(self._known):
            k, (gap, rate, _, level, stretch, _) = self._chart.plan.guards[i], self._watches[i]
            starts[n] = level
            if stretch:
                rows[n, self._chart.springs[k]] += stretch
            for part, known, value in ((0, self._chart.places, gap), (1, self._chart.speeds, rate)):
                if value and k in known:
                    rows[n, part * self._half + known[k]] += value
                elif value:
                    row, start = self._line(k, part)
                    rows[n] += value * row
                    starts[n] += value * start
        return rows, starts

    @kept
    def _line(self, k: int, part: int) -> tuple[Array, float]:
        """A gap (part 0) or its rate (1) that is no coordinate: its element acts along a row."""
        unit = np.vstack([0.0 * self._state, np.eye(len(self._state))])
        values = np.array([self._chart.scene.gap(k, *self._motion(state))[part] for state in unit])
        return values[1:] - values[0], float(values[0])

    def _motion(self, state: Array) -> tuple[Array, Array, float, float]:
        """Positions and velocities (N,), sine and cosine, of a state of the integrator."""
        turn = state[2 * self._half :].tolist() or (0.0, 0.0)
        x, v = self._chart.motion(state[: 2 * self._half], *turn)
        return x[: len(v)], v, *turn

    def _watched(self, which: Sequence[int], z: Array, sine: float, cosine: float) -> Any:
        """Value and rounding error of each of some guards at coordinates (M,)."""
        numbers = [self._chart._events[i] for i in which]
        return self._chart.watched(numbers, *self._chart.motion(z, sine, cosine), sine, cosine)

    def _least(self, i: int, z: Array, sine: float, cosine: float, band: float = 0.0) -> float:
        """A guard above this is zero by rounding, or as it was at coordinates (M,).

        `band` is its rounding error elsewhere.
        """
        ((value, error),) = self._watched([i], z, sine, cosine)
        return float(2.0 * min(-error, -band, value))

    def _fall(self, which: Sequence[int], z: Array, sine: float, cosine: float) -> bool:
        """Whether some guards are negative at the end of a flight, by more than rounding errors."""
        angle = float(self._chart._pars[1]) * float(self._chart.integrator.time)
        s, c = math.sin(angle), math.cos(angle)
        turn = sine * c + cosine * s, cosine * c - sine * s
        ends = self._watched(which, self._state[: 2 * self._half], *turn)
        return any(
            value < -band and value < self._least(i, z, sine, cosine, band)
            for i, (value, band) in zip(which, ends, strict=True)
        )

    def amiss(self, z: Array, sine: float, cosine: float, hit: int = -1) -> bool:
        """Whether an event was missed in a flight from coordinates (M,) that ends at a guard.

        If the chart is not careful, this may be due to rounding errors.
        """
        rows, starts = self._lines
        values = rows @ self._state + starts
        if hit in self._places:
            values[self._places[hit]] = 0.0
        impact = hit in self._chart.plan.impacts
        if impact and not self._careful and not self._rate(self._chart.plan.guards[hit]) < 0.0:
            return True
        negative = np.flatnonzero(values < 0.0).tolist()
        if not self._careful and not set(negative).isdisjoint(self._impacts):
            return True
        tested = [self._known[n] for n in negative] + [i for i in self._forces if i != hit]
        return bool(tested) and self._fall(tested, z, sine, cosine)

    def _rate(self, k: int) -> float:
        """Rate of a gap."""
        if k in self._chart.speeds:
            return float(self._state[self._half + self._chart.speeds[k]])
        row, start = self._line(k, 1)
        return float(row @ self._state) + start

    def rises(self, number: int, z: Array, sine: float, cosine: float) -> bool:
        """Whether a guard that becomes positive was negative by more than rounding errors.

        The integrator has the Taylor coefficients of the last step.
        """
        made, n = self._chart.integrator, self._impacts[number]
        times = float(made.last_h) * (1.0 - _BACK)
        powers = times ** np.arange(made.tc.shape[1])[:, None]
        values = self._lines[0][n] @ (made.tc @ powers) + self._lines[1][n]
        return bool(values.min() < self._least(self._known[n], z, sine, cosine))
