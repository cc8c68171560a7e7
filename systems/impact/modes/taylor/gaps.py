"""Gaps of stops in flight during a flight by Taylor's method: they are never negative."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.validation import Array

ROUNDING = 2.0**-44
"""Rounding error of a sum, relative to the sum of its absolute terms."""

_BACK = 0.5 ** np.arange(40)
"""Parts of a step before its end at which the depth of a gap is evaluated."""


@final
class Gaps:
    """Gaps of the stops in flight of a `Chart`, at the state of its integrator.

    Attributes
    ----------
    open : list of (int, int, int, int)
        For each stop in flight, its guard, its number, and the places of its gap and rate in the
        integrator's state; -1 if they are not coordinates.
    """

    def __init__(self, chart: Any) -> None:
        self._chart, self._half = chart, len(chart.to_x) + len(chart._more)
        self._state = chart.integrator.state
        self._now = memoryview(self._state)  # its numbers are read in a third of the time
        self.open, self._careful = [], chart.plan.careful
        for i in chart.plan.impacts:
            k = chart.plan.guards[i]
            carried = k in chart.places
            places = (chart.places[k], self._half + chart.speeds[k]) if carried else (-1, -1)
            self.open.append((i, k, *places))

    @cached_property
    def _lines(self) -> dict[int, tuple[Array, Array]]:
        """Gaps and rates that are no coordinates, as affine functions of the integrator's state.

        Their stops do not act along functions.
        """
        unit, found = np.vstack([0.0 * self._state, np.eye(len(self._state))]), {}
        scene = self._chart.scene
        for _, k, place, _ in self.open:
            if place < 0:
                values = np.array([scene.gap(k, *self._motion(state)) for state in unit])
                found[k] = (values[1:] - values[0]).T.copy(), values[0]
        return found

    def _motion(self, state: Array) -> tuple[Array, Array, float, float]:
        """Positions and velocities (N,), sine and cosine, of a state of the integrator."""
        turn = state[2 * self._half :].tolist() or (0.0, 0.0)
        x, v = self._chart.motion(state[: 2 * self._half], *turn)
        return x[: len(v)], v, *turn

    def _pair(self, k: int, states: Array) -> Array:
        """Gap of a stop in flight and its rate (2, ...), at states (M, ...) of the integrator."""
        if k in self._chart.places:
            found: Array = states[[self._chart.places[k], self._half + self._chart.speeds[k]]]
            return found
        matrix, start = self._lines[k]
        return np.asarray(((matrix @ states).T + start).T)

    def _least(self, k: int, z: Array, sine: float, cosine: float) -> float:
        """A gap above this is zero by rounding, or as it was at coordinates (M,)."""
        begin = np.append(z, (sine, cosine) if len(self._state) > len(z) else ())
        x, *_ = self._motion(begin)
        element, row = self._chart.scene.elements[k], self._chart.scene.rows_at(x)[k]
        size = abs(row) @ abs(x) + abs(element.offset) + element.amplitude
        return 2.0 * min(-ROUNDING * float(size), float(self._pair(k, begin)[0]))

    def amiss(self, z: Array, sine: float, cosine: float, hit: int = -1) -> bool:
        """Whether an impact was missed in a flight from coordinates (M,) that ends at a guard.

        If the chart is not careful, this may be due to rounding errors.
        """
        now = self._now
        for i, k, place, speed in self.open:
            if i == hit:
                rate = now[speed] if place >= 0 else self._pair(k, self._state)[1]
                if not (rate < 0.0 or self._careful):
                    return True
                continue
            gap = now[place] if place >= 0 else self._pair(k, self._state)[0]
            if gap < 0.0 and not (self._careful and gap >= self._least(k, z, sine, cosine)):
                return True
        return False

    def rises(self, number: int, z: Array, sine: float, cosine: float) -> bool:
        """Whether a gap that becomes positive was negative by more than rounding errors.

        The integrator has the Taylor coefficients of the last step.
        """
        made, k = self._chart.integrator, self.open[number][1]
        times = float(made.last_h) * (1.0 - _BACK)
        powers = times ** np.arange(made.tc.shape[1])[:, None]
        gaps = self._pair(k, made.tc @ powers)[0]
        return bool(gaps.min() < self._least(k, z, sine, cosine))
