"""Transition matrices of linear modes, rates of change of states, and periodic responses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import FOUND, START, Ladder, Workspace
from dynkit.exponential.sampling_kernels import fly

Indices = NDArray[np.intp]


@kernel()
def _clear(states: Array, row: int, slots: Indices, first: int, last: int) -> None:
    """Set the start state to zero, except for ones in a row of ``slots[first:last]``."""
    for i in range(states.shape[2]):
        states[START, 0, i], states[START, 1, i] = 0.0, 0.0
    for k in range(first, last):
        states[START, row, slots[k]] = 1.0


@kernel()
def fly_start(ladder: Ladder, time: float, states: Array) -> None:
    """Advance the start state by a time; the result is the found state."""
    n = int(time / ladder.smallest)
    fly(ladder, n, time - n * ladder.smallest, states)


@kernel(entry=True)
def fly_units(
    ladder: Ladder,
    work: Workspace,
    alone: Indices,
    linked: Indices,
    durations: Array,
    own: Array,
    joint: Array,
) -> None:
    """Fill `own` and `joint` with transition matrices; they and `work` are modified in place.

    Parameters
    ----------
    alone, linked
        (a,), (b,) slots without links, which are advanced together, and slots with links
    durations
        (k,)
    own
        (k, 2, 2, slots), zero in all slots but those without links
    joint
        (k, 2, b, 2 b)
    """
    states, count = work.states, len(linked)
    for m in range(len(durations)):
        for row in range(2):
            _clear(states, row, alone, 0, len(alone))
            fly_start(ladder, durations[m], states)
            for k in range(len(alone)):
                own[m, 0, row, alone[k]] = states[FOUND, 0, alone[k]]
                own[m, 1, row, alone[k]] = states[FOUND, 1, alone[k]]
            for i in range(count):
                _clear(states, row, linked, i, i + 1)
                fly_start(ladder, durations[m], states)
                for k in range(count):
                    joint[m, 0, k, 2 * i + row] = states[FOUND, 0, linked[k]]
                    joint[m, 1, k, 2 * i + row] = states[FOUND, 1, linked[k]]


@kernel(entry=True)
def rates(ladder: Ladder, states: Array, out: Array) -> None:
    """Compute rates of change of states, (k, 2, slots); `out` is modified in place."""
    g, links, b = ladder.generator, ladder.links, ladder.link_step
    for k in range(states.shape[0]):
        for i in range(states.shape[2]):
            p, q = states[k, 0, i], states[k, 1, i]
            out[k, 0, i] = g[0, i] * p + g[1, i] * q
            out[k, 1, i] = g[2, i] * p + g[3, i] * q
        for m in range(links.shape[0]):
            to, p, q = links[m, 0], states[k, 0, links[m, 1]], states[k, 1, links[m, 1]]
            out[k, 0, to] += b[0, m, 0] * p + b[0, m, 1] * q
            out[k, 1, to] += b[0, m, 2] * p + b[0, m, 3] * q


@kernel(entry=True)
def repeat(own: Array, states: Array, multiplier: Any, out: Any) -> bool:
    """Compute z = state + transition z / multiplier for some states; `out` is modified in place.

    Parameters
    ----------
    own
        (k, 2, 2, slots) transition matrices of each slot, of which only the first one is used
    states, out
        (m, 2, slots)

    Returns
    -------
    bool
        Whether z exists: False if the multiplier is an eigenvalue of a transition matrix.
    """
    for i in range(own.shape[3]):
        a, b = 1.0 - own[0, 0, 0, i] / multiplier, own[0, 0, 1, i] / multiplier
        c, d = own[0, 1, 0, i] / multiplier, 1.0 - own[0, 1, 1, i] / multiplier
        determinant = a * d - b * c
        if determinant == 0.0:
            return False
        for k in range(states.shape[0]):
            y, z = states[k, 0, i], states[k, 1, i]
            out[k, 0, i] = (d * y + b * z) / determinant
            out[k, 1, i] = (a * z + c * y) / determinant
    return True


@kernel(entry=True)
def repeat_kicks(
    ladder: Ladder,
    work: Workspace,
    alone: Indices,
    period: Array,
    kicks: Array,
    own: Array,
    joint: Array,
    kicked: Array,
    moved: Array,
) -> bool:
    """Compute the periodic response to repeated kicks, and its derivative, without links.

    Parameters
    ----------
    alone, own, joint
        as in `fly_units`, which fills `own`
    period
        (1,)
    kicks
        (k, 2, slots)
    kicked, moved
        (k, 2, slots) modified in place: the states just after the kicks, and their derivatives
        with respect to the period

    Returns
    -------
    bool
        Whether these states exist, see `repeat`.
    """
    fly_units(ladder, work, alone, alone[:0], period, own, joint)
    if not repeat(own, kicks, 1.0, moved):
        return False
    # the state just before a kick is the state after it minus the kick
    for k in range(kicks.shape[0]):
        for i in range(kicks.shape[2]):
            moved[k, 0, i] -= kicks[k, 0, i]
            moved[k, 1, i] -= kicks[k, 1, i]
    rates(ladder, moved, kicked)
    repeat(own, kicked, 1.0, moved)
    return repeat(own, kicks, 1.0, kicked)
