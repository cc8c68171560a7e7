"""States that the flow leaves the section from too slowly are refused, where that is asked for."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit import Hyperplane, PoincareMap, TangentCrossing
from dynkit.core.validation import Array
from tests.example_systems import DampedRotation

# y = 0 upwards; at (x, 0) a rotation passes at a rate that is proportional to x
PLANE = Hyperplane(np.array([0.0, 1.0, 0.0]))


def returns(least_rate: float) -> PoincareMap:
    return PoincareMap(DampedRotation(), PLANE, 20.0, least_rate)


def rate(state: Array) -> float:
    return float(DampedRotation().velocity(PLANE.lift(state))[1])


def test_states_that_leave_fast_enough_are_mapped_to_the_same_bits() -> None:
    state = np.array([1.0, 0.2])
    assert returns(0.99 * rate(state))(state).tobytes() == returns(0.0)(state).tobytes()


@pytest.mark.parametrize("x", [1.0, -1.0])
def test_slower_states_and_those_of_the_other_direction_are_refused(x: float) -> None:
    state = np.array([x, 0.2])
    with pytest.raises(TangentCrossing, match=r"^the flow must leave the section at a rate of "):
        returns(1.01 * abs(rate(state)))(state)


def test_a_negative_rate_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^least_rate must not be negative; got -1"):
        returns(-1.0)
