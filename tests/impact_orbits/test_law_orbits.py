"""Orbits and branches with impact laws: numbers as restitution, the map's orbits, differences."""

from typing import Any

import numpy as np
import pytest

import dynkit
from dynkit import continue_orbit
from dynkit.systems import (
    HardStop,
    ImpactChain,
    ImpactLaw,
    PlasticBelow,
    SoftStop,
    ViscoelasticSpheres,
)
from dynkit.testing import check_problem
from tests.impact.own_laws import Constant, Hardening

LAWS = [PlasticBelow(0.01, 0.7), ViscoelasticSpheres(0.3), Hardening(0.5, 0.3), Constant(0.6)]


def chain(law: Any, masses: int = 1, frequency: float = 1.9) -> ImpactChain:
    return ImpactChain(
        masses=masses, damping=0.1, frequency=frequency, amplitude=0.1, restitution=law
    )


def rattle(law: ImpactLaw) -> ImpactChain:
    return ImpactChain(
        masses=2,
        damping=0.1,
        frequency=1.3,
        harmonic_forces=[0.1, 0.0],
        elements=[
            HardStop(1, amplitude=0.1, restitution=law, name="table"),
            SoftStop(0, offset=-0.05, stiffness=3.0, damping=0.1, name="pad"),
        ],
    )


@pytest.mark.parametrize("law", LAWS)
def test_one_impact_is_that_of_the_restitution_at_its_own_velocity(law: ImpactLaw) -> None:
    orbit: Any = chain(law).attractor().periodic_orbit()
    assert orbit.label == "P(1,1)"
    approach = orbit.impulses - orbit.relative_velocity
    r = float(law.at(approach)[0])
    assert orbit.relative_velocity == pytest.approx(r * approach, rel=1e-13)
    closed = chain(r).periodic_orbits()  # of a number they are closed forms
    other = min(closed, key=lambda one: abs(one.impulses - orbit.impulses)[0])
    assert orbit.admissible
    assert abs(orbit.states - other.states).max() <= orbit.error + other.error
    assert orbit.error < 1e-12
    slope = float(law.slope(approach)[0])
    # a law enters the multipliers only by its slope: their product is slope * r exp(-trace C T)
    product = slope * r * np.exp(-0.1 * orbit.period)
    assert np.prod(orbit.multipliers).real == pytest.approx(product, rel=1e-11)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("machine", [chain, rattle])
def test_states_and_multipliers_are_those_of_the_map(machine: Any, law: ImpactLaw) -> None:
    system = machine(law)
    orbit = system.attractor().periodic_orbit()
    other = dynkit.periodic_orbit(system, orbit.states)
    assert abs(orbit.states - other.states).max() <= orbit.error + other.error
    assert np.sort_complex(orbit.multipliers) == pytest.approx(
        np.sort_complex(other.multipliers), abs=1e-9
    )


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("machine", [chain, rattle])
def test_derivatives_are_differences(machine: Any, law: ImpactLaw) -> None:
    orbit = machine(law).attractor().periodic_orbit()
    for parameter, value in orbit.system.parameters.items():
        if value and np.isfinite(value) and parameter != "chatter_tolerance":
            problem = orbit.problem(parameter)
            check_problem(problem, orbit.unknowns, problem.values)


@pytest.mark.parametrize("law", LAWS)
def test_a_branch_goes_through_grazing(law: ImpactLaw) -> None:
    """Without impacts the mass rests, and the table reaches it at the offset minus amplitude."""
    orbit = chain(law).attractor().periodic_orbit()
    branch = continue_orbit(orbit, "offset", bounds=(-0.3, 0.0))
    grazing = [b for b in branch.bifurcations if b.kind == "GR" and "grazing" in b.touching]
    assert any(abs(b.value + 0.1) < 1e-9 for b in grazing)
    jumps = [b for b in branch.bifurcations if "jump of the law" in b.touching]
    assert len(jumps) == len(law.breaks)


def test_a_branch_of_a_law_that_is_a_number_is_that_of_the_number() -> None:
    law = chain(Constant(0.6), frequency=1.2).attractor().periodic_orbit()
    number = chain(0.6, frequency=1.2).attractor().periodic_orbit()
    one = continue_orbit(law, "restitution.value", bounds=(0.3, 0.9))
    other = continue_orbit(number, "restitution", bounds=(0.3, 0.9))
    assert [b.kind for b in one.bifurcations] == [b.kind for b in other.bifurcations]
    assert len(one.bifurcations) > 0
    for a, b in zip(one.bifurcations, other.bifurcations, strict=True):
        assert a.value == pytest.approx(b.value, abs=1e-9)


def test_a_branch_meets_the_jump_of_a_law_at_the_velocity_of_its_impact() -> None:
    orbit: Any = chain(PlasticBelow(0.01, 0.7)).attractor().periodic_orbit()
    (approach,) = orbit.impulses / 1.7
    branch = continue_orbit(orbit, "restitution.velocity", bounds=(1e-3, 2.0 * approach))
    (jump,) = branch.bifurcations
    assert jump.kind == "GR"
    assert jump.value == pytest.approx(approach, rel=1e-12)
    beyond = branch.parameter > approach * (1.0 + 1e-9)
    assert beyond.any()
    assert not branch.admissible[beyond].any()
    assert branch.admissible[branch.parameter < approach * (1.0 - 1e-9)].all()


def test_a_stop_with_a_law_is_not_stuck_to() -> None:
    system = ImpactChain(frequency=0.408, restitution=PlasticBelow(0.05))
    with pytest.raises(NotImplementedError, match="must not stick to a stop with an impact law"):
        system.periodic_orbit(start=system.attractor().final)
