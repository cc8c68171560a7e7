"""Kernel of time averages: integrals of products of exponentials, summed over intervals."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array

BLOCK = 64
"""Number of intervals that are summed up first, to reduce the rounding errors of long sums."""


@kernel(entry=True, reorder=True)
def sum_products(
    starts: Array,
    durations: Array,
    forward: Array,
    rates: Array,
    fastest: Array,
    slow: NDArray[np.intp],
    work: Array,
    block: Array,
    gram: Array,
    norms: Array,
    grown: Array,
) -> None:
    """Sum, over intervals, the quantities from which integrals of products are computed.

    Parameters
    ----------
    starts : (k, 2 slots) states at the starts of the intervals
    durations : (k,)
    forward : (2 (m - 1), 2 slots) rows of the real, then of the imaginary parts of all coordinates
        but the last, which is one
    rates : (2, m) real and imaginary parts of the coordinates' rates
    fastest : (m,) errors of the rates, in units of 2^-52
    slow : (p, 3) pairs of coordinates a, b whose rates almost cancel; the third entry is 1 if the
        product is that with the conjugate of b
    work : (4, m) buffer
    block, gram : (2 m, 2 m) buffer; sums of products of real and imaginary parts at the ends of
        intervals minus those at the starts: the upper triangle is modified in place
    norms : (4, m) sums of squares: at starts; at ends; of the phase errors at ends; at starts times
        durations; modified in place
    grown : (2, p) integrals of the slow products, modified in place
    """
    m = rates.shape[1]
    for first in range(0, len(durations), BLOCK):
        block[:] = 0.0
        for k in range(first, min(first + BLOCK, len(durations))):
            t = durations[k]
            work[0, m - 1], work[1, m - 1] = 1.0, 0.0
            for a in range(m - 1):
                real, imaginary = 0.0, 0.0
                for j in range(starts.shape[1]):
                    real += forward[a, j] * starts[k, j]
                    imaginary += forward[m - 1 + a, j] * starts[k, j]
                work[0, a], work[1, a] = real, imaginary
            for a in range(m):
                size = math.exp(rates[0, a] * t)
                c, s = size * math.cos(rates[1, a] * t), size * math.sin(rates[1, a] * t)
                x, y = work[0, a], work[1, a]
                work[2, a], work[3, a] = c * x - s * y, c * y + s * x
                square = x * x + y * y
                end = size * size * square
                norms[0, a] += square
                norms[1, a] += end
                norms[2, a] += end * (t * fastest[a]) ** 2
                norms[3, a] += t * square
            _add_products(work, block)
            for p in range(len(slow)):
                a, b = slow[p, 0], slow[p, 1]
                sign = -1.0 if slow[p, 2] == 1 else 1.0
                u, v = rates[0, a] + rates[0, b], rates[1, a] + sign * rates[1, b]
                real, imaginary = _grown(u, v, t)
                x = work[0, a] * work[0, b] - sign * work[1, a] * work[1, b]
                y = work[1, a] * work[0, b] + sign * work[0, a] * work[1, b]
                grown[0, p] += x * real - y * imaginary
                grown[1, p] += x * imaginary + y * real
        for i in range(2 * m):
            for j in range(i, 2 * m):
                gram[i, j] += block[i, j]


@kernel(reorder=True)
def _add_products(work: Array, block: Array) -> None:
    """Add products at the end of an interval minus those at its start, upper triangle."""
    m = work.shape[1]
    for a in range(m):
        for b in range(m):
            block[a, m + b] += work[2, a] * work[3, b] - work[0, a] * work[1, b]
        for b in range(a, m):
            block[a, b] += work[2, a] * work[2, b] - work[0, a] * work[0, b]
            block[m + a, m + b] += work[3, a] * work[3, b] - work[1, a] * work[1, b]


@kernel()
def _grown(u: float, v: float, t: float) -> tuple[float, float]:
    """Integral of exp((u + i v) s) over [0, t]."""
    square = u * u + v * v
    if square == 0.0:
        return t, 0.0
    half = math.sin(0.5 * v * t)
    grown = math.exp(u * t)
    # exp(z t) - 1 without cancellation
    x = math.expm1(u * t) - 2.0 * grown * half * half
    y = grown * math.sin(v * t)
    return (x * u + y * v) / square, (y * u - x * v) / square
