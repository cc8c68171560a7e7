"""One run of the kernels: buffers in, plain arrays out."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.systems.impact.state import ImpactState, Motion, state_of
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.oscillator import ImpactOscillator

MOST_CELLS = 1_000_000
"""Cells after which the search for the next event gives up, with an ending that says so."""

_MOTIONS = (Motion.FLIGHT, Motion.TABLE, Motion.RELEASE)


@final
@dataclass(frozen=True, eq=False)
class Run:
    """What the kernel returned.

    Attributes
    ----------
    start, final : ImpactState
    states : (impacts, 2N + 4) coordinates, sine and cosine of the phase, relative velocity, time;
        no rows when not asked
        for
    contacts : (k, 3) impacts before the contact, its start, its end (infinite for ever)
    impacts : number of impacts
    ending : number of an ending of the kernels
    chatter_error, cells, touches, seconds : what it lost and cost
    """

    start: ImpactState
    final: ImpactState
    states: Array
    contacts: Array
    impacts: int
    ending: int
    chatter_error: float
    cells: int
    touches: int
    seconds: float


def workspace(slots: int) -> Any:
    """Buffers of a search."""
    from dynkit.exponential.evaluation_kernels import DEGREE, STATES, Workspace

    return Workspace(np.zeros((STATES, 2, slots)), np.zeros(DEGREE + 1))


def band_factor(slots: int) -> float:
    """Rounding band in units of 2^-52 times the sum of amplitudes."""
    return 8.0 + slots


def run(
    oscillator: ImpactOscillator,
    start: ImpactState,
    count: int,
    *,
    store: bool,
    noise: float,
    seed: int,
    most_cells: int = MOST_CELLS,
) -> Run:
    """Simulate `count` impacts from a state of this oscillator.

    With noise every number of the start, and of the states after impacts, is changed by up to this
    part of itself and of a quarter of what it becomes, pseudo-randomly, and the rest by this part
    of the terms of which it is the sum. The search for an event gives up after `most_cells`.
    """
    from dynkit.exponential.evaluation_kernels import START
    from dynkit.systems.impact import clock_kernels, kernels

    began = time.perf_counter()
    n, free = oscillator.degrees_of_freedom, oscillator._free
    q, turn = start._coordinates, start._turn
    clock = np.zeros(clock_kernels.CLOCK)
    clock[clock_kernels.SPEED] = abs(start.relative_velocity)
    clock[clock_kernels.SIDE] = start._side
    clock[clock_kernels.PHASE_OF_MOTION] = _MOTIONS.index(start.motion)
    clock[clock_kernels.SEED] = seed
    if noise > 0.0:
        random = np.random.default_rng(seed)
        # What turning positions into coordinates rounds: half of the disturbance.
        x, v = 0.5 * noise * random.uniform(-1.0, 1.0, (2, n)) * [start.position, start.velocity]
        q = q + oscillator._structure.free.coordinates(x, v)
        turn = turn * (1.0 + noise * random.uniform(-1.0, 1.0, 2))
        shifts = noise * random.uniform(-1.0, 1.0, (2, 2))
    clock[clock_kernels.SINE], clock[clock_kernels.COSINE] = turn
    slots = free.layout.slots
    flight = workspace(slots)
    flight.states[START] = free.states(q, *turn)
    if noise > 0.0:
        generator = oscillator._gaps[0].generator
        clock_kernels.perturb(generator, free.layout.modes, -1, flight.states, clock, noise)
    states = np.empty((count if store else 0, 2 * n + 4))
    contacts = np.empty((0, 3))
    if "_contacts" in vars(oscillator):
        contacts = np.empty((16, 3))
    done = 0
    while True:
        mechanics, contact = mechanics_of(oscillator, with_contact=len(contacts) > 0)
        if noise > 0.0:
            mechanics = _displaced(mechanics, oscillator, shifts)
        impacts, ending = kernels.run(
            mechanics,
            clock,
            count - done,
            noise,
            band_factor(slots),
            most_cells,
            states[done:],
            contacts,
            flight,
            contact,
        )
        used = int(clock[clock_kernels.CONTACTS])
        done += impacts
        if ending != kernels.CONTACTS_FULL:
            break
        contacts = np.concatenate([contacts, np.empty((max(16, len(contacts)), 3))])
    q, sine, cosine = free.parts(flight.states[START])
    turn = np.array([sine, cosine])
    if free.layout.table < 0:
        turn = clock[[clock_kernels.SINE, clock_kernels.COSINE]]
    speed = (
        -clock[clock_kernels.SPEED]
        if clock[clock_kernels.SIDE] == 1.0
        else clock[clock_kernels.SPEED]
    )
    return Run(
        start,
        state_of(oscillator, q, turn, speed, _MOTIONS[int(clock[clock_kernels.PHASE_OF_MOTION])]),
        states[:done],
        contacts[:used],
        done,
        ending,
        float(clock[clock_kernels.CHATTER_ERROR]),
        int(clock[clock_kernels.CELLS]),
        int(clock[clock_kernels.TOUCHES]),
        time.perf_counter() - began,
    )


def mechanics_of(oscillator: ImpactOscillator, *, with_contact: bool) -> tuple[Any, Any]:
    """What the kernels take, and a workspace for contact; empty arrays where there is none."""
    from dynkit.systems.impact.contact_kernels import Mechanics, Stop

    structure, free = oscillator._structure, oscillator._free
    kick = np.zeros((4, free.layout.slots))
    kick[:, free.layout.modes] = structure.kick
    kick[:, free.layout.seen :] = 0.0
    excursion = np.zeros((2, free.layout.slots))
    excursion[:, free.layout.modes] = structure.free.coordinates(*structure.excursion)
    stops = []
    slots = 1
    for side, (stand, gap) in enumerate(zip(oscillator._stands, oscillator._gaps, strict=True)):
        force, to_stuck, to_free = gap, np.empty((0, 0)), np.empty((0, 0))
        if with_contact:
            held = oscillator._contacts[side]
            force, to_stuck, to_free = held.force, held.to_stuck, held.to_free
            slots = held.regime.layout.slots
        stops.append(Stop(gap, force, stand.sign * kick, to_stuck, to_free))
    mechanics = Mechanics(
        tuple(stops),
        free.layout.modes,
        oscillator.restitution,
        excursion,
        structure.coupling,
        oscillator.chatter_tolerance,
        oscillator.frequency if free.layout.table < 0 else 0.0,
    )
    return mechanics, workspace(slots)


def _displaced(mechanics: Any, oscillator: ImpactOscillator, parts: Array) -> Any:
    """The same with gaps and forces (k, 2) changed by these parts of the terms of their rest.

    Where the structure rests on the table, all but exactly, their differences are rounding.
    """
    structure, free = oscillator._structure, oscillator._free.forced
    if not free.rest_terms.any():
        return mechanics
    c, stops = structure.contact, []
    gap_terms = float(free.rest_terms[c])
    force_terms = float(abs(structure.stiffness[c]) @ free.rest_terms)
    for stop, (place, push) in zip(mechanics.stops, parts.tolist(), strict=False):
        gap = stop.gap._replace(offset=stop.gap.offset + place * gap_terms)
        force = stop.force._replace(offset=stop.force.offset + push * force_terms)
        stops.append(stop._replace(gap=gap, force=force))
    return mechanics._replace(stops=tuple(stops))
