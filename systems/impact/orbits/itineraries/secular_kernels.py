"""Eigenvalues of a block-diagonal matrix changed by one of low rank."""

from __future__ import annotations

from dynkit.core.jit import kernel
from dynkit.core.validation import Array


@kernel(reorder=True)
def _logarithmic_derivative(
    blocks: Array, left: Array, right: Array, z: complex, work: Array
) -> complex:
    """Derivative of log det(D + U V' - z) by z, with D of 2 by 2 blocks.

    det(D + U V' - z) = det(D - z) det K, K = 1 + V' (D - z)^-1 U, of which `work` (2, r, r) takes K
    and its derivative.
    """
    count, rank = left.shape[1], left.shape[2]
    for i in range(rank):
        for j in range(rank):
            work[0, i, j] = 1.0 if i == j else 0.0
            work[1, i, j] = 0.0
    total = 0.0j
    for k in range(count):
        a = blocks[0, 0, k] - z
        b = blocks[0, 1, k]
        c = blocks[1, 0, k]
        d = blocks[1, 1, k] - z
        scale = 1.0 / (a * d - b * c)
        total -= (a + d) * scale
        a, b, c, d = d * scale, -b * scale, -c * scale, a * scale
        for j in range(rank):
            x = a * left[0, k, j] + b * left[1, k, j]
            y = c * left[0, k, j] + d * left[1, k, j]
            x_rate = a * x + b * y
            y_rate = c * x + d * y
            for i in range(rank):
                work[0, i, j] += right[0, k, i] * x + right[1, k, i] * y
                work[1, i, j] += right[0, k, i] * x_rate + right[1, k, i] * y_rate
    return total + _trace_of_quotient(work, rank)


@kernel()
def _trace_of_quotient(work: Array, rank: int) -> complex:
    """Trace of K^-1 K', by elimination in place."""
    for k in range(rank):
        pivot = k
        for i in range(k + 1, rank):
            if abs(work[0, i, k]) > abs(work[0, pivot, k]):
                pivot = i
        for j in range(rank):
            work[0, k, j], work[0, pivot, j] = work[0, pivot, j], work[0, k, j]
            work[1, k, j], work[1, pivot, j] = work[1, pivot, j], work[1, k, j]
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


@kernel(entry=True)
def simultaneous_roots(
    blocks: Array,
    left: Array,
    right: Array,
    roots: Array,
    moving: Array,
    steps: int,
    tolerance: float,
    least: float,
    work: Array,
) -> int:
    """Move guesses of all eigenvalues to them, in place; return how many did not arrive.

    Ehrlich's and Aberth's iteration. A guess has arrived when it moves by less than `tolerance` of
    itself or than `least`.

    Parameters
    ----------
    blocks
        (2, 2, n)
    left, right
        (2, n, r)
    roots
        (2 n,) complex, distinct
    moving
        (2 n,) ones; zero for those that have arrived
    work
        (2, r, r) complex

    References
    ----------
    O. Aberth, Iteration methods for finding all zeros of a polynomial simultaneously, Mathematics
    of Computation 27 (1973) 339-344.
    """
    count = roots.shape[0]
    arrived = 0
    for _ in range(steps):
        for i in range(count):
            if moving[i] == 0.0:
                continue
            z = roots[i]
            slope = _logarithmic_derivative(blocks, left, right, z, work)
            for j in range(count):
                if j != i:
                    slope -= 1.0 / (z - roots[j])
            step = 1.0 / slope
            roots[i] = z - step
            if abs(step) <= max(tolerance * abs(z), least):
                moving[i] = 0.0
                arrived += 1
        if arrived == count:
            break
    return int(count - arrived)
