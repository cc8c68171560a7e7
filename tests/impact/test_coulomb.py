"""Coulomb friction at the contact with a hard stop: closed forms, many digits, and what is open."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from mpmath import mp

import dynkit
from dynkit.core.validation import Array
from dynkit.systems import (
    DryFriction,
    HardStop,
    Jenkins,
    MatrixOscillator,
    SoftStop,
    ViscoelasticSpheres,
)
from dynkit.systems.impact.elements.element import Element, Regime, Watch
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.reference.soft_stops import DIGITS, SoftStopReference


def random_machine(seed: int, restitution: float) -> tuple[MatrixOscillator, Array, Array]:
    """Two to four masses on springs that couple all of them, with stops and friction at them."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 5))
    root = random.normal(size=(n, n))
    springs = root @ root.T + np.diag(random.uniform(0.1, 2.0, n))
    rows = random.permutation(n)
    tables = 1 if n < 4 else int(random.integers(1, 3))
    elements: list[Any] = []
    for k in range(tables):
        name = f"table{k}"
        elements.append(
            HardStop(
                rows[2 * k],
                offset=random.uniform(-0.2, 0.1),
                amplitude=random.choice([0.0, 0.15]),
                phase=random.uniform(-3.0, 3.0),
                restitution=restitution,
                side=str(random.choice(["above", "below"])),
                name=name,
            )
        )
        coefficient = random.uniform(0.05, 0.9)
        elements.append(
            DryFriction(
                rows[2 * k + 1],
                coefficient=coefficient,
                static=coefficient * random.choice([1.0, random.uniform(1.0, 1.8)]),
                normal=name,
                velocity=random.choice([0.0, random.uniform(-0.5, 0.5)]),
                amplitude=random.choice([0.0, random.uniform(0.0, 0.4)]),
                phase=random.uniform(-3.0, 3.0),
                slope=random.choice([0.0, random.uniform(0.0, 0.3)]),
                side=str(random.choice(["above", "below"])),
            )
        )
    pushed = np.zeros(n)
    for stop in elements[::2]:
        pushed[stop.coordinate] = -stop.sign * random.uniform(0.5, 2.0)
    damping = 0.1 * springs if random.random() < 0.5 else np.diag(random.uniform(0.0, 0.2, n))
    machine = MatrixOscillator(
        M=np.diag(random.uniform(0.5, 2.0, n)),
        C=damping,
        K=springs,
        frequency=random.uniform(0.4, 1.6),
        harmonic_forces=random.normal(size=n),
        constant_forces=pushed,
        elements=[elements[k] for k in random.permutation(len(elements))],
    )
    place = random.normal(size=n)
    for stop in machine._stops:
        place[stop.coordinate] = stop.offset + stop.sign * (0.3 + abs(random.normal()))
    return machine, place, random.normal(size=n)


def beside_others(seed: int) -> tuple[MatrixOscillator, Array, Array]:
    """Three to five masses: friction at a contact beside other stops, friction and joints."""
    random = np.random.default_rng(seed)
    n = int(random.integers(3, 6))
    root, rows = random.normal(size=(n, n)), random.permutation(n)
    springs = root @ root.T + np.diag(random.uniform(0.1, 2.0, n))
    coefficient, other = random.uniform(0.1, 0.9, 2)
    elements: list[Any] = [
        HardStop(
            rows[0],
            offset=-0.1,
            amplitude=random.choice([0.0, 0.15]),
            restitution=random.choice([0.0, 0.0, 0.6]),
            name="table",
        ),
        DryFriction(rows[1], coefficient=coefficient, normal="table", velocity=other - 0.5),
    ]
    if random.random() < 0.6:
        elements.append(DryFriction(rows[2], force=0.5 * other, static=0.5, velocity=0.1))
    else:
        elements.append(DryFriction(rows[2], coefficient=other, normal="table"))
    if n > 3:
        elements.append(HardStop(rows[3], offset=-0.6, restitution=0.5))
    if n > 4:
        elements.append(SoftStop(rows[4], offset=-0.2, stiffness=5.0, damping=0.3))
    if random.random() < 0.4:
        elements.append(Jenkins(rows[1], stiffness=2.0, force=0.2))
    pushed = np.zeros(n)
    pushed[rows[0]] = -random.uniform(0.5, 2.0)
    machine = MatrixOscillator(
        M=np.diag(random.uniform(0.5, 2.0, n)),
        C=0.05 * springs if random.random() < 0.5 else np.diag(random.uniform(0.0, 0.2, n)),
        K=springs,
        frequency=random.uniform(0.4, 1.6),
        harmonic_forces=random.normal(size=n),
        constant_forces=pushed,
        elements=[elements[k] for k in random.permutation(len(elements))],
    )
    place = random.normal(size=n)
    for stop in machine._stops:
        place[stop.coordinate] = stop.offset + 0.3 + abs(place[stop.coordinate])
    return machine, place, random.normal(size=n)


def held_against_many_digits(machine: MatrixOscillator, place: Array, velocity: Array) -> int:
    """Compare the first impacts with those to 40 digits; how often friction switched."""
    begin = machine.state(place, velocity)
    record = machine.simulate(impacts=5, start=begin)
    run = record._run
    cut = run.switches.before[run.switches.speed > 0.0]  # the reference does not end chatter
    count = min([len(record), *cut.tolist()])
    assert count >= 1
    rows = [e.sign * (e.row(len(place)) @ place) for e in machine._sliders]
    springs = [
        y - e.sign * z for y, e, z in zip(rows, machine._sliders, begin.sliders, strict=True)
    ]
    with mp.workdps(DIGITS):
        reference = SoftStopReference(machine, 0.02)
        found = reference.impacts(np.concatenate([place, velocity, springs]), count)
        states = np.array([[float(number) for number in z] for _, z in found])
        times = record.time[:count].tolist()
        late = [abs(float(t - mp.mpf(o))) for (t, _), o in zip(found, times, strict=True)]
    motion = np.concatenate([record.position, record.velocity], axis=1)[:count]
    apart = abs(motion - states[:, : 2 * len(place)]).max(axis=1)
    assert (apart <= record.error[:count]).all()
    assert (np.array(late) * machine.frequency <= record.error[:count] + 2.0**-48).all()
    assert apart.max() < 1e-9
    return len(reference.switches)


@pytest.mark.parametrize("restitution", [0.0, 0.6])
@pytest.mark.parametrize("seed", range(10))
def test_random_machines_move_as_in_many_digits(seed: int, restitution: float) -> None:
    switches = held_against_many_digits(*random_machine(seed, restitution))
    assert bool(switches) is (restitution == 0.0)  # flights have none


@pytest.mark.parametrize("seed", range(6))
def test_machines_with_other_elements_move_as_in_many_digits(seed: int) -> None:
    held_against_many_digits(*beside_others(seed))


# --- closed forms --------------------------------------------------------------------------------


def block(
    *,
    pull: float = 0.0,
    weight: float = 1.0,
    swing: float = 0.0,
    frequency: float = 1.0,
    **own: Any,
) -> MatrixOscillator:
    """A mass (x, y) on a table y >= swing sin(phase), along which it slips: normal force by y."""
    none = np.zeros((2, 2))
    restitution = own.pop("restitution", 0.0)
    return MatrixOscillator(
        M=np.diag([2.0, 2.0]),
        C=none,
        K=np.diag([own.pop("spring", 0.0), 0.0]),
        frequency=frequency,
        constant_forces=[2.0 * pull, -2.0 * weight],
        harmonic_forces=[0.0, own.pop("load", 0.0)],
        elements=[
            HardStop(1, amplitude=swing, restitution=restitution, name="table"),
            DryFriction(0, normal="table", **own),
        ],
    )


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.8])
def test_each_bounce_takes_its_share_until_the_block_sticks(restitution: float) -> None:
    # From a height 1/2 under weight 1 it lands with 1: bounce n takes mu (1 + r) r^n.
    mu, v = 0.3, 0.8
    ball = block(coefficient=mu, restitution=restitution)
    record = ball.simulate(impacts=8, start=ball.state([0.0, 0.5], [v, 0.0]))
    taken = mu * (1.0 + restitution) * restitution ** np.arange(len(record))
    assert record.velocity[:, 0] == pytest.approx(np.maximum(v - np.cumsum(taken), 0.0), abs=1e-15)
    assert bool((abs(record.velocity[:, 0]) <= 1e-15).any()) is (restitution > 0.0)
    slow = ball.simulate(impacts=2, start=ball.state([0.0, 0.5], [0.2, 0.0]))
    assert abs(slow.velocity[:, 0]).max() < 1e-16  # it sticks within the first impact


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_bounced_block_slips_as_far_as_its_momentum_says(restitution: float) -> None:
    # All bounces together take mu (1 + 2 r/(1 - r)), then a constant mu brings it to rest.
    mu, v, r = 0.2, 1.0, restitution
    ball = block(coefficient=mu, restitution=r)
    record = ball.simulate(impacts=1000, start=ball.state([0.0, 0.5], [v, 0.0]))
    lands, rests = 1.0, 1.0 + 2.0 * r / (1.0 - r)
    left = v - mu * (1.0 + r) / (1.0 - r)
    assert record.sticking[0, 0] == pytest.approx(rests, rel=1e-13)
    position, velocity = record.sample(np.array([rests, rests + left / mu + 1.0]))
    assert velocity[0, 0] == pytest.approx(left, abs=1e-13)
    assert velocity[1, 0] == 0.0
    flights = v * lands
    for n in range(60):
        flights += (v - mu * (1.0 + r) * (1.0 - r ** (n + 1)) / (1.0 - r)) * 2.0 * r ** (n + 1)
    assert position[0, 0] == pytest.approx(flights, abs=1e-12)
    assert position[1, 0] == pytest.approx(flights + 0.5 * left**2 / mu, abs=1e-12)
    assert record.ending.name == "CONTACT_FOR_EVER"


@pytest.mark.parametrize(("pull", "slips"), [(0.29, False), (0.45, False), (0.55, True)])
def test_a_block_on_a_slope_slips_above_the_static_angle(pull: float, slips: bool) -> None:
    plane = block(pull=pull, coefficient=0.3, static=0.5)
    record = plane.simulate(impacts=1, start=plane.state([0.0, 0.0], [0.0, 0.0]))
    position, velocity = record.sample(np.array([3.0]))
    assert position[0, 0] == pytest.approx(4.5 * (pull - 0.3) * slips, abs=1e-14)
    assert velocity[0, 0] == pytest.approx(3.0 * (pull - 0.3) * slips, abs=1e-14)
    moving = plane.simulate(impacts=1, start=plane.state([0.0, 0.0], [1.0, 0.0]))
    rests = 1.0 / (0.3 - pull) if pull < 0.3 else np.inf
    times = np.array([2.0, 120.0])
    position, velocity = moving.sample(times)
    last = np.minimum(times, rests)
    assert velocity[:, 0] == pytest.approx(
        np.where(times < rests, 1.0 + (pull - 0.3) * times, 0.0), abs=1e-13
    )
    assert position[:, 0] == pytest.approx(last + 0.5 * (pull - 0.3) * last**2, rel=1e-13)


def test_a_table_that_vibrates_changes_the_friction_with_the_contact_force() -> None:
    # N = m (g + y''), so w' = -mu (g - a w^2 sin(w t)) as long as it slips; a w^2 < g.
    mu, a, w, v = 0.4, 0.2, 1.9, 1.0
    table = block(coefficient=mu, swing=a, frequency=w)
    record = table.simulate(impacts=1, start=table.state([0.0, 0.0], [v, a * w]))
    with mp.workdps(40):
        m, b, f = mp.mpf(mu), mp.mpf(a), mp.mpf(w)
        halt = mp.findroot(lambda t: v - m * (t - b * f * (1 - mp.cos(f * t))), 2.5)
        place = v * halt - m * (halt**2 / 2 - b * f * (halt - mp.sin(f * halt) / f))
    events = record.events
    assert events.time[-1] == pytest.approx(float(halt), rel=1e-14)
    assert events.position[-1, 0] == pytest.approx(float(place), rel=1e-14)
    times = np.linspace(0.1, 2.0, 7)
    force = record.observable("table.contact_force", times)
    assert force == pytest.approx(2.0 * (1.0 - a * w * w * np.sin(w * times)), rel=1e-13)
    rub = record.observable("elements[1].friction_force", times)
    assert rub == pytest.approx(-mu * force, rel=1e-13)
    assert record.sample(np.array([50.0]))[1][0, 0] == 0.0


def test_a_preloaded_oscillating_normal_load_drives_a_slider_on_a_belt() -> None:
    # 2 x'' + k x = mu (P - Q sin t) while the belt is faster; harmonic balance is exact.
    mu, q, k = 0.3, 1.2, 5.0
    belt = block(coefficient=mu, velocity=9.0, spring=k, load=q)
    record = belt.simulate(impacts=1, start=belt.state([0.1, 0.0], [0.0, 0.0]))
    times = np.linspace(0.0, 60.0, 200)
    w, rest, turn = np.sqrt(k / 2.0), 2.0 * mu / k, -mu * q / (k - 2.0)
    free = (0.1 - rest) * np.cos(w * times) - turn / w * np.sin(w * times)
    expected = rest + turn * np.sin(times) + free
    assert record.sample(times)[0][:, 0] == pytest.approx(expected, abs=1e-13)
    assert record.ending.name == "CONTACT_FOR_EVER"


def coupled(coefficient: float, velocity: float, share: float = 0.5) -> MatrixOscillator:
    """Slip and gap with a common inertia, as of a rod: M = (1, c; c, 1)."""
    return MatrixOscillator(
        M=[[1.0, share], [share, 1.0]],
        C=np.zeros((2, 2)),
        K=np.zeros((2, 2)),
        frequency=1.0,
        constant_forces=[0.3, -1.0],
        elements=[
            HardStop(1, restitution=0.0, name="table"),
            DryFriction(0, coefficient=coefficient, normal="table", velocity=velocity),
        ],
    )


@pytest.mark.parametrize("velocity", [5.0, -5.0])
def test_coupled_inertia_changes_the_contact_force(velocity: float) -> None:
    # x'' = 0.3 - s mu N and c x'' = N - 1 give N = (1 + 0.3 c)/(1 + s mu c).
    mu, c = 0.6, 0.5
    rod = coupled(mu, velocity)
    record = rod.simulate(impacts=1, start=rod.state([0.0, 0.0], [0.0, 0.0]))
    sign = -np.sign(velocity)
    force = (1.0 + 0.3 * c) / (1.0 + sign * mu * c)
    assert record.observable("table.contact_force", np.array([0.5])) == pytest.approx(
        [force], rel=1e-14
    )
    assert record.sample(np.array([0.5]))[1][0, 0] == pytest.approx(
        0.5 * (0.3 - sign * mu * force), rel=1e-14
    )


def test_a_contact_force_without_a_unique_value_ends_the_motion_by_name() -> None:
    # Painleve's paradox: 1 + s mu c is negative for slip of one direction.
    rod = coupled(2.5, 5.0)
    record = rod.simulate(impacts=3, start=rod.state([0.0, 0.0], [0.0, 0.0]))
    assert record.ending.name == "PARADOX"
    assert len(record) == 0
    assert coupled(2.5, -5.0).simulate(impacts=1).ending.name != "PARADOX"
    falls = coupled(0.3, 5.0)  # the impulse is open, too, where masses couple the rows
    record = falls.simulate(impacts=1, start=falls.state([0.0, 0.5], [0.0, 0.0]))
    assert record.ambiguous == 0
    assert record.error[0] == np.inf


def test_flutter_by_friction_grows_as_its_eigenvalues_say() -> None:
    # Two modes that friction couples, on a belt that is faster than any of their motions.
    mu = 0.5
    springs = np.array([[2.0, -0.9, 0.2], [-0.9, 2.1, 2.0], [0.2, 2.0, 5.0]])
    disc = MatrixOscillator(
        M=np.eye(3),
        C=np.zeros((3, 3)),
        K=springs,
        frequency=1.0,
        constant_forces=[0.0, 0.0, -50.0],
        elements=[
            HardStop(2, restitution=0.0, name="pad"),
            DryFriction(0, coefficient=mu, normal="pad", velocity=-1e3),
        ],
    )
    # N = 50 + k_z . x; what slips against the belt feels -mu N.
    matrix = springs[:2, :2].copy()
    matrix[0] += mu * springs[2, :2]
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-matrix, np.zeros((2, 2))]])
    rates = np.linalg.eigvals(state)
    assert rates.real.max() > 0.01
    rest = np.linalg.solve(matrix, [-mu * 50.0, 0.0])
    begin = np.array([rest[0] + 0.01, rest[1], 0.0])
    start = disc.state(begin, [0.0, 0.0, 0.0])
    record = disc.simulate(impacts=1, start=start)
    times = np.array([1.0, 7.0, 20.0])
    values, vectors = np.linalg.eig(state)
    share = np.linalg.solve(vectors, [0.01, 0.0, 0.0, 0.0])
    exact = np.array([(vectors * np.exp(values * t) @ share).real for t in times])
    found = record.sample(times)[0][:, :2] - rest
    assert abs(found - exact[:, :2]).max() < 1e-11
    assert record.ending.name != "CONTACT_FOR_EVER"


# --- chatter, energy, symmetries, derivatives ----------------------------------------------------


def dropped(
    pull: float, coefficient: float, restitution: float, tolerance: float, velocity: float = 0.0
) -> MatrixOscillator:
    """One body falls on a table, and rubs along it by its other coordinate."""
    return MatrixOscillator(
        M=np.diag([1.0, 1.3]),
        C=[[0.05, 0.0], [0.0, 0.02]],
        K=[[1.0, -0.3], [-0.3, 1.0]],
        frequency=1.0,
        constant_forces=[pull, -1.0],
        chatter_tolerance=tolerance,
        elements=[
            HardStop(1, restitution=restitution, name="table"),
            DryFriction(0, coefficient=coefficient, normal="table", velocity=velocity),
        ],
    )


@pytest.mark.parametrize(
    ("coefficient", "velocity", "push", "pull"),
    [(0.3, 0.0, 1.0, 0.0), (0.5, 0.2, 0.2, 0.0), (0.8, 0.0, 0.0, 0.5), (0.5, 0.0, 0.0, 0.3)],
)
@pytest.mark.parametrize("restitution", [0.3, 0.6])
def test_the_tail_of_a_chatter_is_right_to_its_error(
    coefficient: float, velocity: float, push: float, pull: float, restitution: float
) -> None:
    def ends(tolerance: float) -> tuple[Array, float]:
        machine = dropped(pull, coefficient, restitution, tolerance, velocity)
        start = machine.state([0.0, 0.3], [push, 0.0])
        record = machine.simulate(impacts=4000, start=start)
        assert len(record) < 200
        x, v = record.sample(np.array([5.0]))
        return np.concatenate([x[0], v[0]]), record.chatter_error

    exact, _ = ends(1e-50)  # bounces down to nothing
    for tolerance in (1e-6, 1e-9, 1e-12, 1e-16):
        found, error = ends(tolerance)
        assert error <= tolerance
        assert abs(found - exact).max() <= error + 1e-14


def test_rounding_does_not_turn_friction_back_and_forth_as_contact_begins() -> None:
    """Of what slips by 1e-18 rounding leaves no sign; some of these pulls show it anywhere."""
    for pull in np.linspace(0.05, 0.4, 60).tolist():
        machine = dropped(pull, 0.5, 0.3, 1e-50)
        record = machine.simulate(impacts=4000, start=machine.state([0.0, 0.3], [0.0, 0.0]))
        assert record.ending is Ending.CONTACT_FOR_EVER
        assert len(record.events.time) < len(record) + 10


@pytest.mark.parametrize("restitution", [0.0, 0.6])
def test_the_energy_balance_closes(restitution: float) -> None:
    rubbed = 0
    for seed in range(8):
        machine, place, velocity = random_machine(seed, restitution)
        record = machine.simulate(impacts=12, start=machine.state(place, velocity))
        balance = record.energy_balance()
        assert balance.error < 1e-12 * sum(map(abs, balance.work.values()))
        assert min(balance.dissipated.values()) > -1e-12
        names = [n for n, e in zip(balance.dissipated, machine._elements, strict=False)]
        assert len(names) > 1
        frictions = [e for e in machine._elements if isinstance(e, DryFriction)]
        rubbed += sum(lost > 0.01 for lost in list(balance.dissipated.values())[-len(frictions) :])
    assert rubbed >= 8


def test_the_order_of_elements_and_the_side_do_not_matter() -> None:
    for seed in (3, 8, 10):
        machine, place, velocity = random_machine(seed, 0.0)
        other = machine.replace(elements=machine.elements[::-1])
        turned = [
            replace(
                e,
                side="below" if e.side == "above" else "above",
                offset=-e.offset,
                phase=e.phase + np.pi,
                **({"velocity": -e.velocity} if isinstance(e, DryFriction) else {}),
            )
            for e in machine.elements
        ]
        mirror = machine.replace(
            elements=turned,
            harmonic_forces=[-f for f in machine.harmonic_forces],
            constant_forces=[-f for f in machine.constant_forces],
        )
        one, two = (m.simulate(impacts=8, start=m.state(place, velocity)) for m in (machine, other))
        three = mirror.simulate(impacts=8, start=mirror.state(-place, -velocity))
        assert len(one) == len(two) == len(three) == 8
        for record, sign in ((two, 1.0), (three, -1.0)):
            assert record.time == pytest.approx(one.time, abs=1e-10)
            assert sign * record.velocity == pytest.approx(one.velocity, abs=1e-10)


@pytest.mark.parametrize("restitution", [0.3, 0.6])
@pytest.mark.parametrize("seed", [1, 8, 12, 13, 15])
def test_derivatives_are_differences(seed: int, restitution: float) -> None:
    machine, place, velocity = random_machine(seed, restitution)
    record = machine.simulate(impacts=12, start=machine.state(place, velocity))
    size, checked = 1e-6, 0
    for state in record.states[:8]:
        exact, columns = machine.jacobian(state), []
        for step in size * np.eye(machine.dimension):
            ends = machine(state + step), machine(state - step)
            columns.append(machine.difference(*ends) / (2.0 * size))
        off = abs(exact - np.array(columns).T).max() / max(1.0, abs(exact).max())
        assert off < 1e-6
        checked += 1
    assert checked == 8


def test_derivatives_through_contact_are_differences() -> None:
    # What an impact has stopped slips for one sign of a disturbance only: left out.
    checked = 0
    for seed in (1, 4, 5, 13, 14, 22):
        machine, place, velocity = random_machine(seed, 0.0)
        record = machine.simulate(impacts=12, start=machine.state(place, velocity))
        for k in range(min(len(record) - 1, 8)):
            state = machine.impact_state(record.states[k])
            if any(number in machine._automaton.parts.normal for number in state.closed):
                continue
            exact, size = machine.jacobian(record.states[k]), 1e-6
            directions = np.delete(np.arange(machine.dimension), machine.dimension - 2)
            for j in directions.tolist():
                step = size * np.eye(machine.dimension)[j]
                ends = machine(record.states[k] + step), machine(record.states[k] - step)
                change = machine.difference(*ends) / (2.0 * size)
                assert abs(exact[:, j] - change).max() < 1e-5 * max(1.0, abs(exact).max())
            checked += 1
    assert checked >= 10


SLIDING = MatrixOscillator(
    M=np.eye(2),
    C=0.1 * np.eye(2),
    K=[[1.0, -0.2], [-0.2, 0.5]],
    frequency=1.1,
    constant_forces=[0.0, -0.4],
    elements=[
        HardStop(1, amplitude=1.2, restitution=0.6, name="table"),
        DryFriction(0, coefficient=0.3, normal="table", velocity=0.2, name="sole"),
    ],
)
"""A mass that slides on a table which moves up and down, and hits it."""


def test_what_is_measured_of_friction_at_a_contact() -> None:
    assert "sole.coefficient" in SLIDING.parameters
    attractor = SLIDING.attractor()
    label = attractor.label
    assert label.periods is not None
    assert str(label) == "P(2,1)"
    assert label.counts == {"table.impacts": 2, "table.contacts": 0, "sole.sticks": 0}
    orbit = dynkit.periodic_orbit(SLIDING, attractor.states[-1], period=label.iterates)
    assert abs(orbit.multipliers).max() == pytest.approx(abs(label.multiplier), abs=1e-6)
    swept = dynkit.sweep(
        SLIDING, "sole.coefficient", [0.1, 0.3], transient=50, keep=5, progress=False
    )
    assert swept.counts.tolist() == [5, 5]
    whole = SLIDING.simulate(impacts=30)
    rest = SLIDING.simulate(impacts=18, start=SLIDING.simulate(impacts=12).final)
    assert abs(rest.states - whole.states[12:]).max() < 1e-11


@pytest.mark.parametrize(
    ("own", "message"),
    [
        ({}, "either force or coefficient must be given; got neither"),
        ({"force": 1.0, "coefficient": 0.5}, "either force or coefficient must be given; got both"),
        ({"coefficient": 0.5}, "normal must be the name of the hard stop"),
        ({"force": 0.5, "normal": "table"}, "normal must be given with a coefficient only"),
        ({"coefficient": -0.5, "normal": "table"}, "coefficient must"),
        ({"coefficient": 0.5, "static": 0.4, "normal": "table"}, "less than the coefficient 0.5"),
    ],
)
def test_numbers_that_are_none_are_refused(own: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DryFriction(0, **own)


def test_machines_whose_friction_is_open_are_refused() -> None:
    table, sole = HardStop(1, name="table"), DryFriction(0, coefficient=0.5, normal="table")
    for elements, kind, message in (
        (
            [table, replace(sole, normal="wall")],
            ValueError,
            r"elements\[1\].normal must be the name",
        ),
        ([sole, SoftStop(1, stiffness=1.0, name="table")], ValueError, "name of a hard stop"),
        ([table, sole, HardStop(0)], NotImplementedError, "must not act along a hard stop"),
        ([table, sole, DryFriction(0, force=1.0)], NotImplementedError, "along other friction"),
        (
            [HardStop(1, name="table", restitution=ViscoelasticSpheres(0.3)), sole],
            NotImplementedError,
            "whose restitution is a number",
        ),
    ):
        with pytest.raises(kind, match=message):
            MatrixOscillator(
                M=np.eye(2), C=np.eye(2), K=np.eye(2), frequency=1.0, elements=elements
            )


@dataclass(frozen=True)
class Leaning(Element):
    """An element of one's own whose force is in proportion to a contact force."""

    @property
    def regimes(self) -> tuple[Regime, ...]:
        touched, left = (Watch(to=to, gap=gap, order=1) for to, gap in ((1, 1.0), (0, -1.0)))
        return Regime((touched,)), Regime((left,), traction=1.0)


def test_only_friction_may_lean_on_a_stop() -> None:
    with pytest.raises(ValueError, match=r"elements\[1\] must not lean on others"):
        MatrixOscillator(
            M=np.eye(2),
            C=np.eye(2),
            K=np.eye(2),
            frequency=1.0,
            elements=[HardStop(1, name="table"), Leaning(0)],
        )


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_extreme_coefficients(restitution: float) -> None:
    start = [0.0, 0.5], [1.0, 0.0]
    smooth, rough = (block(pull=0.2, coefficient=c, restitution=restitution) for c in (0.0, 1e6))
    times = np.linspace(0.0, 20.0, 50)
    record = smooth.simulate(impacts=1000, start=smooth.state(*start))
    assert record.sample(times)[0][:, 0] == pytest.approx(times + 0.1 * times**2, abs=1e-11)
    record = rough.simulate(impacts=1000, start=rough.state(*start))
    assert record.ending.name == "CONTACT_FOR_EVER"
    lands = record.sticking[0, 0]
    velocity = record.sample(lands + times)[1]
    assert abs(velocity).max() < 1e-14
    # From the first impact at t = 1 on flights begin at rest: t_n = r^n 2, and 0.1 t_n^2 each.
    flights = sum(0.1 * (2.0 * restitution**n) ** 2 for n in range(1, 60) if restitution)
    assert record.sample(np.array([lands]))[0][0, 0] == pytest.approx(1.1 + flights, abs=1e-12)


# --- more closed stops than their rows have directions -------------------------------------------


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_two_equal_stops_hold_as_one(restitution: float) -> None:
    stops = [HardStop(0, restitution=restitution), HardStop(0, restitution=restitution)]
    one, two = (
        MatrixOscillator(
            M=[[1.0]], C=[[0.0]], K=[[0.0]], frequency=1.0, constant_forces=[-1.0], elements=own
        )
        for own in (stops[:1], stops)
    )
    for height in (0.0, 1.0):
        records = [m.simulate(impacts=100, start=m.state([height], [0.0])) for m in (one, two)]
        assert records[1].ending.name == records[0].ending.name == "CONTACT_FOR_EVER"
        x, other = (r.sample(np.linspace(0.0, 9.0, 30))[0] for r in records)
        assert other == pytest.approx(x, abs=1e-9)


@pytest.mark.parametrize("moment", [0.0, 0.5, -0.5, 1.5, -1.5])
def test_three_supports_of_a_beam_have_a_unique_motion(moment: float) -> None:
    # Height y and angle a; the beam rests unless the load lies beyond an end, and then tips there.
    supports = [
        HardStop([1.0, side], restitution=0.0, name=f"s{k}")
        for k, side in enumerate((-1.0, 0.0, 1.0))
    ]
    beam = MatrixOscillator(
        M=np.diag([1.0, 0.3]),
        C=np.zeros((2, 2)),
        K=np.zeros((2, 2)),
        frequency=1.0,
        constant_forces=[-1.0, moment],
        elements=supports,
    )
    record = beam.simulate(impacts=3, start=beam.state([0.0, 0.0], [0.0, 0.0]))
    lift = 0.5 * max(abs(moment) - 1.0, 0.0) / 1.3 * 0.09
    place = record.sample(np.array([0.3]))[0][0]
    assert place == pytest.approx([lift, np.sign(moment) * lift], abs=1e-14)
    forces = [record.observable(f"s{k}.contact_force", np.array([0.3]))[0] for k in range(3)]
    assert min(forces) > -1e-14
    pushed = 1.0 if abs(moment) <= 1.0 else 1.0 + (abs(moment) - 1.0) / 1.3
    assert sum(forces) == pytest.approx(pushed, rel=1e-13)
    assert record.ambiguous is None


@pytest.mark.parametrize(
    ("low", "amplitude", "inertia", "moment", "damping", "place"),
    [
        ((-1e-12, 0.0, 0.0), 0.0, 0.1, 0.0, 0.1, (0.366, -0.027)),
        ((0.0, 0.0, -1e-12), 0.1, 1.0, -0.5, 0.1, (0.459, 0.0)),
        ((-1e-12, 0.0, 0.0), 0.1, 1.0, 0.0, 0.1, (0.885, 0.044)),
    ],
)
def test_three_supports_that_are_hardly_uneven_come_to_rest_on_two(
    low: tuple[float, ...],
    amplitude: float,
    inertia: float,
    moment: float,
    damping: float,
    place: tuple[float, float],
) -> None:
    sides = enumerate(zip((-1.0, 0.0, 1.0), low, strict=True))
    beam = MatrixOscillator(
        M=np.diag([1.0, inertia]),
        C=damping * np.eye(2),
        K=np.eye(2),
        frequency=1.0,
        constant_forces=[-1.0, moment],
        elements=[
            HardStop([1.0, side], restitution=0.0, offset=at, amplitude=amplitude, name=f"s{k}")
            for k, (side, at) in sides
        ],
    )
    record = beam.simulate(impacts=1000, start=beam.state(list(place), [0.0, 0.0]))
    assert record.ending.name == "CONTACT_FOR_EVER"
    times = float(record.time[-1]) + np.linspace(0.1, 6.0, 20)
    for k in range(3):
        assert record.observable(f"s{k}.contact_force", times).min() >= -1e-14
        assert record.observable(f"s{k}.gap", times).min() >= -1e-14
