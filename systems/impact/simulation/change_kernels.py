"""Kernels of changes of the mode, compiled when a motion first needs them."""

from __future__ import annotations

import math

from dynkit.core.jit import by_address, kernel
from dynkit.core.validation import Array
from dynkit.exponential.bound_kernels import stays_in_band
from dynkit.exponential.evaluation_kernels import (
    EPSILON,
    FOUND,
    KEPT,
    LEFT,
    START,
    Ladder,
    Workspace,
    start_sums,
    value_and_rates,
)
from dynkit.exponential.stack_kernels import GROUP, ladder_at
from dynkit.systems.impact.simulation.clock_kernels import (
    AT_THE_SAME_TIME,
    BOUNCED,
    BOUNCES,
    CHATTER_ERROR,
    FLIGHT,
    GUARD,
    IMPACTS,
    LEFT_FROM,
    MARKED,
    MOTION,
    ORDER,
    SPEED,
    STILL,
    SWITCHED,
    TIME,
    WANTED,
    move_on,
    normalise,
    perturb_cut,
    perturb_reached,
    perturb_released,
)
from dynkit.systems.impact.simulation.contact_kernels import (
    Tables,
    accumulates,
    chatter_rest,
    drag,
    order_at_rest,
    sign_of,
    transform,
)
from dynkit.systems.impact.simulation.event_kernels import (
    SWITCH,
    appear,
    copy,
    disturbs,
    guard_of,
    jumped,
    know_gaps,
    returns,
    try_again,
    undecided,
)
from dynkit.systems.impact.simulation.law_chatter_kernels import chatter_by_law
from dynkit.systems.impact.simulation.log_kernels import Impacts, Switches, enter, note_impact
from dynkit.systems.impact.simulation.scrape_kernels import scrapes_out

JUMPS, RESTS, LEAVES = range(3)
"""Kinds of changes: a guard is negative just after an event; the mass comes to rest on a stop that
it has just hit; a flight has reached the zero of a guard that leads to another mode."""

NOTHING, CHANGED, NOT_ENTERED, COUNTED = range(4)
"""Results of `change`: nothing changed; another mode, or a bounce that does not come to rest; the
mode behind guard WANTED has not been built; another mode, at the section."""


@kernel()
def _jumps(
    g: int,
    tables: Tables,
    clock: Array,
    left: Array,
    beside: int | None,
    band_factor: float,
    switches: Switches,
    work: Workspace,
) -> int:
    """Enter the mode of a guard that is negative at the start state, if there is one."""
    y = work.states
    m = tables.ladders.integers[g, GROUP]
    changed = jumped(tables, g, left, y, band_factor)
    if changed < 0:
        return NOTHING
    if tables.partner[changed] < 0:
        clock[WANTED] = changed
        return NOT_ENTERED
    transform(tables.change[tables.row[changed]], y, START, 0)
    copy(y, 0, START)
    there = guard_of(tables, tables.target[changed], tables.element[g])
    enter(changed, there, clock, 0.0, 0.0, y, switches)
    clock[LEFT_FROM] = -1.0
    appear(tables, m, tables.target[changed], left)
    if beside is not None:
        try_again(tables, there, left, y, band_factor)
    # If a force exceeded its limit, the gap starts with an acceleration, or the slip with a rate.
    own = left[tables.element[changed]]
    if own[MOTION] == STILL:
        own[MOTION] = FLIGHT
    if tables.torn[changed] == 2:
        clock[GUARD] = tables.partner[changed]
        own[MOTION] = BOUNCED
        own[SPEED] = 0.0
    elif beside is not None and tables.torn[changed] == 1:
        after = ladder_at(tables.ladders, tables.partner[changed])
        own[SPEED] = value_and_rates(after.rows, after.offset, y, START)[1]
        if own[SPEED] > 0.0:
            own[MOTION] = SWITCHED
            own[ORDER] = 1.0
    elif beside is not None and tables.torn[changed] == 3:
        own[MOTION] = SWITCHED
        own[ORDER] = 2.0
        own[SPEED] = 0.0
    elif beside is not None and returns(tables, there, changed, m, left, y, band_factor):
        own[MOTION] = SWITCHED
        own[ORDER] = 0.0
    return CHANGED


@kernel()
def _rests(
    k: int,
    tables: Tables,
    clock: Array,
    left: Array,
    beside: int | None,
    noise: float,
    band_factor: float,
    switches: Switches,
    work: Workspace,
    waits: Array,
) -> int:
    """Decide whether the mass comes to rest on the stop of guard `k`; if so, enter contact."""
    y = work.states
    gap: Ladder = ladder_at(tables.ladders, k)
    m = tables.ladders.integers[k, GROUP]
    own = left[tables.element[k]]
    u = own[SPEED]
    lost = 0.0
    rest = 0.0
    loose = scraping = False
    if u > 0.0:
        order = 1
        second, third, fourth, _ = start_sums(gap.rows, y, START)
        r, drop = tables.restitution[k], tables.drop[k]
        rates = u
        if beside is not None and tables.law[k] >= 0:
            sticks, rest, lost, rates = chatter_by_law(
                tables, k, gap, u, second, third, fourth, waits[2:]
            )
        else:
            sticks, lost = accumulates(tables, k, gap, u, y)
            if sticks:
                rest = chatter_rest(drag(gap, tables.kick[k]), r, drop, u, second, third)
                rates = u / (1.0 - r)
        if beside is not None:
            if sticks and beside > 0 and disturbs(tables, k, rates, rest, left, y):
                sticks = False
            scraping = sticks and tables.scraped.shape[1] > 0
            if scraping and tables.partner[k] >= 0:
                copy(y, START, KEPT)
                sticks, moved = scrapes_out(tables, k, r, u, second, left, y)
                lost += moved / tables.coupling[k]
    else:
        if beside is not None:  # friction is decided only after contact has begun
            loose = undecided(tables, k, left)
        order = 0 if loose else order_at_rest(gap, y, band_factor)
        if order > 0 and stays_in_band(gap, gap.links, y, START, tables.tolerance):
            # The gap would never exceed the tolerance: it moves by rounding errors only.
            order = 0
        sticks = order <= 0
    held = tables.partner[k]
    if sticks:
        if held < 0:
            clock[WANTED] = k
            return NOT_ENTERED
        transform(tables.change[tables.row[k]], y, START, 0)
        if not loose and sign_of(ladder_at(tables.ladders, held), y, 0, 0, band_factor) < 0:
            # The sign that rounding hid in flight is clear in contact: the force is tensile.
            if u == 0.0:
                if tables.partner[held] >= 0 and tables.target[held] == m:
                    transform(tables.change[tables.row[held]], y, 0, START)
                    normalise(y, gap.steady)
                    order = order_at_rest(gap, y, band_factor)
                else:  # after contact friction would hold the mass, but has just released it
                    order = 3 * sign_of(gap, y, START, 3, band_factor)
            sticks = order <= 0
            if scraping and not sticks:
                copy(y, KEPT, START)
    own[MOTION] = BOUNCES
    own[ORDER] = order
    if sticks:
        if u > 0.0:
            # Largest change of a position or velocity by the omitted bounces, to first order.
            clock[CHATTER_ERROR] += tables.coupling[k] * lost
            if noise > 0.0:
                perturb_cut(tables.excursion[k], lost, y, clock)
                transform(tables.change[tables.row[k]], y, START, 0)
        copy(y, KEPT if scraping else START, LEFT)
        clock[LEFT_FROM] = k
        copy(y, 0, START)
        appear(tables, m, tables.target[k], left)
        if beside is not None:
            try_again(tables, held, left, y, band_factor)
        own[MOTION] = FLIGHT if loose else SWITCHED
        own[ORDER] = 0.0
        enter(k, held, clock, rest, u, y, switches)
    return CHANGED


@kernel()
def _leaves(
    best: int,
    n: int,
    e: float,
    done: int,
    tables: Tables,
    clock: Array,
    left: Array,
    beside: int | None,
    noise: float,
    band_factor: float,
    impacts: Impacts,
    switches: Switches,
    work: Workspace,
) -> int:
    """Enter the mode that guard `best` leads to; the guard is zero in the found state."""
    y = work.states
    ladders = tables.ladders
    m = ladders.integers[best, GROUP]
    if tables.partner[best] < 0:
        clock[WANTED] = best
        return NOT_ENTERED
    own = left[tables.element[best]]
    if beside is not None:
        know_gaps(tables, best, n, e, left, work)
    after = ladder_at(ladders, tables.partner[best])
    target = tables.target[best]
    slots = tables.slots[target, : tables.counts[target]]
    transform(tables.change[tables.row[best]], y, FOUND, START)
    normalise(y, after.steady)
    if noise > 0.0:
        perturb_released(tables.change[tables.row[best]], slots, after.steady, y, clock, own, noise)
        perturb_reached(after.generator, slots, y, clock, noise)
    move_on(clock, left, tables.element[best], n, ladders.smallest[m], e, tables.clock_rate)
    clock[LEFT_FROM] = -1.0
    # Other elements that switched at the same time are updated to the new mode.
    appear(tables, m, target, left)
    if beside is not None:
        try_again(tables, tables.partner[best], left, y, band_factor)
    own[MOTION] = SWITCHED if tables.event[best] == SWITCH else FLIGHT
    own[ORDER] = tables.order[best]
    own[SPEED] = 0.0
    if beside is not None and tables.order[best] == 1:
        own[SPEED] = value_and_rates(after.rows, after.offset, y, START)[1]
    enter(best, tables.partner[best], clock, 0.0, 0.0, y, switches)
    # Friction that halts again at the same time, because other friction slips, counts once.
    since = clock[TIME] - clock[MARKED]
    at_once = since <= AT_THE_SAME_TIME * EPSILON * clock[TIME]
    if beside is not None and tables.marks[best] and not at_once:
        clock[MARKED] = clock[TIME]
        if impacts.time.shape[0] > 0:
            note_impact(done, tables.partner[best], after.steady, clock, math.nan, y, impacts)
        clock[IMPACTS] += 1.0
        return COUNTED
    return CHANGED


@kernel(entry=True)
def change(
    what: int,
    k: int,
    n: int,
    e: float,
    done: int,
    tables: Tables,
    clock: Array,
    left: Array,
    beside: int | None,
    noise: float,
    band_factor: float,
    impacts: Impacts,
    switches: Switches,
    work: Workspace,
    waits: Array,
) -> int:
    """Change the mode at guard `k`, or decide that it stays; the arguments are those of `run`.

    `what` is JUMPS, RESTS or LEAVES. For LEAVES, the flight has lasted `n` smallest steps and a
    time `e`. `done` is the number of impacts so far. Arrays are modified in place.
    """
    if what == JUMPS:
        return _jumps(k, tables, clock, left, beside, band_factor, switches, work)
    if what == RESTS:
        return _rests(k, tables, clock, left, beside, noise, band_factor, switches, work, waits)
    return _leaves(
        k, n, e, done, tables, clock, left, beside, noise, band_factor, impacts, switches, work
    )


change_by_address = by_address(change, int)
"""Calls `change` by its address."""
