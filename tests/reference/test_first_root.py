"""Certified first roots agree with closed forms, and with the verification of many at once."""

from math import acos, asin, cos, pi, sin, sqrt

import mpmath
import numpy as np
import pytest
from flint import arb, ctx
from mpmath import mp, mpf
from numpy.typing import NDArray

from tests.reference.first_root import FirstRoot, evaluate, first_root
from tests.reference.verify import Verification, verify_first_root

Array = NDArray[np.float64]

DEPTHS = [sign * 10.0**-k for k in range(3, 16) for sign in (1, -1)]


def found_time(result: FirstRoot) -> float:
    """The root as a double, from a result that must have one."""
    assert result.root is not None
    return float(result.root.mid())


# --------------------------------------------------------------------------------------- first root


@pytest.mark.parametrize("start", [0.3, 1.0, 2.5])
def test_first_root_of_one_cosine(start: float) -> None:
    result = first_root(0.25, [start], [0.0], [1.5], [0.0], horizon=10.0)
    expected = acos(-0.25 / start) / 1.5 if start > 0.25 else None
    assert found_time(result) == pytest.approx(expected, abs=1e-15)


def test_first_root_is_enclosed_narrower_than_1e_30() -> None:
    result = first_root(0.25, [1.0], [0.0], [1.5], [0.0], horizon=10.0)
    assert result.root is not None
    assert float(result.root.rad()) < 1e-30
    with mp.workdps(50):
        assert abs(mpf(result.root.mid()) - mpmath.acos(-mpf(1) / 4) / mpf("1.5")) < mpf("1e-30")


def test_first_root_of_a_damped_oscillator() -> None:
    # f = exp(-s/4) cos(W s) + exp(-s/4) sin(W s) / (4 W), at rest at 1: zero where tan = -4 W.
    rate = sqrt(1.0 - 0.25**2)
    result = first_root(0.0, [1.0], [0.0], [1.0], [0.25], horizon=10.0)
    assert found_time(result) == pytest.approx((pi - asin(rate)) / rate, abs=2e-15)


def test_critically_damped_root() -> None:
    # exp(-s) (1 + (v + 1) s) with v = -3: zero at s = 1/2.
    result = first_root(0.0, [1.0], [-3.0], [1.0], [1.0], horizon=5.0)
    assert found_time(result) == pytest.approx(0.5, abs=1e-16)


def test_overdamped_root() -> None:
    # roots -1/2 and -2 (w = 1, sigma = 5/4): a exp(-s/2) + b exp(-2 s), a + b = 1, a = -1/3.
    rate = 1.0 / 6.0 - 8.0 / 3.0
    result = first_root(0.0, [1.0], [rate], [1.0], [1.25], horizon=10.0)
    assert found_time(result) == pytest.approx(2.0 * np.log(4.0) / 3.0, abs=1e-15)


def test_stiff_mode_hides_no_root() -> None:
    # Time constants 1e-5 and 1e3 in one overdamped term (w = 10, sigma = 5e4).
    result = first_root(-0.5, [1.0, 0.4], [0.0, 1.0], [10.0, 1.0], [5e4, 0.0], horizon=5.0)
    claim = found_time(result)
    verdict = verify_first_root(
        [claim], [-0.5], [[1.0, 0.4]], [[0.0, 1.0]], [10.0, 1.0], [5e4, 0.0], horizon=5.0
    )
    assert verdict.right.all()


def test_terms_without_frequency_are_straight_lines() -> None:
    result = first_root(0.0, [3.0], [-2.0], [0.0], [0.0], horizon=5.0)
    assert found_time(result) == 1.5


def test_no_root_reports_the_certified_minimum() -> None:
    result = first_root(1.5, [-1.0], [0.0], [1.0], [0.0], horizon=10.0)
    assert result.kind == "none"
    assert result.minimum is not None
    assert result.minimum.contains(arb(0.5))
    assert result.minimum_at is not None
    assert float(result.minimum_at.mid()) == pytest.approx(2.0 * pi, abs=1e-15)


def test_exact_tangency_is_reported_as_touch() -> None:
    result = first_root(1.0, [-1.0], [0.0], [1.0], [0.0], horizon=10.0, leading=(0.0, 0.0))
    assert result.kind == "touch"
    assert found_time(result) == pytest.approx(2.0 * pi, abs=1e-15)


@pytest.mark.parametrize("depth", DEPTHS)
def test_grazing_cosine_is_decided_at_every_depth(depth: float) -> None:
    # f = 1 + depth - cos(s - 2): minimum exactly (1 + depth) - 1 at s = 2; the small part of the
    # constant stands apart as a term of frequency 0, so that no digit of it is lost.
    with ctx.workprec(256):
        value, rate = -arb(2).cos(), -arb(2).sin()
        result = first_root(1, [value, depth], [rate, 0], [1, 0], [0, 0], horizon=6.0)
    if depth > 0:
        assert result.kind == "none"
        assert result.minimum is not None
        assert float(result.minimum.mid()) == pytest.approx(depth, rel=1e-15)
    else:
        assert found_time(result) == pytest.approx(2.0 - 2.0 * asin(sqrt(-depth / 2)), abs=1e-15)
        assert result.depth is not None
        assert float(result.depth.mid()) == pytest.approx(depth, rel=1e-15)


@pytest.mark.parametrize("u", [1e-12, 1e-6, 0.01, 1.0])
def test_root_at_zero_is_divided_out(u: float) -> None:
    # f = cos(s) - 1 + u sin(s): zero at 2 atan(u).
    result = first_root(-1.0, [1.0], [u], [1.0], [0.0], horizon=6.0, leading=(0.0, u))
    assert found_time(result) == pytest.approx(2.0 * np.arctan(u), rel=1e-15)


def test_leading_derivatives_override_the_rounding_of_the_sum() -> None:
    # 0.1 + 0.2 - 0.3 is not 0 in doubles: without the override the start lies above the table.
    terms = -0.3, [0.1, 0.2], [1e-20, 0.0], [1.0, 2.0], [0.0, 0.0]
    result = first_root(*terms, horizon=1.0, leading=(0.0, 1e-10))
    # u s - a s^2 / 2 with a = 0.1 + 4 * 0.2.
    assert found_time(result) == pytest.approx(2e-10 / 0.9, rel=1e-14)


def test_release_starts_with_a_triple_root() -> None:
    # s - sin(s) = s^3/6 - ..., minus a slow pull that brings it back.
    result = first_root(0, [0, 0], [1, -1], [0, 1], [0, 0], horizon=9.0, leading=(0.0, 0.0, 0.0))
    assert result.kind == "none"


def test_a_start_below_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="positive just after s = 0"):
        first_root(-2.0, [1.0], [0.0], [1.0], [0.0], horizon=1.0)


def test_evaluate_encloses_the_sum() -> None:
    result = evaluate(2.0, 0.5, [1.0], [0.0], [3.0], [0.0])
    with mp.workdps(60):
        assert abs(mpf(result.mid()) - (mpf("0.5") + mpmath.cos(6))) < mpf("1e-50")


# ------------------------------------------------------------------------------------- verification


class RandomCases:
    """Gaps of the paper's chain at random states, some oscillators over- and critically damped."""

    def __init__(self, count: int, seed: int) -> None:
        random = np.random.default_rng(seed)
        index = np.arange(1, 11)
        chain = 2.0 * np.sin((2 * index - 1) * pi / 42.0)
        table = random.uniform(0.14, 2.0, count)
        self.w = np.column_stack((np.tile(chain, (count, 1)), table))
        self.sigma = np.column_stack((np.tile(0.05 * chain**2, (count, 1)), np.zeros(count)))
        self.sigma[::4, :10] *= 10.0 ** random.uniform(-2, 2, self.sigma[::4, :10].shape)
        self.sigma[::8, 3] = self.w[::8, 3]
        self.value = random.normal(size=(count, 11)) * np.append(0.1 / chain, 0.1)
        self.rate = random.normal(size=(count, 11)) * 0.1
        self.offset = np.maximum(0.0, -self.value.sum(axis=1)) + random.uniform(0.01, 1.0, count)
        self.horizon = 20.0

    def truth(self, i: int) -> FirstRoot:
        return first_root(
            self.offset[i],
            self.value[i].tolist(),
            self.rate[i].tolist(),
            self.w[i].tolist(),
            self.sigma[i].tolist(),
            horizon=self.horizon,
        )

    def verify(self, claim: Array) -> Verification:
        return verify_first_root(
            claim, self.offset, self.value, self.rate, self.w, self.sigma, horizon=self.horizon
        )


@pytest.fixture(scope="module")
def cases() -> RandomCases:
    return RandomCases(200, seed=7)


@pytest.fixture(scope="module")
def truth(cases: RandomCases) -> Array:
    results = [cases.truth(i) for i in range(200)]
    return np.array([np.inf if r.root is None else float(r.root.mid()) for r in results])


def test_verification_accepts_certified_roots(cases: RandomCases, truth: Array) -> None:
    assert cases.verify(truth).right.all()


def test_verification_measures_half_an_ulp_at_most(cases: RandomCases, truth: Array) -> None:
    error = cases.verify(truth).error_ulp
    assert np.abs(error[np.isfinite(truth)]).max() <= 0.5 + 1e-9


def test_verification_measures_a_shift_of_three_ulp(cases: RandomCases, truth: Array) -> None:
    finite = np.isfinite(truth)
    shifted = np.where(finite, truth + 3.0 * np.spacing(np.where(finite, truth, 1.0)), truth)
    error = cases.verify(shifted).error_ulp[finite]
    assert np.abs(error - 3.0).max() <= 0.5 + 1e-9


def test_verification_refutes_missed_roots(cases: RandomCases, truth: Array) -> None:
    missed = np.full_like(truth, np.inf)
    np.testing.assert_array_equal(cases.verify(missed).right, ~np.isfinite(truth))


def test_verification_refutes_invented_roots(cases: RandomCases, truth: Array) -> None:
    invented = np.where(np.isfinite(truth), 0.5 * truth, 10.0)
    assert not cases.verify(invented).right.any()


def test_verification_returns_what_is_proved_instead(cases: RandomCases, truth: Array) -> None:
    verdict = cases.verify(np.full_like(truth, np.inf))
    found = {i: found_time(r) for i, r in verdict.counterexamples.items()}
    assert found == {int(i): truth[i] for i in np.flatnonzero(np.isfinite(truth))}


def test_verification_refutes_a_later_root() -> None:
    # cos(s) - 0.1: zeros at acos(0.1) and 2 pi - acos(0.1) and one turn later.
    verdict = verify_first_root(
        [acos(0.1) + 2.0 * pi], [-0.1], [[1.0]], [[0.0]], [1.0], [0.0], horizon=20.0
    )
    assert not verdict.right.any()


@pytest.mark.parametrize("claims_root", [True, False])
def test_verification_decides_grazing_at_every_depth(claims_root: bool) -> None:
    depth = np.array(DEPTHS)
    count = depth.size
    value = np.column_stack((np.full(count, -cos(2.0)), depth))
    rate = np.column_stack((np.full(count, -sin(2.0)), np.zeros(count)))
    terms = np.ones(count), value, rate, np.array([1.0, 0.0]), np.zeros(2)
    # hypot(cos 2, sin 2) in doubles is not exactly 1, so who grazes is asked of the intervals.
    results = [
        first_root(1.0, value[i].tolist(), rate[i].tolist(), [1.0, 0.0], [0.0, 0.0], horizon=6.0)
        for i in range(count)
    ]
    times = np.array([np.inf if r.root is None else float(r.root.mid()) for r in results])
    claim = np.where(np.isfinite(times) == claims_root, times, np.where(claims_root, 2.0, np.inf))
    verdict = verify_first_root(claim, *terms, horizon=6.0)
    np.testing.assert_array_equal(verdict.right, np.isfinite(times) == claims_root)


@pytest.mark.parametrize("u", [1e-9, 1e-5, 1e-2])
def test_verification_of_short_flights(u: float) -> None:
    claim = 2.0 * np.arctan(u)
    verdict = verify_first_root(
        [claim], [-1.0], [[1.0]], [[u]], [1.0], [0.0], horizon=6.0, leading=[[0.0, u]]
    )
    assert verdict.right.all()
    assert abs(verdict.error_ulp[0]) <= 2.0
