"""Sliders at their limits that ride on what sticks, and what they do as that breaks away.

Margin, rate and acceleration of the slider are zero there: the third derivative decides.
"""

from typing import Any

import numpy as np
import pytest

from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, ImpactChain, Jenkins, MatrixOscillator, SoftStop
from tests.impact.disguised import disguised
from tests.validation.machines import compared

FRICTION, FORCE, STIFFNESS, DRIVE = 0.3, 0.2, 2.0, 0.8
AWAY = np.arcsin((FRICTION + FORCE) / DRIVE)
BACK = np.arcsin((FRICTION - FORCE) / DRIVE)


def block(*beside: Any, row: float = 1.0, first: bool = True, side: str = "above") -> Any:
    """A unit mass without a spring on friction and a slider, and masses that it does not touch."""
    n = 1 + len(beside)
    joint = Jenkins(
        (row, *np.zeros(n - 1)), stiffness=STIFFNESS / row**2, force=FORCE / abs(row), side=side
    )
    pair = [DryFriction(0, force=FRICTION), joint]
    return MatrixOscillator(
        M=np.eye(n),
        C=np.zeros((n, n)),
        K=np.diag([0.0, *(2500.0 for _ in beside)]),
        frequency=1.0,
        harmonic_forces=[DRIVE, *(0.0 for _ in beside)],
        elements=[*(pair if first else pair[::-1]), *beside],
    )


def started(machine: Any, row: float, phase: float) -> Any:
    """At rest at zero, the slider as far back as it may be."""
    still = np.zeros(machine.degrees_of_freedom)
    moving = np.ones(len(still))
    moving[0] = 0.0
    return machine.state(still, moving, phase=phase, sliders=[-FORCE / STIFFNESS * row])


KINDS = [(1.0, True, "above"), (-2.0, True, "above"), (1.0, False, "below"), (0.5, False, "above")]


ENGINES = pytest.mark.parametrize("engine", [lambda machine: machine, disguised])


@ENGINES
@pytest.mark.parametrize(("row", "first", "side"), KINDS)
def test_it_slides_at_once_where_friction_breaks_away_outwards(
    row: float, first: bool, side: str, engine: Any
) -> None:
    machine = engine(block(row=row, first=first, side=side))
    record = machine.simulate(impacts=1, start=started(machine, row, 0.0))
    events = record.events
    assert events.time[:2] == pytest.approx([AWAY, AWAY], abs=1e-14)
    assert events.time[0] == events.time[1]
    t = np.linspace(AWAY, 2.0, 20)
    s = t - AWAY
    free = DRIVE * (np.sin(AWAY) - np.sin(t) + np.cos(AWAY) * s)
    x = free - (FRICTION + FORCE) * s**2 / 2.0
    assert record.sample(t)[0][:, 0] == pytest.approx(x, abs=1e-14)
    assert record.sample_sliders(t)[:, 0] == pytest.approx(row * (x - FORCE / STIFFNESS), abs=1e-14)


@ENGINES
@pytest.mark.parametrize(("row", "first", "side"), KINDS)
def test_it_sticks_where_friction_breaks_away_inwards(
    row: float, first: bool, side: str, engine: Any
) -> None:
    machine = engine(block(row=row, first=first, side=side))
    record = machine.simulate(impacts=1, start=started(machine, row, np.pi))
    assert record.events.time[0] == pytest.approx(BACK, abs=1e-14)
    assert record.events.time[1] > BACK + 0.1
    # x'' + k x = -h sin t + F - f, as it was at rest at zero
    w, level = STIFFNESS**0.5, (FRICTION - FORCE) / STIFFNESS
    swing = -DRIVE / (STIFFNESS - 1.0)
    t = np.linspace(BACK, float(record.events.time[1]), 20)
    a, b = -level - swing * np.sin(BACK), -swing * np.cos(BACK) / w
    s = w * (t - BACK)
    x = level + swing * np.sin(t) + a * np.cos(s) + b * np.sin(s)
    assert record.sample(t)[0][:, 0] == pytest.approx(x, abs=1e-14)
    still: Array = np.full(20, -FORCE / STIFFNESS * row)
    assert record.sample_sliders(t)[:, 0] == pytest.approx(still, abs=1e-14)


def test_it_is_at_its_limit_however_much_happens_elsewhere() -> None:
    # Each switch of the soft stop changes the basis, and rounds all coordinates anew.
    machine = block(SoftStop(1, offset=0.01, stiffness=500.0, side="below"))
    events = machine.simulate(impacts=1, start=started(machine, 1.0, 0.0)).events
    before = events.time < AWAY - 1e-9
    assert before.sum() > 10
    assert events.time[~before][:2] == pytest.approx([AWAY, AWAY], abs=1e-12)
    assert events.time[~before][0] == events.time[~before][1]


CHAINS: dict[str, list[Any]] = {
    "on two that stick": [
        DryFriction(0, force=0.2),
        DryFriction((0, 1), force=0.1),
        Jenkins((0.5, 1.0), stiffness=2.0, force=0.1),
    ],
    "two in series": [
        Jenkins((0, 1), stiffness=1.0, force=0.1),
        DryFriction(0, force=0.15, velocity=0.125),
        DryFriction(1, force=0.2, velocity=0.125),
        Jenkins(1, stiffness=3.0, force=0.1, velocity=0.125, side="below"),
    ],
    "beside a stop": [
        HardStop(1, offset=-0.2, restitution=0.5),
        Jenkins(0, stiffness=2.0, force=0.05),
        Jenkins(0, stiffness=1.0, force=0.15),
        DryFriction(0, force=0.3, slope=0.1),
    ],
}


@pytest.mark.parametrize("name", CHAINS)
def test_regimes_are_those_of_the_exact_motion(name: str) -> None:
    chain = ImpactChain(
        masses=2, damping=0.05, frequency=0.7, harmonic_forces=[0.6, 0.9j], elements=CHAINS[name]
    )
    start = chain.state([0.3, 0.5], [0.2, -0.4], phase=0.4)
    found = compared(chain, start, impacts=6)
    assert not found.wrong
    assert not found.ended
    assert found.events > 20
    assert all(true <= claimed for true, claimed in (*found.states, *found.times))


def test_a_mass_that_friction_holds_at_a_stop_leaves_it() -> None:
    # gap, rate and acceleration are zero as friction breaks away, the sum of forces that cancel
    stops = [
        HardStop(0, offset=o, side=s, restitution=0.0) for o, s in [(-0.1, "above"), (0.1, "below")]
    ]
    block = ImpactChain(
        masses=1,
        damping=0.05,
        frequency=0.7,
        harmonic_forces=[0.8],
        elements=[*stops, Jenkins(0, stiffness=2.0, force=0.1), DryFriction(0, force=0.1)],
    )
    assert block.simulate(impacts=12).error.max() < 1e-12
    found = compared(block, block.state(), impacts=12)
    assert not found.wrong
    assert not found.ended
    assert found.events > 40
    assert all(true <= claimed for true, claimed in (*found.states, *found.times))
