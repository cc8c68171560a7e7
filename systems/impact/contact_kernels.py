"""Kernels of contact: whether it begins, and what it leaves out of a chatter."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import (
    EPSILON,
    START,
    Ladder,
    start_sums,
    value_and_rates,
)
from dynkit.exponential.stack_kernels import Ladders

Indices = NDArray[np.intp]

SMALLEST = 1e-100
"""Relative velocity below which a chatter is over, whatever is tolerated: cubes of it vanish."""

PLACE = 1000.0
"""So many times the tolerance the place of the contact mass may be off in the bounces that are left
out, where it follows parabolas: nothing else follows from it."""


class Tables(NamedTuple):
    """Linear modes, their guards, and what happens where a guard is zero.

    A guard is an exponential sum that ends a flight in its mode; those of a mode follow each other.

    Attributes
    ----------
    ladders : the guards; a group of them is a mode
    first : (modes + 1,) the first guard of each mode
    slots, counts : (modes, N) and (modes,) slots of the coordinates of each mode, and their number
    element : (guards,) what it belongs to
    event : (guards,) what happens, IMPACT, SWITCH or JAM
    target, partner : (guards,) the mode that it leads to, for an impact that of contact, and the
        guard of the same element there; -1 where it has not been entered
    order : (guards,) how many leading Taylor coefficients of the partner vanish after a switch
    torn : (guards,) the same where the guard is negative at once: 1 or 2 of forces, 0 of others
    change : (guards, 2 slots, 2 slots + 1) from the state (and 1) to that in the other mode; no
        rows while there is one mode only
    kick : (guards, 4, slots) change of the state by a unit jump of the guard's rate, then the low
        parts of the same
    excursion : (guards, 2, slots) change of the state by a brief excursion of the contact
        coordinate, over its time integral
    coupling : (guards,) largest such change of a position or velocity
    restitution : (guards,) coefficient of restitution
    opens : (guards,) guard of a closed stop from which an impact pulls away; -1 where there is none
    ambiguous : (guards,) whether an impact pushes against a closed stop
    coupled : (guards, elements) whether an impact changes the rate of their gaps
    tolerance : largest error of the state by which the rest of a chatter is replaced by contact
        (see `PLACE` for the contact coordinate before it)
    period : after which the state is written down where nothing impacts; 0 where stops are hit
    clock_rate : rate of the phase where no slot holds it, and the clock does; 0 elsewhere
    """

    ladders: Ladders
    first: Indices
    slots: Indices
    counts: Indices
    element: Indices
    event: Indices
    target: Indices
    partner: Indices
    order: Indices
    torn: Indices
    change: Array
    kick: Array
    excursion: Array
    coupling: Array
    restitution: Array
    opens: Indices
    ambiguous: NDArray[np.bool_]
    coupled: NDArray[np.bool_]
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


@kernel()
def chatter_completes(
    gap: Ladder,
    kick: Array,
    restitution: float,
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
    left out.
    """
    r = restitution
    a = -second
    if a <= 0.0 or r >= 1.0 or error > tolerance:
        return False
    if tolerance == 0.0 and u > SMALLEST:
        return False  # under constant forces the error is zero, too
    rest = 4.0 * u / (a * (1.0 - r))
    if rest > gap.window:
        return False
    if (abs(third) + 0.5 * fourth * rest) * rest > 0.25 * (1.0 - r) * a:
        return False
    most = PLACE * tolerance
    return most == 0.0 or _place_error(gap, kick, u, rest, second, third) <= most


@kernel()
def order_at_rest(rows: Array, states: Array, band_factor: float) -> int:
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
def is_negative(guard: Ladder, states: Array, k: int, band_factor: float) -> bool:
    """Whether a guard is negative, beyond rounding: a contact force would have to pull."""
    reach = start_sums(guard.rows, states, k)[3]
    value = value_and_rates(guard.rows, guard.offset, states, k)[0]
    return value < -band_factor * EPSILON * (reach + abs(guard.offset))


@kernel()
def sign_of(guard: Ladder, states: Array, k: int, order: int, band_factor: float) -> int:
    """The sign of a guard, or with order 1 of its rate; 0 where rounding hides it."""
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
def _drag(gap: Ladder, kick: Array) -> float:
    """What a unit of velocity adds to the contact acceleration."""
    rows = gap.rows
    c = 0.0
    for i in range(rows.shape[1]):
        c -= rows[4, i] * kick[0, i] + rows[5, i] * kick[1, i]
    return c


@kernel()
def _place_error(
    gap: Ladder, kick: Array, u: float, rest: float, second: float, third: float
) -> float:
    """Bound of the gap's error, to leading order, where the bounces are drawn as parabolas.

    In flight D'' = -a - b s - c D'; b/a and c shift the bounces by up to a twelfth and a twentieth
    of themselves times T^2, T their duration, at any restitution. `rest` is 2T.
    """
    c = _drag(gap, kick)
    return 0.025 * u * rest * rest * (abs(c + third / second) + abs(c))


@kernel()
def chatter_rest(
    gap: Ladder, kick: Array, restitution: float, u: float, second: float, third: float
) -> float:
    """Time until the bounces from relative velocity `u` on accumulate, to second order in `u`.

    In flight the gap obeys D'' = -a - b s - c D' + ...
    """
    c = _drag(gap, kick)
    a = -second - c * u
    first = 2.0 * u / (a * (1.0 - restitution))
    return first * (1.0 - (1.5 * c * a - third) * first / (3.0 * a))


@kernel()
def lifted(restitution: float, u: float, second: float) -> float:
    """Time integral of the gap over the bounces from relative velocity `u` on: parabolas."""
    r = restitution
    if u < SMALLEST:
        return 0.0
    return (2.0 / 3.0) * u * u * u / (second * second * (1.0 - r * r * r))
