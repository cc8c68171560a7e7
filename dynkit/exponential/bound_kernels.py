"""Bounds of an exponential sum at all later times."""

from __future__ import annotations

import math

from dynkit.core.jit import by_address, kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import DRIFT, TAIL, TERM, Indices, Ladder

NOTHING = 1e-200
"""A motion that never again exceeds this has ended: the motion, and products of its numbers with
high powers of slow rates, would soon underflow."""


@kernel(reorder=True)
def weighted(rows: Array, first: int, skipped: int, states: Array, k: int) -> float:
    """Return the sum of the absolute terms of two rows, without one slot."""
    total = 0.0
    for i in range(rows.shape[1]):
        if i != skipped:
            total += abs(rows[first, i] * states[k, 0, i])
            total += abs(rows[first + 1, i] * states[k, 1, i])
    return total


@kernel()
def _drift(ladder: Ladder, states: Array, k: int) -> tuple[float, float, float, float, float]:
    """Return value, rate and acceleration of the drifting and constant terms, and two distances.

    The distances are by how much bodies under drag will still lower and raise f. They are not added
    to the value, which would lose digits where the drag is small.
    """
    d = ladder.rows
    g = ladder.generator
    value = ladder.offset
    rate = 0.0
    second = 0.0
    down = 0.0
    up = 0.0
    for i in range(d.shape[1]):
        a = states[k, 0, i]
        b = states[k, 1, i]
        ahead = d[DRIFT + 1, i] * b
        value += d[DRIFT, i] * a
        if g[3, i] >= 0.0:
            value += ahead
        elif ahead < 0.0:
            down -= ahead
        else:
            up += ahead
        rate += d[DRIFT + 2, i] * a + d[DRIFT + 3, i] * b
        second += d[DRIFT + 4, i] * a + d[DRIFT + 5, i] * b
    return value, rate, second, down, up


@kernel()
def _less_steady(ladder: Ladder, links: Indices | None, states: Array, k: int) -> int:
    """Return the index of state `k` minus its steady responses; the scratch state TERM if any."""
    if links is None or links.shape[0] == 0:
        return k
    response = ladder.link_step
    last = response.shape[0] - 1
    for row in range(2):
        for i in range(ladder.rows.shape[1]):
            states[TERM, row, i] = states[k, row, i]
    for m in range(links.shape[0]):
        p = states[k, 0, links[m, 1]]
        q = states[k, 1, links[m, 1]]
        states[TERM, 0, links[m, 0]] -= response[last, m, 0] * p + response[last, m, 1] * q
        states[TERM, 1, links[m, 0]] -= response[last, m, 2] * p + response[last, m, 3] * q
    return TERM


@kernel()
def _reach(ladder: Ladder, links: Indices | None, states: Array, at: int) -> float:
    """Return the bound, at all later times, of the terms that neither drift nor are steady."""
    rows = ladder.rows
    k = _less_steady(ladder, links, states, at)
    if links is not None and ladder.apart:
        return weighted(rows, TAIL, ladder.steady, states, k)
    # pairs with a common norm: the bound is the root of a sum of squares
    total = 0.0
    for i in range(rows.shape[1]):
        if i != ladder.steady:
            a = rows[TAIL, i] * states[k, 0, i]
            b = rows[TAIL + 1, i] * states[k, 1, i]
            square = a * a + b * b
            # squares of the smallest numbers underflow
            total += math.sqrt(square) if square > 1e-280 else abs(a) + abs(b)
    return total


@kernel()
def tail(ladder: Ladder, links: Indices | None, states: Array, k: int) -> float:
    """Return a lower bound of f at all later times.

    Here and below, `links` are those of the sum; None for a sum that is known to be `plain`.
    """
    lowest, rate, second, down, _ = _drift(ladder, states, k)
    if second < 0.0 or (second == 0.0 and rate < 0.0):
        return -math.inf
    if rate < 0.0:
        lowest -= 0.5 * rate * rate / second
    lowest -= down
    return lowest - ladder.swing - _reach(ladder, links, states, k)


@kernel()
def stays_in_band(
    ladder: Ladder, links: Indices | None, states: Array, k: int, band: float
) -> bool:
    """Return whether abs(f) stays within the band at all later times."""
    value, rate, second, down, up = _drift(ladder, states, k)
    if rate != 0.0 or second != 0.0:
        return False
    moves = down + up + ladder.swing + _reach(ladder, links, states, k)
    return abs(value) + moves <= band


@kernel()
def died_out(ladder: Ladder, states: Array, k: int) -> bool:
    """Return whether f, without offset and drive, has decayed below `NOTHING` but is not zero.

    Without this test a sequence of ever smaller impacts and releases would not end.
    """
    if ladder.offset != 0.0 or ladder.steady >= 0:
        return False
    links = ladder.links
    decayed = stays_in_band(ladder, links, states, k, NOTHING)
    return decayed and not stays_in_band(ladder, links, states, k, 0.0)


@kernel(entry=True)
def motion_died_out(ladder: Ladder, states: Array, k: int) -> bool:
    """Call `died_out` by its address."""
    return died_out(ladder, states, k)


died_out_by_address = by_address(motion_died_out, bool)
"""Calls `died_out` by its address."""
