"""Where energy comes from and where it goes."""

import math
from typing import Any

import numpy as np
import pytest

from dynkit.systems import (
    BouncingBall,
    DryFriction,
    HardStop,
    ImpactChain,
    MatrixOscillator,
    PlayOscillator,
    SoftStop,
)
from tests.impact.test_friction import random_machine as with_friction
from tests.impact.test_rough_stops import random_machine as on_rough_ground


def free(elements: list[Any], push: float = 0.0) -> MatrixOscillator:
    """A mass of two that nothing but a constant force drives."""
    return MatrixOscillator(
        M=[[2.0]], C=[[0.0]], K=[[0.0]], frequency=1.0, constant_forces=[-push], elements=elements
    )


def test_an_impact_takes_what_its_law_says() -> None:
    ball = free([HardStop(0, restitution=0.6, name="floor")], push=3.0)
    record = ball.simulate(impacts=4, start=ball.state([0.0], [1.5]))
    balance = record.energy_balance()
    lost = 1.5**2 * (1.0 - 0.6**8)  # m u^2 / 2 of mass two
    assert balance.dissipated["floor"] == pytest.approx(lost, rel=1e-14)
    assert balance.work == pytest.approx(
        {"forces": 0.0, "damping": 0.0, "floor": -lost}, rel=1e-13, abs=1e-15
    )
    assert balance.change == pytest.approx(-lost, rel=1e-13)
    assert balance.error < 1e-13


def test_friction_takes_its_force_times_the_slip_and_a_belt_feeds() -> None:
    # On a belt of velocity 0.5 the mass is dragged from rest until it sticks: it gets m v^2 / 2,
    # and as much becomes heat.
    dragged = free([DryFriction(0, force=0.1, velocity=0.5, name="belt")])
    balance = dragged.simulate(impacts=3, start=dragged.state([0.0], [0.0])).energy_balance()
    assert balance.work["belt"] == pytest.approx(0.25, rel=1e-13)
    assert balance.dissipated["belt"] == pytest.approx(0.25, rel=1e-13)


def test_a_spring_gives_back_and_a_dashpot_does_not() -> None:
    elastic = SoftStop(0, offset=0.0, stiffness=8.0, name="pad")
    ball = free([elastic], push=3.0)
    balance = ball.simulate(impacts=5, start=ball.state([0.1], [0.0])).energy_balance()
    # What the spring holds as the last period ends is neither given back nor lost.
    assert abs(balance.dissipated["pad"]) < 1e-12
    lossy = ball.replace(elements=[SoftStop(0, stiffness=8.0, damping=0.5, name="pad")])
    start = lossy.state([0.1], [0.0])
    record = lossy.simulate(impacts=5, start=start)
    x, v = record.position[-1, 0], record.velocity[-1, 0]
    energy = v**2 + 3.0 * (x - 0.1) + 4.0 * min(x, 0.0) ** 2
    assert record.energy_balance().dissipated["pad"] == pytest.approx(-energy, rel=1e-11)


@pytest.mark.parametrize("frequency", [0.35, 0.408, 0.87])
def test_the_chain_balances(frequency: float) -> None:
    record = ImpactChain(frequency=frequency).simulate(impacts=400)
    balance = record.energy_balance()
    before, after = record.start, record.energy[-1]
    chain = ImpactChain(frequency=frequency)
    kinetic = 0.5 * before.velocity @ chain.mass @ before.velocity
    elastic = 0.5 * before.position @ chain.stiffness @ before.position
    assert balance.change == pytest.approx(after - kinetic - elastic, abs=1e-13)
    assert min(balance.dissipated.values()) > 0.0
    assert sum(balance.work.values()) == pytest.approx(balance.change, abs=balance.error)
    assert balance.error < 1e-12
    # each impact takes (1 - r^2)/r^2 of the energy with which its mass leaves the table
    if not len(record.sticking):
        r = chain.restitution
        lost = 0.5 * (1.0 / r**2 - 1.0) * (record.relative_velocity**2).sum() * chain.mass[-1, -1]
        assert balance.dissipated["table"] == pytest.approx(lost, rel=1e-12)


@pytest.mark.parametrize("restitution", [0.05, 0.2, 0.4])
def test_a_motion_that_starts_among_left_out_bounces_balances(restitution: float) -> None:
    chain = ImpactChain(masses=1, frequency=0.5, restitution=restitution)
    run = chain.simulate(impacts=200)
    (chattering,) = np.nonzero(run.relative_velocity < 1e-5)
    assert len(chattering) >= 3
    for last in chattering[:-1].tolist():
        record = chain.attractor(transient=last + 1, impacts=5).record
        balance = record.energy_balance()
        assert record.start.relative_velocity == run.relative_velocity[last]
        assert balance.error < 1e-12 * max(map(abs, balance.work.values()))


def test_special_oscillators_balance() -> None:
    for system in (
        PlayOscillator(play=1.0, amplitude=0.2, frequency=1.0, restitution=0.5),
        BouncingBall(frequency=1.0, amplitude=2.0, restitution=0.5),
    ):
        balance = system.simulate(impacts=100).energy_balance()
        lost = sum(balance.dissipated.values())
        assert lost > 0.0
        assert balance.error < 1e-12 * max(lost, 1.0)


@pytest.mark.parametrize("machine", [with_friction, on_rough_ground])
@pytest.mark.parametrize("seed", range(12))
def test_random_machines_balance(machine: Any, seed: int) -> None:
    given = {"hit": seed % 2 == 0} if machine is with_friction else {}
    chain, place, velocity = machine(seed, **given)
    record = chain.simulate(impacts=10, start=chain.state(place, velocity))
    if not len(record):
        return
    balance = record.energy_balance()
    size = sum(map(abs, balance.work.values())) + abs(balance.change)
    assert balance.error < 1e-12 * size
    lost = np.array(list(balance.dissipated.values()))
    assert lost.min() > -1e-12 * size
    assert math.isfinite(lost.sum())


def test_a_record_without_an_impact_has_no_balance() -> None:
    rest = free([HardStop(0, offset=-1.0)])
    with pytest.raises(ValueError, match="record must hold an impact after its start"):
        rest.simulate(impacts=3, start=rest.state([0.0], [0.0])).energy_balance()
