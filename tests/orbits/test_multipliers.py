"""Eigenvalues of long products are right relative to themselves, however the product is cut."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from dynkit.core.validation import Array
from dynkit.orbits.multipliers import product_eigenvalues

ROUNDING = 2.0**-52


def exact_eigenvalues(factors: Array) -> list[mpmath.mpc]:
    """Of the product of these very floats, in 150 digits."""
    with mpmath.workdps(150):
        product = mpmath.eye(factors.shape[1])
        for factor in factors:
            product = mpmath.matrix(factor.tolist()) * product
        return list(mpmath.eig(product, left=False, right=False))


def largest_relative_error(factors: Array) -> float:
    left = exact_eigenvalues(factors)
    errors = []
    with mpmath.workdps(150):
        for found in product_eigenvalues(factors):
            off = [abs(value - mpmath.mpc(complex(found))) for value in left]
            nearest = min(range(len(left)), key=off.__getitem__)
            errors.append(float(off[nearest] / abs(left.pop(nearest))))
    return max(errors)


def orthogonal(rng: np.random.Generator, d: int) -> Array:
    return np.asarray(np.linalg.qr(rng.normal(size=(d, d)))[0])


def cycle(bases: list[Array], middles: Array) -> Array:
    """Factors B_{k+1} M_k B_k^-1 with B_n = B_0: their product is similar to that of the M_k."""
    following = [*bases[1:], bases[0]]
    return np.array(
        [
            after @ middle @ np.linalg.inv(before)
            for before, middle, after in zip(bases, middles, following, strict=True)
        ]
    )


def first_order_bound(bases: list[Array], sizes: Array, factors: Array) -> float:
    """Relative change of any eigenvalue when every factor changes by 10 d units of rounding.

    A change E of B_{k+1} D B_k^-1 changes the i-th eigenvalue, relative, by (B_{k+1}^-1 E B_k)_ii
    / D_ii.
    """
    following = [*bases[1:], bases[0]]
    norm = np.linalg.norm
    changes = [
        norm(np.linalg.inv(after), 2) * norm(factor, 2) * norm(before, 2) / abs(size).min()
        for before, after, size, factor in zip(bases, following, sizes, factors, strict=True)
    ]
    return float(10.0 * factors.shape[1] * ROUNDING * np.sum(changes))


@pytest.mark.parametrize("decades", [1.0, 5.0, 30.0])
@pytest.mark.parametrize(("n", "d"), [(2, 2), (100, 2), (50, 4), (100, 6), (10, 12)])
def test_large_and_small_ones_are_right_relative_to_themselves(
    n: int, d: int, decades: float
) -> None:
    rng = np.random.default_rng(n + d)
    bases = [rng.normal(size=(d, d)) for _ in range(n)]
    sizes = 10.0 ** (np.linspace(decades, -decades, d) / n) * rng.choice([-1.0, 1.0], (n, d))
    factors = cycle(bases, np.array([np.diag(size) for size in sizes]))
    assert largest_relative_error(factors) < first_order_bound(bases, sizes, factors)


@pytest.mark.parametrize("d", [2, 3, 6])
@pytest.mark.plain
def test_random_factors(d: int) -> None:
    rng = np.random.default_rng(d)
    for _ in range(5):
        factors = rng.normal(size=(30, d, d))
        # random factors grow by some ten a step in any direction that the next one needs
        conditions = sum(np.linalg.cond(factor) for factor in factors)
        assert largest_relative_error(factors) < 10.0 * d * ROUNDING * conditions


@pytest.mark.parametrize("gap", [1e-2, 1e-6, 1e-10, 0.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.plain
def test_nearly_equal_moduli(gap: float, sign: float) -> None:
    rng = np.random.default_rng(1)
    n = 20
    middles = np.array([np.diag([1.0, sign * (1.0 + gap / n), 0.5])] * n)
    factors = cycle([orthogonal(rng, 3) for _ in range(n)], middles)
    # of a normal product with factors that are at most twice as large in one direction
    found = np.sort(product_eigenvalues(factors).real)[::-1]
    expected = np.sort([1.0, (sign * (1.0 + gap / n)) ** n, 0.5**n])[::-1]
    assert found == pytest.approx(expected, rel=10.0 * 3 * ROUNDING * 2.0 * n)


@pytest.mark.parametrize("radius", [1.0 - 1e-9, 1.0, 1.0 + 1e-9])
@pytest.mark.parametrize("angle", [1e-3, 0.3, 1.5, 3.1])
@pytest.mark.plain
def test_complex_pairs_are_conjugate_to_the_last_bit(radius: float, angle: float) -> None:
    rng = np.random.default_rng(2)
    n = 12
    c, s = np.cos(angle / n), np.sin(angle / n)
    middle = np.diag([radius ** (1.0 / n)] * 2 + [0.1, 3.0])
    middle[:2, :2] @= np.array([[c, -s], [s, c]])
    factors = cycle([orthogonal(rng, 4) for _ in range(n)], np.array([middle] * n))
    found = product_eigenvalues(factors)
    assert found[1] == np.conj(found[2])
    assert found[1].imag > 0.0
    assert found[0].imag == found[3].imag == 0.0
    # in a normal product; the factors' condition is thirty
    allowed = 10.0 * 4 * ROUNDING * n * 30.0
    assert abs(found[1] - radius * np.exp(1j * angle)) < allowed
    assert found[[0, 3]].real == pytest.approx([3.0**n, 0.1**n], rel=allowed)


@pytest.mark.parametrize("inside", [True, False])
@pytest.mark.parametrize("segments", [1, 2, 3, 4, 6, 12, 24])
@pytest.mark.plain
def test_stability_does_not_depend_on_the_number_of_segments(segments: int, inside: bool) -> None:
    rng = np.random.default_rng(3)
    n, largest = 24, 1.0 - 1e-11 if inside else 1.0 + 1e-11
    # 1e-4 at the least: even the product in one piece has all of its digits there
    sizes = np.array([largest, -0.9, 0.3, 1e-4])
    roots = np.sign(sizes) * abs(sizes) ** (1.0 / n)
    middles = np.array([np.diag(abs(roots))] * (n - 1) + [np.diag(roots)])
    factors = cycle([orthogonal(rng, 4) for _ in range(n)], middles)
    pieces = [
        np.linalg.multi_dot([np.eye(4), *piece[::-1]]) for piece in np.split(factors, segments)
    ]
    found = product_eigenvalues(pieces)
    assert bool(abs(found[0]) < 1.0) is inside
    assert found.real[:3] == pytest.approx(sizes[:3], rel=1e-12)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.plain
def test_defective_ones_are_right_to_half_of_the_digits(turned: bool) -> None:
    rng = np.random.default_rng(4)
    n = 10
    bases = [orthogonal(rng, 2) if turned else np.eye(2) for _ in range(n)]
    found = product_eigenvalues(cycle(bases, np.array([[[1.0, 1.0], [0.0, 1.0]]] * n)))
    # the square of the error is the change of the lower left entry times the n of the upper right
    assert abs(found - 1.0).max() <= np.sqrt(10.0 * 2 * ROUNDING * 3.0 * n * n)


@pytest.mark.parametrize("growth", [1e2, 1e4, 1e6])
@pytest.mark.plain
def test_growth_that_is_taken_back_costs_what_rounding_costs(growth: float) -> None:
    rng = np.random.default_rng(5)
    shear = np.array([[1.0, growth], [0.0, 1.0]])
    back = np.array([[1.0, -growth], [0.0, 1.0]])
    for _ in range(10):
        factors = np.array([shear, rng.normal(size=(2, 2)), back])
        # each factor changes by rounding of its norm; the others, and the eigenvectors, enlarge it
        eigenvectors = np.linalg.cond(np.linalg.eig(factors[1])[1])
        allowed = 30.0 * ROUNDING * growth**2 * eigenvectors * np.linalg.cond(factors[1])
        assert largest_relative_error(factors) < allowed


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.plain
def test_a_zero_factor_makes_all_of_them_zero(place: int) -> None:
    factors = np.random.default_rng(6).normal(size=(3, 4, 4))
    factors[place] = 0.0
    assert not product_eigenvalues(factors).any()


@pytest.mark.parametrize("count", [1, 2, 5, 6])
@pytest.mark.plain
def test_a_nilpotent_product_has_zeros_only(count: int) -> None:
    chain = np.diag(np.ones(4), 1)
    assert not product_eigenvalues([chain] * count + [np.eye(5)]).any()
    assert not product_eigenvalues([chain.T] * count + [np.eye(5)]).any()


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.plain
def test_singular_factors_with_exact_zeros(seed: int) -> None:
    rng = np.random.default_rng(seed)
    factors = np.rint(3.0 * rng.normal(size=(4, 4, 4)))
    factors[seed % 4, :, 1] = 0.0
    factors[(seed + 1) % 4, 2] = 0.0
    found = product_eigenvalues(factors)
    product = np.linalg.multi_dot(factors[::-1])
    size = float(np.prod([np.linalg.norm(factor, 2) for factor in factors]))
    # sums of powers are polynomials of the factors
    powers = [np.sum(found**k) for k in (1, 2, 3, 4)]
    exact = [np.trace(np.linalg.matrix_power(product, k)) for k in (1, 2, 3, 4)]
    for k in range(4):
        assert abs(powers[k] - exact[k]) <= 100.0 * ROUNDING * size ** (k + 1)


def test_no_spread_makes_it_fail() -> None:
    rng = np.random.default_rng(7)
    for trial in range(2000):
        n, d = (int(k) for k in rng.integers(2, 7, 2))
        factors = rng.normal(size=(n, d, d))
        shape = [(n, 1, d), (n, d, 1), (n, 1, 1)][trial % 3]
        factors *= 10.0 ** rng.uniform(-5.0, 5.0, size=shape)
        if trial % 5 == 0:
            factors *= rng.random(factors.shape) < 0.5
        found = product_eigenvalues(factors)
        # the determinant is the product of those of the factors
        _, logs = np.linalg.slogdet(factors)
        if np.isfinite(logs).all() and trial % 5:
            # a factor's log is wrong by the rounding over its smallest singular value
            allowed = 1e3 * ROUNDING * sum(np.linalg.cond(factor) for factor in factors)
            assert abs(np.log(abs(found)).sum() - logs.sum()) < allowed


@pytest.mark.plain
def test_permutations_keep_their_modulus() -> None:
    found = product_eigenvalues([np.roll(np.eye(5), 1, axis=0)] * 3)
    assert abs(found) == pytest.approx(1.0, abs=10.0 * 5 * 3 * ROUNDING)
    assert np.sort(np.angle(found)) == pytest.approx(2 * np.pi / 5 * np.arange(-2, 3), abs=1e-14)


@given(st.integers(1, 6), st.integers(1, 5), st.integers(0, 5), st.integers(0, 10**6))
@settings(max_examples=50, deadline=None)
def test_where_the_product_begins_does_not_matter(n: int, d: int, begin: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    factors = np.array([orthogonal(rng, d) + 0.3 * orthogonal(rng, d) for _ in range(n)])
    here = product_eigenvalues(factors)
    there = product_eigenvalues(np.roll(factors, begin, axis=0))
    # sums of powers, as the order of equal moduli is rounding; each factor has condition < 2
    for power in (1, 2):
        size = 1.3 ** (n * power)
        allowed = 100.0 * ROUNDING * n * d * d * power * 2.0**n * size
        assert abs((here**power).sum() - (there**power).sum()) < allowed


def test_factors_beyond_the_range_of_floats_together_have_products_within() -> None:
    large = 2.0**500
    factors = [np.diag([-large, 1.0, 1 / large]), np.diag([1 / large, 1.0, large])] * 1001
    assert np.sort(product_eigenvalues(factors).real) == pytest.approx([-1.0, 1.0, 1.0])
    assert product_eigenvalues([[[1e300]], [[1e300]], [[-1e-300]]]) == pytest.approx([-1e300])


@pytest.mark.plain
def test_what_is_too_large_is_infinite_and_what_is_too_small_is_zero() -> None:
    found = product_eigenvalues([np.diag([1e150, 1.0, 1e-150])] * 3)
    assert found.tolist() == [np.inf, 1.0, 0.0]


@pytest.mark.plain
def test_a_single_factor_takes_the_short_way() -> None:
    matrix = np.random.default_rng(8).normal(size=(5, 5))
    expected = np.linalg.eigvals(matrix)
    found = product_eigenvalues(matrix[None])
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(expected), rel=4 * ROUNDING)
    assert (np.diff(abs(found)) <= 0.0).all()


@pytest.mark.plain
def test_numbers_are_multiplied() -> None:
    assert product_eigenvalues([[[2.0]], [[-3.0]], [[0.25]]]).tolist() == [-1.5]


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        (np.zeros((0, 2, 2)), "factors must be square matrices, one at least; got shape"),
        (np.zeros((3, 2, 4)), "factors must be square matrices, one at least; got shape"),
        (np.zeros((2, 2)), "factors must have 3 dimensions"),
        (np.full((2, 2, 2), np.nan), r"factors\[0, 0, 0\] must be a finite number; got nan"),
    ],
)
def test_bad_factors_are_refused(factors: Array, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        product_eigenvalues(factors)
