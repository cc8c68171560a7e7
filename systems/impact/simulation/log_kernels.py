"""Logs of a run: impacts, and changes of the mode."""

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
    """The log of impacts; it has no rows if impacts are not stored.

    Attributes
    ----------
    time, speed : (n,) times of the impacts, and rates of the gap just after them
    guard : (n,) number of the guard that was zero at each impact
    states : (n, 2, slots) states just after the impacts
    turn : (n, 2) sine and cosine of the phase if no slot of the states holds them; else no rows
    """

    time: Array
    speed: Array
    guard: Indices
    states: Array
    turn: Array


class Switches(NamedTuple):
    """The log of changes of the mode.

    Attributes
    ----------
    time : (k,) times of the changes; for contact, the time of the last impact before it
    rest, speed : (k,) duration of the omitted bounces, and speed at which the first one begins
    before : (k,) number of impacts before the change
    guard : (k,) number of the guard that was zero
    states : (k, 2, slots) states just after the change, in the new mode
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
    """Log that guard `g` has led to the mode of `guard`; the start state is that of the new mode.

    `rest` is the duration of omitted bounces, `speed` that at which the first of them begins.
    """
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
    """Log the start state as the state just after an impact at guard `k`, in row `done`."""
    log.time[done] = clock[TIME]
    log.speed[done] = speed
    log.guard[done] = k
    for row in range(2):
        for i in range(log.states.shape[2]):
            log.states[done, row, i] = y[START, row, i]
    if table < 0:
        log.turn[done, 0] = clock[SINE]
        log.turn[done, 1] = clock[COSINE]
