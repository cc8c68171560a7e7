"""Checks of maps against the contract of `Map`."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.map import Map
from dynkit.testing.requirements import (
    require,
    require_derivative,
    require_parameter_derivatives,
    require_pure,
    require_refusal,
    require_shape,
    same_bits,
)

MapCheck: TypeAlias = Callable[[Map, Array], None]


def next_state_has_the_shape(system: Map, states: Array) -> None:
    """The next state of a state (d,) is an array (d,) of finite floats."""
    for state in states:
        require_shape("the next state", system(state), (system.dimension,))


def jacobian_has_the_shape(system: Map, states: Array) -> None:
    """The jacobian is an array (d, d) of finite floats."""
    for state in states:
        require_shape("the jacobian", system.jacobian(state), (system.dimension,) * 2)


def jacobian_is_the_product_of_its_factors(system: Map, states: Array) -> None:
    """The factors multiply to the jacobian, to rounding, and each has an error."""
    d = system.dimension
    for state in states:
        factors, errors = system.jacobian_factors(state)
        require_shape("the factors", factors, (len(factors), d, d))
        require_shape("the errors of the factors", errors, (len(factors),))
        product, size = np.eye(d), 1.0
        for factor in factors:
            product, size = factor @ product, size * float(np.linalg.norm(factor))
        off = float(abs(product - system.jacobian(state)).max())
        require(
            off <= 4.0 * len(factors) * d * 2.0**-52 * size,
            "the jacobian is the product of its factors",
            f"at {state} they differ by {off}",
        )


def map_is_pure(system: Map, states: Array) -> None:
    """Calls with the same state return the same bits and leave the state unchanged."""
    require_pure("the call", system, states)
    require_pure("the jacobian", system.jacobian, states)


def map_refuses_bad_states(system: Map, states: Array) -> None:
    """NaN, infinity and wrong shapes raise ValueError."""
    require_refusal("the call", system, states[0])
    require_refusal("the jacobian", system.jacobian, states[0])


def jacobian_is_the_derivative(system: Map, states: Array) -> None:
    """The jacobian equals differences of the call."""
    for state in states:
        require_derivative(
            "the jacobian",
            system.jacobian(state),
            system,
            state,
            difference=system.difference,
            accuracy=system.accuracy,
        )


def parameter_derivatives_are_right(system: Map, states: Array) -> None:
    """The derivatives by the parameters equal differences of the call.

    A parameter at an end of its range is compared at a value inside the range.
    """
    require_parameter_derivatives(
        "the derivative",
        system,
        lambda at: at(states[0]),
        lambda at, name: at.parameter_derivative(states[0], name),
        difference=system.difference,
        accuracy=system.accuracy,
    )


def iterate_repeats_the_call(system: Map, states: Array) -> None:
    """Rows of `iterate` are, bit for bit, repeated calls."""
    for state in states:
        rows = system.iterate(state, 3)
        expected = [np.asarray(state, dtype=np.float64)]
        for _ in range(3):
            expected.append(system(expected[-1]))
        require(same_bits(rows, np.array(expected)), "iterate repeats the call", f"at {state}")


def difference_is_antisymmetric(system: Map, states: Array) -> None:
    """The difference changes sign with its arguments, is zero for equal ones, and broadcasts."""
    rows = system.difference(states, states[0])
    require_shape("the difference of rows", rows, states.shape)
    for i, state in enumerate(states):
        one = system.difference(state, states[0])
        other = system.difference(states[0], state)
        require(bool((one == -other).all()), "the difference is antisymmetric", f"at {state}")
        require(same_bits(one, rows[i]), "the difference goes row by row", f"at {state}")
        itself = system.difference(state, state)
        require(not itself.any(), "the difference of equal states is zero", f"got {itself}")


def replace_changes_what_is_named(system: Map, states: Array) -> None:
    """`replace` with the same values returns the same map, and refuses unknown names."""
    before = dict(system.parameters)
    for name, value in before.items():
        same = system.replace(**{name: value})
        require(
            type(same) is type(system) and dict(same.parameters) == before,
            "replace keeps what is not named",
            f"{name}: {before} became {dict(same.parameters)}",
        )
        require(same_bits(same(states[0]), system(states[0])), "replace keeps the map", f"{name}")
    try:
        system.replace(**{"no such parameter": 1.0})
    except ValueError:
        return
    require(False, "replace refuses unknown names with ValueError", "it did not")


map_checks: tuple[MapCheck, ...] = (
    next_state_has_the_shape,
    jacobian_has_the_shape,
    jacobian_is_the_product_of_its_factors,
    map_is_pure,
    map_refuses_bad_states,
    jacobian_is_the_derivative,
    parameter_derivatives_are_right,
    iterate_repeats_the_call,
    difference_is_antisymmetric,
    replace_changes_what_is_named,
)


def check_map(system: Map, states: Array) -> None:
    """Run all `map_checks` on a map, at states (k, d)."""
    given = finite_array("states", states, (None, system.dimension))
    for check in map_checks:
        check(system, given)
