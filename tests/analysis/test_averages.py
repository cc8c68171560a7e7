"""Errors of averages of series whose averages are known."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy import signal

from dynkit.analysis.averages import TimeAverages
from dynkit.core.validation import Array
from dynkit.systems import ImpactChain

RUNS = 200


def whole(mean: Array) -> Array:
    return mean


def memory(share: float, n: int, seed: int, runs: int = 1) -> Array:
    """Series (n, runs) around zero of which each value keeps a share of the one before."""
    noise = np.random.default_rng(seed).normal(size=(n, runs))
    return np.asarray(signal.lfilter([1.0], [1.0, -share], noise, axis=0))


def henon(n: int) -> Array:
    """Log growth (n, runs) along the direction that grows fastest."""
    x, y = np.random.default_rng(0).uniform(-0.1, 0.1, size=(2, RUNS))
    along, logs = np.array([np.ones(RUNS), np.zeros(RUNS)]), np.empty((n + 50, RUNS))
    for row in logs:
        along = np.array([along[1] - 2.8 * x * along[0], 0.3 * along[0]])
        length = np.hypot(*along)
        row[:], along = np.log(length), along / length
        x, y = 1.0 - 1.4 * x * x + y, 0.3 * x
    return logs[50:]


def logistic(n: int) -> Array:
    """Log growth (n, runs) at rate 4."""
    x, logs = np.random.default_rng(0).uniform(0.1, 0.9, size=RUNS), np.empty((n, RUNS))
    for row in logs:
        row[:] = np.log(abs(4.0 - 8.0 * x))
        x = 4.0 * x * (1.0 - x)
    return logs


def lorenz(n: int) -> Array:
    """Growth rates (n, runs) over times of 0.2 along the direction that grows fastest."""

    def velocity(both: Array) -> Array:
        x, y, z, p, q, r = both
        return np.array(
            [
                10.0 * (y - x),
                x * (28.0 - z) - y,
                x * y - 8.0 / 3.0 * z,
                10.0 * (q - p),
                (28.0 - z) * p - q - x * r,
                y * p + x * q - 8.0 / 3.0 * r,
            ]
        )

    step, steps, settling = 0.02, 10, 50
    both = np.ones((6, RUNS)) + np.random.default_rng(0).normal(size=(6, RUNS))
    rates = np.empty((n + settling, RUNS))
    for row in rates:
        for _ in range(steps):  # Runge and Kutta's
            a = velocity(both)
            b = velocity(both + 0.5 * step * a)
            c = velocity(both + 0.5 * step * b)
            d = velocity(both + step * c)
            both = both + step / 6.0 * (a + 2.0 * (b + c) + d)
        length = np.linalg.norm(both[3:], axis=0)
        row[:] = np.log(length) / (step * steps)
        both[3:] /= length
    return rates[settling:]


def impacts(n: int) -> Array:
    """Log growth (n, runs) along the direction that grows fastest, in the chaos of ten masses."""
    chain = ImpactChain(frequency=1.346)
    start = chain.attractor(transient=1000).states[-1]
    logs = chain.stretching(start, (RUNS + 1) * n).logs[n:, 0]
    return logs.reshape(RUNS, n).T


# The largest exponents: J. C. Sprott, Chaos and Time-Series Analysis, Oxford 2003, appendix A; of
# the logistic map log 2. Of the ten masses none is published: the mean over all runs. Last how many
# times the deviation an error may be.
SERIES: dict[str, tuple[Callable[[], Array], float | None, float]] = {
    "independent": (lambda: memory(0.0, 400, 1, RUNS), 0.0, 1.5),
    "remembers": (lambda: memory(0.9, 2000, 2, RUNS), 0.0, 1.5),
    "turns round": (lambda: memory(-0.9, 400, 3, RUNS), 0.0, 1.5),
    "Henon, short": (lambda: henon(128), 0.41922, 1.5),
    "Henon": (lambda: henon(1000), 0.41922, 1.5),
    "Lorenz": (lambda: lorenz(600), 0.9056, 2.5),
    "ten masses": (lambda: impacts(300), None, 1.5),
    "logistic map": (lambda: logistic(2000), np.log(2.0), 6.0),
}


@cache
def deviations(name: str) -> tuple[Array, Array]:
    """Deviations and errors, (runs,)."""
    series, known, _ = SERIES[name]
    values, errors = TimeAverages(series()).estimate(whole)
    return values - (values.mean() if known is None else known), errors


@pytest.mark.parametrize("name", SERIES)
def test_the_true_value_is_within_two_errors_in_95_of_100_runs(name: str) -> None:
    off, errors = deviations(name)
    # less three standard errors of a part of so many runs
    assert (abs(off) <= 2.0 * errors).mean() >= 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / RUNS)


@pytest.mark.parametrize("name", SERIES)
def test_the_true_value_is_within_three_errors_in_99_of_100_runs(name: str) -> None:
    off, errors = deviations(name)
    assert (abs(off) <= 3.0 * errors).mean() >= 0.99 - 3.0 * np.sqrt(0.99 * 0.01 / RUNS)


@pytest.mark.parametrize("name", SERIES)
def test_errors_are_hardly_larger_than_they_need_be(name: str) -> None:
    # An error from 12 waves, or 6 where these are larger, is 1.25 times the deviation, as it is for
    # Student's t. The logistic map's logarithms telescope, and Lorenz's nearly do: what is left of
    # that in their averages is less than in the faster waves.
    off, errors = deviations(name)
    factor = SERIES[name][2]
    assert np.sqrt((errors**2).mean()) < factor * np.sqrt((off**2).mean())


def test_what_telescopes_has_an_error_of_its_ends_alone() -> None:
    noise = np.random.default_rng(4).normal(size=(20_001, RUNS))
    _, errors = TimeAverages(np.diff(noise, axis=0)).estimate(whole)
    # of the means of blocks it would be some hundred times as much
    assert np.sqrt((errors**2).mean()) < 3.0 * np.sqrt(2.0) / 20_000


def test_what_is_remembered_for_longer_than_a_slow_wave_is_told() -> None:
    assert not TimeAverages(memory(0.999, 3200, 3)).resolved


def test_a_change_within_the_series_is_told() -> None:
    series = memory(0.0, 3200, 4)
    series[1600:] += 5.0
    assert not TimeAverages(series).resolved


@pytest.mark.parametrize("frequency", [0.2, np.sqrt(2.0) - 1.0, 0.0137])
def test_waves_are_averaged_far_better_than_by_their_mean(frequency: float) -> None:
    angle = 2.0 * np.pi * frequency * np.arange(20_000)
    averages = TimeAverages((1.0 + np.cos(angle + 0.3))[:, None])
    value, error = averages.estimate(whole)
    assert averages.regular
    assert abs(value[0] - 1.0) <= error[0] + 1e-15
    assert error[0] < 1e-8


def test_a_constant_has_no_error() -> None:
    value, error = TimeAverages(np.full((200, 1), 0.25)).estimate(whole)
    assert value[0] == pytest.approx(0.25, rel=1e-15)
    assert error[0] < 1e-15


def test_errors_of_functions_are_those_of_first_order() -> None:
    series = memory(0.0, 6400, 5) + 10.0
    averages = TimeAverages(series)
    _, error = averages.estimate(whole)
    _, squared = averages.estimate(np.square)
    assert squared[0] == pytest.approx(20.0 * error[0], rel=1e-2)


def test_errors_of_ratios_know_what_rises_together() -> None:
    noise = memory(0.0, 6400, 6)
    averages = TimeAverages(np.column_stack([2.0 * (10.0 + noise), 10.0 + noise]))
    value, error = averages.estimate(lambda mean: mean[:1] / mean[1:])
    assert value[0] == pytest.approx(2.0, rel=1e-14)
    assert error[0] < 1e-13
