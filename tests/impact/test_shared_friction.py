"""Friction along one row: over one surface it slips and sticks together, over others one sticks."""

from typing import Any

import numpy as np
import pytest

from dynkit import CannotFollow, parameter_map
from dynkit.systems import DryFriction, HardStop, ImpactChain, Jenkins, SoftStop
from tests.impact.agreement import moves_as_in_many_digits


def pair(*elements: Any) -> ImpactChain:
    """Two masses, driven, with elements."""
    return ImpactChain(
        masses=2, damping=0.05, frequency=0.7, harmonic_forces=[0.3, 0.8], elements=list(elements)
    )


def test_two_along_one_row_are_one_with_their_forces() -> None:
    other = DryFriction(1, force=0.1)
    two = pair(
        DryFriction(0, force=0.3, static=0.4, velocity=0.1, slope=0.1, name="belt"),
        other,
        DryFriction((-2.0, 0.0), force=0.05, static=0.1, velocity=-0.2, slope=0.05, name="lever"),
    )
    one = pair(DryFriction(0, force=0.4, static=0.6, velocity=0.1, slope=0.3), other)
    records = [m.simulate(impacts=20, start=m.state([0.3, 0.2], [0.1, 0.0])) for m in (two, one)]
    apart = abs(records[0].states - records[1].states).max(axis=1)
    assert len(records[0].events) == len(records[1].events) > 100
    assert (apart <= records[0].error + records[1].error).all()
    works = [record.energy_balance().dissipated for record in records]
    assert works[0]["belt"] + works[0]["lever"] == pytest.approx(works[1]["elements[0]"], rel=1e-11)
    counts = two.attractor(transient=100).label.counts
    assert counts is not None
    assert counts["belt.sticks"] == counts["lever.sticks"]


def test_they_stick_up_to_the_sum_of_their_static_forces() -> None:
    elements = [DryFriction(0, force=0.1, static=0.2), DryFriction(0, force=0.1, side="below")]
    block = ImpactChain(masses=1, damping=0.0, frequency=1.0, elements=elements)
    for place, stays in ((0.299, True), (0.301, False), (-0.299, True), (-0.301, False)):
        record = block.simulate(impacts=3, start=block.state([place], [0.0]))
        assert (len(record.events) == 0) == stays
    slid = block.simulate(impacts=1, start=block.state([0.31], [0.0]))
    # slips by the kinetic forces, 0.2, to the other side of the balance of spring and friction
    assert slid.events.position[-1, 0] == pytest.approx(0.09, abs=1e-14)


def test_an_impact_breaks_both() -> None:
    def ride(*rubs: DryFriction) -> ImpactChain:
        stop = HardStop(1, offset=-0.1, restitution=0.6)
        return pair(stop, *rubs)

    two = ride(DryFriction((0, 1), force=0.25), DryFriction((1, 0), force=0.15))
    one = ride(DryFriction((0, 1), force=0.4))
    records = [machine.simulate(impacts=40) for machine in (two, one)]
    apart = abs(two.difference(records[0].states, records[1].states)).max(axis=1)
    assert (apart <= records[0].error + records[1].error).all()
    for state in records[0].states[10:14]:
        assert two.jacobian(state) == pytest.approx(one.jacobian(state), rel=1e-8, abs=1e-8)


def test_what_stays_open_is_refused() -> None:
    # both masses stick, and with them what rubs between them: how they share forces is open
    machine = pair(*(DryFriction(row, force=5.0) for row in (0, 1, (0, 1))))
    with pytest.raises(CannotFollow, match="along what other friction, or a stop, holds"):
        machine.simulate(impacts=1, start=machine.state([0.0, 0.0], [0.0, 0.0]))


def test_a_plane_goes_on_past_values_at_which_friction_forces_stay_open() -> None:
    # without the belt both masses stick, and what rubs between them is open
    rubs = [DryFriction(row, force=0.2) for row in (0, 1, (0, 1))]
    machine = ImpactChain(
        masses=2, frequency=1.0, harmonic_forces=[3.0, 4.0], elements=rubs, damping=0.1
    )
    values = {"elements[0].velocity": [9.0, 0.0, 9.0], "damping": [0.1]}
    run = {"transient": 2, "keep": 4, "progress": False}
    found = parameter_map(machine, values, **run)  # type: ignore[arg-type]
    assert (found.names == "no motion").ravel().tolist() == [False, True, False]


@pytest.mark.parametrize("beside", [[], [Jenkins((0.5, -2.0), stiffness=0.5, force=0.1)]])
def test_what_would_stay_open_beside_a_closed_stop_is_refused(beside: list[Any]) -> None:
    # the stop holds one mass: both frictions halt with the other one
    stop = HardStop(0, restitution=0.0)
    machine = ImpactChain(
        masses=2,
        damping=0.05,
        frequency=0.7,
        harmonic_forces=[0.0, 0.9],
        constant_forces=[-3.0, 0.0],
        elements=[stop, DryFriction((1, 0), force=0.2), DryFriction(1, force=0.1), *beside],
    )
    with pytest.raises(CannotFollow, match="along what other friction, or a stop, holds"):
        machine.simulate(impacts=3, start=machine.state([0.0, 0.5], [0.0, 0.5]))


@pytest.mark.parametrize("hit", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_random_machines_move_as_in_many_digits(seed: int, hit: bool) -> None:
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 4))
    row: Any = int(random.integers(0, n)) if n < 2 or random.random() < 0.5 else (0, 1)
    force, static, belt, slope = random.uniform(0.05, 0.3, 4)
    motion: dict[str, Any] = {
        "amplitude": 0.3 * random.random(),
        "phase": random.uniform(-3.0, 3.0),
    }
    velocity = random.choice([0.0, belt])
    rubs = [
        DryFriction(
            row, force=share * force, static=share * (force + static), velocity=velocity, **motion
        )
        for share in (0.25, 0.75)
    ]
    one = DryFriction(row, force=force, static=force + static, velocity=velocity, **motion)
    more: list[Any] = []
    if random.random() < 0.6:  # another surface, as fast as one, or not: only one of both sticks
        away = {**motion, "velocity": velocity + random.choice([-0.2, 0.3])}
        more.append(DryFriction(row, force=0.1, static=0.15, slope=slope, **away))
    if random.random() < 0.5:
        more.append(SoftStop(0, offset=-0.2, stiffness=4.0, damping=0.3))
    if hit:
        r = random.choice([0.0, random.uniform(0.3, 0.9)])
        more.append(HardStop(n - 1, offset=-0.2, amplitude=0.2, restitution=r))
    chain = ImpactChain(
        masses=tuple(random.uniform(0.5, 2.0, n).tolist()),
        frequency=random.uniform(0.4, 1.6),
        harmonic_forces=random.normal(size=n),
        constant_forces=0.3 * random.normal(size=n) - [*[0.0] * (n - 1), 0.5 * hit],
        elements=[*rubs, *more],
    )
    place, velocities = random.normal(size=n), random.normal(size=n)
    place[-1] = 0.3 + abs(place[-1])
    for machine in (chain, chain.replace(elements=[one, *more])):
        found = moves_as_in_many_digits(machine, place, velocities, impacts=4, most=1e-10)
        assert found.events >= 2
    record = chain.simulate(impacts=4, start=chain.state(place, velocities))
    whole = machine.simulate(impacts=4, start=machine.state(place, velocities))
    assert len(record) == len(whole)
    apart = abs(record.states - whole.states).max(axis=1)
    assert (apart <= record.error + whole.error).all()
    assert record.energy_balance().error < 1e-12
