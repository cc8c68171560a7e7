"""Kernels of the impact oscillator: the loop over flights, impacts, chatter, contact and release.

Modal coordinates all the way: an impact adds a multiple of one vector, and nothing is transformed
to positions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.compiled import kernel
from dynkit.exponential.double_double_kernels import two_product
from dynkit.exponential.evaluation_kernels import (
    EPSILON,
    FOUND,
    KEPT,
    START,
    Ladder,
    Workspace,
    propagate_steps,
    shift,
    shift_linked,
    start_sums,
    value_and_rates,
)
from dynkit.exponential.polynomial_kernels import LIMIT, NEVER, ROOT, TOUCH
from dynkit.exponential.search_kernels import FOREVER, first_root
from dynkit.exponential.tail_kernels import stays_in_band
from dynkit.validation import Array

Indices = NDArray[np.intp]

FLIGHT, BOUNCED, RELEASED = 0, 1, 2
"""Where a run starts or goes on: gap open, on the table (u >= 0), just released by it."""

COUNT_REACHED, NO_FURTHER_CONTACT, CONTACT_FOR_EVER, SEARCH_LIMIT, CONTACTS_FULL = 0, 1, 2, 3, 4
"""Endings of a run."""

FIRST_CELLS = 64
"""Cells after which the search of one of two stops waits for that of the other."""

# Places in the clock, the scalar part of the state of a run.
(
    TIME,
    TIME_LOW,
    SPEED,
    SIDE,
    PHASE_OF_MOTION,
    CHATTER_ERROR,
    IMPACTS,
    CELLS,
    TOUCHES,
    CONTACTS,
    SEED,
    SINE,
    COSINE,
) = range(13)
CLOCK = 13


class Stop(NamedTuple):
    """What the contact coordinate meets on one side.

    Attributes
    ----------
    gap : exponential sum of the gap in free flight
    force : exponential sum of the contact force while stuck
    kick : (4, slots) change of the state by a unit jump of the rate of the gap, then the low parts
        of the same
    to_stuck : (2 * stuck slots, 2 * slots + 1) from the free state (and 1) to the stuck one
    to_free : (2 * slots, 2 * stuck slots + 1) back
    """

    gap: Ladder
    force: Ladder
    kick: Array
    to_stuck: Array
    to_free: Array


class Mechanics(NamedTuple):
    """Everything the loop needs of one impact oscillator.

    Attributes
    ----------
    stops : one or two of them
    modes : (N,) slots of the modes
    restitution : coefficient of restitution
    coupling : largest effect of a unit displacement of the contact mass on another mass
    tolerance : largest error of the state by which the rest of a chatter is replaced by contact
    clock_rate : rate of the phase where no slot holds it, and the clock does; 0 elsewhere
    """

    stops: tuple[Stop, ...]
    modes: Indices
    restitution: float
    coupling: float
    tolerance: float
    clock_rate: float


@kernel()
def _advance_clock(clock: Array, n: int, smallest: float, e: float, rate: float) -> None:
    """Add ``n * smallest + e`` to the time, in double-double; turn the phase."""
    # The smallest step is a power of two: the first product is exact.
    for part in (n * smallest, e):
        total = clock[TIME] + part
        back = total - clock[TIME]
        clock[TIME_LOW] += (clock[TIME] - (total - back)) + (part - back)
        clock[TIME] = total
    total = clock[TIME] + clock[TIME_LOW]
    clock[TIME_LOW] -= total - clock[TIME]
    clock[TIME] = total
    if rate > 0.0:
        # Of the wait alone: a run that goes on from another one gives the same bits.
        angle = rate * (n * smallest + e)
        s = clock[SINE] * math.cos(angle) + clock[COSINE] * math.sin(angle)
        c = clock[COSINE] * math.cos(angle) - clock[SINE] * math.sin(angle)
        factor = 1.5 - 0.5 * (s * s + c * c)
        clock[SINE] = s * factor
        clock[COSINE] = c * factor


@kernel()
def _normalise(states: Array, slot: int) -> None:
    """Sine and cosine of the table in the start state back to the unit circle."""
    if slot < 0:
        return
    s = states[START, 0, slot]
    c = states[START, 1, slot]
    factor = 1.5 - 0.5 * (s * s + c * c)
    states[START, 0, slot] = s * factor
    states[START, 1, slot] = c * factor


@kernel(reorder=True)
def transform(matrix: Array, states: Array, k: int, out: Array) -> None:
    """Affine change of basis from state `k` to the start of `out`, which is modified in place."""
    m = states.shape[2]
    n = out.shape[2]
    for i in range(2 * n):
        total = matrix[i, 2 * m]
        for j in range(m):
            total += matrix[i, j] * states[k, 0, j] + matrix[i, m + j] * states[k, 1, j]
        out[START, i // n, i % n] = total


@kernel()
def _chatter_completes(
    mechanics: Mechanics,
    window: float,
    u: float,
    second: float,
    third: float,
    fourth: float,
    error: float,
) -> bool:
    """Whether the bounces from relative velocity `u` on must accumulate before contact can be lost.

    With contact acceleration a = -f'' the rest lasts T = 2u/(a(1 - r)); a varies by less than a(1 -
    r)/4 over 2T. The bound of f^(4) holds for the time `window`.
    """
    r = mechanics.restitution
    a = -second
    if a <= 0.0 or r >= 1.0 or error > mechanics.tolerance:
        return False
    rest = 4.0 * u / (a * (1.0 - r))
    return rest <= window and (abs(third) + 0.5 * fourth * rest) * rest <= 0.25 * (1.0 - r) * a


@kernel()
def _order_at_rest(rows: Array, states: Array, band_factor: float) -> int:
    """Of the gap's second and third derivative the first that rounding does not hide.

    Its order, negative where the gap would close; 0 where both are hidden. The gap and its rate are
    zero.
    """
    for order in range(2, 4):
        total = 0.0
        size = 0.0
        for i in range(rows.shape[1]):
            a = rows[2 * order, i] * states[START, 0, i]
            b = rows[2 * order + 1, i] * states[START, 1, i]
            total += a + b
            size += abs(a) + abs(b)
        if abs(total) > band_factor * EPSILON * size:
            return order if total > 0.0 else -order
    return 0


@kernel()
def _pulls(force: Ladder, states: Array, band_factor: float) -> bool:
    """Whether the table would have to pull the contact mass to hold it, beyond rounding."""
    reach = start_sums(force.rows, states, START)[3]
    value = value_and_rates(force.rows, force.offset, states, START)[0]
    return value < -band_factor * EPSILON * (reach + abs(force.offset))


@kernel()
def _chatter_rest(stop: Stop, restitution: float, u: float, second: float, third: float) -> float:
    """Time until the bounces from relative velocity `u` on accumulate, to second order in `u`.

    In flight the gap obeys D'' = -a - b s - c D' + ...; c is what a unit of velocity adds.
    """
    gap = stop.gap
    kick = stop.kick
    c = 0.0
    for i in range(gap.rows.shape[1]):
        c -= gap.rows[4, i] * kick[0, i] + gap.rows[5, i] * kick[1, i]
    a = -second - c * u
    first = 2.0 * u / (a * (1.0 - restitution))
    return first * (1.0 - (1.5 * c * a - third) * first / (3.0 * a))


@kernel()
def chatter_error(mechanics: Mechanics, u: float, second: float) -> float:
    """Impulse on the neighbours that is dropped with the rest of a chatter."""
    r = mechanics.restitution
    if u == 0.0:
        return 0.0
    return mechanics.coupling * (2.0 / 3.0) * u * u * u / (second * second * (1.0 - r * r * r))


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
def _random(clock: Array) -> float:
    """Pseudo-random number in [-1, 1]."""
    seed = np.uint64(clock[SEED])
    seed = (seed * np.uint64(1103515245) + np.uint64(12345)) & np.uint64(0x7FFFFFFF)
    clock[SEED] = float(seed)
    return float(seed) / 1073741824.0 - 1.0


@kernel()
def _perturb(
    slots: Indices, table: int, states: Array, clock: Array, noise: float, extra: float
) -> None:
    """Add (noise * number + extra) * xi to the modes, xi pseudo-random in [-1, 1]; noise to all."""
    for m in range(slots.shape[0]):
        for row in range(2):
            number = states[START, row, slots[m]]
            states[START, row, slots[m]] += (noise * number + extra) * _random(clock)
    if table >= 0:
        for row in range(2):
            states[START, row, table] *= 1.0 + noise * _random(clock)
    clock[SPEED] *= 1.0 + noise * _random(clock)


@kernel()
def _copy(states: Array, k: int, to: int) -> None:
    """State `k` into state `to`."""
    for row in range(2):
        for i in range(states.shape[2]):
            states[to, row, i] = states[k, row, i]


@kernel()
def run(
    mechanics: Mechanics,
    clock: Array,
    count: int,
    noise: float,
    band_factor: float,
    limit: int,
    states: Array,
    contacts: Array,
    flight: Workspace,
    contact: Workspace,
) -> tuple[int, int]:
    """Simulate `count` impacts from (``flight.states[START]``, `clock`), modified in place.

    Parameters
    ----------
    states
        (count or 0, 2 * modes + 4), modified in place: the pairs of the modes, sine and cosine of
        the phase, relative velocity (negative at the second stop), time, after each impact. With no
        rows nothing is stored.
    contacts
        (k, 3), modified in place: impacts before the contact, its start and its end.
    noise
        Relative size of a pseudo-random perturbation after each impact, for error estimates; 0 for
        none.
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
    first_budget = min(limit, FIRST_CELLS) if len(mechanics.stops) == 2 else limit
    budget = first_budget
    done = 0
    while done < count:
        side = int(clock[SIDE])
        phase = clock[PHASE_OF_MOTION]
        u = clock[SPEED]
        order = 0
        if phase == RELEASED:
            order = 3
        elif phase != FLIGHT:
            gap = mechanics.stops[side].gap
            second, third, fourth, _ = start_sums(gap.rows, y, START)
            error = chatter_error(mechanics, u, second)
            if u > 0.0:
                order = 1
                sticks = _chatter_completes(mechanics, gap.window, u, second, third, fourth, error)
            else:
                order = _order_at_rest(gap.rows, y, band_factor)
                if order > 0 and stays_in_band(gap, y, START, mechanics.tolerance):
                    # It would never leave the table by more: all that moves is rounding.
                    order = 0
                sticks = order <= 0
            if sticks:
                k = int(clock[CONTACTS])
                if k == contacts.shape[0]:
                    return done, CONTACTS_FULL
                stop = mechanics.stops[side]
                transform(stop.to_stuck, y, START, contact.states)
                if _pulls(stop.force, contact.states, band_factor):
                    # What rounding hid in flight is clear on the table: it does not hold the mass.
                    if u == 0.0:
                        transform(stop.to_free, contact.states, START, y)
                        _normalise(y, table)
                        order = _order_at_rest(gap.rows, y, band_factor)
                    sticks = order <= 0
            if sticks:
                contacts[k, 0] = clock[IMPACTS]
                contacts[k, 1] = clock[TIME]
                contacts[k, 2] = math.inf
                if u > 0.0:
                    contacts[k, 1] += _chatter_rest(stop, mechanics.restitution, u, second, third)
                    clock[CHATTER_ERROR] += error
                    if noise > 0.0:
                        _perturb(slots, table, y, clock, 0.0, error)
                        transform(stop.to_stuck, y, START, contact.states)
                outcome, n, e, _, cells = first_root(
                    stop.force, zero, 0.0, band_factor, count < 0, limit, for_ever, contact
                )
                clock[CELLS] += cells
                clock[CONTACTS] += 1.0
                if outcome == NEVER:
                    return done, CONTACT_FOR_EVER
                if outcome == LIMIT:
                    return done, SEARCH_LIMIT
                transform(stop.to_free, contact.states, FOUND, y)
                _normalise(y, table)
                _advance_clock(clock, n, stop.force.smallest, e, mechanics.clock_rate)
                contacts[k, 2] = clock[TIME]
                clock[SPEED] = 0.0
                clock[PHASE_OF_MOTION] = RELEASED
                order = 3
        gap = mechanics.stops[side].gap
        outcome, n, e, rate, cells = first_root(
            gap, order, u, band_factor, count > 0, budget, for_ever, flight
        )
        clock[CELLS] += cells
        if len(mechanics.stops) == 2:
            # Whether the other stop is reached before.
            _copy(y, FOUND, KEPT)
            found, m, d, slope, cells = first_root(
                mechanics.stops[1 - side].gap,
                zero,
                0.0,
                band_factor,
                count > 0,
                budget,
                for_ever if outcome == NEVER else n,
                flight,
            )
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
                continue
            budget = first_budget
        if outcome == NEVER:
            return done, NO_FURTHER_CONTACT
        if outcome == LIMIT:
            return done, SEARCH_LIMIT
        if outcome == TOUCH:
            clock[TOUCHES] += 1.0
        rate = min(rate, 0.0)
        _add_jump(mechanics.stops[side].kick, -(1.0 + mechanics.restitution) * rate, y)
        _normalise(y, table)
        clock[SIDE] = side
        clock[SPEED] = 0.0 - mechanics.restitution * rate
        clock[PHASE_OF_MOTION] = BOUNCED
        _advance_clock(clock, n, smallest, e, mechanics.clock_rate)
        if noise > 0.0:
            _perturb(slots, table, y, clock, noise, 0.0)
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


@kernel()
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
