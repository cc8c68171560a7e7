"""Dry friction: stick-slip on a belt, Den Hartog's oscillator, and friction beside stops."""

import re
from math import atan, pi, sqrt, tan
from typing import Any

import numpy as np
import pytest

import dynkit
from dynkit.analysis import LyapunovSpectrum
from dynkit.continuation.termination import Reason
from dynkit.core.validation import Array
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    ImpactDuffing,
    Jenkins,
    MatrixOscillator,
    SoftStop,
)
from dynkit.systems.impact.simulation.runs import trajectory_of
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.effort import is_thorough
from tests.impact.agreement import moves_as_in_many_digits, random_chain


def block(frequency: float = 1.0, drive: float = 0.0, **numbers: Any) -> ImpactChain:
    """One mass on a spring, without a dashpot, with friction."""
    return ImpactChain(
        masses=1,
        damping=0.0,
        frequency=frequency,
        harmonic_forces=[drive],
        elements=[DryFriction(0, **numbers)],
    )


@pytest.mark.parametrize(
    ("excess", "velocity"), [(0.3, 0.2), (0.05, 0.5), (1.0, 0.01), (2.0, -0.3)]
)
def test_stick_slip_on_a_belt_has_its_period_in_closed_form(excess: float, velocity: float) -> None:
    # K. Popp, P. Stelter, Phil. Trans. R. Soc. A 332 (1990) 89-105: unit mass and spring.
    slips = 2.0 * (pi - atan(excess / abs(velocity)))
    sticks = 2.0 * excess / abs(velocity)
    belt = block(2 * pi / (slips + sticks), force=0.5, static=0.5 + excess, velocity=velocity)
    record = belt.simulate(impacts=30, start=belt.state([0.0], [velocity]))
    events = record.events
    lasts = np.diff(events.time)[5:]
    stuck = [set(belt._automaton.regimes[m]) == {3} for m in events.mode[5:-1]]
    assert lasts == pytest.approx(np.where(stuck, sticks, slips), rel=1e-12)
    assert abs(record.states[10:] - record.states[9]).max() < 1e-12
    assert record.error[-1] < 1e-11
    times = np.linspace(events.time[5], record.time[-1], 300)
    speed = record.sample(times)[1][:, 0]
    assert (speed * np.sign(velocity) <= abs(velocity) + 1e-12).all()


@pytest.mark.parametrize(("frequency", "ratio"), [(0.6, 0.3), (1.5, 0.4), (2.2, 0.2), (0.8, 0.1)])
def test_den_hartogs_oscillator_has_his_amplitude(frequency: float, ratio: float) -> None:
    # J. P. Den Hartog, Trans. ASME 53 (1931) 107-115: motion without stops, static = kinetic.
    b = frequency
    factor, other = 1.0 / (1.0 - b * b), tan(pi / (2.0 * b)) / b
    amplitude = sqrt(factor**2 - (other * ratio) ** 2)
    attractor = block(b, 1.0, force=ratio).attractor(transient=3000, keep=10)
    events = attractor.record.events
    assert abs(events.position[:, 0]).max() == pytest.approx(amplitude, rel=1e-12)
    assert str(attractor.label) == "P(1,1)"
    assert attractor.label.stable
    apart = np.diff(np.unique(events.time.round(9)))
    assert apart == pytest.approx(np.full(len(apart), pi / b), rel=1e-8)  # no stops


def test_den_hartogs_oscillator_with_two_stops_a_cycle() -> None:
    # It rests while the spring and the force are less than the friction: the two are balanced where
    # it starts to slip, and the phase at which it halts is a root of the motion between.
    b, f = 0.35, 0.6
    oscillator = block(b, 1.0, force=f)
    record = oscillator.attractor(transient=300, keep=6).record
    events, run = record.events, record._run
    regimes = np.array([run.regimes[m][0] for m in events.mode])
    (sticks,) = np.nonzero(regimes[:-1] == 3)
    lasting = [k for k in sticks if events.time[k + 1] - events.time[k] > 1e-6]
    assert len(lasting) >= 10
    for k in lasting:
        begin, end = events.time[k], events.time[k + 1]
        force = np.sin(b * (end + record.start.phase / b)) - events.position[k, 0]
        assert abs(force) == pytest.approx(f, abs=1e-10)
        assert events.position[k + 1] == pytest.approx(events.position[k], abs=1e-14)
        assert end > begin
    x = record.sample(np.linspace(0.0, 2 * pi / b, 7))[0][:, 0]
    half = record.sample(np.linspace(0.0, 2 * pi / b, 7) + pi / b)[0][:, 0]
    assert half == pytest.approx(-x, abs=1e-9)  # symmetric


def test_without_friction_it_is_the_linear_oscillator() -> None:
    forced = ImpactChain(
        masses=2,
        frequency=0.7,
        harmonic_forces=[0.0, 1.0],
        elements=[DryFriction((0, 1), force=0.0), SoftStop(0, offset=-50.0, stiffness=1.0)],
    )
    plain = forced.replace(elements=forced.elements[1:])
    start = [0.3, -0.1], [0.2, 0.5]
    one, two = (m.simulate(impacts=20, start=m.state(*start)) for m in (forced, plain))
    assert abs(one.states - two.states).max() < 1e-12


def test_a_force_that_nothing_overcomes_holds() -> None:
    held = ImpactChain(
        masses=2,
        frequency=0.7,
        harmonic_forces=[0.0, 1.0],
        elements=[DryFriction(0, force=1e6, amplitude=0.2, phase=0.5, velocity=0.0)],
    )
    start = held.state([0.0, 0.0], [0.2 * 0.7 * np.cos(0.5), 0.0])
    record = held.simulate(impacts=20, start=start)
    x, v = record.sample(np.linspace(0.0, record.time[-1], 200))
    turn = 0.7 * np.linspace(0.0, record.time[-1], 200) - 0.5
    assert x[:, 0] == pytest.approx(0.2 * (np.sin(turn) + np.sin(0.5)), abs=1e-12)
    assert v[:, 0] == pytest.approx(0.14 * np.cos(turn), abs=1e-12)
    assert len(record.events) <= 1


def test_a_block_that_is_not_pulled_enough_stays() -> None:
    # between the kinetic and the static force it stays where it is, and from a state, too
    still = block(1.0, force=0.2, static=0.5)
    record = still.simulate(impacts=5, start=still.state([0.4], [0.0]))
    assert len(record) == 0
    assert record.ending.name == "CYCLE_ENDED"
    for start in (record.final, still.impact_state(np.array([0.4]))):
        x = still.simulate(impacts=5, start=start).sample(np.linspace(0.0, 100.0, 9))[0]
        assert abs(x - 0.4).max() < 1e-15
    gone = still.simulate(impacts=1, start=still.state([0.51], [0.0]))
    assert gone.position[0, 0] == pytest.approx(-0.11, abs=1e-12)
    # slides to the other side of the balance of spring and friction: x - 0.2 turns its sign
    record = still.simulate(impacts=3, start=still.state([0.6], [0.0]))
    assert record.events.position[-1, 0] == pytest.approx(-0.2, abs=1e-12)


@pytest.mark.parametrize("side", ["above", "below"])
def test_friction_is_the_same_from_both_sides(side: str) -> None:
    one = block(0.4, 0.6, force=0.2, static=0.3, velocity=0.1)
    element = DryFriction(0, force=0.2, static=0.3, velocity=0.1, side=side)
    other = one.replace(elements=[element])
    start = [0.3], [0.5]
    records = [m.simulate(impacts=30, start=m.state(*start)) for m in (one, other)]
    assert abs(records[0].states - records[1].states).max() < 1e-10


def test_an_impact_takes_what_sticks_along() -> None:
    # A block rides on a belt into a stop: thrown back, braked, brought back, until it lies there.
    velocity, force, r = 1.0, 0.4, 0.5
    ride = MatrixOscillator(
        M=[[1.0]],
        C=[[0.0]],
        K=[[0.0]],
        frequency=1.0,
        elements=[
            HardStop(0, offset=2.0, side="below", restitution=r),
            DryFriction(0, force=force, velocity=velocity),
        ],
    )
    start = ride.state([0.0], [velocity])
    assert start.closed == (1,)
    record = ride.simulate(impacts=6, start=start)
    back = 2.0 * velocity * r / force  # thrown back at r, and back at the stop as fast
    flights = back * r ** np.arange(5)
    assert record.time == pytest.approx(2.0 + np.append(0.0, np.cumsum(flights)), rel=1e-13)
    assert record.velocity[:, 0] == pytest.approx(-(r ** np.arange(1, 7)), rel=1e-12)
    rest = ride.simulate(impacts=1000, start=start)
    assert rest.ending.name == "CONTACT_FOR_EVER"
    assert rest.sticking[0, 0] == pytest.approx(2.0 + back / (1.0 - r), rel=1e-12)


def test_what_sticks_moves_on_through_impacts_elsewhere() -> None:
    chain = ImpactChain(
        masses=2,
        frequency=0.8,
        harmonic_forces=[0.0, 0.5],
        elements=[HardStop(1, offset=-0.2, restitution=0.7), DryFriction(0, force=5.0)],
    )
    record = chain.simulate(impacts=20, start=chain.state([0.1, 0.3], [0.0, 0.0]))
    assert (abs(record.position[:, 0] - 0.1) <= record.error).all()
    assert (abs(record.velocity[:, 0]) <= record.error).all()
    assert record.error[-1] < 1e-11
    assert record.final.closed == (1,)
    assert record.ambiguous is None
    again = chain.unpack_state(chain.pack_state(record.final))
    assert again.closed == (1,)
    jacobian = chain.jacobian(record.states[-1])
    assert np.isfinite(jacobian).all()


MACHINE = ImpactChain(
    masses=3,
    damping=0.05,
    frequency=0.7,
    harmonic_forces=[0.0, 0.0, 0.8],
    elements=[
        DryFriction(0, force=0.1, static=0.15, velocity=0.1, name="belt"),
        DryFriction((1, 2), force=0.05),
        HardStop(2, offset=-0.5, restitution=0.6),
    ],
)


def test_derivatives_through_friction_are_differences() -> None:
    record = MACHINE.simulate(impacts=60)
    assert len(record.events) > 500
    for state in record.states[20:30]:
        exact, size = MACHINE.jacobian(state), 1e-6
        for k in range(6):
            step = size * np.eye(6)[k]
            change = MACHINE.difference(MACHINE(state + step), MACHINE(state - step)) / (2 * size)
            assert abs(exact[:, k] - change).max() < 1e-6
    driven = block(0.6, 1.0, force=0.3, static=0.4)
    for state in driven.simulate(impacts=20).states[5:15]:
        exact, size = driven.jacobian(state), 1e-6
        for k in range(2):
            step = size * np.eye(2)[k]
            change = (driven(state + step) - driven(state - step)) / (2 * size)
            assert abs(exact[:, k] - change).max() < 1e-6


def test_derivatives_through_an_impact_that_breaks_what_sticks_are_differences() -> None:
    pair = ImpactChain(
        masses=2,
        frequency=0.9,
        damping=0.05,
        harmonic_forces=[0.0, 0.7],
        elements=[HardStop(1, offset=-0.1, restitution=0.6), DryFriction((0, 1), force=0.4)],
    )
    record = pair.simulate(impacts=60)
    run, checked = record._run, 0
    sticks = [3 in run.regimes[m] for m in run.segments.mode]
    broken = [
        k for k in range(20, 58) if any(sticks[i] for i in np.flatnonzero(run.segments.point == k))
    ]
    for k in broken[:8]:
        exact, size = pair.jacobian(record.states[k]), 1e-6
        for j in range(4):
            step = size * np.eye(4)[j]
            ends = [pair(record.states[k] + sign * step) for sign in (1, -1)]
            change = pair.difference(*ends) / (2 * size)
            assert abs(exact[:, j] - change).max() < 1e-6 * max(1.0, abs(exact).max())
        checked += 1
    assert checked >= 5


def test_what_is_measured_of_friction() -> None:
    attractor = MACHINE.attractor()
    iterates = attractor.label.iterates
    assert attractor.label.periods is not None
    assert iterates is not None
    spectrum = LyapunovSpectrum(attractor, iterations=200 * iterates)
    per_impact = np.log(abs(attractor.label.multiplier)) / iterates
    assert spectrum.exponents[0] == pytest.approx(per_impact, abs=1e-3)
    record = attractor.record
    moments = record.second_moments()
    times = np.linspace(0.0, record.time[-1], 400_001)
    x = record.sample(times)[0]
    mean = np.trapezoid(x, times, axis=0) / times[-1]
    assert abs(moments.sums.sum(axis=0) / times[-1] - mean).max() < 1e-6
    found = dynkit.sweep(
        MACHINE, "belt.velocity", [0.1, 0.2], transient=100, keep=5, progress=False
    )
    assert found.counts.tolist() == [5, 5]
    whole = MACHINE.simulate(impacts=30)
    rest = MACHINE.simulate(impacts=18, start=MACHINE.simulate(impacts=12).final)
    assert abs(rest.states - whole.states[12:]).max() < 1e-11


def test_many_sliders() -> None:
    sliders = [DryFriction(k, force=0.02, static=0.03, velocity=0.05) for k in range(6)]
    chain = ImpactChain(
        masses=6, damping=0.05, frequency=0.5, harmonic_forces=[0.0] * 5 + [1.0], elements=sliders
    )
    record = chain.simulate(impacts=40)
    assert len(record) == 40
    assert len(record.events) > 500
    energy = record.energy
    assert np.isfinite(energy).all()


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"force": -1.0}, "force must"),
        ({"force": 1.0, "static": 0.5}, "static must not be less than the force 1.0; got 0.5"),
        ({"force": 1.0, "static": np.nan}, "static must"),
        ({"force": 1.0, "velocity": np.inf}, "velocity must"),
        ({"force": 1.0, "slope": "a"}, "slope must"),
    ],
)
def test_numbers_that_are_none_are_refused(numbers: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DryFriction(0, **numbers)


def test_the_static_force_follows_the_force_where_it_is_not_given() -> None:
    both = block(1.0, force=0.5, velocity=0.5)
    assert "elements[0].static" not in both.parameters
    more = both.replace(**{"elements[0].force": 0.9})
    assert more.elements[0].most == 0.9
    with pytest.raises(ValueError, match=r"static must not be less than the force 0.9; got 0.6"):
        block(1.0, force=0.5, static=0.6).replace(**{"elements[0].force": 0.9})


def test_slopes_that_nothing_makes_up_for_are_refused() -> None:
    falling = block(1.0, force=0.5, velocity=0.5, slope=-0.05)
    with pytest.raises(ValueError, match=r"slope must .* than 0\.0, .*; got -0\.05 of Dry"):
        falling.simulate(impacts=5)


def test_the_limit_of_slopes_is_where_dashpots_just_make_up() -> None:
    # Along x_2 - x_1 one dashpot acts, and beside it those to the ground, in series.
    c, ground = 0.3, np.array([0.2, 0.6])
    row = np.array([-1.0, 1.0])
    given: Any = {"force": 0.5, "static": 0.5, "velocity": 0.5}
    machine = MatrixOscillator(
        M=np.eye(2),
        C=np.diag(ground) + c * np.outer(row, row),
        K=np.eye(2),
        frequency=1.0,
        harmonic_forces=[0.0, 1.0],
        elements=[DryFriction((0, 1), slope=-1.0, **given), SoftStop(0, stiffness=1.0)],
    )
    limit = -(c + 1.0 / float((1.0 / ground).sum()))
    with pytest.raises(ValueError, match="slope must not be less than") as refused:
        machine.simulate(impacts=5)
    told = re.search(r"than (\S+), .* got (\S+) of", str(refused.value))
    assert told is not None
    assert [float(part) for part in told.groups()] == pytest.approx([limit, -1.0], rel=1e-12)


def test_a_branch_ends_at_the_limit_of_the_slope() -> None:
    # Not with a refusal of the machine beyond.
    c = 0.2
    damped = MatrixOscillator(
        M=[[1.0]],
        C=[[c]],
        K=[[1.0]],
        frequency=0.8,
        harmonic_forces=[1.0],
        elements=[DryFriction(0, force=0.2)],
    )
    orbit: Any = damped.attractor(transient=200).periodic_orbit()
    branch = dynkit.continue_orbit(orbit, "elements[0].slope", bounds=(-1.5 * c, 0.1 * c))
    ending = branch.endings[0]
    assert ending.reason is Reason.NO_SOLUTION
    assert "slope must not be less than" in ending.message
    assert branch.parameter.min() == pytest.approx(-c, rel=1e-6)


def test_rounding_of_a_slider_at_its_end_refuses_no_point_of_a_branch() -> None:
    machine = ImpactChain(
        masses=(1.68605247127683,),
        damping=0.05,
        frequency=0.6616368261147623,
        harmonic_forces=[0.7422721257715262 - 0.6697987816683887j],
        constant_forces=[-0.19625923123892747],
        elements=[
            DryFriction(0, force=0.13439000926399977),
            Jenkins(0, stiffness=4.672000919112874, force=0.14698693063254453),
        ],
    )
    orbit = machine.attractor(transient=200).periodic_orbit()
    branch = dynkit.continue_orbit(orbit, "frequency", bounds=(0.56, 0.77))
    assert branch.admissible.all()
    assert {end.reason for end in branch.endings} == {Reason.BOUND}


# --- against many digits -------------------------------------------------------------------------


def random_machine(seed: int, *, hit: bool) -> tuple[ImpactChain, Array, Array]:
    """Two or three masses with friction, soft stops, and a hard one or none; where it starts."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 4))
    rows: list[Any] = [*range(n - 1), *((i, i + 1) for i in range(n - 1))]
    chosen = random.permutation(len(rows))[: int(random.integers(1, n))]
    elements: list[Any] = []
    for k in chosen:
        force = random.uniform(0.05, 0.6)
        elements.append(
            DryFriction(
                rows[k],
                force=force,
                static=random.choice([force, force * random.uniform(1.0, 1.8)]),
                velocity=random.choice([0.0, random.uniform(-0.5, 0.5)]),
                slope=random.choice([0.0, random.uniform(0.0, 0.3)]),
                amplitude=random.choice([0.0, random.uniform(0.0, 0.4)]),
                phase=random.uniform(-3.0, 3.0),
                side=str(random.choice(["above", "below"])),
            )
        )
    return random_chain(random, n, elements, hit=hit)


@pytest.mark.parametrize("hit", [False, True])
@pytest.mark.parametrize("seed", range(16 if is_thorough() else 10))
def test_random_machines_with_friction_move_as_in_many_digits(seed: int, hit: bool) -> None:
    chain, place, velocity = random_machine(seed, hit=hit)
    found = moves_as_in_many_digits(chain, place, velocity, impacts=5, most=1e-10)
    assert found.events >= 2


@pytest.mark.parametrize("forces", [[0.15], [0.2, 0.1]])
@pytest.mark.parametrize("noise", [1e-10, 1e-7])
def test_disturbed_motions_go_forward_in_time(forces: list[float], noise: float) -> None:
    """A mass that friction holds at a stop is let go: its gap is zero, also where disturbed."""
    stop = HardStop(0, offset=0.1, side="below", restitution=0.0)
    machine = ImpactChain(
        masses=1,
        damping=0.0,
        frequency=0.5,
        harmonic_forces=[1.0],
        elements=[stop, *(DryFriction(0, force=force) for force in forces)],
    )
    exact = trajectory_of(machine, machine.state(), 12, store=True).segments.begin
    for seed in range(1, 4):
        twin = trajectory_of(machine, machine.state(), 12, store=True, noise=noise, seed=seed)
        assert (np.diff(twin.segments.begin) >= 0.0).all()
        assert twin.time[-1] == pytest.approx(exact[-1], abs=100.0 * noise)


def test_a_motion_that_ends_where_friction_begins_to_slip_goes_on_in_its_direction() -> None:
    # the velocity of slip is zero there, but for rounding, and does not tell the direction
    machine = ImpactChain(
        masses=1,
        damping=1.0,
        frequency=1.0,
        harmonic_forces=[0.01],
        elements=[
            HardStop(0, offset=-5.0, restitution=0.5),
            DryFriction(0, force=0.3, static=0.4, velocity=0.5),
        ],
    )
    record = machine.simulate(impacts=1, start=machine.state([-0.5], [0.5]))
    assert record.final.closed == (1,)
    times = np.array([0.0, 1.0, 5.0, 10.0])
    on = machine.simulate(impacts=1, start=record.final)
    late = record._run.duration
    assert abs(on.sample(times)[0] - record.sample(times + late)[0]).max() < 1e-13


@pytest.mark.parametrize("seed", range(8))
def test_friction_holds_what_moves_by_rounding_alone(seed: int) -> None:
    # All is at rest against a stop while forces act: terms of the slip are far larger than itself.
    rng = np.random.default_rng(seed)
    force, gap, restitution, ground, frequency = rng.uniform(
        [0.2, 0, 0.1, 0.05, 0.5], [1, 0.1, 0.9, 0.6, 2]
    )
    system = MatrixOscillator(
        M=np.diag([1.0, 0.5]),
        C=0.1 * np.array([[1.0, -1.0], [-1.0, 1.0]]),
        K=[[1.0, -1.0], [-1.0, 1.0]],
        frequency=frequency,
        harmonic_forces=[force, -force],
        elements=[
            HardStop((0, 1), offset=-gap, restitution=restitution),
            DryFriction(1, force=ground),
        ],
    )
    place, phase = rng.uniform([-0.1, 0.0], [0.1, 6.28])
    exact = system.simulate(
        impacts=2, start=system.impact_state(np.array([place, 0.0, 0.0, phase]))
    )
    for velocity in (1e-17, -1e-17, 1e-16, -1e-16, 1e-15, -1e-15):
        start = system.impact_state(np.array([place, velocity, 0.0, phase]))
        record = system.simulate(impacts=2, start=start)
        assert record.time == pytest.approx(exact.time, abs=1e-10)
        assert record.position[-1] == pytest.approx(exact.position[-1], abs=1e-10)


@pytest.mark.parametrize("weight", [0.7, 0.75, 0.8, 0.9, 1.0])
def test_contact_beside_friction_that_sticks_lasts_for_ever(weight: float) -> None:
    # The masses join both rows: rounding must give what sticks no velocity of its own.
    machine = MatrixOscillator(
        M=[[0.95, 0.34], [0.34, 1.17]],
        C=[[0.2, 0.01], [0.01, 0.13]],
        K=[[2.3, -1.8], [-1.8, 2.45]],
        frequency=1.34,
        constant_forces=[-weight, -0.2],
        harmonic_forces=[0.3, 0.3],
        elements=[
            HardStop(0, restitution=0.5, name="floor"),
            DryFriction(1, force=3.0, amplitude=0.17),
        ],
    )
    record = machine.simulate(impacts=100, start=machine.state([0.2, 0.0], [0.0, 0.17 * 1.34]))
    assert record.ending is Ending.CONTACT_FOR_EVER
    force = record.observable("floor.contact_force", np.linspace(30.0, 60.0, 501))
    assert force.min() > 1e-3
    further = machine.simulate(impacts=100, start=record.final)
    assert (len(further), further.ending) == (0, Ending.CONTACT_FOR_EVER)


@pytest.mark.parametrize("cubic", [0.0, 1.0])
@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_what_sticks_at_a_start_bears_the_friction_that_slips(
    cubic: float, turn: int, way: float
) -> None:
    # spring 0.816, belt 0.2 against it: the rest is between the kinetic and the static force
    place = -way * (0.6 if cubic else 0.816)
    ground = DryFriction(0, force=0.5, static=0.75, name="ground")
    belt = DryFriction(0, force=0.2, velocity=-way, name="belt")
    shared: Any = {"frequency": 1.0, "elements": [ground, belt][::turn]}
    machine: Any = MatrixOscillator(M=[[1.0]], C=[[0.1]], K=[[1.0]], **shared)
    if cubic:
        machine = ImpactDuffing(damping=0.1, force=0.0, cubic=cubic, **shared)
    record = machine.simulate(impacts=1, start=machine.state([place]))
    assert not record.observable("ground.slip_velocity", np.linspace(0.0, 2.0, 9)).any()
