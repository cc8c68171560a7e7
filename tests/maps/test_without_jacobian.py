"""A map or a flow without derivatives can do what others do, and its claims hold."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from typing import Any

import numpy as np
import pytest

from dynkit import (
    Hyperplane,
    Map,
    MapAttractor,
    NoConvergence,
    PoincareMap,
    basins,
    continue_orbit,
    find_orbits,
    periodic_orbit,
    sweep,
)
from dynkit.analysis import LyapunovSpectrum
from dynkit.core.differences import numerical_derivative
from dynkit.core.no_motion import Diverged, NoDerivative, Refused
from dynkit.core.validation import Array
from dynkit.dynamics.flow import Flow
from dynkit.systems import Henon, IntegratedFlow
from dynkit.testing import check_map
from tests.example_systems import DampedRotation
from tests.flows.integrated_flows import Rossler
from tests.maps.without_jacobian import without_jacobian
from tests.validation.random_maps import random_polynomial


@dataclass(frozen=True)
class Plain(Map):
    a: float = 0.3
    dimension = 2

    def __call__(self, state: Array) -> Array:
        return np.array([1.0 - self.a * state[0] ** 2 + state[1], 0.3 * state[0]])


# --- everything works -----------------------------------------------------------------------------


def test_a_map_of_three_lines_does_everything() -> None:
    attractor = MapAttractor(Plain(), np.array([0.1, 0.1]), 700, 100)
    assert str(attractor.label) == "P(1)"
    assert attractor.label.stable is True
    orbit = attractor.periodic_orbit()
    branch = continue_orbit(orbit, "a", bounds=(0.2, 0.5))
    (doubling,) = branch.bifurcations
    assert abs(doubling.value - 0.75 * 0.7**2) <= doubling.error < 1e-9
    assert [found.label for found in doubling.switch()] == ["P(2)"]
    assert find_orbits(Plain(1.4), 2, [(-2.0, 2.0), (-2.0, 2.0)]).counts == {1: 2, 2: 1}
    chaos = LyapunovSpectrum.of_map(Plain(1.4), [0.1, 0.1], iterations=200)
    assert abs(chaos.sum - np.log(0.3)) <= chaos.sum_error < 1e-10
    swept = sweep(Plain(), "a", [0.3, 0.5], start=[0.1, 0.1])
    assert [str(label) for label in swept.labels] == ["P(1)", "P(2)"]
    pictured = basins(Plain(), [[0.1, 0.1], [-0.5, 0.2], [9.0, 9.0]])
    assert [str(each.label) for each in pictured.basins] == ["P(1)"]


def test_it_conforms() -> None:
    check_map(without_jacobian(Henon()), np.array([[0.1, 0.2], [-0.3, 0.1]]))


def test_a_jacobian_that_asks_for_the_default_gets_differences() -> None:
    class Doubled(Plain):
        def jacobian(self, state: Array) -> Array:
            return 2.0 * super().jacobian(state)

    state = np.array([0.5, 0.1])
    assert Doubled().jacobian(state) == pytest.approx(2.0 * Plain().jacobian(state), abs=0.0)
    assert Doubled().jacobian_factors(state)[1] < 1e-15


def test_factors_alone_make_the_jacobian() -> None:
    class Factored(Plain):
        def jacobian_factors(self, state: Array) -> tuple[Array, Array]:
            return np.array([[[1.0, 2.0], [0.0, 1.0]], [[3.0, 0.0], [1.0, 1.0]]]), np.zeros(2)

    assert Factored().jacobian(np.zeros(2)) == pytest.approx(np.array([[3.0, 6.0], [1.0, 3.0]]))


# --- claims hold ----------------------------------------------------------------------------------


def test_differences_of_random_maps_are_within_their_errors() -> None:
    for number in range(100):
        random = Random(number)
        system = random_polynomial(random)
        state = system.middle + system.size * [random.gauss(0.0, 1.0) for _ in system.middle]
        found, error = numerical_derivative(system, state, accuracy=system.accuracy)
        exact = system.jacobian(state)
        assert (abs(found - exact) <= error + system.accuracy * abs(exact).max()).all()
        assert error.max() <= 1e-8 * abs(exact).max()


@pytest.mark.parametrize("accuracy", [1e-12, 1e-9, 1e-6])
def test_errors_of_calls_are_in_the_error_of_differences(accuracy: float) -> None:
    noise = np.random.default_rng(0)

    def rough(state: Array) -> Array:
        return np.sin(state @ [[3.0, 1.0], [0.2, 2.0]]) + accuracy * noise.uniform(-1.0, 1.0, 2)

    for place in np.random.default_rng(1).uniform(-2.0, 2.0, (50, 2)):
        found, error = numerical_derivative(rough, place, accuracy=accuracy)
        turned = np.cos(place @ [[3.0, 1.0], [0.2, 2.0]])
        exact = turned[:, None] * np.array([[3.0, 0.2], [1.0, 2.0]])
        assert (abs(found - exact) <= error).all()
        assert error.max() < 1e3 * accuracy ** (8.0 / 9.0)


def test_orbits_of_random_maps_are_those_of_the_exact_jacobian() -> None:
    compared = 0
    for number in range(40):
        random = Random(number)
        system = random_polynomial(random)
        p, q = (system.middles + 0.03 * system.widths).tolist()
        system = system.replace(p=p, q=q)
        guess = system.middle + system.size * [random.gauss(0.0, 0.1) for _ in system.middle]
        try:
            given = periodic_orbit(system, guess)
        except NoConvergence:
            continue
        found = periodic_orbit(without_jacobian(system), given.states)
        assert abs(found.states - given.states).max() <= found.error + given.error
        gaps = abs(np.subtract.outer(found.multipliers, given.multipliers))
        allowed = found.multipliers_error + given.multipliers_error
        assert (gaps.min(axis=1) <= allowed).all()
        assert found.multipliers_error.max() < 1e-6 * max(1.0, abs(found.multipliers).max())
        compared += 1
    assert compared >= 25


class Folded(Map):
    """Three dimensions: Henon's map, twisted with a coordinate that shrinks."""

    dimension = 3

    def __call__(self, state: Array) -> Array:
        x, y, z = state
        return np.array([1.0 - 0.3 * x * x + y + 0.1 * np.sin(z), 0.3 * x, 0.5 * z + 0.2 * x])

    def exact(self, state: Array) -> Array:
        x, _, z = state
        return np.array([[-0.6 * x, 1.0, 0.1 * np.cos(z)], [0.3, 0.0, 0.0], [0.2, 0.0, 0.5]])


class Stiff(Map):
    """A slow coordinate, and a fast one that is all but slaved to it."""

    dimension = 2

    def __call__(self, state: Array) -> Array:
        x, y = state
        return np.array([2.7 * x * (1.0 - x) + 1e-3 * y, 1e-6 * y + np.exp(x)])

    def exact(self, state: Array) -> Array:
        x, _ = state
        return np.array([[2.7 * (1.0 - 2.0 * x), 1e-3], [np.exp(x), 1e-6]])


class Unequal(Map):
    """Coordinates of 1e6 and 1e-6."""

    dimension = 2

    def __call__(self, state: Array) -> Array:
        x, y = state[0] / 1e6, state[1] / 1e-6
        return np.array([1e6 * (1.0 - 0.3 * x * x + y), 0.3e-6 * x])

    def exact(self, state: Array) -> Array:
        return np.array([[-0.6 * state[0] / 1e6, 1e12], [0.3e-12, 0.0]])


class Noisy(Map):
    """Calls are wrong by 1e-9, in a way that no step is short enough to see."""

    dimension = 2
    accuracy = 1e-9

    def __call__(self, state: Array) -> Array:
        x, y = state
        off = 1e-9 * np.sin(1e13 * (x + 0.7 * y) + np.array([0.0, 1.0]))
        return np.asarray(np.array([1.0 - 0.3 * x * x + y, 0.3 * x]) + 0.5 * off)

    def exact(self, state: Array) -> Array:
        return np.array([[-0.6 * state[0], 1.0], [0.3, 0.0]])


@pytest.mark.parametrize("kind", [Folded, Stiff, Unequal, Noisy])
def test_claims_of_labels_orbits_and_exponents_hold(kind: type[Any]) -> None:
    system, start = kind(), np.full(kind.dimension, 1e-7)
    attractor = system.attractor(start=start)
    label = attractor.label
    assert str(label) == "P(1)"
    exact = np.linalg.eigvals(system.exact(attractor.states[-1]))
    assert abs(abs(exact).max() - label.multiplier) <= label.multiplier_error
    orbit = periodic_orbit(system, attractor.states[-1])
    assert abs(orbit.states[0] - attractor.states[-1]).max() <= orbit.error + attractor.error
    gaps = abs(np.subtract.outer(orbit.multipliers, exact)).min(axis=1)
    assert (gaps <= orbit.multipliers_error).all()
    spectrum = LyapunovSpectrum.of_map(system, attractor.states[-1], iterations=128)
    known = np.isfinite(spectrum.exponents)
    off = abs(spectrum.exponents - np.sort(np.log(abs(exact)))[::-1])
    assert (off <= spectrum.error + 1e-14)[known].all()
    if kind is not Unequal:  # whose calls are wrong by 1e-4 of the small coordinate
        assert label.stable is True
        assert orbit.multipliers_error.max() < 1e-4


@pytest.mark.parametrize("name", ["PD", "SN"])
def test_bifurcations_are_where_their_closed_forms_are(name: str) -> None:
    for b in (-0.5, 0.6):
        start = periodic_orbit(without_jacobian(Henon(a=0.2, b=b)), [1.0, b])
        branch = continue_orbit(start, "a", bounds=(-0.6, 1.8), points=60)
        exact = {"PD": 0.75 * (1.0 - b) ** 2, "SN": -0.25 * (1.0 - b) ** 2}[name]
        (found,) = [each for each in branch.bifurcations if each.kind == name]
        assert abs(found.value - exact) <= found.error < 1e-8


@pytest.mark.parametrize("number", [0, 1, 2, 5])
def test_bifurcations_of_noisy_maps_are_within_their_errors(number: int) -> None:
    random = np.random.default_rng(number)
    phase, rate = random.uniform(0.0, 6.0), 10.0 ** random.uniform(12.0, 14.0)

    @dataclass(frozen=True)
    class Rough(Map):
        a: float = 0.2
        dimension = 2
        accuracy = 1e-9

        def __call__(self, state: Array) -> Array:
            x, y = state
            off = 1e-9 * np.sin(rate * (x + 0.7 * y + 0.3 * self.a) + phase)
            return np.array([1.0 - self.a * x * x + y, 0.3 * x + 0.3 * off])

    branch = continue_orbit(periodic_orbit(Rough(), [0.9, 0.3]), "a", bounds=(0.1, 0.5))
    (found,) = branch.bifurcations
    assert found.kind == "PD"
    assert abs(found.value - 0.75 * 0.7**2) <= found.error < 1e-5


# --- where there is no derivative -----------------------------------------------------------------


@pytest.mark.parametrize("place", [0.0, 1e-12, 1e-6, 0.4, 1.0 - 1e-9, 1.0])
@pytest.mark.parametrize("outside", ["refused", "diverged", "nan"])
def test_at_the_end_of_a_range_differences_are_one_sided(place: float, outside: str) -> None:
    class Ranged(Map):
        dimension = 1

        def __call__(self, state: Array) -> Array:
            if not 0.0 <= state[0] <= 1.0:
                if outside == "nan":
                    return state * np.nan
                raise (Refused if outside == "refused" else Diverged)("outside")
            return np.asarray(np.exp(state) * state)

    ((factor,),), (error,) = Ranged().jacobian_factors(np.array([place]))
    assert abs(factor - (1.0 + place) * np.exp(place)) <= error < 1e-9


@pytest.mark.parametrize("distance", [0.0, 1e-14, 1e-9, 1e-4, 0.3])
@pytest.mark.parametrize("slopes", [(1.0, 1.1), (0.5, -0.4), (1.0, 3.0), (2.0, -2.0), (0.0, 1.0)])
def test_at_a_corner_the_error_is_that_of_either_slope(
    distance: float, slopes: tuple[float, float]
) -> None:
    def bent(state: Array) -> Array:
        gap = state - 0.7
        return np.where(gap < 0.0, slopes[0] * gap, slopes[1] * gap) + 0.3

    for side, slope in zip((-1.0, 1.0), slopes, strict=True):
        try:
            ((found,),), ((error,),) = numerical_derivative(bent, np.array([0.7 + side * distance]))
        except NoDerivative:
            assert distance < 1e-12
            continue
        assert abs(found - slope) <= error
        assert distance < 1e-12 or error < 1e-3


@dataclass(frozen=True)
class Border(Map):
    """Its fixed point lies on a corner: stable on the left, unstable on the right."""

    dimension = 1

    def __call__(self, state: Array) -> Array:
        gap = state - 0.5
        return np.where(gap < 0.0, 0.5 * gap, -3.0 * gap) + 0.5


def test_nothing_is_said_of_the_multipliers_of_an_orbit_on_a_corner() -> None:
    orbit = periodic_orbit(Border(), [0.5])
    assert orbit.states[0, 0] == 0.5
    with pytest.raises(NoDerivative, match="differences do not settle"):
        _ = orbit.multipliers
    label = Border().attractor(start=[0.5]).label
    assert str(label) == "P(1)"
    assert label.stable is None


@pytest.mark.parametrize("power", [0.5, 0.3])
def test_the_end_of_a_root_has_no_derivative(power: float) -> None:
    class Root(Map):
        dimension = 1

        def __call__(self, state: Array) -> Array:
            return np.asarray(state**power)

    assert Root().jacobian(np.array([1e-6]))[0, 0] == pytest.approx(
        power * 1e-6 ** (power - 1.0), rel=1e-9
    )
    with pytest.raises(NoDerivative, match=r"no derivative by number 0 of \[0\.0\]"):
        Root().jacobian(np.array([0.0]))


def test_steps_longer_than_waves_do_not_agree_by_chance() -> None:
    random = np.random.default_rng(0)
    for _ in range(300):
        waves, place = 10.0 * random.normal(size=2), 100.0 * random.normal(size=1)
        accuracy = 10.0 ** random.uniform(-15.0, -6.0)

        def wavy(state: Array, waves: Array = waves) -> Array:
            return np.sin(waves * state)

        found, error = numerical_derivative(wavy, place, accuracy=accuracy)
        assert (abs(found[:, 0] - waves * np.cos(waves * place)) <= error[:, 0]).all()


# --- flows ----------------------------------------------------------------------------------------


class Turning(DampedRotation):
    """Without a derivative: the default of flows."""

    derivative = Flow.derivative

    def advance(self, state: Array, duration: float) -> Array:
        return np.asarray(super().derivative(state, duration) @ state)


@dataclass(frozen=True, kw_only=True)
class PlainRossler(Rossler):
    velocity_jacobian = IntegratedFlow.velocity_jacobian
    velocity_parameter_derivative = IntegratedFlow.velocity_parameter_derivative


def test_a_flow_without_derivative_has_it_by_differences() -> None:
    state, flow = np.array([1.0, 0.3, 0.2]), Turning()
    exact = DampedRotation().derivative(state, 0.7)
    assert flow.derivative(state, 0.7) == pytest.approx(exact, abs=1e-12)
    found, given = (each.stretching(state, 0.7, 5) for each in (flow, DampedRotation()))
    assert (abs(found.logs - given.logs) <= found.errors + 1e-15).all()
    assert found.errors.max() < 1e-10


@pytest.mark.parametrize(
    ("plain", "given", "plane", "start"),
    [
        (Turning(), DampedRotation(), Hyperplane(np.array([0.0, 1.0, 0.0])), [1.0, 0.2]),
        (PlainRossler(), Rossler(), Hyperplane(np.array([0.0, 1.0, 0.0])), [-5.0, 0.02]),
    ],
)
def test_poincare_maps_of_flows_without_derivatives(
    plain: Flow, given: Flow, plane: Hyperplane, start: list[float]
) -> None:
    found, exact = (PoincareMap(each, plane, 50.0) for each in (plain, given))
    state = np.array(start)
    factors, errors = found.jacobian_factors(state)
    assert errors.max() < 1e-7
    gap = abs(found.jacobian(state) - exact.jacobian(state)).max()
    assert gap <= 10.0 * errors.sum() * max(1.0, abs(factors).max())
