"""Refinement of a Schur form in doubles to double-double accuracy, by plain matrix products.

Let T = Q'AQ consist of U, its diagonal blocks and what is above them, and of the residual L below.
The solution X of ``(U X - X U)_below = -L`` turns Q into ``Q (1 + X - X')``, to first order. Each
step measures T and Q'Q anew, so that errors of earlier steps do not remain.

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
# A step from a larger rotation leaves more than the error of products in half the precision.
_ROUGH = 2.0**-26
# Steps that turn farther than this (radians) diverge more often than not.
_FARTHEST = 0.25
_MOST_STEPS = 12


def refined_schur(matrix: DoubleDouble) -> tuple[DoubleDouble, DoubleDouble] | None:
    """Quasi-triangular T and orthogonal Q, matrix = Q T Q', or None if the steps do not contract.

    They do not where eigenvalues nearly merge, or are as ill-conditioned as those of graded
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
        # Cayley's transform of a skew-symmetric matrix is orthogonal; this is what it adds to 1.
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
    """X below the diagonal blocks, ``(upper X - X upper)_below = -residual``, by halves."""
    from scipy.linalg.lapack import dtrsyl

    n, out = len(upper), np.zeros_like(upper)
    half = n // 2
    if half and upper[half, half - 1] != 0.0:  # within a block
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
