"""Refinement of a Schur form in doubles to double-double accuracy, by plain matrix products.

Let T = Q'AQ be the sum of U, with its diagonal blocks and everything above them, and of the
residual L below. With the solution X of ``(U X - X U)_below = -L``, Q is replaced by ``Q (1 + X -
X')``, to first order. Each step computes T and Q'Q anew, so that errors of earlier steps vanish.

References
----------
A. Bujanovic, D. Kressner, C. Schroeder, Iterative refinement of Schur decompositions, Numer.
Algorithms 92 (2023) 247-267.
"""

from __future__ import annotations

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.structure.double_double import DoubleDouble, plus
from dynkit.systems.structure.symmetric import FULL, product

# The square of this rotation is below double-double rounding: no step follows.
_NEGLIGIBLE = 2.0**-54
# After a larger rotation, the next residual exceeds the error of products in half the precision.
_ROUGH = 2.0**-26
# Steps with a larger rotation than this (radians) diverge in most cases.
_FARTHEST = 0.25
_MOST_STEPS = 12


def refined_schur(matrix: DoubleDouble) -> tuple[DoubleDouble, DoubleDouble] | None:
    """Quasi-triangular T and orthogonal Q, matrix = Q T Q', or None if the steps do not converge.

    They do not converge if eigenvalues nearly merge, or are as ill-conditioned as those of graded
    dashpots along hundreds of masses. The eigenvalues of a 2x2 block may be real.
    """
    from scipy.linalg import schur

    form, vectors = schur(matrix.high)
    block = np.cumsum(np.append(True, np.diagonal(form, -1) == 0.0))
    below = block[:, None] > block
    one: Array = np.eye(len(form))
    q = DoubleDouble(vectors, np.zeros_like(vectors))
    farthest = 1.0
    for _ in range(_MOST_STEPS):
        precision = FULL if farthest <= _ROUGH else FULL // 2
        transposed = DoubleDouble(q.high.T.copy(), q.low.T.copy())
        gram = plus(product(transposed, q, precision), -one).high
        t = product(transposed, product(matrix, q, precision), precision)
        t = plus(t, -0.5 * (gram @ t.high + t.high @ gram))
        x = _rotation(np.where(below, 0.0, t.high), np.where(below, t.high, 0.0))
        # Cayley's transform 1 + turn of a skew-symmetric matrix is orthogonal.
        skew = x - x.T
        turn = np.asarray(np.linalg.solve(one - 0.5 * skew, skew), dtype=np.float64)
        farthest = float(np.abs(turn).max())
        if not farthest <= _FARTHEST:
            return None
        q = plus(q, q.high @ (turn - 0.5 * gram))
        if precision == FULL and farthest <= _NEGLIGIBLE:
            t = plus(t, t.high @ turn - turn @ t.high)
            return DoubleDouble(*(np.where(below, 0.0, part) for part in t)), q
    return None


def _rotation(upper: Array, residual: Array) -> Array:
    """Solve ``(upper X - X upper)_below = -residual`` for X below the blocks, recursively."""
    from scipy.linalg.lapack import dtrsyl

    n, out = len(upper), np.zeros_like(upper)
    half = n // 2
    if half and upper[half, half - 1] != 0.0:  # do not split a 2x2 block
        half -= 1
    if half == 0:
        return out
    first, last = slice(half), slice(half, n)
    x, scale, _ = dtrsyl(upper[last, last], upper[first, first], -residual[last, first], isgn=-1)
    x /= scale
    out[last, first] = x
    right = upper[first, last]
    out[first, first] = _rotation(upper[first, first], residual[first, first] + right @ x)
    out[last, last] = _rotation(upper[last, last], residual[last, last] - x @ right)
    return out
