"""Kernels of contact: whether it begins, and what it leaves out of a chatter."""

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
"""Relative velocity below which a chatter is over, whatever is tolerated: cubes of it vanish."""

PLACE = 1000.0
"""So many times the tolerance the place of the contact mass may be off in the bounces that are left
out, where it follows parabolas: nothing else follows from it."""


_SOON = 64.0
"""The smallest step of a gap is at least so many times longer than what is soon."""


class Tables(NamedTuple):
    """Linear modes, their guards, and what happens where a guard is zero.

    A guard is an exponential sum that ends a flight in its mode; those of a mode follow each other.

    Attributes
    ----------
    ladders : the guards; a group of them is a mode
    first : (modes + 1,) the first guard of each mode
    slots, counts : (modes, N) and (modes,) slots of the coordinates of each mode, and their number
    regimes : (modes, elements) their regimes
    slides : (modes, elements) 1 or -1 for sliders that slide forward or backward, `RIDES` for those
        that stick to what does not move over their surfaces
    element : (guards,) what it belongs to
    event : (guards,) what happens, IMPACT, SWITCH or JAM
    target, partner : (guards,) the mode that it leads to, for an impact that of contact, and the
        guard of the same element there; -1 where it has not been entered
    order : (guards,) how many leading Taylor coefficients of the partner vanish after a switch
    torn : (guards,) the same where the guard is negative at once: 1 or 2 of forces, 0 of others; 3
        for 2 of a soft stop, which has no bounces
    change : (k, 2 slots, 2 slots + 1) from the state (and 1) to that in the other mode
    row : (guards,) which of these is that of each guard whose mode has been entered
    kick : (guards, 4, slots) change of the state by a unit jump of the guard's rate, then the low
        parts of the same
    excursion : (guards, 2, slots) change of the state by a brief excursion of the contact
        coordinate, over its time integral
    coupling : (guards,) largest such change of a position or velocity
    restitution : (guards,) coefficient of restitution, where that is a number
    law : (guards,) number of the impact law; -1 where the restitution is a number
    codes, numbers, tails : (laws,), (laws, k) and (laws, 5), see `law_kernels`
    drop, hold : (guards,) by how much the gap's acceleration falls where its rate becomes negative,
        as friction turns, and which acceleration this friction can hold
    opens : (guards,) guard of a closed stop from which an impact pulls away; -1 where there is none
    ambiguous : (guards,) whether an impact pushes against a closed stop
    coupled : (guards, elements) whether an impact changes the rate of their gaps
    rubbed : (guards, elements) whether they are friction that rests where this stop is closed
    marks : (guards,) whether the section is there, where nothing drives the machine or is hit
    scraped : (guards, frictions, 3) of friction at the contact by how much an impact may change its
        slip velocity, over the change of the gap's rate; that velocity without the state; its
        element
    scrape : (guards, frictions, 8, slots) rows, two each, of the slip velocity and of its rate;
        change of the state by a unit jump of it, then the low parts of the same
    tolerance : largest error of the state by which the rest of a chatter is replaced by contact
        (see `PLACE` for the contact coordinate before it)
    period : after which the state is written down where nothing impacts; 0 where stops are hit, or
        nothing drives
    clock_rate : rate of the phase where no slot holds it, and the clock does; 0 elsewhere
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
    """Restitution and acceleration of bounces without friction that last as long, to leading order.

    As parabolas: friction slows what rises by a_up, and what falls is accelerated by a_up - drop.
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

    With contact acceleration a = -f'' the rest lasts T = 2u/(a(1 - r)); a varies by less than a(1 -
    r)/4 over 2T. The bound of f^(4) holds for the time `gap.window`. And whether they may be
    left out. Friction must not hold in the air what it stops.
    """
    least = -second - drop
    if least <= 0.0 or restitution >= 1.0 or error > tolerance:
        return False
    if tolerance == 0.0 and u > SMALLEST:
        return False  # under constant forces the error is zero, too
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
        place += 0.5 * u * u / least  # they are drawn as if friction did not turn
    return most == 0.0 or place <= most


@kernel()
def order_at_rest(gap: Ladder, states: Array, band_factor: float) -> int:
    """Of the gap's second and third derivative the first that rounding does not hide.

    Its order, negative where the gap would close; 0 where both are hidden. The gap and its rate are
    zero.
    """
    signs = sign_of(gap, states, START, 2, band_factor), sign_of(gap, states, START, 3, band_factor)
    if signs[0] * signs[1] < 0:
        # The rounding of positions is in the second derivative, too, also where these cancel.
        second, third, _, reach = start_sums(gap.rows, states, START)
        band = band_factor * EPSILON * (reach + abs(gap.offset))
        soon = (6.0 * band / abs(third)) ** (1.0 / 3.0)  # the third one exceeds the band from here
        least = min(2.0 * band / (soon * soon), band / (gap.smallest * gap.smallest))
        if _SOON * soon < gap.smallest and abs(second) < least:
            return 3 * signs[1]
    return 2 * signs[0] if signs[0] != 0 else 3 * signs[1]


@kernel()
def sign_of(guard: Ladder, states: Array, k: int, order: int, band_factor: float) -> int:
    """The sign of a guard, or of its derivative of order 1 to 3; 0 where rounding hides it."""
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
    """What a unit of velocity adds to the contact acceleration."""
    rows = gap.rows
    c = 0.0
    for i in range(rows.shape[1]):
        c -= rows[4, i] * kick[0, i] + rows[5, i] * kick[1, i]
    return c


@kernel()
def place_error(
    gap: Ladder, kick: Array, u: float, rest: float, second: float, third: float
) -> float:
    """Bound of the gap's error, to leading order, where the bounces are drawn as parabolas.

    In flight D'' = -a - b s - c D'; b/a and c shift the bounces by up to a twelfth and a twentieth
    of themselves times T^2, T their duration, at any restitution. `rest` is 2T.
    """
    c = drag(gap, kick)
    return 0.025 * u * rest * rest * (abs(c + third / second) + abs(c))


@kernel()
def bounce_terms(
    c: float, drop: float, u: float, second: float, third: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Of bounces from relative velocity `u` on their terms to second order; s, a and b.

    The drag is c. In flight the gap obeys D'' = -a - b t - c D' where it rises, and where it falls
    with s^2 a in place of a. A bounce that leaves at u, t after the first one, takes (1 + 1/s)/a u
    + p u^2 + q u t, and arrives at s u (1 + v u + w t).
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
    """Time integral of the gap over the bounces from relative velocity `u` on: parabolas."""
    if u < SMALLEST or second + drop >= 0.0:
        return 0.0
    r, a = falling(restitution, second, drop)
    return (2.0 / 3.0) * u * u * u / (-second * a * (1.0 - r * r * r))


@kernel()
def accumulates(tables: Tables, k: int, gap: Ladder, u: float, states: Array) -> tuple[bool, float]:
    """Whether bounces at guard `k` from velocity `u` on accumulate: `chatter_completes`.

    And the time integral of the gap over them.
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
