"""Errors of orbits by itinerary: first-order changes of states, and actual errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit.core.differences import numerical_derivative
from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, ImpactChain, MatrixOscillator, SoftStop
from dynkit.systems.impact.orbits.itineraries.several_modes import errors
from tests.impact_orbits.test_itineraries import MACHINES, orbit_of
from tests.reference.itineraries import section_error

NONE = np.empty(0)


def shaken(seed: int) -> ImpactChain:
    """A mass at a soft stop, with friction; both move far, slowly or fast."""
    random = np.random.default_rng(seed)
    moving: list[dict[str, Any]] = [
        {"amplitude": 10.0 ** random.uniform(-1.0, 2.0), "phase": random.uniform(-3.0, 3.0)}
        for _ in range(2)
    ]
    soft = SoftStop(0, stiffness=10.0 ** random.uniform(0.0, 4.0), damping=0.1, **moving[0])
    rub = DryFriction(0, force=10.0 ** random.uniform(-2.0, 1.0), **moving[1])
    return ImpactChain(
        masses=1,
        damping=0.1,
        frequency=10.0 ** random.uniform(-1.5, 2.5),
        harmonic_forces=[10.0 ** random.uniform(-1.0, 1.0)],
        elements=[soft, rub],
    )


@pytest.mark.parametrize("seed", [1, 3, 4, 5, 12, 13])
def test_the_actual_error_lies_under_the_estimate(seed: int) -> None:
    orbit: Any = shaken(seed).attractor(transient=200, impacts=20).periodic_orbit()
    assert section_error(orbit) <= orbit.error


def grazes(amplitude: float) -> Any:
    """A mass that hits a stop so that friction with a surface that moves far stops its slip."""
    rub = DryFriction(0, normal="table", coefficient=1e3 * amplitude, amplitude=amplitude)
    return MatrixOscillator(
        M=np.eye(2),
        C=np.diag([0.1, 0.2]),
        K=np.eye(2),
        frequency=2.1,
        harmonic_forces=[0.5, 1.0],
        elements=[HardStop(1, restitution=0.8, name="table"), rub],
    )


CASES = {**{name: MACHINES[name] for name in ("cushion", "brake", "mixed")}, "rubs": grazes(10.0)}


@pytest.mark.parametrize("most", [1000, 1])
@pytest.mark.parametrize("name", CASES)
def test_changes_of_section_states_are_their_derivatives(name: str, most: int) -> None:
    # With few nodes as of orbits of very many events, whose states are no unknowns.
    orbit = orbit_of(CASES[name])
    problem, x = orbit._problem, orbit.unknowns
    nodes = tuple(range(len(problem.itinerary) if most > 1 else 1))
    fine = problem.remade(nodes=nodes)
    before = problem.at(x, NONE).before[list(nodes), : problem.dimension]
    n, k, _ = fine.layout
    y = np.concatenate([x[: n + k], before.ravel()])

    def states(y: Array) -> Array:
        s = fine.at(y, NONE)
        if not s.hits:
            return np.concatenate([y[:n], s.section_states.ravel()])
        return np.concatenate([y[: n + k], s.after[s.hits, : problem.dimension].ravel()])

    s = fine.at(y, NONE)
    wanted, _ = numerical_derivative(states, y)
    assert abs(errors._sections(s, fine, s.hits) - wanted).max() < 1e-8 * abs(wanted).max()


@pytest.mark.parametrize("length", [2.0**-20, 2.0**30], ids=["2^-20", "2^30"])
def test_orbits_that_begin_at_a_halt_do_not_depend_on_the_unit_of_length(length: float) -> None:
    # Lengths and forces are multiplied by a power of two, which rounds nothing. A halt after a
    # slip is a divided difference: its row was beside other units in one exponential.
    def found(unit: float) -> Any:
        ring = HardStop(0, offset=0.1611 * unit, side="below", restitution=0.2614)
        rough = DryFriction(0, force=0.2076 * unit, static=0.233 * unit)
        machine = MatrixOscillator(
            M=[[1.5243]],
            C=[[0.1211]],
            K=[[1.6774]],
            frequency=0.8821,
            harmonic_forces=[-0.4369 * unit],
            constant_forces=[0.1522 * unit],
            elements=[ring, rough],
        )
        start = machine.state([-0.9 * unit], phase=np.pi / 2)
        return machine.attractor(transient=300, start=start).periodic_orbit()

    orbit, other = found(1.0), found(length)
    assert other.label == orbit.label
    states = other.states / np.array([length, 1.0])
    # phases are as certain as they were, impulses with their unit
    assert abs(states - orbit.states).max() <= 2.0 * orbit.error
