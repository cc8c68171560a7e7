"""Kernels of contact: whether it begins, and the duration and error of the omitted bounces."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import EPSILON, START, Ladder, start_sums
from dynkit.exponential.stack_kernels import Ladders

Indices = NDArray[np.intp]

SMALLEST = 1e-100
"""Relative velocity below which a chatter is over, for any tolerance: its cube is negligible."""

PLACE = 1000.0
"""Largest error of the contact mass's position in omitted bounces, in units of the tolerance. These
positions, which follow parabolas, are only sampled: no other result depends on them."""


_SOON = 64.0
"""The smallest step of a gap must be this many times longer than `soon` in `order_at_rest`."""


class Tables(NamedTuple):
    """Linear modes, their guards, and the events at the zeros of guards.

    A guard is an exponential sum that ends a flight in its mode. The guards of a mode are adjacent.

    Attributes
    ----------
    ladders : the guards; those of one mode are a group
    first : (modes + 1,) the first guard of each mode
    slots, counts : (modes, N) and (modes,) slots of the coordinates of each mode, and their number
    regimes : (modes, elements) regimes of the elements in each mode
    slides : (modes, elements) 1 or -1 for a slider that slides forward or backward; `RIDES` for one
        that sticks while the coordinate that it follows does not move over its surface
    element : (guards,) element of each guard
    event : (guards,) kind of the event at the zero of the guard, from IMPACT to REST
    target, partner : (guards,) the mode that follows (for an impact, that of contact), and the
        first guard of the same element there; -1 if that mode has not been entered
    order : (guards,) number of leading Taylor coefficients of the partner that vanish after a
        switch
    torn : (guards,) the same number if the guard is negative just after an event: 1 or 2 for a
        force, 0 for another guard; 3 stands for 2 of a soft stop, which has no bounces
    change : (k, 2 slots, 2 slots + 1) affine changes of basis, from the state and 1 to the state in
        the other mode
    row : (guards,) index into `change` for each guard whose next mode has been entered
    kick : (guards, 4, slots) change of the state by a unit jump of the guard's rate, then its low
        parts
    excursion : (guards, 2, slots) change of the state by a brief excursion of the contact
        coordinate, divided by the time integral of the excursion
    coupling : (guards,) largest such change of a position or velocity
    restitution : (guards,) coefficient of restitution, if it is a number
    law : (guards,) number of the impact law; -1 if the restitution is a number
    codes, numbers, tails : (laws,), (laws, k) and (laws, 5), see `law_kernels`
    drop, hold : (guards,) decrease of the gap's acceleration when friction along its row reverses
        at the top of a bounce, and the largest acceleration that this friction can hold
    opens : (guards,) guard of a closed stop that an impact opens, or of a sticking element that it
        moves; -1 if there is none
    ambiguous : (guards,) whether an impact pushes against a closed stop, or friction leaves its
        outcome open
    coupled : (guards, elements) whether an impact changes the rate of the element's gap
    rubbed : (guards, elements) whether the element is friction that rests while this stop is closed
    marks : (guards,) whether the zero of the guard is the section of an undriven machine
    yields : (guards,) 1 or -1 where a slider begins to slide forward or backward, else 0
    scraped : (guards, frictions, 3) for friction at the contact: the largest change of its slip
        velocity by an impact, divided by the change of the gap's rate; the constant term of the
        slip velocity; the number of its element
    scrape : (guards, frictions, 8, slots) two rows each of the slip velocity and of its rate; the
        change of the state by a unit jump of the slip velocity; the low parts of this change
    tolerance : largest error of the state when contact replaces the rest of a chatter (see `PLACE`
        for the contact coordinate in the replaced bounces)
    period : period of the stroboscopic section; 0 if stops are hit, or if nothing drives the
        machine
    clock_rate : rate of the phase if the clock holds it; 0 if a slot of the states holds it
    """

    ladders: Ladders
    first: Indices
    slots: Indices
    counts: Indices
    regimes: Indices
    slides: Indices
    element: Indices
    event: Indices
    target: Indices
    partner: Indices
    order: Indices
    torn: Indices
    change: Array
    row: Indices
    kick: Array
    excursion: Array
    coupling: Array
    restitution: Array
    law: Indices
    codes: Indices
    numbers: Array
    tails: Array
    drop: Array
    hold: Array
    opens: Indices
    ambiguous: NDArray[np.bool_]
    coupled: NDArray[np.bool_]
    rubbed: NDArray[np.bool_]
    marks: NDArray[np.bool_]
    yields: Indices
    scraped: Array
    scrape: Array
    tolerance: float
    period: float
    clock_rate: float


@kernel(reorder=True)
def transform(matrix: Array, states: Array, k: int, to: int) -> None:
    """Affine change of basis of state `k`, into state `to`."""
    n = states.shape[2]
    for i in range(2 * n):
        total = matrix[i, 2 * n]
        for j in range(n):
            total += matrix[i, j] * states[k, 0, j] + matrix[i, n + j] * states[k, 1, j]
        states[to, i // n, i % n] = total


@kernel(entry=True)
def falling(restitution: float, second: float, drop: float) -> tuple[float, float]:
    """Restitution and acceleration of frictionless bounces of the same duration, to leading order.

    Flights are parabolas. With a_up = -`second`, the contact mass is decelerated by a_up on its way
    up, and accelerated by a_up - `drop` on its way down, since friction reverses.
    """
    if drop == 0.0:
        return restitution, -second
    s = math.sqrt(max(1.0 + drop / second, 0.0))
    return restitution * s, -second * (2.0 * s / (1.0 + s))


@kernel()
def chatter_completes(
    gap: Ladder,
    kick: Array,
    restitution: float,
    drop: float,
    hold: float,
    tolerance: float,
    u: float,
    second: float,
    third: float,
    fourth: float,
    error: float,
) -> bool:
    """Whether the bounces from relative velocity `u` on must accumulate before contact can be lost.

    They must also be negligible: their effect `error` on the state is at most the tolerance.

    With the contact acceleration a = -f'' the bounces last T = 2u/(a(1 - r)); a must vary by less
    than a(1 - r)/4 over 2T. The bound of f^(4) holds for the time `gap.window`. Friction that stops
    the contact mass at the top of a bounce must not hold it there.
    """
    least = -second - drop
    if least <= 0.0 or restitution >= 1.0 or error > tolerance:
        return False
    if tolerance == 0.0 and u > SMALLEST:
        return False  # no bounces are omitted, even if constant forces make their error zero
    r, a = falling(restitution, second, drop)
    rest = 4.0 * u / (a * (1.0 - r))
    if rest > gap.window:
        return False
    change = (abs(third) + 0.5 * fourth * rest) * rest
    if drop > 0.0 or hold > 0.0:
        change += abs(drag(gap, kick)) * drop * rest
        if change > least + 0.5 * drop - hold:
            return False
    if change > 0.25 * (1.0 - r) * least:
        return False
    most = PLACE * tolerance
    place = place_error(gap, kick, u, rest, second, third)
    if drop > 0.0:
        place += 0.5 * u * u / least  # sampled bounces ignore the reversal of friction
    return most == 0.0 or place <= most


@kernel()
def order_at_rest(gap: Ladder, states: Array, band_factor: float) -> int:
    """Order, 2 or 3, of the first derivative of the gap that rounding does not hide.

    The gap and its rate are zero. The order is negative if the gap would close, and 0 if rounding
    hides both derivatives.
    """
    signs = sign_of(gap, states, START, 2, band_factor), sign_of(gap, states, START, 3, band_factor)
    if signs[0] * signs[1] < 0:
        # Rounding errors of positions are in the second derivative, too, even if the terms of the
        # positions cancel there.
        second, third, _, reach = start_sums(gap.rows, states, START)
        band = band_factor * EPSILON * (reach + abs(gap.offset))
        soon = (6.0 * band / abs(third)) ** (1.0 / 3.0)  # then the cubic term exceeds the band
        least = min(2.0 * band / (soon * soon), band / (gap.smallest * gap.smallest))
        if _SOON * soon < gap.smallest and abs(second) < least:
            return 3 * signs[1]
    return 2 * signs[0] if signs[0] != 0 else 3 * signs[1]


@kernel()
def sign_of(guard: Ladder, states: Array, k: int, order: int, band_factor: float) -> int:
    """The sign of a guard, or of its derivative of order 1 to 3; 0 if rounding hides it."""
    total = guard.offset if order == 0 else 0.0
    size = abs(total)
    for i in range(guard.rows.shape[1]):
        a = guard.rows[2 * order, i] * states[k, 0, i]
        b = guard.rows[2 * order + 1, i] * states[k, 1, i]
        total += a + b
        size += abs(a) + abs(b)
    if abs(total) <= band_factor * EPSILON * size:
        return 0
    return 1 if total > 0.0 else -1


@kernel()
def drag(gap: Ladder, kick: Array) -> float:
    """Change of the contact acceleration -f'' by a unit jump of the gap's rate."""
    rows = gap.rows
    c = 0.0
    for i in range(rows.shape[1]):
        c -= rows[4, i] * kick[0, i] + rows[5, i] * kick[1, i]
    return c


@kernel()
def place_error(
    gap: Ladder, kick: Array, u: float, rest: float, second: float, third: float
) -> float:
    """Bound of the gap's error, to leading order, if the bounces are sampled as parabolas.

    In flight the gap obeys D'' = -a - b s - c D'. The terms with b and c shift the bounces by up to
    (b/a) u T^2/12 and c u T^2/20 at any restitution, where T is their duration. `rest` is 2T.
    """
    c = drag(gap, kick)
    return 0.025 * u * rest * rest * (abs(c + third / second) + abs(c))


@kernel()
def bounce_terms(
    c: float, drop: float, u: float, second: float, third: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Second-order coefficients of bounces from velocity `u` on: once, p, q, v, w; then s, a, b.

    The drag is c. In flight the gap obeys D'' = -a - b t - c D' while it rises, and the same with
    s^2 a in place of a while it falls. A bounce that leaves with velocity u at time t after the
    first one lasts once u + p u^2 + q u t, once = (1 + 1/s)/a, and arrives with s u (1 + v u + w
    t).
    """
    a = -second - c * u
    b = c * a - third
    s = math.sqrt(1.0 - drop / a)
    once = (1.0 + 1.0 / s) / a
    c, b = c / a, b / (a * a)
    p = (c * (1.0 / (6.0 * s * s) - 0.5 - 1.0 / (3.0 * s))) / a
    p -= b * (1.0 / (6.0 * s**4) + 0.5 + 0.5 / s**3 + 1.0 / (6.0 * s)) / a
    q = -b * (1.0 + 0.5 / s**3 + 0.5 / s)
    v = (b * (1.0 / (3.0 * s * s) + 0.5 / s - s / 6.0) - c * (1.0 + s) / 3.0) / s
    w = 0.5 * a * b * (1.0 / s - s) / s
    return once, p, q, v, w, s, a, b * a * a


@kernel(entry=True)
def chatter_rest(
    c: float, restitution: float, drop: float, u: float, second: float, third: float
) -> float:
    """Time until bounces from velocity `u` on accumulate, to second order in `u`; the drag is c."""
    once, p, q, v, w, s, _, _ = bounce_terms(c, drop, u, second, third)
    r = restitution * s
    more = p + r / (1.0 - r) * once * (v + q) + w * (once * r / (1.0 - r)) ** 2
    return once * u / (1.0 - r) + u * u * more / (1.0 - r * r)


@kernel()
def lifted(restitution: float, drop: float, u: float, second: float) -> float:
    """Time integral of the gap over the bounces from relative velocity `u` on, as parabolas."""
    if u < SMALLEST or second + drop >= 0.0:
        return 0.0
    r, a = falling(restitution, second, drop)
    return (2.0 / 3.0) * u * u * u / (-second * a * (1.0 - r * r * r))


@kernel()
def accumulates(tables: Tables, k: int, gap: Ladder, u: float, states: Array) -> tuple[bool, float]:
    """Whether bounces at guard `k` from velocity `u` on accumulate; see `chatter_completes`.

    Then the time integral of the gap over them.
    """
    second, third, fourth, _ = start_sums(gap.rows, states, START)
    r, drop = tables.restitution[k], tables.drop[k]
    lost = lifted(r, drop, u, second)
    error = tables.coupling[k] * lost
    sticks = chatter_completes(
        gap, tables.kick[k], r, drop, tables.hold[k], tables.tolerance, u, second, third, fourth,
        error,
    )  # fmt: skip
    return sticks, lost
