"""Kernels of orbits of one mode, against what they replace: plain steps, curves and matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit.continuation.initial_tangents import start_points
from dynkit.continuation.orbit_equations import OrbitEquations
from dynkit.orbits.multipliers import product_eigenvalues
from dynkit.orbits.newton import ROUNDING, correct, error_bound
from dynkit.systems import ImpactChain, SingleImpactOscillator
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.simulation.parameters import changes_alone
from tests.impact_orbits.test_equations import KINDS, NONE, orbit_of

RESPONDING = [name for name in KINDS if not name.startswith(("ball", "free"))]

LIMITS = 16.0 * ROUNDING, 10, 3
"""Level, steps and halvings of a correction."""

ALONG = [
    ("chain", "frequency"),
    ("chain", "restitution"),
    ("chain, undamped", "amplitude"),
    ("chain, play", "play"),
    ("chain, forces", "offset"),
    ("single, stop", "restitution"),
]


def corrected_twice(orbit: ImpactOrbit, parameter: str, patch: pytest.MonkeyPatch) -> Any:
    """Equations, and what a kernel and plain steps make of a guess ahead of an orbit."""
    problem = orbit.problem(parameter)
    equations = OrbitEquations(problem, 1.0)
    start = start_points(equations, np.append(orbit.unknowns, problem.values))[0]
    guess = start.y + 1e-3 * start.tangent * start.scale
    given = guess, start.scale, start.tangent
    one = problem.corrected(*given, LIMITS)
    patch.setattr(type(problem), "corrected", lambda *_: None)
    return equations, start, one, correct(equations, *given)


@pytest.mark.parametrize(("name", "parameter"), ALONG)
def test_corrections_in_a_kernel_are_those_of_plain_steps(
    name: str, parameter: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    equations, start, one, other = corrected_twice(orbit_of(name), parameter, monkeypatch)
    jacobian = equations.jacobian(other.y)
    bound = error_bound(equations, jacobian, other.y, start.scale, start.tangent)
    assert (abs(one.y - other.y) <= bound).all()
    assert one.direction.turn == other.direction.turn
    # each is that of an iterate at most a step away
    assert abs(one.direction.tangent - other.direction.tangent).max() < 1e-2


def test_beyond_the_range_of_a_parameter_there_is_no_correction() -> None:
    orbit = orbit_of("chain")
    problem = orbit.problem("restitution")
    y = np.append(orbit.unknowns, 1.1)
    assert problem.corrected(y, np.ones(3), np.array([0.0, 0.0, 1.0]), LIMITS) is None


@pytest.mark.plain
def test_a_mass_is_corrected_and_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    orbit = SingleImpactOscillator(frequency=2.6).periodic_orbit()
    _, _, one, other = corrected_twice(orbit, "restitution", monkeypatch)
    assert one.y == pytest.approx(other.y, rel=1e-12)
    assert orbit.admissible
    assert abs(orbit.multipliers.prod()) < 1.0


@pytest.mark.parametrize("name", RESPONDING)
def test_gaps_that_are_proved_open_are_positive_and_others_are_not(name: str) -> None:
    orbit = orbit_of(name)
    solution = orbit.problem().at(orbit.unknowns, NONE)
    for i in range(len(solution.sides)):
        for stop in range(len(solution.terms.rests)):
            curve, is_open = solution.curve(i, stop), solution.is_open(i, stop)
            fine = curve.values(np.linspace(0.0, curve.lasts, 2001)[1:-1], 1)[0]
            if is_open is not None:
                assert is_open == (fine.min() > -curve.rounding)
            lowest, at = curve.smallest
            if np.isfinite(at):
                ((value,),) = curve.values(np.array([at]), 1)
                assert value == pytest.approx(lowest, abs=curve.rounding)


@pytest.mark.parametrize("name", RESPONDING)
def test_the_factors_have_the_multipliers_within_their_errors(name: str) -> None:
    orbit = orbit_of(name)
    known = orbit.problem().factors(orbit.unknowns, NONE)
    assert known is not None
    apart = abs(orbit.multipliers - product_eigenvalues(known[0]))
    assert (apart <= orbit.multipliers_error).all()


def test_derivatives_stay_in_closed_form_when_many_other_structures_were_used() -> None:
    chain = ImpactChain(masses=3, frequency=0.9)
    assert changes_alone(chain, "frequency")
    for k in range(70):  # more than are kept
        assert len(ImpactChain(masses=2, damping=0.1 + 0.001 * k, frequency=0.9).modes.frequencies)
    assert changes_alone(chain, "frequency")
    assert not changes_alone(chain, "damping")
