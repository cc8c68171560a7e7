"""Orbits of machines with friction at contacts: closed forms, many digits, maps, borders."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from dynkit import NoConvergence, continue_orbit, periodic_orbit
from dynkit.systems import DryFriction, HardStop, MatrixOscillator
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.testing import check_problem
from tests.impact.test_coulomb import beside_others, coupled, random_machine
from tests.impact_orbits.contracts import check_parameters
from tests.reference.itineraries import actual_error


def slider(
    frequency: float, restitution: float, amplitude: float, *, push: float = 0.5, **own: Any
) -> MatrixOscillator:
    """A mass on springs that hits a vibrating table, along which it slips."""
    drag = own.pop("drag", 0.1)
    return MatrixOscillator(
        M=np.diag([1.0, 1.25]),
        C=np.diag([drag, 0.0625]),
        K=np.diag([1.0, 0.25]),
        frequency=frequency,
        constant_forces=[0.0, -1.25],
        harmonic_forces=[push, 0.0],
        elements=[
            HardStop(1, restitution=restitution, amplitude=amplitude, name="table"),
            DryFriction(0, normal="table", name="rub", **own),
        ],
    )


MACHINES = {
    "impacts stop it": slider(2.1, 0.3, 0.8, coefficient=0.1),
    "impacts slow it down": slider(2.1, 0.3, 0.8, push=2.0, coefficient=0.05),
    "slips and sticks": slider(1.5, 0.0, 0.8, coefficient=0.3),
    "slips on a belt": slider(1.2, 0.0, 0.9, coefficient=0.3, static=0.4, velocity=0.6),
    "turns in contact": slider(
        1.2, 0.0, 0.9, push=1.0, drag=0.2, coefficient=0.2, static=0.3, velocity=0.2
    ),
    "chatters": slider(
        1.2, 0.4, 0.9, push=1.0, drag=0.2, coefficient=0.2, static=0.3, velocity=0.2
    ),
    "chatters and sticks": slider(1.5, 0.3, 0.8, coefficient=0.3),
}
CHATTERS = ("chatters", "chatters and sticks")


@cache
def orbit_of(name: str) -> Any:
    orbit = MACHINES[name].attractor(transient=1000, impacts=20).periodic_orbit()
    assert isinstance(orbit, ImpactOrbit)
    return orbit


# --- closed forms ---------------------------------------------------------------------------------


def belt(velocity: float, **own: Any) -> MatrixOscillator:
    """A block of weight 2 on a table, and on a spring of unit frequency beside a belt."""
    return MatrixOscillator(
        M=2.0 * np.eye(2),
        C=np.zeros((2, 2)),
        K=np.diag([2.0, 0.0]),
        frequency=1.0,
        constant_forces=[0.0, -2.0],
        elements=[
            HardStop(1, restitution=0.0, name="table"),
            DryFriction(0, normal="table", velocity=velocity, name="belt", **own),
        ],
    )


def test_a_belt_under_a_weight_has_its_stick_slip_cycle_in_closed_form() -> None:
    # it sticks for 2 a/v and slips for 2 (pi - atan(a/v)), a = (static - kinetic) N/k
    v, kinetic, static = 0.2, 0.5, 0.8
    block = belt(v, coefficient=kinetic, static=static)
    orbit = block.periodic_orbit(start=block.state([0.0, 0.0], [v, 0.0]))
    a = static - kinetic
    period = 2.0 * (math.pi - math.atan(a / v)) + 2.0 * a / v
    assert abs(orbit.period - period) <= orbit.error < 1e-11
    assert orbit.label == "P(1)"
    assert orbit.admissible
    assert not orbit.multipliers.any()
    assert orbit.observable("state[0]").max() == pytest.approx(static, abs=1e-14)
    problem = orbit.problem("belt.coefficient")
    check_problem(problem, orbit.unknowns, problem.values)
    branch = continue_orbit(orbit, "belt.coefficient", bounds=(0.45, 0.55))
    lasts = [branch.orbit(k).period for k in range(len(branch.parameter))]
    apart = static - branch.parameter
    periods = 2.0 * (math.pi - np.arctan(apart / v)) + 2.0 * apart / v
    assert lasts == pytest.approx(periods, abs=1e-11)
    assert branch.admissible.all()


W, MU, DRAG = 1.3, 0.05, 0.1


def bounced(velocity: float) -> MatrixOscillator:
    """A ball that bounces on a table, and moves along it on a spring, over a belt."""
    return MatrixOscillator(
        M=np.eye(2),
        C=np.diag([DRAG, 0.0]),
        K=np.diag([1.0, 0.0]),
        frequency=W,
        constant_forces=[0.0, -1.0],
        elements=[
            HardStop(1, restitution=0.3, amplitude=1.2, name="table"),
            DryFriction(0, normal="table", coefficient=MU, velocity=velocity, name="belt"),
        ],
    )


def kicked(velocity: float) -> tuple[float, float]:
    """Position, and velocity after an impact, of a response to kicks mu T, once a period T.

    Each impact changes the velocity of the ball by its weight times the period.
    """
    period = 2.0 * math.pi / W
    rate, turn = 0.5 * DRAG, math.sqrt(1.0 - 0.25 * DRAG**2)
    decay, c, s = math.exp(-rate * period), math.cos(turn * period), math.sin(turn * period) / turn
    moved = decay * np.array([[c + rate * s, s], [-s, c - rate * s]])
    kick = np.array([0.0, math.copysign(MU * period, velocity)])
    x, v = np.linalg.solve(np.eye(2) - moved, kick)
    return float(x), float(v)


def test_impacts_push_a_ball_as_far_as_its_periodic_response_says() -> None:
    ball = bounced(9.0)
    orbit: Any = ball.attractor(transient=1000, impacts=10).periodic_orbit()
    assert orbit.label == "P(1,1)"
    x, v = kicked(9.0)
    place, rate = orbit.sample([1e-300])
    assert abs(place[0, 0] - x) <= orbit.error < 1e-10
    assert abs(rate[0, 0] - v) <= orbit.error
    assert orbit.impulses == pytest.approx([2.0 * math.pi / W], abs=orbit.error)
    # multipliers along the table are those of the damped spring
    decay = math.exp(-0.5 * DRAG * orbit.period)
    assert (abs(abs(orbit.multipliers) - decay) < 1e-12).sum() == 2


def test_where_an_impact_begins_to_stop_the_slip_another_orbit_begins() -> None:
    # just after the impact the ball is as fast as the belt
    orbit = bounced(9.0).attractor(transient=1000, impacts=10).periodic_orbit()
    _, v = kicked(9.0)
    branch = continue_orbit(orbit, "belt.velocity", bounds=(0.5 * v, 9.0), largest_step=0.2)
    (found,) = branch.bifurcations
    assert str(found.kind) == "GR"
    assert "stick at impact" in found.touching
    assert abs(found.value - v) <= found.error < 1e-10
    assert (branch.admissible == (branch.parameter > v)).all()
    (other,) = found.switch()
    beyond = continue_orbit(other, "belt.velocity", bounds=(0.5 * v, 1.5 * v), largest_step=0.2)
    (back,) = beyond.bifurcations
    assert abs(back.value - v) <= back.error
    assert (beyond.admissible == (beyond.parameter < v))[abs(beyond.parameter - v) > 1e-9].all()
    last = beyond.orbit(int(np.argmin(beyond.parameter)))
    settled = last.system.attractor(transient=2000, impacts=1)
    apart = last.system.difference(settled.states[-1], last.states[0])
    assert abs(apart).max() <= last.error + settled.error


# --- many digits, the map -------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in MACHINES if name not in CHATTERS])
def test_orbits_are_those_of_many_digits(name: str) -> None:
    orbit = orbit_of(name)
    assert orbit.admissible
    assert actual_error(orbit) <= orbit.error < 1e-10


@pytest.mark.parametrize("name", [name for name in MACHINES if name not in CHATTERS])
def test_orbits_and_multipliers_are_those_of_the_map(name: str) -> None:
    orbit, system = orbit_of(name), MACHINES[name]
    settled = system.attractor(transient=1000, impacts=20)
    own = periodic_orbit(system, settled.states[-(settled.label.iterates or 1) :])
    wanted, found = (np.sort_complex(o.multipliers) for o in (own, orbit))
    assert abs(found - wanted).max() < 1e-10
    if not orbit.sticks:
        for state in orbit.states:
            apart = min(abs(system.difference(state, other)).max() for other in own.states)
            assert apart <= orbit.error + own.error


@pytest.mark.parametrize("name", MACHINES)
def test_the_contract_of_problems_holds(name: str) -> None:
    orbit = orbit_of(name)
    known = [n for n in ("rub.static", "rub.velocity") if orbit.system.parameters.get(n)]
    check_parameters(orbit, ("rub.coefficient", *known[:1]))


@pytest.mark.parametrize("name", CHATTERS)
def test_simulation_from_the_release_comes_back_to_it(name: str) -> None:
    orbit, system = orbit_of(name), MACHINES[name]
    assert orbit.sticks
    assert orbit.admissible
    (state,) = orbit.states
    record = system.simulate(impacts=300, start=system.impact_state(state))
    there, rate = record.sample([orbit.period])
    x, v = orbit.sample([orbit.period])
    error = 4.0 * orbit.error + orbit.chatter_error + 1e-12
    assert abs(np.append(there - x, rate - v)).max() < error < 1e-10


@pytest.mark.parametrize(
    ("seed", "restitution"),
    [
        (2, 0.6),
        (8, 0.6),
        (10, 0.6),
        (13, 0.6),
        (3, 0.0),
        (16, 0.0),
        *((s, None) for s in (1, 3, 7)),
    ],
)
def test_orbits_of_random_machines_are_their_long_motions(
    seed: int, restitution: float | None
) -> None:
    drawn = beside_others(seed) if restitution is None else random_machine(seed, restitution)
    machine, place, velocity = drawn
    settled = machine.attractor(transient=500, impacts=40, start=machine.state(place, velocity))
    orbit: Any = settled.periodic_orbit()
    assert isinstance(orbit, ImpactOrbit)
    assert orbit.admissible
    assert orbit.counts == settled.label.counts


# --- borders --------------------------------------------------------------------------------------


def test_contact_that_begins_with_stick_turns_into_one_that_slips_first() -> None:
    orbit = orbit_of("slips and sticks")
    branch = continue_orbit(orbit, "rub.coefficient", bounds=(0.27, 0.3))
    (found,) = branch.bifurcations
    assert "stick at impact" in found.touching
    assert (branch.admissible == (branch.parameter > found.value)).all()
    (other,) = found.switch()
    assert len(other._problem.itinerary) == len(orbit._problem.itinerary) + 1
    beyond = continue_orbit(other, "rub.coefficient", bounds=(0.27, 0.275))
    names = [name for b in beyond.bifurcations for name in b.touching if " " in name]
    assert sorted(names) == ["at once", "stick at impact"]
    same = beyond.bifurcations
    for own in same:
        assert abs(own.value - found.value) <= own.error + found.error < 1e-10
    off = abs(beyond.parameter - found.value) > found.error  # on the border rounding decides
    assert off.sum() >= len(beyond) - 1
    assert (beyond.admissible == (beyond.parameter < found.value))[off].all()
    back = [orbit for own in same for orbit in own.switch()]
    assert any(len(o._problem.itinerary) == len(orbit._problem.itinerary) for o in back)


def test_slip_that_no_longer_turns_is_a_crossing_sliding() -> None:
    machine = MACHINES["slips and sticks"].replace(**{"rub.coefficient": 0.222})
    orbit = machine.attractor(transient=1000, impacts=20).periodic_orbit()
    branch = continue_orbit(orbit, "rub.coefficient", bounds=(0.21, 0.222))
    (found,) = branch.bifurcations
    assert "crossing-sliding" in found.touching
    assert branch.admissible.all()
    assert 0.0 <= branch.parameter.min() - found.value < 1e-4
    # slip that ends there and slip that begins there are one: two events happen at once
    assert abs(np.diff(found.orbit._solution.event_phases)).min() < 1e-9


def test_masses_that_leave_the_outcome_open_are_refused_by_name() -> None:
    rod = coupled(0.3, 5.0).replace(harmonic_forces=[0.0, 3.0])
    with pytest.raises(NoConvergence, match="masses leave open what friction does at an impact"):
        rod.periodic_orbit(start=rod.state([0.0, 0.5], [0.0, 0.0]))
