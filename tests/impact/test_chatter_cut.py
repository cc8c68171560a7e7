"""Chatter cut short and replaced by contact: what that changes, against 50 digits.

Each case starts early in a chatter and is simulated with tolerances that bring the relative
velocity of the cut down to half and less each time. The reference bounces on until what it leaves
out is below 1e-22; then comes contact, release and the next impact.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.systems.impact.impact_map import ImpactMap
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from tests.reference.general_oscillator import GeneralOscillator, History, Impact

BITS, LAST = 256, 1e-7
"""The reference cuts at this part of the fastest impact, which leaves an error below 1e-22."""

ROUNDING, ROUNDING_IN_FLIGHT = 2e-14, 5e-15
"""Of the section coordinates of an impact, and of positions and velocities a few bounces on."""

FIRST, SPARED, LEAST = 1e-4, 8.0, 3e-13
"""Tolerances: the first, what divides the last error for the next one, and where to end."""

LINE = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
FULL = np.array([[2.0, 0.5, 0.2], [0.5, 1.0, 0.4], [0.2, 0.4, 1.5]])


# --- cases ----------------------------------------------------------------------------------------

MOVING: dict[str, ImpactOscillator] = {
    "paper at 0.202": ImpactChain(frequency=0.202),
    "paper at 0.408": ImpactChain(frequency=0.408),
    "two masses, restitution 0.3": ImpactChain(masses=2, frequency=0.3, restitution=0.3),
    "three masses, restitution 0.6": ImpactChain(masses=3, frequency=0.3, restitution=0.6),
    "three masses, restitution 0.85": ImpactChain(masses=3, frequency=0.15),
    "unequal masses": ImpactChain(
        masses=(1.0, 0.5, 2.0),
        springs=(1.0, 3.0, 0.7),
        damping=(0.1, 0.4, 0.2),
        restitution=0.6,
        offset=0.05,
        frequency=0.5,
    ),
    "weights": ImpactChain(
        masses=3, frequency=1.0, restitution=0.6, constant_forces=(-0.1, -0.1, -0.3)
    ),
    "stiff dashpots": ImpactChain(masses=3, frequency=0.3, restitution=0.6, damping=10.0),
    "stiffer dashpots": ImpactChain(masses=2, frequency=0.3, restitution=0.6, damping=50.0),
    "coupled masses, contact in the middle": MatrixOscillator(
        M=FULL, C=0.1 * LINE, K=LINE, frequency=0.4, restitution=0.6, amplitude=0.3, contact=1
    ),
    "below the table": MatrixOscillator(
        M=FULL,
        C=0.1 * LINE,
        K=LINE,
        frequency=0.4,
        restitution=0.6,
        amplitude=0.3,
        side="below",
        constant_forces=(0.0, 0.0, 0.2),
    ),
    "soft springs": MatrixOscillator(
        M=np.diag([10.0, 10.0, 1.0]),
        C=0.001 * LINE,
        K=0.03 * LINE,
        frequency=0.05,
        restitution=0.6,
        amplitude=0.3,
        constant_forces=(0.0, 0.0, -0.01),
    ),
    "heavy neighbours": MatrixOscillator(
        M=np.diag([1000.0, 1000.0, 1.0]),
        C=0.001 * LINE,
        K=LINE,
        frequency=0.2,
        restitution=0.6,
        amplitude=0.3,
        constant_forces=(0.0, 0.0, -0.1),
    ),
}
"""Simulated up to a chatter, from the start that they have by default."""

SMALL = ImpactChain(masses=2, frequency=1.0)
SLOW = ImpactChain(masses=(100.0, 1.0), frequency=0.3, restitution=0.95)
PLAY = MatrixOscillator(
    M=np.eye(2),
    C=[[0.2, -0.1], [-0.1, 0.1]],
    K=[[2.0, -1.0], [-1.0, 1.0]],
    frequency=1.0,
    offset=-0.1,
    play=0.2,
    restitution=0.6,
)
PRESSED: dict[str, tuple[ImpactOscillator, tuple[float, ...]]] = {
    "two masses, restitution 0.95": (SLOW, (-1.0, 0.03, 0.003, 0.3)),
    "play, near side": (PLAY, (-0.4, 0.1, 5e-3, 0.3)),
    "play, far side": (PLAY, (0.4, 0.1, -5e-3, 0.3)),
}
"""Just after an impact with these section coordinates, the neighbour pressing towards the stop."""

CASES = (*MOVING, *PRESSED)


class Start(NamedTuple):
    """A state in flight between two bounces of a chatter, in doubles."""

    system: ImpactMap
    position: Array
    velocity: Array
    phase: float

    def simulate(self, tolerance: float) -> ImpactRecord:
        system = self.system.replace(chatter_tolerance=tolerance)
        start = system.state(self.position, self.velocity, self.phase)
        found: ImpactRecord = system.simulate(impacts=600, start=start)
        return found


def start_of(name: str) -> Start:
    """Where the relative velocities are a thousand times that of the last bounce, or before."""
    if name in PRESSED:
        system, section = PRESSED[name]
        return after_impact(system, section)
    record = MOVING[name].simulate(impacts=200)
    u = abs(record.relative_velocity[: bounces_of(record)])
    place = len(u) - 1
    while place > 0 and u[place] < u[place - 1] and u[place] < 1e3 * u[-1]:
        place -= 1
    return in_flight(record, place)


def after_impact(system: ImpactOscillator, section: tuple[float, ...]) -> Start:
    start = system.impact_state(np.array(section))
    return in_flight(system.simulate(impacts=2, start=start), None)


def in_flight(record: ImpactRecord, place: int | None) -> Start:
    """Half way between an impact of a record, or its start, and the next impact."""
    began, phase = 0.0, record.start.phase
    if place is not None:
        began, phase = float(record.time[place]), float(record.phase[place])
    flown = 0.5 * float(record.time[0 if place is None else place + 1] - began)
    position, velocity = record.sample([began + flown])
    return Start(record.system, position[0], velocity[0], phase + record.system.frequency * flown)


def bounces_of(record: ImpactRecord) -> int:
    """Number of impacts before the first contact."""
    return int(np.searchsorted(record.time, record.sticking[0, 0]))


# --- one study ------------------------------------------------------------------------------------


class Row(NamedTuple):
    """What one tolerance leads to.

    Attributes
    ----------
    tolerance
    cut : relative velocity of the last bounce that is simulated
    claimed : the record's `chatter_error`
    changed : error of positions and velocities as contact begins
    unexplained : the same, where the known effect of the bounces left out is taken off
    later : error of the section coordinates of the first impact after the release
    bound : the record's `error` of this impact
    """

    tolerance: float
    cut: float
    claimed: float
    changed: float
    unexplained: float
    later: float
    bound: float


def halved(start: Start) -> list[Row]:
    """Rows for smaller and smaller tolerances."""
    reference = twin(start.system)
    bounces = math.ceil(math.log(LAST) / math.log(start.system.restitution))
    arguments = start.position.tolist(), start.velocity.tolist(), start.phase
    exact = reference.simulate(*arguments, bounces + 12)
    tolerance, rows = FIRST, list[Row]()
    while tolerance > LEAST:
        rows.append(compared(start.simulate(tolerance), tolerance, reference, exact))
        tolerance = rows[-1].claimed / SPARED
    return rows


def twin(system: ImpactMap) -> GeneralOscillator:
    above = system.side == "above"
    far = system.offset + (system.play if above else -system.play)
    return GeneralOscillator(
        system.mass.tolist(),
        system.damping_matrix.tolist(),
        system.stiffness.tolist(),
        system.frequency,
        system.restitution,
        system.amplitude,
        system.offset,
        contact=system.contact,
        side="above" if above else "below",
        harmonic_forces=system.harmonic_forces,
        constant_forces=system.constant_forces,
        far_stop=None if math.isinf(far) else far,
        bits=BITS,
        stick_below=LAST,
    )


def compared(
    record: ImpactRecord, tolerance: float, reference: GeneralOscillator, exact: History
) -> Row:
    system, bounces = record.system, bounces_of(record)
    alone = system.simulate(impacts=bounces + 1, start=record.start)
    begin, release = exact.contacts[0].start, exact.contacts[0].release
    after = next(impact for impact in exact.impacts if impact.time > release)
    with mp.workprec(BITS):
        time = max(float(begin), float(record.sticking[0, 0]))
        assert time < release
        own, theirs = record.sample([time]), reference.state_at(exact, time)
        off = np.array([difference(x[0], y) for x, y in zip(own, theirs, strict=True)])
        later = impact_error(alone, bounces, after)
    effect = lifted(record, bounces - 1) * system._contact.excursion
    return Row(
        tolerance,
        abs(float(record.relative_velocity[bounces - 1])),
        alone.chatter_error,
        abs(off).max(),
        abs(off + effect).max(),
        later,
        float(alone.error[bounces]),
    )


def lifted(record: ImpactRecord, place: int) -> float:
    """Time integral of the parabolas that follow an impact, along the contact coordinate."""
    system, u = record.system, float(record.relative_velocity[place])
    x, v, phase = record.position[place], record.velocity[place], record.phase[place]
    forces = np.array(system.constant_forces or 0.0) - system.damping_matrix @ v
    free = np.linalg.solve(system.mass, forces - system.stiffness @ x)[system.contact]
    pressed = free + system.amplitude * system.frequency**2 * np.sin(phase)
    upwards = 1.0 if (system.side == "above") == (u > 0.0) else -1.0
    return float(upwards * 2.0 / 3.0 * abs(u) ** 3 / pressed**2 / (1.0 - system.restitution**3))


def impact_error(record: ImpactRecord, place: int, exact: Impact) -> float:
    """Largest error of the section coordinates of an impact, in working precision."""
    system, n = record.system, record.system.degrees_of_freedom
    others = [i for i in range(n) if i != system.contact % n]
    u = exact.relative_velocity if exact.side == "near" else -exact.relative_velocity
    section = [*(exact.position[i] for i in others), *(exact.velocity[i] for i in others), u]
    late = difference(record.time[[place]], [exact.time])
    off = difference(record.states[place, :-1], section)
    return float(max(abs(off).max(), system.frequency * abs(late).max()))


def difference(a: Array, b: object) -> Array:
    assert isinstance(b, list | tuple)
    return np.array([float(mpf(x) - y) for x, y in zip(a.tolist(), b, strict=True)])


def order(rows: list[Row], errors: list[float]) -> float:
    return float(np.polyfit(np.log([row.cut for row in rows]), np.log(errors), 1)[0])


# --- order ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=CASES)
def rows(request: pytest.FixtureRequest) -> list[Row]:
    """The study of each case in turn."""
    return halved(start_of(request.param))


def test_every_cut_is_at_half_the_velocity_or_one_bounce_below(rows: list[Row]) -> None:
    assert len(rows) >= 3
    for before, after in pairwise(rows):
        assert 0.29 * 0.5 < after.cut / before.cut < 0.51


def test_the_change_goes_with_the_cube_of_the_cut_velocity(rows: list[Row]) -> None:
    assert 2.9 < order(rows, [row.changed for row in rows]) < 3.1


def test_the_known_effect_of_the_dropped_bounces_leaves_the_fourth_power(rows: list[Row]) -> None:
    # where the fourth power, from the first row on, is above rounding
    first = rows[0]
    known = [r for r in rows if first.unexplained * (r.cut / first.cut) ** 4 > ROUNDING_IN_FLIGHT]
    assert len(known) >= 2
    assert order(known, [row.unexplained for row in known]) > 3.8


def test_nothing_but_rounding_is_left_beside_the_fourth_power(rows: list[Row]) -> None:
    first = rows[0]
    for row in rows:
        power = first.unexplained * (row.cut / first.cut) ** 3.8
        assert row.unexplained <= power + ROUNDING_IN_FLIGHT


def test_the_next_impact_is_at_least_of_order_2_8(rows: list[Row]) -> None:
    first = rows[0]
    for row in rows:
        assert row.later <= first.later * (row.cut / first.cut) ** 2.8 + ROUNDING


# --- estimates ------------------------------------------------------------------------------------


def test_no_change_is_more_than_twice_the_chatter_error(rows: list[Row]) -> None:
    assert all(row.changed <= 2.0 * row.claimed for row in rows)


def test_the_change_by_a_small_cut_is_no_more_than_the_chatter_error(rows: list[Row]) -> None:
    assert rows[-1].changed <= 1.01 * rows[-1].claimed


def test_the_chatter_error_is_at_most_twice_the_change(rows: list[Row]) -> None:
    assert all(row.claimed <= 2.0 * row.changed for row in rows)


def test_the_chatter_error_keeps_to_the_tolerance(rows: list[Row]) -> None:
    assert all(row.claimed <= row.tolerance for row in rows)


def test_the_next_impact_is_as_near_as_the_error_of_the_record(rows: list[Row]) -> None:
    assert all(row.later <= row.bound for row in rows)


# --- the contact mass itself ---------------------------------------------------------------------


def tied(tie: float, ground: float, restitution: float) -> ImpactOscillator:
    """Two masses, a weight on the last one, and a spring `tie` between them."""
    return MatrixOscillator(
        M=np.eye(2),
        C=np.diag([0.1, 0.0]),
        K=[[1.0 + tie, -tie], [-tie, tie + ground]],
        frequency=0.4,
        restitution=restitution,
        amplitude=0.8,
        constant_forces=(0.0, -0.1),
    )


@pytest.mark.parametrize("tolerance", [1e-16, 1e-11])
@pytest.mark.parametrize("restitution", [0.3, 0.6])
@pytest.mark.parametrize("tie", [1e-5, 1e-10])
def test_bounces_left_out_are_drawn_well_where_nothing_else_feels_them(
    tie: float, restitution: float, tolerance: float
) -> None:
    system = tied(tie, 0.01, restitution)
    start = after_impact(system, (0.2, 0.0, 0.02, 3.0))
    bounces = math.ceil(math.log(LAST) / math.log(restitution)) + 2
    reference = twin(system)
    exact = reference.simulate(
        start.position.tolist(), start.velocity.tolist(), start.phase, bounces
    )
    begin = exact.contacts[0].start
    record = start.simulate(tolerance)
    last = float(record.time[bounces_of(record) - 1])
    times = last + (float(begin) - last) * np.linspace(0.01, 1.0, 100)
    places, _ = record.sample(times)
    with mp.workprec(BITS):
        off = [
            float(abs(mpf(x) - reference.state_at(exact, time)[0][1]))
            for x, time in zip(places[:, 1].tolist(), times.tolist(), strict=True)
        ]
        late = float(abs(mpf(float(record.sticking[0, 0])) - begin))
    assert max(off) <= 1e3 * tolerance
    # A bounce that begins so much later is off by this times its velocity.
    assert late * float(record.relative_velocity[bounces_of(record) - 1]) <= 1e3 * tolerance


# --- where contact hardly begins ------------------------------------------------------------------


def pressed(restitution: float, u: float) -> tuple[ImpactOscillator, tuple[float, ...]]:
    """Two masses, the last one bouncing with velocity u where the press on it is falling."""
    return SMALL.replace(restitution=restitution), (-0.3, 0.1, u, 0.3)


def sticks(restitution: float, u: float) -> bool:
    """Whether the bounces accumulate before the press is gone."""
    system, section = pressed(restitution, u)
    start = system.impact_state(np.array(section))
    record = system.simulate(impacts=300, start=start)
    return len(record.sticking) > 0 and bool(record.sticking[0, 1] < 1.0)


def border(restitution: float) -> float:
    """The largest velocity from which they do, by bisection."""
    low, high = 1e-4, 0.3
    assert sticks(restitution, low)
    assert not sticks(restitution, high)
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sticks(restitution, middle) else (low, middle)
    return low


@pytest.mark.parametrize(("restitution", "beside"), [(0.3, 1e-2), (0.3, 1e-4), (0.6, 1e-2)])
def test_beside_the_chatter_border_both_estimates_hold(restitution: float, beside: float) -> None:
    system, section = pressed(restitution, (1.0 - beside) * border(restitution))
    for row in halved(after_impact(system, section)):
        assert row.changed <= 2.0 * row.claimed + 2.0**-48
        assert row.later <= row.bound
