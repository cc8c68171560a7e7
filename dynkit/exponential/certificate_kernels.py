"""Cells of the search for a first root: certificates, and long cells without the fast terms."""

from __future__ import annotations

import math

from dynkit.core.jit import by_address, kernel
from dynkit.core.validation import Array
from dynkit.exponential.bound_kernels import died_out, tail, weighted
from dynkit.exponential.evaluation_kernels import (
    BOUND,
    DEGREE,
    EPSILON,
    SCRATCH,
    SEPARATE,
    Ladder,
    walk,
)

HURDLE = 3
"""Number of rungs between the longest cells that resolve a term and the shortest cells that leave
it out."""


@kernel(inline=True)
def quintic_minimum(
    h: float,
    value: float,
    rate: float,
    second: float,
    new_value: float,
    new_rate: float,
    new_second: float,
) -> float:
    """Return the smallest Bernstein coefficient: a lower bound of the Hermite polynomial."""
    left = min(value, value + 0.2 * h * rate, value + h * (0.4 * rate + 0.05 * h * second))
    right = min(
        new_value,
        new_value - 0.2 * h * new_rate,
        new_value - h * (0.4 * new_rate - 0.05 * h * new_second),
    )
    return min(left, right)


@kernel()
def taylor_rung(rows: Array, states: Array, k: int, smallest: float, most: int, band: float) -> int:
    """Return the largest rung <= `most` on which the Taylor remainder is below rounding."""
    remainder = 0.0
    for i in range(rows.shape[1]):
        remainder += rows[BOUND + 4, i] * abs(states[k, 0, i])
        remainder += rows[BOUND + 5, i] * abs(states[k, 1, i])
    for j in range(most, 0, -1):
        if remainder * (smallest * (1 << j)) ** (DEGREE + 1) <= 1e-3 * band:
            return j
    return 0


@kernel(reorder=True)
def _look_over(
    cell: Array, rows: Array, j: int, states: Array, k: int
) -> tuple[float, float, float, float, float, float, float, float]:
    """Evaluate as `look_ahead`, without the terms that are left out on rung `j`.

    Returns
    -------
    value, rate, second, new_value, new_rate, new_second : f, f', f'' now and after the step,
        without the offset
    error : bound of the quintic Hermite error
    apart : bound, on the cell, of the terms left out
    """
    value = rate = second = 0.0
    new_value = new_rate = new_second = 0.0
    error = 0.0
    apart = 0.0
    for i in range(rows.shape[1]):
        a = states[k, 0, i]
        b = states[k, 1, i]
        p = cell[j, 8, i] * a
        q = cell[j, 9, i] * b
        value += rows[0, i] * p + rows[1, i] * q
        rate += rows[2, i] * p + rows[3, i] * q
        second += rows[4, i] * p + rows[5, i] * q
        new_value += cell[j, 0, i] * p + cell[j, 1, i] * q
        new_rate += cell[j, 2, i] * p + cell[j, 3, i] * q
        new_second += cell[j, 4, i] * p + cell[j, 5, i] * q
        error += cell[j, 6, i] * abs(p) + cell[j, 7, i] * abs(q)
        x = abs(cell[j, 6, i] * (a - p))
        y = abs(cell[j, 7, i] * (b - q))
        square = x * x + y * y
        # squares of the smallest numbers underflow
        apart += x + y if rows[SEPARATE, i] > 0.0 or square < 1e-280 else math.sqrt(square)
    return value, rate, second, new_value, new_rate, new_second, error, apart


@kernel(entry=True)
def leap(
    ladder: Ladder,
    j: int,
    n: int,
    current: int,
    cells: int,
    limit: int,
    horizon: int,
    band_factor: float,
    band: float,
    touches: bool,
    passed: int,
    states: Array,
) -> tuple[bool, int, int, int, int, int, float, int]:
    """Pass cells without a root that are so long that fast terms are left out.

    Returns
    -------
    never, j, wide, n, current, cells, band, passed
        `never` means that no root follows. Otherwise `wide` is the rung of a cell for the Taylor
        polynomial. It is 0 if `j` has reached ``ladder.smooth``, or the search its limit. `passed`
        is the number of cells without a root, including those before a pause.
    """
    cell = ladder.cell
    rows = ladder.rows
    offset = ladder.offset
    smallest = ladder.smallest
    top = cell.shape[0] - 1
    seen = rows.shape[1]
    links = ladder.links
    while j > ladder.smooth and cells < limit and n <= horizon:
        reach = weighted(rows, BOUND, -1, states, current)
        now = band_factor * EPSILON * (reach + abs(offset))
        if ladder.grows:
            band = max(band, now)
        elif links.shape[0] == 0:
            # the rounding errors of uncoupled terms decay with the terms
            band = min(band, now)
        value, rate, second, new_value, new_rate, new_second, error, apart = _look_over(
            cell, rows, j, states, current
        )
        value += offset - apart
        new_value += offset - apart
        cells += 1
        h = smallest * (1 << j)
        low = quintic_minimum(h, value, rate, second, new_value, new_rate, new_second)
        if low > error + band * (1.0 + 0.25 * cells):
            to = (current + 1) % SCRATCH
            walk(ladder.step, links, ladder.link_step, seen, j, states, current, to)
            current = to
            n += 1 << j
            passed += 1
            if passed & 15 == 0 and (
                tail(ladder, ladder.links, states, current) > (band if touches else -band)
                or died_out(ladder, states, current)
            ):
                return True, j, 0, n, current, cells, band, passed
            if j < top and low > 32.0 * error:
                j += 1
            elif passed & 31 == 0:
                j = min(j + HURDLE, top)
        elif ladder.apart and taylor_rung(rows, states, current, smallest, j, band) == j:
            return False, j, j, n, current, cells, band, passed
        else:
            j -= 1
    return False, j, 0, n, current, cells, band, passed


leap_by_address = by_address(leap, bool, int, int, int, int, int, float, int)
"""Calls `leap` by its address."""
