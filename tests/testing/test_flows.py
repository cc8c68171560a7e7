"""The checks of flows pass what conforms, and name the defect of what does not."""

from functools import cached_property

import numpy as np
import pytest

from dynkit import testing
from dynkit.core.validation import Array
from dynkit.dynamics.flow import Flow
from tests.example_systems import DampedRotation
from tests.testing.cases import STATES_3D


@pytest.mark.parametrize("check", testing.flow_checks, ids=testing.check_name)
def test_flows_conform(check: testing.FlowCheck) -> None:
    check(DampedRotation(), STATES_3D)


class FastFlow(DampedRotation):
    def velocity(self, state: Array) -> Array:
        return 1.001 * super().velocity(state)


class WrongShapeFlow(DampedRotation):
    def velocity(self, state: Array) -> Array:
        return super().velocity(state)[:2]


class NoisyFlow(DampedRotation):
    @cached_property
    def noise(self) -> np.random.Generator:
        return np.random.default_rng(0)

    def velocity(self, state: Array) -> Array:
        return super().velocity(state) + 1e-12 * self.noise.normal()


class CarelessFlow(DampedRotation):
    def velocity(self, state: Array) -> Array:
        return super().velocity(np.nan_to_num(state))


class SlowStart(DampedRotation):
    derivative = DampedRotation.derivative

    def advance(self, state: Array, duration: float) -> Array:
        return super().advance(state, duration**2 / (1.0 + duration))


class FrozenDerivative(DampedRotation):
    def derivative(self, state: Array, duration: float) -> Array:
        return super().derivative(state, duration) + np.diag([0.0, 0.0, 1e-4])

    def advance(self, state: Array, duration: float) -> Array:
        return np.asarray(super().derivative(state, duration) @ state)


class NoEffectOfDecay(DampedRotation):
    def parameter_derivative(self, state: Array, duration: float, name: str) -> Array:
        return super().parameter_derivative(state, duration, name) * (name != "decay")


@pytest.mark.parametrize(
    ("flow", "check", "message"),
    [
        (WrongShapeFlow(), testing.flow_results_have_the_shape, "the velocity has shape"),
        (NoisyFlow(), testing.flow_is_pure, "the velocity is pure"),
        (CarelessFlow(), testing.flow_refuses_bad_states, "the velocity refuses nan"),
        (SlowStart(), testing.advance_composes, "advance twice"),
        (FastFlow(), testing.velocity_is_the_rate_of_advance, "the velocity is the derivative"),
        (
            FrozenDerivative(),
            testing.flow_derivative_is_the_derivative,
            "the flow's derivative is the derivative",
        ),
        (
            NoEffectOfDecay(),
            testing.flow_parameter_derivatives_are_right,
            "the flow's derivative by decay is the derivative",
        ),
    ],
)
def test_a_broken_flow_is_caught_by_name(
    flow: Flow, check: testing.FlowCheck, message: str
) -> None:
    with pytest.raises(AssertionError, match=message):
        check(flow, STATES_3D)
    with pytest.raises(AssertionError):
        testing.check_flow(flow, STATES_3D)
