"""Checks of flows against the contract of `Flow`."""

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import numpy as np

from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.flow import Flow
from dynkit.testing.requirements import (
    FLOW_ACCURACY,
    VectorFunction,
    require_close,
    require_derivative,
    require_parameter_derivatives,
    require_pure,
    require_refusal,
    require_shape,
)

FlowCheck: TypeAlias = Callable[[Flow, Array], None]

# Duration for which the checks advance a state.
_DURATION = 0.5


def flow_results_have_the_shape(flow: Flow, states: Array) -> None:
    """Velocity, advanced state and derivative are finite and of their shapes."""
    d = flow.dimension
    for state in states:
        require_shape("the velocity", flow.velocity(state), (d,))
        require_shape("the advanced state", flow.advance(state, _DURATION), (d,))
        require_shape("the derivative", flow.derivative(state, _DURATION), (d, d))


def flow_is_pure(flow: Flow, states: Array) -> None:
    """Calls with the same state return the same bits and leave the state unchanged."""
    for name, function in _functions(flow):
        require_pure(name, function, states)


def flow_refuses_bad_states(flow: Flow, states: Array) -> None:
    """NaN, infinity and wrong shapes raise ValueError."""
    for name, function in _functions(flow):
        require_refusal(name, function, states[0])


def advance_composes(flow: Flow, states: Array) -> None:
    """Advance by zero changes nothing; two advances are one advance by the sum."""
    for state in states:
        require_close("advance by zero", flow.advance(state, 0.0), state, FLOW_ACCURACY)
        twice = flow.advance(flow.advance(state, _DURATION), 0.7 * _DURATION)
        once = flow.advance(state, 1.7 * _DURATION)
        require_close("advance twice", twice, once, FLOW_ACCURACY)


def velocity_is_the_rate_of_advance(flow: Flow, states: Array) -> None:
    """The velocity equals differences, in time, of the advanced state."""
    for state in states:
        velocity = flow.velocity(flow.advance(state, _DURATION))
        path = partial(_path, flow, state)
        require_derivative(
            "the velocity",
            velocity[:, None],
            path,
            np.array([_DURATION]),
            accuracy=flow.accuracy,
        )


def flow_derivative_is_the_derivative(flow: Flow, states: Array) -> None:
    """The derivative equals differences of the advanced state."""
    for state in states:
        require_derivative(
            "the flow's derivative",
            flow.derivative(state, _DURATION),
            lambda start: flow.advance(start, _DURATION),
            state,
            accuracy=flow.accuracy,
        )


def flow_parameter_derivatives_are_right(flow: Flow, states: Array) -> None:
    """The derivatives by the parameters equal differences of the advanced state."""
    require_parameter_derivatives(
        "the flow's derivative",
        flow,
        lambda at: at.advance(states[0], _DURATION),
        lambda at, name: at.parameter_derivative(states[0], _DURATION, name),
        accuracy=flow.accuracy,
    )


flow_checks: tuple[FlowCheck, ...] = (
    flow_results_have_the_shape,
    flow_is_pure,
    flow_refuses_bad_states,
    advance_composes,
    velocity_is_the_rate_of_advance,
    flow_derivative_is_the_derivative,
    flow_parameter_derivatives_are_right,
)


def check_flow(flow: Flow, states: Array) -> None:
    """Run all `flow_checks` on a flow, at states (k, d)."""
    given = finite_array("states", states, (None, flow.dimension))
    for check in flow_checks:
        check(flow, given)


def _functions(flow: Flow) -> list[tuple[str, VectorFunction]]:
    return [
        ("the velocity", flow.velocity),
        ("the advanced state", lambda state: flow.advance(state, _DURATION)),
        ("the flow's derivative", lambda state: flow.derivative(state, _DURATION)),
    ]


def _path(flow: Flow, start: Array, time: Array) -> Array:
    return flow.advance(start, float(time[0]))
