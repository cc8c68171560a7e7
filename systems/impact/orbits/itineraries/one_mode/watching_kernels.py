"""Minima and bounds of the gaps of all stops in the flights between impacts of one mode."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import Ladder, Workspace
from dynkit.systems.impact.orbits.flight_kernels import (
    LEAST,
    MOST,
    REFINEMENTS,
    find_dips,
    least_coefficient,
    refine_dips,
)
from dynkit.systems.impact.orbits.itineraries.one_mode.response_kernels import follow_gap

_ROUNDING = 64.0 * 2.0**-52
"""Rounding error of a gap, relative to the sum of its absolute terms."""


class Watched(NamedTuple):
    """Numbers (n, e) of the gap of each of e stops in the flight after each of n impacts.

    Attributes
    ----------
    size, bend : sums of the absolute terms of the gap, and of its second derivative
    lowest, at : smallest minimum inside, infinite if there is none, and its time
    closed : whether the gap is negative somewhere by more than rounding
    opened : whether the gap is proved to be positive

    The proof: on each cell the error of the quintic Hermite polynomial is at most h^6/46080 sup
    |f^(6)|, or 2 sup |f| + 2/5 h sup |f'| + h^2/20 sup |f''|, for each term of the gap. The
    polynomial's Bernstein coefficients must exceed this error. The coefficient at an impact is left
    out: there the gap vanishes in first order of time, and the polynomial's error in third order.
    """

    size: Array
    bend: Array
    lowest: Array
    at: Array
    closed: NDArray[np.bool_]
    opened: NDArray[np.bool_]


@kernel(reorder=True)
def _sums(bounds: Array, start: Array, h: float) -> tuple[float, float, float]:
    """Sums of the absolute terms of a gap and of its second derivative, and error on a cell."""
    size, bend, error = 0.0, 0.0, 0.0
    for row in range(2):
        for i in range(start.shape[1]):
            a = abs(start[row, i])
            size += bounds[0, row, i] * a
            bend += bounds[2, row, i] * a
            cap = 2.0 * bounds[0, row, i] + 0.4 * h * bounds[1, row, i]
            cap += 0.05 * h * h * bounds[2, row, i]
            error += min(bounds[3, row, i] * h**6 / 46080.0, cap) * a
    return size, bend, error


@kernel(entry=True)
def watch_gaps(
    ladder: Ladder,
    work: Workspace,
    rows: Array,
    bounds: Array,
    numbers: Array,
    starts: Array,
    phases: Array,
    clock: float,
    lasts: Array,
    sides: NDArray[np.intp],
    following: NDArray[np.intp],
    buffer: Array,
    out: Watched,
) -> None:
    """Compute the numbers of `Watched`; `out`, `work` and the buffer are modified in place.

    Parameters
    ----------
    ladder, work, rows, numbers, sides
        as in `assemble`
    bounds
        (e, 4, 2, slots) as in `Windows`
    starts, phases, lasts, following
        (n, 2, slots), (n,): states just after the impacts, their phases, times until the next
        impact with any stop, and its number
    buffer
        (22 (MOST + 1),) for times and values at the ends of cells, and minima
    """
    for i in range(len(sides)):
        for stop in range(rows.shape[0]):
            drive = math.hypot(numbers[stop, 0], numbers[stop, 1])
            size, bend, _ = _sums(bounds[stop], starts[i], 0.0)
            size, bend = size + drive, bend + drive * clock * clock
            out.size[i, stop], out.bend[i, stop] = size, bend
            fine = 4.0 * lasts[i] * math.sqrt(bend / size) if size > 0.0 else 0.0
            cells = max(int(fine), LEAST) if fine < MOST else MOST
            ends, m = cells + 1, 2 * cells
            times, values = buffer[:ends], buffer[ends : 4 * ends].reshape(3, ends)
            left = buffer[4 * ends :]
            at, low, high, lowest = left[:m], left[m : 2 * m], left[2 * m : 3 * m], left[3 * m :]
            sides_of, seen = left[4 * m : 6 * m].reshape(2, m), left[6 * m : 9 * m]
            h, rounding = lasts[i] / cells, _ROUNDING * size
            for k in range(ends):
                times[k] = k * h
            times[cells] = lasts[i]
            begun, phase = starts[i : i + 1], phases[i]
            follow_gap(ladder, work, rows, stop, numbers, begun, phase, clock, times, values)
            out.lowest[i, stop], out.at[i, stop] = math.inf, math.nan
            least = math.inf
            for k in range(1, cells):
                least = min(least, values[0, k])
            if lasts[i] > 0.0:
                inner, count = find_dips(times, values, at, low, high, sides_of)
                for _ in range(REFINEMENTS if count else 0):
                    there, when = seen[: 3 * count].reshape(3, count), at[:count]
                    follow_gap(ladder, work, rows, stop, numbers, begun, phase, clock, when, there)
                    if refine_dips(there, h, inner, rounding, at, low, high, sides_of, lowest):
                        break
                for k in range(count):
                    if lowest[k] < out.lowest[i, stop]:
                        out.lowest[i, stop], out.at[i, stop] = lowest[k], at[k]
            out.closed[i, stop] = min(out.lowest[i, stop], least) < -rounding
            error = _sums(bounds[stop], starts[i], h)[2] + drive * (clock * h) ** 6 / 46080.0
            # the gap itself is zero at impacts with this stop
            first, last = sides[i] == stop, sides[following[i]] == stop
            proved = least_coefficient(values, h, first, last) > 1.1 * (error + rounding)
            out.opened[i, stop] = proved
