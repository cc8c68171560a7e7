"""Rows and bounds of exponential sums of uncoupled pairs, slot by slot."""

from __future__ import annotations

import math

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import BOUND, DEGREE, DRIFT, SEPARATE, TAIL


@kernel(entry=True)
def fill_sum(
    generator: Array,
    scale: Array,
    slow: Array,
    row: Array,
    factorial: float,
    largest: float,
    smallest: float,
    step: Array,
    rows: Array,
    cell: Array,
    work: Array,
    first: int,
    last: int,
) -> int:
    """Fill `rows` and `cell` of a `Ladder` in slots `first` to `last` - 1, in place.

    Parameters
    ----------
    generator, scale : (4, n), (n,)
        Fields of independent `Pairs`.
    slow : (n,)
        1 for pairs that are bounded by their present size, else 0.
    row : (2, seen)
        Row of f.
    factorial, largest : float
        (DEGREE + 1)!, and the upper limit of weights.
    step : (rungs, 8, slots)
    work : (2, DEGREE + 2, 2)
        Scratch: derivatives of the row of a slot, and their bounds; modified in place.

    Returns
    -------
    smooth : int
        Field of the `Ladder`.
    """
    rows_of, bounds = work[0], work[1]
    for k in range(first, last):
        g = generator[:, k]
        s = scale[k]
        rows_of[0, 0] = row[0, k]
        rows_of[0, 1] = row[1, k]
        for order in range(DEGREE + 2):
            a = rows_of[order, 0]
            b = rows_of[order, 1]
            bounds[order, 0] = math.hypot(a, b / s) if s > 0.0 else abs(a)
            bounds[order, 1] = bounds[order, 0] * s if s > 0.0 else abs(b)
            if order <= DEGREE:
                rows_of[order + 1, 0] = a * g[0] + b * g[2]
                rows_of[order + 1, 1] = a * g[1] + b * g[3]
        still = s > 0.0 and g[0] == 0.0 and g[1] == 0.0 and g[2] == 0.0 and g[3] == 0.0
        rows[SEPARATE, k] = 0.0 if s > 0.0 else 1.0
        rows[DRIFT, k] = rows_of[0, 0] if still else 0.0
        for r in range(2):
            for order in range(4):
                rows[2 * order + r, k] = rows_of[order, r]
            most = bounds[0, r]
            rows[BOUND + r, k] = most if slow[k] == 0.0 else abs(rows_of[0, r])
            rows[BOUND + 2 + r, k] = bounds[4, r]
            rows[BOUND + 4 + r, k] = bounds[DEGREE + 1, r] / factorial
            rows[TAIL + r, k] = 0.0 if still else most
            for j in range(cell.shape[0]):
                h = smallest * (1 << j)
                error = bounds[6, r] * (h * h * h * h * h * h) / 46080.0
                left = 2.0 * most + 0.4 * h * bounds[1, r] + 0.05 * h * h * bounds[2, r]
                kept = j == 0 or not left < error
                weight = error if kept else most
                cell[j, 6 + r, k] = weight if weight <= largest else largest
                cell[j, 8 + r, k] = 1.0 if kept else 0.0
                for order in range(3):
                    before = rows_of[order, 0] * step[j, r, k]
                    cell[j, 2 * order + r, k] = before + rows_of[order, 1] * step[j, 2 + r, k]
    for j in range(cell.shape[0]):
        for k in range(row.shape[1]):
            if cell[j, 8, k] == 0.0 or cell[j, 9, k] == 0.0:
                return int(j - 1)
    return int(cell.shape[0] - 1)
