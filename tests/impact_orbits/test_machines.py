"""Machines at another frequency: what they share is what a new one computes."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from dynkit.core.differences import STEP
from dynkit.systems import DryFriction, HardStop, ImpactChain, Jenkins, SoftStop
from dynkit.systems.impact.orbits.itineraries.itinerary import regimes_of
from dynkit.systems.impact.orbits.machine import Machine, Numbers, numbers_of

SYSTEM = ImpactChain(
    masses=3,
    damping=0.05,
    frequency=0.3,
    elements=[
        HardStop(2, amplitude=0.1, restitution=0.3, name="table"),
        SoftStop(0, offset=-0.05, amplitude=0.2, stiffness=2.0, damping=0.3, name="soft"),
        DryFriction(1, force=0.02, velocity=0.1),
        Jenkins(2, stiffness=1.5, force=0.03),
    ],
)


def told(machine: Machine, system: Any) -> list[Any]:
    """All that a machine says of its modes."""
    regimes = [range(len(element.regimes)) for element in system._elements]
    numbers = sorted({system._parts.settled(list(own)) for own in product(*regimes)})
    found: list[Any] = [machine.frequency]
    for mode in [regimes_of(system, own) for own in numbers]:
        found += [machine.flow(mode), machine.caught(machine.free, mode)]
        found += [machine.kick(mode, 0)] if 0 not in mode.held else []
        found += [machine.force(mode, k) for k in mode.held]
        found += [machine.watched(mode, *watch) for watch in mode.watched]
    places = range(len(system._elements))
    return [*found, *(of(k) for k in places for of in (machine.gap, machine.rate, machine.put_on))]


@pytest.mark.parametrize("name", ["frequency", "soft.stiffness", "soft.damping", "table.offset"])
def test_a_machine_at_another_value_is_a_new_one(name: str) -> None:
    known = Machine(SYSTEM)
    told(known, SYSTEM)
    other = SYSTEM.replace(**{name: 1.1 * SYSTEM.value_of(name) + 0.01})
    expected = told(Machine(other), other)
    for own, exact in zip(told(known.like(other), other), expected, strict=True):
        assert np.array_equal(own, exact)


@pytest.mark.parametrize("name", ["frequency", "soft.damping"])
def test_changes_of_a_machine_are_those_of_a_new_one(name: str) -> None:
    known = Machine(SYSTEM)
    told(known, SYSTEM)
    value = SYSTEM.value_of(name)
    ends = [numbers_of(SYSTEM.replace(**{name: value + step})) for step in (0.125, 0.0)]
    whole = (ends[0] - ends[1]) / 0.125
    parts = Numbers.split(SYSTEM, whole)
    assert parts.clock_alone == (name == "frequency")
    expected = told(Machine(SYSTEM, whole), SYSTEM)
    for own, exact in zip(
        told(known.changed(SYSTEM, (whole, parts)), SYSTEM), expected, strict=True
    ):
        assert np.real(own) == pytest.approx(np.real(exact), rel=1e-14, abs=1e-16)
        assert np.imag(own) / STEP == pytest.approx(np.imag(exact) / STEP, rel=1e-13, abs=1e-14)
