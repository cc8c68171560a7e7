"""Minima of gaps in flight, and of other curves that are positive along a motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.validation import Array


def smallest_minimum(
    curve: Callable[[Array, int], Array], times: Array, values: Array, rounding: float = 0.0
) -> tuple[float, float]:
    """Smallest minimum of a curve inside an interval, and its time; infinite and NaN if none.

    Parameters
    ----------
    curve : callable
        Takes times (k,) and a number of orders; returns values and derivatives (orders, k).
    times, values : (k,), (3, k)
        Ends of equal cells that resolve it, and the curve with its first two derivatives there.
    rounding : float
        Rounding error of the values. Minima inside a cell that are less deep are left out: where
        the rate is zero at first, rounding causes such minima.
    """
    from dynkit.systems.impact.orbits.flight_kernels import REFINEMENTS, find_dips, refine_dips

    found = np.empty((6, 2 * len(times)))
    at, low, high, lowest, ends = *found[:4], found[4:]
    inner, count = find_dips(times, values, at, low, high, ends)
    if not count:
        return math.inf, math.nan
    at, lowest, step = at[:count], lowest[:count], float(times[1] - times[0])
    for _ in range(REFINEMENTS):
        if refine_dips(curve(at, 3), step, inner, rounding, at, low, high, ends, lowest):
            break
    k = int(np.argmin(lowest))
    return (float(lowest[k]), float(at[k])) if lowest[k] < math.inf else (math.inf, math.nan)


@final
class Curve:
    """A function of time that is positive along a motion: the gap in a flight, a contact force.

    Parameters
    ----------
    values : callable
        Takes times (k,) from the begin and a number of orders; returns values and derivatives
        (orders, k).
    lasts : float
        Duration.
    sizes : (2,)
        Sums of the absolute terms of the curve, and of its second derivative.
    """

    def __init__(
        self,
        values: Callable[[Array, int], Array],
        lasts: float,
        sizes: tuple[float, float],
    ) -> None:
        self.values, self.lasts, self._sizes = values, lasts, sizes
        self.rounding = 64.0 * 2.0**-52 * sizes[0]

    @cached_property
    def nodes(self) -> tuple[Array, Array]:
        """Ends (k,) of cells that resolve the curve, and the curve with two derivatives (3, k)."""
        from dynkit.systems.impact.orbits.flight_kernels import LEAST, MOST

        size, bend = self._sizes
        count = 4.0 * self.lasts * math.sqrt(bend / size) if size > 0.0 else 0.0
        cells = int(min(max(count, LEAST), MOST))
        times: Array = np.arange(cells + 1.0) * (self.lasts / cells)
        times[-1] = self.lasts
        return times, self.values(times, 3)

    @cached_property
    def smallest(self) -> tuple[float, float]:
        """Smallest minimum inside, and its time; infinite and NaN if there is none."""
        if self.lasts <= 0.0:
            return math.inf, math.nan
        return smallest_minimum(self.values, *self.nodes, self.rounding)

    @property
    def seen(self) -> float:
        """The smallest minimum; infinite if it is below rounding, as in a flight of length zero."""
        value = self.smallest[0]
        return value if abs(value) > self.rounding else math.inf
