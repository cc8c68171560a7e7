"""What becomes of an exponential sum from now on."""

from __future__ import annotations

import math

from dynkit.compiled import kernel
from dynkit.exponential.evaluation_kernels import DRIFT, TAIL, Ladder
from dynkit.validation import Array


@kernel(reorder=True, inline=True)
def weighted(rows: Array, first: int, skipped: int, states: Array, k: int) -> float:
    """Sum of the absolute terms of two rows, but for one slot."""
    total = 0.0
    for i in range(rows.shape[1]):
        if i != skipped:
            total += abs(rows[first, i] * states[k, 0, i])
            total += abs(rows[first + 1, i] * states[k, 1, i])
    return total


@kernel()
def _drift(ladder: Ladder, states: Array, k: int) -> tuple[float, float, float]:
    """Value, rate and acceleration of the terms that drift, with the offset."""
    d = ladder.rows
    value = ladder.offset
    rate = 0.0
    second = 0.0
    for i in range(d.shape[1]):
        a = states[k, 0, i]
        b = states[k, 1, i]
        value += d[DRIFT, i] * a + d[DRIFT + 1, i] * b
        rate += d[DRIFT + 2, i] * a + d[DRIFT + 3, i] * b
        second += d[DRIFT + 4, i] * a + d[DRIFT + 5, i] * b
    return value, rate, second


@kernel()
def _reach(ladder: Ladder, states: Array, k: int) -> float:
    """Bound of what does not drift, but for the table, from now on."""
    rows = ladder.rows
    if ladder.apart:
        return weighted(rows, TAIL, ladder.steady, states, k)
    # Pairs of one norm: the bound is not a sum, but a root of squares.
    total = 0.0
    for i in range(rows.shape[1]):
        if i != ladder.steady:
            a = rows[TAIL, i] * states[k, 0, i]
            b = rows[TAIL + 1, i] * states[k, 1, i]
            total += math.sqrt(a * a + b * b)
    return total


@kernel()
def tail(ladder: Ladder, states: Array, k: int) -> float:
    """Lower bound of f from now on."""
    lowest = ladder.offset
    if ladder.grows:
        lowest, rate, second = _drift(ladder, states, k)
        if second < 0.0 or (second == 0.0 and rate < 0.0):
            return -math.inf
        if rate < 0.0:
            lowest -= 0.5 * rate * rate / second
    return lowest - ladder.swing - _reach(ladder, states, k)


@kernel()
def stays_in_band(ladder: Ladder, states: Array, k: int, band: float) -> bool:
    """Whether abs(f) never exceeds the band from now on."""
    value = ladder.offset
    if ladder.grows:
        value, rate, second = _drift(ladder, states, k)
        if rate != 0.0 or second != 0.0:
            return False
    return abs(value) + ladder.swing + _reach(ladder, states, k) <= band
