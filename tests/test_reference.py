"""The references agree with closed forms and with each other."""

from itertools import pairwise
from math import acos, asin, cos, exp, pi, sin, sqrt

import mpmath
import numpy as np
import pytest
from flint import arb, ctx
from mpmath import mp, mpf
from numpy.typing import NDArray

from tests.reference.brute_force import BruteForceChain
from tests.reference.first_root import FirstRoot, evaluate, first_root
from tests.reference.impact_chain import ReferenceChain
from tests.reference.solve_ivp_peer import Method, missed_impacts, simulate
from tests.reference.values import PAPER_CHAIN, regenerate
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


# ------------------------------------------------------------------------------------- impact chain


def test_one_undamped_mass_returns_every_half_period() -> None:
    # Elastic impacts on a table at rest at the spring's zero: half a period of flight, for ever.
    chain = ReferenceChain(1, damping=0.0, restitution=1.0, amplitude=0.0, frequency=1.0)
    history = chain.simulate(20, [1.0], [0.0])
    with mp.workdps(60):
        errors = [abs(p.time - (k + mpf(1) / 2) * mp.pi) for k, p in enumerate(history.impacts)]
    assert max(errors) < mpf("1e-45")


def test_undamped_elastic_chain_keeps_its_energy() -> None:
    chain = ReferenceChain(3, damping=0.0, restitution=1.0, amplitude=0.0, frequency=1.0)
    history = chain.simulate(30)
    with mp.workdps(60):
        energies = []
        for p in history.impacts:
            stretch = [p.position[0], *(b - a for a, b in pairwise(p.position))]
            energies.append(sum(v * v for v in p.velocity) + sum(d * d for d in stretch))
    assert max(energies) - min(energies) < mpf("1e-45")


def test_one_damped_mass_flies_its_closed_form() -> None:
    chain = ReferenceChain(1, damping=0.2, restitution=0.5, amplitude=0.0, frequency=1.0)
    first = chain.simulate(1, [1.0], [0.0]).impacts[0]
    rate = sqrt(1.0 - 0.1**2)
    time = (pi - acos(0.1)) / rate
    assert float(first.time) == pytest.approx(time, abs=2e-15)
    assert float(first.relative_velocity) == pytest.approx(0.5 * exp(-0.1 * time), abs=2e-16)


def test_every_proved_root_is_a_root_in_mpmath() -> None:
    history = ReferenceChain(frequency=0.87).simulate(20)
    assert history.worst_newton_step < mpf("1e-60")


def test_contact_of_one_mass_ends_where_the_table_pulls_away() -> None:
    # One mass without damping on the table: force w-balance (1 - w^2) A sin + A0 = 0.
    chain = ReferenceChain(
        1, damping=0.0, restitution=0.0, amplitude=0.5, offset=0.2, frequency=0.5
    )
    history = chain.simulate(2, [2.0], [0.0])
    _, release = history.contacts[0]
    with mp.workdps(60):
        phase = mp.pi + mpmath.asin(mpf(0.2) / (mpf("0.75") * mpf("0.5")))
        late = mpmath.fmod(release / 2 - phase, 2 * mp.pi)
    assert abs(late) < mpf("1e-45")


def test_release_does_not_depend_on_the_cut_of_the_chatter() -> None:
    ends = [
        ReferenceChain(2, frequency=0.408, restitution=0.3, stick_below=cut)
        .simulate(60)
        .contacts[0][1]
        for cut in (1e-15, 1e-23)
    ]
    assert abs(ends[0] - ends[1]) < mpf("1e-27")


def test_a_table_out_of_reach_ends_the_motion() -> None:
    history = ReferenceChain(3, offset=-5.0).simulate(5)
    assert history.ending == "no further contact"


def test_a_light_shake_ends_in_contact_for_ever() -> None:
    chain = ReferenceChain(2, amplitude=0.01, offset=0.5, restitution=0.0, frequency=0.3)
    assert chain.simulate(50, [1.0, 1.0], [0.0, 0.0]).ending == "contact for ever"


@pytest.mark.parametrize("frequency", [0.35, 0.87])
def test_stored_values_are_regenerated(frequency: float) -> None:
    assert regenerate(frequency, 10) == PAPER_CHAIN[frequency, 10]


# -------------------------------------------------------------------------------------------- peers


class Peers:
    """Five impacts of a four-mass chain, by the reference and by what is compared with it."""

    def __init__(self) -> None:
        self.chain = ReferenceChain(4, frequency=0.87)
        self.impacts = self.chain.simulate(5).impacts
        position, velocity = self.chain.paper_start()
        self.position = np.array([float(x) for x in position])
        self.velocity = np.array([float(x) for x in velocity])

    def brute_force_error(self, step: float) -> float:
        run = BruteForceChain(
            np.ones(4),
            np.ones(4),
            damping=0.1,
            restitution=0.85,
            amplitude=0.1,
            offset=0.0,
            frequency=0.87,
            step=step,
        ).run(self.position, self.velocity, impacts=5, limit=200.0)
        last = self.impacts[-1]
        return float(np.abs(run.velocity[-1] - np.array([float(v) for v in last.velocity])).max())

    def solve_ivp_error(self, method: Method, tolerance: float) -> float:
        run = simulate(
            np.ones(4),
            np.ones(4),
            damping=0.1,
            restitution=0.85,
            amplitude=0.1,
            offset=0.0,
            frequency=0.87,
            position=self.position,
            velocity=self.velocity,
            impacts=5,
            method=method,
            rtol=tolerance,
            atol=0.01 * tolerance,
        )
        times = np.array([float(p.time) for p in self.impacts])
        return float(np.abs(run.time - times).max())


@pytest.fixture(scope="module")
def peers() -> Peers:
    return Peers()


def test_brute_force_converges_with_order_four(peers: Peers) -> None:
    steps = np.array([0.08, 0.04, 0.02, 0.01])
    errors = np.array([peers.brute_force_error(h) for h in steps])
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(4.0, abs=0.3)


def test_brute_force_finds_the_contact_of_the_reference() -> None:
    chain = ReferenceChain(2, frequency=0.408, restitution=0.3)
    start, end = chain.simulate(60).contacts[0]
    position, velocity = chain.paper_start()
    run = BruteForceChain(
        np.ones(2),
        np.ones(2),
        damping=0.1,
        restitution=0.3,
        amplitude=0.1,
        offset=0.0,
        frequency=0.408,
        step=1e-3,
    ).run(
        np.array([float(x) for x in position]),
        np.array([float(x) for x in velocity]),
        impacts=40,
        limit=float(end) + 0.1,
    )
    np.testing.assert_allclose(run.contact[0], [float(start), float(end)], atol=5e-3)


@pytest.mark.parametrize(
    ("method", "tolerance", "error"),
    [("DOP853", 1e-10, 1e-8), ("RK45", 1e-8, 1e-5), ("Radau", 1e-6, 1e-4), ("LSODA", 1e-10, 1e-7)],
)
def test_solve_ivp_agrees_within_its_tolerance(
    peers: Peers, method: Method, tolerance: float, error: float
) -> None:
    assert peers.solve_ivp_error(method, tolerance) < error


def test_solve_ivp_counts_a_motion_that_stops_short() -> None:
    run = simulate(
        np.ones(1),
        np.ones(1),
        damping=0.1,
        restitution=0.8,
        amplitude=0.1,
        offset=-5.0,
        frequency=1.0,
        position=np.array([1.0]),
        velocity=np.array([0.0]),
        impacts=3,
    )
    assert not run.completed


def test_missed_impacts_are_counted() -> None:
    assert missed_impacts(np.array([1.0, 3.0]), np.array([1.0, 2.0, 3.00001])) == 1


def test_solve_ivp_misses_a_grazing_impact() -> None:
    # One undamped mass on a table at rest, 1e-9 above the lowest point of its swing.
    run = simulate(
        np.ones(1),
        np.ones(1),
        damping=0.0,
        restitution=0.8,
        amplitude=0.0,
        offset=-1.0 + 1e-9,
        frequency=1.0,
        position=np.array([1.0]),
        velocity=np.array([0.0]),
        impacts=1,
        flight_limit=6.0,
    )
    reference = np.array([acos(-1.0 + 1e-9)])
    assert missed_impacts(run.time, reference) == 1
