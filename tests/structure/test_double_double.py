from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, strategies as st

from dynkit.core.validation import Array
from dynkit.systems.structure.double_double import (
    ROUNDING,
    DoubleDouble,
    add,
    column_dots,
    column_sums,
    divide,
    multiply,
    power_of_two,
    scale,
    square_root,
    two_product,
    two_sum,
)
from dynkit.systems.structure.symmetric import SymmetricMatrix, exact_slices_product

NUMBERS = st.floats(min_value=1e-60, max_value=1e60) | st.floats(min_value=-1e60, max_value=-1e-60)


def exact(x: DoubleDouble, index: int | tuple[int, int] = 0) -> Fraction:
    return Fraction(float(x.high[index])) + Fraction(float(x.low[index]))


def pair(high: float, share: float) -> DoubleDouble:
    """A double-double whose low part is a share of half an ulp of the high one."""
    return DoubleDouble(np.array([high]), np.array([share * 0.49 * float(np.spacing(high))]))


PAIRS = st.builds(pair, NUMBERS, st.floats(-1.0, 1.0))


def relative(found: Fraction, wanted: Fraction) -> float:
    return float(abs(found - wanted) / abs(wanted)) if wanted else float(abs(found))


@given(NUMBERS, NUMBERS)
def test_a_sum_of_doubles_is_exact(a: float, b: float) -> None:
    assert exact(two_sum(np.array([a]), np.array([b]))) == Fraction(a) + Fraction(b)


@given(NUMBERS, NUMBERS)
def test_a_product_of_doubles_is_exact(a: float, b: float) -> None:
    assert exact(two_product(np.array([a]), np.array([b]))) == Fraction(a) * Fraction(b)


@given(PAIRS, PAIRS)
def test_sums_lose_no_more_than_stated(x: DoubleDouble, y: DoubleDouble) -> None:
    assert relative(exact(add(x, y)), exact(x) + exact(y)) <= ROUNDING


@given(PAIRS, PAIRS)
def test_products_lose_no_more_than_stated(x: DoubleDouble, y: DoubleDouble) -> None:
    assert relative(exact(multiply(x, y)), exact(x) * exact(y)) <= ROUNDING


@given(PAIRS, NUMBERS)
def test_products_with_doubles_lose_no_more_than_stated(x: DoubleDouble, y: float) -> None:
    assert relative(exact(scale(x, np.array([y]))), exact(x) * Fraction(y)) <= ROUNDING


@given(PAIRS, PAIRS)
def test_quotients_lose_no_more_than_stated(x: DoubleDouble, y: DoubleDouble) -> None:
    assert relative(exact(divide(x, y)), exact(x) / exact(y)) <= ROUNDING


@given(st.builds(pair, st.floats(1e-60, 1e60), st.floats(-1.0, 1.0)))
def test_square_roots_lose_no_more_than_stated(x: DoubleDouble) -> None:
    assert relative(exact(square_root(x)) ** 2, exact(x)) <= 2.0 * ROUNDING


def test_the_square_root_of_zero_is_zero() -> None:
    root = square_root(DoubleDouble(np.zeros(1), np.zeros(1)))
    assert (root.high[0], root.low[0]) == (0.0, 0.0)


def test_powers_of_two_are_exact() -> None:
    x = pair(0.1, 0.7)
    assert exact(power_of_two(x, -7)) == exact(x) / 128


@pytest.mark.parametrize("length", [1, 2, 3, 7, 64, 101])
def test_column_sums_hold_in_spite_of_cancellation(length: int) -> None:
    rng = np.random.default_rng(length)
    x = two_product(rng.normal(size=(length, 2)), rng.normal(size=(length, 2)))
    wanted = sum((exact(x, (i, 1)) for i in range(length)), Fraction(0))
    size = float(np.sum(np.abs(x.high[:, 1])))
    assert abs(exact(column_sums(x), 1) - wanted) <= 10 * ROUNDING * size


def test_scalar_products_are_those_of_the_columns() -> None:
    x = np.array([[1.0, 2.0], [3.0, 4.0]])
    found = column_dots(x, DoubleDouble(np.array([[1.0, 1.0], [1.0, 2.0]]), np.zeros((2, 2))))
    assert found.high.tolist() == [4.0, 10.0]


def exact_product(a: Array, b: Array, place: tuple[int, int]) -> Fraction:
    pairs = zip(a[place[0]].tolist(), b[:, place[1]].tolist(), strict=True)
    return sum((Fraction(x) * Fraction(y) for x, y in pairs), Fraction(0))


@pytest.mark.parametrize("size", [1, 5, 80])
@pytest.mark.parametrize("spread", [0.0, 12.0])
def test_products_by_slices_reach_double_double_precision(size: int, spread: float) -> None:
    rng = np.random.default_rng(size)
    a, b = (
        rng.normal(size=(size, size)) * 10 ** rng.uniform(0, spread, (size, size)) for _ in "ab"
    )
    found = exact_slices_product(a, b)
    for place in [(0, 0), (size - 1, size // 2)]:
        bound = size * float(np.max(np.abs(a[place[0]])) * np.max(np.abs(b[:, place[1]])))
        assert abs(exact(found, place) - exact_product(a, b, place)) <= ROUNDING * bound


def test_a_product_of_zeros_is_zero() -> None:
    assert not exact_slices_product(np.zeros((2, 2)), np.ones((2, 2))).high.any()


@pytest.mark.parametrize("size", [4, 80])
def test_full_and_sparse_matrices_multiply_alike(size: int) -> None:
    rng = np.random.default_rng(3)
    a = rng.normal(size=(size, size))
    a += a.T
    found = SymmetricMatrix.from_dense(a).times(a)
    bound = size * ROUNDING * float(np.max(np.abs(a))) ** 2
    assert abs(exact(found, (1, 2)) - exact_product(a, a, (1, 2))) <= bound


def test_a_sparse_product_holds_the_low_parts() -> None:
    matrix = SymmetricMatrix.from_fractions(1, {(0, 0): 1 + Fraction(1, 2**80)})
    found = matrix.times(np.array([[3.0]]))
    assert exact(found, (0, 0)) == 3 + Fraction(3, 2**80)
