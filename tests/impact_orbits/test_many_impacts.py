"""Orbits of several impacts: against simulation, the map's own derivative, and the exact map."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.single import SingleImpactOscillator
from tests.impact.test_labels import PAPER
from tests.impact_orbits.exact_orbits import distance, exact_orbit
from tests.impact_orbits.structures import SYSTEMS

ASKED = 1e-9

FREQUENCIES = [0.16, 0.28, 0.33, 0.46, 0.55, 0.67, 0.79, 1.31]
"""Of the paper's chain, with two to seven impacts."""

EIGHT = 2.982
"""Of the single mass, with eight impacts in eight periods."""

SEARCHED = {
    "chain, undamped": (3, 2),
    "chain, elastic": (3, 4),
    "chain, dead": (3, 4),
    "chain, play": (3, 4),
    "chain, below with play": (3, 4),
    "chain, forces": (3, 4),
    "double": (4, 5),
    "single": (6, 4),
    "single, stop": (4, 5),
    "play": (5, 3),
}
"""Impacts and periods of orbits that are searched for."""


@cache
def settled(frequency: float) -> ImpactOrbit:
    orbit = ImpactChain(frequency=frequency).attractor().periodic_orbit()
    assert isinstance(orbit, ImpactOrbit)
    return orbit


@cache
def searched(name: str) -> list[ImpactOrbit]:
    impacts, periods = SEARCHED[name]
    return SYSTEMS[name].periodic_orbits(impacts=impacts, periods=periods)


# --- the paper's motions --------------------------------------------------------------------------


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_an_attractor_leads_to_the_orbit_of_its_label(frequency: float) -> None:
    orbit = settled(frequency)
    assert orbit.label == PAPER[frequency]
    assert orbit.stable
    assert orbit.admissible


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_an_attractor_leads_to_its_own_states(frequency: float) -> None:
    attractor = ImpactChain(frequency=frequency).attractor()
    orbit = settled(frequency)
    after = attractor.system.simulate(impacts=orbit.impacts, start=attractor.final)
    off = abs(attractor.system.difference(after.states, orbit.states)).max()
    # What is left of the transient has recurred to the tolerance of the label.
    assert off <= attractor.label.tolerance


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_simulation_goes_round_the_orbit(frequency: float) -> None:
    orbit = settled(frequency)
    system, n = orbit.system, orbit.impacts
    record = system.simulate(impacts=n, start=system.impact_state(orbit.states[0]))
    growth, product = 1.0, np.eye(system.dimension)
    for state in orbit.states:
        product = system.jacobian(state) @ product
        growth = max(growth, float(abs(product).sum(axis=1).max()))
    off = abs(system.difference(record.states, np.roll(orbit.states, -1, axis=0))).max()
    assert off <= (1.0 + growth) * orbit.error + record.error.max()
    assert abs(record.time[-1] - orbit.period) <= 2.0 * growth * orbit.error / system.frequency


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_multipliers_are_those_of_the_derivative_of_the_map(frequency: float) -> None:
    orbit = settled(frequency)
    product = np.eye(orbit.system.dimension)
    for state in orbit.states:
        product = orbit.system.jacobian(state) @ product
    assert distance(orbit.multipliers, np.linalg.eigvals(product)) <= ASKED


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_orbits_of_the_paper_are_exact(frequency: float) -> None:
    orbit = settled(frequency)
    exact = exact_orbit(orbit)
    assert exact.error_of(orbit.states) <= orbit.error <= ASKED
    assert distance(orbit.multipliers, exact.multipliers) <= ASKED


# --- orbits that are searched for -----------------------------------------------------------------


@pytest.mark.parametrize("name", SEARCHED)
def test_orbits_that_are_found_are_exact(name: str) -> None:
    orbits = searched(name)
    assert orbits
    for orbit in orbits:
        exact = exact_orbit(orbit)
        size = max(1.0, abs(exact.multipliers).max())
        assert exact.error_of(orbit.states) <= orbit.error <= ASKED
        assert distance(orbit.multipliers, exact.multipliers) <= ASKED * size


@pytest.mark.parametrize("name", SEARCHED)
def test_orbits_that_are_found_have_the_kind_that_was_asked_for(name: str) -> None:
    impacts, periods = SEARCHED[name]
    for orbit in searched(name):
        assert orbit.label == f"P({impacts},{periods})"
        assert len(orbit.states) == orbit.impacts == impacts
        assert orbit.period == pytest.approx(
            2.0 * math.pi * periods / orbit.system.frequency, rel=1e-15
        )


@pytest.mark.parametrize("name", SEARCHED)
def test_impacts_come_in_turn_within_the_period(name: str) -> None:
    for orbit in searched(name):
        ends = np.append(orbit.phases, orbit.phases[0] + 2.0 * math.pi * orbit.periods)
        assert (np.diff(ends) > 0.0).all()
        assert 0.0 <= orbit.phases[0] < 2.0 * math.pi


def states_of(orbit: ImpactOrbit, turns: int) -> Array:
    """States from another of the impacts on, as points of the plane of the phase."""
    states = np.roll(orbit.states, turns, axis=0)
    phase = states[:, -1:]
    return np.concatenate([states[:, :-1], np.cos(phase), np.sin(phase)], axis=1)


@pytest.mark.parametrize("name", SEARCHED)
def test_no_orbit_is_found_twice(name: str) -> None:
    orbits = searched(name)
    for k, orbit in enumerate(orbits):
        for other in orbits[:k]:
            for turns in range(orbit.impacts):
                assert abs(states_of(orbit, turns) - states_of(other, 0)).max() > 1e-6


@pytest.mark.parametrize("name", SEARCHED)
def test_no_orbit_repeats_a_shorter_one(name: str) -> None:
    for orbit in searched(name):
        for turns in range(1, orbit.impacts):
            whole = orbit.periods * turns % orbit.impacts == 0
            same = abs(states_of(orbit, turns) - states_of(orbit, 0)).max() < 1e-6
            assert not (whole and same)


@pytest.mark.parametrize("name", SEARCHED)
def test_admissible_orbits_come_first_then_larger_impulses(name: str) -> None:
    keys = [(not orbit.admissible, -orbit.impulses.sum()) for orbit in searched(name)]
    assert keys == sorted(keys)


def test_without_rebound_no_impulse_of_zero_is_taken_for_an_impact() -> None:
    system = SYSTEMS["chain, dead"]
    for impacts, periods in ((2, 1), (2, 2), (5, 3)):
        for orbit in system.periodic_orbits(impacts=impacts, periods=periods):
            assert orbit.impulses.min() > 1e-6


def test_orbits_of_eight_impacts_are_exact() -> None:
    attractor = SingleImpactOscillator(frequency=EIGHT, restitution=0.8).attractor(transient=3000)
    orbit: Any = attractor.periodic_orbit()
    exact = exact_orbit(orbit)
    assert orbit.impacts == 8
    assert exact.error_of(orbit.states) <= orbit.error <= ASKED
    assert distance(orbit.multipliers, exact.multipliers) <= ASKED


@pytest.mark.parametrize("periods", [1, 2, 3])
@pytest.mark.parametrize("damping", [0.1, 1.0])
def test_multipliers_of_many_masses_are_those_of_the_derivative(
    damping: float, periods: int
) -> None:
    chain = ImpactChain(masses=80, frequency=1.2, damping=damping)
    orbit = chain.periodic_orbit(periods=periods)
    # Only an admissible orbit is followed by the map.
    assert orbit.admissible
    wanted = np.linalg.eigvals(chain.jacobian(orbit.states[0]))
    assert distance(orbit.multipliers, wanted) <= ASKED


# --- Newton's method ------------------------------------------------------------------------------


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_convergence_from_a_guess_is_quadratic(frequency: float) -> None:
    orbit = settled(frequency)
    random = np.random.default_rng(round(1000 * frequency))
    # Small beside the shortest flight.
    ends = np.append(orbit.phases, orbit.phases[0] + 2.0 * math.pi * orbit.periods)
    size = 3e-3 * float(np.diff(ends).min())
    again = orbit.system.periodic_orbit(
        periods=orbit.periods, phases=orbit.phases + random.uniform(-size, size, orbit.impacts)
    )
    assert abs(orbit.system.difference(again.states, orbit.states)).max() <= (
        orbit.error + again.error
    )
    logs = np.log(again.history)
    orders = np.diff(logs)[1:] / np.diff(logs)[:-1]
    # Steps that end far above rounding tell the order.
    telling = orders[np.array(again.history[2:]) > 1e-13]
    assert len(telling)
    assert (telling > 1.6).all()


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_residuals_end_near_rounding(frequency: float) -> None:
    orbit = settled(frequency)
    assert orbit.residual == orbit.history[-1] <= 1e-14
