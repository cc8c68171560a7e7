"""Kernels of the clock (the scalars of a run's state), and of disturbances for error estimates."""

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
"""Length of the array `clock`. The names above are its indices. At index MARKED is the last time at
which an undriven motion was on its section."""

MOTION, ORDER, SPEED, GAP, AT_LIMIT = range(5)
"""Columns of `left`, one row for each element. MOTION: how the element begins the flight, one of
`FLIGHT` to `STILL`. ORDER: number of leading Taylor coefficients of its first guard that vanish.
SPEED: rate of its gap if ORDER is one. GAP: its gap if that is known to more digits than the state
has, else zero. AT_LIMIT: 1 or -1 if a slider sticks exactly at its forward or backward limit, twice
that while nothing moves it over its surface, else zero."""

BEGIN = 5
"""Number of columns of `left`."""

AT_THE_SAME_TIME = 64.0
"""Events of different elements count as simultaneous if their times differ by less than this many
rounding errors, or if a gap is within this many rounding bands of zero while another one is zero:
the errors of both accumulate."""

FLIGHT, BOUNCED, SWITCHED, BOUNCES, STILL = range(5)
"""Values of MOTION: in flight; just after an impact (u >= 0), after which the mass may come to
rest; just after a switch; just after an impact, and the mass does not come to rest; friction whose
slip an impact has stopped, to rounding."""


@kernel()
def advance_clock(clock: Array, n: int, smallest: float, e: float, rate: float) -> None:
    """Add the wait ``n * smallest + e`` to the time, in double-double, and advance the phase.

    Also updates the longest wait, and the remaining time of the period.
    """
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
        # The angle depends on this wait alone, so that a continued run gives the same bits. It is
        # in double-double: in an angle of many turns a double has fewer digits of the phase.
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
    """`advance_clock`; all elements but `own` are then in flight if the wait exceeds its rounding.

    Low bounces may last less than this rounding, but their gaps are known to more digits than the
    state has. Therefore a stop that was just hit is in flight after any time, and so are all other
    elements if the bounce of `own` is over.
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
    """Scale the sine and cosine of the table in the start state back to the unit circle."""
    if slot < 0:
        return
    s = states[START, 0, slot]
    c = states[START, 1, slot]
    factor = 1.5 - 0.5 * (s * s + c * c)
    states[START, 0, slot] = s * factor
    states[START, 1, slot] = c * factor


@kernel()
def begin_period(slot: int, states: Array, clock: Array, period: float) -> None:
    """Begin a period: set the phase of the start state, which is zero to rounding, to zero."""
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

    This includes the rate of a gap, in a row (BEGIN,) of `left`.
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
    """Change all numbers by noise / 32 * xi of the size that they reach in the flight that begins.

    A velocity v leads to a displacement of |v| t, where t = 1 / max(omega, 2 zeta omega) or the
    longest flight, whichever is shorter. A displacement x leads to a velocity of omega^2 |x| t. If
    these are small again at the end of the flight, they keep the rounding errors of the larger
    values in between. With a noise of 8 * 2^-52 the disturbance is a quarter of the last digit.
    """
    # An error estimate is at least four times the largest distance to three disturbed runs. The
    # largest of three |xi| is 3/4 on average: this gives 3/4 of a last digit, and a rounding error
    # is at most half of one. For none of 8988 impacts in tests/validation does the error exceed its
    # estimate, with or without this disturbance.
    seed = clock[SEED]
    clock[SEED] = float(0x7FFFFFFF) - seed  # another seed: other disturbances do not change
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
    """As `perturb`; also disturbs by the constant terms of the change of basis to this mode."""
    width = states.shape[2]
    for m in range(slots.shape[0]):
        for row in range(2):
            place = abs(to_free[row * width + slots[m], to_free.shape[1] - 1])
            states[START, row, slots[m]] += noise * place * random(clock)
    perturb(slots, table, states, clock, left, noise)


@kernel()
def perturb_cut(excursion: Array, lost: float, states: Array, clock: Array) -> None:
    """Add the effect of omitted bounces to the state, or subtract it, pseudo-randomly.

    `lost` is the time integral of the gap over these bounces.
    """
    change = math.copysign(lost, random(clock))
    for row in range(2):
        for i in range(states.shape[2]):
            states[START, row, i] += change * excursion[row, i]


@kernel()
def _perturb_touch(gap: Ladder, band_factor: float, states: Array, clock: Array) -> float:
    """Shift a touch (a double root) pseudo-randomly in time, and return the gap's new rate.

    The shift is at most the time for which the gap stays in its rounding band. The found state is
    modified in place.
    """
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
    """Disturb a touch and return the gap's rate, or disturb the state after an event (return 0)."""
    if touches:
        return _perturb_touch(gap, band_factor, states, clock)
    perturb(slots, gap.steady, states, clock, left, noise)
    perturb_reached(gap.generator, slots, states, clock, noise)
    return 0.0


disturb_by_address = by_address(disturb, float)
