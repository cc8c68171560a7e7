"""Periodic orbits of flows on a section: Liouville's formula, differences, tighter integrations."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from dynkit import (
    Hyperplane,
    MapAttractor,
    MapOrbit,
    PoincareMap,
    Stroboscope,
    periodic_orbit,
)
from dynkit.core.no_motion import Refused
from dynkit.core.validation import Array
from dynkit.testing import numerical_derivative
from tests.flows.integrated_flows import Duffing, Lorenz, Rossler

PLANE = Hyperplane(np.array([0.0, 0.0, 1.0]), 27.0, -1)
SYSTEMS: dict[str, tuple[PoincareMap, list[list[float]]]] = {
    "duffing, unstable": (
        PoincareMap(Duffing(force=0.28), Stroboscope(3), time_limit=10.0),
        [[0.38, 0.31]],
    ),
    "duffing, period 2": (
        PoincareMap(Duffing(force=0.28), Stroboscope(3), time_limit=10.0),
        [[0.59, 0.38], [0.25, 0.24]],
    ),
    # D. Viswanath, Nonlinearity 16 (2003) 1035-1056, table 1: the orbit AB
    "lorenz, AB": (
        PoincareMap(Lorenz(), PLANE, time_limit=10.0),
        [[-2.15, 2.08], [2.15, -2.08]],
    ),
    "rossler": (
        PoincareMap(Rossler(), Hyperplane(np.eye(3)[0]), time_limit=50.0),
        [[-8.38, 0.03]],
    ),
}


@cache
def orbit_of(name: str) -> MapOrbit:
    system, guess = SYSTEMS[name]
    return periodic_orbit(system, guess)


@cache
def times(name: str) -> tuple[float, ...]:
    system, _ = SYSTEMS[name]
    return tuple(system.return_time(state) for state in orbit_of(name).states)


@pytest.mark.parametrize(
    ("name", "label", "stable"),
    [
        ("duffing, unstable", "P(1)", False),
        ("duffing, period 2", "P(2)", True),
        ("lorenz, AB", "P(2)", False),
        ("rossler", "P(1)", False),
    ],
)
def test_it_is_found(name: str, label: str, stable: bool) -> None:
    orbit = orbit_of(name)
    assert orbit.label == label
    assert orbit.stable is stable
    assert orbit.residual < 1e-14


def test_lorenzs_orbit_has_its_known_period() -> None:
    # D. Viswanath, The fractal property of the Lorenz attractor, Physica D 190 (2004) 115-128
    known = 1.5586522107161747
    assert sum(times("lorenz, AB")) == pytest.approx(known, abs=orbit_of("lorenz, AB").error)


@pytest.mark.parametrize(
    ("name", "rate"),
    [
        ("duffing, unstable", -0.3),
        ("duffing, period 2", -0.3),
        ("lorenz, AB", -(10.0 + 1.0 + 8.0 / 3.0)),
    ],
)
def test_the_product_of_the_multipliers_is_that_of_liouville(name: str, rate: float) -> None:
    orbit = orbit_of(name)
    # volumes change at a constant rate; on the section as much, as the speed through it is the same
    # after a round. Entries of the derivative are integrated to the flow's accuracy.
    allowed = 100.0 * orbit.system.accuracy * max(1.0, abs(orbit.multipliers[0])) ** 2
    expected = np.exp(rate * sum(times(name)))
    assert orbit.multipliers.prod() == pytest.approx(expected, abs=allowed)


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_multipliers_are_those_of_differences(name: str) -> None:
    orbit = orbit_of(name)
    system, n = orbit.system, orbit.period

    def round_trip(state: Array) -> Array:
        return np.asarray(system.iterate(state, n)[-1])

    found, error = numerical_derivative(
        round_trip, orbit.states[0], accuracy=system.accuracy, difference=system.difference
    )
    values = np.linalg.eigvals(found)
    vectors = np.linalg.cond(np.linalg.eig(found)[1])
    # Bauer and Fike: no further than the condition of the eigenvectors times the error
    allowed = 20.0 * vectors * float(np.linalg.norm(error))
    assert allowed < 1e-3
    for multiplier in orbit.multipliers:
        assert abs(values - multiplier).min() <= allowed


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("name", SYSTEMS)
def test_its_error_covers_that_of_the_integration(name: str, tolerance: float) -> None:
    fine = orbit_of(name)
    rough = periodic_orbit(fine.system.replace(tolerance=tolerance), fine.states)
    gap = abs(fine.system.difference(rough.states, fine.states)).max()
    assert gap <= rough.error < 1e4 * tolerance * abs(fine.states).max()


@pytest.mark.parametrize(
    ("name", "parameter"), [("duffing, unstable", "frequency"), ("lorenz, AB", "rho")]
)
def test_orbits_move_with_a_parameter_as_its_derivative_says(name: str, parameter: str) -> None:
    orbit = orbit_of(name)
    problem = orbit.problem(parameter)
    x, p = orbit.unknowns, problem.values
    claimed = np.linalg.solve(problem.linearization(x, p), -problem.parameter_derivative(x, p))

    def followed(value: Array) -> Array:
        system = orbit.system.replace(**{parameter: float(value[0])})
        # Newton's method begins at what is claimed, and goes on to the orbit that there is
        guess = (x + claimed @ (value - p)).reshape(orbit.states.shape)
        near = periodic_orbit(system, guess)
        if near.period != orbit.period:
            raise Refused("the step is so long that it leads to another orbit")
        return near.unknowns

    accuracy = orbit.error / float(abs(x).max())
    found, error = numerical_derivative(followed, p, accuracy=accuracy)
    assert (abs(claimed - found) <= 20.0 * error).all()
    assert error.max() < 1e-3 * abs(claimed).max()


def test_an_attractor_of_a_flow_gives_its_orbit() -> None:
    system, _ = SYSTEMS["duffing, period 2"]
    attractor = MapAttractor(system, np.array([1.0, 0.0]), transient=60, iterations=20)
    orbit = attractor.periodic_orbit()
    same = orbit_of("duffing, period 2")
    assert orbit.label == "P(2)"
    gaps = abs(orbit.states[:, None] - same.states[None]).max(axis=2)
    assert gaps.min(axis=1).max() <= orbit.error + same.error
