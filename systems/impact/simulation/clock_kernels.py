"""Kernels of the clock of a run, the scalar part of its state, and of disturbances for errors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import by_address, kernel
from dynkit.core.validation import Array
from dynkit.exponential.double_double_kernels import two_product
from dynkit.exponential.evaluation_kernels import (
    EPSILON,
    FOUND,
    START,
    Ladder,
    shift,
    start_sums,
)

Indices = NDArray[np.intp]

(
    TIME,
    TIME_LOW,
    GUARD,
    LEFT_FROM,
    WANTED,
    CHATTER_ERROR,
    IMPACTS,
    SWITCHES,
    CELLS,
    TOUCHES,
    BUDGET,
    SEED,
    SINE,
    COSINE,
    LONGEST,
    AMBIGUOUS,
    AT_ONCE,
    REMAINING,
    MARKED,
) = range(19)
CLOCK = 19
"""Numbers of a clock; above, the places of them. At the time MARKED an undriven motion was on its
section."""

MOTION, ORDER, SPEED, GAP, AT_LIMIT = range(5)
"""Of each element, how it begins the flight: see `FLIGHT`; how many leading Taylor coefficients of
its first guard vanish; the rate of its gap where that is one; its gap, where that is known to more
digits than the state has, else zero; and where a slider sticks exactly at its limit 1 or -1, for
the forward and the backward one, or twice that while nothing moves it. Zero elsewhere."""

BEGIN = 5
"""Numbers of each element; above, the places of them."""

AT_THE_SAME_TIME = 64.0
"""So many times their rounding events of different elements may be apart, and a gap may be off zero
where another one is zero: errors of both accumulate."""

FLIGHT, BOUNCED, SWITCHED, BOUNCES, STILL = range(5)
"""Gap open; just after an impact (u >= 0), which may come to rest; just after a switch; just after
an impact, and it does not come to rest. Of friction: an impact has stopped it, but for rounding."""


@kernel()
def advance_clock(clock: Array, n: int, smallest: float, e: float, rate: float) -> None:
    """Add ``n * smallest + e`` to the time, in double-double; turn the phase; note the longest."""
    clock[LONGEST] = max(clock[LONGEST], n * smallest + e)
    clock[REMAINING] = max(clock[REMAINING] - (n * smallest + e), 0.0)
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
        # Of the wait alone: a run that goes on from another one gives the same bits. In
        # double-double: many turns would cost as many digits.
        wait = n * smallest + e
        angle, low = two_product(rate, wait)
        low += rate * ((n * smallest - wait) + e)
        sine = math.sin(angle) * math.cos(low) + math.cos(angle) * math.sin(low)
        cosine = math.cos(angle) * math.cos(low) - math.sin(angle) * math.sin(low)
        s = clock[SINE] * cosine + clock[COSINE] * sine
        c = clock[COSINE] * cosine - clock[SINE] * sine
        factor = 1.5 - 0.5 * (s * s + c * c)
        clock[SINE] = s * factor
        clock[COSINE] = c * factor


@kernel()
def move_on(
    clock: Array, left: Array, own: int, n: int, smallest: float, e: float, rate: float
) -> None:
    """`advance_clock`; where more time than its rounding has passed, all but one are in flight.

    Low bounces last less, but their gaps are known to more digits than the state has: a stop that
    has bounced is in flight after any time, and all others where its own bounce is over.
    """
    time, low = clock[TIME], clock[TIME_LOW]
    later = n * smallest + e > AT_THE_SAME_TIME * EPSILON * time
    if own >= 0:
        later = later or left[own, ORDER] == 1.0 or left[own, GAP] > 0.0
        left[own, GAP] = 0.0
    advance_clock(clock, n, smallest, e, rate)
    if clock[TIME] != time or clock[TIME_LOW] != low:
        for element in range(left.shape[0]):
            known = left[element, GAP] > 0.0 and left[element, ORDER] <= 1.0
            if element != own and (later or known):
                left[element, MOTION] = FLIGHT
                left[element, ORDER] = 0.0
            if later and abs(left[element, AT_LIMIT]) == 1.0:
                left[element, AT_LIMIT] = 0.0


@kernel()
def normalise(states: Array, slot: int) -> None:
    """Sine and cosine of the table in the start state back to the unit circle."""
    if slot < 0:
        return
    s = states[START, 0, slot]
    c = states[START, 1, slot]
    factor = 1.5 - 0.5 * (s * s + c * c)
    states[START, 0, slot] = s * factor
    states[START, 1, slot] = c * factor


@kernel()
def begin_period(slot: int, states: Array, clock: Array, period: float) -> None:
    """The phase of the start state is zero, but for rounding: now it is."""
    clock[REMAINING] = period
    clock[SINE], clock[COSINE] = 0.0, 1.0
    if slot >= 0:
        states[START, 0, slot], states[START, 1, slot] = 0.0, 1.0


@kernel()
def random(clock: Array) -> float:
    """Pseudo-random number in [-1, 1]."""
    seed = np.uint64(clock[SEED])
    seed = (seed * np.uint64(1103515245) + np.uint64(12345)) & np.uint64(0x7FFFFFFF)
    clock[SEED] = float(seed)
    return float(seed) / 1073741824.0 - 1.0


@kernel()
def perturb(
    slots: Indices, table: int, states: Array, clock: Array, left: Array, noise: float
) -> None:
    """Change all numbers by noise * xi of themselves, xi pseudo-random in [-1, 1].

    Among them the rate of a gap, which is in a row (4,) of `left`.
    """
    for m in range(slots.shape[0]):
        for row in range(2):
            states[START, row, slots[m]] += noise * states[START, row, slots[m]] * random(clock)
    if table >= 0:
        for row in range(2):
            states[START, row, table] *= 1.0 + noise * random(clock)
    left[SPEED] *= 1.0 + noise * random(clock)


@kernel(entry=True)
def perturb_reached(
    generator: Array, slots: Indices, states: Array, clock: Array, noise: float
) -> None:
    """Change all numbers by noise / 32 * xi of what they become in the flight that begins.

    A velocity v makes a displacement of |v| t, t = 1 / max(omega, 2 zeta omega) or the longest
    flight, whichever is shorter; a displacement x makes a velocity of omega^2 |x| t. Where these
    are small again at the end of the flight, they keep the rounding of a step between: with a noise
    of 8 * 2^-52 a quarter of a last digit.
    """
    # An estimate is at least four times the largest distance of three twins. The largest of three
    # xi is 3/4 on average: that makes 3/4 of a last digit; a rounding is half of one at most. Of
    # 8988 impacts of tests/validation no error exceeds its estimate, with this disturbance or not.
    seed = clock[SEED]
    clock[SEED] = float(0x7FFFFFFF) - seed  # draws of its own: those of other disturbances stay
    for m in range(slots.shape[0]):
        slot = slots[m]
        a = abs(states[START, 0, slot])
        b = abs(states[START, 1, slot])
        rate = max(math.sqrt(abs(generator[5, slot])), abs(generator[4, slot]))
        part = noise / 32.0 * clock[LONGEST]
        if rate * clock[LONGEST] > 1.0:
            part = noise / 32.0 / rate
        states[START, 0, slot] += part * abs(generator[1, slot]) * b * random(clock)
        states[START, 1, slot] += part * abs(generator[2, slot]) * a * random(clock)
    clock[SEED] = seed


@kernel()
def perturb_released(
    to_free: Array,
    slots: Indices,
    table: int,
    states: Array,
    clock: Array,
    left: Array,
    noise: float,
) -> None:
    """As `perturb` with noise, with the terms that the change of basis summed up."""
    width = states.shape[2]
    for m in range(slots.shape[0]):
        for row in range(2):
            place = abs(to_free[row * width + slots[m], to_free.shape[1] - 1])
            states[START, row, slots[m]] += noise * place * random(clock)
    perturb(slots, table, states, clock, left, noise)


@kernel()
def perturb_cut(excursion: Array, lost: float, states: Array, clock: Array) -> None:
    """Add what a cut chatter drops, or take it away: which is pseudo-random, the size is not."""
    change = math.copysign(lost, random(clock))
    for row in range(2):
        for i in range(states.shape[2]):
            states[START, row, i] += change * excursion[row, i]


@kernel()
def _perturb_touch(gap: Ladder, band_factor: float, states: Array, clock: Array) -> float:
    """Move a touch, in the found state, by what the rounding band leaves open; the new rate."""
    second, third, _, reach = start_sums(gap.rows, states, FOUND)
    band = band_factor * EPSILON * (reach + abs(gap.offset))
    longest = gap.smallest
    if second * longest * longest > 2.0 * band:
        longest = math.sqrt(2.0 * band / second)
    if abs(third) * longest * longest * longest > 6.0 * band:
        longest = (6.0 * band / abs(third)) ** (1.0 / 3.0)
    slots = states.shape[2]
    shift(gap.generator, longest * random(clock), states, FOUND, START, 0, slots)
    for row in range(2):
        for i in range(slots):
            states[FOUND, row, i] = states[START, row, i]
    return -abs(second * longest * random(clock))


@kernel(entry=True)
def disturb(
    gap: Ladder,
    slots: Indices,
    touches: bool,
    states: Array,
    clock: Array,
    left: Array,
    noise: float,
    band_factor: float,
) -> float:
    """Disturb a touch, and return the rate there, or the state just after an event."""
    if touches:
        return _perturb_touch(gap, band_factor, states, clock)
    perturb(slots, gap.steady, states, clock, left, noise)
    perturb_reached(gap.generator, slots, states, clock, noise)
    return 0.0


disturb_by_address = by_address(disturb, float)
