"""Many starts that end at known orbits: the motions and the basins of single simulations."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from dynkit import basins
from dynkit.core.validation import Array
from dynkit.sweeps.basins import arriving
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    ImpactOscillator,
    Jenkins,
    PlayOscillator,
    SingleImpactOscillator,
    SoftStop,
)
from dynkit.systems.impact.simulation import runs

SINGLE = SingleImpactOscillator(frequency=2.2, restitution=0.8)
PLAY = PlayOscillator(
    frequency=1.38, play=1.0, spring=1.0, damping=0.1, force=1.0, amplitude=0.0, restitution=0.7
)
CASES: dict[str, tuple[ImpactOscillator, float, dict[str, Any]]] = {
    "one mass, P(1,1)": (SINGLE, 1.4, {"transient": 200, "keep": 50}),
    "one mass, P(1,2) and rest": (
        SingleImpactOscillator(frequency=3.4, restitution=0.8, stop=0.2),
        1.4,
        {"transient": 200, "keep": 50},
    ),
    "two stops, mirror images": (PLAY, 0.45, {}),
    "one mass, chatter": (
        ImpactChain(masses=1, frequency=0.6, restitution=0.5),
        1.0,
        {"transient": 100, "keep": 40},
    ),
    "one mass, chaos": (
        SingleImpactOscillator(frequency=2.75, restitution=0.8),
        1.4,
        {"transient": 100, "keep": 40},
    ),
    "two masses": (ImpactChain(masses=2, frequency=1.5, damping=0.3), 1.0, {"transient": 300}),
    "ten masses, two P(2,3)": (ImpactChain(frequency=0.8), 0.5, {"transient": 700}),
    "a soft stop": (
        ImpactChain(
            masses=2,
            frequency=0.9,
            damping=0.3,
            elements=[
                HardStop(1, amplitude=0.1, restitution=0.6),
                SoftStop(0, offset=-0.3, stiffness=5.0, damping=0.2),
            ],
        ),
        0.3,
        {"transient": 300},
    ),
    "two hard stops": (
        ImpactChain(
            masses=2,
            frequency=0.9,
            damping=0.3,
            elements=[
                HardStop(1, amplitude=0.1, restitution=0.6),
                HardStop((0, 1), offset=-0.2, restitution=0.5),
            ],
        ),
        0.4,
        {"transient": 300},
    ),
    "friction": (
        ImpactChain(
            masses=2,
            frequency=1.5,
            damping=0.1,
            elements=[
                HardStop(1, amplitude=0.3, restitution=0.6),
                DryFriction(0, force=0.02, static=0.03),
            ],
        ),
        0.4,
        {"transient": 300},
    ),
}


def random_starts(system: ImpactOscillator, size: float, count: int) -> Array:
    """Starts around rest, some of them beyond a stop."""
    random, n = np.random.default_rng(7), system.degrees_of_freedom
    own = random.uniform(-size, size, (count, 2 * n))
    return np.column_stack([own, random.uniform(0.0, 2.0 * np.pi, count)])


@pytest.mark.parametrize("name", CASES)
def test_motions_that_end_early_have_the_basins_of_whole_motions(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    system, size, more = CASES[name]
    # each chaotic motion has a label of its own, of thousands of impacts
    starts = random_starts(system, size, 24 if "chaos" in name else 60)
    whole = basins(system, starts, **more, progress=False)
    monkeypatch.setattr(arriving, "_MANY", 24)
    found = basins(system, starts, **more, progress=False)
    assert np.array_equal(found.numbers, whole.numbers)
    for one, other in zip(found.basins, whole.basins, strict=True):
        assert (one.label, one.ending, one.start) == (other.label, other.ending, other.start)
        assert np.array_equal(one.states, other.states)  # the same bits


@pytest.mark.parametrize("name", [name for name in CASES if "cha" not in name])
def test_an_arrived_motion_has_the_bits_of_its_single_simulation(name: str) -> None:
    system, size, more = CASES[name]
    starts = random_starts(system, size, 200)
    motion = system.attractor(transient=1000, keep=1)
    orbit = system.attractor(start=motion.final, transient=0, keep=motion.label.iterates)
    arrived = system.arrivals(starts, [orbit], more.get("transient", 700), 1e-9)
    assert arrived is not None
    numbers, states, _ = arrived
    (there,) = np.nonzero(numbers == 0)
    assert len(there) > 10
    for place in there[:20]:
        record = system.simulate(impacts=700, start=system.state_from(starts[place]))
        assert (record.states == states[place]).all(axis=1).any()
        distance = np.linalg.norm(system.difference(orbit.states, states[place]), axis=1).min()
        assert distance < 1e-8 * np.linalg.norm(orbit.states, axis=1).max()
    assert np.isnan(states[numbers < 0]).all()


def test_motions_that_chatter_arrive_at_an_orbit_that_sticks() -> None:
    system, size, _ = CASES["one mass, chatter"]
    motion = system.attractor()
    assert motion.label.name == "P(inf,1)"
    orbit = system.attractor(start=motion.final, transient=0, keep=100)
    starts = random_starts(system, size, 40)
    starts = starts[starts[:, 0] > 0.1]
    arrived = system.arrivals(starts, [orbit], 200, 1e-9)
    assert arrived is not None
    numbers, states, cost = arrived
    assert (numbers == 0).all()
    period = system.simulate(impacts=100, start=motion.final)
    impacts = int((period.time <= 2.0 * np.pi / system.frequency).sum())
    assert cost.counts["contacts"] >= len(starts)  # each has stuck
    assert cost.counts["impacts"] < 5 * impacts * len(starts)
    for start, state in zip(starts, states, strict=True):
        record = system.simulate(impacts=200, start=system.state_from(start))
        assert (record.states == state).all(axis=1).any()


def test_an_orbit_that_does_not_recur_is_not_compared() -> None:
    system, size, _ = CASES["one mass, chatter"]
    period = system.simulate(impacts=100, start=system.attractor().final)
    impacts = int((period.time <= 2.0 * np.pi / system.frequency).sum())
    orbit = system.attractor(transient=700, keep=impacts - 1)
    assert len(orbit.record.sticking) == 1
    arrived = system.arrivals(random_starts(system, size, 20), [orbit], 200, 1e-9)
    assert arrived is not None
    assert (arrived[0] == -1).all()


def test_most_starts_are_simulated_in_calls_of_many_and_only_until_they_arrive(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    courses, own = [0], runs.Course.__init__

    def counted(*arguments: Any, **more: Any) -> None:
        courses[0] += 1
        own(*arguments, **more)

    monkeypatch.setattr(runs.Course, "__init__", counted)
    starts = random_starts(SINGLE, 1.4, 1024)
    starts[:, 0] = -abs(starts[:, 0])
    found = basins(SINGLE, starts, transient=200, keep=50, progress=False)
    assert [str(basin.label) for basin in found.basins] == ["P(1,1)"]
    assert found.basins[0].count == 1024
    # the sample of 32 has a course for the transient and one for the kept impacts of each
    assert courses[0] < 100
    # rounding takes a motion with multipliers of modulus m from 1 to 1e-9 in 21 / log(1 / m)
    rate = np.log(1.0 / found.basins[0].label.multiplier)
    assert found.cost.counts["impacts"] < 32 * 250 + 992 * (25.0 / rate)


def test_basins_do_not_depend_on_the_executor_or_the_chunks() -> None:
    starts = random_starts(PLAY, 0.45, 1000).reshape(20, 50, 3)
    with ThreadPoolExecutor(2) as executor:
        found = basins(PLAY, starts, executor=executor, progress=False)
    assert sorted(str(basin.label) for basin in found.basins) == ["P(2,1)", "P(2,1)"]
    again = basins(PLAY, starts, progress=False)
    assert np.array_equal(found.numbers, again.numbers)
    for one, other in zip(found.basins, again.basins, strict=True):
        assert np.array_equal(one.states, other.states)
    assert dict(found.cost.counts) == dict(again.cost.counts)


def test_sliders_and_preloads_have_whole_motions() -> None:
    """Positions and velocities alone do not say how they begin."""
    stop = HardStop(1, amplitude=0.1)
    for other in (
        Jenkins(0, stiffness=1.0, force=0.01),
        SoftStop(0, offset=-0.3, stiffness=5.0, preload=0.1),
    ):
        system = ImpactChain(masses=2, frequency=0.9, elements=[stop, other])
        assert system.arrivals(np.empty((0, 5)), (), 0, 1e-9) is None
