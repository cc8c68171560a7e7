"""Kernel of a chatter: what its flights and impacts make of changes of the state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array

Indices = NDArray[np.intp]


@kernel(reorder=True)
def _add_product(matrix: Array, changes: Array, out: Array) -> None:
    """Add a matrix times changes; most entries of an impact's matrix are zero."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            a = matrix[i, j]
            if a != 0.0:
                for k in range(changes.shape[1]):
                    out[i, k] += a * changes[j, k]


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
    """Follow changes (d, k) through n flights, each with the impact that ends it.

    Parameters
    ----------
    flown
        (n, d, d) derivatives of the flights less 1.
    hits, which
        (p, d, d) derivatives of impacts, and (n,) which of them each impact has.
    movings
        (n, d) rates by which a delay of an impact changes the state.
    delays, delay
        (n, d) derivatives of the delays by the changes, and (n,) what changes of numbers add.
    more
        (n, d) what changes of numbers add to the state.
    changes
        (d, k) modified in place.
    landed, delayed
        (d, k), and (2, k) the delay of the last impact, and sums of all; modified in place.
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
