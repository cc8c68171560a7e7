"""Kernel that simulates many starts of one machine until they arrive at known periodic orbits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import START, Workspace
from dynkit.systems.impact.simulation.clock_kernels import (
    AMBIGUOUS,
    CELLS,
    COSINE,
    IMPACTS,
    LEFT_FROM,
    SINE,
    SWITCHES,
    TOUCHES,
)
from dynkit.systems.impact.simulation.contact_kernels import Tables
from dynkit.systems.impact.simulation.log_kernels import Impacts, Switches
from dynkit.systems.impact.simulation.loop_kernels import COUNT_REACHED, run

Indices = NDArray[np.intp]

STRIDE = 4
"""Impacts between comparisons with the known orbits."""


class Orbits(NamedTuple):
    """The impacts of known periodic orbits.

    Attributes
    ----------
    guard, speed : (p,) guards of the impacts, and rates of the gap just after them
    states : (p, 2, slots) states just after the impacts
    size : (p,) largest magnitude in the states and speeds of the impact's orbit
    number, period : (p,) number of the impact's orbit, and number of impacts in its period
    """

    guard: Indices
    speed: Array
    states: Array
    size: Array
    number: Indices
    period: Indices


class Members(NamedTuple):
    """Motions that start in free flight, and their results.

    Attributes
    ----------
    states : (n, 2, slots) states of the starts
    turns : (n, 2) sine and cosine of the phases of the starts
    number : (n,) number of the orbit at which each motion has arrived, else -1
    counts : (n, 4) numbers of impacts, cells, contacts and touches
    last : the last impact of each motion that has arrived
    """

    states: Array
    turns: Array
    number: Indices
    counts: Indices
    last: Impacts


@kernel()
def near_orbit(orbits: Orbits, log: Impacts, row: int, near: float, first: int, last: int) -> int:
    """The first orbit impact from `first` to `last` - 1 near impact `row` of a log; -1 if none.

    Near means the same guard, and differences of at most `near` times the orbit's size.
    """
    for k in range(first, last):
        most = near * orbits.size[k]
        if log.guard[row] != orbits.guard[k] or abs(log.speed[row] - orbits.speed[k]) > most:
            continue
        apart = 0.0
        for part in range(2):
            for i in range(log.states.shape[2]):
                apart = max(apart, abs(log.states[row, part, i] - orbits.states[k, part, i]))
        if apart <= most:
            return k
    return -1


@kernel(entry=True, nogil=True)
def arrive(
    tables: Tables,
    orbits: Orbits,
    contact: NDArray[np.bool_],
    near: float,
    most: int,
    beside: int | None,
    band_factor: float,
    limit: int,
    pause: int,
    first: int,
    members: Members,
    clock: Array,
    left: Array,
    impacts: Impacts,
    switches: Switches,
    work: Workspace,
    waiting: Indices,
    waits: Array,
) -> int:
    """Simulate members from number `first` on, until each is near an orbit for one period.

    The simulation of a member is given up if it does not arrive within `most` impacts and `pause`
    cells, if its motion ends, or if it needs a mode that has not been entered.

    Parameters
    ----------
    contact
        (guards,) whether contact begins at the zero of each guard.
    near
        Largest distance of a state or speed from that of an orbit's impact, relative to the orbit's
        size.
    beside, band_factor, limit, pause
        As for `run`. The call ends after the member with which `pause` cells have been searched.
    impacts, switches
        Buffers. That of impacts has at least STRIDE rows, and as many as the longest period has.
    members, clock, left, work, waiting, waits
        Modified in place.

    Returns
    -------
    The number of the next member.
    """
    spent = 0.0
    stride = STRIDE + (most - most)  # for a literal `run` would be compiled once more
    for i in range(first, members.number.shape[0]):
        clock[:] = 0.0
        clock[LEFT_FROM] = clock[AMBIGUOUS] = -1.0
        clock[SINE], clock[COSINE] = members.turns[i, 0], members.turns[i, 1]
        left[:] = 0.0
        waiting[:] = 0
        work.places[0] = 0
        work.states[START] = 0.0
        for part in range(2):
            for slot in range(members.states.shape[2]):
                work.states[START, part, slot] = members.states[i, part, slot]
        wanted, at = stride, -1
        while clock[IMPACTS] + wanted <= most and clock[CELLS] < pause:
            done, ending = run(
                tables,
                clock,
                left,
                wanted,
                beside,
                0.0,
                band_factor,
                limit,
                pause,
                impacts,
                switches,
                work,
                waiting,
                waits,
            )
            for k in range(int(clock[SWITCHES])):
                members.counts[i, 2] += contact[switches.guard[k]]
            clock[SWITCHES] = 0.0
            if ending != COUNT_REACHED or clock[AMBIGUOUS] >= 0.0:
                break
            last = done - 1
            if at >= 0 and near_orbit(orbits, impacts, last, near, at, at + 1) == at:
                members.number[i] = orbits.number[at]
                members.last.time[i] = impacts.time[last]
                members.last.speed[i] = impacts.speed[last]
                members.last.guard[i] = impacts.guard[last]
                for part in range(2):
                    for slot in range(members.states.shape[2]):
                        members.last.states[i, part, slot] = impacts.states[last, part, slot]
                break
            at = near_orbit(orbits, impacts, last, near, 0, orbits.guard.shape[0])
            wanted = stride if at < 0 else orbits.period[at]
        members.counts[i, 0] = int(clock[IMPACTS])
        members.counts[i, 1] = int(clock[CELLS])
        members.counts[i, 3] = int(clock[TOUCHES])
        spent += clock[CELLS]
        if spent >= pause:
            return i + 1
    return int(members.number.shape[0])
