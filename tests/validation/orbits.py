"""Periodic orbits of random oscillators against closed forms and 50 digits."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.harmonics import harmonics_of
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from tests.impact_orbits.exact_orbits import exact_orbit, one_impact_orbits
from tests.reference.random_cases import STARTS, Kept, random_case
from tests.reference.random_sticking import FILE, random_sticking, sticking_orbit

SYSTEMS, SEVERAL = 1500, 300

_TURN = Fraction("6.283185307179586476925286766559005768394")


def states_of_orbits(every: int) -> Iterator[tuple[float, float]]:
    """Largest error of a section coordinate of P(1,m), m = 1 to 3, from their closed form."""
    for orbit in orbits_of_one_impact(every):
        exact = one_impact_orbits(orbit.system, orbit.periods)
        off = [abs(orbit.system.difference(orbit.states[0], e.state)).max() for e in exact]
        # The closed form is rounded to doubles.
        yield float(min(off)), orbit.error + 2.0**-53 * float(abs(orbit.states).max())


def orbits_of_one_impact(every: int) -> Iterator[ImpactOrbit]:
    for number in range(0, SYSTEMS, every):
        system = random_case(STARTS * number).system()
        if system.natural_frequencies[0] == 0.0:  # not held: these have no such form
            continue
        for periods in (1, 2, 3):
            try:
                yield from system.periodic_orbits(periods=periods)
            except ValueError:  # not driven
                break


def states_of_longer_orbits(every: int) -> Iterator[tuple[float, float]]:
    """The same of P(2,m) and P(3,m), by Newton's method on the impact map in 180 digits."""
    for number in range(0, SEVERAL, every):
        system = random_case(STARTS * (30_000 + number)).system()
        if system.degrees_of_freedom > 4:
            continue
        try:
            orbits = system.periodic_orbits(impacts=2 + number % 2, periods=1 + number % 3)
        except ValueError:
            continue
        for orbit in orbits:
            try:
                exact = exact_orbit(orbit)
            except ArithmeticError:  # a step left the neighbourhood
                continue
            yield exact.error_of(orbit.states), orbit.error


def coefficients_of_harmonics(every: int) -> Iterator[tuple[float, float]]:
    """Largest error of a Fourier coefficient of P(1,m), whose impulses make a closed form."""
    for orbit in orbits_of_one_impact(every):
        system, period = orbit.system, orbit.period
        c = system.contact % system.degrees_of_freedom
        times = np.linspace(0.0, period, 513)
        found = harmonics_of(orbit.sample(times)[0][:, c], 2.0 * np.pi / period)
        exact = _coefficients(orbit, c, len(found.coefficients))
        yield float(abs(found.coefficients - exact).max()), found.error + orbit.error


def _coefficients(orbit: ImpactOrbit, c: int, count: int) -> Array:
    """c_k of the contact coordinate: an impulse each period at time 0, and the forces."""
    system = orbit.system
    w = 2.0 * np.pi / orbit.period * np.arange(1.0, count + 1.0)[:, None, None]
    mass, drag, spring = system.mass, system.damping_matrix, system.stiffness
    far = bool(np.signbit(orbit.states[0, -2]))  # of minus zero, too, where nothing rebounds
    impulse = float(orbit.impulses[0]) * (-1.0 if far == (system.side == "above") else 1.0)
    force = np.zeros((count, len(mass)), dtype=complex)
    force[:, c] = impulse / np.linalg.inv(mass)[c, c] / orbit.period
    if len(system.harmonic_forces):
        turn = np.exp(1j * orbit.phases[0])
        force[orbit.periods - 1] -= 0.5j * np.asarray(system.harmonic_forces) * turn
    dynamic = spring - w**2 * mass + 1j * w * drag
    return np.asarray(np.linalg.solve(dynamic, force[..., None])[:, c, 0])


def states_of_sticking_orbits(every: int) -> Iterator[tuple[float, float]]:
    """Largest error of a place, or of a phase but for whole turns, at a release."""
    for orbit, exact, _ in sticking_orbits(every):
        found = np.concatenate([orbit.states[:, :-2], orbit.phases[:, None]], axis=1)
        high, low = exact
        off = abs(found - high - low)
        for k, parts in enumerate(zip(found[:, -1], high[:, -1], low[:, -1], strict=True)):
            phase, *own = map(Fraction, map(float, parts))
            gap = phase - sum(own)
            off[k, -1] = abs(gap - round(gap / _TURN) * _TURN)
        yield float(off.max()), orbit.error


def sticking_orbits(every: int) -> Iterator[tuple[ImpactOrbit, Array, Any]]:
    """Orbits, their exact releases, two parts (2, k, 2N - 1), and multipliers (2N - 2,)."""
    kept = Kept.load(FILE)
    for row in range(0, len(kept.number), every):
        orbit = sticking_orbit(int(kept.number[row]))
        assert orbit is not None, random_sticking(int(kept.number[row]))
        parts = np.array(kept.numbers(row))
        count, width = len(orbit.phases), 2 * orbit.system.degrees_of_freedom - 1
        releases, rest = np.split(parts, [count * width], axis=1)
        pairs = rest.sum(axis=0).reshape(-1, 2)
        yield orbit, releases.reshape(2, count, width), pairs[:, 0] + 1j * pairs[:, 1]
