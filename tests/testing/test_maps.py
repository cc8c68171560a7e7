"""The checks of maps pass what conforms, and name the defect of what does not."""

from functools import cached_property
from typing import Any

import numpy as np
import pytest

from dynkit import testing
from dynkit.core.no_motion import NoDerivative
from dynkit.core.validation import Array
from dynkit.dynamics.map import Map
from dynkit.dynamics.poincare_map import PoincareMap
from dynkit.systems import Henon, Logistic
from tests.example_systems import CircleRotation, DampedRotation
from tests.testing.cases import PLANE, POINTS, STATES


@pytest.mark.parametrize("check", testing.map_checks, ids=testing.check_name)
@pytest.mark.parametrize(
    ("system", "states"),
    [
        (Henon(), STATES),
        (CircleRotation(1.0), STATES),
        (Logistic(3.9), np.array([[0.2], [0.6]])),
        (PoincareMap(DampedRotation(), PLANE, 10.0), POINTS),
    ],
    ids=lambda value: type(value).__name__,
)
def test_maps_conform(check: testing.MapCheck, system: Map, states: Array) -> None:
    check(system, states)


class LongHenon(Henon):
    def __call__(self, state: Array) -> Array:
        return np.append(super().__call__(state), 0.0)


class TransposedJacobian(Henon):
    def jacobian(self, state: Array) -> Array:
        return super().jacobian(state)[:1]


class OtherFactors(Henon):
    jacobian = Henon.jacobian

    def jacobian_factors(self, state: Array) -> tuple[Array, Array]:
        factors, errors = super().jacobian_factors(state)
        return 1.001 * factors, errors


class InPlaceHenon(Henon):
    def __call__(self, state: Array) -> Array:
        result = super().__call__(state)
        state[:] = result
        return result


class ForgetfulHenon(Henon):
    """Counts its calls, and changes with them."""

    @cached_property
    def calls(self) -> list[int]:
        return []

    def __call__(self, state: Array) -> Array:
        self.calls.append(1)
        return super().__call__(state) + 1e-15 * len(self.calls)


class CarelessHenon(Henon):
    def __call__(self, state: Array) -> Array:
        return super().__call__(np.nan_to_num(np.asarray(state), posinf=0.0)[:2])


class WrongErrorHenon(Henon):
    def __call__(self, state: Array) -> Array:
        if not np.isfinite(state).all():
            raise TypeError("state must be finite")
        return super().__call__(state)


class SlightlyWrongJacobian(Henon):
    def jacobian(self, state: Array) -> Array:
        return super().jacobian(state) * (1.0 + 1e-7)


class SwappedJacobian(Henon):
    def jacobian(self, state: Array) -> Array:
        return super().jacobian(state).T


class SlightlyWrongInB(Henon):
    def parameter_derivative(self, state: Array, name: str) -> Array:
        return super().parameter_derivative(state, name) * (1.0 + 1e-7 * (name == "b"))


class OneSidedRotation(CircleRotation):
    def difference(self, a: Array, b: Array) -> Array:
        gap = np.array(np.asarray(a) - np.asarray(b))
        gap[..., 0] %= 2.0 * np.pi
        return gap


class ForgetsParameters(Henon):
    def replace(self, **parameters: float) -> "ForgetsParameters":
        super().replace(**parameters)
        return ForgetsParameters(**{"b": 0.2, **parameters})


class TakesAnyParameter(Henon):
    def replace(self, **parameters: float) -> "TakesAnyParameter":
        return TakesAnyParameter(self.a, self.b)


class OtherIterate(Henon):
    """`iterate` is final; an override all the same is what the check is for."""


def other_iterate(self: Map, state: Array, n: int) -> Array:
    return Henon().iterate(state, n) * (1.0 + 2.0**-52)


setattr(OtherIterate, "iterate", other_iterate)  # noqa: B010

BROKEN_MAPS: list[tuple[Map, testing.MapCheck, str]] = [
    (LongHenon(), testing.next_state_has_the_shape, r"the next state has shape \(2,\)"),
    (TransposedJacobian(), testing.jacobian_has_the_shape, r"the jacobian has shape \(2, 2\)"),
    (
        OtherFactors(),
        testing.jacobian_is_the_product_of_its_factors,
        "the jacobian is the product of its factors",
    ),
    (InPlaceHenon(), testing.map_is_pure, "the call leaves its argument"),
    (ForgetfulHenon(), testing.map_is_pure, "the call is pure"),
    (CarelessHenon(), testing.map_refuses_bad_states, "the call refuses nan with ValueError"),
    (WrongErrorHenon(), testing.map_refuses_bad_states, "the call refuses nan with ValueError"),
    (SlightlyWrongJacobian(), testing.jacobian_is_the_derivative, "the jacobian is the derivative"),
    (SwappedJacobian(), testing.jacobian_is_the_derivative, "the jacobian is the derivative"),
    (
        SlightlyWrongInB(),
        testing.parameter_derivatives_are_right,
        "the derivative by b is the derivative",
    ),
    (OtherIterate(), testing.iterate_repeats_the_call, "iterate repeats the call"),
    (
        OneSidedRotation(1.0),
        testing.difference_is_antisymmetric,
        "the difference is antisymmetric",
    ),
    (ForgetsParameters(), testing.replace_changes_what_is_named, "replace keeps what is not named"),
    (TakesAnyParameter(), testing.replace_changes_what_is_named, "replace refuses unknown names"),
]


@pytest.mark.parametrize(("system", "check", "message"), BROKEN_MAPS)
def test_a_broken_map_is_caught_by_name(system: Map, check: testing.MapCheck, message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check(system, STATES)


@pytest.mark.parametrize("system", [system for system, _, _ in BROKEN_MAPS])
def test_check_map_catches_every_broken_map(system: Map) -> None:
    with pytest.raises((AssertionError, ValueError, NoDerivative)):
        testing.check_map(system, STATES)


class Jump(Henon):
    jacobian = Henon.jacobian

    def __call__(self, state: Array) -> Array:
        return super().__call__(state) + (0.1 if state[0] >= 1.0 else 0.0)


def test_a_state_at_a_jump_is_said_to_be_no_place_to_compare() -> None:
    with pytest.raises(AssertionError, match="differences do not converge"):
        testing.jacobian_is_the_derivative(Jump(), np.array([[1.0, 0.4]]))


def test_states_may_be_lists() -> None:
    rows: Any = [[0.1, 0.2], [0.3, -0.1]]
    testing.check_map(Henon(), rows)
    testing.check_section(PLANE, POINTS.tolist())


def test_a_single_state_in_place_of_states_is_refused_with_its_shape() -> None:
    with pytest.raises(ValueError, match=r"states must have shape \(n, 2\), .*; got shape \(2,\)$"):
        testing.check_map(Henon(), STATES[0])


def test_a_call_that_accepts_nan_is_told_how_to_refuse_it() -> None:
    class Plain(Map):
        dimension = 1

        def __call__(self, state: Array) -> Array:
            return 0.5 * state

    with pytest.raises(AssertionError, match=r"refuses nan .* dynkit\.core\.validation\.finite_"):
        testing.check_map(Plain(), np.array([[1.0]]))
