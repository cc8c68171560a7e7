"""Harmonics of periodic motions against Fourier coefficients in closed form."""

import pickle

import numpy as np
import pytest
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.dynamics.attractor import MapAttractor
from dynkit.labels.label import OrbitKind, OrbitLabel
from dynkit.orbits.harmonics import harmonics_needed, harmonics_of
from dynkit.systems import BouncingBall, ImpactChain, Logistic
from dynkit.systems.impact.oscillators.attractor import ImpactAttractor

TWO_PI = 2.0 * np.pi
DAMPING = 0.1


def triangle(t: Array) -> Array:
    """A wave of period one between 1 and -1, which folds without mercy: c_k = 4 / (pi k)^2 / 2."""
    return np.asarray(4.0 * abs(t % 1.0 - 0.5) - 1.0)


def settled(attractor: ImpactAttractor, samples: int) -> tuple[Array, float]:
    """Contact coordinate over one period, (samples + 1,), and its first frequency."""
    periods = attractor.label.periods
    assert periods is not None
    frequency = attractor.system.frequency / periods
    times = np.linspace(0.0, TWO_PI / frequency, samples + 1)
    coordinate = attractor.system.contact % attractor.system.degrees_of_freedom
    return attractor.time_series(times)[:, coordinate], frequency


def response(attractor: ImpactAttractor, count: int) -> NDArray[np.complex128]:
    """Coefficients c_1 ... c_count of a chain's tip under its own impacts, in closed form.

    Each impact is an impulse, v+ - v- = (1 + 1/r) u. The modes answer to it by themselves:
    c_k = sum_j phi_j^2 / (w_j^2 - W^2 + i g w_j^2 W) sum_i J_i exp(-i W t_i) / T at W = 2 pi k / T.
    """
    chain, n, m = attractor.system, attractor.label.iterates, attractor.label.periods
    assert isinstance(chain, ImpactChain)
    assert n is not None
    assert m is not None
    impulses = (1.0 + 1.0 / chain.restitution) * attractor.record.relative_velocity[:n]
    frequencies = chain.frequency / m * np.arange(1.0, count + 1.0)[:, None]
    natural, tip = chain.natural_frequencies**2, chain.modal_matrix[-1] ** 2
    answers = tip / (natural - frequencies**2 + 1j * DAMPING * natural * frequencies)
    turns = np.exp(-1j * frequencies * attractor.record.time[:n])
    pushes = (turns * impulses).sum(axis=1) * chain.frequency / (TWO_PI * m)
    return np.asarray(answers.sum(axis=1) * pushes)


# --- coefficients ---------------------------------------------------------------------------------


@pytest.mark.parametrize("samples", [64, 65, 1000])
def test_coefficients_of_a_parabola_are_in_error_by_no_more_than_estimated(samples: int) -> None:
    t = np.linspace(0.0, 1.0, samples + 1)
    found = harmonics_of(t * (1.0 - t), TWO_PI)
    exact = -2.0 / found.frequencies**2  # twice integrated by parts: the slope jumps by 2
    error = abs(found.coefficients - exact).max()
    assert 0.2 * found.error < error <= found.error


@pytest.mark.parametrize("samples", [64, 1000])
def test_error_estimate_is_sharp_for_a_triangle(samples: int) -> None:
    found = harmonics_of(triangle(np.linspace(0.0, 1.0, samples + 1)), TWO_PI)
    k = np.arange(1, len(found.coefficients) + 1)
    exact = np.where(k % 2 == 1, 4.0 / (np.pi * k) ** 2, 0.0)
    error = abs(found.coefficients - exact).max()
    assert 0.9 * found.error < error <= found.error


@pytest.mark.parametrize("samples", range(4, 20))
@pytest.mark.parametrize("fall", ["powers", "squares"])
def test_error_estimate_holds_for_few_samples(samples: int, fall: str) -> None:
    random, exceeded = np.random.default_rng(samples), 0
    k = np.arange(1, 61)
    turns = np.exp(2j * np.pi * np.outer(np.arange(samples + 1) / samples, k))
    for _ in range(1000):
        numbers = random.normal(size=60) + 1j * random.normal(size=60)
        exact = numbers * (random.uniform(0.2, 0.95) ** k if fall == "powers" else k**-2.0)
        found = harmonics_of(2.0 * (turns @ exact).real, 1.0)
        error = abs(found.coefficients - exact[: len(found.coefficients)]).max()
        exceeded += error > found.error
    assert exceeded <= 4  # one in a thousand, and chance


@pytest.mark.parametrize("samples", range(8, 16))
def test_error_estimate_of_a_smooth_motion_of_few_samples_is_small(samples: int) -> None:
    turns = TWO_PI * np.arange(samples + 1) / samples
    found = harmonics_of(np.cos(turns) + 0.1 * np.sin(2.0 * turns), 1.0)
    assert found.error < 0.2


@pytest.mark.parametrize("phase", [0.0, 0.3, 0.7123])
def test_error_estimate_holds_wherever_the_kinks_are(phase: float) -> None:
    found = harmonics_of(triangle(np.linspace(0.0, 1.0, 101) + phase / 100.0), TWO_PI)
    k = np.arange(1, len(found.coefficients) + 1)
    exact = np.where(k % 2 == 1, 4.0 / (np.pi * k) ** 2, 0.0) * np.exp(
        TWO_PI * 1j * k * phase / 100
    )
    assert abs(found.coefficients - exact).max() <= found.error


@pytest.mark.parametrize("samples", [5, 8, 64, 1001])
def test_error_estimate_holds_for_jumps(samples: int) -> None:
    # t modulo 1 less a half, for a jump at t_0: c_k = i exp(-2 pi i k t_0) / (2 pi k)
    k = np.arange(1, (samples - 1) // 2 + 1)
    for place in np.random.default_rng(0).uniform(size=50):
        t = np.arange(samples + 1) / samples
        found = harmonics_of((t - place) % 1.0 - 0.5, 2.0 * np.pi)
        exact = 1j * np.exp(-2j * np.pi * k * place) / (2.0 * np.pi * k)
        assert abs(found.coefficients - exact).max() <= found.error


@pytest.mark.parametrize("unit", [1e-300, 1e-163, 1e-100, 1e100, 1e300])
def test_error_estimate_of_a_jump_is_the_same_in_all_units(unit: float) -> None:
    saw = (np.arange(65) / 64 - 0.3) % 1.0 - 0.5
    error = harmonics_of(saw, TWO_PI).error
    assert harmonics_of(unit * saw, TWO_PI).error / unit == pytest.approx(error, rel=1e-9)


def test_powers_are_the_mean_squares_of_sines() -> None:
    t = np.linspace(0.0, TWO_PI, 33)
    found = harmonics_of(7.0 + 2.0 * np.cos(t) - 3.0 * np.sin(4.0 * t), 1.0)
    assert found.power[[0, 3]] == pytest.approx([2.0, 4.5], rel=1e-14)
    assert found.variance == pytest.approx(6.5, rel=1e-14)


def test_frequencies_are_multiples_of_the_first() -> None:
    found = harmonics_of(triangle(np.linspace(0.0, 1.0, 10)), 0.25)
    assert found.frequencies.tolist() == [0.25, 0.5, 0.75, 1.0]


def test_error_tells_what_a_motion_lacks_to_be_periodic() -> None:
    t = np.linspace(0.0, TWO_PI, 1025)
    drift = 1e-3 * t / TWO_PI
    found = harmonics_of(np.cos(t) + drift, 1.0)
    exact = np.where(np.arange(1, 512) == 1, 0.5, 0.0)
    assert abs(found.coefficients - exact).max() <= found.error
    assert found.error < 2e-3


def test_cost_counts_the_samples() -> None:
    assert harmonics_of(np.zeros(9), 1.0).cost.counts == {"samples": 9}


# --- motions with impacts -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("masses", "frequency", "label"),
    [(1, 2.5, "P(1,1)"), (1, 4.5, "P(1,2)"), (10, 0.87, "P(1,3)"), (10, 0.28, "P(2,1)")],
)
def test_harmonics_of_a_chain_are_its_answer_to_the_impulses(
    masses: int, frequency: float, label: str
) -> None:
    chain = ImpactChain(masses=masses, frequency=frequency, damping=DAMPING)
    attractor = chain.attractor(transient=5000)
    assert str(attractor.label) == label
    found = harmonics_of(*settled(attractor, 1024))
    exact = response(attractor, len(found.coefficients))
    assert abs(found.coefficients - exact).max() <= found.error
    assert found.error < 1e-3 * abs(exact).max()


@pytest.mark.parametrize("frequency", [0.28, 0.64, 0.87, 1.2, 1.31, 1.75])
def test_labels_count_the_harmonics_of_the_closed_form(frequency: float) -> None:
    attractor = ImpactChain(frequency=frequency, damping=DAMPING).attractor(transient=5000)
    power = np.sort(abs(response(attractor, 100_000)) ** 2)[::-1]
    held = np.cumsum(power) / power.sum()
    assert attractor.label.harmonics == np.searchsorted(held, 0.99) + 1


def test_bouncing_ball_has_three_harmonics() -> None:
    # bounces of one period, Gamma = 1.1 b; parabolas have powers 1 / k^4: the first harmonics hold
    # 0.924, 0.982 and 0.993 of pi^4 / 90
    w, r = 3.0, 0.8
    born = np.pi * (1.0 - r) / (1.0 + r)
    ball = BouncingBall(amplitude=1.1 * born / w**2, frequency=w, restitution=r)
    u, phase = TWO_PI * r / ((1.0 + r) * w), np.arccos(1.0 / 1.1)
    attractor = ball.attractor(start=ball.impact_state(np.array([u, phase])))
    assert (str(attractor.label), attractor.label.harmonics) == ("P(1,1)", 3)


@pytest.mark.parametrize("frequency", [0.408, 0.14])
def test_sticking_motion_has_as_many_harmonics_as_many_samples_tell(frequency: float) -> None:
    attractor = ImpactChain(frequency=frequency).attractor(transient=8000)
    assert attractor.label.kind is OrbitKind.STICKING
    assert attractor.label.harmonics == harmonics_of(*settled(attractor, 1 << 14)).count()


# --- how many matter ------------------------------------------------------------------------------


def test_strongest_harmonics_are_counted_first() -> None:
    t = np.linspace(0.0, TWO_PI, 33)
    found = harmonics_of(np.sin(t) + 10.0 * np.sin(5.0 * t), 1.0)
    assert found.shares[:2] == pytest.approx([100.0 / 101.0, 1.0], rel=1e-14)
    assert (found.count(0.99), found.count(0.991)) == (1, 2)


def test_counts_do_not_depend_on_units() -> None:
    t = np.linspace(0.0, 2.0 * np.pi, 65)
    x = 2.0 * np.cos(t) + 0.5 * np.sin(5.0 * t)
    assert [harmonics_of(unit * x, 1.0).count() for unit in (1e-200, 1.0)] == [2, 2]


def test_rest_has_no_harmonics() -> None:
    assert harmonics_of(np.full(9, 0.1), 1.0).count() == 0


def test_number_is_right_where_few_samples_mislead() -> None:
    def motion(t: Array) -> Array:
        return np.asarray(t * (1.0 - t) + 0.01 * np.sin(3.0 * TWO_PI * t))

    # c_k = -1 / (2 pi^2 k^2) of the parabola, c_3 less 0.005 i
    power = 1.0 / (2.0 * np.pi**2 * np.arange(1.0, 1000.0) ** 2) ** 2
    power[2] += 0.005**2
    many = np.searchsorted(np.cumsum(np.sort(power)[::-1]) / power.sum(), 0.99) + 1
    assert harmonics_of(motion(np.linspace(0.0, 1.0, 17)), TWO_PI).count() != many
    assert harmonics_needed(motion, 1.0, 16) == many


# --- labels ---------------------------------------------------------------------------------------


def test_chaos_has_no_count_of_harmonics() -> None:
    assert ImpactChain(frequency=1.346).attractor().label.harmonics is None


def test_maps_have_no_count_of_harmonics() -> None:
    attractor = MapAttractor(Logistic(rate=3.2), np.array([0.3]), transient=50, iterations=20)
    assert attractor.label.harmonics is None


def test_counting_changes_neither_name_nor_equality_of_a_label() -> None:
    plain = OrbitLabel(OrbitKind.PERIODIC, 1, 3, 1e-6, 0.0, 100)
    counting = OrbitLabel(OrbitKind.PERIODIC, 1, 3, 1e-6, 0.0, 100, count_harmonics=lambda: 12)
    assert (str(counting), repr(counting)) == (str(plain), repr(plain))
    assert counting == plain


def test_label_still_counts_when_it_was_pickled() -> None:
    label = ImpactChain(frequency=0.87).attractor().label
    assert pickle.loads(pickle.dumps(label)).harmonics == label.harmonics


# --- refusals -------------------------------------------------------------------------------------


def test_too_few_values_are_refused() -> None:
    with pytest.raises(ValueError, match="values must be 5 or more; got 4"):
        harmonics_of(np.zeros(4), 1.0)


@pytest.mark.parametrize("frequency", [0.0, -1.0, np.nan])
def test_bad_frequencies_are_refused(frequency: float) -> None:
    with pytest.raises(ValueError, match="frequency must"):
        harmonics_of(np.zeros(9), frequency)


@pytest.mark.parametrize("share", [0.0, 1.0, -0.5])
def test_bad_shares_are_refused(share: float) -> None:
    with pytest.raises(ValueError, match=r"share must lie in \(0, 1\)"):
        harmonics_of(np.zeros(9), 1.0).count(share)


@pytest.mark.parametrize(("unit", "limit"), [(1e-200, "at least 1e-145"), (1e200, "exceed 1e.145")])
def test_powers_that_would_vanish_or_overflow_are_refused(unit: float, limit: str) -> None:
    found = harmonics_of(unit * np.sin(np.linspace(0.0, TWO_PI, 33)), 1.0)
    assert abs(found.coefficients[0]) == pytest.approx(0.5 * unit)
    with pytest.raises(ValueError, match=f"coefficients must .*{limit}"):
        found.power  # noqa: B018
