"""The conformance suite passes what conforms, and names the defect of what does not."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import pytest

from dynkit import testing
from dynkit.attractors import Attractor, MapAttractor
from dynkit.flows import Crossing, Flow
from dynkit.labels import OrbitLabel
from dynkit.maps import Map
from dynkit.results import Cost
from dynkit.sections import Hyperplane, PoincareMap, PoincareSection
from dynkit.validation import Array
from tests.example_systems import CircleRotation, DampedRotation, Henon, Logistic, Sphere

STATES = np.array([[0.3, 0.1], [-0.7, 0.2], [1.1, -0.3]])
STATES_3D = np.array([[0.9, 0.2, 0.5], [-0.3, 1.4, -0.2]])
PLANE = Hyperplane(np.array([0.3, 1.0, 0.2]), 0.1)
POINTS = np.array([[0.9, 0.4], [1.3, -0.2]])


def henon_attractor(transient: int, states: int) -> MapAttractor:
    return MapAttractor(Henon(), np.array([0.1, 0.1]), transient, states)


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


@pytest.mark.parametrize("check", testing.flow_checks, ids=testing.check_name)
def test_flows_conform(check: testing.FlowCheck) -> None:
    check(DampedRotation(), STATES_3D)


@pytest.mark.parametrize("check", testing.poincare_map_checks, ids=testing.check_name)
def test_poincare_maps_conform(check: testing.PoincareMapCheck) -> None:
    check(PoincareMap(DampedRotation(), PLANE, 10.0), POINTS)


@pytest.mark.parametrize("check", testing.section_checks, ids=testing.check_name)
@pytest.mark.parametrize("section", [PLANE, Sphere(2.0, -1)], ids=repr)
def test_sections_conform(check: testing.SectionCheck, section: PoincareSection) -> None:
    check(section, POINTS)


@pytest.mark.parametrize("check", testing.attractor_checks, ids=testing.check_name)
@pytest.mark.parametrize("system", [Henon(), Logistic(3.2)], ids=repr)
def test_attractors_conform(check: testing.AttractorCheck, system: Map) -> None:
    check(partial(MapAttractor, system, np.full(system.dimension, 0.1)))


# ------------------------------------------------------------------------------- broken maps


class LongHenon(Henon):
    def __call__(self, state: Array) -> Array:
        return np.append(super().__call__(state), 0.0)


class TransposedJacobian(Henon):
    def jacobian(self, state: Array) -> Array:
        return super().jacobian(state)[:1]


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
    (InPlaceHenon(), testing.map_is_pure, "the call leaves its argument"),
    (ForgetfulHenon(), testing.map_is_pure, "the call is pure"),
    (CarelessHenon(), testing.map_refuses_bad_states, "the call refuses nan with ValueError"),
    (WrongErrorHenon(), testing.map_refuses_bad_states, "the call refuses nan with ValueError"),
    (SlightlyWrongJacobian(), testing.jacobian_is_the_derivative, "the jacobian is the derivative"),
    (SwappedJacobian(), testing.jacobian_is_the_derivative, "the jacobian is the derivative"),
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
    with pytest.raises((AssertionError, ValueError)):
        testing.check_map(system, STATES)


class Jump(Henon):
    def __call__(self, state: Array) -> Array:
        return super().__call__(state) + (0.1 if state[0] >= 1.0 else 0.0)


def test_a_state_at_a_jump_is_said_to_be_no_place_to_compare() -> None:
    with pytest.raises(AssertionError, match="differences do not converge"):
        testing.jacobian_is_the_derivative(Jump(), np.array([[1.0, 0.4]]))


# ------------------------------------------------------------------------------- broken flows


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
    def advance(self, state: Array, duration: float) -> Array:
        return super().advance(state, duration**2 / (1.0 + duration))


class FrozenDerivative(DampedRotation):
    def derivative(self, state: Array, duration: float) -> Array:
        return super().derivative(state, duration) + np.diag([0.0, 0.0, 1e-4])

    def advance(self, state: Array, duration: float) -> Array:
        return np.asarray(super().derivative(state, duration) @ state)


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
    ],
)
def test_a_broken_flow_is_caught_by_name(
    flow: Flow, check: testing.FlowCheck, message: str
) -> None:
    with pytest.raises(AssertionError, match=message):
        check(flow, STATES_3D)
    with pytest.raises(AssertionError):
        testing.check_flow(flow, STATES_3D)


@dataclass(frozen=True)
class ShiftedCrossing(DampedRotation):
    """Reports a crossing moved in time, in space, or by whole returns."""

    late: float = 0.0
    aside: float = 0.0
    turns: int = 1
    against: bool = False
    patient: bool = False

    def next_crossing(self, state: Array, section: PoincareSection, time_limit: float) -> Crossing:
        if self.against:
            section = Hyperplane(section.gradient(state), 0.1 / np.sqrt(1.13), -1)
        limit = 100.0 if self.patient or self.turns > 1 else time_limit
        time = 0.0
        here = state
        for _ in range(self.turns):
            crossing = super().next_crossing(here, section, limit)
            time, here = time + crossing.time, crossing.state
        return Crossing(time + self.late, here + self.aside)


@pytest.mark.parametrize(
    ("flow", "check", "message"),
    [
        (
            ShiftedCrossing(aside=1e-3),
            testing.crossing_lands_on_the_section,
            "crossings lie on the section",
        ),
        (
            ShiftedCrossing(against=True),
            testing.crossing_goes_in_the_direction,
            "crossings go in the section's direction",
        ),
        (
            ShiftedCrossing(late=1e-3),
            testing.crossing_is_where_the_flow_is,
            "the flow at the return time",
        ),
        (
            ShiftedCrossing(late=-20.0),
            testing.crossing_is_where_the_flow_is,
            "return times are positive",
        ),
        (ShiftedCrossing(turns=2), testing.crossing_is_the_first, "crossings are the first"),
        (ShiftedCrossing(patient=True), testing.time_limit_is_kept, "NoCrossing is raised"),
    ],
)
def test_a_broken_crossing_is_caught_by_name(
    flow: Flow, check: testing.PoincareMapCheck, message: str
) -> None:
    system = PoincareMap(flow, PLANE, 10.0)
    with pytest.raises(AssertionError, match=message):
        check(system, POINTS)
    with pytest.raises(AssertionError):
        testing.check_poincare_map(system, POINTS)


# ------------------------------------------------------------------------------- broken sections


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


# ------------------------------------------------------------------------------- broken attractors


class Wrapped(Attractor):
    """An attractor as good as the one it wraps; its subclasses spoil one thing each."""

    def __init__(self, transient: int, kept: int) -> None:
        self.inner = henon_attractor(transient, kept)

    @property
    def system(self) -> Map:
        return self.inner.system

    @property
    def transient(self) -> int:
        return self.inner.transient

    @property
    def states(self) -> Array:
        return self.inner.states

    @property
    def label(self) -> OrbitLabel:
        return self.inner.label

    @property
    def cost(self) -> Cost:
        return self.inner.cost

    @property
    def error(self) -> float:
        return self.inner.error

    def time_series(self, times: Array) -> Array:
        return self.inner.time_series(times)

    def section(self, section: PoincareSection) -> Array:
        return self.inner.section(section)


class KeepsOneMore(Wrapped):
    @property
    def states(self) -> Array:
        return henon_attractor(self.transient, len(self.inner.states) + 1).states


class ForgetsTransient(Wrapped):
    @property
    def transient(self) -> int:
        return 0


class Writeable(Wrapped):
    @property
    def states(self) -> Array:
        return self.inner.states.copy()


class Wavering(Wrapped):
    made = 0

    def __init__(self, transient: int, kept: int) -> None:
        super().__init__(transient, kept)
        Wavering.made += 1
        self.number = Wavering.made

    @property
    def error(self) -> float:
        return float(self.number)


class SkipsOneMore(Wrapped):
    @property
    def states(self) -> Array:
        skipped = self.transient + (1 if self.transient else 0)
        return henon_attractor(skipped, len(self.inner.states)).states


class DrivenByCompany(Wrapped):
    def time_series(self, times: Array) -> Array:
        return super().time_series(times) + 1e-12 * len(times)


class FlatSection(Wrapped):
    def section(self, section: PoincareSection) -> Array:
        return super().section(section)[:, 0]


class NegativeError(Wrapped):
    @property
    def error(self) -> float:
        return float("nan")


BROKEN_ATTRACTORS: list[tuple[type[Wrapped], testing.AttractorCheck, str]] = [
    (KeepsOneMore, testing.attractor_states_have_the_shape, "the states has shape"),
    (ForgetsTransient, testing.attractor_states_have_the_shape, "the transient is kept"),
    (Writeable, testing.attractor_states_have_the_shape, "the states are read-only"),
    (Wavering, testing.attractor_is_deterministic, "the error is deterministic"),
    (SkipsOneMore, testing.transient_skips_states, "the transient skips states"),
    (DrivenByCompany, testing.time_series_does_not_depend_on_company, "same bits alone"),
    (FlatSection, testing.attractor_has_sections, "the section has shape"),
    (NegativeError, testing.attractor_says_cost_and_error, "the error is not negative"),
]


def test_a_wrapped_attractor_conforms() -> None:
    testing.check_attractor(Wrapped)


@pytest.mark.parametrize(("make", "check", "message"), BROKEN_ATTRACTORS)
def test_a_broken_attractor_is_caught_by_name(
    make: testing.MakeAttractor, check: testing.AttractorCheck, message: str
) -> None:
    with pytest.raises(AssertionError, match=message):
        check(make)
    with pytest.raises(AssertionError):
        testing.check_attractor(make)


@pytest.mark.parametrize("order", range(1, 6))
def test_numerical_derivatives_stay_within_twenty_of_their_errors(order: int) -> None:
    point = np.array([0.7, -1.3])
    found, error = testing.numerical_derivative(lambda x: np.sin(order * x), point)
    exact = np.diag(order * np.cos(order * point))
    assert (np.abs(found - exact) <= 20.0 * error).all()


def test_numerical_derivatives_of_smooth_functions_are_good_to_ten_digits() -> None:
    found, error = testing.numerical_derivative(np.exp, np.array([0.3]))
    assert error.max() < 1e-10
    assert found[0, 0] == pytest.approx(np.exp(0.3), rel=1e-10)
