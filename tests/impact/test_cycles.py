"""Machines that nothing drives: their section is where friction halts, or a soft stop is met."""

import pickle
from math import atan, exp, pi, sqrt
from typing import Any

import numpy as np
import pytest
from mpmath import mp

import dynkit
from dynkit.analysis import LyapunovSpectrum
from dynkit.core.no_motion import NoCrossing
from dynkit.systems import DryFriction, HardStop, ImpactChain, Jenkins, SoftStop
from dynkit.systems.impact.simulation.trajectory import Ending
from dynkit.testing import check_name, map_checks, parameter_derivatives_are_right
from tests.reference.friction import STICK
from tests.reference.soft_stops import DIGITS, SoftStopReference
from tests.validation.machines import compared


def belt(frequency: float = 1.0, **numbers: float) -> ImpactChain:
    """A unit mass on a unit spring on a belt."""
    given: dict[str, Any] = {"force": 0.5, "static": 0.8, "velocity": 0.2, "name": "belt"}
    return ImpactChain(
        masses=1, damping=0.0, frequency=frequency, elements=[DryFriction(0, **(given | numbers))]
    )


@pytest.mark.parametrize(
    ("force", "static", "velocity"),
    [(0.5, 0.8, 0.2), (0.3, 0.35, 0.01), (0.1, 1.0, 0.4), (0.5, 0.8, -0.2)],
)
def test_a_belt_has_its_period_in_closed_form(force: float, static: float, velocity: float) -> None:
    a, v = static - force, abs(velocity)
    period = 2.0 * (pi - atan(a / v)) + 2.0 * a / v
    machine = belt(force=force, static=static, velocity=velocity)
    label = machine.attractor(transient=20, keep=20).label
    assert str(label) == "P(1)"
    assert label.stable
    assert label.period == pytest.approx(period, rel=1e-12)
    assert label.period is not None
    assert label.period_error is not None
    assert abs(label.period - period) <= label.period_error < 1e-11
    assert label.counts == {"belt.sticks": 1}


def test_the_frequency_is_of_no_importance() -> None:
    found = [belt(frequency).attractor(transient=20, keep=20) for frequency in (0.03, 1.0, 40.0)]
    for other in found[1:]:
        assert other.states.tobytes() == found[0].states.tobytes()
        assert other.label.period == found[0].label.period


@pytest.mark.parametrize("stiffness", [0.5, 3.0, 99.0])
def test_a_bilinear_oscillator_has_its_period_in_closed_form(stiffness: float) -> None:
    free = ImpactChain(
        masses=1,
        damping=0.0,
        frequency=1.0,
        elements=[SoftStop(0, stiffness=stiffness, name="stop")],
    )
    label = free.attractor(start=free.state([0.3], [0.7]), transient=5, keep=20).label
    period = pi + pi / sqrt(1.0 + stiffness)
    assert str(label) == "P(1)"
    assert label.stable is None  # one of a family
    assert label.period == pytest.approx(period, rel=1e-15)
    assert abs((label.period or 0.0) - period) <= (label.period_error or 0.0)
    assert label.counts == {"stop.presses": 1}


def test_coulombs_friction_takes_as_much_in_each_half_cycle() -> None:
    # x falls by 2 force in each half cycle (stiffness one), until the spring is weaker than it.
    force, start = 0.06, 1.0
    ground = ImpactChain(
        masses=1, damping=0.0, frequency=1.0, elements=[DryFriction(0, force=force)]
    )
    record = ground.simulate(impacts=100, start=ground.state([start], [0.0]))
    assert record.ending.name == "CYCLE_ENDED"
    turns = np.arange(1, len(record) + 1)
    expected = (-1.0) ** turns * (start - 2.0 * force * turns)
    assert record.position[:, 0] == pytest.approx(expected, abs=1e-14)
    assert record.time == pytest.approx(pi * turns, rel=1e-14)
    assert abs(expected[-1]) <= force < abs(expected[-2])
    with pytest.raises(NoCrossing, match="does not return to its section"):
        ground(record.states[-1])
    assert ground.attractor().label.kind.value == "no impacts"


MACHINE = ImpactChain(
    masses=3,
    damping=0.02,
    frequency=1.0,
    elements=[
        DryFriction(0, force=0.4, static=0.8, velocity=0.05, name="belt"),
        DryFriction((1, 2), force=0.01),
        SoftStop(2, offset=0.3, stiffness=5.0, damping=0.3, side="below", name="pad"),
    ],
)


def test_cycles_of_a_machine_with_several_elements() -> None:
    attractor = MACHINE.attractor(transient=600, keep=60)
    label = attractor.label
    assert label.kind.value == "periodic"
    assert label.periods is None
    counts = label.counts or {}
    assert counts["belt.sticks"] == label.iterates
    record, n = attractor.record, label.iterates or 0
    assert np.diff(record.time)[-n:].sum() == pytest.approx(label.period, rel=1e-10)
    again = pickle.loads(pickle.dumps(label))
    assert again.period == label.period
    assert label.harmonics is not None
    per_crossing = np.log(abs(label.multiplier)) / n
    spectrum = LyapunovSpectrum(attractor, iterations=200 * n)
    assert spectrum.exponents[0] == pytest.approx(per_crossing, abs=1e-3)
    orbit = attractor.periodic_orbit()
    assert abs(orbit.multipliers[0]) == pytest.approx(label.multiplier, abs=1e-6)
    assert record.energy_balance().error < 1e-11


def test_it_goes_on_from_where_it_was() -> None:
    whole = MACHINE.simulate(impacts=30)
    rest = MACHINE.simulate(impacts=18, start=MACHINE.simulate(impacts=12).final)
    assert abs(rest.states - whole.states[12:]).max() < 1e-11
    assert abs(rest.time - (whole.time[12:] - whole.time[11])).max() < 1e-11
    assert (rest.error < 1e-10).all()


@pytest.mark.parametrize("check", map_checks, ids=check_name)
@pytest.mark.parametrize("elements", [MACHINE.elements, MACHINE.elements[2:]])
def test_its_map_conforms(check: Any, elements: Any) -> None:
    if check is parameter_derivatives_are_right:  # what begins to move drives it: another section
        return
    machine = MACHINE.replace(elements=elements)
    record = machine.simulate(impacts=13, start=machine.state([0.9, 0.2, 1.0]))
    check(machine, record.states[-3:])


def test_derivatives_are_differences() -> None:
    for state in MACHINE.simulate(impacts=20).states[10:13]:
        exact, size = MACHINE.jacobian(state), 1e-6
        for k in range(5):
            step = size * np.eye(5)[k]
            change = (MACHINE(state + step) - MACHINE(state - step)) / (2 * size)
            assert abs(exact[:, k] - change).max() < 1e-6


@pytest.mark.parametrize("seed", range(6))
def test_random_cycles_are_those_of_many_digits(seed: int) -> None:
    random = np.random.default_rng(seed)
    force = random.uniform(0.1, 0.5, 2)
    chain = ImpactChain(
        masses=tuple(random.uniform(0.5, 2.0, 2).tolist()),
        damping=random.choice([0.0, 0.05]),
        frequency=1.0,
        elements=[
            DryFriction(
                0,
                force=force[0],
                static=force[0] * random.uniform(1.0, 2.0),
                velocity=random.uniform(-0.2, 0.2),
            ),
            SoftStop(1, offset=0.1, stiffness=4.0, damping=random.choice([0.0, 0.3])),
        ],
    )
    start = np.concatenate([random.normal(size=2), random.normal(size=2)])
    record = chain.simulate(impacts=6, start=chain.state(start[:2], start[2:]))
    with mp.workdps(DIGITS):
        reference = SoftStopReference(chain, 0.003)
        reference.motion(start, 1, (), float(record._run.duration) + 0.01)
        halts, slips = [], True
        for time, _, way in reference.switches:
            if slips:  # to stick, or to turn
                halts.append(float(time))
            slips = way != STICK
    assert record.time == pytest.approx(np.array(halts[: len(record)]), rel=1e-12)


def test_the_error_of_a_period_covers_how_far_a_motion_is_from_its_cycle() -> None:
    settled = MACHINE.attractor(transient=600, keep=20).label
    for transient in (5, 20, 60):
        label = MACHINE.attractor(transient=transient, keep=20).label
        if label.iterates == settled.iterates:
            assert settled.period is not None
            assert abs((label.period or 0.0) - settled.period) <= (label.period_error or 0.0)


def test_sweeps_cross_from_cycles_to_steady_sliding() -> None:
    slow = belt(velocity=0.1).replace(damping=0.2)
    found = dynkit.sweep(
        slow, "belt.velocity", [0.05, 0.1, 5.0], transient=50, keep=5, progress=False
    )
    assert found.counts.tolist() == [5, 5, 0]
    assert [label.name for label in found.labels] == ["P(1)", "P(1)", "no impacts"]
    # What slides steadily rests where the spring is as strong as friction.
    sliding = slow.replace(**{"belt.velocity": 5.0}).simulate(impacts=5)
    assert sliding.sample([200.0])[0] == pytest.approx(np.array([[0.5]]), abs=1e-8)


def test_a_motion_that_ends_is_no_cycle_and_says_why() -> None:
    sliding = belt(static=0.5).replace(damping=0.1)
    motion = sliding.attractor(start=sliding.state([0.5], [0.2]), transient=0)
    assert motion.ending is Ending.CYCLE_ENDED
    with pytest.raises(dynkit.NoConvergence, match=f"but ends: {Ending.CYCLE_ENDED.value}"):
        motion.periodic_orbit()


def test_a_branch_of_cycles_does_not_begin_to_drive_the_machine() -> None:
    cycle = belt().attractor(transient=20, keep=20).periodic_orbit()
    with pytest.raises(ValueError, match=r"belt\.amplitude must stay 0\.0 on a branch of cycles"):
        dynkit.continue_orbit(cycle, "belt.amplitude", bounds=(0.0, 0.1))


def test_a_damped_cycle_decays_by_its_dashpot() -> None:
    # Through zero to zero, two half cycles of different frequencies: the speed falls by each.
    c, k = 0.1, 3.0
    damped = ImpactChain(
        masses=1, damping=c, frequency=1.0, elements=[SoftStop(0, stiffness=k, name="stop")]
    )
    record = damped.simulate(impacts=10, start=damped.state([0.0], [-1.0]))
    soft, hard = sqrt(1.0 - c * c / 4.0), sqrt(1.0 + k - c * c / 4.0)
    per_cycle = exp(-0.5 * c * (pi / soft + pi / hard))
    speeds = -(per_cycle ** np.arange(1, 11))
    assert record.velocity[:, 0] == pytest.approx(speeds, rel=1e-12)
    assert damped.jacobian(record.states[0]) == pytest.approx(np.array([[per_cycle]]), rel=1e-12)
    assert damped(np.array([-0.4])) == pytest.approx([-0.4 * per_cycle], rel=1e-13)


def test_what_is_driven_or_hit_keeps_its_section() -> None:
    driven = belt().replace(harmonic_forces=[1e-9])
    assert driven.simulate(impacts=3).time == pytest.approx(2 * pi * np.arange(1, 4))
    moved = belt(amplitude=1e-9)
    assert moved.simulate(impacts=3).time == pytest.approx(2 * pi * np.arange(1, 4))
    hit = ImpactChain(
        masses=2,
        frequency=1.0,
        elements=[HardStop(1, restitution=0.9), DryFriction(0, force=0.01)],
    )
    record = hit.simulate(impacts=3)
    assert len(record.states[0]) == 4
    assert not record.element.any()


@pytest.mark.parametrize("stiffness", [1.0, 2.0])
@pytest.mark.parametrize("first", ["friction", "slider"])
def test_friction_that_halts_with_a_slider_is_on_its_section(stiffness: float, first: str) -> None:
    """Both are along one row over one belt: they halt at the same time, and that is one event."""
    own = [
        DryFriction(0, force=0.2, velocity=0.2),
        Jenkins(0, stiffness=stiffness, force=0.1, velocity=0.2),
    ]
    machine = ImpactChain(
        masses=1,
        damping=0.0,
        frequency=1.0,
        constant_forces=[0.3],
        elements=own if first == "friction" else own[::-1],
    )
    found = compared(machine, machine.state([1.5], [0.4]))
    assert not found.wrong
    assert len(found.states) > 1
    assert all(true <= claimed for true, claimed in (*found.states, *found.times))
