"""Kernels that update the elements of a machine at an event."""

from __future__ import annotations

import math

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.double_double_kernels import two_product
from dynkit.exponential.evaluation_kernels import (
    EPSILON,
    FOUND,
    KEPT,
    START,
    Ladder,
    Workspace,
    expand,
    expand_apart,
    look_ahead,
    start_sums,
    value_and_rates,
)
from dynkit.exponential.polynomial_kernels import polynomial
from dynkit.exponential.stack_kernels import GROUP, ladder_at
from dynkit.systems.impact.simulation.clock_kernels import (
    AT_LIMIT,
    AT_THE_SAME_TIME,
    BOUNCED,
    BOUNCES,
    FLIGHT,
    GAP,
    MOTION,
    ORDER,
    SPEED,
    STILL,
    SWITCHED,
)
from dynkit.systems.impact.simulation.contact_kernels import SMALLEST, Tables, sign_of

_HALVINGS = 60
"""The first step of `falls` is the smallest step halved this many times."""

LAIN = 2
"""Regime of an open stop at which friction holds a mass."""

IMPACT, SWITCH, JAM, HALT, JUMP, REST = range(6)
"""Kinds of events at the zero of a guard: an impact in the same mode, another mode, the end of the
motion, another mode because a rate has become zero, another mode only if the guard is negative just
after an event, or only where a motion begins at rest."""


@kernel()
def add_jump(kick: Array, jump: float, states: Array) -> None:
    """Set the start state to the found state plus `jump` times the kick, rounded once.

    A kick rounded to double precision would bias the energy by the same amount, about 1e-17, at
    every impact.
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
def copy(states: Array, k: int, to: int) -> None:
    """Copy state `k` into state `to`."""
    for row in range(2):
        for i in range(states.shape[2]):
            states[to, row, i] = states[k, row, i]


@kernel()
def vanishes(tables: Tables, k: int, left: Array) -> bool:
    """Whether guard `k` is exactly zero because its slider is at the limit of this guard."""
    return bool(tables.yields[k] * left[tables.element[k], AT_LIMIT] > 0.0)


@kernel()
def falls(guard: Ladder, band_factor: float, work: Workspace) -> bool:
    """Whether a guard that is exactly zero at the start becomes negative.

    The sign of its first nonzero derivative decides. Derivatives that vanish have rounding errors,
    but these contribute less than the guard's own rounding error until the nonzero one contributes
    more. The result is therefore the sign with which the guard first exceeds its rounding error.
    """
    y, c = work.states, work.coefficients
    band = band_factor * EPSILON * (start_sums(guard.rows, y, START)[3] + abs(guard.offset))
    if guard.apart:
        expand_apart(guard, y, START, c)
    else:
        expand(guard.generator, guard.rows, guard.offset, y, START, c)
    rounding, c[0] = c[0], 0.0
    for rung in range(-_HALVINGS, guard.cell.shape[0]):
        if rung <= 0:
            value = polynomial(c, 0, guard.smallest * 2.0**rung)[0]
        else:
            value = look_ahead(guard.cell, rung, y, START)[0] + guard.offset - rounding
        if abs(value) > band:
            return bool(value < 0.0)
    return False


@kernel()
def falling(tables: Tables, g: int, left: Array, band_factor: float, work: Workspace) -> int:
    """The first guard in cyclic order from `g` that vanishes and becomes negative; -1 if none."""
    m = tables.ladders.integers[g, GROUP]
    first, guards = tables.first[m], tables.first[m + 1] - tables.first[m]
    for turn in range(guards):
        k = first + (g - first + turn) % guards
        if tables.event[k] >= JUMP or not vanishes(tables, k, left):
            continue
        if falls(ladder_at(tables.ladders, k), band_factor, work):
            return int(k)
    return -1


@kernel()
def jumped(tables: Tables, g: int, left: Array, states: Array, band_factor: float) -> int:
    """A guard that is negative at a start, or after an event at guard `g`; -1 if none.

    The guards of elements that have just switched are skipped: they are zero to rounding, or their
    signs are known. The guard of a slider at its limit is zero (see `falls`). The guards are tested
    from `g` on: if an element that has just halted slips on, others may stick that would not do so
    if it stuck.
    """
    m = tables.ladders.integers[g, GROUP]
    first, guards = tables.first[m], tables.first[m + 1] - tables.first[m]
    for turn in range(guards):
        k = first + (g - first + turn) % guards
        motion = left[tables.element[k], MOTION]
        if tables.event[k] not in (SWITCH, JUMP) or motion == SWITCHED:
            continue
        if vanishes(tables, int(k), left):
            continue
        if motion == STILL and tables.event[k] == JUMP and tables.order[k] == 0:
            continue  # friction that an impact has stopped slips by rounding errors only
        if sign_of(ladder_at(tables.ladders, k), states, START, 0, band_factor) < 0:
            return int(k)
    return -1


@kernel()
def returns(
    tables: Tables,
    g: int,
    changed: int,
    before: int,
    left: Array,
    states: Array,
    band_factor: float,
) -> bool:
    """Whether the element that guard `changed` has switched would switch back at once.

    This is possible by rounding errors only: without them, its guards in the two modes are not both
    negative.
    """
    k = jumped(tables, g, left, states, band_factor)
    return bool(
        k >= 0 and tables.element[k] == tables.element[changed] and tables.target[k] == before
    )


@kernel()
def bounced(tables: Tables, m: int, left: Array) -> int:
    """The first guard of mode `m` whose stop has just been hit; -1 if none."""
    for k in range(tables.first[m], tables.first[m + 1]):
        if tables.event[k] == IMPACT and left[tables.element[k], MOTION] == BOUNCED:
            return int(k)
    return -1


@kernel()
def disturbs(
    tables: Tables, g: int, rates: float, lasts: float, left: Array, states: Array
) -> bool:
    """Whether the bounces of a chatter at guard `g` may make other elements switch.

    `rates` is the sum of the velocities at which the bounces begin, and `lasts` their duration. In
    total their impulses change another guard by less than 2 `rates` times its change by a unit
    jump.
    """
    kick, all_of_them = tables.kick[g], 2.0 * rates
    least = max(tables.tolerance, SMALLEST)
    m = tables.ladders.integers[g, GROUP]
    for k in range(tables.first[m], tables.first[m + 1]):
        if tables.event[k] not in (SWITCH, HALT) or tables.rubbed[g, tables.element[k]]:
            continue
        guard = ladder_at(tables.ladders, k)
        rows, at_once, in_time = guard.rows, 0.0, 0.0
        for i in range(rows.shape[1]):
            at_once += rows[0, i] * kick[0, i] + rows[1, i] * kick[1, i]
            in_time += rows[2, i] * kick[0, i] + rows[3, i] * kick[1, i]
        at_once, in_time = abs(at_once), abs(in_time)
        for f in range(tables.scraped.shape[1]):
            rub, ratio = tables.scrape[g, f], tables.scraped[g, f, 0]
            more, later = 0.0, 0.0
            for i in range(rows.shape[1]):
                more += rows[0, i] * rub[4, i] + rows[1, i] * rub[5, i]
                later += rows[2, i] * rub[4, i] + rows[3, i] * rub[5, i]
            at_once += ratio * abs(more)
            in_time += ratio * abs(later)
        change = (at_once + in_time * lasts) * all_of_them
        value, rate = value_and_rates(rows, guard.offset, states, START)[:2]
        near = vanishes(tables, int(k), left) or value < 2.0 * (change + abs(rate) * lasts)
        if change > least and near:
            return True
    return False


@kernel()
def appear(tables: Tables, before: int, m: int, left: Array) -> bool:
    """Update elements after a change from mode `before` to `m`; whether a `LAIN` stop is free.

    A stop at which friction no longer holds a mass has a gap of zero, at rest. A slider that no
    longer slides is at its limit, and stays there until it moves. An element that has just switched
    and is now in another regime has other guards, and is in flight.
    """
    for element in range(left.shape[0]):
        was, now, at = tables.slides[before, element], tables.slides[m, element], left[element]
        if at[MOTION] == SWITCHED and tables.regimes[before, element] != tables.regimes[m, element]:
            at[MOTION] = FLIGHT
            at[ORDER] = 0.0
        if was in (1, -1):
            at[AT_LIMIT] = was
        if now in (1, -1):
            at[AT_LIMIT] = 0.0
        elif at[AT_LIMIT] != 0.0:
            at[AT_LIMIT] = math.copysign(float(max(now, 1)), at[AT_LIMIT])
    found = False
    for k in range(tables.first[m], tables.first[m + 1]):
        element = tables.element[k]
        lay = tables.regimes[before, element] == LAIN != tables.regimes[m, element]
        if tables.event[k] == IMPACT and lay:
            found = True
            left[element, MOTION] = BOUNCED
            left[element, ORDER] = 0.0
            left[element, SPEED] = 0.0
    return found


@kernel()
def undecided(tables: Tables, g: int, left: Array) -> bool:
    """Whether friction that has not just switched rests while the stop of guard `g` is closed."""
    for element in range(left.shape[0]):
        if tables.rubbed[g, element] and left[element, MOTION] != SWITCHED:
            return True
    return False


@kernel()
def know_gaps(tables: Tables, g: int, n: int, e: float, left: Array, work: Workspace) -> None:
    """Compute the gaps of stops that were left shortly before guard `g` ends the flight.

    If friction switches during low bounces, gaps from the state would have the rounding errors of
    positions. Here they have relative accuracy, from Taylor coefficients. `left` is modified in
    place.
    """
    m, c = tables.ladders.integers[g, GROUP], work.coefficients
    for k in range(tables.first[m], tables.first[m + 1]):
        if tables.event[k] not in (IMPACT, JAM):
            continue
        own = left[tables.element[k]]
        order = int(own[ORDER])
        rubbed = tables.event[g] != IMPACT or tables.drop[k] + tables.hold[k] > 0.0
        if k == g:  # `move_on` ends the bounce of this stop
            continue
        if n > 0 or not rubbed or (order == 0 and own[GAP] == 0.0):
            own[GAP] = 0.0
            continue
        gap = ladder_at(tables.ladders, k)
        if gap.apart:
            expand_apart(gap, work.states, START, c)
        else:
            expand(gap.generator, gap.rows, gap.offset, work.states, START, c)
        if order < 2:
            c[order] = own[SPEED] if order == 1 else own[GAP]
        value = polynomial(c, order, e)[0]
        for _ in range(order):
            value *= e
        own[GAP] = max(value, 0.0)


@kernel()
def guard_of(tables: Tables, mode: int, element: int) -> int:
    """The first guard of an element in a mode; the first guard of the mode if it has none."""
    for k in range(tables.first[mode], tables.first[mode + 1]):
        if tables.element[k] == element:
            return int(k)
    return int(tables.first[mode])


@kernel()
def lets_go(tables: Tables, g: int) -> int:
    """The guard of a stop that an impact at `g` opens, if the next mode is not built; else -1."""
    while tables.opens[g] >= 0:
        k = tables.opens[g]
        if tables.partner[k] < 0:
            return int(k)
        g = guard_of(tables, tables.target[k], tables.element[g])
    return -1


@kernel()
def together(tables: Tables, g: int, states: Array, band_factor: float, longest: float) -> bool:
    """Whether another stop is also reached, and the impact at guard `g` changes its gap's rate.

    It is reached at the same time, to rounding of the longest flight so far.
    """
    m = tables.ladders.integers[g, GROUP]
    for k in range(tables.first[m], tables.first[m + 1]):
        if k == g or tables.event[k] != IMPACT or not tables.coupled[g, tables.element[k]]:
            continue
        gap = ladder_at(tables.ladders, k)
        value, rate, _ = value_and_rates(gap.rows, gap.offset, states, FOUND)
        if value <= AT_THE_SAME_TIME * EPSILON * longest * abs(rate):
            return True
        if sign_of(gap, states, FOUND, 0, band_factor) <= 0:
            return True
    return False


@kernel()
def first_of(tables: Tables, g: int, states: Array, band_factor: float) -> int:
    """The first of the stops that are hit at the same time, to rounding, as the stop of guard `g`.

    Otherwise, in a symmetric machine, rounding errors would choose the order at every impact.
    """
    for k in range(tables.first[tables.ladders.integers[g, GROUP]], g):
        if tables.event[k] != IMPACT:
            continue
        gap = ladder_at(tables.ladders, k)
        closes = sign_of(gap, states, FOUND, 1, band_factor) < 0
        if closes and sign_of(gap, states, FOUND, 0, AT_THE_SAME_TIME * band_factor) == 0:
            return int(k)
    return g


@kernel()
def met(tables: Tables, k: int, states: Array, at: int, band_factor: float) -> bool:
    """Whether the guard `k` of another element is zero in state `at`, to accumulated rounding."""
    return sign_of(ladder_at(tables.ladders, k), states, at, 0, AT_THE_SAME_TIME * band_factor) == 0


@kernel()
def precedes(tables: Tables, hit: int, slid: int, at: int, states: Array, factor: float) -> bool:
    """Whether the stop of guard `hit` is hit as the slider of guard `slid` reaches its limit.

    The state of the impact is `at`, FOUND or KEPT, and that of the slider the other one. A mass
    that leaves a stop with a slider at its limit meets both again at the same time. Then the impact
    comes first: rounding errors would choose the order at every impact.
    """
    if tables.event[hit] != IMPACT or tables.yields[slid] == 0:
        return False
    other = KEPT if at == FOUND else FOUND
    return met(tables, slid, states, at, factor) and met(tables, hit, states, other, factor)


@kernel()
def limit_sliders(tables: Tables, g: int, left: Array, states: Array, band_factor: float) -> None:
    """Note which sticking sliders are at their limits, to rounding, at the impact at guard `g`."""
    m = tables.ladders.integers[g, GROUP]
    for k in range(tables.first[m], tables.first[m + 1]):
        if tables.yields[k] != 0 and met(tables, int(k), states, FOUND, band_factor):
            left[tables.element[k], AT_LIMIT] = tables.yields[k]


@kernel()
def push(tables: Tables, g: int, left: Array, states: Array) -> bool:
    """Set the rates of zero gaps that the impact at guard `g` changed; return if one closes."""
    closes = False
    m = tables.ladders.integers[g, GROUP]
    for k in range(tables.first[m], tables.first[m + 1]):
        if k == g or tables.event[k] != IMPACT or not tables.coupled[g, tables.element[k]]:
            continue
        own = left[tables.element[k]]
        if own[MOTION] != FLIGHT:
            other = ladder_at(tables.ladders, k)
            rate = value_and_rates(other.rows, other.offset, states, START)[1]
            closes = closes or rate < 0.0
            own[MOTION] = FLIGHT if rate < 0.0 else BOUNCED
            own[ORDER] = 0.0
            own[SPEED] = max(rate, 0.0)
    return closes


@kernel()
def jolt(tables: Tables, g: int, left: Array, states: Array, band_factor: float) -> None:
    """After an impact at guard `g`, let elements switch back that switched at the same time.

    Before, note which sliders are at their limits.

    Their guards are zero to rounding. The impact has changed the rate of such a guard, or the guard
    itself if that is a rate.
    """
    limit_sliders(tables, g, left, states, band_factor)
    m = tables.ladders.integers[g, GROUP]
    for k in range(tables.first[m], tables.first[m + 1]):
        own = left[tables.element[k]]
        begins = k == tables.first[m] or tables.element[k - 1] != tables.element[k]
        if tables.element[k] == tables.element[g] or not begins or own[MOTION] != SWITCHED:
            continue
        if own[ORDER] == 1.0:
            guard = ladder_at(tables.ladders, k)
            own[SPEED] = value_and_rates(guard.rows, guard.offset, states, START)[1]
        if own[ORDER] == 0.0 or own[SPEED] <= 0.0:
            own[MOTION] = FLIGHT
            own[ORDER] = 0.0


@kernel()
def rises(guard: Ladder, order: int, states: Array, band_factor: float) -> int:
    """Order of the first nonzero derivative of a guard that is zero; 0 if it is negative.

    It was `order` before a force changed. A change of a force can only lower it.
    """
    for lower in range(1, order):
        sign = sign_of(guard, states, START, lower, band_factor)
        if sign != 0:
            return lower if sign > 0 else 0
    return order if start_sums(guard.rows, states, START)[order - 2] > 0.0 else 0


@kernel()
def try_again(tables: Tables, g: int, left: Array, states: Array, band_factor: float) -> None:
    """Update elements after another mode, that of guard `g`, has been entered.

    Masses that did not come to rest on their stops may do so in this mode. The guards of elements
    that have just switched get their new orders and rates.
    """
    for element in range(left.shape[0]):
        if left[element, MOTION] == BOUNCES:
            left[element, MOTION] = BOUNCED
    m = tables.ladders.integers[g, GROUP]
    for k in range(tables.first[m], tables.first[m + 1]):
        own = left[tables.element[k]]
        begins = k == tables.first[m] or tables.element[k - 1] != tables.element[k]
        if not begins or tables.event[k] not in (SWITCH, HALT) or own[MOTION] != SWITCHED:
            continue
        guard = ladder_at(tables.ladders, k)
        if own[ORDER] > 1.0:
            own[ORDER] = rises(guard, int(own[ORDER]), states, band_factor)
        if own[ORDER] == 1.0:
            own[SPEED] = value_and_rates(guard.rows, guard.offset, states, START)[1]
            if own[SPEED] <= 0.0:
                own[ORDER] = 0.0
        if own[ORDER] == 0.0:  # in this mode a force has another value
            own[MOTION] = FLIGHT


@kernel()
def come_to_rest(tables: Tables, m: int, left: Array, y: Array, band_factor: float) -> bool:
    """Whether rounding hides the gaps' rates at all touched stops; if so, set them to zero."""
    first, last = tables.first[m], tables.first[m + 1]
    for k in range(first, last):
        guard = ladder_at(tables.ladders, k)
        touched = tables.event[k] == IMPACT and sign_of(guard, y, START, 0, band_factor) <= 0
        if touched and sign_of(guard, y, START, 1, band_factor) != 0:
            return False
    for k in range(first, last):
        guard = ladder_at(tables.ladders, k)
        if tables.event[k] == IMPACT and sign_of(guard, y, START, 0, band_factor) <= 0:
            element = tables.element[k]
            left[element, MOTION] = BOUNCED
            left[element, ORDER] = 0.0
            left[element, SPEED] = 0.0
    return True
