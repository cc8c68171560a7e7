"""Machines with several hard stops: closed forms, symmetries, and what has no unique answer."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dynkit
from dynkit.analysis import LyapunovSpectrum
from dynkit.core.differences import numerical_derivative
from dynkit.core.no_motion import NoDerivative, Refused
from dynkit.systems import (
    DryFriction,
    Element,
    HardStop,
    ImpactChain,
    Jenkins,
    MatrixOscillator,
    PlayOscillator,
)
from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.validation.machines import compared

TABLE = HardStop(-1, amplitude=0.1, restitution=0.85, name="table")
GEAR = HardStop((0, 1), offset=-0.02, restitution=0.5, name="gear")
MACHINE = ImpactChain(masses=3, frequency=0.9, harmonic_forces=[0.1, 0, 0], elements=[TABLE, GEAR])


def free(stops: list[HardStop], weight: float = 0.0, masses: Any = None) -> MatrixOscillator:
    """Masses without springs, their weights, and stops."""
    own = np.ones(max(np.ravel(stop.coordinate).astype(int).max() for stop in stops) + 1)
    given = own if masses is None else np.array(masses)
    none = np.zeros((len(given), len(given)))
    weights = -weight * given
    return MatrixOscillator(
        M=np.diag(given), C=none, K=none, frequency=1.0, constant_forces=weights, elements=stops
    )


def row_of_balls(count: int, restitution: float) -> MatrixOscillator:
    return free([HardStop((k, k + 1), restitution=restitution) for k in range(count - 1)])


@pytest.mark.parametrize("count", [2, 3, 7])
def test_equal_balls_exchange_their_velocities(count: int) -> None:
    balls = row_of_balls(count, 1.0)
    start = balls.state(np.arange(count), [1.0] + [0.0] * (count - 1))
    record = balls.simulate(impacts=count, start=start)
    assert record.ending is Ending.NO_FURTHER_CONTACT
    assert record.element.tolist() == list(range(count - 1))
    assert record.time.tolist() == list(range(1, count))
    assert (record.velocity == np.eye(count)[1:]).all()
    assert record.ambiguous is None


@pytest.mark.parametrize("speed", [0.0, 1e-20, -1e-20, 1e-15])
def test_a_mass_lies_on_another_stop_but_for_the_rounding_of_all_coordinates(speed: float) -> None:
    # pressed by three; as states of orbits are, in which changes of coordinates leave rounding
    stops = [HardStop(0, offset=-0.2, restitution=0.6), HardStop(2, restitution=0.5)]
    forces: dict[str, Any] = {
        "harmonic_forces": [0.4, 0.2, 0.1],
        "constant_forces": [0.0, 0.0, -3.0],
    }
    machine = ImpactChain(masses=3, frequency=0.9, elements=stops, **forces)
    state = machine.impact_state(np.array([0.1, 0.1 * abs(speed), -0.6, speed, 0.5, 4.2]))
    assert state.closed == (1,)
    record = machine.simulate(impacts=1, start=state)
    assert record.element.tolist() == [0]  # not an impact of rounding on the other stop
    assert record.error[0] < 1e-12


@pytest.mark.parametrize("restitution", [0.5, 0.75, 0.9])
def test_the_last_ball_of_a_row_is_as_fast_as_the_closed_form_says(restitution: float) -> None:
    count = 6
    balls = row_of_balls(count, restitution)
    start = balls.state(np.arange(count), [1.0] + [0.0] * (count - 1))
    record = balls.simulate(impacts=count - 1, start=start)
    fastest = record.velocity[-1, -1]
    assert fastest == pytest.approx((0.5 * (1.0 + restitution)) ** (count - 1), rel=1e-14)
    assert record.velocity.sum(axis=1) == pytest.approx(np.ones(count - 1), rel=1e-14)


def test_two_stops_that_face_each_other_are_a_play() -> None:
    numbers: dict[str, Any] = {"amplitude": 0.2, "restitution": 0.3}
    play = PlayOscillator(play=2.0, frequency=0.7, spring=0.2, damping=0.1, force=0.6, **numbers)
    facing = [HardStop(0, offset=-1.0, **numbers), HardStop(0, offset=1.0, side="below", **numbers)]
    pair = MatrixOscillator(
        M=[[1.0]], C=[[0.1]], K=[[0.2]], frequency=0.7, harmonic_forces=[0.6], elements=facing
    )
    start = play.state()
    one = play.simulate(impacts=100, start=start)
    other = pair.simulate(impacts=100, start=pair.state(start.position, start.velocity))
    assert (one.time == other.time).all()
    assert (one.velocity == other.velocity).all()
    assert (abs(one.relative_velocity) == other.relative_velocity).all()
    assert (other.relative_velocity >= 0.0).all()
    assert str(one.as_attractor().label) == str(other.as_attractor().label) == "P(2,1)"
    assert one.second_moments().products == pytest.approx(other.second_moments().products)
    assert len(set(other.element)) == 2


def test_the_order_of_elements_does_not_matter() -> None:
    other = MACHINE.replace(elements=MACHINE.elements[::-1])
    one, two = MACHINE.simulate(impacts=60), other.simulate(impacts=60)
    assert two.time == pytest.approx(one.time, abs=1e-10)
    assert two.position == pytest.approx(one.position, abs=1e-10)
    assert (two.element == 1 - one.element).all()
    assert str(MACHINE.attractor().label) == str(other.attractor().label)


def test_a_mirrored_machine_moves_as_its_mirror() -> None:
    def mirrored(stop: HardStop) -> HardStop:
        side = "below" if stop.side == "above" else "above"
        return replace(stop, offset=-stop.offset, phase=stop.phase + np.pi, side=side)

    forces = [-f for f in MACHINE.harmonic_forces]
    mirror = MACHINE.replace(
        harmonic_forces=forces, elements=[mirrored(stop) for stop in MACHINE.elements]
    )
    start = MACHINE.state()
    one = MACHINE.simulate(impacts=40, start=start)
    two = mirror.simulate(impacts=40, start=mirror.state(-start.position, -start.velocity))
    assert two.position == pytest.approx(-one.position, abs=1e-10)
    assert (two.element == one.element).all()


def test_elastic_impacts_keep_the_energy() -> None:
    stops = [
        HardStop(2, offset=-0.1, restitution=1.0),
        HardStop((0, 1), offset=-0.2, restitution=1.0),
    ]
    stops += [HardStop(0, offset=0.4, side="below", restitution=1.0)]
    chain = ImpactChain(masses=3, damping=0.0, frequency=1.0, elements=stops)
    record = chain.simulate(impacts=2000)
    assert set(record.element) == {0, 1, 2}
    assert abs(record.energy / record.energy[0] - 1.0).max() < 1e-12


# --- impacts while other stops are in contact ----------------------------------------------------


def test_an_impact_that_pulls_from_a_stop_opens_it() -> None:
    # Falls of 2 and 0: their sum has the rate -2, each gets half of 1.6 times 2.
    pair = free(
        [HardStop(0, restitution=0.5), HardStop([1.0, 1.0], offset=1.0, restitution=0.6)], 1.0
    )
    record = pair.simulate(impacts=1, start=pair.state([0.0, 3.0]))
    assert record.velocity[0] == pytest.approx([1.6, -0.4], abs=1e-15)
    events = record.events
    assert events.kind.tolist() == [EventKind.CONTACT, EventKind.RELEASE, EventKind.IMPACT]
    assert events.element.tolist() == [0, 0, 1]
    assert record.sticking.tolist() == [[0.0, 2.0]]
    assert record.ambiguous is None
    assert record.error[0] < 1e-13
    assert record.final.closed == ()


def test_an_impact_that_pushes_against_a_stop_is_ambiguous() -> None:
    stack = free([HardStop(0, restitution=0.5), HardStop((0, 1), restitution=0.5)], 1.0)
    record = stack.simulate(impacts=2, start=stack.state([0.0, 2.0]))
    assert record.velocity[0] == pytest.approx([0.0, 1.0], abs=1e-15)
    assert record.ambiguous == 0
    assert (record.error == np.inf).all()
    assert record.as_attractor().error == np.inf
    assert record.final.closed == (0,)
    before = stack.section_state(stack.state([0.0, 2.0]))
    with pytest.raises(NoDerivative, match="choice of law"):
        stack.jacobian(before)


def test_impacts_at_once_are_ambiguous_where_they_change_each_other() -> None:
    balls = row_of_balls(3, 1.0)
    start = balls.state([0.0, 1.0, 2.0], [1.0, 0.0, -1.0])
    record = balls.simulate(impacts=3, start=start)
    assert record.ambiguous == 0
    apart = free([HardStop(0, restitution=0.5), HardStop(1, restitution=0.7)])
    record = apart.simulate(impacts=2, start=apart.state([1.0, 1.0], [-1.0, -1.0]))
    assert record.ambiguous is None
    assert record.time.tolist() == [1.0, 1.0]
    assert record.velocity[-1].tolist() == [0.5, 0.7]


def test_a_stack_of_masses_comes_to_rest() -> None:
    stops = [HardStop(0, restitution=0.3), *(HardStop((k, k + 1), restitution=0.3) for k in (0, 1))]
    stack = free(stops, 1.0, [3.0, 2.0, 1.0])
    record = stack.simulate(impacts=10_000, start=stack.state([0.5, 1.0, 2.0]))
    assert record.ending is Ending.CONTACT_FOR_EVER
    assert len(record) < 1000
    assert record.ambiguous is not None
    resting = stack.simulate(impacts=1, start=stack.state([0.0, 0.0, 0.0]))
    assert resting.ending is Ending.CONTACT_FOR_EVER
    assert len(resting) == 0
    assert sorted([resting.final.element, *resting.final.closed]) == [0, 1, 2]
    position, velocity = resting.sample([0.0, 3.0])
    assert not position.any()
    assert not velocity.any()


def test_without_weight_touching_stops_stay_as_they_are() -> None:
    rest = free([HardStop(0), HardStop((0, 1))]).simulate(impacts=1)
    assert len(rest) == 0


# --- ends with a name ----------------------------------------------------------------------------


@pytest.mark.parametrize(("restitution", "together"), [(0.06, True), (0.08, False)])
def test_an_inelastic_collapse_is_completed(restitution: float, together: bool) -> None:
    # Three equal balls collide without end for r < 7 - 4 sqrt(3) = 0.0718, and then are one.
    balls = row_of_balls(3, restitution)
    start = balls.state([0.0, 1.0, 2.0], [1.3, 0.0, -1.0])
    record = balls.simulate(impacts=10_000, start=start)
    assert len(record) < 200
    assert (record.ambiguous is not None) is together
    assert record.ending is (Ending.CONTACT_FOR_EVER if together else Ending.NO_FURTHER_CONTACT)
    if together:
        assert record.sample([5.0])[1] == pytest.approx(np.full((1, 3), 0.1), abs=1e-14)


def test_closing_walls_end_the_motion() -> None:
    walls = [
        HardStop(0, offset=-1.0, amplitude=0.5, restitution=0.3),
        HardStop(0, offset=-0.9, side="below", restitution=0.3),
    ]
    squeezed = free(walls)
    record = squeezed.simulate(impacts=10_000, start=squeezed.state([-0.95], [0.5]))
    assert record.ending is Ending.COLLAPSED
    assert record.time[-1] == pytest.approx(np.arcsin(0.2), abs=1e-12)
    assert len(record) < 3000


def test_what_a_stop_holds_jams_against_another_one() -> None:
    # The weight holds the mass on a table that rises into a ceiling.
    table = HardStop(0, amplitude=0.5, restitution=0.0)
    jammed = free([table, HardStop(0, offset=0.3, side="below")], 1.0)
    record = jammed.simulate(impacts=5, start=jammed.state([0.0], [0.5]))
    assert record.ending is Ending.JAMMED
    assert len(record) == 0
    position, _ = record.sample([0.1])
    assert position[0, 0] == pytest.approx(0.5 * np.sin(0.1), abs=1e-15)
    assert jammed.simulate(impacts=5, start=record.final).ending is Ending.JAMMED


def test_another_stop_lifts_what_a_stop_holds() -> None:
    # Two lifts below one mass: it lies on the slow one until the fast one comes from below.
    lifts = [
        HardStop(0, amplitude=0.1, restitution=0.0),
        HardStop(0, offset=-0.4, amplitude=0.6, restitution=0.5, name="fast"),
    ]
    machine = free(lifts, 1.0)
    start = machine.state([0.0], [0.1])
    record = machine.simulate(impacts=8, start=start)
    found = compared(machine, start)
    assert not found.wrong
    assert not found.ended
    assert len(record) == 8
    # on the slow lift until 0.5 sin = 0.4, where the fast one is faster by 0.5 cos = 0.3
    assert record.element[0] == 1
    assert record.time[0] == pytest.approx(np.arcsin(0.8), abs=1e-13)
    assert record.relative_velocity[0] == pytest.approx(0.15, abs=1e-13)
    assert record.error[0] < 1e-12
    for state in record.states[:3]:
        expected, error = numerical_derivative(machine, state)
        assert (abs(machine.jacobian(state) - expected) <= 1e-8 + error).all()


def test_no_clearance() -> None:
    walls = [
        HardStop(0, amplitude=0.2, restitution=0.3),
        HardStop(0, amplitude=0.2, side="below", restitution=0.3),
    ]
    held = MatrixOscillator(
        M=[[1.0]], C=[[0.1]], K=[[0.2]], frequency=0.7, harmonic_forces=[0.6], elements=walls
    )
    record = held.simulate(impacts=20)
    times = np.linspace(0.0, record.time[-1], 50)
    position = record.sample(times)[0][:, 0]
    assert abs(position - 0.2 * np.sin(0.7 * times)).max() < 1e-11


@pytest.mark.parametrize("rub", [DryFriction(0, force=0.1), Jenkins(0, stiffness=2.0, force=0.1)])
def test_no_clearance_beside_friction(rub: Element) -> None:
    def between(*more: Element, swing: float = 0.2) -> MatrixOscillator:
        walls = [
            HardStop(0, amplitude=swing, restitution=0.3, side=side) for side in ("above", "below")
        ]
        return MatrixOscillator(
            M=[[1.0]],
            C=[[0.1]],
            K=[[0.2]],
            frequency=0.7,
            harmonic_forces=[0.6],
            elements=[*walls, *more],
        )

    record = between(rub).simulate(impacts=20)
    times = np.linspace(0.0, record.time[-1], 50)
    position = record.sample(times)[0][:, 0]
    assert abs(position - 0.2 * np.sin(0.7 * times)).max() < 1e-11
    still = between(rub, swing=0.0)
    assert still.state([0.0], [0.0]).closed == ()  # two along one row are not held both
    assert abs(still.simulate(impacts=3).position).max() == 0.0


def test_stops_that_leave_no_room_are_refused() -> None:
    with pytest.raises(Refused, match="must leave room between their stops"):
        free([HardStop(0, offset=1.0), HardStop(0, offset=0.5, side="below")]).state()


# --- the map, and what stands on it --------------------------------------------------------------


def test_section_coordinates_name_the_stop() -> None:
    record = MACHINE.simulate(impacts=60)
    assert set(record.element) == {0, 1}
    for y, image in zip(record.states[:-1], record.states[1:], strict=True):
        state = MACHINE.impact_state(y)
        assert MACHINE.section_state(state) == pytest.approx(y, abs=1e-13)
        assert abs(MACHINE.difference(MACHINE(y), image)).max() < 1e-12
        numbers = MACHINE.pack_state(state)
        assert (MACHINE.unpack_state(numbers).position == state.position).all()
    one, other = (record.states[record.element == k][0] for k in (0, 1))
    assert abs(MACHINE.difference(one, other)[-1]) > np.pi
    with pytest.raises(Refused, match=r"state\[5\] must be a phase and 4 pi times the number"):
        MACHINE.impact_state(np.array([0.0, 0.1, 0.0, 0.0, 0.1, 30.0]))


@pytest.mark.parametrize("restitution", [0.5, 0.0])
def test_derivatives_with_several_stops_are_differences(restitution: float) -> None:
    # Without rebound a stop is in contact while the others are hit, or open it.
    stops = [
        HardStop(2, amplitude=0.1, restitution=restitution),
        HardStop((0, 1), offset=-0.2, restitution=0.5),
        HardStop([1.0, 0.5, 0.5], offset=-0.1, phase=0.3, amplitude=0.2, restitution=0.6),
    ]
    chain = ImpactChain(masses=3, frequency=0.9, elements=stops, harmonic_forces=[0.3, -0.2j, 0.1])
    record = chain.simulate(impacts=60)
    run, checked = record._run, 0
    contacts = len(record.sticking)
    assert bool(contacts) is (restitution == 0.0)
    for k in range(10, 50):
        state = record.states[k]
        if run.closed(run.log.guard[k]) or run.ambiguous >= 0:
            continue
        others = [e for e in stops if e is not stops[record.element[k]]]
        sine, cosine = np.sin(record.phase[k]), np.cos(record.phase[k])
        gaps = [e.row(3) @ record.position[k] - e.offset - e.swing(sine, cosine) for e in others]
        if min(gaps) < 1e-3:
            continue  # just opened: on one side there is no motion
        twice = chain.jacobian(chain(state)) @ chain.jacobian(state)
        size, best = 1e-6, np.inf
        landed = restitution == 0.0 and record.element[k] == 0
        directions = [d for d in range(6) if d != 4 or not landed]
        changes = [
            chain.difference(chain(chain(state + size * e)), chain(chain(state - size * e)))
            for e in np.eye(6)[directions]
        ]
        off = abs(twice[:, directions] - np.array(changes).T / (2.0 * size)).max()
        best = min(best, off / max(1.0, abs(twice).max()))
        assert best < 1e-5
        checked += 1
    assert checked >= 12


def test_the_derivative_through_an_impact_that_opens_a_stop_is_a_difference() -> None:
    stops = [
        HardStop(0, amplitude=0.02, restitution=0.0),
        HardStop([1.0, 1.0], offset=1.0, amplitude=0.3, phase=1.0, restitution=0.6),
    ]
    pair = free(stops, 1.0, [1.0, 2.0])
    y = np.array([3.0, 0.2, 0.0, 0.3])
    record = pair.simulate(impacts=1, start=pair.impact_state(y))
    assert record.events.kind.tolist()[-2:] == [EventKind.RELEASE, EventKind.IMPACT]
    exact, size = pair.jacobian(y), 1e-6
    for k in (0, 1, 3):  # on one side of a velocity of zero there is no motion
        step = size * np.eye(4)[k]
        change = pair.difference(pair(y + step), pair(y - step)) / (2.0 * size)
        assert abs(exact[:, k] - change).max() < 1e-8


def test_what_is_measured_of_several_stops() -> None:
    attractor = MACHINE.attractor()
    label = attractor.label
    assert label.periods is not None
    assert label.iterates is not None
    spectrum = LyapunovSpectrum(attractor, iterations=200 * label.iterates)
    assert spectrum.exponents.max() < 0.0
    per_impact = np.log(abs(label.multiplier)) / label.iterates
    assert per_impact == pytest.approx(spectrum.exponents.max(), abs=5e-3)
    record = attractor.record
    moments = record.second_moments()
    times = np.linspace(0.0, record.time[-1], 400_001)
    x = record.sample(times)[0]
    mean = np.trapezoid(x, times, axis=0) / times[-1]
    assert abs(moments.sums.sum(axis=0) / times[-1] - mean).max() < 1e-6


def test_orbits_and_branches_of_several_stops() -> None:
    attractor = MACHINE.attractor()
    count = attractor.label.iterates
    orbit = dynkit.periodic_orbit(MACHINE, attractor.states[-1], period=count)
    assert orbit.stable
    assert abs(orbit.multipliers).max() == pytest.approx(abs(attractor.label.multiplier), abs=1e-6)
    with pytest.raises(NotImplementedError, match="HardStop"):
        MACHINE.periodic_orbit(phases=[0.1])


def test_parameters_of_all_stops_are_swept() -> None:
    found = dynkit.sweep(
        MACHINE, "gear.restitution", [0.4, 0.5, 0.6], transient=100, keep=20, progress=False
    )
    assert found.counts.tolist() == [20, 20, 20]
    assert MACHINE.replace(**{"gear.offset": -0.1}).elements[1].offset == -0.1


def test_a_state_goes_on_while_another_stop_is_closed() -> None:
    stops = [
        HardStop(1, amplitude=0.1, restitution=0.0, name="table"),
        HardStop(0, offset=0.3, side="below", restitution=0.6),
    ]
    chain = ImpactChain(
        masses=2,
        frequency=0.75,
        harmonic_forces=[1.0, 0.0],
        constant_forces=[0.0, -0.5],
        elements=stops,
    )
    whole = chain.simulate(impacts=40)
    run = whole._run
    closed = [k for k in range(1, 39) if run.closed(run.log.guard[k - 1])]
    assert len(closed) >= 3
    for k in closed:
        final = chain.simulate(impacts=k).final
        assert final.closed == (0,)
        for start in (final, chain.unpack_state(chain.pack_state(final))):
            rest = chain.simulate(impacts=40 - k, start=start)
            assert abs(rest.states - whole.states[k:]).max() < 1e-11
        other = chain.replace(**{"table.offset": 0.01})
        entered = other.simulate(impacts=1, start=final).start
        assert entered.closed == (0,)
        table = 0.1 * np.sin(entered.phase) + 0.01
        assert entered.position[1] == pytest.approx(table, abs=1e-14)


def test_twenty_stops() -> None:
    stops: list[HardStop] = []
    for k in range(10):
        stops.append(HardStop(k, offset=-0.05 * (k + 1), restitution=0.6))
        stops.append(HardStop(k, offset=0.05 * (k + 1), side="below", restitution=0.6))
    chain = ImpactChain(masses=10, frequency=0.5, harmonic_forces=[0.1] * 10, elements=stops)
    record = chain.simulate(impacts=300)
    assert len(record) == 300
    assert len(set(record.element)) > 5
    assert len(chain._automaton.modes) < 300


def both(harmonic: float, coupling: float, *elements: Element) -> MatrixOscillator:
    """Two equal masses that are driven alike, with the same elements each."""
    own = [replace(e, coordinate=k) for k in (0, 1) for e in elements]
    return MatrixOscillator(
        M=np.eye(2),
        C=0.1 * np.eye(2),
        K=[[1.0 + coupling, -coupling], [-coupling, 1.0 + coupling]],
        frequency=0.9,
        harmonic_forces=[harmonic] * 2,
        elements=own,
    )


@pytest.mark.parametrize(
    "elements",
    [
        [HardStop(0, offset=-0.3, restitution=0.7)],
        [HardStop(0, offset=-0.3, restitution=0.0), DryFriction(0, force=0.1)],
        [HardStop(0, offset=-0.3, restitution=0.5), Jenkins(0, stiffness=1.0, force=0.1)],
    ],
    ids=["stop", "friction", "slider"],
)
def test_equal_masses_hit_their_stops_at_the_same_time(elements: list[Element]) -> None:
    """Each moves as it would alone; rounding does not choose which of them is first."""
    pair, alone = both(0.8, 1.0, *elements), both(0.8, 0.0, *elements)
    alone = alone.replace(elements=[e for e in alone.elements if e.coordinate == 0])
    record, single = (
        machine.simulate(impacts=n, start=machine.state([0.1, 0.1], [0.2, 0.2]))
        for machine, n in ((pair, 40), (alone, 20))
    )
    assert record.element.tolist() == [0, 1] * 20
    within = single.error + record.error[1::2]
    assert within.max() < 1e-11
    for first in (0, 1):
        assert (abs(record.time[first::2] - single.time) < within + 1e-14).all()
    assert (abs(record.position[1::2] - single.position[:, :1]).max(axis=1) <= within).all()
    assert (abs(record.velocity[1::2] - single.velocity[:, :1]).max(axis=1) <= within).all()


def test_the_label_of_a_symmetric_machine_counts_both_stops() -> None:
    assert (
        str(both(0.8, 1.0, HardStop(0, offset=-0.3, restitution=0.7)).attractor().label) == "P(2,1)"
    )
