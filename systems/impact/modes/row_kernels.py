"""Kernel of the product of many rows with a matrix."""

from __future__ import annotations

from dynkit.core.jit import kernel
from dynkit.core.validation import Array

TOGETHER = 16
"""Number of rows that are multiplied together, so that their products stay in the cache."""


@kernel(entry=True)
def fill_products(rows: Array, columns: Array, out: Array) -> None:
    """Fill `out` (k, m) with the products of rows (k, n) and columns (n, m), summed in order."""
    count, size = out.shape
    for first in range(0, count, TOGETHER):
        last = min(first + TOGETHER, count)
        for j in range(columns.shape[0]):
            for k in range(first, last):
                factor = rows[k, j]
                if j == 0:  # a sum that starts from zero would lose the sign of zero
                    for i in range(size):
                        out[k, i] = factor * columns[0, i]
                else:
                    for i in range(size):
                        out[k, i] += factor * columns[j, i]
