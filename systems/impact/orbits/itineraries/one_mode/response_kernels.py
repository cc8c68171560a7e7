"""Equations of impacts of one mode, and their Jacobian, from the responses to all impulses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import FOUND, START, Ladder, Workspace
from dynkit.systems.impact.modes.transition_kernels import fly_start


@kernel()
def _flown(ladder: Ladder, given: Array, k: int, time: float, states: Array) -> int:
    """Propagate given state `k` for a time; return the index of the result in `states`."""
    for i in range(given.shape[2]):
        states[START, 0, i], states[START, 1, i] = given[k, 0, i], given[k, 1, i]
    if time == 0.0:
        return START
    fly_start(ladder, time, states)
    return FOUND


@kernel(reorder=True)
def _product(rows: Array, side: int, order: int, states: Array, k: int) -> float:
    """Product of a row, (2 slots,), with a state."""
    total, slots = 0.0, states.shape[2]
    for i in range(slots):
        total += rows[side, order, i] * states[k, 0, i]
        total += rows[side, order, slots + i] * states[k, 1, i]
    return total


class Assembled(NamedTuple):
    """Responses to n impulses that repeat after a period, and the equations of the impacts.

    Attributes
    ----------
    since, turns : (n, n) time from an impulse (column) to an impact (row), and the number of
        periods between their phases: -1 where the impulse is later in the period
    lasts, following : (n,) time from each impact to the next in time, and its number
    spread : (n, n, 2, slots) states at the impacts (rows) after unit impulses (columns)
    responses : (4, n, n) gaps and derivatives after unit impulses
    steady, gaps : (3, n) gaps and two derivatives, in the steady response and in the whole motion,
        just after the impacts
    left, jacobian : (2n,), (2n, 2n) residual of gaps and impact laws, and its derivative by phases
        and impulses
    by_frequency : (2n,) derivative of the residual by the clock, with constant amplitudes of the
        steady response
    """

    since: Array
    turns: Array
    lasts: Array
    following: NDArray[np.intp]
    spread: Array
    responses: Array
    steady: Array
    gaps: Array
    left: Array
    jacobian: Array
    by_frequency: Array

    @classmethod
    def of(cls, n: int, shape: tuple[int, ...]) -> Assembled:
        """Uninitialized arrays for n impacts and states of a shape."""
        e, empty = 2 * n, np.empty
        times = empty((n, n)), empty((n, n)), empty(n), empty(n, np.intp)
        responses = empty((n, n, *shape)), empty((4, n, n)), empty((3, n)), empty((3, n))
        return cls(*times, *responses, empty(e), empty((e, e)), empty(e))


@kernel(entry=True)
def assemble(
    ladder: Ladder,
    work: Workspace,
    rows: Array,
    kicked: Array,
    moved: Array,
    sides: NDArray[np.intp],
    numbers: Array,
    phases: Array,
    impulses: Array,
    clock: float,
    turn: float,
    out: Assembled,
) -> None:
    """Compute responses and equations of n impulses that repeat after a period, in place.

    Parameters
    ----------
    ladder, work
        propagators and buffers of the free motion; buffers are modified in place
    rows
        (e, 4, 2 slots) products with a state are the gap of a stop, and three derivatives
    kicked, moved
        (e, 2, slots) states just after a unit impulse per period, and their derivative by the
        period
    sides
        (n,) the number of the stop of each impact
    numbers
        (e, 4) for each stop: coefficients of sine and cosine of the phase in the steady gap, its
        mean, and restitution
    phases, impulses
        (n,)
    clock, turn
        frequency of the phase, and phase of a period
    """
    n, states = len(sides), work.states
    steady, gaps, responses = out.steady, out.gaps, out.responses
    for i in range(n):
        side = sides[i]
        sine, cosine = math.sin(phases[i]), math.cos(phases[i])
        a, b = numbers[side, 0], numbers[side, 1]
        steady[0, i] = a * sine + b * cosine + numbers[side, 2]
        steady[1, i] = clock * (a * cosine - b * sine)
        steady[2, i] = -clock * clock * (a * sine + b * cosine)
        for order in range(3):
            gaps[order, i] = steady[order, i]
        out.by_frequency[i], out.by_frequency[n + i] = 0.0, steady[1, i] / clock
        out.lasts[i], out.following[i] = turn / clock, i
    for i in range(n):
        side = sides[i]
        for j in range(n):
            # an impulse later in the period is that of the period before; so is a simultaneous one
            # with a larger number
            apart = phases[i] - phases[j]
            turns = math.floor(apart / turn)
            if i < j and apart == turns * turn:
                turns -= 1.0
            since = (apart - turns * turn) / clock
            out.turns[i, j], out.since[i, j] = turns, since
            if i != j and since < out.lasts[j]:
                out.lasts[j], out.following[j] = since, i
            k = _flown(ladder, kicked, sides[j], since, states)
            for slot in range(kicked.shape[2]):
                out.spread[i, j, 0, slot] = states[k, 0, slot]
                out.spread[i, j, 1, slot] = states[k, 1, slot]
            for order in range(4):
                responses[order, i, j] = _product(rows, side, order, states, k)
            for order in range(3):
                gaps[order, i] += responses[order, i, j] * impulses[j]
            k = _flown(ladder, moved, sides[j], since, states)
            for order in range(2):
                later = _product(rows, side, order, states, k) * turn / clock
                later += responses[order + 1, i, j] * since
                out.by_frequency[order * n + i] -= later * impulses[j] / clock
        back = numbers[side, 3] / (1.0 + numbers[side, 3])
        out.left[i] = gaps[0, i]
        out.left[n + i] = gaps[1, i] - back * impulses[i]
        for order in range(2):
            row = order * n + i
            # the impulse of an impact moves with the impact's phase
            own = gaps[order + 1, i]
            for j in range(n):
                part = impulses[j] * responses[order + 1, i, j]
                out.jacobian[row, j] = -part / clock
                out.jacobian[row, n + j] = responses[order, i, j]
            out.jacobian[row, i] += own / clock
        out.jacobian[n + i, n + i] -= back


@kernel(entry=True)
def follow_gap(
    ladder: Ladder,
    work: Workspace,
    rows: Array,
    side: int,
    numbers: Array,
    start: Array,
    phase: float,
    clock: float,
    times: Array,
    out: Array,
) -> None:
    """Compute the gap of a stop and its derivatives, (orders, k), at times (k,) after an impact.

    `out` and `work` are modified in place. `start` is (1, 2, slots); the other parameters are those
    of `assemble`.
    """
    states, a, b = work.states, numbers[side, 0], numbers[side, 1]
    for m in range(len(times)):
        k = _flown(ladder, start, 0, times[m], states)
        for order in range(out.shape[0]):
            out[order, m] = _product(rows, side, order, states, k)
        sine, cosine = math.sin(phase + clock * times[m]), math.cos(phase + clock * times[m])
        s, c = a * sine + b * cosine, a * cosine - b * sine
        out[0, m] += s + numbers[side, 2]
        if out.shape[0] > 1:
            out[1, m] += clock * c
        if out.shape[0] > 2:
            out[2, m] -= clock * clock * s
