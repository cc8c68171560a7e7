"""What holds for every motion of a chain, a single mass, a ball, or a mass with play."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.state import Motion
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.effort import share, shorter_searches
from tests.impact.any_oscillator import Begin, balls, begins, chains, plays, singles, table_at

FAMILIES = {
    "chain": chains(),
    "single": singles(),
    "ball": balls(),
    "play": plays(),
    "matrices": begins(),
}


def each(*families: str) -> pytest.MarkDecorator:
    """For each of these families there are examples of a property, as many as for the others."""
    return pytest.mark.parametrize("family", families)


ONE_MASS = ("single", "ball", "play")
CLASSES = ("chain", *ONE_MASS)


@pytest.fixture(autouse=True, scope="module")
def searches() -> Iterator[None]:
    with shorter_searches(50_000):
        yield


def without_touches(record: ImpactRecord) -> ImpactRecord:
    """Let the motion pass that grazes: a touch stands to the square root of the rounding."""
    assume(record.cost.counts["touches"] == 0)
    return record


def rounding(record: ImpactRecord) -> Array:
    """What rounding may do to positions at the impacts, (n,); more where modes nearly agree."""
    size = 1.0 + abs(record.position).max(initial=0.0) + abs(record.velocity).max(initial=0.0)
    return np.asarray(1e-14 * size * (1.0 + record.system.frequency * record.time) + record.error)


@each(*CLASSES)
@share(0.2)
@given(st.data())
def test_times_increase_and_fall_never(family: str, data: st.DataObject) -> None:
    begin = data.draw(FAMILIES[family])
    assert (np.diff(begin.simulate(60).time, prepend=0.0) >= 0.0).all()


@each("chain", "single", "ball")
@share(0.2)
@given(st.data())
def test_relative_velocities_are_not_negative_at_one_stop(family: str, data: st.DataObject) -> None:
    begin = data.draw(FAMILIES[family])
    assert (begin.simulate(60).relative_velocity >= 0.0).all()


@share(0.5)
@given(chains())
def test_the_contact_mass_is_on_the_table_at_impacts(begin: Begin) -> None:
    record = begin.simulate(60)
    table, _, _ = table_at(begin.system, record.phase)
    assert (abs(record.position[:, -1] - table) <= rounding(record)).all()


@share(0.5)
@given(chains())
def test_the_contact_mass_leaves_the_table_with_its_relative_velocity(begin: Begin) -> None:
    record = without_touches(begin.simulate(60))
    _, table, _ = table_at(begin.system, record.phase)
    off = record.velocity[:, -1] - table - record.relative_velocity
    assert (abs(off) <= (1.0 + begin.system.frequency) * rounding(record)).all()


def at_its_stop(record: ImpactRecord) -> bool:
    """Whether the mass has the place and the velocity of the stop that u tells, and u."""
    system, u = record.system, record.relative_velocity
    sign = 1.0 if system.side == "above" else -1.0
    far = np.signbit(u)
    place = np.where(far, system.offset + sign * system.play, system.offset)
    place += system.amplitude * np.sin(record.phase)
    speed = np.where(far, -sign, sign) * abs(u)
    speed += system.amplitude * system.frequency * np.cos(record.phase)
    # Of the phase, of its sine, and of the sum: 8.5 in all, at most.
    rounding = 2.0**-53 * 9.0
    near = abs(record.position[:, 0] - place) <= rounding * (system.amplitude + abs(place))
    largest = system.amplitude * system.frequency + abs(u)
    return bool((near & (abs(record.velocity[:, 0] - speed) <= rounding * largest)).all())


@each(*ONE_MASS)
@share(0.2)
@given(st.data())
def test_the_mass_is_at_the_stop_that_its_relative_velocity_tells(
    family: str, data: st.DataObject
) -> None:
    begin = data.draw(FAMILIES[family])
    assert at_its_stop(begin.simulate(60))


@pytest.mark.parametrize("play", [math.inf, 0.25])
@pytest.mark.parametrize("side", ["above", "below"])
def test_the_mass_is_at_its_stop_however_far_its_spring_would_pull_it(
    play: float, side: str
) -> None:
    # By 2e7: that many digits less has any difference from where the spring rests.
    system = MatrixOscillator(
        M=[[1.0]],
        C=[[0.0]],
        K=[[1e-8]],
        frequency=1.3,
        restitution=0.9,
        offset=0.03,
        side=side,
        play=play,
        constant_forces=(-0.2 if side == "above" else 0.2,),
    )
    middle = 0.05 if side == "above" else -0.05
    record = system.simulate(impacts=40, start=system.state([middle + 0.03], [2.0], 0.5))
    assert len(record) == 40
    assert np.signbit(record.relative_velocity).any() == (play < math.inf)
    assert at_its_stop(record)
    assert record.final.position[0] == record.position[-1, 0]
    assert record.final.velocity[0] == record.velocity[-1, 0]


@each(*CLASSES)
@share(0.2)
@given(st.data())
def test_phases_are_those_of_the_times(family: str, data: st.DataObject) -> None:
    begin = data.draw(FAMILIES[family])
    record, w = begin.simulate(60), begin.system.frequency
    turns = (record.phase - begin.state.phase - w * record.time) / math.tau
    off = math.tau * abs(turns - np.rint(turns))
    assert (off <= 1e-14 * (1.0 + w * record.time)).all()


@each(*CLASSES)
@share(0.2)
@given(st.data())
def test_no_impact_is_missed(family: str, data: st.DataObject) -> None:
    begin = data.draw(FAMILIES[family])
    record, system = begin.simulate(30), begin.system
    assume(len(record) > 0)
    edges = np.append(0.0, record.time)
    part = np.linspace(0.0, 1.0, 42)[1:-1]
    times = (edges[:-1, None] + np.diff(edges)[:, None] * part).ravel()
    table, _, _ = table_at(system, begin.state.phase + system.frequency * times)
    sign = 1.0 if system.side == "above" else -1.0
    gap = sign * (record.sample(times)[0][:, system.contact] - table)
    allowed = np.repeat(rounding(record), len(part))
    assert (gap >= -allowed).all()
    assert (gap <= system.play + allowed).all()


@each(*CLASSES)
@share(0.2)
@given(st.data())
def test_impacts_obey_the_law_of_restitution(family: str, data: st.DataObject) -> None:
    begin = data.draw(FAMILIES[family])
    record, system = without_touches(begin.simulate(30)), begin.system
    before = np.nextafter(record.time, 0.0)
    clear = np.diff(record.time, prepend=0.0) > 1e-3
    v = record.sample(before[clear])[1][:, system.contact]
    _, table, _ = table_at(system, begin.state.phase + system.frequency * before[clear])
    closing = (table - v) * (1.0 if system.side == "above" else -1.0)
    forces = abs(system.stiffness).max() * abs(record.position).max(initial=1.0)
    forces += abs(system.damping_matrix).max() * abs(record.velocity).max(initial=1.0)
    forces += sum(map(abs, system.harmonic_forces)) + sum(map(abs, system.constant_forces))
    acceleration = float(forces / np.diag(system.mass).min())
    acceleration += system.amplitude * system.frequency**2
    allowed = 1e-13 + record.error[clear] + 4.0 * acceleration * np.spacing(record.time[clear])
    off = record.relative_velocity[clear] - system.restitution * closing
    assert (abs(off) <= allowed).all()


@each(*CLASSES)
@share(0.2)
@given(st.data())
def test_section_states_make_the_states_they_are_of(family: str, data: st.DataObject) -> None:
    begin = data.draw(FAMILIES[family])
    record, system = begin.simulate(10), begin.system
    for row in record.states:
        again = system.section_state(system.impact_state(row))
        assert abs(system.difference(again, row)).max() <= 1e-13 * (1.0 + abs(row).max())
        assert again[-2] == row[-2]


@each(*CLASSES)
@share(0.2)
@given(st.data())
def test_packed_states_are_unpacked_to_the_bit(family: str, data: st.DataObject) -> None:
    begin = data.draw(FAMILIES[family])
    final = begin.simulate(10).final
    copy = begin.system.unpack_state(begin.system.pack_state(final))
    assert copy.motion is final.motion
    assert copy.relative_velocity == final.relative_velocity
    assert copy.position.tobytes() == final.position.tobytes()
    assert copy.velocity.tobytes() == final.velocity.tobytes()


@each(*FAMILIES)
@share(0.2)
@given(st.data(), st.integers(1, 29))
def test_any_two_runs_are_one(family: str, data: st.DataObject, first: int) -> None:
    begin = data.draw(FAMILIES[family])
    whole, part = begin.simulate(30), begin.simulate(first)
    rest = begin.system.simulate(impacts=30, start=part.final)
    states = np.concatenate([part.states, rest.states])[: len(whole)]
    assert states.tobytes() == whole.states.tobytes()
    if whole.ending is not Ending.COUNT_REACHED:
        assert rest.ending is whole.ending


@share(0.5)
@given(chains())
def test_the_energy_is_never_negative(begin: Begin) -> None:
    assert (begin.simulate(30).energy >= 0.0).all()


@each(*CLASSES)
@share(0.2)
@given(st.data())
def test_contacts_follow_one_another(family: str, data: st.DataObject) -> None:
    begin = data.draw(FAMILIES[family])
    record = begin.simulate(60)
    events = record.sticking.ravel()
    assert (np.diff(events[np.isfinite(events)]) >= 0.0).all()
    assert np.isfinite(record.sticking[:-1]).all()


@share(0.5)
@given(chains())
def test_runs_of_a_count_end_on_the_table(begin: Begin) -> None:
    record = begin.simulate(5)
    if len(record) == 5:
        assert record.final.motion is Motion.TABLE


@share(0.5)
@given(balls())
def test_a_ball_never_leaves_for_ever(begin: Begin) -> None:
    assert begin.simulate(60).ending.name != "NO_FURTHER_CONTACT"
