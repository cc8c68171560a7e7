"""Derivatives by parameters: differences are right to 1e-8 and better, overrides are exact."""

import numpy as np
import pytest

from dynkit.core.differences import parameter_difference
from dynkit.core.no_motion import NoCrossing, Refused
from dynkit.core.validation import Array
from dynkit.dynamics.map import Map
from dynkit.systems import Henon, HighBounce, Logistic
from tests.example_systems import CircleRotation

ROUNDING = 2.0**-52


def wave(x: float) -> Array:
    return np.array([np.sin(3.0 * x), 2.0 + np.cos(3.0 * x)])


def slope(x: float) -> Array:
    return np.array([3.0 * np.cos(3.0 * x), -3.0 * np.sin(3.0 * x)])


PLACES = [0.0, 1e-9, -1e-3, 0.3, -1.0, 20.0]


@pytest.mark.parametrize("place", PLACES)
def test_differences_of_rounded_values_are_good_to_twelve_digits(place: float) -> None:
    assert parameter_difference(wave, place) == pytest.approx(slope(place), abs=3e-12)


@pytest.mark.parametrize("accuracy", [1e-13, 1e-11, 1e-9])
def test_errors_of_values_cost_an_eighth_of_their_digits(accuracy: float) -> None:
    noise = np.random.default_rng(0)

    def rough(x: float) -> Array:
        return wave(x) + accuracy * noise.uniform(-1.0, 1.0, 2)

    # accuracy / step, and the step accuracy^(1/9) is halved up to four times for a slope of three
    allowed = 3.0 * 16.0 * accuracy ** (8.0 / 9.0)
    for place in np.linspace(0.0, 1.0, 50).tolist():
        off = parameter_difference(rough, place, accuracy=accuracy) - slope(place)
        assert abs(off).max() < allowed


@pytest.mark.parametrize("edge", [1.0, 1.0 + 1e-9, 1.0 + 1e-4])
@pytest.mark.parametrize("refusal", [Refused, NoCrossing])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_at_an_end_of_the_range_differences_are_one_sided(
    edge: float, refusal: type[Exception], side: float
) -> None:
    def bounded(x: float) -> Array:
        if side * x > edge:
            raise refusal
        return wave(x)

    assert parameter_difference(bounded, side) == pytest.approx(slope(side), abs=1e-10)


@pytest.mark.parametrize("fault", [ValueError, RuntimeError, ZeroDivisionError, TypeError])
def test_a_fault_of_the_function_is_no_refusal(fault: type[Exception]) -> None:
    def faulty(x: float) -> Array:
        if x > 1.0:
            raise fault("by a fault")
        return wave(x)

    with pytest.raises(fault, match="by a fault"):
        parameter_difference(faulty, 1.0)


def test_a_value_alone_has_no_derivative() -> None:
    def single(x: float) -> Array:
        if x != 1.0:
            raise Refused
        return wave(x)

    with pytest.raises(ValueError, match=r"values must exist on at least one side of 1\.0"):
        parameter_difference(single, 1.0)


def test_jumps_on_both_sides_are_not_taken_for_a_slope() -> None:
    def pocket(x: float) -> Array:
        return wave(x) + (0.0 if abs(x - 1.0) < 1e-5 else 0.5)

    # only steps below 1e-5 see the function: rounding over the step
    assert parameter_difference(pocket, 1.0) == pytest.approx(slope(1.0), abs=10 * ROUNDING / 1e-6)


def test_angles_are_followed_over_the_turn() -> None:
    def angle(x: float) -> Array:
        return np.array([(5.0 * x) % (2.0 * np.pi)])

    def shortest(a: Array, b: Array) -> Array:
        gap = a - b
        return np.asarray(gap - 2.0 * np.pi * np.rint(gap / (2.0 * np.pi)))

    (found,) = parameter_difference(angle, 2.0 * np.pi / 5.0, difference=shortest)
    assert found == pytest.approx(5.0, abs=1e-11)


def test_functions_of_a_small_scale_are_resolved() -> None:
    (found,) = parameter_difference(lambda x: np.array([np.sin(1e4 * x)]), 1.0)
    assert found == pytest.approx(1e4 * np.cos(1e4), rel=1e-9)


EXACT: dict[str, tuple[Map, Array]] = {
    "logistic": (Logistic(3.7), np.array([0.3])),
    "henon": (Henon(1.2, 0.4), np.array([0.7, -0.2])),
    "high bounce": (HighBounce(restitution=0.8, gamma=2.0), np.array([5.0, 7.0])),
    "dead ball": (HighBounce(restitution=0.0, gamma=2.0), np.array([5.0, 7.0])),
    "ball without losses": (HighBounce(restitution=1.0, gamma=2.0), np.array([5.0, 7.0])),
    "table at rest": (HighBounce(restitution=0.5, gamma=0.0), np.array([5.0, 7.0])),
}


@pytest.mark.parametrize("name", EXACT)
def test_what_a_map_knows_exactly_equals_differences(name: str) -> None:
    system, state = EXACT[name]
    for parameter in system.parameters:
        exact = system.parameter_derivative(state, parameter)
        by_differences = Map.parameter_derivative(system, state, parameter)
        assert by_differences == pytest.approx(exact, rel=1e-10, abs=1e-11)


def test_differences_of_a_map_with_angles_go_the_shortest_way() -> None:
    found = CircleRotation(2.0 * np.pi - 1.0).parameter_derivative(np.array([1.0, 0.5]), "turn")
    assert found == pytest.approx([1.0, 0.0], abs=1e-11)


@pytest.mark.parametrize("name", EXACT)
def test_unknown_parameters_are_refused(name: str) -> None:
    system, state = EXACT[name]
    with pytest.raises(ValueError, match=r"parameter must be one of: .*; got 'mass'"):
        system.parameter_derivative(state, "mass")


@pytest.mark.parametrize("unit", [1e-18, 1e-9, 1e-3, 1e9])
def test_functions_vary_over_the_size_of_the_number(unit: float) -> None:
    def values(x: float) -> Array:
        return np.array([1.0 / (1.0 + (x / unit) ** 2), np.tanh(x / unit), 2.0 + x / unit])

    slopes = np.array([-2.2 / (1.0 + 1.21) ** 2, np.cosh(1.1) ** -2, 1.0])
    assert unit * parameter_difference(values, 1.1 * unit) == pytest.approx(slopes, rel=1e-9)


def test_a_number_that_does_not_occur_costs_few_calls() -> None:
    asked: list[float] = []

    def constant(value: float) -> Array:
        asked.append(value)
        return np.array([1.5, -0.3])

    assert not parameter_difference(constant, 0.3).any()
    assert len(asked) <= 25
