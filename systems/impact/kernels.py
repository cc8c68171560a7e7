"""Kernels of linear modes joined by events: the loop over flights and transitions.

Modal coordinates all the way: an impact adds a multiple of one vector, and nothing is transformed
to positions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.bound_kernels import died_out, stays_in_band
from dynkit.exponential.double_double_kernels import two_product
from dynkit.exponential.evaluation_kernels import (
    FOUND,
    KEPT,
    LEFT,
    START,
    Workspace,
    start_sums,
    value_and_rates,
)
from dynkit.exponential.polynomial_kernels import LIMIT, NEVER, PAUSED, ROOT, TOUCH
from dynkit.exponential.search_kernels import FOREVER, first_root
from dynkit.exponential.stack_kernels import GROUP, ladder_at
from dynkit.systems.impact.clock_kernels import (
    BUDGET,
    CELLS,
    CHATTER_ERROR,
    GUARD,
    IMPACTS,
    LEFT_FROM,
    MOTION,
    ORDER,
    SPEED,
    SWITCHES,
    TOUCHES,
    WANTED,
    advance_clock,
    normalise,
    perturb,
    perturb_cut,
    perturb_reached,
    perturb_released,
    perturb_touch,
)
from dynkit.systems.impact.contact_kernels import (
    Tables,
    chatter_completes,
    chatter_rest,
    is_negative,
    lifted,
    order_at_rest,
    transform,
)
from dynkit.systems.impact.log_kernels import (
    BOUNCED,
    FLIGHT,
    SWITCHED,
    Impacts,
    Switches,
    enter,
    note_impact,
)

Indices = NDArray[np.intp]


(
    COUNT_REACHED,
    NO_FURTHER_CONTACT,
    CONTACT_FOR_EVER,
    SEARCH_LIMIT,
    DIED_OUT,
    MODE_WANTED,
    SWITCHES_FULL,
    RUN_PAUSED,
) = range(8)
"""Endings of a run; after the last three the call is repeated."""

IMPACT, SWITCH = range(2)
"""What happens where a guard is zero: the law of impacts in the same mode, or another mode."""

RELEASED = 3
"""Order of the gap after contact: it, its rate and its acceleration are zero."""

PER_EVENT = 4
"""An event takes about as long as so many cells; where contact is tried, one more for each slot."""

FIRST_CELLS = 64
"""Cells after which the search of one of several guards waits for that of the others."""

WAITS, TURN, OUTCOME, STEPS, BEST = range(5)
"""Of a paused search: whether it is paused, how many guards were searched, and the earliest root so
far: its outcome, smallest steps and guard. Its remainder and rate are waiting, too."""


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


@kernel()
def _jumped(tables: Tables, g: int, switched: bool, states: Array, band_factor: float) -> int:
    """A guard that is negative at a start, or after an event at guard `g`; -1 if none.

    Those of an element that has switched are zero but for rounding, or decided.
    """
    m = tables.ladders.integers[g, GROUP]
    for k in range(tables.first[m], tables.first[m + 1]):
        if tables.event[k] != SWITCH or (switched and tables.element[k] == tables.element[g]):
            continue
        if is_negative(ladder_at(tables.ladders, k), states, START, band_factor):
            return int(k)
    return -1


@kernel()
def _guard_of(tables: Tables, mode: int, element: int) -> int:
    """The first guard of an element in a mode."""
    g = int(tables.first[mode])
    while tables.element[g] != element:
        g += 1
    return g


@kernel(entry=True, nogil=True)
def run(
    tables: Tables,
    clock: Array,
    count: int,
    noise: float | None,
    band_factor: float,
    limit: int,
    pause: int,
    impacts: Impacts,
    switches: Switches,
    work: Workspace,
    waiting: Indices,
    waits: Array,
) -> tuple[int, int]:
    """Simulate `count` impacts from (``work.states[START]``, `clock`), modified in place.

    Parameters
    ----------
    limit
        Largest number of cells of one search.
    pause
        After so many cells, and twice as many at most, this call ends with RUN_PAUSED; a call with
        the same arguments, for the impacts that remain, goes on from there, bit for bit.
    noise
        Relative size of a pseudo-random perturbation after each event, for error estimates. With
        None, what perturbs is not compiled.
    impacts, switches
        Logs, modified in place; that of impacts has `count` rows or none.
    work, waiting, waits
        Buffers (5 integers, 2 numbers), modified in place.

    Returns
    -------
    impacts, ending
    """
    y = work.states
    ladders = tables.ladders
    store = impacts.time.shape[0] > 0
    # Not a literal: for every one of them the search would be compiled once more.
    for_ever = FOREVER + (count - count)
    spent = 0
    done = 0
    # Views of a guard are made where it is another one than before.
    at = int(clock[GUARD])
    gap = ladder_at(ladders, at)
    while done < count:
        if spent >= pause:
            return done, RUN_PAUSED
        if int(clock[SWITCHES]) + 2 > switches.time.shape[0]:
            return done, SWITCHES_FULL
        g = int(clock[GUARD])
        order = int(clock[ORDER])
        if waiting[WAITS] == 0:
            spent += PER_EVENT
            if at != g:
                at = g
                gap = ladder_at(ladders, at)
            # Nothing drives it: then it may die out.
            if gap.steady < 0 and died_out(gap, y, START):
                return done, DIED_OUT
            before = clock[MOTION]
            changed = _jumped(tables, g, before == SWITCHED, y, band_factor)
            if changed >= 0:
                if tables.partner[changed] < 0:
                    clock[WANTED] = changed
                    return done, MODE_WANTED
                transform(tables.change[changed], y, START, 0)
                _copy(y, 0, START)
                held = _guard_of(tables, tables.target[changed], tables.element[g])
                torn = tables.order[changed] == RELEASED
                if torn:
                    held = tables.partner[changed]
                enter(changed, held, order, clock, 0.0, y, switches)
                clock[LEFT_FROM] = -1.0
                clock[MOTION] = before
                if torn:  # by a force that jumped: the gap has an acceleration at once
                    clock[MOTION] = BOUNCED
                    clock[SPEED] = 0.0
                continue
            if before == FLIGHT:
                order = 0
            elif before == BOUNCED:
                u = clock[SPEED]
                second, third, fourth, _ = start_sums(gap.rows, y, START)
                r = tables.restitution[g]
                # Largest change of a position or velocity by the rest of a chatter, at first order.
                error = tables.coupling[g] * lifted(r, u, second)
                if u > 0.0:
                    order = 1
                    sticks = chatter_completes(
                        gap,
                        tables.kick[g],
                        r,
                        tables.tolerance,
                        u,
                        second,
                        third,
                        fourth,
                        error,
                    )
                else:
                    order = order_at_rest(gap.rows, y, band_factor)
                    if order > 0 and stays_in_band(gap, y, START, tables.tolerance):
                        # It would never leave the table by more: all that moves is rounding.
                        order = 0
                    sticks = order <= 0
                if sticks:
                    held = tables.partner[g]
                    if held < 0:
                        clock[WANTED] = g
                        return done, MODE_WANTED
                    spent += y.shape[2]
                    transform(tables.change[g], y, START, 0)
                    if is_negative(ladder_at(ladders, held), y, 0, band_factor):
                        # What rounding hid in flight is clear on the table: it does not hold the
                        # mass.
                        if u == 0.0:
                            transform(tables.change[held], y, 0, START)
                            normalise(y, gap.steady)
                            order = order_at_rest(gap.rows, y, band_factor)
                        sticks = order <= 0
                if sticks:
                    rest = 0.0
                    if u > 0.0:
                        rest = chatter_rest(gap, tables.kick[g], r, u, second, third)
                        clock[CHATTER_ERROR] += error
                        if noise is not None:
                            lost = lifted(r, u, second)
                            perturb_cut(tables.excursion[g], lost, y, clock)
                            transform(tables.change[g], y, START, 0)
                    _copy(y, START, LEFT)
                    clock[LEFT_FROM] = g
                    _copy(y, 0, START)
                    order = 0
                    enter(g, held, order, clock, rest, y, switches)
                    g = held
            clock[ORDER] = order
        m = ladders.integers[g, GROUP]
        first = tables.first[m]
        guards = tables.first[m + 1] - first
        smallest = ladders.smallest[m]
        # With several guards little is spent on each at first: what cannot be told of one of them
        # for ever need not be, where another one is reached.
        budget = int(clock[BUDGET])
        if budget == 0:
            budget = min(limit, FIRST_CELLS) if guards > 1 else limit
        turn = 0
        outcome = NEVER
        n = 0
        best = g
        e = 0.0
        rate = 0.0
        if waiting[WAITS] != 0:
            waiting[WAITS] = 0
            turn, outcome, n, best = waiting[TURN], waiting[OUTCOME], waiting[STEPS], waiting[BEST]
            e, rate = waits[0], waits[1]
        while turn < guards:
            k = g + turn  # the one that was left first
            if k >= first + guards:
                k -= guards
            if at != k:
                at = k
                gap = ladder_at(ladders, at)
            found, steps, d, slope, cells = first_root(
                gap,
                order if turn == 0 else 0,
                clock[SPEED] if turn == 0 else 0.0,
                band_factor,
                tables.event[k] == IMPACT,
                budget,
                pause,
                for_ever if outcome == NEVER else n,
                work,
            )
            if found == PAUSED:
                waiting[WAITS], waiting[TURN] = 1, turn
                waiting[OUTCOME], waiting[STEPS], waiting[BEST] = outcome, n, best
                waits[0], waits[1] = e, rate
                clock[BUDGET] = budget
                return done, RUN_PAUSED
            spent += cells
            clock[CELLS] += cells
            reached = found in (ROOT, TOUCH)
            # At the limit of cells a search has come to n, and no further than another root.
            if found == LIMIT or (reached and (outcome == NEVER or (steps - n) * smallest < e - d)):
                outcome, n, best, e, rate = found, steps, k, d, slope
                if guards > 1:
                    _copy(y, FOUND, KEPT)
            turn += 1
        clock[BUDGET] = 0.0
        if outcome == LIMIT and budget < limit:
            clock[BUDGET] = min(limit, 16 * budget)
            continue
        if outcome in (NEVER, LIMIT):
            held = int(clock[LEFT_FROM])
            if held >= 0:  # contact does not end: the last event is the impact before it
                _copy(y, LEFT, START)
                clock[GUARD] = held
                clock[MOTION] = BOUNCED
                clock[LEFT_FROM] = -1.0
            if outcome == LIMIT:
                return done, SEARCH_LIMIT
            return done, CONTACT_FOR_EVER if held >= 0 else NO_FURTHER_CONTACT
        if guards > 1:
            _copy(y, KEPT, FOUND)
        if tables.event[best] == SWITCH:
            if tables.partner[best] < 0:
                clock[WANTED] = best
                return done, MODE_WANTED
            after = ladder_at(ladders, tables.partner[best])
            own = tables.target[best]
            slots = tables.slots[own, : tables.counts[own]]
            transform(tables.change[best], y, FOUND, START)
            normalise(y, after.steady)
            if noise is not None:
                perturb_released(tables.change[best], slots, after.steady, y, clock, noise)
                perturb_reached(after.generator, slots, y, clock, noise)
            advance_clock(clock, n, smallest, e, tables.clock_rate)
            order = tables.order[best]
            clock[LEFT_FROM] = -1.0
            clock[SPEED] = 0.0
            if order == 1:
                clock[SPEED] = value_and_rates(after.rows, after.offset, y, START)[1]
            enter(best, tables.partner[best], order, clock, 0.0, y, switches)
            continue
        if at != best:
            at = best
            gap = ladder_at(ladders, at)
        slots = tables.slots[m, : tables.counts[m]]
        if outcome == TOUCH:
            clock[TOUCHES] += 1.0
            if noise is not None:
                rate = perturb_touch(gap, band_factor, y, clock)
        rate = min(rate, 0.0)
        r = tables.restitution[best]
        _add_jump(tables.kick[best], -(1.0 + r) * rate, y)
        normalise(y, gap.steady)
        clock[GUARD] = best
        clock[SPEED] = 0.0 - r * rate
        clock[MOTION] = BOUNCED
        advance_clock(clock, n, smallest, e, tables.clock_rate)
        if noise is not None:
            perturb(slots, gap.steady, y, clock, noise)
            perturb_reached(gap.generator, slots, y, clock, noise)
        if store:
            note_impact(done, best, gap.steady, clock, y, impacts)
        done += 1
        clock[IMPACTS] += 1.0
    return done, COUNT_REACHED
