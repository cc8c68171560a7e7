"""Kernels of the impact oscillator: the loop over flights, impacts, chatter, contact and release.

Modal coordinates all the way: an impact adds a multiple of one vector, and nothing is transformed
to positions.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.bound_kernels import died_out, stays_in_band
from dynkit.exponential.double_double_kernels import two_product
from dynkit.exponential.evaluation_kernels import (
    FOUND,
    KEPT,
    START,
    Ladder,
    Workspace,
    propagate_steps,
    shift,
    shift_linked,
    start_sums,
)
from dynkit.exponential.polynomial_kernels import LIMIT, NEVER, PAUSED, ROOT, TOUCH
from dynkit.exponential.search_kernels import FOREVER, first_root
from dynkit.systems.impact.clock_kernels import (
    BUDGET,
    CELLS,
    CHATTER_ERROR,
    CONTACTS,
    COSINE,
    IMPACTS,
    PHASE_OF_MOTION,
    SIDE,
    SINE,
    SPEED,
    STAGE,
    TIME,
    TOUCHES,
    advance_clock,
    normalise,
    perturb,
    perturb_cut,
    perturb_reached,
    perturb_released,
    perturb_touch,
)
from dynkit.systems.impact.contact_kernels import (
    Mechanics,
    chatter_completes,
    chatter_error,
    chatter_rest,
    lifted,
    order_at_rest,
    pulls,
    transform,
)

Indices = NDArray[np.intp]

FLIGHT, BOUNCED, RELEASED = 0, 1, 2
"""Where a run starts or goes on: gap open, on the table (u >= 0), just released by it."""

(
    COUNT_REACHED,
    NO_FURTHER_CONTACT,
    CONTACT_FOR_EVER,
    SEARCH_LIMIT,
    DIED_OUT,
    CONTACTS_FULL,
    RUN_PAUSED,
) = range(7)
"""Endings of a run; after the last two the call is repeated."""

NEXT, ON_TABLE, IN_FLIGHT, OTHER_STOP = range(4)
"""Where a paused run goes on: at its next event, in the search of a release, of an impact, or of an
impact with the other stop."""

PER_EVENT = 4
"""An event takes about as long as so many cells; where contact is tried, one more for each slot."""

FIRST_CELLS = 64
"""Cells after which the search of one of two stops waits for that of the other."""


@kernel()
def _add_jump(kick: Array, jump: float, states: Array) -> None:
    """The found state plus `jump` times the kick, rounded once, into the start state.

    A kick in double precision would bias the energy, by the same 1e-17 or so at every impact.
    """
    for row in range(2):
        for i in range(states.shape[2]):
            before = states[FOUND, row, i]
            change, rest = two_product(kick[row, i], jump)
            total = before + change
            back = total - before
            lost = (before - (total - back)) + (change - back)
            states[START, row, i] = total + (lost + (rest + kick[2 + row, i] * jump))


@kernel()
def _copy(states: Array, k: int, to: int) -> None:
    """State `k` into state `to`."""
    for row in range(2):
        for i in range(states.shape[2]):
            states[to, row, i] = states[k, row, i]


@kernel(entry=True, nogil=True)
def run(
    mechanics: Mechanics,
    clock: Array,
    count: int,
    noise: float | None,
    band_factor: float,
    limit: int,
    pause: int,
    states: Array,
    contacts: Array,
    flight: Workspace,
    contact: Workspace,
) -> tuple[int, int]:
    """Simulate `count` impacts from (``flight.states[START]``, `clock`), modified in place.

    Parameters
    ----------
    limit
        Largest number of cells of one search.
    pause
        After so many cells, and twice as many at most, this call ends with RUN_PAUSED; a call with
        the same arguments, for the impacts that remain, goes on from there, bit for bit.
    states
        (count or 0, 2 * modes + 4), modified in place: the pairs of the modes, sine and cosine of
        the phase, relative velocity (negative at the second stop), time, after each impact. With no
        rows nothing is stored.
    contacts
        (k, 3), modified in place: impacts before the contact, its start and its end.
    noise
        Relative size of a pseudo-random perturbation after each impact, for error estimates. With
        None, what perturbs is not compiled.
    flight, contact
        Workspaces of the free and of the stuck structure, modified in place.

    Returns
    -------
    impacts, ending
    """
    y = flight.states
    slots = mechanics.modes
    modes = slots.shape[0]
    smallest = mechanics.stops[0].gap.smallest
    table = mechanics.stops[0].gap.steady
    store = states.shape[0] > 0
    # Not literals: for every set of them the search would be compiled once more.
    zero = count - count
    for_ever = FOREVER + zero
    # With two stops little is spent at first: what cannot be told of one of them for ever need not
    # be, where the other one is reached.
    # In flight the workspace of contact is free: it keeps what the search waits with.
    waiting = contact.places
    first_budget = min(limit, FIRST_CELLS) if len(mechanics.stops) == 2 else limit
    budget = int(clock[BUDGET]) if clock[BUDGET] > 0.0 else first_budget
    stage = int(clock[STAGE])
    clock[STAGE] = NEXT
    clock[BUDGET] = 0.0
    spent = 0
    done = 0
    while done < count:
        if spent >= pause:
            clock[BUDGET] = budget
            return done, RUN_PAUSED
        side = int(clock[SIDE])
        u = clock[SPEED]
        order = 0
        sticks = stage == ON_TABLE
        if stage == NEXT:
            spent += PER_EVENT
            phase = clock[PHASE_OF_MOTION]
            # Nothing drives it: then it may die out.
            if table < 0 and died_out(mechanics.stops[side].gap, y, START):
                return done, DIED_OUT
            if phase == RELEASED:
                order = 3
            elif phase != FLIGHT:
                stop = mechanics.stops[side]
                gap = stop.gap
                second, third, fourth, _ = start_sums(gap.rows, y, START)
                error = chatter_error(mechanics, u, second)
                if u > 0.0:
                    order = 1
                    sticks = chatter_completes(mechanics, stop, u, second, third, fourth, error)
                else:
                    order = order_at_rest(gap.rows, y, band_factor)
                    if order > 0 and stays_in_band(gap, y, START, mechanics.tolerance):
                        # It would never leave the table by more: all that moves is rounding.
                        order = 0
                    sticks = order <= 0
                if sticks:
                    k = int(clock[CONTACTS])
                    if k == contacts.shape[0]:
                        return done, CONTACTS_FULL
                    spent += y.shape[2]
                    transform(stop.to_stuck, y, START, contact.states)
                    if pulls(stop.force, contact.states, band_factor):
                        # What rounding hid in flight is clear on the table: it does not hold the
                        # mass.
                        if u == 0.0:
                            transform(stop.to_free, contact.states, START, y)
                            normalise(y, table)
                            order = order_at_rest(gap.rows, y, band_factor)
                        sticks = order <= 0
                if sticks:
                    contacts[k, 0] = clock[IMPACTS]
                    contacts[k, 1] = clock[TIME]
                    contacts[k, 2] = math.inf
                    if u > 0.0:
                        rest = chatter_rest(stop, mechanics.restitution, u, second, third)
                        contacts[k, 1] += rest
                        clock[CHATTER_ERROR] += error
                        if noise is not None:
                            lost = lifted(mechanics.restitution, u, second)
                            perturb_cut(mechanics.excursion, lost, y, clock)
                            transform(stop.to_stuck, y, START, contact.states)
        elif stage != ON_TABLE:
            order = waiting[3]
        if sticks:
            stop = mechanics.stops[side]
            outcome, n, e, _, cells = first_root(
                stop.force, zero, 0.0, band_factor, count < 0, limit, pause, for_ever, contact
            )
            if outcome == PAUSED:
                clock[STAGE] = ON_TABLE
                return done, RUN_PAUSED
            stage = NEXT
            spent += cells
            clock[CELLS] += cells
            k = int(clock[CONTACTS])
            clock[CONTACTS] += 1.0
            if outcome == NEVER:
                return done, CONTACT_FOR_EVER
            if outcome == LIMIT:
                return done, SEARCH_LIMIT
            transform(stop.to_free, contact.states, FOUND, y)
            normalise(y, table)
            if noise is not None:
                perturb_released(stop.to_free, slots, table, y, clock, noise)
                perturb_reached(stop.gap.generator, slots, y, clock, noise)
            advance_clock(clock, n, stop.force.smallest, e, mechanics.clock_rate)
            contacts[k, 2] = clock[TIME]
            u = 0.0
            clock[SPEED] = u
            clock[PHASE_OF_MOTION] = RELEASED
            order = 3
        gap = mechanics.stops[side].gap
        if stage == OTHER_STOP:
            outcome, n = waiting[1], waiting[2]
            e, rate = contact.levels[0], contact.levels[1]
        else:
            outcome, n, e, rate, cells = first_root(
                gap, order, u, band_factor, count > 0, budget, pause, for_ever, flight
            )
            if outcome == PAUSED:
                waiting[3] = order
                clock[STAGE], clock[BUDGET] = IN_FLIGHT, budget
                return done, RUN_PAUSED
            spent += cells
            clock[CELLS] += cells
            if len(mechanics.stops) == 2:
                _copy(y, FOUND, KEPT)
        if len(mechanics.stops) == 2:
            # Whether the other stop is reached before.
            found, m, d, slope, cells = first_root(
                mechanics.stops[1 - side].gap,
                zero,
                0.0,
                band_factor,
                count > 0,
                budget,
                pause,
                for_ever if outcome == NEVER else n,
                flight,
            )
            if found == PAUSED:
                waiting[1], waiting[2], waiting[3] = outcome, n, order
                contact.levels[0], contact.levels[1] = e, rate
                clock[STAGE], clock[BUDGET] = OTHER_STOP, budget
                return done, RUN_PAUSED
            spent += cells
            clock[CELLS] += cells
            # At the limit of cells the first search has come to n.
            earlier = outcome == NEVER or (m - n) * smallest < e - d
            if found in (ROOT, TOUCH) and earlier:
                outcome = found
                n = m
                e = d
                rate = slope
                side = 1 - side
            else:
                _copy(y, KEPT, FOUND)
                if found == LIMIT:
                    outcome = LIMIT
            if outcome == LIMIT and budget < limit:
                budget = min(limit, 16 * budget)
                stage = NEXT
                continue
            budget = first_budget
        stage = NEXT
        if outcome == NEVER:
            return done, NO_FURTHER_CONTACT
        if outcome == LIMIT:
            return done, SEARCH_LIMIT
        if outcome == TOUCH:
            clock[TOUCHES] += 1.0
            if noise is not None:
                rate = perturb_touch(mechanics.stops[side].gap, band_factor, y, clock)
        rate = min(rate, 0.0)
        _add_jump(mechanics.stops[side].kick, -(1.0 + mechanics.restitution) * rate, y)
        normalise(y, table)
        clock[SIDE] = side
        clock[SPEED] = 0.0 - mechanics.restitution * rate
        clock[PHASE_OF_MOTION] = BOUNCED
        advance_clock(clock, n, smallest, e, mechanics.clock_rate)
        if noise is not None:
            perturb(slots, table, y, clock, noise)
            perturb_reached(gap.generator, slots, y, clock, noise)
        if store:
            for i in range(modes):
                states[done, i] = y[START, 0, slots[i]]
                states[done, modes + i] = y[START, 1, slots[i]]
            states[done, 2 * modes] = y[START, 0, table] if table >= 0 else clock[SINE]
            states[done, 2 * modes + 1] = y[START, 1, table] if table >= 0 else clock[COSINE]
            states[done, 2 * modes + 2] = -clock[SPEED] if side == 1 else clock[SPEED]
            states[done, 2 * modes + 3] = clock[TIME]
        done += 1
        clock[IMPACTS] += 1.0
    return done, COUNT_REACHED


@kernel(entry=True)
def sample(
    ladder: Ladder, starts: Array, which: Indices, durations: Array, work: Workspace, out: Array
) -> None:
    """States after given durations from given starts; `out` and `work` are modified in place.

    Parameters
    ----------
    starts
        (k, 2, slots)
    which, durations
        (m,) start and time of each sample.
    out
        (m, 2, slots)
    """
    states = work.states
    for m in range(which.shape[0]):
        for i in range(starts.shape[2]):
            states[START, 0, i] = starts[which[m], 0, i]
            states[START, 1, i] = starts[which[m], 1, i]
        n = int(durations[m] / ladder.smallest)
        e = durations[m] - n * ladder.smallest
        last = starts.shape[2]
        k = propagate_steps(ladder.step, ladder.links, ladder.link_step, n, states, 0, 0, last)
        shift(ladder.generator, e, states, k, FOUND, 0, last)
        if ladder.links.shape[0] > 0:
            shift_linked(ladder, e, states, k, FOUND)
        for i in range(starts.shape[2]):
            out[m, 0, i] = states[FOUND, 0, i]
            out[m, 1, i] = states[FOUND, 1, i]
