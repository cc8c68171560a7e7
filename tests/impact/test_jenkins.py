"""Springs in series with sliders: hysteresis loops, Iwan's models, and machines that have them."""

from math import pi
from typing import Any

import numpy as np
import pytest
from mpmath import mp

import dynkit
from dynkit.analysis import LyapunovSpectrum
from dynkit.core.validation import Array
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    Jenkins,
    MatrixOscillator,
    SoftStop,
    iwan,
)
from tests.effort import is_thorough
from tests.impact.agreement import random_chain
from tests.reference.soft_stops import DIGITS, SoftStopReference
from tests.validation.machines import compared


def block(*elements: Any, frequency: float = 0.8, drive: float = 0.5, **more: Any) -> ImpactChain:
    """One mass on a spring, with elements."""
    given = {"masses": 1, "damping": 0.05, "harmonic_forces": [drive], **more}
    return ImpactChain(frequency=frequency, elements=list(elements), **given)


JOINT = Jenkins(0, stiffness=2.0, force=0.3, name="joint")
MACHINE = ImpactChain(
    masses=3,
    damping=0.05,
    frequency=0.7,
    harmonic_forces=[0.0, 0.0, 0.8],
    elements=[
        Jenkins(0, stiffness=1.5, force=0.1, velocity=0.1, name="belt"),
        Jenkins((1, 2), stiffness=3.0, force=0.1, name="joint"),
        Jenkins((1, 2), stiffness=1.0, force=0.15),
        HardStop(2, offset=-0.5, restitution=0.6),
    ],
)


# --- closed forms --------------------------------------------------------------------------------


@pytest.mark.parametrize("joint", [[JOINT, Jenkins(0, stiffness=1.0, force=0.5)], None])
def test_a_hysteresis_loop_is_masings(joint: list[Jenkins] | None) -> None:
    # G. Masing, Proc. 2nd Int. Congress for Applied Mechanics, Zurich 1926, 332-335: a branch of
    # the loop is the virgin curve, twice as large, from where the motion turned.
    joint = joint or iwan(0, stiffness=3.0, force=0.8, elements=5, exponent=-0.4, macroslip=0.2)
    swing, w = 0.8, 0.6
    moved = MatrixOscillator(
        M=[[1.0]],
        C=[[0.0]],
        K=[[0.0]],
        frequency=w,
        elements=[DryFriction(0, force=1e6, amplitude=swing), *joint],
    )
    record = moved.simulate(impacts=3, start=moved.state([0.0], [swing * w]))
    times = np.linspace(2 * pi / w, 4 * pi / w, 401)
    springs, forces = np.array([[each.stiffness, each.force] for each in joint]).T
    y = record.sample(times)[0]
    found = (y - record.sample_sliders(times)) @ springs

    def virgin(x: Array) -> Array:
        out: Array = np.minimum(np.outer(x, springs), forces).sum(axis=1)
        return out

    most = virgin(np.array([swing]))
    place = swing * np.sin(w * times)
    up, down = -most + 2 * virgin((place + swing) / 2), most - 2 * virgin((swing - place) / 2)
    assert found == pytest.approx(np.where(np.cos(w * times) > 0.0, up, down), abs=1e-12)
    # What slides on the virgin curve, in five half loops, and on the last quarter of one.
    first, last = (np.maximum(swing - n * forces / springs, 0.0) for n in (1, 2))
    lost = list(record.energy_balance().dissipated.values())[2:]
    assert lost == pytest.approx(forces * (11 * first + last), abs=1e-12)


def test_a_free_decay_in_closed_form() -> None:
    # Unit mass on one Jenkins element only: it slides under the force f until it halts, and then
    # swings on the spring for ever, about where the slider is.
    k, f, speed = 4.0, 0.5, 1.0
    free = MatrixOscillator(
        M=[[1.0]],
        C=[[0.0]],
        K=[[0.0]],
        frequency=1.0,
        elements=[Jenkins(0, stiffness=k, force=f)],
    )
    record = free.simulate(impacts=4, start=free.state([0.0], [speed]))
    first = np.arcsin(f / (speed * k**0.5)) / k**0.5
    left = (speed**2 - f**2 / k) ** 0.5
    assert record.events.time == pytest.approx([first, first + left / f], abs=1e-14)
    far = f / k + left**2 / (2 * f)
    assert record.events.position[:, 0] == pytest.approx([f / k, far], abs=1e-14)
    t = np.linspace(first + left / f, record.time[-1], 50)
    swing = far - f / k + f / k * np.cos(k**0.5 * (t - first - left / f))
    assert record.sample(t)[0][:, 0] == pytest.approx(swing, abs=1e-13)
    assert record.sliders[:, 0] == pytest.approx(np.full(4, far - f / k), abs=1e-14)


def test_sliders_along_one_row_share_their_changes_of_basis() -> None:
    joint = iwan(0, stiffness=2.0, force=0.5, elements=30)
    machine = ImpactChain(masses=1, frequency=0.8, harmonic_forces=[0.8], elements=joint)
    record = machine.simulate(impacts=4)
    automaton = machine._automaton
    # sliders that slide at the same time do so in any order
    assert len(automaton._rows) == len(automaton._changes)
    assert 2 * len(automaton.modes) < 180
    fewer = machine.replace(elements=iwan(0, stiffness=2.0, force=0.5, elements=29))
    # more elements change the joint by their number to the power -2
    apart = abs(fewer.simulate(impacts=4).position - record.position).max()
    assert 0.0 < apart < 1e-4


def test_a_slider_that_nothing_moves_is_a_spring() -> None:
    spring = block(Jenkins(0, stiffness=2.0, force=1e9))
    linear = MatrixOscillator(
        M=[[1.0]],
        C=spring.damping_matrix,
        K=spring.stiffness + 2.0,
        frequency=0.8,
        harmonic_forces=[0.5],
        elements=[SoftStop(0, offset=-50.0, stiffness=1.0)],
    )
    start = [0.7], [-0.2]
    one, two = (m.simulate(impacts=20, start=m.state(*start)) for m in (spring, linear))
    assert abs(one.states[:, :2] - two.states).max() < 1e-13
    assert not len(one.events)
    assert (one.sliders == 0.0).all()


def test_stiff_springs_tend_to_dry_friction() -> None:
    # Where the motion turns, the force turns over the distance 2 f/k: the work differs by as much
    # as 1/k, the time that this takes by its root.
    rigid = block(DryFriction(0, force=0.3)).simulate(impacts=8)
    apart = []
    for k in (1e3, 1e4, 1e5, 1e6):
        soft = block(Jenkins(0, stiffness=k, force=0.3))
        record = soft.simulate(impacts=8, start=soft.state(rigid.start.position))
        apart.append(abs(record.position - rigid.position).max())
    rates = np.log10(np.array(apart[:-1]) / apart[1:])
    assert rates == pytest.approx(np.full(3, 0.5), abs=0.01)


def test_sums_of_iwans_models_are_exact() -> None:
    numbers: dict[str, Any]
    for numbers in (
        {},
        {"exponent": -0.6, "ratio": 1.5},
        {"exponent": -0.3, "macroslip": 0.7, "elements": 25},
    ):
        given: dict[str, Any] = {"name": "joint", "velocity": 0.1, **numbers}
        joint = iwan(0, stiffness=5.0, force=2.0, **given)
        assert sum(each.stiffness for each in joint) == pytest.approx(5.0, rel=1e-14)
        assert sum(each.force for each in joint) == pytest.approx(2.0, rel=1e-14)
        assert len(joint) == numbers.get("elements", 10)
        assert joint[1].name == "joint1"
        slips = [each.force / each.stiffness for each in joint]
        assert (np.diff(slips) > 0.0).all()
    # uniform (Iwan 1966): equal springs, whose forces rise evenly
    uniform = iwan(0, stiffness=4.0, force=1.0, elements=4)
    assert [each.stiffness for each in uniform] == pytest.approx([1.0] * 4)
    assert [each.force for each in uniform] == pytest.approx(np.array([1, 3, 5, 7]) / 16)
    # the stretch at which a joint slips as a whole: Segalman (2005), equation 26
    joint = iwan(0, stiffness=5.0, force=2.0, exponent=-0.3, macroslip=0.7)
    most = 2.0 * 1.7 / (5.0 * (0.7 + 0.7 / 1.7))
    assert joint[-1].force / joint[-1].stiffness == pytest.approx(most, rel=1e-14)


# --- machines ------------------------------------------------------------------------------------


def test_the_state_goes_everywhere() -> None:
    attractor = MACHINE.attractor(transient=200, keep=40)
    record = attractor.record
    assert record.states.shape == (40, MACHINE.dimension) == (40, 9)
    assert record.sliders == pytest.approx(record.states[:, 4:7], abs=0.0)
    assert record.to_xarray().sliders.dims == ("impact", "slider")
    back = MACHINE.impact_state(record.states[-1])
    assert back.sliders == pytest.approx(record.sliders[-1], abs=1e-14)
    assert MACHINE.section_state(record.final) == pytest.approx(record.states[-1], abs=1e-13)
    again = MACHINE.unpack_state(MACHINE.pack_state(record.final))
    assert (again.sliders == record.final.sliders).all()
    whole = MACHINE.simulate(impacts=30)
    rest = MACHINE.simulate(impacts=18, start=MACHINE.simulate(impacts=12).final)
    assert abs(rest.states - whole.states[12:]).max() < 1e-11
    assert whole.error[-1] < 1e-10
    assert whole.energy_balance().error < 1e-12
    found = dynkit.sweep(MACHINE, "joint.force", [0.1, 0.02], transient=50, keep=5, progress=False)
    assert found.counts.tolist() == [5, 5]


def test_what_is_measured() -> None:
    attractor = MACHINE.attractor()
    spectrum = LyapunovSpectrum(attractor, iterations=300)
    assert len(spectrum.exponents) == 9
    assert str(attractor.label) == "P(1,1)"
    per_impact = np.log(abs(attractor.label.multiplier)) / attractor.label.iterates
    assert spectrum.exponents[0] == pytest.approx(per_impact, abs=1e-3)
    assert np.isneginf(spectrum.exponents[-3:]).all()  # of sliders that follow nothing is left
    counts = attractor.label.counts
    assert counts is not None
    assert counts["belt.sticks"] > 0
    record = attractor.record
    moments = record.second_moments()
    times = np.linspace(0.0, record.time[-1], 400_001)
    mean = np.trapezoid(record.sample(times)[0], times, axis=0) / times[-1]
    assert abs(moments.sums.sum(axis=0) / times[-1] - mean).max() < 1e-6


def test_derivatives_are_differences() -> None:
    for machine in (MACHINE, block(JOINT, Jenkins(0, stiffness=1.0, force=0.5))):
        record = machine.simulate(impacts=40)
        size = 1e-6
        for state in record.states[20:26]:
            exact = machine.jacobian(state)
            for k in range(machine.dimension):
                step = size * np.eye(machine.dimension)[k]
                ends = [machine(state + sign * step) for sign in (1, -1)]
                change = machine.difference(*ends) / (2 * size)
                assert abs(exact[:, k] - change).max() < 3e-6 * max(1.0, abs(exact).max())


def test_the_place_of_what_slides_does_not_count() -> None:
    sliding = block(JOINT)
    state = sliding.state([0.5], [1.0], sliders=[0.35])
    start = sliding.section_state(state)
    assert abs(sliding.jacobian(start)[:, 2]).max() < 1e-12


def test_the_order_of_elements_does_not_matter() -> None:
    elements, sliders = MACHINE.elements, np.array([0.15, -0.08, 0.01])
    start = [0.2, 0.4, 0.3], [0.1, 0.0, -0.2]
    records = []
    for order in ([0, 1, 2, 3], [3, 2, 0, 1]):
        machine = MACHINE.replace(elements=[elements[k] for k in order])
        own = [k for k in order if k < 3]
        state = machine.state(*start, sliders=sliders[own])
        records.append(machine.simulate(impacts=25, start=state))
    apart = abs(records[0].position - records[1].position).max(axis=1)
    assert (apart <= records[0].error + records[1].error).all()


@pytest.mark.parametrize("side", ["above", "below"])
def test_it_is_the_same_from_both_sides(side: str) -> None:
    one = block(Jenkins(0, stiffness=2.0, force=0.3, velocity=0.1, amplitude=0.2, side=side))
    two = block(Jenkins((-1.0,), stiffness=2.0, force=0.3, velocity=-0.1, amplitude=0.2, phase=pi))
    start = [0.3], [0.5]
    records = [m.simulate(impacts=10, start=m.state(*start)) for m in (one, two)]
    assert abs(records[0].states[:, :2] - records[1].states[:, :2]).max() < 1e-12


def test_it_holds_while_a_stop_is_closed() -> None:
    # A mass is pressed onto a table that stands; its slider is where the mass came down.
    laid = block(
        HardStop(0, offset=0.0, restitution=0.0),
        Jenkins(0, stiffness=2.0, force=0.3),
        constant_forces=[-1.0],
        drive=1.5,
        frequency=0.3,
    )
    record = laid.simulate(impacts=6, start=laid.state([1.0], [0.0]))
    assert len(record.sticking) >= 3
    for begin, end in record.sticking[:3]:
        held = record.sample_sliders(np.linspace(begin + 1e-9, min(end, record.time[-1]) - 1e-9, 5))
        assert abs(held - held[0]).max() < 1e-9
    assert record.energy_balance().error < 1e-12


def test_a_chain_with_a_joint_of_iwans() -> None:
    chain = ImpactChain(
        masses=40,
        damping=0.05,
        frequency=0.5,
        harmonic_forces=[0.0] * 20 + [0.5] + [0.0] * 19,
        elements=iwan((19, 20), stiffness=2.0, force=0.3, elements=10, exponent=-0.5),
    )
    record = chain.simulate(impacts=4)
    assert len(record) == 4
    assert len(record.events) > 20
    assert len(record._run.regimes) <= 60
    assert record.energy_balance().error < 1e-11


# --- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"stiffness": 0.0, "force": 1.0}, "stiffness must be positive; got 0.0"),
        ({"stiffness": 1.0, "force": -1.0}, "force must be positive; got -1.0"),
        ({"stiffness": 1.0, "force": np.nan}, "force must"),
        ({"stiffness": 1.0, "force": 1.0, "velocity": np.inf}, "velocity must"),
        ({"stiffness": "a", "force": 1.0}, "stiffness must"),
    ],
)
def test_numbers_that_are_none_are_refused(numbers: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Jenkins(0, **numbers)


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"exponent": -1.0}, r"exponent must be above -1; got -1\.0"),
        ({"elements": 0}, "elements must"),
        ({"elements": 1, "macroslip": 0.5}, "elements must be 2 at least with macroslip; got 1"),
        ({"ratio": 0.0}, "ratio must be positive"),
        ({"force": 0.0}, "force must be positive"),
    ],
)
def test_joints_that_are_none_are_refused(numbers: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        iwan(0, **{"stiffness": 1.0, "force": 1.0, **numbers})


@pytest.mark.parametrize("seed", [9, 30])
def test_a_machine_begins_at_the_sliders_of_a_state(seed: int) -> None:
    random = np.random.default_rng(seed)
    inertia, springs = (part @ part.T for part in random.normal(size=(2, 6, 6)))
    machine = MatrixOscillator(
        M=0.5 * np.eye(6) + inertia,
        C=np.zeros((6, 6)),
        K=np.eye(6) + springs,
        frequency=0.9,
        elements=[Jenkins((i, i + 1), stiffness=2.0, force=1e-3) for i in range(5)],
    )
    state = machine.state(random.normal(size=6), phase=1.0)  # all are as far off as they may be
    again = machine.state(state.position, phase=1.0, sliders=state.sliders)
    assert again.sliders == pytest.approx(state.sliders, abs=1e-14)


def test_sliders_that_are_too_far_off_are_refused() -> None:
    one = block(JOINT)
    with pytest.raises(ValueError, match=r"sliders\[0\] must lie in \[0.35, 0.65\]; got 0.9"):
        one.state([0.5], [0.0], sliders=[0.9])
    with pytest.raises(ValueError, match="sliders must"):
        one.state([0.5], [0.0], sliders=[0.5, 0.5])
    with pytest.raises(ValueError, match="start must have 1 sliders; got 0"):
        one.simulate(impacts=1, start=block(DryFriction(0, force=0.1)).state([0.5]))


# --- against many digits -------------------------------------------------------------------------


def random_machine(seed: int, *, hit: bool) -> tuple[ImpactChain, Array, Array]:
    """One to three masses with sliders, stops and friction; where it starts."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 4))
    rows: list[Any] = [*range(n), *((i, i + 1) for i in range(n - 1))]
    rows.append(tuple(random.normal(size=n).tolist()))
    elements: list[Any] = [
        Jenkins(
            rows[k],
            stiffness=random.uniform(0.3, 4.0),
            force=random.uniform(0.05, 0.5),
            velocity=random.choice([0.0, random.uniform(-0.4, 0.4)]),
            offset=random.choice([0.0, random.normal() * 0.3]),
            amplitude=random.choice([0.0, random.uniform(0.0, 0.4)]),
            phase=random.uniform(-3.0, 3.0),
            side=str(random.choice(["above", "below"])),
        )
        for k in random.integers(0, len(rows), int(random.integers(1, 4)))
    ]
    if random.random() < 0.4 and n - hit > 0:
        force = random.uniform(0.05, 0.5)
        belt = random.choice([0.0, random.uniform(-0.4, 0.4)])
        static = random.choice([force, 1.4 * force])
        rubbed = int(random.integers(0, n - hit))
        elements.append(DryFriction(rubbed, force=force, static=static, velocity=belt))
    return random_chain(random, n, elements, hit=hit)


def agrees(chain: ImpactChain, place: Array, velocity: Array, *, hit: bool) -> None:
    """Assert that a motion is the one in many digits."""
    record = chain.simulate(impacts=4, start=chain.state(place, velocity))
    run = record._run
    cut = run.switches.before[run.switches.speed > 0.0]  # the reference does not end chatter
    count = min([len(record), *cut.tolist()])
    assert count >= 1
    joints = [each for each in chain.elements if isinstance(each, Jenkins)]
    signs = np.array([each.sign for each in joints])
    rows = np.array([each.row(len(place)) for each in joints])
    start = np.concatenate([place, velocity, signs * (rows @ place - record.start.sliders)])
    with mp.workdps(DIGITS):
        reference = SoftStopReference(chain)
        found = (reference.impacts if hit else reference.periods)(start, count)
        states = np.array([[float(number) for number in z] for _, z in found])
        times = record.time[:count].tolist()
        late = [abs(float(t - mp.mpf(o))) for (t, _), o in zip(found, times, strict=True)]
    assert len(reference.slides) >= 1
    d = 2 * len(place)
    stretched = signs * (record.position @ rows.T - record.sliders)
    motion = np.concatenate([record.position, record.velocity, stretched], axis=1)[:count]
    apart = abs(motion - np.delete(states, [d, d + 1, d + 2], axis=1)).max(axis=1)
    assert (apart <= record.error[:count]).all()
    assert (np.array(late) * chain.frequency <= record.error[:count] + 2.0**-48).all()
    assert apart.max() < 1e-10
    assert record.energy_balance().error < 1e-12


@pytest.mark.parametrize("hit", [False, True])
@pytest.mark.parametrize("seed", range(12 if is_thorough() else 10))
def test_random_machines_move_as_in_many_digits(seed: int, hit: bool) -> None:
    agrees(*random_machine(seed, hit=hit), hit=hit)


@pytest.mark.parametrize("seed", range(8))
def test_friction_along_the_row_of_sliders_halts_with_them(seed: int) -> None:
    random = np.random.default_rng(seed)
    n, force, belt = int(random.integers(1, 3)), random.uniform(0.1, 0.4), random.uniform(-0.2, 0.2)
    row: Any = 0 if n == 1 else (0, 1)
    surface: dict[str, Any] = {"velocity": random.choice([0.0, belt]), "phase": 1.0}
    surface["amplitude"] = random.choice([0.0, 0.2])
    elements: list[Any] = [
        Jenkins(row, stiffness=spring, force=slip, **surface)
        for spring, slip in random.uniform([0.5, 0.05], [4.0, 0.3], (2, 2)).tolist()
    ]
    static = random.choice([force, 1.4 * force])
    elements.insert(seed % 3, DryFriction(row, force=force, static=static, **surface))
    chain = ImpactChain(
        masses=n,
        frequency=random.uniform(0.4, 1.6),
        harmonic_forces=random.normal(size=n),
        elements=elements,
    )
    agrees(chain, random.normal(size=n), random.normal(size=n), hit=False)


def test_where_a_slider_turns_friction_along_the_same_halts() -> None:
    machine = block(
        JOINT, DryFriction(0, force=0.1, static=0.2), DryFriction(0, force=0.1, velocity=1.0)
    )
    parts = machine._automaton.parts
    assert parts.halted([1, 1, 2], 0, jumps=False) == [0, 3, 2]
    assert parts.halted([1, 1, 2], 0, jumps=True) == [0, 1, 2]


def test_where_a_shaker_that_holds_a_block_turns_so_do_sliders_and_friction() -> None:
    joint, guide = Jenkins(0, stiffness=2.0, force=0.05), DryFriction(0, force=0.05)
    shaker = DryFriction(0, force=5.0, amplitude=0.3)
    machine = block(joint, guide, shaker)
    parts = machine._automaton.parts
    assert parts.halted([1, 1, 3], 0, jumps=False) == [0, 1, 3]
    rates = 0.3 * machine.frequency * np.cos(1.0)  # those of the shaker
    start = machine.state([0.0], [rates], phase=1.0)
    found = compared(machine, start)
    assert not found.wrong
    assert not found.ended
    assert found.events > 20


@pytest.mark.parametrize(("restitution", "spring", "slip"), [(0.3, 4.0, 0.3), (0.6, 1.0, 0.2)])
def test_a_slider_is_about_to_slide_where_a_stop_on_its_surface_is_hit(
    restitution: float, spring: float, slip: float
) -> None:
    # each bounce ends at the place where the slider slid in the one before
    elements = [HardStop(0, restitution=restitution), Jenkins(0, stiffness=spring, force=slip)]
    machine = ImpactChain(
        masses=1,
        damping=0.1,
        frequency=0.8,
        harmonic_forces=[0.5],
        constant_forces=[-1.0],
        elements=elements,
    )
    start = machine.state([1.0], [0.0])
    assert machine.simulate(impacts=12, start=start).error.max() < 1e-12
    found = compared(machine, start)
    assert not found.wrong
    assert all(actual <= claimed for actual, claimed in found.states)


@pytest.mark.parametrize(
    ("joints", "stop", "frequency", "drive"),
    [
        (
            [(3.3324752991121684, 0.1326617225066765), (2.134230387568434, 0.24278872632558923)],
            (0.10252891942857975, 0.0),
            0.46615838364038376,
            0.9931173305788501,
        ),
        (
            [(2.3575786630759836, 0.2021632983984971), (2.4478076405106997, 0.2359364746144762)],
            (0.1422899026465144, 0.1568573438459345),
            0.3298736547897749,
            0.8227241169122153,
        ),
    ],
)
def test_sliders_do_not_slide_as_a_mass_bounces_where_they_stopped(
    joints: list[tuple[float, float]], stop: tuple[float, float], frequency: float, drive: float
) -> None:
    # the stop and the limits of the sliders are reached together, to rounding
    offset, restitution = stop
    machine = ImpactChain(
        masses=2,
        damping=0.05,
        frequency=frequency,
        harmonic_forces=[0.4, drive],
        elements=[
            HardStop(1, offset=offset, restitution=restitution, name="stop"),
            *(Jenkins(1, stiffness=k, force=f, name=f"j{i}") for i, (k, f) in enumerate(joints)),
        ],
    )
    attractor = machine.attractor(transient=900, impacts=60)
    orbit = attractor.periodic_orbit()
    assert orbit.admissible
    assert attractor.label.counts == orbit.counts
    assert orbit.counts["j0.sticks"] == orbit.counts["j1.sticks"] == 2
    assert machine.simulate(impacts=40, start=attractor.final).error.max() < 1e-8


def test_a_block_that_halts_on_sliders_and_friction_sticks() -> None:
    # found among random machines: friction had turned there without sticking
    joints = [
        Jenkins(0, stiffness=2.71989812574495, force=0.30997736817956884, side="below"),
        Jenkins(0, stiffness=2.045896541400679, force=0.20562130265745887, side="below"),
        Jenkins(0, stiffness=3.5349270862800832, force=0.11237402206167668),
    ]
    rub = DryFriction(0, force=0.39860032480476926, static=0.558040454726677)
    chain = ImpactChain(
        masses=(1.5099071635270678,),
        damping=0.0,
        frequency=0.76264945602738,
        harmonic_forces=[0.42113165522656165],
        constant_forces=[-0.06983328568941138],
        elements=[*joints[:2], rub, joints[2]],
    )
    agrees(chain, np.array([2.43309624060453]), np.array([-0.9508479465447343]), hit=False)
