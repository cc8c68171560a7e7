import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from dynkit.core.no_motion import NoCrossing, TangentCrossing
from dynkit.core.validation import Array
from dynkit.dynamics.flow import Crossing
from dynkit.dynamics.poincare_map import PoincareMap
from dynkit.dynamics.section import Hyperplane, PoincareSection, Stroboscope
from dynkit.testing import numerical_derivative
from tests.example_systems import DampedRotation, Sphere

POINTS = np.array([[0.7, 0.2], [1.5, -0.4], [0.1, 3.0]])


def half_plane(direction: int = 1, flow: DampedRotation | None = None) -> PoincareMap:
    """The plane y = 0, crossed upwards where x > 0: its map is known in closed form."""
    section = Hyperplane(np.array([0.0, 1.0, 0.0]), 0.0, direction)
    return PoincareMap(flow or DampedRotation(), section, time_limit=10.0)


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=6).filter(any), st.floats(-10.0, 10.0))
def test_a_chart_is_orthonormal(normal: list[float], offset: float) -> None:
    plane = Hyperplane(np.array(normal), offset)
    chart = plane.lift_derivative(np.zeros(len(normal) - 1))
    basis = np.column_stack([chart, plane.gradient(np.zeros(len(normal)))])
    assert basis.T @ basis == pytest.approx(np.eye(len(normal)), abs=1e-14)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -3.0])
def test_a_plane_across_an_axis_keeps_the_other_coordinates(axis: int, sign: float) -> None:
    state = np.array([1.25, -2.5, 4.75])
    plane = Hyperplane(sign * np.eye(3)[axis], 2.0)
    assert plane.reduce(state).tolist() == np.delete(state, axis).tolist()


def test_the_value_is_the_signed_distance() -> None:
    assert Hyperplane(np.array([3.0, 4.0]), 5.0).value(np.array([6.0, 8.0])) == pytest.approx(9.0)


@pytest.mark.parametrize("length", [1e-200, 1e200])
def test_the_length_of_the_normal_does_not_matter(length: float) -> None:
    plane = Hyperplane(length * np.array([3.0, 4.0]), length * 5.0)
    assert plane.value(np.array([6.0, 8.0])) == pytest.approx(9.0)


@pytest.mark.parametrize(
    ("normal", "offset", "direction", "message"),
    [
        ([0.0, 0.0], 0.0, 1, "normal must not be zero; got [0.0, 0.0]"),
        ([1.0], 0.0, 1, "normal must have 2 or more coordinates; got 1"),
        ([1.0, np.nan], 0.0, 1, "normal[1] must be a finite number; got nan"),
        ([1.0, 0.0], np.inf, 1, "offset must be a finite number; got inf"),
        ([1.0, 0.0], 0.0, 0, "direction must be +1 or -1; got 0"),
        ([1.0, 0.0], 0.0, True, "direction must be +1 or -1; got True"),
        ([1.0, 0.0], 0.0, np.ones(2), "direction must be +1 or -1; got array([1., 1.])"),
        ([1.0, 0.0], 0.0, [], "direction must be +1 or -1; got []"),
        ([1.0, 0.0], 0.0, np.ones(0), "direction must be +1 or -1; got array([], dtype=float64)"),
    ],
)
def test_a_bad_plane_is_refused(
    normal: list[float], offset: float, direction: Any, message: str
) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        Hyperplane(np.array(normal), offset, direction)


@pytest.mark.parametrize(
    ("normal", "angles", "message"),
    [
        ([1.0, 0.0], [2], "angles[0] must be less than 2; got 2"),
        ([1.0, 0.0], [-1], "angles[0] must be zero or a positive integer; got -1"),
        ([1.0, 0.0], [1.0], "angles[0] must be zero or a positive integer; got 1.0"),
        ([1.0, 0.0, 0.0], [1, True], "angles[1] must be zero or a positive integer; got True"),
        ([3.0, 4.0], [1], "normal[1], an angle's, must be zero; got 4.0"),
    ],
)
def test_bad_angles_are_refused(normal: list[float], angles: list[int], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        Hyperplane(np.array(normal), angles=angles)


@pytest.mark.parametrize("angle", [0, 1, 3])
def test_angles_are_reduced_to_one_turn(angle: int) -> None:
    state = np.array([7.0, -1.0, 0.0, 20.0])
    plane = Hyperplane(np.eye(4)[2], angles=[angle])
    expected = np.where(np.arange(4) == angle, state % (2.0 * np.pi), state)
    assert plane.reduce(state).tolist() == np.delete(expected, 2).tolist()


def test_an_oblique_plane_keeps_its_angle() -> None:
    plane = Hyperplane(np.array([1.0, 0.0, 2.0]), angles=[1])
    reduced = plane.reduce(np.array([2.0, 7.0, -1.0]))
    assert 7.0 - 2.0 * np.pi in reduced.tolist()


def test_differences_of_angles_go_the_shortest_way() -> None:
    plane = Hyperplane(np.array([1.0, 0.0, 0.0]), angles=[2])
    gap = plane.difference(np.array([[3.0, 0.1], [3.0, 3.0]]), np.array([1.0, 6.2]))
    assert gap == pytest.approx(np.array([[2.0, 0.1 - 6.2 + 2.0 * np.pi], [2.0, -3.2 + 2 * np.pi]]))


def test_a_poincare_map_measures_as_its_section_does() -> None:
    section = Hyperplane(np.array([0.0, 1.0, 0.0]), angles=[2])
    system = PoincareMap(DampedRotation(), section, time_limit=10.0)
    gap = system.difference(np.array([1.0, 0.1]), np.array([1.0, 6.2]))
    assert gap == pytest.approx([0.0, 0.1 - 6.2 + 2.0 * np.pi])


class RoughRotation(DampedRotation):
    @property
    def accuracy(self) -> float:
        return 1e-9


def test_a_poincare_map_is_as_accurate_as_its_flow() -> None:
    assert half_plane().accuracy == 2.0**-52
    assert half_plane(flow=RoughRotation()).accuracy == 1e-9


@pytest.mark.parametrize("turns", [-2, 0, 5])
def test_a_stroboscope_flashes_once_in_every_turn(turns: int) -> None:
    state = np.array([1.0, 2.0, 0.7 + 2.0 * np.pi * turns])
    flashes = Stroboscope(3, phase=0.7)
    # the phase is rounded to 2^-52 of its size
    assert flashes.value(state) == pytest.approx(0.0, abs=2.0**-52 * 50.0)
    assert flashes.gradient(state) == pytest.approx([0.0, 0.0, 1.0])


def test_half_a_turn_later_a_stroboscope_is_passed_the_other_way() -> None:
    flashes = Stroboscope(3, phase=0.7)
    assert flashes.gradient(np.array([0.0, 0.0, 0.7 + np.pi]))[2] * flashes.direction == -1.0


def test_a_stroboscope_forgets_the_phase() -> None:
    assert Stroboscope(3, phase=0.7).reduce(np.array([1.0, 2.0, 9.0])).tolist() == [1.0, 2.0]


def test_a_stroboscope_takes_angles_modulo_a_turn() -> None:
    flashes = Stroboscope(3, angles=[0])
    assert flashes.reduce(np.array([7.0, 8.0, 9.0])).tolist() == [7.0 % (2.0 * np.pi), 8.0]
    gap = flashes.difference(np.array([0.1, 7.0]), np.array([6.2, 0.0]))
    assert gap == pytest.approx([0.1 - 6.2 + 2.0 * np.pi, 7.0])


def test_an_angle_just_below_zero_is_zero() -> None:
    state = np.array([-1e-17, 0.3, 0.0])
    for section in (Hyperplane(np.eye(3)[2], angles=[0]), Stroboscope(3, angles=[0])):
        assert section.reduce(state)[0] == 0.0


def test_the_phase_of_a_stroboscope_is_no_other_angle() -> None:
    with pytest.raises(ValueError, match=r"^angles\[1\] must be less than 2; got 2$"):
        Stroboscope(3, angles=[0, 2])


@pytest.mark.parametrize(
    ("dimension", "phase", "message"),
    [
        (1, 0.0, "dimension must be 2 or more; got 1"),
        (0, 0.0, "dimension must be a positive integer; got 0"),
        (3.0, 0.0, "dimension must be a positive integer; got 3.0"),
        (3, np.nan, "phase must be a finite number; got nan"),
    ],
)
def test_a_bad_stroboscope_is_refused(dimension: int, phase: float, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        Stroboscope(dimension, phase)


@pytest.mark.parametrize("point", POINTS, ids=str)
def test_the_poincare_map_is_its_closed_form(point: Array) -> None:
    # one turn takes 2 pi / frequency = pi
    expected = point * np.exp([-0.1 * np.pi, -0.3 * np.pi])
    assert half_plane()(point) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("point", POINTS, ids=str)
def test_the_return_time_is_one_turn(point: Array) -> None:
    assert half_plane().return_time(point) == pytest.approx(np.pi, rel=1e-14)


def test_crossings_against_the_direction_do_not_count() -> None:
    # from x > 0 the plane is crossed downwards, at x < 0, after half a turn
    point = half_plane(direction=-1)(np.array([1.0, 1.0]))
    assert point == pytest.approx([-np.exp(-0.05 * np.pi), np.exp(-0.15 * np.pi)], rel=1e-14)


@pytest.mark.parametrize("point", POINTS, ids=str)
def test_the_jacobian_is_its_closed_form(point: Array) -> None:
    expected = np.diag(np.exp([-0.1 * np.pi, -0.3 * np.pi]))
    assert half_plane().jacobian(point) == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize(
    "section",
    [Hyperplane(np.array([0.3, 1.0, 0.2]), 0.1), Hyperplane(np.array([-1.0, 0.4, 0.3]), 0.2, -1)],
    ids=repr,
)
@pytest.mark.parametrize("point", [[0.9, 0.4], [1.3, -0.2]], ids=str)
def test_the_jacobian_across_an_oblique_plane_equals_differences(
    section: PoincareSection, point: list[float]
) -> None:
    system = PoincareMap(DampedRotation(), section, time_limit=10.0)
    found, error = numerical_derivative(system, np.array(point))
    assert (np.abs(system.jacobian(np.array(point)) - found) <= 20.0 * error).all()


@pytest.mark.parametrize("point", [[0.3, 0.4], [1.3, -0.7]], ids=str)
def test_the_jacobian_across_a_curved_section_equals_differences(point: list[float]) -> None:
    system = PoincareMap(DampedRotation(), OffsetSphere(), time_limit=20.0)
    found, error = numerical_derivative(system, np.array(point))
    assert (np.abs(system.jacobian(np.array(point)) - found) <= 20.0 * error).all()


class OffsetSphere(Sphere):
    """A sphere around (1, 0, 0), which the flow crosses inwards and outwards."""

    centre = np.array([1.0, 0.0, 0.0])

    def __init__(self) -> None:
        super().__init__(radius=0.8)

    def value(self, state: Array) -> float:
        return super().value(state - self.centre)

    def gradient(self, state: Array) -> Array:
        return super().gradient(state - self.centre)

    def reduce(self, state: Array) -> Array:
        return super().reduce(state - self.centre)

    def lift(self, reduced: Array) -> Array:
        return np.asarray(super().lift(reduced) + self.centre)

    def reduce_derivative(self, state: Array) -> Array:
        return super().reduce_derivative(state - self.centre)


def test_a_crossing_that_never_comes_is_named() -> None:
    far = Hyperplane(np.array([0.0, 1.0, 0.0]), 5.0)
    with pytest.raises(NoCrossing):
        PoincareMap(DampedRotation(), far, time_limit=3.0)(np.array([1.0, 1.0]))


class Grazing(DampedRotation):
    """Claims a crossing where the velocity lies in the section."""

    def next_crossing(self, state: Array, section: PoincareSection, time_limit: float) -> Crossing:
        return Crossing(1.0, np.zeros(3))


def test_a_tangent_crossing_has_no_jacobian() -> None:
    with pytest.raises(TangentCrossing, match=r"tangent to the section at \[0\.0, 0\.0, 0\.0\]"):
        half_plane(flow=Grazing()).jacobian(np.array([1.0, 1.0]))


def test_the_parameters_of_a_poincare_map_are_those_of_its_flow() -> None:
    system = half_plane().replace(frequency=4.0)
    assert system.return_time(np.array([1.0, 0.0])) == pytest.approx(np.pi / 2, rel=1e-14)


def test_a_section_of_another_dimension_is_refused() -> None:
    with pytest.raises(ValueError, match="section must have the flow's dimension 3; got 2"):
        PoincareMap(DampedRotation(), Hyperplane(np.array([1.0, 0.0])), time_limit=1.0)


def test_a_time_limit_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match=r"time_limit must be positive; got 0\.0"):
        PoincareMap(DampedRotation(), Hyperplane(np.eye(3)[0]), time_limit=0.0)


def test_the_repr_of_a_section_has_its_angles() -> None:
    assert repr(Stroboscope(3, angles=[0])) == "Stroboscope(3, 0.0, angles=[0])"
    plane = Hyperplane(np.array([0.0, 0.0, 1.0]), angles=[1])
    assert repr(plane) == "Hyperplane([0.0, 0.0, 1.0], 0.0, +1, angles=[1])"
    assert repr(Stroboscope(3)) == "Stroboscope(3, 0.0)"
