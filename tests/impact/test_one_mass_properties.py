"""What holds for every motion of a single mass, a ball, or a mass with play."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from dynkit.core.validation import Array
from dynkit.systems.impact.ball import BouncingBall
from dynkit.systems.impact.matrices import MatrixOscillator
from dynkit.systems.impact.oscillator import ImpactOscillator
from dynkit.systems.impact.play import PlayOscillator
from dynkit.systems.impact.record import ImpactRecord
from dynkit.systems.impact.single import SingleImpactOscillator
from dynkit.systems.impact.state import ImpactState
from tests.effort import shorter_searches

SHARE = st.just(0.0) | st.floats(1e-100, 1.0)
RESTITUTION = st.floats(0.0, 1.0) | st.sampled_from([0.0, 1.0])
TOLERANCE = st.sampled_from([1e-16, 1e-12, 1e-8])


@pytest.fixture(autouse=True, scope="module")
def searches() -> Iterator[None]:
    with shorter_searches(50_000):
        yield


@dataclass(frozen=True)
class Begin:
    """A system, and a state to start from."""

    system: ImpactOscillator
    state: ImpactState

    def simulate(self, impacts: int) -> ImpactRecord:
        return self.system.simulate(impacts=impacts, start=self.state)


@st.composite
def singles(draw: st.DrawFn) -> Begin:
    system = SingleImpactOscillator(
        frequency=draw(st.floats(0.1, 8.0)),
        damping_ratio=draw(st.sampled_from([0.0, 1.0]) | st.floats(1e-3, 3.0)),
        force=draw(SHARE),
        stop=draw(SHARE) * draw(st.sampled_from([-1.0, 1.0])),
        restitution=draw(RESTITUTION),
        chatter_tolerance=draw(TOLERANCE),
    )
    place, speed = system.stop - draw(st.floats(1e-9, 2.0)), draw(st.floats(-2.0, 2.0))
    return Begin(system, system.state([place], [speed], draw(st.floats(0.0, 6.28))))


@st.composite
def balls(draw: st.DrawFn) -> Begin:
    system = BouncingBall(
        frequency=draw(st.floats(0.1, 8.0)),
        amplitude=draw(st.just(0.0) | st.floats(0.01, 1.0)),
        gravity=draw(st.floats(0.1, 10.0)),
        restitution=draw(RESTITUTION),
        chatter_tolerance=draw(TOLERANCE),
    )
    phase = draw(st.floats(0.0, 6.28))
    place = system.amplitude * math.sin(phase) + draw(st.floats(1e-9, 2.0))
    return Begin(system, system.state([place], [draw(st.floats(-2.0, 2.0))], phase))


@st.composite
def plays(draw: st.DrawFn) -> Begin:
    system = PlayOscillator(
        frequency=draw(st.floats(0.1, 8.0)),
        play=draw(st.floats(0.1, 3.0)),
        spring=draw(st.just(0.0) | st.floats(1e-2, 4.0)),
        damping=draw(st.just(0.0) | st.floats(1e-2, 4.0)),
        force=draw(SHARE) * draw(st.sampled_from([-1.0, 1.0])),
        amplitude=draw(st.just(0.0) | st.floats(0.01, 1.0)),
        restitution=draw(RESTITUTION),
        chatter_tolerance=draw(TOLERANCE),
    )
    phase = draw(st.floats(0.0, 6.28))
    part = draw(st.floats(-0.499, 0.499))
    place = system.amplitude * math.sin(phase) + part * system.play
    return Begin(system, system.state([place], [draw(st.floats(-2.0, 2.0))], phase))


BEGINS = singles() | balls() | plays()


def rounding(record: ImpactRecord) -> Array:
    """What rounding may do to positions at the impacts, (n,)."""
    size = 1.0 + abs(record.position).max(initial=0.0) + abs(record.velocity).max(initial=0.0)
    return np.asarray(1e-14 * size * (1.0 + record.system.frequency * record.time) + record.error)


def gap(system: ImpactOscillator, position: Array, phase: Array) -> Array:
    """Distance from the (near) stop."""
    sign = 1.0 if system.side == "above" else -1.0
    return sign * (position - system.amplitude * np.sin(phase) - system.offset)


def closing_speed(system: ImpactOscillator, velocity: Array, phase: Array) -> Array:
    """How fast the distance from the (near) stop decreases."""
    sign = 1.0 if system.side == "above" else -1.0
    return -sign * (velocity - system.amplitude * system.frequency * np.cos(phase))


@given(BEGINS)
def test_times_increase(begin: Begin) -> None:
    assert (np.diff(begin.simulate(60).time, prepend=0.0) >= 0.0).all()


@given(singles() | balls())
def test_relative_velocities_are_not_negative_at_one_stop(begin: Begin) -> None:
    assert (begin.simulate(60).relative_velocity >= 0.0).all()


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


@given(BEGINS)
def test_the_mass_is_at_the_stop_that_its_relative_velocity_tells(begin: Begin) -> None:
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


@given(BEGINS)
def test_no_impact_is_missed(begin: Begin) -> None:
    record, system = begin.simulate(30), begin.system
    assume(len(record) > 0)
    edges = np.append(0.0, record.time)
    part = np.linspace(0.0, 1.0, 42)[1:-1]
    times = (edges[:-1, None] + np.diff(edges)[:, None] * part).ravel()
    phase = begin.state.phase + system.frequency * times
    distance = gap(system, record.sample(times)[0][:, 0], phase)
    allowed = np.repeat(rounding(record), len(part))
    assert (distance >= -allowed).all()
    assert (distance <= system.play + allowed).all()


@given(BEGINS)
def test_impacts_obey_the_law_of_restitution(begin: Begin) -> None:
    record, system = begin.simulate(30), begin.system
    assume(record.cost.counts["touches"] == 0)
    before = np.nextafter(record.time, 0.0)
    clear = np.diff(record.time, prepend=0.0) > 1e-3
    v = record.sample(before[clear])[1][:, 0]
    phase = begin.state.phase + system.frequency * before[clear]
    closing = closing_speed(system, v, phase)
    forces = system.stiffness[0, 0] * abs(record.position).max(initial=1.0)
    forces += system.damping_matrix[0, 0] * abs(record.velocity).max(initial=1.0)
    forces += sum(map(abs, system.harmonic_forces)) + sum(map(abs, system.constant_forces))
    acceleration = float(forces) + system.amplitude * system.frequency**2
    allowed = rounding(record)[clear] * (1.0 + system.frequency)
    allowed += 4.0 * acceleration * np.spacing(record.time[clear])
    off = record.relative_velocity[clear] - system.restitution * closing
    assert (abs(off) <= allowed).all()


@given(BEGINS)
def test_phases_are_those_of_the_times(begin: Begin) -> None:
    record, w = begin.simulate(60), begin.system.frequency
    turns = (record.phase - begin.state.phase - w * record.time) / math.tau
    off = math.tau * abs(turns - np.rint(turns))
    assert (off <= 1e-14 * (1.0 + w * record.time)).all()


@given(BEGINS)
def test_areas_shrink_as_dashpot_and_impacts_take_them(begin: Begin) -> None:
    # u du dphase, by r^2 exp(-c t) in every flight and impact.
    record, system = begin.simulate(6), begin.system
    assume(len(record) == 6)
    assume(not len(record.sticking))
    u, c = record.relative_velocity, float(system.damping_matrix[0, 0])
    for i in range(1, 5):
        assume(abs(u[i]) > 1e-3)
        assume(abs(u[i + 1]) > 1e-3)
        jacobian = system.jacobian(record.states[i])
        wait = record.time[i + 1] - record.time[i]
        expected = system.restitution**2 * math.exp(-c * wait) * u[i] / u[i + 1]
        # The terms of the determinant cancel; elements change by their squares over u.
        steep = 1.0 + abs(jacobian).max()
        allowed = 1e-13 * steep**3 / abs(u[i + 1]) * (1.0 + abs(record.states).max())
        assert abs(np.linalg.det(jacobian) - expected) <= allowed


@given(BEGINS, st.integers(1, 29))
def test_any_two_runs_are_one(begin: Begin, first: int) -> None:
    whole = begin.simulate(30)
    part = begin.simulate(first)
    rest = begin.system.simulate(impacts=30, start=part.final)
    states = np.concatenate([part.states, rest.states])[: len(whole)]
    assert states.tobytes() == whole.states.tobytes()


@given(BEGINS)
def test_packed_states_are_unpacked_to_the_bit(begin: Begin) -> None:
    final = begin.simulate(10).final
    copy = begin.system.unpack_state(begin.system.pack_state(final))
    assert copy.motion is final.motion
    assert copy.relative_velocity == final.relative_velocity
    assert copy.position.tobytes() == final.position.tobytes()
    assert copy.velocity.tobytes() == final.velocity.tobytes()


@given(BEGINS)
def test_contacts_follow_one_another(begin: Begin) -> None:
    record = begin.simulate(60)
    events = record.sticking.ravel()
    assert (np.diff(events[np.isfinite(events)]) >= 0.0).all()
    assert np.isfinite(record.sticking[:-1]).all()


@given(balls())
def test_a_ball_never_leaves_for_ever(begin: Begin) -> None:
    assert begin.simulate(60).ending.name != "NO_FURTHER_CONTACT"
