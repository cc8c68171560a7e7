"""Friction along what stops hold: it rests, holds where they let go, and turns in each bounce."""

import math
from typing import Any

import numpy as np
import pytest
from mpmath import mp

from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, ImpactChain, MatrixOscillator
from tests.effort import is_thorough
from tests.reference.soft_stops import DIGITS, SoftStopReference


def block(
    push: float = 0.0,
    drive: float = 0.0,
    spring: float = 0.0,
    frequency: float = 1.0,
    **numbers: Any,
) -> MatrixOscillator:
    """A unit mass on rough ground that is pushed against a stop at zero."""
    restitution = numbers.pop("restitution", 0.6)
    return MatrixOscillator(
        M=[[1.0]],
        C=[[0.0]],
        K=[[spring]],
        frequency=frequency,
        constant_forces=[-push],
        harmonic_forces=[drive],
        elements=[HardStop(0, restitution=restitution), DryFriction(0, **numbers)],
    )


@pytest.mark.parametrize("restitution", [0.3, 0.9, 1.0])
def test_bounces_on_rough_ground_are_those_of_a_smaller_restitution(restitution: float) -> None:
    push, force, u = 1.0, 0.4, 0.5
    rough = block(push, force=force, restitution=restitution)
    record = rough.simulate(impacts=10**4, start=rough.state([0.0], [u]))
    assert record.ending.name == "CONTACT_FOR_EVER"
    up, s = push + force, math.sqrt((push - force) / (push + force))
    speeds = u * (restitution * s) ** np.arange(1, len(record) + 1)
    assert record.relative_velocity == pytest.approx(speeds, rel=1e-8, abs=1e-15)
    lasts = u * (1.0 + 1.0 / s) / up / (1.0 - restitution * s)
    assert record.sticking[0, 0] == pytest.approx(lasts, rel=1e-13)
    assert record.final.closed == (1,) or record.final.element == 0


def test_what_friction_holds_in_the_air_does_not_come_back() -> None:
    # It rises once, and hangs: the chatter must not be completed.
    hangs = block(1.0, force=0.4, static=1.2)
    record = hangs.simulate(impacts=5, start=hangs.state([0.0], [0.5]))
    assert len(record) == 0
    assert record.ending.name == "NO_FURTHER_CONTACT"
    assert record.events.position[-1, 0] == pytest.approx(0.5**2 / (2.0 * 1.4), rel=1e-15)


def test_friction_holds_what_a_stop_lets_go_of() -> None:
    # Pushed by 0.3 - sin t: the stop lets go at sin t = 0.3, friction at 0.3 + static.
    static, w = 0.5, 1.0
    held = block(0.3, 1.0, frequency=w, force=0.2, static=static, restitution=0.0)
    record = held.simulate(impacts=3, start=held.state([0.0], [0.0]))
    events = record.events
    lets_go = events.time[events.kind == 2][0]
    slips = events.time[(events.kind == 3) & (events.time > lets_go)][0]
    assert lets_go == pytest.approx(math.asin(0.3), abs=1e-15)
    assert slips == pytest.approx(math.asin(0.3 + static), abs=1e-15)
    assert events.position[events.time <= slips].max() == 0.0
    # It moves off as the integral of the force less the friction, and returns into contact.
    t = np.linspace(slips, slips + 0.5, 7)
    moved = math.cos(slips) - np.cos(t) - (0.3 + 0.2) * (t - slips)
    assert record.sample(t)[1][:, 0] == pytest.approx(moved, abs=1e-14)
    assert record.error.max() < 1e-13


def test_it_stays_where_friction_alone_holds_it_at_the_stop() -> None:
    held = block(0.3, 0.7, force=0.5, restitution=0.5)
    record = held.simulate(impacts=3, start=held.state([0.0], [0.0]))
    assert len(record) == 0
    assert record.ending.name in ("NO_FURTHER_CONTACT", "CONTACT_FOR_EVER", "SEARCH_LIMIT")
    assert abs(record.events.position).max(initial=0.0) < 1e-15


def test_where_friction_yields_towards_the_stop_it_is_closed_again() -> None:
    # Pushed by 0.3 - 0.5 sin t: never off the stop, which lets go at sin t = 0.6, and takes the
    # force again where friction would have to push by more than its most, at sin t = -0.2.
    held = block(0.3, 0.5, force=0.2, static=0.4, restitution=0.5)
    record = held.simulate(impacts=3, start=held.state([0.0], [0.0]))
    assert len(record) == 0
    events, turn = record.events, 2.0 * math.pi
    assert abs(events.position).max() == 0.0
    opened, closed = (events.time[events.kind == kind][1:9] for kind in (2, 1))
    periods = turn * np.arange(8)
    assert opened == pytest.approx(math.asin(0.6) + turn + periods, rel=1e-14)
    assert closed == pytest.approx(math.pi + math.asin(0.2) + periods, rel=1e-14)


ROUGH = MatrixOscillator(
    M=[[1.0]],
    C=[[0.1]],
    K=[[1.0]],
    frequency=0.3,
    harmonic_forces=[1.0],
    elements=[HardStop(0, offset=-0.1, restitution=0.5), DryFriction(0, force=0.1, static=0.15)],
)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.8])
def test_what_a_cut_chatter_changes_is_within_the_error(restitution: float) -> None:
    machine = ROUGH.replace(
        elements=[HardStop(0, offset=-0.1, restitution=restitution), *ROUGH.elements[1:]]
    )
    found = [
        machine.replace(chatter_tolerance=tolerance).simulate(impacts=300)
        for tolerance in (machine.chatter_tolerance, 1e-10)
    ]
    begins = [record.sticking[:4, 0] for record in found]
    assert len(begins[0]) == 4
    assert begins[0] == pytest.approx(begins[1], abs=1e-7)
    ends = [record.sticking[:4, 1] for record in found]
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    record = found[0]
    assert record.error.max() < 1e-11


def test_places_in_the_bounces_that_are_left_out_are_as_exact_as_promised() -> None:
    found = [
        ROUGH.replace(chatter_tolerance=tolerance).simulate(impacts=200)
        for tolerance in (1e-10, 1e-16)
    ]
    cut = found[0]._run.switches
    begin, rest = cut.time[cut.rest > 0.0][0], cut.rest[cut.rest > 0.0][0]
    times = begin + rest * np.linspace(0.0, 1.0, 200)
    places = [record.sample(times)[0] for record in found]
    assert 1e-12 < abs(places[0] - places[1]).max() < 1e-7


def test_orbits_derivatives_and_labels_pass_rough_stops() -> None:
    attractor = ROUGH.attractor()
    assert str(attractor.label) == "P(inf,1)"
    record = ROUGH.simulate(impacts=60, start=attractor.record.final)
    assert len(record.sticking) >= 3
    for state in record.states[record.relative_velocity > 1e-4][:20]:
        exact, size = ROUGH.jacobian(state), 1e-6
        for k in range(2):
            step = size * np.eye(2)[k]
            ends = [ROUGH(state + sign * step) for sign in (1, -1)]
            change = ROUGH.difference(*ends) / (2 * size)
            assert abs(exact[:, k] - change).max() < 1e-6 * max(1.0, abs(exact).max())


def random_machine(seed: int) -> tuple[ImpactChain, Array, Array]:
    """One to three masses, a stop with friction along the same row, maybe more; where it starts."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 4))
    rows: list[Any] = [*range(n), *((i, i + 1) for i in range(n - 1))]
    random.shuffle(rows)
    place, *others = rows
    side = str(random.choice(["above", "below"])) if isinstance(place, int) else "above"
    moves = {"amplitude": random.choice([0.0, 0.2]), "phase": random.uniform(-3.0, 3.0)}
    bounces = float(random.choice([0.0, random.uniform(0.1, 0.8)], p=[0.7, 0.3]))
    force = random.uniform(0.03, 0.3)
    elements: list[Any] = [
        HardStop(
            place,
            offset=random.uniform(-0.3, 0.1) * (1 if side == "above" else -1),
            side=side,
            restitution=bounces,
            **moves,
        ),
        DryFriction(
            place,
            force=force,
            static=force * random.uniform(1.05, 1.8),
            slope=random.choice([0.0, 0.2]),
            side=str(random.choice(["above", "below"])),
            **moves,
        ),
    ]
    if others and random.random() < 0.5:
        elements.append(DryFriction(others[0], force=0.1, static=0.15, velocity=0.2))
    if len(others) > 1 and random.random() < 0.4:
        elements.append(HardStop(others[1], offset=-0.5, restitution=random.choice([0.0, 0.5])))
    chain = ImpactChain(
        masses=tuple(random.uniform(0.5, 2.0, n).tolist()),
        damping=random.choice([0.0, 0.1]),
        frequency=random.uniform(0.25, 1.2),
        harmonic_forces=random.normal(size=n),
        constant_forces=0.3 * random.normal(size=n),
        elements=[elements[k] for k in random.permutation(len(elements))],
    )
    stops = [e for e in elements if isinstance(e, HardStop)]
    x = random.normal(size=n)
    while not all(e.sign * (e.row(n) @ x - e.offset - e.swing(0.0, 1.0)) > 0.05 for e in stops):
        x = random.normal(size=n)
    return chain, x, random.normal(size=n)


@pytest.mark.parametrize("seed", range(30 if is_thorough() else 20))
def test_random_machines_on_rough_ground_move_as_in_many_digits(seed: int) -> None:
    chain, place, velocity = random_machine(seed)
    record = chain.simulate(impacts=6, start=chain.state(place, velocity))
    run = record._run
    cut = run.switches.before[run.switches.speed > 0.0]  # the reference does not end chatter
    count = min([len(record), *cut.tolist()])
    if record.ambiguous is not None:
        count = min(count, record.ambiguous)
    with mp.workdps(DIGITS):
        reference = SoftStopReference(chain)
        found = reference.impacts(np.concatenate([place, velocity]), count)
        states = np.array([[float(number) for number in z] for _, z in found])
        times = record.time[:count].tolist()
        late = [abs(float(t - mp.mpf(o))) for (t, _), o in zip(found, times, strict=True)]
    assert count >= 1
    motion = np.concatenate([record.position, record.velocity], axis=1)[:count]
    apart = abs(motion - states[:, : chain.dimension]).max(axis=1)
    assert (apart <= record.error[:count]).all()
    assert (np.array(late) * chain.frequency <= record.error[:count] + 2.0**-46).all()


def bouncing_beside_friction(seed: int) -> MatrixOscillator:
    """Friction between two masses, one of which bounces: its impacts make it slip a little."""
    random = np.random.default_rng(seed)
    force = random.uniform(0.05, 0.6)
    return MatrixOscillator(
        M=np.diag(random.uniform(0.5, 2.0, 2)),
        C=np.zeros((2, 2)),
        K=[[1.0, -1.0], [-1.0, 1.2]],
        frequency=random.uniform(0.2, 0.6),
        constant_forces=[0.0, -random.uniform(0.3, 1.0)],
        harmonic_forces=random.normal(size=2) * 0.2,
        elements=[
            HardStop(1, restitution=random.uniform(0.2, 0.7)),
            DryFriction((0, 1), force=force, static=force * random.uniform(1.0, 1.5)),
        ],
    )


@pytest.mark.parametrize("seed", [7, 14, 17, 36, 42, 46])
def test_a_chatter_is_not_cut_where_its_bounces_make_friction_elsewhere_slip(seed: int) -> None:
    pair = bouncing_beside_friction(seed)
    found = []
    for tolerance in (1e-10, 1e-16):
        machine = pair.replace(chatter_tolerance=tolerance)
        found.append(machine.simulate(impacts=200, start=machine.state([0.0, 0.3], [0.0, 0.0])))
    assert found[0].sticking[0] == pytest.approx(found[1].sticking[0], abs=1e-8)
    (x, v), (y, w) = (
        (events.position[events.kind == 1][0], events.velocity[events.kind == 1][0])
        for events in (record.events for record in found)
    )
    assert x == pytest.approx(y, abs=2e-10)
    assert v == pytest.approx(w, abs=2e-10)
    # What sticks for ever does not creep by rounding until it slips.
    assert {record.ending.name for record in found} <= {"CONTACT_FOR_EVER", "COUNT_REACHED"}
