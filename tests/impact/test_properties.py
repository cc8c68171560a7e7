"""What holds for every motion of every small chain."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from hypothesis import assume, given, strategies as st

from dynkit.core.validation import Array
from dynkit.systems.impact.chain import ImpactChain
from dynkit.systems.impact.record import ImpactRecord
from dynkit.systems.impact.state import ImpactState, Motion

SIZES = st.floats(0.2, 5.0)


@dataclass(frozen=True)
class Begin:
    """A chain, and a state to start from."""

    chain: ImpactChain
    state: ImpactState

    def simulate(self, impacts: int) -> ImpactRecord:
        return self.chain.simulate(impacts=impacts, start=self.state)


@st.composite
def begins(draw: st.DrawFn) -> Begin:
    n = draw(st.integers(1, 4))
    elements = st.lists(SIZES, min_size=n, max_size=n).map(tuple)
    dashpots = st.lists(st.floats(0.0, 2.0), min_size=n, max_size=n).map(tuple)
    chain = ImpactChain(
        masses=draw(st.just(n) | elements),
        springs=draw(st.just(1.0) | elements),
        damping=draw(st.floats(0.0, 8.0) | st.sampled_from([0.0, 0.1]) | dashpots),
        restitution=draw(st.floats(0.0, 1.0) | st.sampled_from([0.0, 1.0])),
        amplitude=draw(st.floats(0.01, 1.0)),
        offset=draw(st.floats(-1.0, 1.0)),
        frequency=draw(st.floats(0.1, 5.0)),
        chatter_tolerance=draw(st.sampled_from([1e-16, 1e-12, 1e-8])),
    )
    coordinates = st.lists(st.floats(-1.0, 1.0), min_size=n, max_size=n)
    position, velocity = np.array(draw(coordinates)), np.array(draw(coordinates))
    phase = draw(st.floats(0.0, 6.28))
    table = chain.amplitude * math.sin(phase) + chain.offset
    position[-1] = table + draw(st.floats(1e-9, 2.0))
    try:
        state = chain.state(position, velocity, phase)
        chain.simulate(impacts=1, start=state)
    except ValueError as refusal:  # nearly defective dashpots, resonance without damping
        assume("must not" not in str(refusal))
        raise
    return Begin(chain, state)


def without_touches(record: ImpactRecord) -> ImpactRecord:
    """Let the motion pass that grazes: a touch stands to the square root of the rounding."""
    assume(record.cost.counts["touches"] == 0)
    return record


def rounding(record: ImpactRecord) -> Array:
    """What rounding may do to positions at the impacts, (n,); more where modes nearly agree."""
    chain = record.system
    size = 1.0 + abs(record.position).max(initial=0.0) + abs(record.velocity).max(initial=0.0)
    return np.asarray(1e-14 * size * (1.0 + chain.frequency * record.time) + record.error)


@given(begins())
def test_relative_velocities_are_not_negative(begin: Begin) -> None:
    assert (begin.simulate(60).relative_velocity >= 0.0).all()


@given(begins())
def test_times_increase_and_fall_never(begin: Begin) -> None:
    assert (np.diff(begin.simulate(60).time, prepend=0.0) >= 0.0).all()


@given(begins())
def test_the_contact_mass_is_on_the_table_at_impacts(begin: Begin) -> None:
    record = begin.simulate(60)
    table = begin.chain.amplitude * np.sin(record.phase) + begin.chain.offset
    assert (abs(record.position[:, -1] - table) <= rounding(record)).all()


@given(begins())
def test_the_contact_mass_leaves_the_table_with_its_relative_velocity(begin: Begin) -> None:
    record = without_touches(begin.simulate(60))
    table = begin.chain.amplitude * begin.chain.frequency * np.cos(record.phase)
    off = record.velocity[:, -1] - table - record.relative_velocity
    assert (abs(off) <= (1.0 + begin.chain.frequency) * rounding(record)).all()


@given(begins())
def test_phases_are_those_of_the_times(begin: Begin) -> None:
    record = begin.simulate(60)
    turns = (record.phase - begin.state.phase - begin.chain.frequency * record.time) / math.tau
    off = math.tau * abs(turns - np.rint(turns))
    assert (off <= 1e-14 * (1.0 + begin.chain.frequency * record.time)).all()


@given(begins())
def test_no_impact_is_missed(begin: Begin) -> None:
    record = begin.simulate(30)
    assume(len(record) > 0)
    edges = np.append(0.0, record.time)
    part = np.linspace(0.0, 1.0, 42)[1:-1]
    times = (edges[:-1, None] + np.diff(edges)[:, None] * part).ravel()
    phase = begin.state.phase + begin.chain.frequency * times
    table = begin.chain.amplitude * np.sin(phase) + begin.chain.offset
    allowed = np.repeat(rounding(record), len(part))
    assert (record.sample(times)[0][:, -1] - table >= -allowed).all()


@given(begins())
def test_impacts_obey_the_law_of_restitution(begin: Begin) -> None:
    record = without_touches(begin.simulate(30))
    chain = begin.chain
    before = np.nextafter(record.time, 0.0)
    clear = np.diff(record.time, prepend=0.0) > 1e-3
    _, v = record.sample(before[clear])
    phase = begin.state.phase + chain.frequency * before[clear]
    closing = chain.amplitude * chain.frequency * np.cos(phase) - v[:, -1]
    lightest = np.diag(chain.mass).min()
    forces = abs(chain.stiffness).max() * abs(record.position).max(initial=1.0)
    forces += abs(chain.damping_matrix).max() * abs(record.velocity).max(initial=1.0)
    acceleration = float(forces / lightest) + chain.amplitude * chain.frequency**2
    allowed = 1e-13 + record.error[clear] + 4.0 * acceleration * np.spacing(record.time[clear])
    off = record.relative_velocity[clear] - chain.restitution * closing
    assert (abs(off) <= allowed).all()


@given(begins())
def test_section_states_make_the_states_they_are_of(begin: Begin) -> None:
    record = begin.simulate(10)
    for row in record.states:
        again = begin.chain.section_state(begin.chain.impact_state(row))
        assert abs(begin.chain.difference(again, row)).max() <= 1e-13 * (1.0 + abs(row).max())
        assert again[-2] == row[-2]


@given(begins())
def test_packed_states_are_unpacked_to_the_bit(begin: Begin) -> None:
    final = begin.simulate(10).final
    copy = begin.chain.unpack_state(begin.chain.pack_state(final))
    assert copy.motion is final.motion
    assert copy.relative_velocity == final.relative_velocity
    assert copy.position.tobytes() == final.position.tobytes()
    assert copy.velocity.tobytes() == final.velocity.tobytes()


@given(begins(), st.integers(1, 29))
def test_any_two_runs_are_one(begin: Begin, first: int) -> None:
    whole = begin.simulate(30)
    part = begin.simulate(first)
    rest = begin.chain.simulate(impacts=30, start=part.final)
    states = np.concatenate([part.states, rest.states])[: len(whole)]
    assert states.tobytes() == whole.states.tobytes()


@given(begins())
def test_the_energy_is_never_negative(begin: Begin) -> None:
    assert (begin.simulate(30).energy >= 0.0).all()


@given(begins())
def test_contacts_follow_one_another(begin: Begin) -> None:
    record = begin.simulate(60)
    events = record.sticking.ravel()
    assert (np.diff(events[np.isfinite(events)]) >= 0.0).all()
    assert np.isfinite(record.sticking[:-1]).all()


@given(begins())
def test_runs_of_a_count_end_on_the_table(begin: Begin) -> None:
    record = begin.simulate(5)
    if len(record) == 5:
        assert record.final.motion is Motion.TABLE
