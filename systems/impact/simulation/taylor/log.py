"""The logs of impacts and switches of a run by Taylor's method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.simulation.trajectory import Impacts

if TYPE_CHECKING:
    from dynkit.systems.impact.modes.taylor.chart import Chart
    from dynkit.systems.impact.modes.taylor.mode import TaylorMode


@final
class Log:
    """Impacts of a run, stored in the coordinates of their charts until all are logged."""

    def __init__(self, rows: int, mode: TaylorMode) -> None:
        self._mode, self._count = mode, 0
        scene = mode.scene
        self._z = np.empty((rows, 2 * (mode.size + len(scene.parted) + len(scene.dragged))))
        self._rows: list[tuple[float, float, float, float, int]] = []
        self._charts: list[tuple[int, Chart]] = []

    def note(
        self, time: float, speed: float, guard: int, chart: Chart, z: Array, turn: Any
    ) -> None:
        """Log one impact."""
        i = self._count
        self._z[i] = z
        self._rows.append((time, speed, *turn, guard))
        if not self._charts or self._charts[-1][1] is not chart:
            self._charts.append((i, chart))
        self._count = i + 1

    def impacts(self) -> Impacts:
        """The log with states as positions and velocities."""
        count = self._count
        columns: Any = list(zip(*self._rows, strict=True)) or [()] * 5
        time, speed, *turns = np.array(columns[:4], dtype=float)
        turn, states = np.stack(turns, axis=1), np.empty((count, 2, self._mode.size + 1))
        ends = [i for i, _ in self._charts[1:]] + [count] * bool(self._charts)
        for (begin, chart), end in zip(self._charts, ends, strict=True):
            now = slice(begin, end)
            states[now] = self._mode.state(*chart.motion(self._z[now], *turn[now].T), *turn[now].T)
        guard = np.array(columns[4], dtype=np.intp)
        return Impacts(time, speed, guard, states, np.empty((0, 2)))


_FEW, _ROUNDING = 64, 64.0 * 2.0**-52
"""Smallest number of switches after which repetition is tested, and largest change of a state that
has returned, relative to the largest magnitudes of states."""


def repeats(switches: Sequence[tuple[Any, ...]], count: int, *, phased: bool) -> bool:
    """Whether the last of `count` switches without an impact repeats an earlier one.

    The last switch is compared with switch number 2^k, the largest power of two up to `count`, if
    at least half as many have followed. Item 4 of a switch is its guard, and item 5 the state (2,
    slots), with sine and cosine of the phase in the last slot; `phased` says whether the motion
    depends on the phase.
    """
    if count < _FEW:
        return False
    mark = 1 << (count.bit_length() - 1)  # Brent's search for a cycle
    first, last = switches[mark - count - 1], switches[-1]
    if 2 * count < 3 * mark or first[4] != last[4]:
        return False
    sizes = abs(np.array([switch[5] for switch in switches[mark - count - 1 :]])).max(axis=0)
    sizes[:, :-1] = sizes[:, :-1].max(axis=1, keepdims=True)
    change = abs(last[5] - first[5])
    if not phased:
        change[:, -1] = 0.0
    return bool((change <= _ROUNDING * sizes).all())
