"""Impact oscillators as maps and attractors: the contracts, and the derivative through contact."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.testing import (
    AttractorCheck,
    MapCheck,
    attractor_checks,
    check_name,
    map_checks,
    numerical_derivative,
)
from tests.impact.test_structures import Rod, TaperedChain

SMOOTH: dict[str, ImpactChain] = {
    "one mass": ImpactChain(masses=1, frequency=0.9),
    "two masses": ImpactChain(masses=2, frequency=0.7),
    "ten masses, P(1,3)": ImpactChain(frequency=0.87),
    "ten masses, P(1,1)": ImpactChain(frequency=0.64),
    "dashpots apart": ImpactChain(masses=2, damping=(0.3, 0.0), amplitude=0.3, frequency=0.5),
    "overdamped": ImpactChain(masses=3, damping=8.0, amplitude=0.5, frequency=0.8),
    "tapered": TaperedChain(frequency=0.87),
    "rod": Rod(frequency=0.9),
}


@cache
def states(name: str) -> Array:
    return SMOOTH[name].attractor(transient=300, impacts=5).states


@pytest.mark.parametrize("check", map_checks, ids=check_name)
@pytest.mark.parametrize("name", SMOOTH)
def test_the_chain_is_a_map(name: str, check: MapCheck) -> None:
    check(SMOOTH[name], states(name))


@pytest.mark.parametrize("check", attractor_checks, ids=check_name)
@pytest.mark.parametrize("frequency", [0.35, 0.408, 0.87])
def test_the_attractor_is_an_attractor(frequency: float, check: AttractorCheck) -> None:
    chain = ImpactChain(frequency=frequency)
    check(lambda transient, count: chain.attractor(transient=transient, impacts=count))


def test_calls_of_the_map_are_the_impacts_of_the_record() -> None:
    chain = ImpactChain(frequency=0.87)
    record = chain.simulate(impacts=30)
    following = np.array([chain(state) for state in record.states[:-1]])
    assert abs(chain.difference(following, record.states[1:])).max() < 1e-12


def test_a_step_of_the_map_leads_through_contact() -> None:
    chain = ImpactChain(frequency=0.408)
    record = chain.simulate(impacts=120)
    before = int(np.searchsorted(record.time, record.sticking[0, 0])) - 1
    after = chain(record.states[before])
    assert abs(chain.difference(after, record.states[before + 1])).max() < 1e-12


# --- derivatives through contact and release -----------------------------------------------------

STICKING: dict[str, ImpactChain] = {
    "0.16": ImpactChain(frequency=0.16, chatter_tolerance=1e-8),
    "0.408": ImpactChain(frequency=0.408, chatter_tolerance=1e-8),
    "dead": ImpactChain(frequency=0.408, restitution=0.0),
    "two masses": ImpactChain(masses=2, restitution=0.4, frequency=0.2, chatter_tolerance=1e-6),
    "dashpots apart": ImpactChain(
        masses=3,
        damping=(0.1, 0.4, 0.2),
        restitution=0.4,
        frequency=0.2,
        chatter_tolerance=1e-6,
    ),
    "rod": Rod(frequency=0.2, restitution=0.4, chatter_tolerance=1e-6),
}


def before_contact(chain: ImpactChain) -> Array:
    """The last impact before the first contact that ends."""
    record = chain.simulate(impacts=300)
    contact = int(np.flatnonzero(np.isfinite(record.sticking[:, 1]))[0])
    begin = record.sticking[contact, 0]
    return np.array(record.states[np.searchsorted(record.time, begin, side="right") - 1])


@pytest.mark.parametrize("name", STICKING)
def test_the_jacobian_through_contact_is_the_derivative(name: str) -> None:
    chain = STICKING[name]
    state = before_contact(chain)
    jacobian = chain.jacobian(state)
    free = np.arange(len(state)) != len(state) - 2  # the relative velocity may not be negative

    def moved(part: Array) -> Array:
        whole = state.copy()
        whole[free] = part
        return chain(whole)

    found, error = numerical_derivative(moved, state[free], difference=chain.difference)
    assert error.max() < 1e-5
    assert (abs(jacobian[:, free] - found) <= 20.0 * error + 1e-12 * abs(found).max()).all()


@pytest.mark.parametrize("name", STICKING)
def test_the_relative_velocity_acts_through_contact_as_the_jacobian_says(name: str) -> None:
    # Not at all, unless inertia couples the contact mass with others.
    chain = STICKING[name]
    state = before_contact(chain)
    slower = state.copy()
    slower[-2] *= 0.999
    change = chain.difference(chain(slower), chain(state))
    column = chain.jacobian(state)[:, -2] * (slower[-2] - state[-2])
    assert change == pytest.approx(column, abs=1e-12)


@pytest.mark.parametrize("name", STICKING)
def test_two_multipliers_vanish_through_contact(name: str) -> None:
    # The states after a release fill 2N - 2 dimensions: gap, relative velocity and force vanish.
    chain = STICKING[name]
    sizes = np.linalg.svd(chain.jacobian(before_contact(chain)), compute_uv=False)
    assert sizes[-2] < 1e-11 * sizes[0]


@pytest.mark.parametrize("name", ["two masses", "ten masses, P(1,3)", "overdamped"])
def test_products_of_jacobians_are_derivatives_of_iterates(name: str) -> None:
    chain, state = SMOOTH[name], states(name)[0]
    product, here = np.eye(len(state)), state
    for _ in range(3):
        product, here = chain.jacobian(here) @ product, chain(here)
    found, error = numerical_derivative(
        lambda y: chain.iterate(y, 3)[-1], state, difference=chain.difference
    )
    # Single elements of the difference of two step sizes may vanish by chance.
    assert error.max() < 1e-6
    assert abs(product - found).max() <= 20.0 * error.max()


def test_a_chatter_without_tolerance_has_the_derivative_of_its_bounces() -> None:
    # r for velocities, 2/a for times, in each bounce (a = contact acceleration).
    chain = ImpactChain(masses=2, offset=0.3, frequency=0.1, chatter_tolerance=0.0)
    record = chain.simulate(impacts=200, start=chain.state([0.5, 1.0]))
    state = record.states[150]
    assert state[-2] < 1e-9
    jacobian = chain.jacobian(state)
    flight = chain.simulate(impacts=1, start=chain.impact_state(state)).time[0]
    assert jacobian[-2, -2] == pytest.approx(0.85, abs=1e-5)
    assert jacobian[-1, -2] == pytest.approx(chain.frequency * flight / state[-2], rel=1e-5)
