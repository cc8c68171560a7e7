"""Checks of sections against the contract of `PoincareSection`."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

from dynkit.core.no_motion import NoCrossing
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.poincare_map import PoincareMap
from dynkit.dynamics.section import PoincareSection
from dynkit.testing.maps import map_checks
from dynkit.testing.requirements import (
    FLOW_ACCURACY,
    VectorFunction,
    require,
    require_close,
    require_derivative,
    require_pure,
    require_refusal,
    require_shape,
)

SectionCheck: TypeAlias = Callable[[PoincareSection, Array], None]


def section_has_dimension_and_direction(section: PoincareSection, points: Array) -> None:
    """The points have one coordinate less than the states; the direction is +1 or -1."""
    found = points.shape[1] + 1
    require(section.dimension == found, f"the dimension is {found}", f"got {section.dimension}")
    require(section.direction in (1, -1), "the direction is a sign", f"got {section.direction}")


def lift_lands_on_the_section(section: PoincareSection, points: Array) -> None:
    """Lifted points have value zero."""
    for point in points:
        state = section.lift(point)
        require_shape("the lifted state", state, (section.dimension,))
        reach = float(np.linalg.norm(section.gradient(state)) * (1.0 + np.linalg.norm(state)))
        off = abs(section.value(state))
        require(off <= 1e-13 * reach, "lift lands on the section", f"the value is {off}")


def reduce_inverts_lift(section: PoincareSection, points: Array) -> None:
    """`reduce` is the inverse of `lift`."""
    for point in points:
        gap = section.difference(section.reduce(section.lift(point)), point)
        require_close("reduce after lift", point + gap, point, 1e-12)


def section_is_pure(section: PoincareSection, points: Array) -> None:
    """Calls with the same state return the same bits and leave the state unchanged."""
    states = np.array([section.lift(point) for point in points])
    for name, function, on_points in _functions(section):
        require_pure(name, function, points if on_points else states)


def section_refuses_bad_states(section: PoincareSection, points: Array) -> None:
    """NaN, infinity and wrong shapes raise ValueError."""
    for name, function, on_points in _functions(section):
        require_refusal(name, function, points[0] if on_points else section.lift(points[0]))


def section_derivatives_are_right(section: PoincareSection, points: Array) -> None:
    """The gradient, and the derivatives of the chart, equal differences."""
    for point in points:
        state = section.lift(point)
        gradient = section.gradient(state)
        # the rounding of a value near zero is that of its terms: shift the value to their size
        shift = float(np.linalg.norm(gradient) * (1.0 + np.linalg.norm(state)))
        value = partial(_shifted_value, section, shift)
        require_derivative("the gradient", gradient[None], value, state)
        reduced = section.reduce_derivative(state)
        require_derivative(
            "the derivative of reduce",
            reduced,
            section.reduce,
            state,
            difference=section.difference,
        )
        lifted = section.lift_derivative(point)
        require_derivative("the derivative of lift", lifted, section.lift, point)


section_checks: tuple[SectionCheck, ...] = (
    section_has_dimension_and_direction,
    lift_lands_on_the_section,
    reduce_inverts_lift,
    section_is_pure,
    section_refuses_bad_states,
    section_derivatives_are_right,
)


def check_section(section: PoincareSection, points: Array) -> None:
    """Run all `section_checks` on a section, at reduced points (k, d - 1)."""
    given = finite_array("points", points, (None, None))
    for check in section_checks:
        check(section, given)


def _shifted_value(section: PoincareSection, shift: float, state: Array) -> Array:
    return np.array([section.value(state) + shift])


def _functions(section: PoincareSection) -> list[tuple[str, VectorFunction, bool]]:
    return [
        ("the value", lambda state: np.array(section.value(state)), False),
        ("the gradient", section.gradient, False),
        ("reduce", section.reduce, False),
        ("the derivative of reduce", section.reduce_derivative, False),
        ("lift", section.lift, True),
        ("the derivative of lift", section.lift_derivative, True),
    ]


PoincareMapCheck: TypeAlias = Callable[[PoincareMap, Array], None]


def crossing_lands_on_the_section(system: PoincareMap, states: Array) -> None:
    """The section's value is zero at a crossing."""
    for state in states:
        hit = system.crossing(state).state
        reach = float(np.linalg.norm(system.section.gradient(hit)) * (1.0 + np.linalg.norm(hit)))
        off = abs(system.section.value(hit))
        require(off <= FLOW_ACCURACY * reach, "crossings lie on the section", f"the value is {off}")


def crossing_goes_in_the_direction(system: PoincareMap, states: Array) -> None:
    """At a crossing the section's value changes in the section's direction."""
    for state in states:
        hit = system.crossing(state).state
        rate = float(system.section.gradient(hit) @ system.flow.velocity(hit))
        require(
            rate * system.section.direction > 0.0,
            "crossings go in the section's direction",
            f"the value changes at the rate {rate}",
        )


def crossing_is_where_the_flow_is(system: PoincareMap, states: Array) -> None:
    """The return time is positive, and the flow advanced by it is at the crossing."""
    for state in states:
        hit = system.crossing(state)
        require(hit.time > 0.0, "return times are positive", f"got {hit.time}")
        there = system.flow.advance(system.section.lift(state), hit.time)
        require_close("the flow at the return time", there, hit.state, FLOW_ACCURACY)


def crossing_is_the_first(system: PoincareMap, states: Array) -> None:
    """No passage in the section's direction, in 200 samples, comes before the crossing."""
    for state in states:
        here = system.section.lift(state)
        times = np.linspace(0.0, system.return_time(state), 200)[1:-1]
        values = []
        for duration in np.diff(times, prepend=0.0):
            # from sample to sample: `advance_composes` checks that two advances equal one
            here = system.flow.advance(here, duration)
            values.append(system.section.value(here))
        side = system.section.direction * np.array(values) > 0.0
        early = times[1:][side[1:] & ~side[:-1]]
        require(not early.size, "crossings are the first", f"one was missed before {early[:1]}")


def time_limit_is_kept(system: PoincareMap, states: Array) -> None:
    """A time limit of half the return time raises `NoCrossing`."""
    for state in states:
        try:
            replace(system, time_limit=0.5 * system.return_time(state))(state)
        except NoCrossing:
            continue
        require(False, "NoCrossing is raised at the time limit", f"it was not from {state}")


poincare_map_checks: tuple[PoincareMapCheck, ...] = (
    crossing_lands_on_the_section,
    crossing_goes_in_the_direction,
    crossing_is_where_the_flow_is,
    crossing_is_the_first,
    time_limit_is_kept,
)


def check_poincare_map(system: PoincareMap, states: Array) -> None:
    """Run `poincare_map_checks` and `map_checks` on a Poincare map, at states (k, d - 1)."""
    given = finite_array("states", states, (None, None))
    for check in (*poincare_map_checks, *map_checks):
        check(system, given)
