"""The gap in the flights of an orbit, and other curves that ought to stay positive."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array

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
        times = np.linspace(0.0, self.lasts, int(min(max(count, LEAST), MOST)) + 1)
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


@final
@dataclass(frozen=True, eq=False)
class Flight:
    """The gap of one stop between two impacts.

    Attributes
    ----------
    start, end : int
        Numbers of the impacts; no start, -1, where it begins at a release.
    side : int
        Number of the stop.
    begins : float
        Phase of the start.
    gap : Curve
    """

    start: int
    end: int
    side: int
    begins: float
    gap: Curve
