"""Eigenvalues of a block-diagonal matrix changed by one of low rank."""

from __future__ import annotations

import math

from dynkit.core.jit import kernel
from dynkit.core.validation import Array


@kernel(reorder=True)
def _logarithmic_derivative(
    halves: Array,
    spreads: Array,
    values: Array,
    slopes: Array,
    x: float,
    y: float,
    poles: Array,
    work: Array,
) -> complex:
    """Derivative of log det(D + U V' - z) by z = x + i y, with D of 2 by 2 blocks.

    det(D + U V' - z) = det(D - z) det K, K = 1 + V' (D - z)^-1 U. K and its derivative are stored
    in `work` (2, r, r). The inverse of a block is its adjugate, linear in z, over its determinant.
    Real and imaginary parts of the reciprocal determinants and their derivatives are stored in
    `poles` (4, n).
    """
    rank, count = values.shape[0], halves.shape[0]
    total_x = total_y = 0.0
    for k in range(count):
        # reciprocal of the determinant (z - half)^2 - spread, and its logarithmic derivative
        u = x - halves[k]
        p, q = u * u - y * y - spreads[k], 2.0 * u * y
        size = max(abs(p), abs(q))
        p, q = p / size, -q / size
        scale = 1.0 / ((p * p + q * q) * size)
        p, q = p * scale, q * scale
        s, t = 2.0 * (u * p - y * q), 2.0 * (u * q + y * p)
        total_x += s
        total_y += t
        poles[0, k], poles[1, k] = p, q
        poles[2, k], poles[3, k] = t * q - s * p, -s * q - t * p
    z = complex(x, y)
    for i in range(rank):
        for j in range(rank):
            a = b = c = d = e = f = g = h = 0.0
            for k in range(count):
                value, slope = values[i, j, k], slopes[i, j, k]
                a += value * poles[0, k]
                b += value * poles[1, k]
                c += value * poles[2, k]
                d += value * poles[3, k]
                e += slope * poles[0, k]
                f += slope * poles[1, k]
                g += slope * poles[2, k]
                h += slope * poles[3, k]
            linear = complex(e, f)
            work[0, i, j] = complex(a, b) - z * linear
            work[1, i, j] = complex(c, d) - z * complex(g, h) - linear
        work[0, i, i] += 1.0
    return complex(total_x, total_y) + _trace_of_quotient(work, rank)


@kernel()
def _trace_of_quotient(work: Array, rank: int) -> complex:
    """Trace of K^-1 K', by elimination in place; infinite where K is singular, at an eigenvalue."""
    for k in range(rank):
        pivot = k
        for i in range(k + 1, rank):
            if abs(work[0, i, k]) > abs(work[0, pivot, k]):
                pivot = i
        for j in range(rank):
            work[0, k, j], work[0, pivot, j] = work[0, pivot, j], work[0, k, j]
            work[1, k, j], work[1, pivot, j] = work[1, pivot, j], work[1, k, j]
        if work[0, k, k] == 0.0:
            return complex(math.inf, 0.0)
        for i in range(rank):
            if i != k:
                factor = work[0, i, k] / work[0, k, k]
                for j in range(rank):
                    work[0, i, j] -= factor * work[0, k, j]
                    work[1, i, j] -= factor * work[1, k, j]
    total = 0.0j
    for k in range(rank):
        total += work[1, k, k] / work[0, k, k]
    return total


@kernel(reorder=True)
def _repulsion(x: Array, y: Array, i: int) -> complex:
    """Sum of 1 / (z_i - z_j) over the others, z = x + i y."""
    total_x = total_y = 0.0
    for first, last in ((0, i), (i + 1, x.shape[0])):
        for j in range(first, last):
            p, q = x[i] - x[j], y[i] - y[j]
            size = max(abs(p), abs(q))
            p, q = p / size, q / size
            scale = 1.0 / ((p * p + q * q) * size)
            total_x += p * scale
            total_y -= q * scale
    return complex(total_x, total_y)


@kernel(entry=True)
def simultaneous_roots(
    halves: Array,
    spreads: Array,
    values: Array,
    slopes: Array,
    x: Array,
    y: Array,
    moving: Array,
    steps: int,
    tolerance: float,
    least: float,
    poles: Array,
    work: Array,
) -> int:
    """Iterate guesses x + i y of all eigenvalues, in place; return how many have not converged.

    This is Ehrlich's and Aberth's iteration. A guess has converged when its step is below
    `tolerance` times its modulus, or below `least`.

    Parameters
    ----------
    halves, spreads
        (n,); half the trace of each block, and the square of this minus the determinant
    values, slopes
        (r, r, n); value at z = 0, and coefficient of -z, of each block's part of V' adj(D - z) U
    x, y
        (2 n,), distinct
    moving
        (2 n,), true at first; set to false for guesses that have converged
    poles, work
        (4, n), and (2, r, r) complex: scratch

    References
    ----------
    O. Aberth, Iteration methods for finding all zeros of a polynomial simultaneously, Mathematics
    of Computation 27 (1973) 339-344.
    """
    count, arrived = x.shape[0], 0
    for _ in range(steps):
        for i in range(count):
            if not moving[i]:
                continue
            slope = _logarithmic_derivative(
                halves, spreads, values, slopes, x[i], y[i], poles, work
            )
            step = 1.0 / (slope - _repulsion(x, y, i))
            x[i] -= step.real
            y[i] -= step.imag
            if abs(step) <= max(tolerance * abs(complex(x[i], y[i])), least):
                moving[i] = False
                arrived += 1
        if arrived == count:
            break
    return int(count - arrived)
