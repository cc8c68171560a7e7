"""Standard errors of time averages: how often the interval that they claim is missed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr, stdtrit

from dynkit.analysis.averages import TimeAverages
from dynkit.core.validation import Array

SERIES, LENGTH = 10_000, 1024

FEWEST = 6
"""Waves that an error stands on at least: its degrees of freedom."""


def remembering(memory: float) -> Array:
    """Series (LENGTH, SERIES) of mean zero: a part of the value before, and chance."""
    random = np.random.default_rng(1)
    series = random.normal(size=(LENGTH, SERIES))
    series[0] /= np.sqrt(1.0 - memory**2)
    for i in range(1, LENGTH):
        series[i] += memory * series[i - 1]
    return series


@pytest.mark.parametrize("memory", [0.0, 0.9, 0.97])
def test_intervals_of_999_in_1000_are_missed_by_one_in_1000(memory: float) -> None:
    """By Student's t with their own degrees of freedom; twice the error is that of 95 %."""
    means, errors = TimeAverages(remembering(memory)).estimate(lambda mean: mean)
    width = 2.0 * stdtrit(FEWEST, 0.9995) / stdtrit(FEWEST, ndtr(2.0))
    missed = int((abs(means) > width * errors).sum())
    assert missed <= SERIES / 1000
    assert np.median(abs(means) / errors) > 0.5
