"""The checks of sections pass what conforms, and name the defect of what does not."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from dynkit import testing
from dynkit.core.validation import Array
from dynkit.dynamics.section import Hyperplane, PoincareSection, Stroboscope
from tests.example_systems import Sphere
from tests.testing.cases import PLANE, POINTS


@pytest.mark.parametrize("check", testing.section_checks, ids=testing.check_name)
@pytest.mark.parametrize(
    "section",
    [
        PLANE,
        Hyperplane(np.array([1.0, 0.0, -2.0]), 0.3, -1, angles=[1]),
        Stroboscope(3, phase=-2.0),
        Sphere(2.0, -1),
    ],
    ids=repr,
)
def test_sections_conform(check: testing.SectionCheck, section: PoincareSection) -> None:
    check(section, POINTS)


class BrokenSphere(Sphere):
    """A sphere with one function replaced."""

    def __init__(self, name: str, function: Callable[..., Any]) -> None:
        super().__init__(radius=2.0)
        setattr(self, name, partial(function, Sphere(2.0)))


def careless(sphere: Sphere, state: Array) -> Array:
    return sphere.reduce(np.nan_to_num(state))


def in_place(sphere: Sphere, state: Array) -> Array:
    result = sphere.reduce(state)
    state[0] = 0.0
    return result


@pytest.mark.parametrize(
    ("section", "check", "message"),
    [
        (
            BrokenSphere("lift", lambda sphere, point: 1.01 * sphere.lift(point)),
            testing.lift_lands_on_the_section,
            "lift lands on the section",
        ),
        (
            BrokenSphere("reduce", lambda sphere, state: sphere.reduce(state)[::-1]),
            testing.reduce_inverts_lift,
            "reduce after lift",
        ),
        (
            BrokenSphere("gradient", lambda sphere, state: -sphere.gradient(state)),
            testing.section_derivatives_are_right,
            "the gradient is the derivative",
        ),
        (
            BrokenSphere(
                "reduce_derivative", lambda sphere, state: 1.001 * sphere.reduce_derivative(state)
            ),
            testing.section_derivatives_are_right,
            "the derivative of reduce is the derivative",
        ),
        (
            BrokenSphere(
                "lift_derivative", lambda sphere, point: 1.001 * sphere.lift_derivative(point)
            ),
            testing.section_derivatives_are_right,
            "the derivative of lift is the derivative",
        ),
        (BrokenSphere("reduce", careless), testing.section_refuses_bad_states, "reduce refuses"),
        (BrokenSphere("reduce", in_place), testing.section_is_pure, "reduce leaves its argument"),
        (
            Sphere(2.0, direction=0),
            testing.section_has_dimension_and_direction,
            "the direction is a sign",
        ),
        (
            Hyperplane(np.eye(4)[0]),
            testing.section_has_dimension_and_direction,
            "the dimension is 3",
        ),
    ],
)
def test_a_broken_section_is_caught_by_name(
    section: PoincareSection, check: testing.SectionCheck, message: str
) -> None:
    with pytest.raises(AssertionError, match=message):
        check(section, POINTS)
    with pytest.raises(AssertionError):
        testing.check_section(section, POINTS)
