"""The textbook flows keep the contracts of flows, Poincare maps and attractors."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit import Hyperplane, MapAttractor, PoincareMap, Stroboscope
from dynkit.dynamics.section import PoincareSection
from dynkit.testing import (
    AttractorCheck,
    FlowCheck,
    MapCheck,
    PoincareMapCheck,
    attractor_checks,
    check_name,
    check_section,
    flow_checks,
    map_checks,
    numerical_derivative,
    poincare_map_checks,
)
from tests.flows.cases import FLOWS, STATES, Parabola, Rotation
from tests.flows.integrated_flows import Duffing, Lorenz, Rossler


def poincare_map(flow: str, section: PoincareSection) -> PoincareMap:
    # other tests are of the accuracy of returns
    return PoincareMap(FLOWS[flow].replace(tolerance=1e-11), section, time_limit=50.0)


MAPS: dict[str, tuple[PoincareMap, list[list[float]]]] = {
    "duffing, stroboscope": (
        poincare_map("duffing", Stroboscope(3, phase=2.5)),
        [[0.5, 0.2], [-1.2, 0.4]],
    ),
    "duffing, maxima": (
        poincare_map("duffing", Hyperplane(np.array([0.0, 1.0, 0.0]), 0.0, -1, angles=[2])),
        [[1.2, 0.3], [-0.3, 2.0]],
    ),
    "duffing, parabola": (
        poincare_map("duffing", Parabola(1, height=-0.1, bend=0.4)),
        [[1.1, 0.3]],
    ),
    "lorenz, downwards through the fixed points' plane": (
        poincare_map("lorenz", Hyperplane(np.array([0.0, 0.0, 1.0]), 27.0, -1)),
        [[2.0, 2.0], [-3.0, 0.5]],
    ),
    "lorenz, oblique plane": (
        poincare_map("lorenz", Hyperplane(np.array([1.0, -0.5, 0.2]), 3.0)),
        [[2.6, 15.0]],
    ),
    "rossler, plane": (
        poincare_map("rossler", Hyperplane(np.array([1.0, 0.0, 0.0]))),
        [[-8.0, 0.03]],
    ),
}


@pytest.mark.parametrize("check", flow_checks, ids=check_name)
@pytest.mark.parametrize("name", FLOWS)
def test_it_is_a_flow(name: str, check: FlowCheck) -> None:
    check(FLOWS[name], STATES[name])


@pytest.mark.parametrize("check", flow_checks, ids=check_name)
def test_a_flow_of_ones_own_is_a_flow(check: FlowCheck) -> None:
    check(Rotation(frequency=2.0), np.array([[1.0, 0.5, 2.0], [-0.3, 1.4, -0.2]]))


@pytest.mark.parametrize("check", [*poincare_map_checks, *map_checks], ids=check_name)
@pytest.mark.parametrize("name", MAPS)
def test_it_has_poincare_maps(name: str, check: PoincareMapCheck | MapCheck) -> None:
    system, points = MAPS[name]
    check(system, np.array(points))


def test_a_parabola_is_a_section() -> None:
    check_section(Parabola(1, height=-0.1, bend=0.4), np.array([[1.1, 0.3], [-0.8, 2.0]]))


@pytest.mark.parametrize("name", FLOWS)
def test_the_velocity_jacobian_is_the_derivative_of_the_velocity(name: str) -> None:
    flow = FLOWS[name]
    for state in STATES[name]:
        found, error = numerical_derivative(flow.velocity, state)
        off = np.abs(flow.velocity_jacobian(state) - found)
        assert (off <= 20.0 * error + 1e-13 * np.abs(found).max()).all()


# Periodic motions: their labels take a hundred iterates, where chaos takes thousands.
ATTRACTORS: dict[str, tuple[PoincareMap, list[float]]] = {
    "duffing": (
        PoincareMap(Duffing(force=0.2, tolerance=1e-8), Stroboscope(3), time_limit=10.0),
        [1.2, 0.1],
    ),
    "lorenz": (
        PoincareMap(
            Lorenz(rho=350.0, tolerance=1e-8),
            Hyperplane(np.array([0.0, 0.0, 1.0]), 349.0),
            time_limit=10.0,
        ),
        [40.0, 60.0],
    ),
    "rossler": (
        PoincareMap(Rossler(c=2.5, tolerance=1e-8), Hyperplane(np.eye(3)[0]), time_limit=50.0),
        [-3.5, 0.1],
    ),
}


@pytest.mark.parametrize("check", attractor_checks, ids=check_name)
@pytest.mark.parametrize("name", ATTRACTORS)
def test_it_has_attractors(name: str, check: AttractorCheck) -> None:
    # What is checked is the class of attractors: of one flow at length, of the others in short, as
    # their maps are pure by the checks above. How accurate they are is for the tests below.
    system, start = ATTRACTORS[name]
    system = system.replace(tolerance=1e-6)
    most = 100 if name == "duffing" else 27
    check(
        lambda transient, count: MapAttractor(system, np.array(start), transient, min(count, most))
    )


@pytest.mark.parametrize("name", ATTRACTORS)
def test_the_error_of_an_attractor_is_that_of_the_integration(name: str) -> None:
    system, start = ATTRACTORS[name]
    attractor = MapAttractor(system, np.array(start), transient=20, iterations=5)
    exact = MapAttractor(tightened(system), np.array(start), transient=20, iterations=5)
    off = np.abs(system.difference(attractor.states, exact.states)).max()
    assert off < attractor.error < 1e-4 * np.abs(exact.states).max()


def tightened(system: PoincareMap) -> PoincareMap:
    return system.replace(tolerance=1e-12)
