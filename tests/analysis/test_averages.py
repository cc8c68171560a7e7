"""Errors of averages of series whose averages are known."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit.analysis.averages import BlockAverages
from dynkit.validation import Array


def whole(mean: Array) -> Array:
    return mean


def memory(share: float, n: int, seed: int) -> Array:
    """A series (n, 1) around zero of which each value keeps a share of the one before."""
    noise = np.random.default_rng(seed).normal(size=n)
    out = np.zeros(n)
    for i in range(1, n):
        out[i] = share * out[i - 1] + noise[i]
    return out[:, None]


def test_errors_of_independent_values_are_those_of_their_mean() -> None:
    # of 32 blocks a standard error is known to 1 / sqrt(62), and here three times that
    value, error = BlockAverages(memory(0.0, 6400, 1)).estimate(whole)
    assert error[0] == pytest.approx(1.0 / 80.0, rel=3.0 / np.sqrt(62.0))
    assert abs(value[0]) < 3.0 * error[0]


def test_what_is_remembered_makes_the_error_larger() -> None:
    # 1 / (1 - share) times that of independent values
    averages = BlockAverages(memory(0.9, 12_800, 2))
    _, error = averages.estimate(whole)
    assert averages.resolved
    assert error[0] == pytest.approx(10.0 / np.sqrt(12_800.0), rel=3.0 / np.sqrt(62.0))


def test_what_is_remembered_for_longer_than_a_block_is_told() -> None:
    assert not BlockAverages(memory(0.999, 3200, 3)).resolved


def test_a_change_within_the_series_is_told() -> None:
    series = memory(0.0, 3200, 4)
    series[1600:] += 5.0
    assert not BlockAverages(series).resolved


@pytest.mark.parametrize("frequency", [0.2, np.sqrt(2.0) - 1.0, 0.0137])
def test_waves_are_averaged_far_better_than_by_their_mean(frequency: float) -> None:
    angle = 2.0 * np.pi * frequency * np.arange(20_000)
    averages = BlockAverages((1.0 + np.cos(angle + 0.3))[:, None])
    value, error = averages.estimate(whole)
    assert averages.regular
    assert abs(value[0] - 1.0) <= error[0] + 1e-15
    assert error[0] < 1e-8


def test_a_constant_has_no_error() -> None:
    value, error = BlockAverages(np.full((200, 1), 0.25)).estimate(whole)
    assert value[0] == pytest.approx(0.25, rel=1e-15)
    assert error[0] < 1e-15


def test_errors_of_functions_are_those_of_first_order() -> None:
    series = memory(0.0, 6400, 5) + 10.0
    averages = BlockAverages(series)
    _, error = averages.estimate(whole)
    _, squared = averages.estimate(np.square)
    assert squared[0] == pytest.approx(20.0 * error[0], rel=1e-2)


def test_errors_of_ratios_know_what_rises_together() -> None:
    noise = memory(0.0, 6400, 6)
    averages = BlockAverages(np.column_stack([2.0 * (10.0 + noise), 10.0 + noise]))
    value, error = averages.estimate(lambda mean: mean[:1] / mean[1:])
    assert value[0] == pytest.approx(2.0, rel=1e-14)
    assert error[0] < 1e-13
