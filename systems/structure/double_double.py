"""Arrays of double-double numbers: the unevaluated sum of two doubles, about 32 decimal digits.

Every operation works elementwise on whole arrays and costs as much as 10 to 30 operations on
doubles. The relative error of each result is a few times 2^-106, unless there is an overflow or
underflow; callers avoid these by scaling with powers of two.

References
----------
T. J. Dekker, A floating-point technique for extending the available precision, Numer. Math. 18
(1971). M. Joldes, J.-M. Muller, V. Popescu, Tight and rigorous error bounds for basic building
blocks of double-word arithmetic, ACM Trans. Math. Softw. 44 (2017), algorithms 6, 12 and 17.
"""

from typing import NamedTuple

import numpy as np

from dynkit.core.validation import Array

# Veltkamp's constant 2^27 + 1 splits the 53 bits of a double into 26 and 26 (one is in the sign).
_SPLITTER = 134217729.0

ROUNDING = 2.0**-104
"""Bound of the relative error of one operation, slightly larger than the proved bounds."""


class DoubleDouble(NamedTuple):
    """The sum `high` + `low` of two arrays of one shape; `high` is the double nearest to it."""

    high: Array
    low: Array


def two_sum(a: Array, b: Array) -> DoubleDouble:
    """Sum of two doubles, exactly (Knuth).

    Examples
    --------
    >>> two_sum(np.array([1.0]), np.array([2.0**-60])).low[0] == 2.0**-60
    np.True_
    """
    total = a + b
    part = total - a
    return DoubleDouble(total, (a - (total - part)) + (b - part))


def quick_two_sum(a: Array, b: Array) -> DoubleDouble:
    """Sum of two doubles, exactly, where ``abs(a) >= abs(b)`` or a is zero (Dekker)."""
    total = a + b
    return DoubleDouble(total, b - (total - a))


def split(a: Array) -> tuple[Array, Array]:
    """Two parts of at most 26 bits each, whose sum is the given double (Veltkamp)."""
    scaled = _SPLITTER * a
    top = scaled - (scaled - a)
    return top, a - top


def two_product(a: Array, b: Array) -> DoubleDouble:
    """Product of two doubles, exactly (Dekker).

    Examples
    --------
    >>> square = two_product(np.array([0.1]), np.array([0.1]))
    >>> from fractions import Fraction
    >>> Fraction(float(square.high[0])) + Fraction(float(square.low[0])) == Fraction(0.1) ** 2
    True
    """
    (a_top, a_rest), (b_top, b_rest) = split(a), split(b)
    product = a * b
    error = a_top * b_top - product
    error += a_top * b_rest
    error += a_rest * b_top
    error += a_rest * b_rest
    return DoubleDouble(product, error)


def add(x: DoubleDouble, y: DoubleDouble) -> DoubleDouble:
    """Sum of two double-double arrays (Joldes, algorithm 6)."""
    high = two_sum(x.high, y.high)
    low = two_sum(x.low, y.low)
    first = quick_two_sum(high.high, high.low + low.high)
    return quick_two_sum(first.high, low.low + first.low)


def plus(x: DoubleDouble, y: Array) -> DoubleDouble:
    """Sum of a double-double array and an array of doubles."""
    high = two_sum(x.high, y)
    return quick_two_sum(high.high, x.low + high.low)


def negative(x: DoubleDouble) -> DoubleDouble:
    """The array with its sign changed."""
    return DoubleDouble(-x.high, -x.low)


def multiply(x: DoubleDouble, y: DoubleDouble) -> DoubleDouble:
    """Product of two double-double arrays (Joldes, algorithm 12)."""
    product = two_product(x.high, y.high)
    return quick_two_sum(product.high, product.low + (x.high * y.low + x.low * y.high))


def scale(x: DoubleDouble, factor: Array) -> DoubleDouble:
    """Product of a double-double array and an array of doubles."""
    product = two_product(x.high, factor)
    return quick_two_sum(product.high, product.low + x.low * factor)


def divide(x: DoubleDouble, y: DoubleDouble) -> DoubleDouble:
    """Quotient of two double-double arrays, by long division (Joldes, algorithm 17)."""
    first = x.high / y.high
    rest = add(x, negative(scale(y, first)))
    return quick_two_sum(first, rest.high / y.high)


def square_root(x: DoubleDouble) -> DoubleDouble:
    """Square root of a double-double array without negative elements; that of zero is zero."""
    first = np.sqrt(x.high)
    rest = add(x, negative(two_product(first, first)))
    correction = np.divide(rest.high, 2.0 * first, out=np.zeros_like(first), where=first > 0.0)
    return quick_two_sum(first, correction)


def column_sums(x: DoubleDouble) -> DoubleDouble:
    """Sums over the first axis, pairwise: the error grows with the logarithm of its length."""
    while len(x.high) > 1:
        half = len(x.high) // 2
        folded = add(
            DoubleDouble(x.high[:half], x.low[:half]),
            DoubleDouble(x.high[half : 2 * half], x.low[half : 2 * half]),
        )
        if len(x.high) % 2:
            high = np.concatenate([folded.high, x.high[-1:]])
            folded = DoubleDouble(high, np.concatenate([folded.low, x.low[-1:]]))
        x = folded
    return DoubleDouble(x.high[0], x.low[0])


def column_dots(x: Array, y: DoubleDouble) -> DoubleDouble:
    """Scalar products of the columns of x with those of y, both of shape (N, m): shape (m,)."""
    return column_sums(scale(y, x))


def columns(x: DoubleDouble, chosen: slice) -> DoubleDouble:
    """Some columns of a double-double matrix."""
    return DoubleDouble(x.high[:, chosen], x.low[:, chosen])


def power_of_two(x: DoubleDouble, exponent: int) -> DoubleDouble:
    """The array times a power of two: exact unless there is an overflow or underflow."""
    return DoubleDouble(np.ldexp(x.high, exponent), np.ldexp(x.low, exponent))
