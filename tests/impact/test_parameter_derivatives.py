"""Derivatives of the impact map by parameters, exact ones against differences of maps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from dynkit.core.differences import parameter_difference
from dynkit.core.no_motion import NoDerivative, replaced
from dynkit.dynamics.map import Map
from dynkit.exponential.propagators import Propagators
from dynkit.systems import (
    BouncingBall,
    DryFriction,
    HardStop,
    ImpactChain,
    Jenkins,
    PlayOscillator,
    SoftStop,
)
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.structure.lagrangian import LagrangianStructure
from tests.impact.disguised import disguised
from tests.impact.own_laws import Hardening

BALL = BouncingBall(amplitude=1.3, frequency=1.0, restitution=0.5)
STRUCTURE = MatrixOscillator(
    M=[[1.0, 0.2], [0.2, 1.5]],
    C=[[0.1, 0.0], [0.0, 0.05]],
    K=[[2.0, -1.0], [-1.0, 1.0]],
    frequency=0.9,
    amplitude=0.1,
    offset=-0.05,
    side="below",
    constant_forces=(0.1, 0.2),
)
SYSTEMS = {
    "ball": (BALL, ("amplitude", "frequency", "restitution")),
    "chain": (
        ImpactChain(masses=3, frequency=0.87),
        ("amplitude", "frequency", "restitution", "offset"),
    ),
    "matrices": (STRUCTURE, ("amplitude", "frequency", "restitution", "offset")),
    "driven": (
        STRUCTURE.replace(harmonic_forces=(0.1, 0.2j), amplitude=0.0),
        ("amplitude", "restitution", "offset"),
    ),
    "play": (
        PlayOscillator(amplitude=0.5, frequency=1.0, restitution=0.6),
        ("amplitude", "frequency", "restitution"),
    ),
    "two stops": (STRUCTURE.replace(play=0.3), ("play", "offset", "amplitude")),
}
SHAKEN = ImpactChain(
    masses=2,
    frequency=0.9,
    harmonic_forces=[0.4, 0.8j],
    elements=[
        HardStop(1, offset=-0.3, amplitude=0.1, restitution=Hardening(0.5, 1.0), name="table"),
        SoftStop(0, offset=-0.1, stiffness=20.0, damping=0.2, amplitude=0.1, name="pad"),
        DryFriction((0, 1), force=0.05, static=0.06, velocity=0.1, amplitude=0.05, name="rub"),
        Jenkins(0, stiffness=2.0, force=0.1, amplitude=0.05, phase=0.3, side="below", name="joint"),
    ],
)
STROBED = SHAKEN.replace(elements=SHAKEN.elements[1:])
MODES = {
    "elements": (
        SHAKEN,
        (
            "frequency",
            "springs",
            "damping",
            "table.restitution.scale",
            "table.phase",
            "pad.damping",
            "rub.velocity",
            "joint.amplitude",
        ),
    ),
    "elements without a stop": (STROBED, ("frequency", "pad.offset", "rub.force", "joint.phase")),
    "contact": (
        ImpactChain(masses=2, frequency=0.8, restitution=0.0),
        ("frequency", "offset", "damping", "springs"),
    ),
}
CASES = [
    (kind, name, k) for kind, (_, names) in SYSTEMS.items() for name in names for k in (0, 3, 4)
]
CASES += [(kind, name, 3) for kind, (_, names) in MODES.items() for name in names]


def state_of(system: ImpactOscillator, skipped: int) -> np.ndarray:
    record = system.simulate(impacts=skipped + 1, start=system.state())
    return np.asarray(record.states[skipped])


@pytest.mark.parametrize(("kind", "name", "skipped"), CASES)
def test_derivatives_are_those_of_differences(kind: str, name: str, skipped: int) -> None:
    system = (SYSTEMS | MODES)[kind][0]
    state = state_of(system, skipped)
    value = system.value_of(name)

    def moved(value: float) -> np.ndarray:
        return replaced(system, **{name: value})(state)

    if kind in SYSTEMS:
        differences = parameter_difference(moved, value, difference=system.difference)
    else:  # of sixth order: each value makes a machine
        h = 1e-3 * max(abs(value), 1.0)
        ends = [system.difference(moved(value + k * h), moved(value - k * h)) for k in (1, 2, 3)]
        differences = np.array([45.0, -9.0, 1.0]) @ ends / (60.0 * h)
    with patch.object(Map, "parameter_derivative", side_effect=AssertionError):
        exact = system.parameter_derivative(state, name)
    assert exact == pytest.approx(differences, rel=1e-8, abs=1e-8 * abs(differences).max())


@pytest.mark.parametrize("name", ["amplitude", "frequency", "restitution"])
def test_no_structure_and_no_propagators_are_made_for_a_derivative(name: str) -> None:
    state = state_of(BALL, 0)
    BALL.parameter_derivative(state, name)
    with (
        patch.object(LagrangianStructure, "_derive", side_effect=AssertionError),
        patch.object(Propagators, "of", side_effect=AssertionError),
    ):
        assert np.isfinite(BALL.parameter_derivative(state, name)).all()


@pytest.mark.parametrize(
    ("name", "value"), [("amplitude", 0.0), ("restitution", 0.0), ("restitution", 1.0)]
)
def test_derivatives_at_the_end_of_a_range_are_one_sided_limits(name: str, value: float) -> None:
    system = ImpactChain(masses=2, frequency=0.87).replace(**{name: value})
    state = np.array([0.3, -0.2, 0.4, 1.0])
    inside = system.replace(**{name: 1e-7 if value == 0.0 else value - 1e-7})
    near = inside.parameter_derivative(state, name)
    assert system.parameter_derivative(state, name) == pytest.approx(near, rel=1e-5, abs=1e-5)


@dataclass(frozen=True, kw_only=True)
class Built(ImpactChain):
    """A chain with a mass and a spring that depend on the diameter of a rod."""

    diameter: float = 1.1
    thickness: float = 1.0
    density: float = 1.0
    stiffness_of_rod: float = 0.4

    def kinetic(self, v: Any) -> Any:
        own = self.density * (self.diameter / self.thickness) ** 3
        return super().kinetic(v) + own * v[0] ** 2 / 2

    def potential(self, x: Any) -> Any:
        own = self.stiffness_of_rod / (1.0 + self.diameter / self.thickness)
        return super().potential(x) + own * x[0] ** 2 / 2


UNITS = {  # of mass, stiffness, length and diameter
    "grams and seconds": (1e-3, 1.0, 1.0, 1.0),
    "diameters in metres": (1.0, 1.0, 1.0, 1e-9),
    "microseconds": (1e-6, 1e6, 1.0, 1.0),
    "small machines": (1e-15, 1e3, 1e-9, 1e-9),
    "long machines": (1.0, 1.0, 1e9, 1e6),
}


def built(mass: float, stiffness: float, length: float, diameter: float) -> ImpactChain:
    rate = np.sqrt(stiffness / mass)
    return Built(
        masses=(mass,) * 3,
        springs=stiffness,
        damping=(0.1 * mass * rate,) * 3,
        frequency=0.87 * rate,
        diameter=1.1 * diameter,
        thickness=diameter,
        density=mass,
        stiffness_of_rod=0.4 * stiffness,
        chatter_tolerance=0.0,
        elements=[
            HardStop(
                2,
                amplitude=0.1 * length,
                restitution=Hardening(0.5, length * rate),
                name="table",
            ),
            SoftStop(0, offset=0.02 * length, stiffness=9.0 * stiffness, name="pad"),
        ],
    )


@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize(
    "name", ["diameter", "table.amplitude", "frequency", "table.restitution.scale"]
)
def test_derivatives_do_not_depend_on_units(units: str, name: str) -> None:
    mass, stiffness, length, diameter = UNITS[units]
    rate = np.sqrt(stiffness / mass)
    size = {"diameter": diameter, "table.amplitude": length, "frequency": rate}
    state = np.array([0.3, -0.2, 0.1, 0.4, 0.2, 1.0])
    sizes = np.array([*[length] * 2, *[length * rate] * 3, 1.0])
    expected = built(1.0, 1.0, 1.0, 1.0).parameter_derivative(state, name)
    found = built(*UNITS[units]).parameter_derivative(state * sizes, name)
    found *= size.get(name, length * rate) / sizes
    assert found == pytest.approx(expected, rel=1e-10, abs=1e-11 * abs(expected).max())


def test_parameters_that_energies_refuse_nearby_have_derivatives() -> None:
    # a step of 1e-5 from 1e-9 makes masses that are negative
    system, state = built(1.0, 1.0, 1.0, 1e-9), np.array([0.3, -0.2, 0.1, 0.4, 0.2, 1.0])
    ends = [system.replace(diameter=1.1e-9 + k)(state) for k in (2e-13, 1e-13, -1e-13, -2e-13)]
    differences = np.array([-1.0, 8.0, -8.0, 1.0]) @ ends / 1.2e-12
    assert system.parameter_derivative(state, "diameter") == pytest.approx(differences, rel=1e-7)


@pytest.mark.parametrize("unit", [1e-6, 1e-9, 1e-12])
def test_derivatives_where_a_parameter_is_zero_do_not_depend_on_its_unit(unit: float) -> None:
    state = np.array([0.3, -0.2, 0.1, 0.4, 0.2, 1.0])
    expected, found = (
        size
        * built(1.0, 1.0, 1.0, size).replace(diameter=0.0).parameter_derivative(state, "diameter")
        for size in (1.0, unit)
    )
    assert found == pytest.approx(expected, rel=1e-8, abs=1e-9 * abs(expected).max())


def test_there_is_none_where_friction_at_a_closed_stop_would_slip_either_way() -> None:
    machine = ImpactChain(
        masses=1,
        frequency=0.5,
        harmonic_forces=[-0.6],
        elements=[
            HardStop(0, offset=-0.1, restitution=0.0, name="stop"),
            DryFriction(0, force=0.1, name="rub"),
        ],
    )
    state = machine.attractor(transient=50, impacts=1).states[-1]
    assert machine.simulate(impacts=1, start=machine.impact_state(state)).events.kind[0] == 1

    def after(value: float) -> Any:
        return machine.replace(**{"rub.velocity": value})(state)

    step = 1e-5
    slopes = (after(step) - machine(state)) / step, (machine(state) - after(-step)) / step
    assert abs(slopes[0] - slopes[1]).max() > 0.01
    with pytest.raises(NoDerivative, match="friction that rests at a closed stop would slip"):
        machine.parameter_derivative(state, "rub.velocity")
    found = machine.parameter_derivative(state, "rub.force")
    assert found == pytest.approx(
        (machine.replace(**{"rub.force": 0.1 + step})(state) - machine(state)) / step, abs=1e-3
    )


JOINT = MatrixOscillator(
    M=[[1.0]],
    C=[[0.1]],
    K=[[1.0]],
    frequency=1.0,
    harmonic_forces=[0.5],
    elements=[Jenkins(0, stiffness=2.0, force=0.5, name="joint")],
)


@pytest.mark.parametrize("machine", [JOINT, disguised(JOINT)], ids=["exact", "Taylor"])
@pytest.mark.parametrize("parameter", ["joint.stiffness", "joint.force"])
def test_there_is_none_where_a_slider_leaves_the_limit_of_its_spring(
    machine: Any, parameter: str
) -> None:
    state, value, step = np.array([0.3, -1.0, 0.05]), machine.value_of(parameter), 1e-6

    def moved(change: float) -> Any:
        return machine.replace(**{parameter: value + change})(state)

    slopes = (moved(step) - moved(0.0)) / step, (moved(0.0) - moved(-step)) / step
    assert abs(slopes[0] - slopes[1]).max() > 0.01
    with pytest.raises(NoDerivative):
        machine.parameter_derivative(state, parameter)


@pytest.mark.parametrize("parameter", ["joint.stiffness", "joint.force"])
def test_there_is_one_where_a_slider_slides_on(parameter: str) -> None:
    state = np.array([0.3, 1.0, 0.05])
    found = JOINT.parameter_derivative(state, parameter)
    assert found == pytest.approx(Map.parameter_derivative(JOINT, state, parameter), rel=1e-7)
