"""The logistic map: its cycles, their multipliers and its chaos, in closed form."""

import numpy as np
import pytest

from dynkit import MapAttractor
from dynkit.core.validation import Array
from dynkit.systems.maps.logistic import Logistic

ROUNDING = 2.0**-52
BIRTH_OF_PERIOD_3 = 1.0 + np.sqrt(8.0)


def cycle_of_period_2(rate: float) -> Array:
    """R. M. May, Nature 261 (1976) 459-467: the roots of x^2 - (1 + 1/r) x + (1 + 1/r)/r."""
    root = np.sqrt((rate - 3.0) * (rate + 1.0))
    return np.array([[rate + 1.0 + root], [rate + 1.0 - root]]) / (2.0 * rate)


def multiplier(rate: float, cycle: Array) -> float:
    system = Logistic(rate)
    return float(np.prod([system.jacobian(state)[0, 0] for state in cycle]))


@pytest.mark.parametrize("rate", [0.5, 2.0, 3.0, 3.7, 4.0])
def test_a_fixed_point_is_one_less_the_inverse_rate(rate: float) -> None:
    state = np.array([1.0 - 1.0 / rate])
    # one rounding of the state, and three of the call
    assert Logistic(rate)(state) == pytest.approx(state, rel=4.0 * ROUNDING)


@pytest.mark.parametrize("rate", [0.5, 2.0, 3.0, 3.7, 4.0])
def test_its_multiplier_is_two_less_the_rate(rate: float) -> None:
    found = multiplier(rate, np.array([[1.0 - 1.0 / rate]]))
    assert found == pytest.approx(2.0 - rate, abs=8.0 * ROUNDING)


@pytest.mark.parametrize("rate", [3.2, 3.5, 4.0])
def test_the_cycle_of_period_2_is_mays(rate: float) -> None:
    cycle = cycle_of_period_2(rate)
    assert Logistic(rate)(cycle[0]) == pytest.approx(cycle[1], rel=8.0 * ROUNDING)
    assert Logistic(rate)(cycle[1]) == pytest.approx(cycle[0], rel=8.0 * ROUNDING)


@pytest.mark.parametrize(
    ("rate", "expected"), [(3.0, 1.0), (1.0 + np.sqrt(5.0), 0.0), (1.0 + np.sqrt(6.0), -1.0)]
)
def test_the_cycle_of_period_2_is_born_superstable_and_doubled(
    rate: float, expected: float
) -> None:
    # its multiplier is 1 - (rate - 3)(rate + 1); sizes of the factors are below 4
    found = multiplier(rate, cycle_of_period_2(rate))
    assert found == pytest.approx(expected, abs=64.0 * ROUNDING)


@pytest.mark.parametrize(
    ("rate", "label"),
    [
        (2.9, "P(1)"),
        (3.1, "P(2)"),
        (1.0 + np.sqrt(6.0) - 0.05, "P(2)"),
        (1.0 + np.sqrt(6.0) + 0.05, "P(4)"),
        (BIRTH_OF_PERIOD_3 + 0.005, "P(3)"),
        (3.9, "chaotic"),
    ],
)
def test_labels_are_those_of_the_period_doublings(rate: float, label: str) -> None:
    # May 1976, table 2: 3, 1 + sqrt 6 = 3.4495; period 3 from 1 + sqrt 8 = 3.8284
    attractor = MapAttractor(Logistic(rate), np.array([0.4]), transient=1000, iterations=1000)
    assert str(attractor.label) == label


@pytest.mark.parametrize("period", range(2, 13))
@pytest.mark.parametrize("fold", [-1, 1])
def test_multipliers_at_rate_4_are_powers_of_2(period: int, fold: int) -> None:
    """Angles double, x = sin^2 t: t = pi/(2^n + fold) has period n and the multiplier 2^n."""
    angles = np.pi * 2.0 ** np.arange(period) / (2**period + fold)
    cycle = np.sin(angles)[:, None] ** 2
    found = abs(multiplier(4.0, cycle))
    # f' = 4 cos 2t is off by 4 eps (1 + 2t tan 2t), and 1/cos 2t is below 2^n
    assert found == pytest.approx(2.0**period, rel=8.0 * ROUNDING * period * 2.0**period)


@pytest.mark.parametrize("start", [0.1, 0.2345, 0.7])
def test_the_lyapunov_exponent_at_rate_4_is_the_logarithm_of_2(start: float) -> None:
    """f' = 2 sqrt(f(f(x))/f(x)): the logarithms telescope to n ln 2 + ln(x_(n+1)/x_1) / 2."""
    system, n = Logistic(4.0), 10_000
    states = system.iterate(np.array([start]), n + 1)[:, 0]
    slopes = [abs(system.jacobian(np.array([x]))[0, 0]) for x in states[:n]]
    ends = abs(np.log(states[n + 1] / states[1])) / (2 * n)
    # near x = 1/2 a rounding of x changes ln |f'| by eps / |1 - 2x|
    rounding = float(np.mean(8.0 * ROUNDING / np.abs(1.0 - 2.0 * states[:n])))
    assert abs(np.mean(np.log(slopes)) - np.log(2.0)) <= ends + rounding


@pytest.mark.parametrize("start", [0.1, 0.2345, 0.7])
def test_iterates_at_rate_4_double_an_angle(start: float) -> None:
    angle = np.arcsin(np.sqrt(start))
    states = Logistic(4.0).iterate(np.array([start]), 20)[:, 0]
    n = np.arange(21)
    # an error of the angle doubles in every iterate
    assert (np.abs(states - np.sin(2.0**n * angle) ** 2) <= 4.0 * ROUNDING * 2.0**n).all()
