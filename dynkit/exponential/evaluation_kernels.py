"""Exponential sums as the kernels see them, and their evaluation.

A sum is f(s) = offset + sum_k rows_k . y_k(s), y_k' = G_k y_k, with one pair y_k of two numbers in
each slot: a mode (displacement, velocity), two real exponentials, or (sine, cosine) of the table.
Arrays are C-contiguous float64, slots last; slots beyond the last term hold zeros.

States are addressed as states[k], never passed as views: taking a view costs more than the loop
over a few slots.
"""

from __future__ import annotations

from typing import NamedTuple

from dynkit.compiled import kernel
from dynkit.validation import Array

EPSILON = 2.0**-52

DEGREE = 14
"""Degree of the Taylor polynomials: for |lambda| h <= REACH a remainder below 3e-17."""

REACH = 0.5
"""Largest |lambda| h of the smallest step."""

SCRATCH, START, FOUND, STATES = 3, 3, 4, 5
"""Number of scratch states; places of the start and of the result; number of states."""


class Ladder(NamedTuple):
    """One exponential sum, prepared for steps of ``smallest * 2**j``.

    Attributes
    ----------
    step : (rungs, 8, slots) propagators exp(G h), entries 11, 12, 21, 22, then the low parts of the
        same
    cell : (rungs, 8, slots) rows that give f, f', f'' after the step from the state before it, two
        each, then the
        weights of |y| in the bound of the quintic Hermite error on a cell of that size
    rows : (8, slots) rows that give f, f', f'', f^(3) from y, two each
    bound : (6, slots) weights of |y| that bound sup |f_k|, sup |f_k^(4)| and the last
        sup |f_k^(DEGREE + 1)| / (DEGREE + 1)! for all later times
    generator : (4, slots) entries 11, 12, 21, 22 of G
    characteristic : (2, slots) trace and determinant of G
    offset : constant term of f
    smallest : step of rung 0, a power of two
    smooth : largest rung on which every term's bound grows as h^6
    separate : whether a slot holds two separate exponentials (an overdamped mode)
    steady : number of the slot that never decays and is bounded by `swing` (the table)
    swing : amplitude of that slot's term
    """

    step: Array
    cell: Array
    rows: Array
    bound: Array
    generator: Array
    characteristic: Array
    offset: float
    smallest: float
    smooth: int
    separate: bool
    steady: int
    swing: float


class Workspace(NamedTuple):
    """Buffers of a search, modified in place.

    Attributes
    ----------
    states : (STATES, 2, slots); ``states[START]`` is the state that a search starts from,
        ``states[FOUND]`` the one at the
        root, the others are scratch
    coefficients : (DEGREE + 1,) Taylor coefficients of f
    """

    states: Array
    coefficients: Array


@kernel(fuse=True, inline=True)
def propagate(step: Array, j: int, states: Array, k: int, to: int) -> None:
    """State `k` after the step of rung `j`, to about one rounding error, into state `to`.

    Fused, the low parts meet the exact product, whose bits beyond the last carry them; a rounded
    one would swallow them always, and the energy would drift.
    """
    for i in range(states.shape[2]):
        a = states[k, 0, i]
        b = states[k, 1, i]
        states[to, 0, i] = (
            (step[j, 4, i] * a + step[j, 5, i] * b) + step[j, 0, i] * a + step[j, 1, i] * b
        )
        states[to, 1, i] = (
            (step[j, 6, i] * a + step[j, 7, i] * b) + step[j, 2, i] * a + step[j, 3, i] * b
        )


@kernel(reorder=True, inline=True)
def walk(step: Array, j: int, states: Array, k: int, to: int) -> None:
    """As `propagate` without the low parts: for the search only."""
    for i in range(states.shape[2]):
        a = states[k, 0, i]
        b = states[k, 1, i]
        states[to, 0, i] = step[j, 0, i] * a + step[j, 1, i] * b
        states[to, 1, i] = step[j, 2, i] * a + step[j, 3, i] * b


@kernel()
def propagate_steps(step: Array, n: int, states: Array, keep: int) -> int:
    """The start state after `n` smallest steps, one propagation per binary digit.

    Returns the place of the result, one of the two scratch states that are not `keep`.
    """
    top = step.shape[0] - 1
    k = START
    to = (keep + 1) % SCRATCH
    other = (keep + 2) % SCRATCH
    for j in range(top):
        if (n >> j) & 1:
            propagate(step, j, states, k, to)
            k = to
            to = other
            other = k
    for _ in range(n >> top):
        propagate(step, top, states, k, to)
        k = to
        to = other
        other = k
    return k


@kernel(reorder=True)
def shift(
    generator: Array, characteristic: Array, e: float, states: Array, k: int, to: int
) -> None:
    """State `k` after a time `e` not beyond the smallest step, into state `to`.

    exp(G e) = x0 + x1 G by the theorem of Cayley and Hamilton, both as Taylor series.
    """
    for i in range(states.shape[2]):
        trace = characteristic[0, i] * e
        determinant = characteristic[1, i] * e * e
        before = 0.0
        now = 1.0
        x0 = 1.0
        x1 = 1.0
        factor = 1.0
        for j in range(2, DEGREE + 2):
            before, now = now, trace * now - determinant * before
            factor = factor / j
            x0 -= determinant * before * factor
            x1 += now * factor
        x1 *= e
        a = states[k, 0, i]
        b = states[k, 1, i]
        states[to, 0, i] = x0 * a + x1 * (generator[0, i] * a + generator[1, i] * b)
        states[to, 1, i] = x0 * b + x1 * (generator[2, i] * a + generator[3, i] * b)


@kernel(reorder=True, inline=True)
def look_ahead(cell: Array, j: int, states: Array, k: int) -> tuple[float, float, float, float]:
    """f, f', f'' after the step of rung `j`, and the bound of the quintic Hermite error on it."""
    value = 0.0
    rate = 0.0
    second = 0.0
    error = 0.0
    for i in range(states.shape[2]):
        a = states[k, 0, i]
        b = states[k, 1, i]
        value += cell[j, 0, i] * a + cell[j, 1, i] * b
        rate += cell[j, 2, i] * a + cell[j, 3, i] * b
        second += cell[j, 4, i] * a + cell[j, 5, i] * b
        error += cell[j, 6, i] * abs(a) + cell[j, 7, i] * abs(b)
    return value, rate, second, error


@kernel(reorder=True, inline=True)
def start_sums(
    rows: Array, bound: Array, states: Array, k: int
) -> tuple[float, float, float, float]:
    """f'', f^(3), bound of |f^(4)| and of |f| from now on."""
    second = 0.0
    third = 0.0
    fourth = 0.0
    reach = 0.0
    for i in range(states.shape[2]):
        a = states[k, 0, i]
        b = states[k, 1, i]
        second += rows[4, i] * a + rows[5, i] * b
        third += rows[6, i] * a + rows[7, i] * b
        reach += bound[0, i] * abs(a) + bound[1, i] * abs(b)
        fourth += bound[2, i] * abs(a) + bound[3, i] * abs(b)
    return second, third, fourth, reach


@kernel(reorder=True, inline=True)
def value_and_rates(
    rows: Array, offset: float, states: Array, k: int
) -> tuple[float, float, float]:
    """f, f' and f'' of the state `k`."""
    value = 0.0
    rate = 0.0
    second = 0.0
    for i in range(states.shape[2]):
        value += rows[0, i] * states[k, 0, i] + rows[1, i] * states[k, 1, i]
        rate += rows[2, i] * states[k, 0, i] + rows[3, i] * states[k, 1, i]
        second += rows[4, i] * states[k, 0, i] + rows[5, i] * states[k, 1, i]
    return value + offset, rate, second


@kernel(reorder=True)
def expand(
    characteristic: Array, rows: Array, offset: float, states: Array, k: int, c: Array
) -> None:
    """Taylor coefficients of f at the state `k`; `c` is modified in place.

    Every term obeys its characteristic equation, f'' = trace f' - determinant f, and so do all its
    derivatives. Written out, because the compiler then keeps the sums in registers, ten times as
    fast as a loop over the orders.
    """
    c0 = c1 = c2 = c3 = c4 = c5 = c6 = c7 = c8 = c9 = c10 = c11 = c12 = c13 = c14 = 0.0
    for i in range(states.shape[2]):
        t = characteristic[0, i]
        d = characteristic[1, i]
        a = rows[0, i] * states[k, 0, i] + rows[1, i] * states[k, 1, i]
        b = rows[2, i] * states[k, 0, i] + rows[3, i] * states[k, 1, i]
        c0 += a
        c1 += b
        a = t * b - d * a
        b = t * a - d * b
        c2 += a
        c3 += b
        a = t * b - d * a
        b = t * a - d * b
        c4 += a
        c5 += b
        a = t * b - d * a
        b = t * a - d * b
        c6 += a
        c7 += b
        a = t * b - d * a
        b = t * a - d * b
        c8 += a
        c9 += b
        a = t * b - d * a
        b = t * a - d * b
        c10 += a
        c11 += b
        a = t * b - d * a
        b = t * a - d * b
        c12 += a
        c13 += b
        c14 += t * b - d * a
    c[0] = c0 + offset
    c[1] = c1
    c[2] = c2 / 2.0
    c[3] = c3 / 6.0
    c[4] = c4 / 24.0
    c[5] = c5 / 120.0
    c[6] = c6 / 720.0
    c[7] = c7 / 5040.0
    c[8] = c8 / 40320.0
    c[9] = c9 / 362880.0
    c[10] = c10 / 3628800.0
    c[11] = c11 / 39916800.0
    c[12] = c12 / 479001600.0
    c[13] = c13 / 6227020800.0
    c[14] = c14 / 87178291200.0


@kernel()
def expand_separate(
    generator: Array, rows: Array, offset: float, states: Array, k: int, c: Array
) -> None:
    """As `expand`, both exponentials of a slot apart: their equation would mix their rates."""
    for j in range(DEGREE + 1):
        c[j] = 0.0
    for i in range(states.shape[2]):
        p = states[k, 0, i]
        q = states[k, 1, i]
        c[0] += rows[0, i] * p + rows[1, i] * q
        for j in range(1, DEGREE + 1):
            a = p / j
            b = q / j
            p = generator[0, i] * a + generator[1, i] * b
            q = generator[2, i] * a + generator[3, i] * b
            c[j] += rows[0, i] * p + rows[1, i] * q
    c[0] += offset
