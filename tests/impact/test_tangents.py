"""How impact motions stretch disturbances: the kernel against products of exact derivatives."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from dynkit.core.no_motion import NoCrossing
from dynkit.systems import BouncingBall, ImpactChain, SingleImpactOscillator
from dynkit.systems.impact.oscillators.attractor import _ImpactOrbit
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.variational.map_derivative import _lift
from dynkit.systems.impact.variational.tangent_kernels import stretch
from dynkit.systems.impact.variational.tangents import growth, returned, steps_of, stretching
from tests.impact.test_structures import Rod
from tests.impact_orbits.structures import SYSTEMS

if TYPE_CHECKING:
    from dynkit.core.validation import Array
    from dynkit.systems.impact.simulation.state import ImpactState

ROUNDING = 2.0**-52

FLYING: dict[str, ImpactOscillator] = {
    "chaos": ImpactChain(frequency=1.346),
    "P(1,3)": ImpactChain(frequency=0.87),
    "play": SYSTEMS["chain, play"],
    "one mass with play": SYSTEMS["play"],
    "below": SYSTEMS["chain, below"],
    "contact inside": SYSTEMS["chain, contact inside"],
    "forces": SYSTEMS["chain, forces"],
    "not proportional": SYSTEMS["graded"],
    "unequal": SYSTEMS["chain, unequal"],
    "linked": SYSTEMS["triple"],
    "linked, contact inside": SYSTEMS["double, contact inside"],
    "overdamped": SYSTEMS["chain, overdamped"],
    "resonant": SingleImpactOscillator(
        frequency=1.0, damping_ratio=1e-6, restitution=0.8, stop=0.1
    ),
    "elastic": SYSTEMS["chain, elastic"],
    "rigid": BouncingBall(amplitude=0.8, frequency=3.0, restitution=0.9),
}


def between(system: ImpactOscillator) -> ImpactState | None:
    """A start between two stops; the default one where there is but one."""
    n = system.degrees_of_freedom
    return system.state(np.zeros(n), np.zeros(n)) if system.play < np.inf and n > 1 else None


@cache
def start(name: str) -> Array:
    system = FLYING[name]
    attractor = system.attractor(transient=300, impacts=1, start=between(system))
    return np.array(attractor.states[-1])


def at_one_time(system: ImpactOscillator, state: ImpactState) -> Array:
    """Derivative (2N, 2N) of the pairs of the modes at one time by the section coordinates."""
    n, free = system.degrees_of_freedom, system._free
    lift = _lift(system, state).reshape(2, free.layout.slots, 2 * n)[:, free.layout.modes]
    # A later phase is an earlier state: less the rate of the free motion, times the time.
    gap = system._gaps[state.element]
    y = free.states(state._coordinates, *state._turn)
    g = gap.generator
    rate = np.stack([g[0] * y[0] + g[1] * y[1], g[2] * y[0] + g[3] * y[1]])
    for (target, source), b in zip(gap.links.tolist(), gap.link_step[0], strict=True):
        rate[:, target] += b.reshape(2, 2) @ y[:, source]
    lift[..., -1] -= rate[:, free.layout.modes] / system.frequency
    return np.asarray(lift.reshape(2 * n, 2 * n))


def whole(system: ImpactOscillator, start: ImpactState) -> Array:
    """The matrix (2N, 2N) of one impact, from what the kernel makes of each unit vector."""
    steps = steps_of(system, system._run(start, 1, store=True))
    d = system.dimension
    product = np.eye(d)
    for k in range(len(steps.which)):
        part = slice(k, k + 1)
        image = np.empty((d, d))
        for j in range(d):
            frame, logs = np.roll(np.eye(d), -j, axis=0), np.empty((1, d))
            stretch(
                steps.blocks[part],
                steps.which[part],
                steps.dense,
                steps.vectors,
                steps.jumps[part],
                np.zeros(1, dtype=np.intp),
                frame,
                np.empty(d),
                logs,
            )
            image[:, j] = frame[0] * np.exp(logs[0, 0])
        product = image @ product
    return product


@pytest.mark.parametrize("name", FLYING)
def test_an_impact_acts_as_the_jacobian_in_other_coordinates(name: str) -> None:
    system = FLYING[name]
    state = system.impact_state(start(name))
    after = system.simulate(impacts=1, start=state).final
    before, there = at_one_time(system, state), at_one_time(system, after)
    found, jacobian = whole(system, state), system.jacobian(start(name))
    # The entries of the factors are wrong by rounding of sums over 2N modes and some N coordinates.
    size = (abs(there) @ abs(jacobian) + abs(found) @ abs(before)).max()
    assert size > 0.1
    gap = abs(found @ before - there @ jacobian)
    assert gap.max() <= 4.0 * system.dimension * ROUNDING * size


STICKING: dict[str, ImpactOscillator] = {
    "ten masses": ImpactChain(frequency=0.408, chatter_tolerance=1e-16),
    "slow": ImpactChain(frequency=0.16, chatter_tolerance=1e-16),
    "two masses": ImpactChain(masses=2, restitution=0.4, frequency=0.2),
    "dashpots apart": ImpactChain(
        masses=3, damping=(0.1, 0.4, 0.2), restitution=0.4, frequency=0.2
    ),
    "below": ImpactChain(masses=2, restitution=0.4, frequency=0.2, side="below"),
    "two stops": ImpactChain(masses=2, restitution=0.2, frequency=0.2, play=0.25, offset=-0.05),
    "dead": ImpactChain(frequency=0.408, restitution=0.0),
    "rod": Rod(frequency=0.2, restitution=0.4),
}


@pytest.mark.parametrize("name", STICKING)
def test_contact_acts_as_the_jacobian_in_other_coordinates(name: str) -> None:
    system = STICKING[name]
    record = system.simulate(impacts=300, start=between(system))
    contact = int(np.flatnonzero(np.isfinite(record.sticking[:, 1]))[0])
    i = int(np.searchsorted(record.time, record.sticking[contact, 0], side="right")) - 1
    state = system.impact_state(record.states[i])
    run = system._run(state, 1, store=True)
    assert len(run.contacts) == 1
    before, there = at_one_time(system, state), at_one_time(system, run.final)
    found, jacobian = whole(system, state), system.jacobian(record.states[i])
    size = (abs(there) @ abs(jacobian) + abs(found) @ abs(before)).max()
    gap = abs(found @ before - there @ jacobian)
    # As in flight, with two changes of basis besides; and the times of events are rounded.
    time = float(run.time[0])
    assert gap.max() <= (12.0 * system.dimension + 4.0 * time) * ROUNDING * size


@pytest.mark.parametrize("name", STICKING)
def test_contact_takes_two_directions(name: str) -> None:
    system = STICKING[name]
    record = system.simulate(impacts=200, start=between(system))
    found = system.stretching(record.states[-1], 300)
    lost = np.isneginf(found.logs).sum(axis=1)
    assert set(lost.tolist()) <= ({0, 2} if system.restitution else {1, 2})
    assert (lost == 2).any()
    assert np.isfinite(found.logs[:, :-2]).all()


@pytest.mark.parametrize("name", FLYING)
@pytest.mark.plain
def test_the_sum_is_the_logarithm_of_the_determinant(name: str) -> None:
    system = FLYING[name]
    found = system.stretching(start(name), 60)
    assert found.times is not None
    trace = float(np.trace(np.linalg.solve(system.mass, system.damping_matrix)))
    expected = 2.0 * np.log(system.restitution) - trace * found.times
    sticks = np.isneginf(found.logs).any(axis=1)
    # In each part of a flight rounding leaves ten digits of the smallest of the stretchings.
    gap = abs(found.logs.sum(axis=1) - expected)[~sticks]
    assert len(gap) > 20
    assert gap.max() < 1e-9 * max(1.0, abs(expected).max())


@pytest.mark.plain
def test_the_state_after_is_that_of_the_simulation() -> None:
    chain = FLYING["chaos"]
    found = chain.stretching(start("chaos"), 20)
    record = chain.simulate(impacts=20, start=chain.impact_state(start("chaos")))
    assert (found.state == record.states[-1]).all()
    assert found.times == pytest.approx(np.diff(record.time, prepend=0.0), abs=0.0)


def test_runs_are_cut_without_a_trace() -> None:
    # 1024 impacts are worked on at a time.
    chain = ImpactChain(masses=2, frequency=0.7)
    state = chain.attractor(transient=300, impacts=1).states[-1]
    whole_run = chain.stretching(state, 1500)
    assert (whole_run.logs[:1024] == chain.stretching(state, 1024).logs).all()
    assert abs(whole_run.logs[1024:] - whole_run.logs[1000:1024].mean(axis=0)).max() < 20.0


@pytest.mark.plain
def test_a_touch_counts_as_no_impact() -> None:
    chain = FLYING["P(1,3)"]
    state = chain.impact_state(start("P(1,3)"))
    run = chain._run(state, 1, store=True)
    touching = dataclasses.replace(run.log, speed=np.zeros(1))
    steps = steps_of(chain, run.holding(touching))
    assert (steps.jumps == 0.0).all()
    assert (steps.lost == 0).all()


@pytest.mark.plain
def test_where_no_impact_follows_there_is_no_stretching() -> None:
    chain = ImpactChain(masses=2, frequency=0.7, offset=-10.0)
    state = np.array([-10.0, 0.0, 0.5, 0.0])
    with pytest.raises(NoCrossing, match="no next impact"):
        chain.stretching(state, 100)


def test_one_disturbance_grows_as_the_first_direction_does() -> None:
    chain = FLYING["chaos"]
    state = chain.impact_state(start("chaos"))
    one = growth(chain, chain._run(state, 300, store=True))
    whole_frame = chain.stretching(start("chaos"), 300).logs[:, 0]
    # both have turned into the direction that grows fastest
    assert one[200:] == pytest.approx(whole_frame[200:], abs=1e-9)


@pytest.mark.plain
def test_where_the_motion_ends_nothing_grows() -> None:
    chain = ImpactChain(masses=2, frequency=0.7, offset=-10.0)
    start = chain.impact_state(np.array([-10.0, 0.0, 0.5, 0.0]))
    assert np.isneginf(_ImpactOrbit(chain.simulate(impacts=1, start=start)).growth(100)).all()


# with millions of radians of the fast mode in a flight, whose sine loses nine digits
STIFF = {"stiff": ImpactChain(masses=2, springs=(1.0, 1e12), damping=0.0, frequency=0.9)}


@pytest.mark.parametrize("name", [*FLYING, *STICKING, *STIFF])
def test_whole_runs_have_the_growth_and_derivatives_of_single_steps(name: str) -> None:
    system = {**FLYING, **STICKING, **STIFF}[name]
    begin = system.attractor(transient=100, impacts=1, start=between(system)).final
    frame = np.sqrt(np.arange(2.0, 2.0 + system.dimension))[:, None]
    expected = stretching(system, begin, 60, frame / np.linalg.norm(frame), 0.0).logs[:, 0]
    found = growth(system, system._run(begin, 60, store=True))
    assert (np.isneginf(found) == np.isneginf(expected)).all()
    certain = ~np.isneginf(found)
    assert abs(found - expected)[certain].max(initial=0.0) < 1e-9
    product = whole(system, begin)
    (first,) = returned(system, system._run(begin, 1, store=True), [-1, 0])
    assert abs(first - product).max() < 1e-11 * abs(product).max()
