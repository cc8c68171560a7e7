"""Several elements that hold or stick where the mass matrix varies: as the exact engine.

A chain in coordinates of which the first one is bent has a mass matrix that depends on all of them,
and the same motion.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from dynkit.systems import DryFriction, HardStop, ImpactChain, SoftStop
from dynkit.systems.impact.elements.element import EventKind
from dynkit.testing.maps import jacobian_is_the_derivative
from tests.impact_orbits.bent_cases import Leaning

TABLE = HardStop(2, amplitude=0.1, restitution=0.6, name="table")
CASES: dict[str, dict[str, Any]] = {
    "two contacts": {
        "frequency": 0.3,
        "elements": [
            HardStop(2, amplitude=0.1, restitution=0.3),
            HardStop(1, offset=-0.02, restitution=0.4),
        ],
    },
    "stacked": {
        "frequency": 1.9,
        "constant_forces": [0.0, 0.6, -1.8],
        "elements": [
            HardStop(2, amplitude=0.6, restitution=0.0),
            HardStop((1, 2), offset=-0.05, restitution=0.0),
        ],
    },
    "friction": {
        "frequency": 0.9,
        "elements": [TABLE, DryFriction(1, force=0.02, static=0.03, velocity=0.1)],
    },
    "preload": {
        "frequency": 0.9,
        "elements": [TABLE, SoftStop(1, offset=-0.05, stiffness=20.0, damping=0.3, preload=0.05)],
    },
}


@cache
def both(name: str) -> tuple[Any, Any]:
    """Motions of the chain, and in coordinates of which one is bent."""
    exact = ImpactChain(masses=3, damping=0.15, **CASES[name])
    bent = Leaning(damping=0.15, **CASES[name])
    q = np.array([0.2, 0.4, 0.5])
    x = [float(place) for place in bent.places(q)]
    start = bent.state(q, [0.0, 0.0, 0.0]), exact.state(x, [0.0, 0.0, 0.0])
    return exact.simulate(impacts=16, start=start[1]), bent.simulate(impacts=16, start=start[0])


@pytest.mark.parametrize("name", CASES)
def test_motions_are_those_of_the_chain(name: str) -> None:
    exact, bent = both(name)
    assert bent.system.engine == "Taylor"
    bound = exact.error[-1] + bent.error[-1]
    assert bound < 1e-11
    assert repr(exact.events) == repr(bent.events)
    assert abs(exact.time - bent.time).max() <= bound / exact.system.frequency
    places = np.array(bent.system.places(bent.position.T)).T
    assert abs(exact.position - places).max() <= bound
    heat = bent.energy_balance().dissipated
    assert heat == pytest.approx(exact.energy_balance().dissipated, abs=1e-11)


@pytest.mark.parametrize("name", CASES)
def test_the_derivative_of_the_map_is_that_of_differences(name: str) -> None:
    jacobian_is_the_derivative(both(name)[1].system, both(name)[1].states[12:14])


@pytest.mark.parametrize("name", ["two contacts", "friction"])
def test_orbits_have_the_multipliers_of_the_chain(name: str) -> None:
    systems = (record.system for record in both(name))
    exact, bent = (s.attractor(transient=60, keep=60).periodic_orbit() for s in systems)
    assert (exact.label, bent.admissible) == (bent.label, True)
    assert abs(exact.phases - bent.phases).max() <= exact.error + bent.error
    assert np.poly(bent.multipliers) == pytest.approx(np.poly(exact.multipliers), abs=1e-11)


def test_a_contact_that_an_impact_opens_ends_with_that_impact() -> None:
    record = both("stacked")[1]
    assert (np.diff(record.events.time)[record.events.kind[:-1] == EventKind.RELEASE] == 0.0).any()
    jacobian_is_the_derivative(record.system, record.states[12:14])
