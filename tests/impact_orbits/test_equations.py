"""Derivatives of the equations of orbits, and where a disturbance that returns makes them singular.

A number mu is a multiplier where D(mu) is singular. More than that: D(mu) is what is left of the
multiplier problem (dP - mu) when the free motion E over the period is eliminated, so that

    det D(mu) / det D(1) = prod_i (1 - mu_i/mu) / (1 - mu_i)  det(1 - E) / det(1 - E/mu).

Where some motion has no restoring force nothing is eliminated: there is no E, and a factor of mu^2N
is left.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import sympy

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.impact_map import ImpactMap
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.oscillators.chain import ImpactChain
from tests.impact_orbits.exact_orbits import exact_orbit
from tests.impact_orbits.structures import ALL

KINDS = {
    "chain": (1, 3),
    "chain, undamped": (3, 2),
    "chain, elastic": (3, 4),
    "chain, dead": (3, 4),
    "chain, unequal": (1, 2),
    "chain, contact inside": (1, 2),
    "chain, below": (1, 1),
    "chain, forces": (3, 4),
    "chain, play": (3, 4),
    "chain, below with play": (3, 4),
    "double": (4, 5),
    "fourfold": (1, 1),
    "triple": (1, 2),
    "graded": (1, 3),
    "grounded": (1, 1),
    "single": (3, 4),
    "single, stop": (4, 5),
    "play": (5, 3),
    "ball": (1, 1),
    "ball, two bounces": (2, 2),
    "free chain": (1, 1),
    "free chain, dragged": (1, 2),
    "free mass": (2, 1),
    "free mass, dragged": (2, 1),
}
"""Impacts and periods."""

NONE = np.empty(0)


@cache
def orbit_of(name: str) -> ImpactOrbit:
    impacts, periods = KINDS[name]
    return ALL[name].periodic_orbit(impacts=impacts, periods=periods)


def free_multipliers(orbit: ImpactOrbit) -> tuple[Any, int]:
    """Eigenvalues of the period without impacts, if it is eliminated, or else 2N; see above."""
    system = orbit.system
    n = system.degrees_of_freedom
    if orbit.problem().size > 2 * orbit.impacts:
        return np.empty(0), 2 * n
    rates = np.zeros((2 * n, 2 * n))
    rates[:n, n:] = np.eye(n)
    rates[n:, :n] = -np.linalg.solve(system.mass, system.stiffness)
    rates[n:, n:] = -np.linalg.solve(system.mass, system.damping_matrix)
    return scipy.linalg.eigvals(scipy.linalg.expm(rates * orbit.period)), 0


def scaled(orbit: ImpactOrbit, multiplier: complex) -> Array:
    problem, x = orbit.problem(), orbit.unknowns
    return np.asarray(problem.linearization(x, NONE, multiplier) * problem.scale(x))


# --- multipliers ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", KINDS)
def test_the_determinant_has_the_multipliers_as_its_roots_and_no_others(name: str) -> None:
    orbit = orbit_of(name)
    multipliers, (free, neutral) = orbit.multipliers, free_multipliers(orbit)
    first = np.linalg.det(scaled(orbit, 1.0))
    random = np.random.default_rng(0)
    for _ in range(10):
        size, angle = random.uniform(0.5, 3.0), random.uniform(0.1, 3.0)
        mu = size * np.exp(1j * angle)
        wanted = np.prod((1.0 - multipliers / mu) / (1.0 - multipliers))
        wanted *= np.prod((1.0 - free) / (1.0 - free / mu)) * mu**neutral
        found = np.linalg.det(scaled(orbit, mu)) / first
        assert found == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("name", KINDS)
def test_the_linearization_is_singular_at_every_multiplier(name: str) -> None:
    orbit = orbit_of(name)
    multipliers = exact_orbit(orbit).multipliers
    # Of small ones the inverse powers swamp it.
    for mu in multipliers[abs(multipliers) > 0.05]:
        values = np.linalg.svd(scaled(orbit, complex(mu)), compute_uv=False)
        assert values[-1] <= 1e-10 * values[0]


@pytest.mark.parametrize("name", KINDS)
def test_the_linearization_is_regular_between_the_multipliers(name: str) -> None:
    orbit = orbit_of(name)
    angles = np.exp(1j * np.linspace(0.0, np.pi, 40))
    for mu in [m for m in angles if abs(orbit.multipliers - m).min() > 1e-2]:
        values = np.linalg.svd(scaled(orbit, complex(mu)), compute_uv=False)
        assert values[-1] > 1e-6 * values[0]


@pytest.mark.parametrize("name", KINDS)
def test_the_linearization_is_real_for_real_multipliers_only(name: str) -> None:
    orbit = orbit_of(name)
    assert scaled(orbit, -1.0).dtype == np.float64
    assert np.iscomplexobj(scaled(orbit, 1j))
    assert np.array_equal(scaled(orbit, -1j), scaled(orbit, 1j).conj())
    assert scaled(orbit, 1.0 + 0j).real == pytest.approx(scaled(orbit, 1.0), abs=1e-12)


# --- derivatives ----------------------------------------------------------------------------------


def extrapolated(function: Callable[[float], Array], step: float) -> Array:
    """Derivative at 0 by central differences of three steps; the error is of the sixth order."""
    table = [(function(h) - function(-h)) / (2.0 * h) for h in (step, 0.5 * step, 0.25 * step)]
    once = [(4.0 * b - a) / 3.0 for a, b in pairwise(table)]
    return np.asarray((16.0 * once[1] - once[0]) / 15.0)


@pytest.mark.parametrize("name", KINDS)
def test_the_linearization_is_the_derivative_of_the_residual(name: str) -> None:
    orbit = orbit_of(name)
    problem, x = orbit.problem(), orbit.unknowns
    # Also away from a solution.
    x = x + 1e-3 * problem.scale(x) * np.random.default_rng(0).normal(size=len(x))
    wanted = problem.linearization(x, NONE)
    flights = np.diff(np.append(orbit.phases, orbit.phases[0] + 2.0 * np.pi * orbit.periods))
    for k, size in enumerate(problem.scale(x)):
        step = 1e-2 * size * min(1.0, float(flights.min()))

        def moved(h: float, k: int = k) -> Array:
            return np.asarray(problem.residual(x + h * np.eye(len(x))[k], NONE))

        assert abs(extrapolated(moved, step) - wanted[:, k]).max() <= 1e-8 * abs(wanted).max()


def inside(system: ImpactMap) -> dict[str, float]:
    """Parameters that can be changed both ways, with a step each."""
    out = {}
    for name, value in system.parameters.items():
        size = max(abs(value), 0.1)
        try:
            system.replace(**{name: value - 1e-3 * size})
            system.replace(**{name: value + 1e-3 * size})
        except ValueError:
            continue
        if np.isfinite(value):
            out[name] = 1e-3 * size
    return out


@pytest.mark.parametrize("name", KINDS)
def test_parameter_derivatives_are_those_of_the_residual(name: str) -> None:
    orbit = orbit_of(name)
    steps = inside(orbit.system)
    assert {"frequency"} <= set(steps) <= set(orbit.system.parameters)
    problem, x = orbit.problem(*steps), orbit.unknowns
    found = problem.parameter_derivative(x, problem.values)
    assert found.shape == (problem.size, len(steps))
    for k, step in enumerate(steps.values()):

        def moved(h: float, k: int = k) -> Array:
            return np.asarray(problem.residual(x, problem.values + h * np.eye(len(steps))[k]))

        wanted = extrapolated(moved, step)
        assert abs(wanted - found[:, k]).max() <= 1e-8 * max(1.0, abs(wanted).max())


@dataclass(frozen=True, kw_only=True)
class Tapered(ImpactChain):
    """Masses that grow along the chain: a parameter of the kinetic energy."""

    taper: float = 0.3

    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return sum(((1 + self.taper * i) * x**2 for i, x in enumerate(v)), sympy.Integer(0)) / 2


@pytest.mark.parametrize(
    ("chain", "impacts", "periods", "parameter"),
    [
        (ImpactChain(frequency=0.87), 1, 3, "damping"),
        (ImpactChain(frequency=0.87), 1, 3, "springs"),
        (ImpactChain(frequency=0.80), 2, 3, "damping"),
        (Tapered(masses=3, frequency=0.87), 1, 2, "taper"),
        (Tapered(masses=3, frequency=0.87, offset=-0.02), 1, 2, "damping"),
    ],
)
def test_derivatives_by_what_the_matrices_are_linear_in_have_all_digits(
    chain: ImpactChain, impacts: int, periods: int, parameter: str
) -> None:
    orbit = chain.periodic_orbits(impacts=impacts, periods=periods)[0]
    problem, x = orbit.problem(parameter), orbit.unknowns
    value = problem.values
    wanted = extrapolated(lambda h: problem.residual(x, value + h), 4e-3 * float(value[0]))
    found = problem.parameter_derivative(x, value)[:, 0]
    # The differences' own rounding is 1e-15 over their step.
    assert abs(wanted - found).max() <= 1e-10 * abs(wanted).max()


def one_sided(function: Callable[[float], Array], step: float) -> Array:
    """Derivative at 0 of the polynomial through eight values on one side."""
    at = np.arange(8.0)
    weights = np.linalg.solve(np.vander(at, increasing=True).T, np.eye(8)[1])
    return np.asarray(sum(w * function(step * k) for w, k in zip(weights, at, strict=True)) / step)


@pytest.mark.parametrize(
    ("name", "parameter", "step"),
    [
        ("chain, undamped", "damping", 1e-4),
        ("chain, elastic", "restitution", -1e-3),
        ("chain, dead", "restitution", 1e-3),
        ("single, stop", "damping_ratio", -1e-3),
    ],
)
def test_parameter_derivatives_hold_at_the_ends_of_what_is_allowed(
    name: str, parameter: str, step: float
) -> None:
    orbit = orbit_of(name)
    problem, x = orbit.problem(parameter), orbit.unknowns
    wanted = one_sided(lambda h: problem.residual(x, problem.values + h), step)
    found = problem.parameter_derivative(x, problem.values)[:, 0]
    assert abs(wanted - found).max() <= 1e-8 * max(1.0, abs(wanted).max())


@pytest.mark.parametrize("side", ["above", "below"])
def test_an_orbit_that_a_lagging_stop_drives_lags_and_grows_with_it(side: str) -> None:
    # nothing else drives the machine: phases follow the lag, and impulses the amplitude
    stop = HardStop(0, amplitude=0.1, phase=1.9, restitution=0.6, side=side, name="stop")
    orbit = ImpactChain(masses=2, frequency=0.9, elements=[stop]).periodic_orbit()
    problem, x = orbit.problem("stop.phase", "stop.amplitude"), orbit.unknowns
    by_both = problem.parameter_derivative(x, problem.values)
    moved = np.linalg.solve(problem.linearization(x, problem.values), -by_both)
    impulses = orbit.impulses
    still = np.zeros(len(impulses))
    assert moved[:, 0] == pytest.approx(np.concatenate([still + 1.0, still]), abs=1e-12)
    assert moved[:, 1] == pytest.approx(np.concatenate([still, impulses / 0.1]), abs=1e-12)


def test_parameters_of_a_subclass_can_be_free() -> None:
    system = ALL["grounded"]
    problem = system.periodic_orbit(periods=1).problem("grip", "drag")
    assert problem.values.tolist() == [system.parameters["grip"], system.parameters["drag"]]


def test_springs_and_damping_as_numbers_can_be_free() -> None:
    chain = ImpactChain(masses=3, springs=1.3, damping=0.07, frequency=0.9)
    assert {"springs", "damping"} <= set(inside(chain))


# --- arrays ---------------------------------------------------------------------------------------


def test_equations_do_not_remember_arrays_that_changed() -> None:
    problem, x = orbit_of("single").problem(), orbit_of("single").unknowns
    wanted = problem.residual(x + 0.01, NONE)
    changed = x.copy()
    problem.residual(changed, NONE)
    changed += 0.3
    assert np.array_equal(problem.multipliers(x, NONE), orbit_of("single").multipliers)
    assert np.array_equal(problem.residual(x + 0.01, NONE), wanted)


# --- the same motion as another orbit -------------------------------------------------------------


@pytest.mark.parametrize("name", KINDS)
def test_an_orbit_run_through_twice_is_a_solution(name: str) -> None:
    orbit = orbit_of(name)
    problem, x, _ = orbit.problem().doubled(orbit.unknowns, np.zeros(orbit.problem().size))
    assert problem.size == 2 * orbit.problem().size
    turned = 1.0 + abs(x).max()
    assert abs(problem.residual(x, NONE)).max() <= orbit.residual + 1e-14 * turned


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_a_disturbance_that_changes_sign_is_one_of_twice_the_period(name: str, seed: int) -> None:
    orbit = orbit_of(name)
    problem, x = orbit.problem(), orbit.unknowns
    disturbance = np.random.default_rng(seed).normal(size=len(x))
    n = orbit.impacts
    matrix = problem.linearization(x, NONE, -1.0)
    doubled, twice, direction = problem.doubled(x, disturbance)
    gaps, rates, others = np.split(matrix @ disturbance, [n, 2 * n])
    wanted = np.concatenate([gaps, -gaps, rates, -rates, others, -others])
    found = doubled.linearization(twice, NONE) @ direction
    assert found == pytest.approx(wanted, abs=1e-11 * abs(wanted).max())


@pytest.mark.parametrize("name", KINDS)
def test_multipliers_of_twice_the_period_are_squares(name: str) -> None:
    orbit = orbit_of(name)
    doubled, twice, _ = orbit.problem().doubled(orbit.unknowns, np.zeros(len(orbit.unknowns)))
    found = doubled.multipliers(twice, NONE)
    largest = orbit.multipliers[0]
    assert abs(found[0]) == pytest.approx(abs(largest) ** 2, rel=1e-9)


@pytest.mark.parametrize("name", KINDS)
def test_an_orbit_is_the_same_from_any_of_its_impacts(name: str) -> None:
    orbit = orbit_of(name)
    system, n, turn = orbit.system, orbit.impacts, 2.0 * np.pi * orbit.periods
    problem = orbit.problem()
    marks = []
    for k in range(n):
        sides = np.roll(problem.sides, -k)
        phases = np.append(orbit.phases[k:], orbit.phases[:k] + turn) - 2.0 * np.pi * k
        other = system.periodic_orbit(periods=orbit.periods, phases=phases, sides=sides)
        marks.append(other.problem().canonical(other.unknowns))
    assert marks == [pytest.approx(problem.canonical(orbit.unknowns), abs=1e-8)] * n


@pytest.mark.parametrize("name", ["chain, play", "chain, below with play", "play", "chain, forces"])
def test_different_orbits_have_different_marks(name: str) -> None:
    impacts, periods = KINDS[name]
    orbits = ALL[name].periodic_orbits(impacts=impacts, periods=periods)
    marks = [orbit.problem().canonical(orbit.unknowns) for orbit in orbits]
    assert len(marks) > 1
    for k, mark in enumerate(marks):
        assert all(abs(mark - other).max() > 1e-4 for other in marks[:k])
