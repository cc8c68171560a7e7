"""Kernels of linear modes joined by events: the loop over flights and transitions.

States stay in modal coordinates throughout: an impact adds a multiple of one vector, and no state
is transformed to positions.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.bound_kernels import died_out_by_address
from dynkit.exponential.evaluation_kernels import (
    CHANGE,
    DEATH,
    EPSILON,
    FOUND,
    KEPT,
    LEFT,
    NOISE,
    SEARCH,
    START,
    WANTED_CODE,
    Workspace,
    value_and_rates,
)
from dynkit.exponential.polynomial_kernels import LIMIT, NEVER, PAUSED, ROOT, TOUCH
from dynkit.exponential.sampling_kernels import fly
from dynkit.exponential.search_kernels import FOREVER, first_root, plain, search_by_address
from dynkit.exponential.stack_kernels import GROUP, ladder_at
from dynkit.systems.impact.elements.law_kernels import evaluate
from dynkit.systems.impact.simulation.change_kernels import (
    CHANGED,
    COUNTED,
    JUMPS,
    LEAVES,
    NOT_ENTERED,
    RESTS,
    change_by_address,
)
from dynkit.systems.impact.simulation.clock_kernels import (
    AMBIGUOUS,
    AT_ONCE,
    BOUNCED,
    BOUNCES,
    BUDGET,
    CELLS,
    GAP,
    GUARD,
    IMPACTS,
    LEFT_FROM,
    LONGEST,
    MOTION,
    ORDER,
    REMAINING,
    SPEED,
    SWITCHED,
    SWITCHES,
    TIME,
    TOUCHES,
    WANTED,
    begin_period,
    disturb_by_address,
    move_on,
    normalise,
)
from dynkit.systems.impact.simulation.contact_kernels import Tables, accumulates, transform
from dynkit.systems.impact.simulation.event_kernels import (
    HALT,
    IMPACT,
    JAM,
    JUMP,
    SWITCH,
    add_jump,
    appear,
    bounced,
    come_to_rest,
    copy,
    falling,
    first_of,
    guard_of,
    jolt,
    jumped,
    know_gaps,
    lets_go,
    precedes,
    push,
    together,
)
from dynkit.systems.impact.simulation.log_kernels import Impacts, Switches, enter, note_impact
from dynkit.systems.impact.simulation.scrape_kernels import scrape

Indices = NDArray[np.intp]

(
    COUNT_REACHED,
    NO_FURTHER_CONTACT,
    CONTACT_FOR_EVER,
    SEARCH_LIMIT,
    DIED_OUT,
    JAMMED,
    COLLAPSED,
    MODE_WANTED,
    SWITCHES_FULL,
    RUN_PAUSED,
    LAW_BROKEN,
) = range(11)
"""Endings of a run. LAW_BROKEN: the impact law of guard ``clock[WANTED]`` gives no number in [0, 1]
at the velocity ``waits[1]``."""

AGAIN = MODE_WANTED, SWITCHES_FULL, RUN_PAUSED
"""Endings after which the call is repeated."""

SECTION = 100
"""Outcome of a search without an event within the period of the stroboscopic section."""

PER_EVENT = 4
"""Cost of an event, in search cells; a test for contact costs one more cell for each slot."""

AT_REST, MOST_AT_ONCE = 10, 1000
"""Numbers of impacts on alternating stops in no time. Beyond the first number, gaps whose rates are
hidden by rounding get rates of zero. Beyond the second one, times the number of elements, the run
ends with COLLAPSED."""

FIRST_CELLS = 64
"""Cells after which the search for a zero of one of several guards gives way to the next guard."""

WAITS, TURN, OUTCOME, STEPS, BEST, NEXT = range(6)
"""Indices of `waiting`, which holds a paused search: whether it is paused, the number of guards
searched, and the outcome, number of smallest steps and guard of the earliest root so far. The
remainder of its time and the guard's rate are in `waits`. From NEXT on: for each guard, modulo
MOST_KNOWN, the guard that ended the last flight that began at it."""

MOST_KNOWN = 1024
WAITING = NEXT + MOST_KNOWN
"""Length of `waiting`."""


@kernel(entry=True, nogil=True)
def run(
    tables: Tables,
    clock: Array,
    left: Array,
    count: int,
    beside: int | None,
    noise: float,
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
    left
        (elements, BEGIN) how each element begins the flight, see `MOTION`; modified in place.
    limit
        Largest number of cells of one search.
    pause
        After this number of cells, and at most twice as many, the call ends with RUN_PAUSED. A call
        with the same arguments, for the remaining impacts, continues it bit for bit.
    beside
        Number of elements besides the first one. None means that there are none and that the only
        element is a hard stop whose restitution is a number; code for others is not compiled.
    noise
        Relative size of a pseudo-random perturbation after each event, for error estimates; 0 for
        none.
    impacts, switches
        Logs, modified in place; that of impacts has `count` rows or none.
    work, waiting, waits
        Buffers (WAITING integers and 3 numbers, the last one for impact laws), modified in place.

    Returns
    -------
    impacts, ending
    """
    y = work.states
    buffer = waits[2:]
    ladders = tables.ladders
    codes = work.codes
    store = impacts.time.shape[0] > 0
    # A literal would be another type, for which the search would be compiled once more.
    for_ever = FOREVER + (count - count)
    spent = 0
    done = 0
    # Views of a guard's arrays are made only when the guard changes.
    at = int(clock[GUARD])
    gap = ladder_at(ladders, at)
    while done < count:
        if spent >= pause:
            return done, RUN_PAUSED
        if int(clock[SWITCHES]) + 2 + left.shape[0] > switches.time.shape[0]:
            return done, SWITCHES_FULL
        g = int(clock[GUARD])
        if waiting[WAITS] == 0:
            spent += PER_EVENT
            if at != g:
                at = g
                gap = ladder_at(ladders, at)
            # A motion without forcing may die out.
            if gap.steady < 0 and tables.period == 0.0:
                if codes[DEATH] <= 0:
                    codes[DEATH] = WANTED_CODE
                    return done, RUN_PAUSED
                if died_out_by_address(codes[DEATH], (gap, y, START)):
                    return done, DIED_OUT
            m = ladders.integers[g, GROUP]
            if codes[CHANGE] <= 0 and (beside is not None or tables.event[g] != IMPACT):
                codes[CHANGE] = WANTED_CODE
                return done, RUN_PAUSED
            if beside is not None:
                jumps = jumped(tables, g, left, y, band_factor) >= 0
            else:  # only the contact force can be negative just after an event
                jumps = tables.event[g] != IMPACT and left[tables.element[g], MOTION] != SWITCHED
            if jumps:
                came = change_by_address(
                    codes[CHANGE], (JUMPS, g, 0, 0.0, done, tables, clock, left, beside, noise,
                    band_factor, impacts, switches, work, waits)
                )  # fmt: skip
                if came == NOT_ENTERED:
                    return done, MODE_WANTED
                if came == CHANGED:
                    continue
            k = bounced(tables, m, left)
            if k >= 0:
                if at != k:
                    at = k
                    gap = ladder_at(ladders, at)
                own = left[tables.element[k]]
                u = own[SPEED]
                number = beside is None or tables.law[k] < 0
                if u > 0.0 and number and not accumulates(tables, k, gap, u, y)[0]:
                    own[MOTION] = BOUNCES
                    own[ORDER] = 1.0
                else:
                    if codes[CHANGE] <= 0:
                        codes[CHANGE] = WANTED_CODE
                        return done, RUN_PAUSED
                    spent += y.shape[2]
                    came = change_by_address(
                        codes[CHANGE], (RESTS, k, 0, 0.0, done, tables, clock, left, beside, noise,
                        band_factor, impacts, switches, work, waits)
                    )  # fmt: skip
                    if came == NOT_ENTERED:
                        return done, MODE_WANTED
                    g = int(clock[GUARD])
                if beside is not None and beside > 0:
                    continue  # another stop may have been hit, or another force be too large
        m = ladders.integers[g, GROUP]
        first = tables.first[m]
        guards = tables.first[m + 1] - first
        smallest = ladders.smallest[m]
        # With several guards, each search begins with a small budget: a guard whose sign is hard to
        # determine for all time need not be searched beyond the zero of another guard.
        budget = int(clock[BUDGET])
        if budget == 0:
            budget = min(limit, FIRST_CELLS) if guards > 1 else limit
        turn, outcome, n, best = 0, NEVER, 0, g
        e = rate = 0.0
        if beside is not None and tables.period > 0.0:
            outcome = SECTION
            n = int(clock[REMAINING] / smallest)
            e = clock[REMAINING] - n * smallest
        if waiting[WAITS] != 0:
            waiting[WAITS] = 0
            turn, outcome, n, best = waiting[TURN], waiting[OUTCOME], waiting[STEPS], waiting[BEST]
            e, rate = waits[0], waits[1]
        elif beside is not None:
            k = falling(tables, g, left, band_factor, work)
            if k >= 0:
                copy(y, START, KEPT)
                outcome, n, best, e, rate = ROOT, 0, k, 0.0, 0.0
        # A root limits the later searches to the time before it. Therefore the guard that is likely
        # to be reached first is searched first. The result does not depend on the order.
        likely = waiting[NEXT + g % MOST_KNOWN]
        if not first <= likely < first + guards:
            likely = g
        while turn < guards:
            k = likely + turn
            if k >= first + guards:
                k -= guards
            if at != k:
                at = k
                gap = ladder_at(ladders, at)
            if tables.event[k] >= JUMP:
                turn += 1
                continue
            begins = k == first or tables.element[k - 1] != tables.element[k]
            own = left[tables.element[k]]
            order = int(own[ORDER]) if begins else 0
            speed = own[SPEED] if order > 0 else own[GAP]
            touches = tables.event[k] == IMPACT
            horizon = for_ever if outcome == NEVER else n
            if plain(gap):
                found, steps, d, slope, cells = first_root(
                    gap, order, speed, band_factor, touches, budget, pause, horizon, work, None
                )
            elif codes[SEARCH] > 0:
                found, steps, d, slope, cells = search_by_address(
                    codes[SEARCH],
                    (gap, order, speed, band_factor, touches, budget, pause, horizon, work),
                )
            else:
                codes[SEARCH] = WANTED_CODE
                found, steps, d, slope, cells = PAUSED, 0, 0.0, 0.0, 0
            if found == PAUSED:
                waiting[WAITS], waiting[TURN] = 1, turn
                waiting[OUTCOME], waiting[STEPS], waiting[BEST] = outcome, n, best
                waits[0], waits[1] = e, rate
                clock[BUDGET] = budget
                return done, RUN_PAUSED
            spent += cells
            clock[CELLS] += cells
            sooner = found in (ROOT, TOUCH)
            if sooner and outcome != NEVER:
                gain = (e - d) - (steps - n) * smallest
                sooner = gain > 0.0 or (gain == 0.0 and (k - g) % guards < (best - g) % guards)
                if beside is not None and outcome in (ROOT, TOUCH):
                    hit, slid, where = (best, k, KEPT) if sooner else (k, best, FOUND)
                    sooner = sooner != precedes(tables, hit, slid, where, y, band_factor)
            # A search that ends at the limit of cells has reached a time before any other root.
            if found == LIMIT or sooner:
                outcome, n, best, e, rate = found, steps, k, d, slope
                if guards > 1:
                    copy(y, FOUND, KEPT)
            turn += 1
        clock[BUDGET] = 0.0
        if outcome == LIMIT and budget < limit:
            clock[BUDGET] = min(limit, 16 * budget)
            continue
        if outcome in (NEVER, LIMIT):
            held = int(clock[LEFT_FROM])
            if held >= 0:  # contact never ends: go back to the impact before it
                copy(y, LEFT, START)
                clock[GUARD] = held
                left[tables.element[held], MOTION] = BOUNCED
                clock[LEFT_FROM] = -1.0
            if outcome == LIMIT:
                return done, SEARCH_LIMIT
            return done, CONTACT_FOR_EVER if held >= 0 else NO_FURTHER_CONTACT
        if beside is not None and outcome == SECTION:
            fly(gap, n, e, y)
            copy(y, FOUND, START)
            move_on(clock, left, -1, n, smallest, e, tables.clock_rate)
            begin_period(gap.steady, y, clock, tables.period)
            clock[GUARD] = first
            if noise > 0.0:
                slots = tables.slots[m, : tables.counts[m]]
                disturb_by_address(
                    codes[NOISE], (gap, slots, False, y, clock, left[0], noise, band_factor)
                )
            if store:
                note_impact(done, first, gap.steady, clock, math.nan, y, impacts)
            done += 1
            clock[IMPACTS] += 1.0
            continue
        if guards > 1:
            copy(y, KEPT, FOUND)
            waiting[NEXT + g % MOST_KNOWN] = best
        own = left[tables.element[best]]
        if tables.event[best] in (SWITCH, HALT):
            came = change_by_address(
                codes[CHANGE], (LEAVES, best, n, e, done, tables, clock, left, beside, noise,
                band_factor, impacts, switches, work, waits)
            )  # fmt: skip
            if came == NOT_ENTERED:
                return done, MODE_WANTED
            done += came == COUNTED
            continue
        if beside is not None:
            if tables.event[best] == JAM:
                copy(y, FOUND, START)
                move_on(clock, left, tables.element[best], n, smallest, e, tables.clock_rate)
                return done, JAMMED
            tied = first_of(tables, best, y, band_factor)
            if tied != best:
                at = best = tied
                gap = ladder_at(ladders, best)
                own = left[tables.element[best]]
                outcome = ROOT
                rate = value_and_rates(gap.rows, gap.offset, y, FOUND)[1]
            wanted = lets_go(tables, best)
            if wanted >= 0:
                clock[WANTED] = wanted
                return done, MODE_WANTED
        if at != best:
            at = best
            gap = ladder_at(ladders, at)
        if outcome == TOUCH:
            clock[TOUCHES] += 1.0
            if noise > 0.0:
                slots = tables.slots[m, : tables.counts[m]]
                rate = disturb_by_address(
                    codes[NOISE], (gap, slots, True, y, clock, own, noise, band_factor)
                )
        rate = min(rate, 0.0)
        if beside is not None and beside > 0:
            know_gaps(tables, best, n, e, left, work)
        move_on(clock, left, tables.element[best], n, smallest, e, tables.clock_rate)
        appeared = False
        if beside is not None:
            ambiguous = tables.ambiguous[best] or (
                guards > 1 and together(tables, best, y, band_factor, clock[LONGEST])
            )
            if ambiguous and clock[AMBIGUOUS] < 0.0:
                clock[AMBIGUOUS] = clock[IMPACTS]
            while tables.opens[best] >= 0:  # a closed stop from which the impact pulls away
                open_ = tables.opens[best]
                before = ladders.integers[open_, GROUP]
                at = best = guard_of(tables, tables.target[open_], tables.element[best])
                gap = ladder_at(ladders, at)
                transform(tables.change[tables.row[open_]], y, FOUND, START)
                normalise(y, gap.steady)
                copy(y, START, FOUND)
                left[tables.element[open_], MOTION] = BOUNCED
                appeared = appear(tables, before, tables.target[open_], left) or appeared
                clock[LEFT_FROM] = -1.0
                enter(open_, best, clock, 0.0, 0.0, y, switches)
        m = ladders.integers[best, GROUP]
        r = tables.restitution[best]
        if beside is not None and tables.law[best] >= 0 and rate < 0.0:
            law = tables.law[best]
            r = evaluate(tables.codes[law], tables.numbers[law], -rate, buffer)
            if not 0.0 <= r <= 1.0:
                clock[WANTED], waits[1] = best, -rate
                return done, LAW_BROKEN
        add_jump(tables.kick[best], -(1.0 + r) * rate, y)
        if beside is not None:
            scrape(tables, best, -(1.0 + r) * rate, left, y)
        normalise(y, gap.steady)
        # The impact pushes a mass against the stop at which friction held it.
        if (
            beside is not None
            and push(tables, best, left, y)
            and appeared
            and clock[AMBIGUOUS] < 0.0
        ):
            clock[AMBIGUOUS] = clock[IMPACTS]
        if (n * smallest + e) > EPSILON * clock[TIME]:
            clock[AT_ONCE] = 0.0
        elif clock[GUARD] != best:
            clock[AT_ONCE] += 1.0
        clock[GUARD] = best
        if beside is not None and beside > 0:
            jolt(tables, best, left, y, band_factor)
        own[SPEED] = 0.0 - r * rate
        own[MOTION] = BOUNCED
        if noise > 0.0:
            slots = tables.slots[m, : tables.counts[m]]
            disturb_by_address(codes[NOISE], (gap, slots, False, y, clock, own, noise, band_factor))
        if store:
            note_impact(done, best, gap.steady, clock, own[SPEED], y, impacts)
        done += 1
        clock[IMPACTS] += 1.0
        if beside is not None:
            if clock[AT_ONCE] > AT_REST and come_to_rest(tables, m, left, y, band_factor):
                clock[AT_ONCE] = 0.0
            if clock[AT_ONCE] > MOST_AT_ONCE * left.shape[0]:
                return done, COLLAPSED
    return done, COUNT_REACHED
