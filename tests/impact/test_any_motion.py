"""What mechanics says of any motion of any oscillator: gaps, impacts, energy, momentum, contact."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import assume, given, strategies as st

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from tests.effort import share
from tests.impact.any_oscillator import (
    Begin,
    begins,
    certain,
    forces_at,
    table_at,
)

IMPACTS = 20
INSIDE = np.linspace(0.0, 1.0, 22)[1:-1]


def size(record: ImpactRecord) -> float:
    """How large positions, velocities and what the forces hold them at are."""
    q = record._run.coordinates[0]
    parts = (record.position, record.velocity, record.start.position, record.start.velocity)
    rest = record.system._free.forced.rest
    return 1.0 + max(float(abs(a).max(initial=0.0)) for a in (*parts, q, rest))


def stiffest(system: MatrixOscillator) -> float:
    """The fastest rate of anything in flight or in the forces."""
    rates = np.linalg.eigvals(np.linalg.solve(system.mass, system.damping_matrix))
    fastest = float(system.natural_frequencies[-1])
    return fastest + float(abs(rates).max()) + system.frequency


def flights(record: ImpactRecord, at_least: float = 1e-3) -> list[tuple[float, float]]:
    """Begin and end of the flights between impacts with no contact between them."""
    edges = np.append(0.0, record.time)
    held = np.zeros(len(record), dtype=bool)
    if len(record.sticking):
        begins_at = np.searchsorted(record.time, record.sticking[:, 0], side="right")
        ends_at = np.searchsorted(record.time, record.sticking[:, 1], side="left")
        for low, high in zip(begins_at.tolist(), ends_at.tolist(), strict=True):
            # from the impact before the chatter was cut to the first one after the release
            held[max(low - 1, 0) : high + 1] = True
    ends = zip(edges[:-1].tolist(), edges[1:].tolist(), held.tolist(), strict=True)
    return [(a, b) for a, b, stuck in ends if not stuck and b - a > at_least]


def a_flight(draw: st.DataObject, record: ImpactRecord, longest: float) -> tuple[float, float]:
    """A part of a flight; of all that there are one is drawn."""
    chosen = flights(record)
    assume(chosen)
    low, high = draw.draw(st.sampled_from(chosen))
    low, high = low + 1e-9 * (high - low), high - 1e-9 * (high - low)
    return low, min(high, low + longest)


def quadrature(low: float, high: float, rate: float) -> tuple[Array, Array]:
    """Nodes and weights with which sines of three times that rate are integrated to rounding."""
    node, weight = np.polynomial.legendre.leggauss(16)
    panels = max(math.ceil((high - low) * rate), 1)
    edges = np.linspace(low, high, panels + 1)
    half = 0.5 * np.diff(edges)[:, None]
    nodes = edges[:-1, None] + half * (1.0 + node)
    return nodes.ravel(), (half * weight).ravel()


def energy(system: MatrixOscillator, x: Array, v: Array) -> Array:
    """Kinetic and elastic energy, less the work of the constant forces."""
    weight = np.array(system.constant_forces or (0.0,) * system.degrees_of_freedom)
    kinetic = ((v @ system.mass) * v).sum(axis=-1)
    return np.asarray(0.5 * (kinetic + ((x @ system.stiffness) * x).sum(axis=-1)) - x @ weight)


# --- the table is never passed, and impacts obey their law ----------------------------------------


@share(0.4)
@given(begins())
def test_gaps_are_never_negative(begin: Begin) -> None:
    record, system = begin.simulate(IMPACTS), begin.system
    error = certain(record)
    edges = np.append(0.0, record.time)
    times = (edges[:-1, None] + np.diff(edges)[:, None] * INSIDE).ravel()
    sign = 1.0 if system.side == "above" else -1.0
    table, _, _ = table_at(system, begin.phase + system.frequency * times)
    gap = sign * (record.sample(times)[0][:, system.contact] - table)
    late = 1e-15 * (1.0 + system.frequency * times) * system.amplitude
    allowed = np.repeat(error, len(INSIDE)) + late + 1e-14 * size(record)
    assert (gap >= -allowed).all()
    assert (gap <= system.play + allowed).all()


def jumps(record: ImpactRecord) -> tuple[Array, Array, Array, Array]:
    """Velocities just before and just after the impacts, phases, and what they may be off by."""
    system = record.system
    error = certain(record)
    clear = np.diff(record.time, prepend=0.0) > 1e-3
    assume(clear.any())
    before = np.nextafter(record.time[clear], 0.0)
    _, v = record.sample(before)
    force = abs(system.stiffness).sum() + abs(system.damping_matrix).sum() + 2.0
    fastest = float(np.linalg.norm(np.linalg.inv(system.mass)) * force) * size(record)
    fastest += system.amplitude * system.frequency**2
    allowed = 1e-13 * size(record) + error[clear] * (1.0 + system.frequency)
    allowed += 4.0 * fastest * np.spacing(record.time[clear])
    return v, record.velocity[clear], record.phase[clear], allowed


@share(0.4)
@given(begins())
def test_an_impact_turns_the_rate_of_the_gap_by_the_restitution(begin: Begin) -> None:
    before, after, phase, allowed = jumps(begin.simulate(IMPACTS))
    system, c = begin.system, begin.system.contact
    _, moving, _ = table_at(system, phase)
    off = after[:, c] - moving + system.restitution * (before[:, c] - moving)
    assert (abs(off) <= 2.0 * allowed).all()


@share(0.4)
@given(begins())
def test_an_impact_is_an_impulse_on_the_contact_mass_alone(begin: Begin) -> None:
    before, after, _, allowed = jumps(begin.simulate(IMPACTS))
    system = begin.system
    impulse = (after - before) @ system.mass
    impulse[:, system.contact] = 0.0
    assert (abs(impulse).max(axis=1) <= 2.0 * allowed * abs(system.mass).sum()).all()


@share(0.4)
@given(begins(amplitude=0.0))
def test_no_impact_with_a_stop_at_rest_adds_energy(begin: Begin) -> None:
    before, after, _, allowed = jumps(begin.simulate(IMPACTS))
    mass = begin.system.mass
    gained = 0.5 * (((after @ mass) * after).sum(axis=1) - ((before @ mass) * before).sum(axis=1))
    speed = abs(before).sum(axis=1) + abs(after).sum(axis=1)
    assert (gained <= allowed * speed * abs(mass).max()).all()


# --- energy and momentum --------------------------------------------------------------------------


@share(0.4)
@given(begins(), st.data())
def test_energy_changes_in_flight_by_the_work_of_forces_less_the_dashpots(
    begin: Begin, data: st.DataObject
) -> None:
    record, system = begin.simulate(IMPACTS), begin.system
    rate = stiffest(system)
    low, high = a_flight(data, record, 40.0 / rate)
    times, weights = quadrature(low, high, rate)
    _, v = record.sample(times)
    phase = begin.phase + system.frequency * times
    varying = forces_at(system, phase) - np.array(
        system.constant_forces or (0.0,) * system.degrees_of_freedom
    )
    work = (varying * v).sum(axis=1)
    lost = ((v @ system.damping_matrix) * v).sum(axis=1)
    ends = energy(system, *record.sample([low, high]))
    scale = size(record) ** 2 * (1.0 + abs(system.stiffness).sum() + abs(system.mass).sum())
    scale += float(weights @ (abs(work) + lost))
    late = 1.0 + system.frequency * high
    assert abs(ends[1] - ends[0] - weights @ (work - lost)) <= 1e-14 * late * scale


@share(0.4)
@given(
    begins(
        damped=False,
        restitution=st.just(1.0),
        amplitude=0.0,
        harmonic_forces=(),
    )
)
def test_nothing_that_takes_or_gives_keeps_the_energy(begin: Begin) -> None:
    record, system = begin.simulate(60), begin.system
    assume(len(record) > 0)
    # A weak force brings back what nothing holds from far away, with the rounding of the way there.
    assume(record.time[-1] < 1e4)
    levels = energy(system, record.position, record.velocity)
    before = energy(system, begin.position, begin.velocity)
    scale = size(record) ** 2 * (1.0 + abs(system.stiffness).sum() + abs(system.mass).sum())
    assert abs(levels - before).max() <= 1e-14 * scale * (1.0 + len(record))


@st.composite
def unheld(draw: st.DrawFn) -> Begin:
    """Structures whose springs and dashpots tie masses to each other only."""
    begin = draw(begins())
    n = begin.system.degrees_of_freedom
    apart = np.eye(n) - np.ones((n, n)) / n  # no force on a motion of all by the same
    ties: dict[str, Any] = {}
    for name in ("C", "K"):
        tied = apart @ np.array(getattr(begin.system, name)) @ apart
        tied = 0.5 * (tied + tied.T)
        np.fill_diagonal(tied, 0.0)
        ties[name] = tied - np.diag(tied.sum(axis=1))
    try:
        again = begin.changed(**ties)
        again.simulate(1)
    except ValueError as refusal:
        assume("must" not in str(refusal))
        raise
    return again


@share(0.4)
@given(unheld(), st.data())
def test_the_momentum_of_what_nothing_holds_is_that_of_the_forces(
    begin: Begin, data: st.DataObject
) -> None:
    record, system = begin.simulate(IMPACTS), begin.system
    low, high = a_flight(data, record, 40.0 / stiffest(system))
    _, v = record.sample([low, high])
    momentum = (v @ system.mass).sum(axis=1)
    n, w = system.degrees_of_freedom, system.frequency
    given_ = np.array(system.constant_forces or (0.0,) * n).sum() * (high - low)
    swing = np.array(system.harmonic_forces or (0.0,) * n).sum()
    given_ -= swing / w * (math.cos(begin.phase + w * high) - math.cos(begin.phase + w * low))
    scale = size(record) * abs(system.mass).sum() + abs(given_) + abs(swing) / w
    assert abs(momentum[1] - momentum[0] - given_) <= 1e-14 * (1.0 + w * high) * scale


# --- contact --------------------------------------------------------------------------------------


def held(data: st.DataObject, begin: Begin) -> tuple[ImpactRecord, float, float, float]:
    """A record, and a contact in it: its second half, and the sign of the force there."""
    record, system = begin.simulate(3 * IMPACTS), begin.system
    last = float(record.time[-1]) if len(record) else 0.0
    ended = [(a, b) for a, b in record.sticking.tolist() if b - a > 1e-3 and b <= last]
    assume(ended)
    low, high = data.draw(st.sampled_from(ended))
    near = 1.0 if system.side == "above" else -1.0
    middle = 0.5 * (low + high)
    table, _, _ = table_at(system, np.array(begin.phase + system.frequency * middle))
    there = record.sample([middle])[0][0, system.contact] - table
    far = system.play < math.inf and abs(there) > 0.5 * system.play
    return record, middle, high, -near if far else near


def force(record: ImpactRecord, begin: Begin, times: Array) -> tuple[Array, float]:
    """Force on the contact mass, upwards, by the equations of motion; and its scale."""
    system, c = begin.system, begin.system.contact
    x, v = record.sample(times)
    phase = begin.phase + system.frequency * times
    _, _, moving = table_at(system, phase)
    pull = forces_at(system, phase) - v @ system.damping_matrix - x @ system.stiffness
    others = np.delete(np.arange(system.degrees_of_freedom), c)
    acceleration = np.zeros_like(x)
    acceleration[:, c] = moving
    if others.size:
        rest = pull[:, others] - np.outer(moving, system.mass[others, c])
        inner = system.mass[np.ix_(others, others)]
        acceleration[:, others] = np.linalg.solve(inner, rest.T).T
    scale = abs(system.stiffness).sum() + abs(system.damping_matrix).sum() + abs(system.mass).sum()
    scale *= size(record) + float(abs(acceleration).max())
    return acceleration @ system.mass[c] - pull[:, c], scale


CONTACTS = begins(restitution=st.sampled_from([0.0, 0.2, 0.5]))


@share(0.4)
@given(CONTACTS, st.data())
def test_the_table_pushes_while_there_is_contact(begin: Begin, data: st.DataObject) -> None:
    record, low, high, sign = held(data, begin)
    pushed, scale = force(record, begin, low + (high - low) * INSIDE)
    assert (sign * pushed >= -1e-13 * (1.0 + begin.system.frequency * high) * scale).all()


@share(0.4)
@given(CONTACTS, st.data())
def test_the_table_lets_go_where_it_would_have_to_pull(begin: Begin, data: st.DataObject) -> None:
    record, _, high, _ = held(data, begin)
    pushed, scale = force(record, begin, np.array([np.nextafter(high, 0.0)]))
    rate = stiffest(begin.system)
    allowed = 1e-13 + 4.0 * rate * float(np.spacing(high))
    assert abs(pushed[0]) <= allowed * (1.0 + begin.system.frequency * high) * scale


@share(0.4)
@given(CONTACTS, st.data())
def test_the_contact_mass_moves_as_the_table_while_there_is_contact(
    begin: Begin, data: st.DataObject
) -> None:
    record, low, high, sign = held(data, begin)
    system, times = begin.system, low + (high - low) * INSIDE
    x, v = record.sample(times)
    table, moving, _ = table_at(system, begin.phase + system.frequency * times)
    near = 1.0 if system.side == "above" else -1.0
    place = table if sign == near else table + near * system.play
    allowed = 1e-14 * size(record) * (1.0 + system.frequency * high)
    assert abs(x[:, system.contact] - place).max() <= allowed
    assert abs(v[:, system.contact] - moving).max() <= allowed * (1.0 + system.frequency)
