"""Orbits and branches with impact laws: numbers as restitution, the map's orbits, differences."""

from functools import cache
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
from tests.impact.own_laws import Constant, Hardening, Rooted
from tests.impact_orbits.bent_cases import WIDE
from tests.impact_orbits.contracts import check_parameters
from tests.impact_orbits.sticking_cases import differences

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
    values = orbit.system.parameters.items()
    own = [name for name, p in values if p and np.isfinite(p) and name != "chatter_tolerance"]
    # those that are no numbers of the law do not meet it but by its slope, which hardens here
    every = isinstance(law, Hardening)
    names = [name for name in own if every or "restitution" in name or name == "frequency"]
    check_parameters(orbit, names)


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


# --- orbits that stick ----------------------------------------------------------------------------


def sticking(restitution: Any, frequency: float = 0.408) -> ImpactChain:
    return ImpactChain(masses=2, frequency=frequency, damping=0.1, restitution=restitution)


STICKING = {
    "hardens": sticking(Hardening(0.3, 1.0)),
    "plastic": sticking(PlasticBelow(0.05, 0.6)),
    "elastic": sticking(ViscoelasticSpheres(1.2)),
    "elastic, slower": sticking(Rooted(0.8, 0.15), 0.25),
}


@cache
def sticking_orbit(name: str) -> Any:
    return STICKING[name].attractor(transient=2000).periodic_orbit()


def test_a_law_that_is_a_number_sticks_as_the_number() -> None:
    law, number = (sticking(r).attractor().periodic_orbit() for r in (Constant(0.6), 0.6))
    assert abs(law.states - number.states).max() <= law.error + number.error
    assert abs(law.multipliers - number.multipliers).max() < 1e-13
    by = [
        orbit.problem(name).parameter_derivative(orbit.unknowns, np.array([0.6]))
        for orbit, name in ((law, "restitution.value"), (number, "restitution"))
    ]
    assert by[0] == pytest.approx(by[1], rel=1e-9, abs=1e-9 * abs(by[1]).max())


@pytest.mark.parametrize("name", STICKING)
def test_simulation_from_the_release_comes_back_to_it(name: str) -> None:
    orbit, system = sticking_orbit(name), STICKING[name]
    assert orbit.sticks
    assert orbit.admissible
    label = system.attractor(transient=2000).label
    assert orbit.counts == label.counts
    (state,) = orbit.states
    record = system.simulate(impacts=3000, start=system.impact_state(state))
    there, back = record.sample([orbit.period]), orbit.sample([orbit.period])
    apart = max(float(abs(a - b).max()) for a, b in zip(there, back, strict=True))
    assert apart < 4.0 * (orbit.error + orbit.chatter_error + record.error.max()) < 1e-8


@pytest.mark.parametrize("name", STICKING)
def test_multipliers_are_those_of_differences_of_simulations(name: str) -> None:
    """Of the map from places in contact a little before the release to those of a period later."""
    orbit, system = sticking_orbit(name), STICKING[name]
    (state,) = orbit.states
    early, period = 0.05, orbit.period

    def held(places: Any) -> Any:
        start = np.concatenate([places, [0.0, state[-1] - early]])
        record = system.simulate(impacts=3000, start=system.impact_state(start))
        x, v = record.sample([period])
        return np.concatenate([x[0, :1], v[0, :1]])

    x, v = orbit.sample([period - early / system.frequency])
    begin = np.concatenate([x[0, :1], v[0, :1]])
    matrix = differences(held, begin, np.full(2, 1e-5))
    wanted = np.sort(abs(np.linalg.eigvals(matrix)))
    assert abs(np.sort(abs(orbit.multipliers[:-2])) - wanted).max() < 1e-6


@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        ("hardens", "restitution.scale"),
        ("hardens", "frequency"),
        ("plastic", "restitution.rebound"),
        ("elastic, slower", "restitution.loss"),
    ],
)
def test_equations_of_what_sticks_keep_the_contracts(name: str, parameter: str) -> None:
    orbit = sticking_orbit(name)
    problem = orbit.problem(parameter)
    check_problem(problem, orbit.unknowns, problem.values)


def test_a_branch_that_sticks_is_followed_in_a_number_of_the_law() -> None:
    branch = continue_orbit(
        sticking_orbit("elastic"), "restitution.dissipation", bounds=(1.19, 1.21), **WIDE
    )
    assert branch.admissible.all()
    last = branch.orbit(int(np.argmax(branch.parameter)))
    other = sticking(ViscoelasticSpheres(1.21)).attractor(transient=2000).periodic_orbit()
    assert abs(last.states - other.states).max() <= last.error + other.error


def test_slow_impacts_of_what_sticks_meet_the_jump_of_the_law() -> None:
    orbit = sticking_orbit("plastic")
    speeds = orbit.impulses[orbit._solution.restitutions > 0.0] / 1.6
    branch = continue_orbit(orbit, "restitution.velocity", bounds=(0.049, 1.2 * speeds.min()))
    jumps = [b for b in branch.bifurcations if "jump of the law" in b.touching]
    assert any(abs(jump.value - speeds.min()) < 1e-10 for jump in jumps)
