"""Derivatives by differences are as good as their error estimate says."""

import numpy as np
import pytest

from dynkit import testing


@pytest.mark.parametrize("order", range(1, 6))
def test_numerical_derivatives_stay_within_twenty_of_their_errors(order: int) -> None:
    point = np.array([0.7, -1.3])
    found, error = testing.numerical_derivative(lambda x: np.sin(order * x), point)
    exact = np.diag(order * np.cos(order * point))
    assert (np.abs(found - exact) <= 20.0 * error).all()


def test_numerical_derivatives_of_smooth_functions_are_good_to_ten_digits() -> None:
    found, error = testing.numerical_derivative(np.exp, np.array([0.3]))
    assert error.max() < 1e-10
    assert found[0, 0] == pytest.approx(np.exp(0.3), rel=1e-10)
