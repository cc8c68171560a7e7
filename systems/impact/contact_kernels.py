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

Indices = NDArray[np.intp]

SMALLEST = 1e-100
"""Relative velocity below which a chatter is over, whatever is tolerated: cubes of it vanish."""

PLACE = 1000.0
"""So many times the tolerance the place of the contact mass may be off in the bounces that are left
out, where it follows parabolas: nothing else follows from it."""


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
    excursion : (2, slots) change of the state by a brief excursion of the contact coordinate, over
        its time integral
    coupling : largest such change of a position or velocity
    tolerance : largest error of the state by which the rest of a chatter is replaced by contact
        (see `PLACE` for the contact coordinate before it)
    clock_rate : rate of the phase where no slot holds it, and the clock does; 0 elsewhere
    """

    stops: tuple[Stop, ...]
    modes: Indices
    restitution: float
    excursion: Array
    coupling: float
    tolerance: float
    clock_rate: float


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
def chatter_completes(
    mechanics: Mechanics,
    stop: Stop,
    u: float,
    second: float,
    third: float,
    fourth: float,
    error: float,
) -> bool:
    """Whether the bounces from relative velocity `u` on must accumulate before contact can be lost.

    With contact acceleration a = -f'' the rest lasts T = 2u/(a(1 - r)); a varies by less than a(1 -
    r)/4 over 2T. The bound of f^(4) holds for the time `stop.gap.window`. And whether they may be
    left out.
    """
    r = mechanics.restitution
    a = -second
    if a <= 0.0 or r >= 1.0 or error > mechanics.tolerance:
        return False
    if mechanics.tolerance == 0.0 and u > SMALLEST:
        return False  # under constant forces the error is zero, too
    rest = 4.0 * u / (a * (1.0 - r))
    if rest > stop.gap.window:
        return False
    if (abs(third) + 0.5 * fourth * rest) * rest > 0.25 * (1.0 - r) * a:
        return False
    most = PLACE * mechanics.tolerance
    return most == 0.0 or _place_error(stop, u, rest, second, third) <= most


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
def pulls(force: Ladder, states: Array, band_factor: float) -> bool:
    """Whether the table would have to pull the contact mass to hold it, beyond rounding."""
    reach = start_sums(force.rows, states, START)[3]
    value = value_and_rates(force.rows, force.offset, states, START)[0]
    return value < -band_factor * EPSILON * (reach + abs(force.offset))


@kernel()
def _drag(stop: Stop) -> float:
    """What a unit of velocity adds to the contact acceleration."""
    rows = stop.gap.rows
    kick = stop.kick
    c = 0.0
    for i in range(rows.shape[1]):
        c -= rows[4, i] * kick[0, i] + rows[5, i] * kick[1, i]
    return c


@kernel()
def _place_error(stop: Stop, u: float, rest: float, second: float, third: float) -> float:
    """Bound of the gap's error, to leading order, where the bounces are drawn as parabolas.

    In flight D'' = -a - b s - c D'; b/a and c shift the bounces by up to a twelfth and a twentieth
    of themselves times T^2, T their duration, at any restitution. `rest` is 2T.
    """
    c = _drag(stop)
    return 0.025 * u * rest * rest * (abs(c + third / second) + abs(c))


@kernel()
def chatter_rest(stop: Stop, restitution: float, u: float, second: float, third: float) -> float:
    """Time until the bounces from relative velocity `u` on accumulate, to second order in `u`.

    In flight the gap obeys D'' = -a - b s - c D' + ...
    """
    c = _drag(stop)
    a = -second - c * u
    first = 2.0 * u / (a * (1.0 - restitution))
    return first * (1.0 - (1.5 * c * a - third) * first / (3.0 * a))


@kernel()
def chatter_error(mechanics: Mechanics, u: float, second: float) -> float:
    """Largest change of a position or velocity by the rest of a chatter, to leading order."""
    return mechanics.coupling * lifted(mechanics.restitution, u, second)


@kernel()
def lifted(restitution: float, u: float, second: float) -> float:
    """Time integral of the gap over the bounces from relative velocity `u` on: parabolas."""
    r = restitution
    if u < SMALLEST:
        return 0.0
    return (2.0 / 3.0) * u * u * u / (second * second * (1.0 - r * r * r))
