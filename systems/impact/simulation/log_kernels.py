"""What a run writes down: impacts, and changes of the mode."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import START
from dynkit.systems.impact.simulation.clock_kernels import (
    COSINE,
    GUARD,
    IMPACTS,
    SINE,
    SWITCHES,
    TIME,
)

Indices = NDArray[np.intp]


class Impacts(NamedTuple):
    """What is written down of impacts: nothing where there are no rows.

    Attributes
    ----------
    time, speed : (n,) times, and rates of the gap just after them
    guard : (n,) number of the guard that each was at
    states : (n, 2, slots) just after them
    turn : (n, 2) sine and cosine of the phase where no slot holds them; else no rows
    """

    time: Array
    speed: Array
    guard: Indices
    states: Array
    turn: Array


class Switches(NamedTuple):
    """What is written down of changes of the mode.

    Attributes
    ----------
    time : (k,) when they happen: for contact, at the last impact that is not left out
    rest, speed : (k,) how long the bounces last that are left out, and how fast the first one is
    before : (k,) number of impacts before
    guard : (k,) number of the guard that each was at
    states : (k, 2, slots) just after them, in the new mode
    """

    time: Array
    rest: Array
    speed: Array
    before: Indices
    guard: Indices
    states: Array


@kernel(entry=True)
def enter(
    g: int, guard: int, clock: Array, rest: float, speed: float, y: Array, log: Switches
) -> None:
    """Guard `g` has led to another mode, whose state is the start state, and a guard there."""
    k = int(clock[SWITCHES])
    log.time[k] = clock[TIME]
    log.rest[k] = rest
    log.speed[k] = speed
    log.before[k] = int(clock[IMPACTS])
    log.guard[k] = g
    for row in range(2):
        for i in range(y.shape[2]):
            log.states[k, row, i] = y[START, row, i]
    clock[SWITCHES] += 1.0
    clock[GUARD] = guard


@kernel(inline=True)
def note_impact(
    done: int, k: int, table: int, clock: Array, speed: float, y: Array, log: Impacts
) -> None:
    """Write down the start state, just after an impact at guard `k`."""
    log.time[done] = clock[TIME]
    log.speed[done] = speed
    log.guard[done] = k
    for row in range(2):
        for i in range(log.states.shape[2]):
            log.states[done, row, i] = y[START, row, i]
    if table < 0:
        log.turn[done, 0] = clock[SINE]
        log.turn[done, 1] = clock[COSINE]
