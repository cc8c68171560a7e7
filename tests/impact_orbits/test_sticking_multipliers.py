"""Multipliers and derivatives of orbits that stick, by differences and by simulation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from dynkit.analysis.lyapunov import LyapunovSpectrum
from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.itineraries.equations import ItineraryEquations
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from tests.impact_orbits.exact_sticking import parts_of, slope
from tests.impact_orbits.sticking_cases import (
    SEVERAL,
    SYSTEMS,
    differences,
    monodromy,
    orbit_of,
    releases_of,
    returned,
)

NONE = np.empty(0)
UNSTABLE = "chain of 10, unstable"


def distance(found: Any, wanted: Any) -> float:
    """Largest distance of numbers that are matched with others as well as can be."""
    apart = abs(found[:, None] - wanted[None, :])
    return float(apart[linear_sum_assignment(apart)].max())


# --- multipliers ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SEVERAL)
def test_multipliers_are_those_of_differences_of_simulations(name: str) -> None:
    found = orbit_of(name).multipliers[:-2]
    assert distance(found, np.linalg.eigvals(monodromy(name))) < 1e-8


@pytest.mark.parametrize("name", SYSTEMS)
def test_two_multipliers_are_zero(name: str) -> None:
    orbit = orbit_of(name)
    multipliers = orbit.multipliers
    assert len(multipliers) == 2 * orbit.system.degrees_of_freedom
    assert (multipliers[-2:] == 0.0).all()
    assert (np.diff(abs(multipliers)) <= 1e-15).all()


def test_an_unstable_orbit_has_one_multiplier_outside() -> None:
    orbit = orbit_of(UNSTABLE)
    assert (abs(orbit.multipliers) > 1.0).sum() == 1
    assert not orbit.stable
    # The largest eigenvalue of differences of simulations (this test's own reference).
    values = np.linalg.eigvals(monodromy(UNSTABLE))
    assert orbit.multipliers[0] == pytest.approx(values[np.argmax(abs(values))], abs=1e-8)


def test_a_disturbance_of_an_unstable_orbit_grows_by_its_multiplier() -> None:
    orbit = orbit_of(UNSTABLE)
    _, places, _ = releases_of(orbit)
    values, vectors = np.linalg.eig(monodromy(UNSTABLE))
    direction = vectors[:, np.argmax(abs(values))].real
    z, lengths = places + 1e-6 * direction, [1e-6]
    for _ in range(6):
        z = returned(orbit, z)
        lengths.append(float((z - places) @ direction))
    growth = np.array(lengths[1:]) / np.array(lengths[:-1])
    assert growth == pytest.approx(orbit.multipliers[0].real, rel=1e-3)


@pytest.mark.parametrize(
    "name", ["chain of 3, 0.3", "contact inside", "dashpots", "chain of 10, 0.408"]
)
def test_the_largest_multiplier_is_the_lyapunov_exponent_per_period(name: str) -> None:
    orbit = orbit_of(name)
    attractor = orbit.system.attractor(transient=3000, impacts=2)
    spectrum = LyapunovSpectrum(attractor, iterations=3000)
    record = orbit.system.simulate(impacts=3000, start=attractor.record.final)
    periods = record.time[-1] / orbit.period
    per_period = spectrum.exponents[0] * len(record) / periods
    wanted = math.log(abs(orbit.multipliers[0]))
    # Impacts per period are counted to one in so many periods.
    bound = 3.0 * spectrum.error[0] * len(record) / periods + 2.0 * abs(wanted) / periods
    assert abs(per_period - wanted) <= bound
    assert np.isneginf(spectrum.exponents).sum() == 2


def cut_later(orbit: ImpactOrbit) -> tuple[ItineraryEquations, Array]:
    """The same orbit, with one impact of its first chatter more among the unknowns."""
    problem = orbit.problem()
    s, itinerary = problem.at(orbit.unknowns, NONE), list(problem.itinerary)
    (i, chatter), *_ = s.chatters.items()
    phases, impulses, states = problem.layout.split(orbit.unknowns)
    r, count = orbit.system.restitution, s.impulse_of[i] + 1
    itinerary.insert(i, itinerary[i]._replace(chatters=False))
    phases = np.insert(phases, i + 1, phases[i] + s.frequency * chatter.run.time[0])
    impulses = np.insert(impulses, count, (1.0 + r) / r * chatter.run.speeds[1])
    nodes = tuple(node + (node > i) for node in problem.nodes)
    longer = problem.remade(itinerary=tuple(itinerary), nodes=nodes)
    return longer, np.concatenate([phases, impulses, states])


@pytest.mark.parametrize(
    "name", [n for n in SEVERAL if SYSTEMS[n][0].restitution > 0.0 and "play" not in n]
)
def test_multipliers_do_not_depend_on_where_a_passage_is_cut(name: str) -> None:
    orbit = orbit_of(name)
    problem, x = cut_later(orbit)
    assert abs(problem.residual(x, NONE)).max() < 1e-10
    assert distance(problem.multipliers(x, NONE), orbit.multipliers) < 1e-9


@pytest.mark.parametrize("name", SEVERAL)
def test_the_linearization_is_singular_at_the_multipliers(name: str) -> None:
    orbit = orbit_of(name)
    problem, x = orbit.problem(), orbit.unknowns
    scale = problem.scale(x)

    def smallest(mu: complex) -> float:
        values = np.linalg.svd(problem.linearization(x, NONE, mu) * scale, compute_uv=False)
        return float(values[-1] / values[0])

    # Where two are close, D is nearly singular between them.
    for mu in orbit.multipliers[:2]:
        assert smallest(mu) < 1e-12
        assert smallest(mu * 1.1 + 0.05j) > 1e3 * smallest(mu)


def test_the_linearization_at_other_numbers_is_regular() -> None:
    orbit = orbit_of("chain of 3, 0.3")
    problem, x = orbit.problem(), orbit.unknowns
    for mu in (1.0, -1.0, 0.7 + 0.7j):
        matrix = problem.linearization(x, NONE, mu) * problem.scale(x)
        assert np.linalg.cond(matrix) < 1e6


# --- derivatives ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_linearization_is_the_derivative_of_the_equations(name: str) -> None:
    orbit = orbit_of(name)
    problem, x = orbit.problem(), orbit.unknowns
    steps = 1e-5 * problem.scale(x)
    wanted = differences(lambda y: problem.residual(y, NONE), x, steps)
    found = problem.linearization(x, NONE)
    # Equations are measured in units that may depend on the unknowns, which are zero on the orbit.
    assert abs(found - wanted).max() <= 1e-6 * abs(wanted).max()


@pytest.mark.parametrize("name", ["chain of 3, 0.6", "contact inside", "chain of 10, 0.408"])
def test_the_linearization_is_right_beside_the_orbit_too(name: str) -> None:
    orbit = orbit_of(name)
    problem, x = orbit.problem(), orbit.unknowns
    scale = problem.scale(x)
    y = x + 1e-3 * scale * np.random.default_rng(3).uniform(-1.0, 1.0, len(x))
    wanted = differences(lambda z: problem.residual(z, NONE), y, 1e-5 * scale)
    assert abs(problem.linearization(y, NONE) - wanted).max() <= 0.05 * abs(wanted).max()


PARAMETERS = [
    (name, parameter)
    for name in ("chain of 10, 0.408", "chain of 3, 0.3", "below", "forces", "weights")
    for parameter in ("frequency", "restitution", "amplitude", "damping", "offset")
] + [("chain in a play", "play"), ("play", "play"), ("play", "force"), ("ball", "amplitude")]


@pytest.mark.parametrize(("name", "parameter"), PARAMETERS)
def test_parameter_derivatives_are_those_of_differences(name: str, parameter: str) -> None:
    orbit = orbit_of(name)
    problem, x = orbit.problem(parameter), orbit.unknowns
    p = problem.values
    step = np.array([1e-5 * max(abs(p[0]), 0.01)])
    wanted = differences(lambda q: problem.residual(x, q), p, step)
    found = problem.parameter_derivative(x, p)
    assert found.shape == (problem.size, 1)
    assert abs(found - wanted).max() <= 1e-6 * max(abs(wanted).max(), 1e-3)


@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        ("chain of 3, 0.3", "frequency"),
        ("chain of 2, 0.6", "restitution"),
        ("weights", "offset"),
        ("chain in a play", "amplitude"),
        ("below", "amplitude"),
    ],
)
def test_releases_move_with_a_parameter_as_those_of_many_digits(name: str, parameter: str) -> None:
    orbit = orbit_of(name)
    problem, x = orbit.problem(parameter), orbit.unknowns
    by_parameter = problem.parameter_derivative(x, problem.values)
    moved = -np.linalg.solve(problem.linearization(x, problem.values), by_parameter)[:, 0]
    found = np.array([np.append(places, phases[0]) for places, phases in parts_of(problem, moved)])
    wanted = slope(orbit, parameter)
    # differences, by which this was found before, are wrong by 1e-8
    assert abs(found - wanted).max() <= 1e-11 * abs(wanted).max()


def test_derivatives_by_several_parameters_stand_side_by_side() -> None:
    orbit = orbit_of("chain of 3, 0.3")
    both = orbit.problem("frequency", "offset")
    single = [orbit.problem(name) for name in both.names]
    found = both.parameter_derivative(orbit.unknowns, both.values)
    columns = [p.parameter_derivative(orbit.unknowns, p.values) for p in single]
    assert found == pytest.approx(np.concatenate(columns, axis=1), abs=1e-12)
