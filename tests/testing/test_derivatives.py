"""Derivatives by differences are as good as their error estimate says."""

import numpy as np
import pytest

from dynkit import testing
from dynkit.core.validation import Array


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


@pytest.mark.parametrize("accuracy", [1e-11, 1e-8, 1e-5])
def test_errors_of_the_values_are_part_of_the_error(accuracy: float) -> None:
    noise = np.random.default_rng(0)

    def rough(x: Array) -> Array:
        return np.exp(x) * (1.0 + accuracy * noise.uniform(-1.0, 1.0))

    for place in np.linspace(0.0, 1.0, 20):
        found, error = testing.numerical_derivative(rough, np.array([place]), accuracy=accuracy)
        assert abs(found[0, 0] - np.exp(place)) <= 20.0 * error[0, 0]
