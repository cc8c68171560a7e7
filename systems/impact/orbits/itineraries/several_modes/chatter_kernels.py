"""Kernel of a chatter: changes of the state through its flights and impacts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array

Indices = NDArray[np.intp]


@kernel(reorder=True)
def _add_product(matrix: Array, changes: Array, out: Array) -> None:
    """Add a matrix times changes; most entries of an impact's matrix are zero."""
    rows, (d, columns) = matrix.shape[0], changes.shape
    if columns == 1:
        for j in range(d):
            for i in range(rows):
                out[i, 0] += matrix[i, j] * changes[j, 0]
        return
    blocks = d - d % 4
    for i in range(rows):
        for j in range(0, blocks, 4):
            a, b, c, e = matrix[i, j], matrix[i, j + 1], matrix[i, j + 2], matrix[i, j + 3]
            if a != 0.0 or b != 0.0 or c != 0.0 or e != 0.0:
                for k in range(columns):
                    two = a * changes[j, k] + b * changes[j + 1, k]
                    out[i, k] += two + c * changes[j + 2, k] + e * changes[j + 3, k]
        for j in range(blocks, d):
            if matrix[i, j] != 0.0:
                for k in range(columns):
                    out[i, k] += matrix[i, j] * changes[j, k]


@kernel(entry=True)
def carry(
    flown: Array,
    hits: Array,
    which: Indices,
    movings: Array,
    delays: Array,
    delay: Array,
    more: Array,
    changes: Array,
    landed: Array,
    delayed: Array,
) -> None:
    """Propagate changes (d, k) of the state through n flights, each ended by an impact.

    Parameters
    ----------
    flown
        (n, d, d) derivatives of the flights minus identity.
    hits, which
        (p, d, d) derivatives of impacts, and (n,) the number of the derivative of each impact.
    movings
        (n, d) changes of the state by a unit delay of each impact.
    delays, delay
        (n, d) derivatives of the delays by the changes, and (n,) delays due to changed numbers.
    more
        (n, d) changes of the state due to changed numbers.
    changes
        (d, k) modified in place.
    landed, delayed
        (d, k) and (2, k) modified in place: a buffer; the last delay, and the sum of all delays.
    """
    d, columns = changes.shape
    for k in range(columns):
        delayed[1, k] = 0.0
    for n in range(flown.shape[0]):
        for k in range(columns):
            delayed[0, k] = delay[n]
            for i in range(d):
                landed[i, k] = changes[i, k]
        _add_product(flown[n], changes, landed)
        _add_product(delays[n : n + 1], changes, delayed)
        for i in range(d):
            for k in range(columns):
                changes[i, k] = more[n, i] + movings[n, i] * delayed[0, k]
        _add_product(hits[which[n]], landed, changes)
        for k in range(columns):
            delayed[1, k] += delayed[0, k]
