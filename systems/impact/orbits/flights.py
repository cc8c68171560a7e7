"""The gap in the flights of an orbit."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.solution import Solution

LEAST, MOST = 24, 4096
"""Cells of a flight."""

_REFINEMENTS, _CONVERGED = 12, 1e-7


def smallest_minimum(
    curve: Callable[[Array, int], Array], times: Array, values: Array, rounding: float = 0.0
) -> tuple[float, float]:
    """Smallest of the minima of a curve inside an interval, and its time; else infinite and NaN.

    Parameters
    ----------
    curve : callable
        Of times (k,) and a number of orders: values and derivatives (orders, k).
    times, values : (k,), (3, k)
        Ends of equal cells that resolve it, and the curve with its first two derivatives there.
    rounding : float
        What rounding leaves in values: where the rate is zero at first it makes dips of its own.
    """
    gap = values[0]
    inner = np.flatnonzero((gap[1:-1] < gap[:-2]) & (gap[1:-1] <= gap[2:])) + 1
    cells, guesses = _dips(times, values, inner)
    at = np.concatenate([times[inner], guesses])
    if not len(at):
        return math.inf, math.nan
    low = np.concatenate([times[inner - 1], times[cells]])
    high = np.concatenate([times[inner + 1], times[cells + 1]])
    step = times[1] - times[0]
    for _ in range(_REFINEMENTS):
        _, rate, bend = curve(at, 3)
        move = np.where(bend > 0.0, -rate / np.where(bend > 0.0, bend, 1.0), 0.0)
        before = at
        at = np.clip(at + np.clip(move, -step, step), low, high)
        # Newton's method: the next step would be the square of it.
        if abs(at - before).max() <= _CONVERGED * step:
            break
    lowest, _, bend = curve(at, 3)
    # what was taken for a dip may be none
    dips = slice(len(inner), None)
    ends = np.stack([gap[cells], gap[cells + 1]])
    apart = (abs(ends - lowest[dips]) > rounding).all(axis=0)
    none = np.zeros(len(at), dtype=bool)
    none[dips] = ~(apart & (bend > 0.0)[dips] & (low < at)[dips] & (at < high)[dips])
    lowest[none] = math.inf
    k = int(np.argmin(lowest))
    return (float(lowest[k]), float(at[k])) if lowest[k] < math.inf else (math.inf, math.nan)


def _dips(times: Array, values: Array, inner: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
    """Cells (k,) with a minimum that no inner value shows, and guesses (k,) of its time.

    After a weak impact the gap rises, falls and rises again within a cell or two, and it does so
    before one: the rates at the ends of a cell tell, or, where they have the same sign, the
    parabola through them that goes on from the impact's side and is zero twice.
    """
    _, rate, bend = values
    h = times[1] - times[0]
    turned = (rate[:-1] < 0.0) & (rate[1:] > 0.0)
    turned[inner] = turned[inner - 1] = False
    cells = np.flatnonzero(turned)
    part = rate[cells] / (rate[cells] - rate[cells + 1])
    found, guesses = [cells], [times[cells] + h * part]
    for begin, bent, end, forwards in (
        (rate[:-1], bend[:-1], rate[1:], True),
        (-rate[1:], bend[1:], -rate[:-1], False),
    ):
        cells = np.flatnonzero((begin > 0.0) & (bent < 0.0) & (end > 0.0))
        begin, bent, end = begin[cells], bent[cells] * h, end[cells]
        curved = end - begin - bent
        inside = (bent * bent > 4.0 * curved * begin) & (-bent < 2.0 * curved)
        cells, begin, bent, curved = (x[inside] for x in (cells, begin, bent, curved))
        part = (-bent + np.sqrt(bent * bent - 4.0 * curved * begin)) / (2.0 * curved)
        found.append(cells)
        guesses.append(times[cells] + h * part if forwards else times[cells + 1] - h * part)
    return np.concatenate(found), np.concatenate(guesses)


@final
class Flight:
    """The gap of one stop from impact number `start` to the next, number `end`.

    Parameters
    ----------
    solution : Solution
    start : int
        Number of the impact.
    side : int
        Number of the stop.
    """

    def __init__(self, solution: Solution, start: int, side: int) -> None:
        self.solution, self.start, self.side = solution, start, side
        ahead = (solution.phases - solution.phases[start]) % solution.turn
        ahead[start] = solution.turn
        self.end = int(np.argmin(ahead))
        self.lasts = float(ahead[self.end]) / solution.terms.frequency
        t, state = solution.terms, abs(solution.states[start])
        turning = abs(t.drive) * t.frequency ** np.array([0.0, 1.0, 2.0, 6.0])
        self._sizes = solution.motion.bounds(self.lasts) * state
        total = self._sizes.sum(axis=(1, 2)) + turning
        # Cells that resolve whatever is of some size.
        count = 4.0 * self.lasts * math.sqrt(total[2] / total[0]) if total[0] > 0.0 else 0.0
        self._cells = int(min(max(count, LEAST), MOST))
        self._turning = float(turning[3])

    def gap(self, times: Array, orders: int) -> Array:
        """Gap and derivatives (orders, k) at times (k,) after the impact."""
        s, t = self.solution, self.solution.terms
        which = np.zeros(len(times), dtype=np.intp)
        states = s.motion.mode.after(s.states[self.start][None], which, times)
        free = s.motion.rows[:orders] @ states.reshape(len(times), -1).T
        turn = t.drive * np.exp(1j * (s.phases[self.start] + t.frequency * times))
        steady = np.stack([((1j * t.frequency) ** k * turn).imag for k in range(orders)])
        steady[0] += t.rest - t.places[self.side]
        return np.asarray(t.signs[self.side] * (free + steady))

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        """Times, and gap with its first two derivatives (3, k), at the ends of the cells."""
        times = np.linspace(0.0, self.lasts, self._cells + 1)
        return times, self.gap(times, 3)

    @cached_property
    def smallest(self) -> tuple[float, float]:
        """Smallest of the minima of the gap inside, and its time; infinite where there is none."""
        return smallest_minimum(self.gap, *self._nodes, self._rounding)

    @property
    def _rounding(self) -> float:
        return 64.0 * 2.0**-52 * float(self._sizes[0].sum() + abs(self.solution.terms.drive))

    @property
    def surely_closed(self) -> bool:
        """Whether the gap is negative somewhere between the impacts, by more than rounding."""
        return min(self.smallest[0], float(self._nodes[1][0, 1:-1].min())) < -self._rounding

    @cached_property
    def surely_open(self) -> bool:
        """Whether the gap is proved to be positive between the impacts.

        On each cell the quintic Hermite polynomial is wrong by at most h^6/46080 sup |f^(6)|, or by
        2 sup |f| + 2/5 h sup |f'| + h^2/20 sup |f''|, term by term; its Bernstein coefficients have
        to exceed this. At the ends it is wrong in third order only, where the gap is zero in first.
        """
        times, (gap, rate, bend) = self._nodes
        h = float(times[1])
        sizes = self._sizes
        caps = 2.0 * sizes[0] + 0.4 * h * sizes[1] + 0.05 * h * h * sizes[2]
        error = float(np.minimum(sizes[3] * h**6 / 46080.0, caps).sum())
        error += self._turning * h**6 / 46080.0
        error += self._rounding
        left = np.stack([gap, gap + 0.2 * h * rate, gap + h * (0.4 * rate + 0.05 * h * bend)])
        right = np.stack([gap, gap - 0.2 * h * rate, gap - h * (0.4 * rate - 0.05 * h * bend)])
        left, right = left[:, :-1], right[:, 1:]
        # The gap itself is zero at impacts with this stop.
        own = self.solution.sides == self.side
        if own[self.start]:
            left[0, 0] = math.inf
        if own[self.end]:
            right[0, -1] = math.inf
        return bool(min(left.min(), right.min()) > 1.1 * error)
