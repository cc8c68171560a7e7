"""Machines whose elements switch at once: derivatives, orbits and branches.

Two equal masses under equal forces move as one, whatever the spring between them: the motion, its
multipliers and its borders are those of one mass. The other multipliers are of disturbances in
which the masses part.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dynkit import NoConvergence, continue_orbit
from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, ImpactChain, MatrixOscillator, SoftStop


def soft(mass: int) -> SoftStop:
    return SoftStop(mass, offset=-0.1, stiffness=20.0, damping=0.2)


def turning(mass: int) -> DryFriction:
    return DryFriction(mass, force=0.1)


def sticking(mass: int) -> DryFriction:
    return DryFriction(mass, force=0.2, static=0.25)


KINDS: dict[str, tuple[float, list[Callable[[int], Any]]]] = {
    "soft stops": (0.9, [soft]),
    "friction that turns": (0.9, [turning]),
    "friction that sticks": (0.4, [sticking]),
    "soft stops and friction": (0.9, [soft, turning]),
}


def pair(name: str, **parameters: Any) -> MatrixOscillator:
    frequency, kinds = KINDS[name]
    system = MatrixOscillator(
        M=np.eye(2),
        C=0.1 * np.eye(2),
        K=[[2.0, -0.5], [-0.5, 2.0]],
        frequency=frequency,
        harmonic_forces=(0.5, 0.5),
        elements=[kind(mass) for kind in kinds for mass in (0, 1)],
    )
    return system.replace(**parameters)


def single(name: str) -> MatrixOscillator:
    frequency, kinds = KINDS[name]
    return MatrixOscillator(
        M=[[1.0]],
        C=[[0.1]],
        K=[[1.5]],
        frequency=frequency,
        harmonic_forces=(0.5,),
        elements=[kind(0) for kind in kinds],
    )


class Hardening(ImpactChain):
    """Two masses with springs that are not linear, alike."""

    def potential(self, x: Any) -> Any:
        own = sum(0.75 * e**2 + 0.1 * e**4 for e in x)
        return own + 0.25 * (x[1] - x[0]) ** 2

    def dissipation(self, v: Any) -> Any:
        return 0.05 * sum(e**2 for e in v)


def differences(system: Any, state: Array, step: float = 1e-6) -> Array:
    rows = step * np.eye(len(state))
    found = [system.difference(system(state + e), system(state - e)) for e in rows]
    return np.array(found).T / (2.0 * step)


@pytest.mark.parametrize("name", KINDS)
def test_derivatives_through_events_at_once_are_those_of_differences(name: str) -> None:
    system = pair(name)
    state = system.attractor(transient=300, impacts=2).states[-1]
    exact = system.jacobian(state)
    assert abs(exact - differences(system, state)).max() < 1e-7
    found = system._followed(state, 3)[1]
    assert np.array([factor for (factor,), _ in found]) == pytest.approx(np.array([exact] * 3))


@pytest.mark.parametrize("kind", [turning])
def test_so_are_they_with_springs_that_are_not_linear(kind: Callable[[int], Any]) -> None:
    elements = [kind(0), kind(1)]
    system = Hardening(masses=2, frequency=0.9, harmonic_forces=(0.5, 0.5), elements=elements)
    assert system.engine == "Taylor"
    state = system.attractor(transient=100, impacts=2).states[-1]
    exact = system.jacobian(state)
    assert abs(exact - differences(system, state)).max() < 1e-6
    orbit = system.attractor(transient=100, impacts=20).periodic_orbit()
    assert np.poly(orbit.multipliers) == pytest.approx(np.poly(np.linalg.eigvals(exact)), abs=1e-8)


@pytest.mark.parametrize(("name", "parameter"), [("soft stops", "elements[1].damping")])
def test_derivatives_by_parameters_are_those_of_differences(name: str, parameter: str) -> None:
    system = pair(name)
    state = system.attractor(transient=300, impacts=2).states[-1]
    for each in (parameter, "frequency"):
        value, step = system.parameters[each], 1e-6
        ends = [system.replace(**{each: value + way * step})(state) for way in (1.0, -1.0)]
        found = system.parameter_derivative(state, each)
        assert abs(found - (ends[0] - ends[1]) / (2.0 * step)).max() < 1e-6, each


@pytest.mark.parametrize("name", KINDS)
def test_orbits_hold_those_of_one_mass(name: str) -> None:
    one, two = (
        system.attractor(transient=400, impacts=40).periodic_orbit()
        for system in (single(name), pair(name))
    )
    assert two.admissible
    assert two.error < 1e-11
    assert abs(two.states[0][:1] - one.states[0][:1]).max() < 1e-12
    exact = two.system.jacobian(two.states[0])
    polynomial = np.poly(two.multipliers)
    assert polynomial == pytest.approx(np.poly(np.linalg.eigvals(exact)), abs=1e-9)
    rest = np.polydiv(polynomial, np.poly(one.multipliers))[1]
    assert abs(rest).max() < 1e-9


def test_branches_hold_the_borders_of_one_mass() -> None:
    name = "soft stops"
    one, two = (
        continue_orbit(
            system.attractor(transient=400, impacts=40).periodic_orbit(),
            "frequency",
            bounds=(0.87, 0.92),
        )
        for system in (single(name), pair(name))
    )
    (border,) = one.bifurcations
    found = [own.value for own in two.bifurcations]
    assert found
    assert found == pytest.approx([border.value] * len(found), abs=1e-9)
    beyond = two.parameter > border.value
    assert two.admissible[beyond].all()
    assert not two.admissible[~beyond & (two.parameter < border.value - 1e-6)].any()


@pytest.mark.parametrize("mass", [0, 1])
def test_a_parameter_parts_the_events(mass: int) -> None:
    # Each order of the events is a motion on one side; the border leads to the other one.
    parameter, bounds = f"elements[{mass}].offset", (-0.11, -0.09)
    orbit = pair("soft stops").attractor(transient=400, impacts=40).periodic_orbit()
    branch = continue_orbit(orbit, parameter, bounds=bounds)
    border = branch.bifurcations[0]
    assert abs(border.value + 0.1) <= border.error < 1e-10
    assert "at once" in border.touching
    (other,) = border.switch()
    sides = []
    for part in (branch, continue_orbit(other, parameter, bounds=bounds)):
        near = abs(abs(part.parameter + 0.1) - 0.005) < 0.004
        (side,) = {float(v) for v in np.sign(part.parameter + 0.1)[near & part.admissible]}
        assert (part.admissible[near] == (side * (part.parameter[near] + 0.1) > 0.0)).all()
        sides.append(side)
        there = part.orbit(int(np.flatnonzero(near & part.admissible)[-1]))
        again = there.system.attractor(transient=600, impacts=40).periodic_orbit()
        assert np.poly(there.multipliers) == pytest.approx(np.poly(again.multipliers), abs=1e-9)
    assert sorted(sides) == [-1.0, 1.0]


def test_hard_stops_that_are_hit_at_once_are_refused_by_name() -> None:
    tables = [HardStop(mass, offset=-0.1, restitution=0.7) for mass in (0, 1)]
    attractor = pair("soft stops", elements=tables).attractor(transient=400, impacts=40)
    with pytest.raises(NoConvergence, match="events merge"):
        attractor.periodic_orbit()
    # what each impact shrinks is known: 0.7 squared, and the dashpots
    found = attractor.system.stretching(attractor.final, 40)
    assert found.times is not None
    expected = 40 * 2.0 * np.log(0.7) - 0.2 * found.times.sum()
    assert found.logs.sum() == pytest.approx(expected, rel=1e-9)
