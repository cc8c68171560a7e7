"""Eigenpairs of a symmetric problem K x = lambda M x beyond double precision.

One step of refinement from approximate eigenvectors X, with R = 1 - X'MX and S = X'KX (Ogita &
Aishima):

    lambda_i = s_ii / (1 - r_ii),   x_j <- x_j + sum_i x_i e_ij,
    e_ij = (s_ij + lambda_j r_ij) / (lambda_j - lambda_i),   e_ii = r_ii / 2.

The numerator is x_i . w_j with the residual w_j = K x_j - lambda_j M x_j. Cancellation occurs only
in the residual, which is computed in double-double arithmetic. All further steps need few correct
digits and use matrix products in doubles. Eigenvalues that the first approximation cannot separate
are separated by a small eigenproblem, whose matrix follows from the same residuals.

References
----------
T. Ogita, K. Aishima, Iterative refinement for symmetric eigenvalue decomposition, Japan J. Indust.
Appl. Math. 35 (2018) 1007-1035, and part II: clustered eigenvalues, 36 (2019) 435-459.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.systems.structure.double_double import (
    ROUNDING,
    DoubleDouble,
    add,
    column_dots,
    columns,
    divide,
    multiply,
    negative,
    square_root,
    two_sum,
)
from dynkit.systems.structure.symmetric import BLOCK, SymmetricMatrix

# Largest correction that counts as small; beyond it the pair of modes is not yet separated.
_SMALL = 2.0**-7
# The iteration ends when the error after a step is below this.
_NEGLIGIBLE = 2.0**-66
_MOST_STEPS = 30


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """Refined solution of K x = lambda M x, eigenvalues ascending.

    Parameters
    ----------
    values : DoubleDouble, shape (N,)
        The eigenvalues.
    vectors : DoubleDouble, shape (N, N)
        The eigenvectors as columns, X'MX = 1.
    values_error : array, shape (N,)
        Estimate of the absolute error of `values`.
    vectors_error : array, shape (N,)
        Estimate of the error of each column of `vectors`, relative to its largest entry.
    rounding_level : array, shape (N,)
        abs(x)' abs(K) abs(x): an eigenvalue far below it results from cancellation of stiffnesses.
    """

    values: DoubleDouble
    vectors: DoubleDouble
    values_error: Array
    vectors_error: Array
    rounding_level: Array


@dataclass(frozen=True, eq=False)
class _Step:
    """One step of refinement, before the eigenvectors are changed."""

    values: DoubleDouble  # Rayleigh quotients, (N,)
    squares: DoubleDouble  # x'Mx, (N,)
    gaps: Array  # lambda_j - lambda_i, (N, N)
    numerators: Array  # x_i . (K x_j - lambda_j M x_j), (N, N)
    noise: Array  # rounding errors of the numerators, (N, N)
    corrections: Array  # E without its diagonal, (N, N)
    values_correction: Array  # second order, (N,)
    left: Array  # second and third order of corrections: bound of the error after the step, (N, N)
    alike: NDArray[np.bool_]  # pairs whose eigenvalues are equal up to rounding, (N, N)
    clusters: list[NDArray[np.intp]]  # modes that the corrections cannot separate


def refine(stiffness: SymmetricMatrix, mass: SymmetricMatrix) -> Eigenpairs:
    """Solve K x = lambda M x to nearly double-double accuracy.

    Parameters
    ----------
    stiffness, mass : SymmetricMatrix
        K, and the positive definite M; elements neither huge nor tiny (see `exponent`).

    Returns
    -------
    Eigenpairs
        Modes whose eigenvalues are equal up to rounding (relative to norm(K)) share an eigenspace.
        An orthonormal basis of it is returned; `vectors_error` does not include the choice of this
        basis.
    """
    x = _first_approximation(stiffness, mass)
    step = _step(stiffness, mass, x)
    least = np.inf
    for _ in range(_MOST_STEPS):
        if not step.clusters:
            left = float(np.max(step.left))
            # A step without improvement has reached the rounding of double-double arithmetic.
            if left <= _NEGLIGIBLE or left > least / 4.0:
                break
            least = left
        x = _corrected(x, step).high
        for cluster in step.clusters:
            x[:, cluster] = x[:, cluster] @ _separation(x, mass, cluster, step)
        step = _step(stiffness, mass, x)
    return _assembled(stiffness, x, step)


def _first_approximation(stiffness: SymmetricMatrix, mass: SymmetricMatrix) -> Array:
    # Scaling to a diagonal of ones removes the effect of unequal masses.
    lengths = np.sqrt(mass.diagonal)
    scaled = stiffness.dense / lengths[:, None] / lengths
    if mass.is_diagonal:
        vectors: Array = np.linalg.eigh(scaled)[1]
    else:
        from scipy.linalg import eigh

        vectors = eigh(scaled, mass.dense / lengths[:, None] / lengths)[1]
    return np.ascontiguousarray(vectors / lengths[:, None])


def _residuals(
    stiffness: SymmetricMatrix, mass: SymmetricMatrix, x: Array
) -> tuple[DoubleDouble, DoubleDouble, Array, Array]:
    """Return Rayleigh quotients (N,), x'Mx (N,), K x - lambda M x and M x (N, N), both rounded."""
    size = len(x)
    stretched, moved = stiffness.times(x), mass.times(x)
    squares = DoubleDouble(np.empty(size), np.empty(size))
    values = DoubleDouble(np.empty(size), np.empty(size))
    residuals = np.empty((size, size))
    for start in range(0, size, BLOCK):
        chosen = slice(start, start + BLOCK)
        block = np.ascontiguousarray(x[:, chosen])
        kx, mx = columns(stretched, chosen), columns(moved, chosen)
        square = column_dots(block, mx)
        value = divide(column_dots(block, kx), square)
        residual = add(kx, negative(multiply(mx, DoubleDouble(value.high[None], value.low[None]))))
        residuals[:, chosen] = residual.high
        values.high[chosen], values.low[chosen] = value
        squares.high[chosen], squares.low[chosen] = square
    return values, squares, residuals, moved.high


def _step(stiffness: SymmetricMatrix, mass: SymmetricMatrix, x: Array) -> _Step:
    values, squares, residuals, moved = _residuals(stiffness, mass, x)
    numerators = x.T @ residuals
    noise = _noise(stiffness, mass, x, values, residuals)
    gaps = _gaps(values)
    alike = np.abs(gaps) <= noise / _SMALL
    np.fill_diagonal(alike, False)
    separable = ~alike
    np.fill_diagonal(separable, False)
    divisors = gaps * squares.high[:, None]
    corrections = np.divide(numerators, divisors, out=np.zeros_like(gaps), where=separable)
    unsettled = np.where(alike, np.abs(numerators) > noise, np.abs(corrections) > _SMALL)
    np.fill_diagonal(unsettled, False)
    unsettled |= unsettled.T
    corrections[unsettled] = 0.0
    if alike.any():
        # Within an eigenspace the vectors are only made orthogonal.
        settled = alike & ~unsettled
        corrections[settled] = -0.5 * (x.T @ moved)[settled]
    second = numerators @ corrections + (corrections + corrections.T) @ numerators
    left = np.divide(second, divisors, out=np.zeros_like(gaps), where=separable & ~unsettled)
    # The error of a rotation of two modes is of third order.
    size = np.abs(corrections)
    third = size @ size @ size
    return _Step(
        values=values,
        squares=squares,
        gaps=gaps,
        numerators=numerators,
        noise=noise,
        corrections=corrections + np.where(np.abs(left) <= _SMALL, left, 0.0),
        values_correction=np.diagonal(second) / squares.high,
        left=np.abs(left) + third,
        alike=alike,
        clusters=_groups(unsettled),
    )


def _noise(
    stiffness: SymmetricMatrix,
    mass: SymmetricMatrix,
    x: Array,
    values: DoubleDouble,
    residuals: Array,
) -> Array:
    """Rounding errors of x_i . (K x_j - lambda_j M x_j), shape (N, N)."""
    size = np.abs(x)
    forces = np.abs(stiffness.dense) @ size + np.abs(mass.dense) @ size * np.abs(values.high)
    # The products with the residuals are computed in doubles.
    lost = (stiffness.widest_row + 8) * ROUNDING * forces + 2.0**-50 * np.abs(residuals)
    noise: Array = size.T @ lost
    return noise


def _gaps(values: DoubleDouble) -> Array:
    """lambda_j - lambda_i as doubles, shape (N, N), to nearly full relative accuracy."""
    high = two_sum(values.high[None, :], -values.high[:, None])
    gaps: Array = high.high + (high.low + (values.low[None, :] - values.low[:, None]))
    return gaps


def _groups(joined: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Connected components, of two modes or more, of the graph with this adjacency matrix."""
    if not joined.any():  # the usual case; the import takes as long as the modes
        return []
    from scipy.sparse.csgraph import connected_components

    count, part_of = connected_components(joined, directed=False)
    parts = (np.flatnonzero(part_of == number) for number in range(count))
    return [part for part in parts if len(part) > 1]


def _corrected(x: Array, step: _Step) -> DoubleDouble:
    """The vectors after the step, with x'Mx = 1."""
    e = step.corrections
    # Second order of the length; x_i'Mx_j is -(e_ij + e_ji).
    longer = np.maximum(-np.sum(e * (e + 2.0 * e.T), axis=0), -0.5 * step.squares.high)
    square = add(step.squares, DoubleDouble(longer, np.zeros_like(longer)))
    length = square_root(square)
    moved = two_sum(x, x @ e)
    inverse = divide(DoubleDouble(np.ones_like(longer), np.zeros_like(longer)), length)
    return multiply(moved, DoubleDouble(inverse.high[None], inverse.low[None]))


def _separation(x: Array, mass: SymmetricMatrix, cluster: NDArray[np.intp], step: _Step) -> Array:
    """Solve the small eigenproblem of one cluster; vectors are combinations of the present ones.

    Its matrix is x'(K - shift M)x; the size of its elements is the width of the cluster.
    """
    from scipy.linalg import eigh

    chosen = x[:, cluster]
    gram = chosen.T @ mass.times(chosen).high
    lowest = cluster[np.argmin(step.values.high[cluster])]
    above = step.gaps[lowest, cluster]
    matrix = step.numerators[np.ix_(cluster, cluster)] + above * gram
    vectors: Array = eigh((matrix + matrix.T) / 2.0, (gram + gram.T) / 2.0)[1]
    return vectors


def _assembled(stiffness: SymmetricMatrix, x: Array, step: _Step) -> Eigenpairs:
    vectors = _corrected(x, step)
    values = add(
        step.values, DoubleDouble(step.values_correction, np.zeros_like(step.values_correction))
    )
    size = np.abs(vectors.high)
    level = np.sum(size * (np.abs(stiffness.dense) @ size), axis=0)
    distant = ~step.alike
    np.fill_diagonal(distant, False)
    uncertain = np.divide(
        step.noise, np.abs(step.gaps), out=np.zeros_like(step.gaps), where=distant
    )
    mixed = size @ (uncertain + step.left)
    vectors_error = np.max(mixed, axis=0) / np.max(size, axis=0)
    # The correction of a value is a sum of numerators times corrections of vectors.
    inexact = np.abs(step.numerators) * step.left + 32.0 * step.noise * np.abs(step.corrections)
    values_error = (stiffness.widest_row + 8) * ROUNDING * level + np.sum(inexact, axis=0)
    if step.clusters:
        # Some modes were not separated within the largest number of steps.
        stuck = np.concatenate(step.clusters)
        vectors_error[stuck] = 1.0
        values_error[stuck] = np.sum(np.abs(step.numerators[:, stuck]), axis=0)
    order = np.lexsort((values.low, values.high))
    return Eigenpairs(
        values=DoubleDouble(values.high[order], values.low[order]),
        vectors=DoubleDouble(vectors.high[:, order], vectors.low[:, order]),
        values_error=values_error[order],
        vectors_error=vectors_error[order],
        rounding_level=level[order],
    )
