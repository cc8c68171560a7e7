"""Kernels for the minima of a curve that is sampled at the ends of equal cells."""

from __future__ import annotations

import math

from dynkit.core.jit import kernel
from dynkit.core.validation import Array

LEAST, MOST = 24, 4096
"""Smallest and largest number of cells of a flight."""

REFINEMENTS = 12
"""Largest number of steps of Newton's method to a minimum."""

CONVERGED = 1e-5
"""Newton's method ends at a step below this many cells: the next step is of its square's order."""


@kernel(entry=True)
def find_dips(
    times: Array, values: Array, at: Array, low: Array, high: Array, ends: Array
) -> tuple[int, int]:
    """Find minima at ends of cells (first kind), then minima inside cells only (second kind).

    Just after a weak impact, and just before one, the gap may rise, fall and rise again within one
    or two cells. A cell holds such a minimum if the rate changes sign from minus to plus between
    its ends. If both rates have the same sign, it holds one if a parabola for the rate has two
    zeros in the cell. This parabola has both rates, and the second derivative at one end.

    Parameters
    ----------
    times, values
        (c + 1,), (3, c + 1) ends of equal cells, and the curve with its first two derivatives
    at, low, high
        (m,) modified in place: guesses of the times of minima, and their bounds; m = 2 c is enough
    ends
        (2, m) modified in place: the curve at the ends of the cells of the second kind

    Returns
    -------
    int, int
        Number of minima of the first kind, and of both kinds.
    """
    count, h = times.shape[0] - 1, times[1] - times[0]
    n = 0
    for i in range(1, count):
        if values[0, i] < values[0, i - 1] and values[0, i] <= values[0, i + 1]:
            # zero of the parabola through the rate, with its slope and the slopes at both sides
            r, b = values[1, i], values[2, i]
            move = 0.0
            if b > 0.0:
                curved = (values[2, i + 1] - values[2, i - 1]) / h
                move = -2.0 * r / (b + math.sqrt(max(b * b - curved * r, 0.0)))
            at[n] = times[i] + min(max(move, -h), h)
            low[n], high[n] = times[i - 1], times[i + 1]
            n += 1
    inner = n
    for i in range(count):
        r, s = values[1, i], values[1, i + 1]
        place = -1.0
        if r < 0.0 and s > 0.0:
            left = i > 0 and values[0, i] < values[0, i - 1] and values[0, i] <= values[0, i + 1]
            right = (
                i + 1 < count
                and values[0, i + 1] < values[0, i]
                and values[0, i + 1] <= values[0, i + 2]
            )
            if not (left or right):
                place = r / (r - s)
        # parabola with the second derivative at the left end, then the one at the right end
        for side in range(2):
            begin, end = (r, s) if side == 0 else (-s, -r)
            bent = values[2, i + side] * h
            curved = end - begin - bent
            if begin > 0.0 and bent < 0.0 and end > 0.0:
                inside = bent * bent - 4.0 * curved * begin
                if inside > 0.0 and -bent < 2.0 * curved:
                    part = (-bent + math.sqrt(inside)) / (2.0 * curved)
                    place = part if side == 0 else 1.0 - part
        if place >= 0.0:
            at[n] = times[i] + h * place
            low[n], high[n] = times[i], times[i + 1]
            ends[0, n], ends[1, n] = values[0, i], values[0, i + 1]
            n += 1
    return inner, n


@kernel(entry=True)
def refine_dips(
    values: Array,
    step: float,
    inner: int,
    rounding: float,
    at: Array,
    low: Array,
    high: Array,
    ends: Array,
    lowest: Array,
) -> bool:
    """Take one step of Newton's method for all minima, and return whether all have converged.

    Parameters
    ----------
    values
        (3, n) the curve with its first two derivatives at the guesses
    step
        length of a cell
    inner
        number of minima of the first kind; a guess of the second kind may belong to no minimum
    rounding
        rounding error of the values
    at, lowest
        (n,) modified in place: times, and values at the minima, infinite where there is none
    low, high, ends
        as found by `find_dips`
    """
    longest = 0.0
    for k in range(values.shape[1]):
        rate, bend = values[1, k], values[2, k]
        move = min(max(-rate / bend, -step), step) if bend > 0.0 else 0.0
        move = min(max(at[k] + move, low[k]), high[k]) - at[k]
        longest = max(longest, abs(move))
        at[k] += move
        lowest[k] = values[0, k] + move * (rate + 0.5 * bend * move)
        if k >= inner:
            apart = min(abs(ends[0, k] - lowest[k]), abs(ends[1, k] - lowest[k]))
            if not (apart > rounding and bend > 0.0 and low[k] < at[k] < high[k]):
                lowest[k] = math.inf
    return longest <= CONVERGED * step


@kernel(entry=True)
def least_coefficient(values: Array, h: float, first: bool, last: bool) -> float:
    """Least Bernstein coefficient of the quintic Hermite polynomials of a curve on its cells.

    Parameters
    ----------
    values
        (3, c + 1) the curve with its first two derivatives at the ends of the cells
    h
        length of a cell
    first, last
        whether the value of the curve at its begin, and at its end, is left out
    """
    least, count = math.inf, values.shape[1] - 1
    for i in range(count + 1):
        gap, rate, bend = values[0, i], 0.2 * h * values[1, i], 0.05 * h * h * values[2, i]
        if not ((first and i == 0) or (last and i == count)):
            least = min(least, gap)
        if i < count:
            least = min(least, gap + rate, gap + 2.0 * rate + bend)
        if i > 0:
            least = min(least, gap - rate, gap - 2.0 * rate + bend)
    return least
