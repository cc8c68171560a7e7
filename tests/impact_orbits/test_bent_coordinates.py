"""Orbits on stops along functions, where masses vary too: as the exact engine, and 60 digits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from flint import arb, ctx

from dynkit import continue_orbit
from dynkit.orbits.kinds import BifurcationKind
from dynkit.systems import HardStop, SoftStop
from tests.flows.cases import BITS
from tests.impact.curved_cases import ARM, Bob, Exact
from tests.impact_orbits.bent_cases import WIDE, both

CASES: dict[str, dict[str, Any]] = {
    "one mass": {"masses": 1, "frequency": 2.4},
    "two masses": {"masses": 2, "frequency": 0.9},
    "one mass sticks": {"masses": 1, "frequency": 0.3, "restitution": 0.4},
    "two masses stick": {"masses": 2, "frequency": 0.2, "restitution": 0.4},
    "two masses, a plain stop": {
        "masses": 2,
        "frequency": 0.2,
        "restitution": 0.4,
        "straight": True,
    },
    "no rebound": {"masses": 2, "frequency": 0.8, "restitution": 0.0},
}


@cache
def orbits(name: str) -> tuple[Any, Any]:
    """The orbit by exponential sums, and in bent coordinates."""
    chain, bent = both(**CASES[name])
    exact = chain.attractor(transient=300).periodic_orbit()
    near = bent.attractor(transient=0, keep=20, start=bent.beside(exact)[1])
    return exact, near.periodic_orbit()


@pytest.mark.parametrize("name", CASES)
def test_phases_impulses_and_multipliers_are_those_of_the_linear_machine(name: str) -> None:
    exact, bent = orbits(name)
    assert bent.system.engine == "Taylor"
    assert (exact.label, exact.admissible) == (bent.label, bent.admissible)
    allowed = exact.error + bent.error
    assert bent.error < 1e-10
    assert abs(exact.phases - bent.phases).max() <= allowed
    assert abs(exact.impulses - bent.impulses).max() <= allowed
    assert abs(exact.contacts - bent.contacts).max(initial=0.0) <= allowed
    assert np.poly(bent.multipliers) == pytest.approx(np.poly(exact.multipliers), abs=1e-11)
    times = np.linspace(0.0, exact.period, 30)
    x, q = exact.sample(times)[0], bent.sample(times)[0]
    moved = np.array(bent.system.places(q.T)).T
    assert x == pytest.approx(moved, abs=1e-11)


@pytest.mark.parametrize("name", ["two masses", "two masses stick", "two masses, a plain stop"])
def test_derivatives_by_parameters_are_those_of_the_linear_machine(name: str) -> None:
    exact, bent = orbits(name)
    for parameter in ("frequency", "restitution", "amplitude", "damping"):
        one, two = _changes(exact, parameter), _changes(bent, _of_table(parameter))
        assert one == pytest.approx(two, rel=1e-10, abs=1e-10)


def _of_table(parameter: str) -> str:
    return parameter if parameter in ("frequency", "damping") else f"table.{parameter}"


def _changes(orbit: Any, parameter: str) -> Any:
    """Of phases and impulses, which come first, whatever the other unknowns are."""
    problem = orbit._problem.free(parameter)
    x, p = orbit._x, problem.values
    by = problem.parameter_derivative(x, p)[:, 0]
    found = np.linalg.solve(problem.linearization(x, p), -by)
    return found[: problem.layout.events + problem.layout.impacts]


@pytest.mark.parametrize("name", ["two masses", "two masses stick"])
def test_other_coordinates_change_no_phase_and_no_impulse(name: str) -> None:
    for parameter in ("bend", "last"):
        assert abs(_changes(orbits(name)[1], parameter)).max() < 1e-10


@pytest.mark.parametrize(
    ("name", "bounds", "kinds"),
    [("one mass", (2.4, 2.7), {"PD"}), ("two masses", (0.86, 0.91), {"GR"})],
)
def test_branches_meet_the_bifurcations_of_the_linear_machine(
    name: str, bounds: tuple[float, float], kinds: set[str]
) -> None:
    exact, bent = (
        continue_orbit(orbit, "frequency", bounds=bounds).bifurcations for orbit in orbits(name)
    )
    assert {each.kind.name for each in exact} == kinds
    for known, found in zip(exact, bent, strict=True):
        assert (known.kind, known.admissible) == (found.kind, found.admissible)
        assert abs(known.value - found.value) <= known.error + found.error
    for grazing in (each for each in bent if each.kind is BifurcationKind.GR):
        ends = [sorted(str(o.label) for o in each.switch()) for each in (exact[0], grazing)]
        assert ends[0] == ends[1]
        assert ends[0]


# --- a wall beside a pendulum ---------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Walled(Bob):
    """A pendulum whose bob meets a wall beside it."""

    def beside(self, x: Any) -> Any:
        """Return the distance of the bob from below the pivot."""
        return self.length * sp.sin(x[0])


@pytest.mark.parametrize("restitution", [0.8, 0.3])
def test_a_wall_is_a_stop_on_the_angle(restitution: float) -> None:
    one: Any
    two: Any
    own: dict[str, Any] = {"restitution": restitution, "side": "below", "name": "wall"}
    angle = HardStop(0, offset=math.asin(0.25), **own)
    wall = HardStop("beside", offset=0.25, **own)
    found = [
        Walled(frequency=0.8, drag=0.2, harmonic_forces=(0.4,), elements=[stop])
        for stop in (angle, wall)
    ]
    one, two = (
        system.attractor(start=system.state(position=[-0.3]), transient=200).periodic_orbit()
        for system in found
    )
    assert (one.label, one.admissible) == (two.label, True)
    assert abs(one.phases - two.phases).max() <= one.error + two.error
    assert np.poly(one.multipliers) == pytest.approx(np.poly(two.multipliers), abs=1e-11)
    # rates of the gap are those of the angle times the cosine
    lever = math.cos(math.asin(0.25))
    assert lever * one.impulses == pytest.approx(two.impulses, abs=1e-11)


# --- sixty digits, and the map --------------------------------------------------------------------


def test_the_error_of_an_orbit_lies_over_its_actual_error() -> None:
    table = HardStop("height", amplitude=0.05, offset=0.3, restitution=0.9, name="floor")
    system = Bob(frequency=4.0, elements=[table])
    orbit: Any = system.attractor(
        start=system.state(position=[1.5]), transient=300
    ).periodic_orbit()
    state = orbit.states[0]
    begin, exact = system.impact_state(state), Exact(system)
    with ctx.workprec(BITS):
        start = [*(arb(y) for y in (*begin.position, *begin.velocity)), arb(float(state[-1]))]
        ((time, x, v, _),) = exact.after(start, [orbit.period])
    grown = 1.0 + float(np.linalg.norm(system.jacobian(state), np.inf))
    off = [float(x) - begin.position[0], float(v) - begin.velocity[0], float(time) - orbit.period]
    assert max(map(abs, off)) <= grown * orbit.error < 1e-10


def test_an_arm_before_a_wall_has_the_multipliers_of_its_map() -> None:
    system: Any = ARM.replace(frequency=2.2)
    start = system.state(position=[-0.4, -0.9], velocity=[0.3, 0.2])
    orbit = system.attractor(start=start, transient=300).periodic_orbit()
    assert (orbit.label, orbit.admissible) == ("P(1,2)", True)
    known = np.linalg.eigvals(system.jacobian(orbit.states[0]))
    found = np.append(orbit.multipliers, [0.0, 0.0])
    assert np.poly(found) == pytest.approx(np.poly(known), abs=1e-10)
    branch = continue_orbit(orbit, "floor.offset", bounds=(0.198, 0.202), **WIDE)
    there = branch.orbit(0)
    settled = there.system.attractor(
        start=orbit.system.impact_state(orbit.states[0]), transient=300
    )
    away = abs(there.system.difference(there.states[:1], settled.states)).max(axis=1).min()
    assert away < 1e-9


def test_a_soft_stop_presses_beside_a_wall() -> None:
    wall = HardStop("reach", side="below", amplitude=0.1, offset=0.2, restitution=0.6, name="wall")
    pad = SoftStop(0, offset=-0.1, stiffness=20.0, damping=0.1, name="pad")
    system: Any = ARM.replace(frequency=2.2, elements=[wall, pad])
    start = system.state(position=[0.1, -0.5], velocity=[0.3, 0.2])
    orbit = system.attractor(start=start, transient=300).periodic_orbit()
    assert orbit.admissible
    assert orbit.counts["pad.presses"] > 0
    jacobian = np.eye(system.dimension)
    for state in orbit.states:
        jacobian = system.jacobian(state) @ jacobian
    found = np.append(orbit.multipliers, [0.0, 0.0])
    assert np.poly(found) == pytest.approx(np.poly(np.linalg.eigvals(jacobian)), abs=1e-9)


# --- searches -------------------------------------------------------------------------------------


def test_a_search_finds_the_orbits_of_the_linear_machine() -> None:
    exact, bent = (
        system.find_orbits(impacts=2, periods=2)
        for system in both(masses=1, frequency=2.8, restitution=0.8, damping=0.1)
    )
    assert bent.message.startswith("P(1,1) to P(2,2): from near returns among 3000 impacts")
    known, found = ([o for o in search if o.admissible] for search in (exact, bent))
    assert [str(orbit.label) for orbit in known] == ["P(1,1)", "P(2,2)"]
    for one, two in zip(known, found, strict=True):
        assert one.label == two.label
        assert not two.stable
        assert one.impulses.sum() == pytest.approx(two.impulses.sum(), abs=1e-10)
    system = bent.system
    (first,) = system.periodic_orbits()
    assert first.phases == pytest.approx(found[0].phases, abs=1e-10)


def test_a_search_finds_orbits_that_stick() -> None:
    exact, bent = both(**CASES["one mass sticks"])
    one, two = (system.periodic_orbit(sticking=True) for system in (exact, bent))
    assert (one.label, two.admissible) == (two.label, True)
    apart = np.sin(0.5 * (one.phases - two.phases))
    assert abs(apart).max() <= one.error + two.error


def test_a_search_needs_a_drive() -> None:
    with pytest.raises(ValueError, match="system must be driven"):
        ARM.replace(**{"floor.amplitude": 0.0}, harmonic_forces=()).find_orbits()
