"""Derivatives by parameters: differences are right to 1e-8 and better, overrides are exact."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from dynkit.core.differences import numerical_derivative, parameter_difference
from dynkit.core.no_motion import NoCrossing, NoDerivative, Refused
from dynkit.core.validation import Array
from dynkit.dynamics.map import Map
from dynkit.systems import Henon, HighBounce, Logistic
from tests.effort import some
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


def smooth(random: np.random.Generator) -> tuple[Callable[[float], Array], float]:
    """A random smooth function, which may be steep or oscillate, and a place."""
    (a, b, c), rate = random.normal(size=3), 10.0 ** random.uniform(-1.0, 4.0)
    place = float(random.choice([0.0, random.normal(), 10.0 ** random.uniform(-6.0, 2.0)]))
    coefficients, kind = random.normal(size=6), int(random.integers(5))

    def function(x: float) -> Array:
        near = rate * (x - place) + b
        kinds = (
            lambda: a * np.sin(rate * x) + b * np.cos(0.7 * rate * x),
            lambda: a * np.tanh(near),
            lambda: a * np.exp(-min(near**2, 700.0)) + c * x,
            lambda: a / (1.0 + near**2),
            lambda: np.polyval(coefficients, x),
        )
        return np.array([kinds[kind]()])

    return function, place


def noisy(number: int, accuracy: float) -> tuple[Callable[[float], Array], float, float]:
    """A random smooth function with errors, a place, and a change of slope to compare with."""
    random = np.random.default_rng(number)
    function, place = smooth(random)
    size, steep = abs(function(place)).max(), abs(function(place + 1e-7) - function(place)) / 1e-7
    noise = accuracy * size if accuracy > ROUNDING else 0.0
    corner = random.choice([-1.0, 1.0]) * 10.0 ** random.uniform(-2.0, 1.0) * max(steep[0], size)
    return lambda x: function(x) + noise * random.uniform(-1.0, 1.0), place, float(corner)


def bent(
    function: Callable[[float], Array], place: float, corner: float, jump: float = 0.0
) -> Callable[[float], Array]:
    """The function with another slope, and a jump, beyond a place."""
    return lambda x: function(x) + corner * max(x - place, 0.0) + jump * (x > place)


ACCURACIES = [ROUNDING, 1e-13, 1e-11, 1e-9, 1e-6]


@pytest.mark.parametrize("accuracy", ACCURACIES)
def test_smooth_functions_have_a_derivative(accuracy: float) -> None:
    for number in some(range(10_000), 40):
        function, place, _ = noisy(number, accuracy)
        parameter_difference(function, place, accuracy=accuracy)


@pytest.mark.parametrize("accuracy", ACCURACIES[:2])
def test_functions_with_a_corner_have_no_derivative(accuracy: float) -> None:
    for number in some(range(2_000), 40):
        function, place, corner = noisy(number, accuracy)
        with pytest.raises(NoDerivative, match="slopes on both sides differ"):
            parameter_difference(bent(function, place, corner), place, accuracy=accuracy)


def test_the_error_at_a_corner_covers_the_slopes_on_both_sides() -> None:
    for number in some(range(2_000), 40):
        function, place, corner = noisy(number, 1e-13)
        slope = parameter_difference(function, place, accuracy=1e-13)

        one = bent(function, place, corner)

        def along(x: Array, one: Callable[[float], Array] = one) -> Array:
            return one(float(x[0]))

        try:
            found, error = numerical_derivative(along, np.array([place]), accuracy=1e-13)
        except NoDerivative:
            continue
        assert abs(found[0] - slope) <= error[0]
        assert abs(found[0] - slope - corner) <= error[0]


@pytest.mark.parametrize("edge", [1.0 - 1e-3, -1.0])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_near_an_end_of_the_range_a_corner_has_no_derivative(edge: float, way: float) -> None:
    def bounded(x: float) -> Array:
        if way * x < edge:
            raise Refused
        return wave(x) + abs(x - way)

    with pytest.raises(NoDerivative):
        parameter_difference(bounded, way)


@pytest.mark.parametrize("jump", [1e-3, 1.0])
def test_a_jump_has_no_derivative(jump: float) -> None:
    for number in range(50):
        function, place, corner = noisy(number, 1e-13)
        with pytest.raises(NoDerivative):
            parameter_difference(bent(function, place, 0.0, jump * corner), place, accuracy=1e-13)


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


@pytest.mark.parametrize("digits", [9, 10, 11])
def test_values_less_exact_than_said_do_not_look_like_corners(digits: int) -> None:
    def values(x: float) -> Array:
        return np.round(np.array([np.sin(x), np.exp(x)]), digits)

    errors, refused = [], []
    for x in np.random.default_rng(0).uniform(0.2, 1.3, 200).tolist():
        try:
            slope = parameter_difference(values, x)
        except NoDerivative as refusal:
            refused.append(str(refusal))
        else:
            errors.append(abs(slope / [np.cos(x), np.exp(x)] - 1.0).max())
    assert len(refused) <= 4
    assert all("differences do not settle" in message for message in refused)
    assert np.median(errors) < 1e-6


@pytest.mark.parametrize("size", [1e2, 1e4, 1e6, 1e8, 1e10])
def test_steps_near_multiples_of_a_period_are_not_taken_for_small_ones(size: float) -> None:
    def kicked(state: Array) -> Array:
        return np.array([state[0] + size * np.sin(state[1]), state[1] + state[0] / size])

    for angle in np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, 100).tolist():
        derivative, error = numerical_derivative(kicked, np.array([0.3 * size, angle]))
        exact = [[1.0, size * np.cos(angle)], [1.0 / size, 1.0]]
        assert (abs(derivative - exact) <= error).all()


@pytest.mark.parametrize(
    "sizes", [(1.0, 1e3), (1.0, 1e9), (1e-3, 1e6), (1e-6, 1e4), (1e9, 1.0, 1e9), (1e-6, 1e-6)]
)
def test_coordinates_may_differ_by_large_factors(sizes: tuple[float, ...]) -> None:
    """Metres beside gigapascals: steps for the large numbers are many periods of the small ones."""
    unit = np.array(sizes)
    for number in range(30):
        random = np.random.default_rng(number)
        linear, waves = random.normal(size=(2, len(unit), len(unit)))
        phase, place = random.uniform(-1.0, 1.0, (2, len(unit)))
        waves *= random.uniform(0.5, 3.0)

        def values(
            x: Array, linear: Array = linear, waves: Array = waves, phase: Array = phase
        ) -> Array:
            return np.asarray(unit * (linear @ (x / unit) + np.sin(waves @ (x / unit) + phase)))

        exact = linear + np.cos(waves @ place + phase)[:, None] * waves
        found, error = numerical_derivative(values, unit * place)
        assert (abs(found - exact * unit[:, None] / unit) <= error).all()
        assert abs(found / unit[:, None] * unit - exact).max() < 1e-2


def _grainy(kind: str, grain: float, number: int) -> tuple[Callable[[Array], Array], Array, Array]:
    """A function whose values have errors, a place, and its exact derivative there."""
    random = np.random.default_rng(number)
    place = random.uniform(-2.0, 2.0, 2)
    waves, linear = 2.0 * random.normal(size=(2, 2)), random.normal(size=(2, 2))
    noise: dict[bytes, Array] = {}

    def values(x: Array) -> Array:
        exact = linear @ x + np.sin(waves @ x)
        if kind == "rounded":
            return np.round(exact / grain) * grain
        return np.asarray(exact + grain * noise.setdefault(x.tobytes(), random.uniform(-1, 1, 2)))

    return values, place, linear + np.cos(waves @ place)[:, None] * waves


def _along(values: Callable[[Array], Array], other: float, x: float) -> Array:
    return values(np.array([x, other]))


@pytest.mark.parametrize("kind", ["rounded", "noisy"])
@pytest.mark.parametrize("grain", [1e-9, 1e-8, 1e-7, 1e-6])
def test_values_with_large_errors_that_are_declared_exact(kind: str, grain: float) -> None:
    """A root finder stops early: the derivative is right, or its error is large, or none is said.

    At steps below the rounding nothing changes: a derivative of zero would look exact.
    """
    refused = 0
    for number in range(60):
        values, place, exact = _grainy(kind, grain, number)
        try:
            found, error = numerical_derivative(values, place)
        except NoDerivative:
            refused += 1
        else:
            assert (abs(found - exact) <= error + 1e-2 * abs(exact).max()).all()
        try:
            slope = parameter_difference(partial(_along, values, float(place[1])), float(place[0]))
        except NoDerivative:
            continue
        assert abs(slope - exact[:, 0]).max() <= 1e-2 * abs(exact[:, 0]).max()
    assert refused <= 1


def test_a_rounded_value_beside_exact_ones_has_no_derivative_of_zero() -> None:
    for number in range(60):
        values, place, exact = _grainy("rounded", 1e-7, number)

        def beside(x: Array, values: Callable[[Array], Array] = values) -> Array:
            return np.append(values(x)[0], np.sin(x))

        found, error = numerical_derivative(beside, place)
        assert (abs(found[0] - exact[0]) <= error[0] + 1e-2 * abs(exact).max()).all()


@pytest.mark.parametrize("border", [1e-3, 3e-3, 5e-3, 7e-3, 2e-2])
def test_a_part_that_is_constant_up_to_a_border_has_a_derivative_of_zero(border: float) -> None:
    """Like a slider that sticks unless the state changes by more: that is no rounded value."""

    def sliding(x: Array) -> Array:
        beyond = max(x[0] - 0.5 - border, 0.0)
        return np.array([np.sin(3.0 * x[0]), beyond + (beyond > 0.0) * 1e-3])

    found, error = numerical_derivative(sliding, np.array([0.5]))
    assert abs(found[0, 0] - 3.0 * np.cos(1.5)) <= error[0, 0] < 1e-8
    assert abs(found[1, 0]) <= error[1, 0] < 1e-8


@pytest.mark.parametrize("tiny", [1e-16, 1e-100, 1e-300, 1e-310, 5e-324])
def test_a_coordinate_that_has_decayed_costs_no_more_than_zero(tiny: float) -> None:
    calls = [0]

    def decaying(x: Array) -> Array:
        calls[0] += 1
        return np.array([2.8 * x[0] * (1.0 - x[0]), 0.3 * x[1] * (1.0 + x[0])])

    found, error = numerical_derivative(decaying, np.array([0.6, tiny]))
    exact = [[-0.56, 0.0], [0.3 * tiny, 0.48]]
    assert (abs(found - exact) <= error).all()
    assert calls[0] <= 200
