"""Checks of sections against the contract of `PoincareSection`."""

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import numpy as np

from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.section import PoincareSection
from dynkit.testing.requirements import (
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
