"""Orbits by itinerary of machines with sliders: as simulation, and to where a slider yields."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit import NoConvergence, continue_orbit
from dynkit.orbits.kinds import BifurcationKind
from dynkit.systems import HardStop, ImpactChain, Jenkins, iwan
from tests.impact.test_jenkins import JOINT, MACHINE, block

TABLE = HardStop(1, amplitude=0.1, restitution=0.85, name="table")
MACHINES: dict[str, ImpactChain] = {
    "one": block(JOINT),
    "two": block(JOINT, Jenkins(0, stiffness=1.0, force=0.1, name="other"), drive=0.9),
    "iwan": block(
        *iwan(0, stiffness=3.0, force=0.3, elements=5, exponent=-0.4, macroslip=0.2), drive=0.8
    ),
    "beside a table": ImpactChain(
        masses=2,
        frequency=0.9,
        elements=[TABLE, Jenkins(0, stiffness=1.0, force=0.03, name="joint")],
    ),
    "along one row": MACHINE,
}


@pytest.mark.parametrize("name", MACHINES)
def test_orbits_are_those_of_simulation(name: str) -> None:
    machine = MACHINES[name]
    attractor = machine.attractor(transient=2000)
    orbit: Any = attractor.periodic_orbit()
    assert orbit.label == str(attractor.label)
    assert orbit.admissible
    assert orbit.counts == attractor.label.counts
    count = len(orbit.states)
    away = abs(machine.difference(orbit.states, attractor.states[-count:])).max()
    assert away <= orbit.error + float(attractor.record.error.max())
    jacobian = np.eye(machine.dimension)
    for state in orbit.states:
        jacobian = machine.jacobian(state) @ jacobian
    known = np.poly(np.linalg.eigvals(jacobian))
    assert np.poly(orbit.multipliers) == pytest.approx(known, abs=1e-9)


@pytest.mark.parametrize("parameter", ["frequency", "joint.force", "joint.stiffness"])
def test_derivatives_by_parameters_are_differences_of_orbits(parameter: str) -> None:
    orbit: Any = MACHINES["beside a table"].attractor().periodic_orbit()
    problem = orbit._problem.free(parameter)
    x, p = orbit._x, problem.values
    by = problem.parameter_derivative(x, p)[:, 0]
    change = np.linalg.solve(problem.linearization(x, p), -by)
    h, ends = 1e-4, []
    for value in (p[0] - h, p[0] + h):
        there = orbit.system.replace(**{parameter: float(value)})
        ends.append(there.attractor(start=orbit.system.impact_state(orbit.states[0])))
    found = [end.periodic_orbit() for end in ends]
    differences = (found[1].impulses - found[0].impulses) / (2.0 * h)
    impulses = slice(len(problem.itinerary), len(problem.itinerary) + len(orbit.impulses))
    assert change[impulses] == pytest.approx(differences, rel=1e-4, abs=1e-6)


def test_a_branch_ends_where_the_slider_slips_no_more() -> None:
    # of the stuck slider the response is linear: it slips where its spring may bear no more
    orbit = MACHINES["one"].attractor().periodic_orbit()
    branch = continue_orbit(orbit, "joint.force", bounds=(0.2, 1.0))
    (last,) = branch.bifurcations
    w, damping, drive = 0.8, 0.05, 0.5
    stuck = 1.0 + JOINT.stiffness
    force = JOINT.stiffness * drive / abs(stuck - w * w + 1j * damping * w)
    assert last.kind is BifurcationKind.GR
    assert abs(last.value - force) <= last.error + 1e-12
    assert "grazing-sliding" in last.touching
    assert branch.endings[-1].message.startswith("beyond, there is no such orbit")


def test_a_slider_that_never_slips_may_be_anywhere() -> None:
    machine = block(Jenkins(0, stiffness=2.0, force=50.0, name="joint"))
    with pytest.raises(NoConvergence, match="a slider that never slips may be anywhere; got Jenk"):
        machine.attractor(transient=500).periodic_orbit()
