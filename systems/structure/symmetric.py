"""Sparse symmetric matrices whose elements are double-double numbers, and their products."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product as pairs
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.systems.structure.double_double import (
    DoubleDouble,
    add,
    plus,
    quick_two_sum,
    scale,
    two_product,
    two_sum,
)

FULL = 110
"""Bits of precision for which products of slices have full double-double accuracy."""

# Number of columns that are processed together: 1000 x 32 double-doubles fit a second-level cache.
BLOCK = 32


class _Layer(NamedTuple):
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    element: DoubleDouble


@dataclass(frozen=True, eq=False)
class SymmetricMatrix:
    """A symmetric matrix given by its nonzero elements, each the sum of two doubles.

    Parameters
    ----------
    size : int
        The number of rows, N.
    rows, columns : arrays of int, shape (n,)
        Places of the nonzero elements, both triangles, ordered by row and then by column.
    high, low : arrays, shape (n,)
        The elements are ``high + low``; ``high`` is the nearest double.

    Notes
    -----
    The sum of two spring constants is seldom a double. The low part keeps the digits that rounding
    to a double would lose, for example those of a soft spring between a stiff chain and the wall.
    """

    size: int
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    high: Array
    low: Array

    @classmethod
    def from_fractions(
        cls, size: int, elements: Mapping[tuple[int, int], Fraction]
    ) -> SymmetricMatrix:
        """Return the matrix with given elements on and above the diagonal, each rounded once.

        Raises
        ------
        OverflowError
            When an element exceeds the range of doubles.
        """
        pairs = {}
        for (row, column), value in elements.items():
            if value:
                high = float(value)
                pairs[row, column] = pairs[column, row] = high, float(value - Fraction(high))
        places = sorted(pairs)
        return cls(
            size,
            np.array([row for row, _ in places], dtype=np.intp),
            np.array([column for _, column in places], dtype=np.intp),
            np.array([pairs[place][0] for place in places], dtype=np.float64),
            np.array([pairs[place][1] for place in places], dtype=np.float64),
        )

    @classmethod
    def from_dense(cls, matrix: Array) -> SymmetricMatrix:
        """Return the matrix of a symmetric array of shape (N, N), whose elements are exact."""
        rows, columns = np.nonzero(matrix)
        high = matrix[rows, columns]
        return cls(len(matrix), rows, columns, high, np.zeros_like(high))

    @cached_property
    def dense(self) -> Array:
        """The matrix as a read-only array of doubles, shape (N, N): correctly rounded."""
        matrix = np.zeros((self.size, self.size))
        matrix[self.rows, self.columns] = self.high
        matrix.flags.writeable = False
        return matrix

    @property
    def is_diagonal(self) -> bool:
        """Whether all elements off the diagonal are zero."""
        return bool(np.all(self.rows == self.columns))

    @cached_property
    def diagonal(self) -> Array:
        """The diagonal as doubles, shape (N,)."""
        diagonal = np.zeros(self.size)
        on_it = self.rows == self.columns
        diagonal[self.rows[on_it]] = self.high[on_it]
        return diagonal

    @cached_property
    def exponent(self) -> int:
        """The smallest even number e such that the largest element is below 2^e."""
        if not len(self.high):
            return 0
        exponent = int(np.frexp(np.max(np.abs(self.high)))[1])
        return exponent + exponent % 2

    def scaled(self, exponent: int) -> SymmetricMatrix:
        """The matrix times 2 to the power `exponent`."""
        high, low = np.ldexp(self.high, exponent), np.ldexp(self.low, exponent)
        return replace(self, high=high, low=low)

    def without(self, places: NDArray[np.intp], ties: Array | None = None) -> SymmetricMatrix:
        """Matrix of the quadratic form with coordinates (h,) that are zero, or follow the m others.

        With ties (h, m) each is this linear combination of the others; the matrix is rounded once.
        """
        number = np.arange(self.size) - np.searchsorted(np.sort(places), np.arange(self.size))
        size = self.size - len(places)
        if ties is None:
            kept = ~(np.isin(self.rows, places) | np.isin(self.columns, places))
            rows, columns = number[self.rows[kept]], number[self.columns[kept]]
            return SymmetricMatrix(size, rows, columns, self.high[kept], self.low[kept])
        parts = [{k: Fraction(1)} for k in number.tolist()]
        for place, row in zip(places.tolist(), ties.tolist(), strict=True):
            parts[place] = {k: Fraction(tie) for k, tie in enumerate(row) if tie}
        elements: dict[tuple[int, int], Fraction] = {}
        given = self.rows.tolist(), self.columns.tolist(), self.high.tolist(), self.low.tolist()
        for i, j, high, low in zip(*given, strict=True):
            for (a, one), (b, other) in pairs(parts[i].items(), parts[j].items()):
                if a <= b:
                    term = (Fraction(high) + Fraction(low)) * one * other
                    elements[a, b] = elements.get((a, b), Fraction(0)) + term
        return SymmetricMatrix.from_fractions(size, elements)

    def with_spring(self, row: Array, factor: float) -> SymmetricMatrix:
        """The matrix plus ``factor * outer(row, row)``, to double-double accuracy."""
        dense = DoubleDouble(self.dense.copy(), np.zeros((self.size, self.size)))
        dense.low[self.rows, self.columns] = self.low
        some = np.flatnonzero(row)
        here, own = np.ix_(some, some), row[some]
        term = scale(two_product(own[:, None], own[None]), np.full((1, 1), factor))
        summed = add(DoubleDouble(*(part[here] for part in dense)), term)
        for part, value in zip(dense, summed, strict=True):
            part[here] = value
        rows, columns = np.nonzero(dense.high)
        high, low = (part[rows, columns] for part in dense)
        return SymmetricMatrix(self.size, rows, columns, high, low)

    @cached_property
    def _layers(self) -> list[_Layer]:
        """The elements sorted into layers with at most one element of each row."""
        rank = np.arange(len(self.rows)) - np.searchsorted(self.rows, self.rows)
        layers = []
        for chosen in (rank == number for number in range(int(rank.max(initial=-1)) + 1)):
            element = DoubleDouble(self.high[chosen][:, None], self.low[chosen][:, None])
            layers.append(_Layer(self.rows[chosen], self.columns[chosen], element))
        return layers

    @property
    def widest_row(self) -> int:
        """The largest number of nonzero elements in one row."""
        return len(self._layers)

    def times(self, x: Array) -> DoubleDouble:
        """The product with an array of doubles, shape (N, m), to double-double accuracy.

        The error is below ``(widest_row + 4) * ROUNDING * (abs(A) @ abs(x))``, elementwise. A full
        matrix is cut into slices for BLAS; then the bound has the largest elements of the rows of A
        and of the columns of x.
        """
        if len(self.rows) * 8 > self.size**2 and self.size > 64:
            return self._times_by_slices(x)
        product = DoubleDouble(np.zeros_like(x), np.zeros_like(x))
        for start in range(0, x.shape[1], BLOCK):
            chosen = slice(start, start + BLOCK)
            block = self._times_by_elements(np.ascontiguousarray(x[:, chosen]))
            product.high[:, chosen], product.low[:, chosen] = block
        return product

    def _times_by_elements(self, x: Array) -> DoubleDouble:
        high, low = np.zeros_like(x), np.zeros_like(x)
        for rows, places, element in self._layers:
            term = scale(element, x[places])
            high[rows], low[rows] = add(DoubleDouble(high[rows], low[rows]), term)
        return DoubleDouble(high, low)

    def _times_by_slices(self, x: Array) -> DoubleDouble:
        total = exact_slices_product(self.dense, x)
        low = np.zeros((self.size, self.size))
        low[self.rows, self.columns] = self.low
        return quick_two_sum(total.high, total.low + low @ x)


def product_with(a: Array, b: DoubleDouble) -> DoubleDouble:
    """Product of a matrix of doubles and one of double-doubles, to double-double accuracy."""
    return plus(exact_slices_product(a, b.high), a @ b.low)


def product(a: DoubleDouble, b: DoubleDouble, precision: int = FULL) -> DoubleDouble:
    """Product of two matrices of double-doubles; for `precision` see `exact_slices_product`."""
    return plus(exact_slices_product(a.high, b.high, precision), a.high @ b.low + a.low @ b.high)


def exact_slices_product(a: Array, b: Array, precision: int = FULL) -> DoubleDouble:
    """Matrix product to double-double accuracy, or less, by BLAS products (Ozaki's scheme).

    Both factors are cut into slices with so few bits that the products of slices are exact in
    double precision for any order of the sums. These products are then added in double-double
    arithmetic.

    Parameters
    ----------
    a : array, shape (k, n)
    b : array, shape (n, m)
    precision : int
        Bits, at most 110. Half of the bits take a third of the time.

    Returns
    -------
    DoubleDouble, shape (k, m)
        Within about ``n * 2^-104`` times the largest elements of the row of a and the column of b,
        or ``n * 2^-precision`` if this is more.

    References
    ----------
    K. Ozaki, T. Ogita, S. Oishi, S. M. Rump, Error-free transformations of matrix multiplication by
    using fast routines of matrix multiplication, Numer. Algorithms 59 (2012).

    Examples
    --------
    >>> a = np.array([[1.0, 2.0**-70], [0.1, 0.3]])
    >>> exact_slices_product(a, np.ones((2, 1))).low[0, 0] == 2.0**-70
    np.True_
    """
    bits = int((53 - np.ceil(np.log2(a.shape[1] + 1))) // 2)
    wanted = -(-precision // (bits - 1)) + 1
    left = _slices(a, bits, wanted, axis=1)
    right = _slices(b, bits, wanted, axis=0)
    total = DoubleDouble(np.zeros((len(a), b.shape[1])), np.zeros((len(a), b.shape[1])))
    # Smallest products first.
    for order in range(min(wanted, len(left) + len(right) - 1) - 1, -1, -1):
        for first in range(max(0, order - len(right) + 1), min(order + 1, len(left))):
            part = two_sum(total.high, left[first] @ right[order - first])
            total = quick_two_sum(part.high, part.low + total.low)
    return total


def _slices(a: Array, bits: int, wanted: int, axis: int) -> list[Array]:
    """Slices whose sum is the array; each is a power of two times integers of at most 2^bits."""
    slices: list[Array] = []
    rest = a
    while len(slices) < wanted and np.any(rest):
        largest = np.max(np.abs(rest), axis=axis, keepdims=True)
        exponent = np.frexp(largest)[1]
        # The sum with this number is rounded to the last bit of the slice.
        rounder = np.where(largest > 0.0, np.ldexp(0.75, exponent + 53 - bits), 0.0)
        part = (rest + rounder) - rounder
        slices.append(part)
        rest = rest - part
    return slices or [np.zeros_like(a)]


def check_definite(name: str, matrix: Array) -> None:
    """Raise an error if a matrix is not positive definite up to rounding.

    Parameters
    ----------
    name : str
        Name of the matrix in the error message.
    matrix : array, shape (N, N)
        Finite and symmetric.

    Raises
    ------
    ValueError
        When a diagonal element is not positive, or when the matrix, after scaling of rows and
        columns to a diagonal of ones, has an eigenvalue below N ulp.

    Examples
    --------
    >>> check_definite("mass", np.diag([1.0, 0.0]))
    Traceback (most recent call last):
    ...
    ValueError: mass must be positive definite; got 0.0 at [1, 1]
    """
    _check(name, matrix, definite=True)


def check_semidefinite(name: str, matrix: Array) -> None:
    """Raise an error if a matrix is not positive semidefinite up to rounding.

    Parameters
    ----------
    name : str
        Name of the matrix in the error message.
    matrix : array, shape (N, N)
        Finite and symmetric.

    Raises
    ------
    ValueError
        When a diagonal element is negative, or when it is zero in a row that is not zero, or when
        the matrix, after scaling of rows and columns to a diagonal of ones, has an eigenvalue below
        -4 N ulp.

    Examples
    --------
    >>> check_semidefinite("stiffness", np.array([[1.0, -2.0], [-2.0, 1.0]]))
    Traceback (most recent call last):
    ...
    ValueError: stiffness must be positive semidefinite; got the eigenvalue -1.0
    """
    _check(name, matrix, definite=False)


def _check(name: str, matrix: Array, *, definite: bool) -> None:
    wanted = "positive definite" if definite else "positive semidefinite"
    diagonal = np.diagonal(matrix)
    wrong = diagonal <= 0.0 if definite else diagonal < 0.0
    if wrong.any():
        place = int(np.argmax(wrong))
        value = float(diagonal[place])
        raise ValueError(f"{name} must be {wanted}; got {value} at [{place}, {place}]")
    if np.count_nonzero(matrix) == np.count_nonzero(diagonal):
        return
    # Scaling makes the check independent of the units of the coordinates.
    lengths = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = matrix / lengths[:, None] / lengths
    margin = len(matrix) * np.finfo(np.float64).eps * (-1.0 if definite else 4.0)
    try:
        np.linalg.cholesky(scaled + margin * np.eye(len(matrix)))
    except np.linalg.LinAlgError:
        # Rounding may make the factorisation fail if an eigenvalue is close to the margin.
        if float(np.linalg.eigvalsh(scaled)[0]) < -margin:
            lowest = float(np.linalg.eigvalsh(matrix)[0])
            raise ValueError(f"{name} must be {wanted}; got the eigenvalue {lowest:.6}") from None


class Traction(NamedTuple):
    """Forces along p directions, each a combination of the forces of springs and dashpots.

    They add ``along @ damping`` to the damping matrix and ``along @ stiffness`` to the stiffness
    matrix; the sums are not symmetric.

    Attributes
    ----------
    along : (N, p)
    damping, stiffness : (p, N), double-double
    """

    along: Array
    damping: DoubleDouble
    stiffness: DoubleDouble

    @staticmethod
    def of(
        along: Array, weights: Array, damping: SymmetricMatrix, stiffness: SymmetricMatrix
    ) -> Traction:
        """Return the forces ``along @ weights @ (C x' + K x)``, with weights (p, N)."""
        own = np.ascontiguousarray(weights.T)
        parts = (part.times(own) for part in (damping, stiffness))
        return Traction(along, *(DoubleDouble(high.T, low.T) for high, low in parts))

    def without(self, places: NDArray[np.intp], ties: Array | None) -> Traction:
        """Return the forces if coordinates (h,) are zero, or follow the m others by ties (h, m)."""
        others = np.delete(np.arange(len(self.along)), places)
        along, parts = self.along[others], []
        if ties is not None:
            along = along + ties.T @ self.along[places]
        for whole in self[1:]:
            part = DoubleDouble(*(own[:, others] for own in whole))
            for place, tie in zip(places.tolist(), () if ties is None else ties, strict=False):
                term = DoubleDouble(*(own[:, [place]] for own in whole))
                part = add(part, scale(term, tie[None]))
            parts.append(part)
        return Traction(along, *parts)


def product_of(a: DoubleDouble, b: Array) -> DoubleDouble:
    """Product (p, m) of a double-double matrix (p, N) with one of doubles (N, m)."""
    product = exact_slices_product(a.high, b)
    low = a.low @ b
    return add(product, DoubleDouble(low, np.zeros_like(low)))
