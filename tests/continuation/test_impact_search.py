"""Searches for orbits of impact oscillators, against brute force and far longer motions.

`CASES=20 python -m pytest tests/continuation/test_impact_search.py` takes twenty times as many
random oscillators.
"""

from __future__ import annotations

import os
from functools import cache

import numpy as np
import pytest

from dynkit import NoConvergence, NoMotion, explore, periodic_orbit
from dynkit.core.validation import Array
from dynkit.orbits.search import OrbitSearch
from dynkit.systems import ImpactChain
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from tests.reference.one_mass_orbits import Mass, brute_force, near

MORE = int(os.environ.get("CASES", "1"))
PERIODS = 3

CHAOTIC = ImpactChain(masses=1, restitution=0.8, frequency=2.8)
"""Of one mass; its four orbits up to P(3,3) are all unstable."""


@cache
def chaotic() -> OrbitSearch[ImpactOrbit]:
    return CHAOTIC.find_orbits(impacts=3, periods=PERIODS)


def random_mass(seed: int) -> ImpactChain:
    random = np.random.default_rng(seed)
    return ImpactChain(
        masses=1,
        damping=float(random.uniform(0.02, 0.2)),
        restitution=float(random.uniform(0.6, 0.95)),
        frequency=float(random.uniform(1.0, 5.5)),
    )


@cache
def by_brute_force(chain: ImpactChain) -> dict[tuple[int, int], list[Array]]:
    motion = chain.attractor(transient=1000, impacts=300)
    fastest = 2.0 * float(motion.states[:, 0].max())
    return brute_force(Mass.of(chain), 3, PERIODS, fastest, (12, 12))


def missed(
    orbits: list[ImpactOrbit], known: dict[tuple[int, int], list[Array]]
) -> list[tuple[int, int]]:
    """Which P(n,m) of the known orbits are not among those that were found."""
    return [
        (n, m)
        for (n, m), many in known.items()
        for states in many
        if not any(
            orbit.label == f"P({n},{m})" and any(near(states[0], x) for x in orbit.states)
            for orbit in orbits
        )
    ]


def admissible(search: OrbitSearch[ImpactOrbit]) -> list[ImpactOrbit]:
    return [orbit for orbit in search if orbit.admissible]


@pytest.mark.parametrize("seed", range(MORE))
def test_no_orbit_of_one_mass_is_missed_that_brute_force_finds(seed: int) -> None:
    chain = random_mass(seed)
    known = by_brute_force(chain)
    assert missed(admissible(chain.find_orbits(impacts=3, periods=PERIODS)), known) == []


def test_no_orbit_in_chaos_of_one_mass_is_missed_that_brute_force_finds() -> None:
    known = by_brute_force(CHAOTIC)
    assert {place: len(orbits) for place, orbits in known.items()} == {
        (1, 1): 1,
        (2, 2): 1,
        (3, 3): 2,
    }
    assert missed(admissible(chaotic()), known) == []
    assert len(admissible(chaotic())) == 4


def test_orbits_of_one_mass_satisfy_the_reference_map() -> None:
    mass = Mass.of(CHAOTIC)
    for orbit in admissible(chaotic()):
        path, slope, _ = mass.iterated(orbit.states[:1], orbit.impacts, PERIODS)
        assert near(path[0, -1], orbit.states[0])
        exact = np.sort(abs(np.linalg.eigvals(slope[0])))
        assert np.sort(abs(orbit.multipliers)) == pytest.approx(exact, rel=1e-6)


def test_an_exploration_reaches_every_orbit_that_brute_force_finds() -> None:
    network = explore(
        CHAOTIC, "frequency", (2.7995, 2.8005), iterates=3, periods=PERIODS, values=1, branches=30
    )
    orbits = [orbit for orbit in network.orbits(2.8) if isinstance(orbit, ImpactOrbit)]
    known = by_brute_force(CHAOTIC)
    assert missed([orbit for orbit in orbits if orbit.admissible], known) == []
    assert network.message.endswith(
        "; searched: P(1,1) to P(3,3) at frequency 2.8: P(1,m) from their closed form, "
        "P(2,m) and P(3,m) from 1200 random guesses, P(2,m) and more from near returns among "
        "9000 impacts simulated from 21 starts"
    )


@pytest.mark.parametrize(("masses", "frequency"), [(2, 2.8), (3, 3.1)])
def test_orbits_embedded_in_the_chaos_of_chains_are_found(masses: int, frequency: float) -> None:
    chain = ImpactChain(masses=masses, restitution=0.8, frequency=frequency)
    search = chain.find_orbits(impacts=3, periods=5)
    ten_times = 10 * search.cost.counts["impacts"]
    states = chain.attractor(transient=2000, impacts=ten_times).states
    embedded = 0
    for n in (1, 2, 3):
        gaps = abs(chain.difference(states[n:], states[:-n])) / abs(states).max(axis=0)
        distance = gaps.max(axis=1)
        for part in np.array_split(np.arange(len(distance)), 10):
            place = part[np.argmin(distance[part])]
            try:
                orbit = periodic_orbit(chain, states[place : place + n])
            except (NoConvergence, NoMotion):
                continue
            if abs(chain.difference(orbit.states[0], states[place])).max() > 0.1:
                continue  # Newton's method went elsewhere
            last = chain.simulate(impacts=n, start=chain.impact_state(orbit.states[0])).time[-1]
            if round(last * chain.frequency / (2.0 * np.pi)) > 5 * n // orbit.period:
                continue  # of more periods than were asked for
            embedded += 1
            assert any(
                other.impacts == orbit.period
                and abs(chain.difference(other.states, orbit.states[0])).max(axis=1).min() < 1e-6
                for other in search
            )
    assert embedded >= 10


def test_a_search_says_what_it_looked_at_and_resolves_nothing() -> None:
    search = chaotic()
    assert search.resolved == 0
    assert search.message.startswith("P(1,1) to P(3,3): P(1,m) from their closed form, ")
    assert "all" not in search.message.split()
    counts = search.cost.counts
    assert (counts["guesses"], counts["starts"], counts["impacts"]) == (1200, 21, 9000)
    assert search.region.shape == (2, 2)
    assert len(search.error) == len(search) == sum(search.counts.values())


def test_the_same_search_of_motions_finds_the_same_bits() -> None:
    chain = CHAOTIC.replace(frequency=3.0)
    once, again = (chain.find_orbits(impacts=2, periods=1) for _ in range(2))
    assert [orbit.unknowns.tobytes() for orbit in once] == [o.unknowns.tobytes() for o in again]


def test_orbits_of_more_impacts_than_are_guessed_are_found_near_motions() -> None:
    chain = CHAOTIC.replace(frequency=0.5)
    assert str(chain.attractor(transient=2000).label) == "P(4,1)"
    search = chain.find_orbits(impacts=4, periods=1)
    assert any(orbit.label == "P(4,1)" and orbit.stable for orbit in admissible(search))


def test_one_impact_needs_no_motion() -> None:
    search = CHAOTIC.find_orbits(impacts=1, periods=2)
    assert search.message == "P(1,1) to P(1,2): P(1,m) from their closed form"
    assert search.cost.counts["impacts"] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"impacts": 0}, "impacts must be a positive integer; got 0"),
        ({"periods": 1.5}, "periods must be a positive integer; got 1.5"),
        ({"impacts": 10**30}, "impacts"),
    ],
)
def test_what_is_no_number_of_impacts_is_refused(options: dict[str, int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        CHAOTIC.find_orbits(**options)


def test_nothing_that_drives_is_refused() -> None:
    with pytest.raises(ValueError, match="system must be driven"):
        CHAOTIC.replace(amplitude=0.0).find_orbits()
