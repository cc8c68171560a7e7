"""Orbits P(1,m): against closed forms to 40 and to 180 digits, and exact multipliers."""

from __future__ import annotations

import math
from functools import cache
from itertools import islice
from typing import Any

import numpy as np
import pytest

from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.finding import Found
from dynkit.systems.impact.orbits.itineraries.guesses import random_guesses
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.oscillators.play import PlayOscillator
from dynkit.systems.impact.oscillators.single import SingleImpactOscillator
from tests.effort import is_thorough
from tests.impact.one_mass import Orbit, periodic_orbits
from tests.impact_orbits.exact_orbits import (
    ExactOrbit,
    OneImpact,
    distance,
    exact_orbit,
    one_impact_orbits,
)
from tests.impact_orbits.structures import ALL, SYSTEMS, UNHELD

ASKED = 1e-9
"""Largest error of states and multipliers that is asked for."""


# --- one mass -------------------------------------------------------------------------------------


def one_mass(seed: int) -> ImpactOscillator:
    """Any restitution but 0, where the closed form divides by it; damping from none to twice the
    critical one and more; both sides, table and forces."""
    random = np.random.default_rng(seed)
    choose: Any = random.choice
    damping = float(choose([0.0, 10.0 ** random.uniform(-3.0, 0.0), random.uniform(1.0, 5.0), 2.0]))
    forced = bool(choose([False, True]))
    return MatrixOscillator(
        M=[[1.0]],
        C=[[damping]],
        K=[[float(choose([1.0, 0.3, 4.0]))]],
        frequency=10.0 ** random.uniform(-1.0, 1.0),
        restitution=float(choose([1.0, random.uniform(0.01, 1.0), 1e-3])),
        amplitude=0.1 if not forced else float(choose([0.0, 0.5])),
        offset=float(choose([0.0, random.uniform(-0.1, 0.1), random.uniform(-0.3, 0.3)])),
        side=str(choose(["above", "below"])),
        harmonic_forces=(complex(*random.normal(size=2)) if forced else 0j,),
    )


def matching(wanted: list[Orbit], found: list[ImpactOrbit]) -> list[tuple[Orbit, ImpactOrbit]]:
    """Each orbit with the one of the same impulse."""
    assert len(found) == len(wanted)
    ordered = sorted(found, key=lambda orbit: float(orbit.impulses[0]))
    return list(zip(sorted(wanted, key=lambda orbit: float(orbit.u)), ordered, strict=True))


ONE_MASS = range(60)


@pytest.mark.parametrize("seed", ONE_MASS)
def test_one_mass_has_the_orbits_of_the_closed_form(seed: int) -> None:
    system = one_mass(seed)
    for periods in (1, 2, 3):
        pairs = matching(periodic_orbits(system, periods), system.periodic_orbits(periods=periods))
        for exact, orbit in pairs:
            off = abs(system.difference(orbit.states[0], exact.state)).max()
            assert off <= orbit.error
            assert orbit.error <= ASKED
            assert distance(orbit.multipliers, exact.multipliers) <= ASKED


def test_the_one_mass_cases_hold_orbits_of_every_kind() -> None:
    found = [o for seed in ONE_MASS for o in one_mass(seed).periodic_orbits(periods=2)]
    assert len(found) > 40
    assert {(o.stable, o.admissible) for o in found} == {
        (stable, admissible) for stable in (True, False) for admissible in (True, False)
    }


def test_an_offset_gives_two_orbits_between_the_folds() -> None:
    counts = {len(one_mass(seed).periodic_orbits(periods=2)) for seed in ONE_MASS}
    assert counts == {0, 1, 2}


def play(seed: int) -> PlayOscillator:
    random = np.random.default_rng(seed)
    return PlayOscillator(
        play=random.uniform(0.2, 1.5),
        spring=float(random.choice([0.5, 1.0])),
        damping=float(random.choice([0.1, 0.5, 3.0])),
        force=float(random.choice([0.0, 1.0])),
        amplitude=random.uniform(0.1, 0.5),
        frequency=10.0 ** random.uniform(-0.5, 0.5),
        restitution=random.uniform(0.1, 1.0),
    )


@pytest.mark.parametrize("seed", range(20))
def test_symmetric_orbits_in_a_play_are_those_of_the_closed_form(seed: int) -> None:
    system = play(seed)
    for periods in (1, 3):
        for exact in periodic_orbits(system, periods):
            start = float(exact.state[1])
            orbit = system.periodic_orbit(
                periods=periods, phases=(start, start + math.pi * periods), sides=(0, 1)
            )
            off = abs(system.difference(orbit.states[0], exact.state)).max()
            other = abs(orbit.states[1, 0] + exact.state[0])
            assert max(off, other) <= orbit.error
            assert orbit.error <= ASKED
            # The closed form is that of half the orbit.
            assert distance(orbit.multipliers, exact.multipliers**2) <= ASKED


# --- any structure --------------------------------------------------------------------------------

PERIODS = (1, 2, 3)


@cache
def found(name: str) -> list[tuple[ImpactOrbit, ExactOrbit]]:
    orbits = [o for m in PERIODS for o in ALL[name].periodic_orbits(periods=m)]
    return [(orbit, exact_orbit(orbit)) for orbit in orbits]


def same(orbit: ImpactOrbit, exact: OneImpact) -> bool:
    off: Array = orbit.system.difference(orbit.states[0], exact.state)
    return bool(abs(off).max() <= orbit.error and orbit.problem().sides[0] == exact.side)


@pytest.mark.parametrize("name", SYSTEMS)
def test_orbits_are_those_of_the_closed_form_of_any_structure(name: str) -> None:
    wanted = [o for m in PERIODS for o in one_impact_orbits(SYSTEMS[name], m)]
    orbits = [orbit for orbit, _ in found(name)]
    assert len(orbits) == len(wanted) > 0
    assert all(any(same(orbit, exact) for orbit in orbits) for exact in wanted)


@pytest.mark.parametrize("name", UNHELD)
@pytest.mark.parametrize("periods", PERIODS)
def test_random_guesses_find_no_other_orbits_of_what_no_spring_holds(
    name: str, periods: int
) -> None:
    others = Found()
    guesses = random_guesses(UNHELD[name], 1, periods)
    for problem, guess in islice(guesses, None if is_thorough() else 60):
        others.add(problem, guess)
    orbits = UNHELD[name].periodic_orbits(periods=periods)
    assert len(others.orbits(0.0)) == len(orbits)
    for other in others.orbits(0.0):
        off = [abs(other.system.difference(other.states, orbit.states)).max() for orbit in orbits]
        assert min(off) <= 2.0 * other.error


@pytest.mark.parametrize("name", ALL)
def test_errors_of_states_stay_below_their_bound(name: str) -> None:
    for orbit, exact in found(name):
        assert exact.error_of(orbit.states) <= orbit.error <= ASKED


@pytest.mark.parametrize("name", ALL)
@pytest.mark.plain
def test_multipliers_are_those_of_the_exact_map(name: str) -> None:
    for orbit, exact in found(name):
        assert distance(orbit.multipliers, exact.multipliers) <= ASKED


@pytest.mark.parametrize("name", ALL)
def test_multipliers_come_with_the_largest_first(name: str) -> None:
    for orbit, _ in found(name):
        assert orbit.multipliers.shape == (orbit.system.dimension,)
        assert (np.diff(abs(orbit.multipliers)) <= 1e-12 * abs(orbit.multipliers[0])).all()


# --- many parameters ------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("damping", [0.0, 0.02, 1.0, 5.0])
@pytest.mark.parametrize("masses", [2, 3, 10])
def test_orbits_of_chains_of_any_damping_and_restitution(
    masses: int, damping: float, restitution: float
) -> None:
    chain = SYSTEMS["chain"].replace(masses=masses, damping=damping, restitution=restitution)
    random = np.random.default_rng(masses)
    for _ in range(3):
        system = chain.replace(
            frequency=10.0 ** random.uniform(-0.7, 0.5), offset=random.uniform(-0.08, 0.02)
        )
        periods = int(random.integers(1, 5))
        orbits = system.periodic_orbits(periods=periods)
        wanted = one_impact_orbits(system, periods)
        assert len(orbits) == len(wanted)
        for orbit in orbits:
            assert any(same(orbit, exact) for exact in wanted)
            assert orbit.error <= ASKED


@pytest.mark.parametrize("frequency", [0.5, 1.0])
def test_at_resonance_without_damping_there_is_no_orbit(frequency: float) -> None:
    # The response to any impulse once in the period of the free motion grows for ever.
    system = MatrixOscillator(M=[[1.0]], C=[[0.0]], K=[[1.0]], frequency=frequency, offset=-0.02)
    assert system.periodic_orbits(periods=1) == []


@pytest.mark.parametrize("distance_to_it", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize(("frequency", "periods"), [(2.0, 2), (0.5, 1)])
def test_near_a_resonance_the_error_stays_below_its_bound(
    frequency: float, periods: int, distance_to_it: float
) -> None:
    system = SingleImpactOscillator(
        frequency=frequency * (1.0 + distance_to_it), damping_ratio=0.0, restitution=0.8
    )
    (orbit,) = system.periodic_orbits(periods=periods)
    assert exact_orbit(orbit).error_of(orbit.states) <= orbit.error
