"""The gap in the flights of an orbit, and other curves that ought to stay positive."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array

LEAST, MOST = 24, 4096
"""Cells of a flight."""

_REFINEMENTS, _CONVERGED = 12, 1e-5


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
    (gap, rate, bend), step = values, times[1] - times[0]
    inner = ((gap[1:-1] < gap[:-2]) & (gap[1:-1] <= gap[2:])).nonzero()[0] + 1
    cells, guesses = _dips(times, values, inner)
    # where the parabola through the rate, its slope and the slopes beside it is zero
    r, b, curved = rate[inner], bend[inner], (bend[inner + 1] - bend[inner - 1]) / step
    away = b + np.sqrt(np.maximum(b * b - curved * r, 0.0))
    move = _clipped(-2.0 * r / np.where(b > 0.0, away, np.inf), -step, step)
    at = np.concatenate([times[inner] + move, guesses])
    if not len(at):
        return math.inf, math.nan
    low = times[np.concatenate([inner - 1, cells])]
    high = times[np.concatenate([inner + 1, cells + 1])]
    for _ in range(_REFINEMENTS):
        lowest, rate, bend = curve(at, 3)
        move = _clipped(-rate / np.where(bend > 0.0, bend, np.inf), -step, step)
        move = _clipped(at + move, low, high) - at
        at, lowest = at + move, lowest + move * (rate + 0.5 * bend * move)
        # Newton's method: the next step would be the square of it.
        if abs(move).max() <= _CONVERGED * step:
            break
    # what was taken for a dip may be none
    if len(cells):
        dips = slice(len(inner), None)
        ends = np.array([gap[cells], gap[cells + 1]])
        apart = (abs(ends - lowest[dips]) > rounding).all(axis=0)
        real = apart & (bend > 0.0)[dips] & (low < at)[dips] & (at < high)[dips]
        lowest[dips][~real] = math.inf
    k = int(np.argmin(lowest))
    return (float(lowest[k]), float(at[k])) if lowest[k] < math.inf else (math.inf, math.nan)


def _clipped(x: Array, low: Any, high: Any) -> Array:
    return np.asarray(np.minimum(np.maximum(x, low), high))


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
    cells = turned.nonzero()[0]
    part = rate[cells] / (rate[cells] - rate[cells + 1])
    guesses = times[cells] + h * part
    # from the left end of each cell, and from the right one
    begin, bent = np.array([rate[:-1], -rate[1:]]), np.array([bend[:-1], bend[1:]]) * h
    end = -begin[::-1]
    curved = end - begin - bent
    twice = (bent * bent > 4.0 * curved * begin) & (-bent < 2.0 * curved)
    places = (twice & (begin > 0.0) & (bent < 0.0) & (end > 0.0)).nonzero()
    right, more = places
    if len(more):
        begin, bent, curved = begin[places], bent[places], curved[places]
        part = (-bent + np.sqrt(bent * bent - 4.0 * curved * begin)) / (2.0 * curved)
        guesses = np.append(guesses, times[more + right] + (1 - 2 * right) * h * part)
        cells = np.append(cells, more)
    return cells, guesses


@final
class Curve:
    """A number that a motion keeps positive for a while: the gap in a flight, a contact force.

    Parameters
    ----------
    values : callable
        Of times (k,) from its begin, and a number of orders: it and its derivatives (orders, k).
    lasts : float
    sizes : (2,)
        Sums of the absolute terms of it, and of its second derivative.
    """

    def __init__(
        self, values: Callable[[Array, int], Array], lasts: float, sizes: tuple[float, float]
    ) -> None:
        self.values, self.lasts, self._sizes = values, lasts, sizes
        self.rounding = 64.0 * 2.0**-52 * sizes[0]

    @cached_property
    def nodes(self) -> tuple[Array, Array]:
        """Times, and it with two derivatives (3, k), at the ends of cells that resolve it."""
        size, bend = self._sizes
        count = 4.0 * self.lasts * math.sqrt(bend / size) if size > 0.0 else 0.0
        cells = int(min(max(count, LEAST), MOST))
        times: Array = np.arange(cells + 1.0) * (self.lasts / cells)
        times[-1] = self.lasts
        return times, self.values(times, 3)

    @cached_property
    def smallest(self) -> tuple[float, float]:
        """Smallest of the minima inside, and its time; infinite where there is none."""
        if self.lasts <= 0.0:
            return math.inf, math.nan
        return smallest_minimum(self.values, *self.nodes, self.rounding)

    @property
    def seen(self) -> float:
        """The smallest minimum; infinite where it is rounding, as in a flight of no length."""
        value = self.smallest[0]
        return value if abs(value) > self.rounding else math.inf
