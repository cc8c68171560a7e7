"""Orbits by itinerary where energies are not quadratic: as the exact engine, and simulation."""

from __future__ import annotations

from functools import cache
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from dynkit import continue_curve, continue_orbit
from dynkit.orbits.kinds import BifurcationKind
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    Jenkins,
    SoftStop,
    TodaChain,
)
from tests.impact.taylor_cases import Bead, Disguised
from tests.impact.toda_many_digits import ManyDigits
from tests.impact_orbits.bent_cases import WIDE

TABLE = HardStop(-1, amplitude=0.1, restitution=0.85, name="table")
SOFT = SoftStop(0, offset=0.02, stiffness=50.0, damping=0.2, name="pad")
BELT = DryFriction(0, force=0.5, static=0.8, velocity=0.2, name="belt")
MOVING = SoftStop(1, amplitude=0.1, stiffness=50.0, damping=0.2, preload=0.01, name="pad")

LINEAR: dict[str, tuple[dict[str, Any], list[str]]] = {
    "impacts": ({"masses": 3, "frequency": 0.9}, ["frequency", "damping", "offset"]),
    "play": ({"masses": 2, "frequency": 1.1, "play": 0.3, "amplitude": 0.05}, ["play"]),
    "soft": (
        {"masses": 2, "frequency": 0.9, "elements": [TABLE, SOFT]},
        ["frequency", "pad.stiffness", "table.restitution"],
    ),
    "a moving pad": (
        {"masses": 2, "frequency": 0.9, "elements": [MOVING]},
        ["frequency", "pad.amplitude", "pad.preload"],
    ),
    "friction": (
        {
            "masses": 2,
            "frequency": 0.7,
            "harmonic_forces": [0.8, 0.0],
            "elements": [
                DryFriction(0, force=0.3, name="rail"),
                SoftStop(1, offset=-0.2, stiffness=20.0),
            ],
        },
        ["frequency", "damping", "rail.force"],
    ),
    "a cycle on a belt": (
        {"masses": 1, "damping": 0.01, "frequency": 1.0, "elements": [BELT]},
        ["belt.force", "belt.velocity", "belt.static"],
    ),
    "chatter and contact": (
        {"masses": 2, "frequency": 0.2, "restitution": 0.4},
        ["frequency", "restitution", "amplitude", "damping"],
    ),
    "contact without rebound": (
        {"masses": 3, "frequency": 0.8, "side": "below", "restitution": 0.0},
        ["frequency", "offset"],
    ),
    "joint": (
        {
            "masses": 2,
            "frequency": 0.9,
            "elements": [
                TABLE,
                Jenkins(
                    0,
                    stiffness=2.0,
                    force=0.02,
                    velocity=0.01,
                    amplitude=0.05,
                    side="below",
                    name="j",
                ),
            ],
        },
        ["frequency", "j.velocity", "j.amplitude", "j.phase", "j.force", "j.stiffness"],
    ),
    "masses hit each other": (
        {
            "masses": 3,
            "frequency": 0.9,
            "elements": [TABLE, HardStop((0, 1), offset=-0.05, restitution=0.5, name="gap")],
        },
        ["gap.offset", "gap.restitution", "frequency"],
    ),
    "a mass that never leaves its stop": (
        {
            "masses": 2,
            "frequency": 0.7,
            "constant_forces": [0.0, -2.0],
            "harmonic_forces": [0.3, 0.0],
            "elements": [HardStop(1, offset=0.1, restitution=0.5, name="floor")],
        },
        ["frequency", "floor.offset"],
    ),
}


@cache
def both(name: str) -> tuple[Any, Any]:
    """The orbit by exponential sums, and by Taylor's method."""
    given = LINEAR[name][0]
    settled = ImpactChain(**given).attractor()
    near = Disguised(**given).attractor(transient=0, keep=20, start=settled.final)
    exact: Any = settled.periodic_orbit()
    other: Any = near.periodic_orbit()
    assert (exact.system.engine, other.system.engine) == ("exponential sums", "Taylor")
    return exact, other


@pytest.mark.parametrize("name", LINEAR)
def test_a_linear_structure_has_the_orbit_of_the_exact_engine(name: str) -> None:
    exact, other = both(name)
    away = abs(exact.system.difference(exact.states, other.states)).max()
    assert away <= exact.error + other.error
    assert other.error < 1e-10
    assert (exact.label, dict(exact.counts)) == (other.label, dict(other.counts))
    assert exact.admissible
    assert other.admissible
    assert np.poly(other.multipliers) == pytest.approx(np.poly(exact.multipliers), abs=1e-11)
    times = np.linspace(0.0, exact.period, 50)
    for one, two in zip(exact.sample(times), other.sample(times), strict=True):
        assert one == pytest.approx(two, abs=1e-11)


@pytest.mark.parametrize(("name", "parameter"), [(n, p) for n in LINEAR for p in LINEAR[n][1]])
def test_derivatives_by_parameters_are_those_of_the_exact_engine(name: str, parameter: str) -> None:
    changes = []
    for orbit in both(name):
        problem = orbit._problem.free(parameter)
        x, p = orbit._x, problem.values
        by = problem.parameter_derivative(x, p)[:, 0]
        changes.append(np.linalg.solve(problem.linearization(x, p), -by))
    # phases and impulses come first, whatever the other unknowns are
    one, two = (change[: len(orbit.impulses) + len(orbit.phases)] for change in changes)
    assert one == pytest.approx(two, rel=1e-10, abs=1e-10)


BORDERS = [
    ("impacts", "frequency", (0.6, 0.92)),
    ("a moving pad", "frequency", (0.84, 0.92)),
    ("soft", "pad.offset", (0.015, 0.021)),
    ("masses hit each other", "gap.offset", (-0.06, -0.0495)),
]


@pytest.mark.parametrize(("name", "parameter", "bounds"), BORDERS)
def test_branches_meet_the_bifurcations_of_the_exact_engine(
    name: str, parameter: str, bounds: tuple[float, float]
) -> None:
    branches = [continue_orbit(orbit, parameter, bounds=bounds, **WIDE) for orbit in both(name)]
    one, two = (sorted(b.bifurcations, key=lambda each: each.value) for b in branches)
    assert {each.kind for each in one} & {BifurcationKind.GR, BifurcationKind.CB}
    assert [each.kind for each in one] == [each.kind for each in two]
    for known, found in zip(one, two, strict=True):
        assert abs(known.value - found.value) <= known.error + found.error
        assert known.admissible == found.admissible


@cache
def toda() -> Any:
    """The branch of Toda's chain from its orbit at 0.9, and that orbit."""
    orbit: Any = TodaChain(masses=5, frequency=0.9).attractor().periodic_orbit()
    return continue_orbit(orbit, "frequency", bounds=(0.86, 0.97)), orbit


def test_toda_s_chain_is_followed_through_grazings() -> None:
    branch, orbit = toda()
    assert (orbit.label, orbit.admissible) == ("P(2,2)", True)
    kinds = [each.kind.name for each in branch.bifurcations]
    assert kinds == ["PD", "GR", "NS", "GR", "PD"]
    low, high = (each.value for each in branch.bifurcations if each.kind is BifurcationKind.GR)
    for place in range(0, len(branch), 4):
        there, value = branch.orbit(place), float(branch.parameter[place])
        assert there.admissible == (low < value < high)
        if there.admissible and there.stable:
            system, first = there.system, there.states[0]
            assert abs(system.difference(system(system(first)), first)).max() < 1e-9


def test_at_a_grazing_the_gap_of_simulation_touches_zero() -> None:
    grazing = toda()[0].bifurcations[1]
    assert 0.87 < grazing.value < 0.9
    orbit = grazing.orbit
    system, times = orbit.system, np.linspace(0.0, orbit.period, 20001)
    x, _ = orbit.sample(times)
    phases = orbit.phases[0] + system.frequency * times
    gaps = x[:, -1] - system.offset - system.amplitude * np.sin(phases)
    apart = abs((times[:, None] - np.append(orbit.time, orbit.period)) % orbit.period).min(axis=1)
    inside = gaps[(apart > 0.05) & (orbit.period - apart > 0.05)]
    assert -1e-9 < inside.min() < 1e-6
    (other,) = grazing.switch()
    assert other.label == "P(3,2)"


def test_criticality_curves_and_stores(tmp_path: Any) -> None:
    branch, _ = toda()
    _, _, torus, grazing, _ = branch.bifurcations
    assert torus.rotation_number == pytest.approx(0.2465, abs=1e-4)
    assert str(torus.criticality).startswith("subcritical")
    bounds = (0.95, 0.97), (0.099, 0.101)
    curve = continue_curve(grazing, ("frequency", "amplitude"), bounds=bounds)
    assert len(curve) > 2
    branch.save(tmp_path / "branch.h5")


def test_a_mass_matrix_that_varies() -> None:
    system: Any = Bead(frequency=0.9, amplitude=0.3, restitution=0.5)
    attractor = system.attractor(transient=300)
    orbit: Any = attractor.periodic_orbit()
    assert orbit.admissible
    away = abs(system.difference(orbit.states[:1], attractor.states)).max(axis=1).min()
    assert away < 1e-8
    n = len(orbit.states)
    jacobian = np.eye(system.dimension)
    for state in orbit.states:
        jacobian = system.jacobian(state) @ jacobian
    assert n == orbit.impacts
    known = np.linalg.eigvals(jacobian)
    assert np.poly(orbit.multipliers) == pytest.approx(np.poly(known), abs=1e-8)


@pytest.mark.usefixtures("optimised")
def test_the_error_of_toda_s_orbit_lies_over_its_actual_error() -> None:
    chain = TodaChain(masses=2, frequency=1.2)
    orbit = chain.attractor().periodic_orbit()
    exact = ManyDigits(2, 1.2, 0.1, 0.1, 0.85)
    state = orbit.states[0]
    with mp.workdps(30):
        following = np.array(exact.next_impact(state.tolist())[:-1], dtype=float)
    grown = 1.0 + float(np.linalg.norm(chain.jacobian(state), np.inf))
    assert abs(chain.difference(following, state)).max() <= grown * orbit.error < 1e-10


def test_toda_s_chain_chatters_and_sticks() -> None:
    chain = TodaChain(masses=2, frequency=0.2, restitution=0.4)
    attractor = chain.attractor()
    orbit: Any = attractor.periodic_orbit()
    assert (orbit.label, orbit.admissible, orbit.stable) == ("P(inf,1)", True, True)
    (begin, end) = orbit.contacts[0]
    assert 0.0 < begin < end <= orbit.period
    x, _ = orbit.sample(np.linspace(begin, end, 20) + 1e-9)
    phases = orbit.phases[0] + chain.frequency * np.linspace(begin, end, 20)
    assert x[:, -1] == pytest.approx(chain.amplitude * np.sin(phases), abs=1e-8)
    branch = continue_orbit(orbit, "frequency", bounds=(0.1995, 0.2005), **WIDE)
    for place in (0, -1):
        there = branch.orbit(place)
        settled: Any = there.system.attractor(start=attractor.final).periodic_orbit()
        away = abs(there.system.difference(there.states, settled.states)).max()
        assert away <= there.error + settled.error


def test_a_chain_of_toda_slips_and_sticks() -> None:
    belt = DryFriction(0, force=0.5, name="rail")
    chain = TodaChain(masses=2, frequency=0.7, harmonic_forces=[0.8, 0.0], elements=[belt])
    attractor = chain.attractor()
    orbit: Any = attractor.periodic_orbit()
    assert orbit.admissible
    assert orbit.counts["rail.sticks"] > 0
    away = abs(chain.difference(orbit.states, attractor.states[-len(orbit.states) :])).max()
    assert away < 1e-8
    jacobian = chain.jacobian(orbit.states[0])
    assert np.poly(orbit.multipliers) == pytest.approx(
        np.poly(np.linalg.eigvals(jacobian)), abs=1e-8
    )


# --- the driven Toda chain ------------------------------------------------------------------------


def driven_toda(masses: int, **parameters: Any) -> TodaChain:
    return TodaChain(
        masses=masses, elements=[SoftStop(0, offset=-100.0, stiffness=1.0)], **parameters
    )


def free_period(energy: float) -> float:
    """Period of a free mass on Toda's spring, by quadrature between its turning points."""

    def left(x: Any) -> Any:
        return energy - (np.exp(x) - 1.0 - x)

    low, high = brentq(left, -50.0, 0.0), brentq(left, 0.0, 10.0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)

    def time(angle: float) -> Any:
        return half * np.cos(angle) / np.sqrt(2.0 * left(middle + half * np.sin(angle)))

    return float(2.0 * quad(time, -0.5 * np.pi, 0.5 * np.pi, epsabs=1e-10)[0])


def test_the_resonance_of_a_toda_spring_leans_along_its_free_oscillations() -> None:
    chain = driven_toda(1, damping=0.02, frequency=0.6, harmonic_forces=[0.04])
    orbit = chain.attractor(transient=400).periodic_orbit()
    branch = continue_orbit(orbit, "frequency", bounds=(0.6, 1.2), largest_step=0.1)
    energy = []
    for i, frequency in enumerate(branch.parameter):
        x, v = branch.orbit(i).sample(np.linspace(0.0, 2.0 * np.pi / frequency, 65)[:-1])
        energy.append((v**2 / 2.0 + np.exp(x) - 1.0 - x).mean())
    top = int(np.argmax(energy))
    # the dashpot is balanced by the force, but for terms of the order of its square
    assert branch.parameter[top] == pytest.approx(2.0 * np.pi / free_period(energy[top]), abs=4e-4)
    assert energy[top] > 1.5
    folds = [found.value for found in branch.bifurcations]
    assert [found.kind for found in branch.bifurcations] == [BifurcationKind.SN] * 2
    assert min(folds) < branch.parameter[top] < 0.87
    assert max(folds) > 0.95


@pytest.mark.parametrize(("frequency", "label"), [(0.86, "P(1,1)"), (0.893, "P(2,2)")])
def test_a_driven_toda_chain_doubles_its_period(frequency: float, label: str) -> None:
    # between the period doublings of its branch at 0.8824 and 0.9038
    chain = driven_toda(3, damping=0.05, frequency=frequency, harmonic_forces=[0.0, 0.0, 0.15])
    assert str(chain.attractor(transient=600).label) == label
