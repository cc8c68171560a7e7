"""Motions are the same in any unit of length, and so are the orbits that searches find."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np
import pytest

from dynkit import explore
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactDuffing,
    ImpactOscillator,
    MatrixOscillator,
    SoftStop,
)
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.records.record import ImpactRecord

# of each parameter, the powers of length, time and mass; powers of two with even exponents change
# no last digit
POWERS = {
    "M": (0, 0, 1), "C": (0, -1, 1), "K": (0, -2, 1), "frequency": (0, -1, 0),
    "offset": (1, 0, 0), "amplitude": (1, 0, 0), "harmonic_forces": (1, -2, 1),
    "stiffness": (0, -2, 1), "damping": (0, -1, 1), "preload": (1, -2, 1), "force": (1, -2, 1),
}  # fmt: skip
UNITS = [(2.0**10, 1.0, 1.0), (1.0, 2.0**-10, 1.0), (1.0, 1.0, 2.0**10), (2.0**-8, 2.0**6, 2.0**4)]


def machine(number: int, units: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> ImpactOscillator:
    """A random machine of one or two masses: hard stops, or also soft ones and friction."""
    random = np.random.default_rng([7, number])
    n = int(random.integers(1, 3))
    factor = random.normal(size=(n, n)) / n**0.5
    given: dict[str, Any] = {
        "M": np.diag(random.uniform(0.5, 1.5, n)),
        "C": 0.1 * np.eye(n),
        "K": np.diag(random.uniform(0.3, 2.0, n)) + factor @ factor.T,
        "frequency": random.uniform(0.4, 1.8),
        "harmonic_forces": 0.6 * (random.normal(size=n) + 1j * random.normal(size=n)),
    }
    elements: list[Element] = [HardStop(0, offset=-random.uniform(0.0, 0.3), restitution=0.6)]
    if number % 2:
        stiffness, preload = 10.0 ** random.uniform(-0.3, 1.3), random.choice([0.0, 0.2])
        soft: dict[str, Any] = {"stiffness": stiffness, "damping": 0.3, "preload": preload}
        elements.append(SoftStop(n - 1, side="below", offset=random.uniform(0.0, 0.3), **soft))
        elements.append(DryFriction(0, force=random.uniform(0.02, 0.1)))
    elements = [dataclasses.replace(own, **_scaled(vars(own), units)) for own in elements]
    return MatrixOscillator(**given | _scaled(given, units), elements=elements)


def _scaled(given: dict[str, Any], units: tuple[float, float, float]) -> dict[str, Any]:
    return {
        name: value * float(np.prod(np.power(units, POWERS[name])))
        for name, value in given.items()
        if name in POWERS and value is not None
    }


@pytest.mark.parametrize("number", range(6))
def test_a_search_finds_the_same_orbits_in_all_units(number: int) -> None:
    known = machine(number).find_orbits(impacts=2, periods=2)
    for units in UNITS:
        found = machine(number, units).find_orbits(impacts=2, periods=2)
        assert [orbit.label for orbit in found] == [orbit.label for orbit in known]
        for orbit, other in zip(found, known, strict=True):
            assert orbit.admissible == other.admissible
            # which of the impacts is the first one is rounding
            here, there = (np.sort(np.cos(own.phases)) for own in (orbit, other))
            np.testing.assert_allclose(here, there, atol=1e-8)
            speeds = np.sort(orbit.impulses) * (units[1] / units[0])
            np.testing.assert_allclose(speeds, np.sort(other.impulses), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("number", [0, 3])
def test_an_exploration_finds_the_same_branches_in_all_units(number: int) -> None:
    def branches(units: tuple[float, float, float]) -> list[tuple[Any, ...]]:
        system, time = machine(number, units), units[1]
        bounds = 0.97 * system.frequency, 1.03 * system.frequency
        network = explore(
            system, "frequency", bounds, values=2, iterates=2, periods=2, branches=4, points=200
        )
        return [
            (branch.label, [(found.kind, round(found.value * time, 9)) for found in ends])
            for branch in network.branches
            for ends in [branch.bifurcations]
        ]

    known = branches((1.0, 1.0, 1.0))
    assert all(branches(units) == known for units in UNITS)


@pytest.mark.parametrize("units", [(2.0**30, 1.0, 1.0), (2.0**-30, 1.0, 1.0), (1.0, 1.0, 2.0**20)])
def test_the_orbit_without_a_start_is_the_same_in_all_units(
    units: tuple[float, float, float],
) -> None:
    """A start of length one is far too near, or too far, in other units."""

    def on_a_belt(length: float, time: float, mass: float) -> ImpactOscillator:
        force = mass * length / time**2
        friction = DryFriction(
            0, force=0.3 * force, static=0.5 * force, velocity=0.3 * length / time
        )
        return MatrixOscillator(
            M=[[mass]],
            C=[[0.05 * mass / time]],
            K=[[mass / time**2]],
            frequency=1.0 / time,
            elements=[friction],
        )

    known, found = (on_a_belt(*own).periodic_orbit() for own in ((1.0, 1.0, 1.0), units))
    assert found.label == known.label
    np.testing.assert_allclose(found.multipliers, known.multipliers, atol=1e-10)


def bent(length: float) -> ImpactDuffing:
    """A Duffing oscillator between a hard and a soft stop, with friction."""
    return ImpactDuffing(
        linear=1.0,
        cubic=0.5 / length**2,
        damping=0.2,
        force=0.6 * length,
        frequency=1.2,
        elements=[
            HardStop(0, offset=-0.3 * length, restitution=0.7),
            SoftStop(0, side="below", offset=0.3 * length, stiffness=5.0, damping=0.1),
            DryFriction(0, force=0.05 * length),
        ],
    )


@cache
def moved(length: float) -> tuple[ImpactRecord, ImpactOrbit]:
    """Twenty impacts of `bent`, and the orbit to which they lead."""
    machine = bent(length)
    record = machine.simulate(impacts=20, start=machine.state([0.1 * length], [0.0]))
    orbit = machine.attractor(start=record.final, transient=50, impacts=20).periodic_orbit()
    assert isinstance(orbit, ImpactOrbit)
    return record, orbit


@pytest.mark.parametrize("length", [2.0**-60, 2.0**-40, 2.0**-20, 2.0**20])
def test_springs_that_are_not_linear_have_the_same_motions_in_all_units(length: float) -> None:
    """Taylor's method has an absolute tolerance for what is small."""
    (known, orbit), (found, other) = moved(1.0), moved(length)
    times = np.linspace(0.1, known.time[-1] - 0.1, 400)
    for here, there in zip(found.sample(times), known.sample(times), strict=True):
        np.testing.assert_allclose(here / length, there, atol=1e-12)
    np.testing.assert_allclose(
        found.relative_velocity / length, known.relative_velocity, rtol=1e-13
    )
    np.testing.assert_allclose(other.multipliers, orbit.multipliers, atol=1e-12)
