"""Exponential sums in the arrays of the kernels, and their evaluation.

A sum is f(s) = offset + sum_k rows_k . y_k(s), y_k' = G_k y_k. Each slot holds a pair y_k of two
numbers: a mode (displacement, velocity), two real exponentials, or (sine, cosine) of the table.
Links are couplings by which the pair of one slot drives that of another. Arrays are C-contiguous
float64, slots last; unused slots hold zeros. The sum depends on the first slots only ("seen"); the
others belong to the same state.

States are addressed as states[k] and not passed as views, because taking a view costs more than the
loop over a few slots.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.product_kernels import fused, pair_sums

EPSILON = 2.0**-52

DEGREE = 14
"""Degree of the Taylor polynomials: the remainder is below 3e-17 for |lambda| h <= REACH."""

REACH = 0.5
"""Largest |lambda| h of the smallest step."""

SCRATCH, START, FOUND, TERM, KEPT, LEFT, STATES = 3, 3, 4, 5, 7, 8, 9
"""Number of scratch states; indices of the start, of the result, of two Taylor terms, of the
earliest result and of the start of the previous mode; number of states."""

PLACES, LEVELS = 11, 5
"""Number of integers and of real numbers of a paused search."""

LEAP, SEARCH, CHANGE, NOISE, DEATH = range(5)
"""Indices of the kernels that are called by their address: for long cells, for the search of a sum
that is not `plain`, for a change of the mode, for disturbances, and for the end of a decay."""

CODES, WANTED_CODE = 5, -1
"""Number of these kernels; entry in place of an address if a call has paused until the kernel is
compiled."""

BOUND, TAIL, DRIFT, SEPARATE = 8, 14, 16, 22
"""First rows of the groups in ``Ladder.rows``."""

Indices = NDArray[np.intp]


class Ladder(NamedTuple):
    """One exponential sum, prepared for steps of ``smallest * 2**j``.

    Attributes
    ----------
    step : (all rungs, 8, slots) propagators exp(G h): entries 11, 12, 21, 22, then their low parts
    cell : (rungs, 10, seen) for a step of each rung:
        rows, two each, of f, f', f'' after the step, applied to the state before it;
        weights (2) of |y|: for kept terms, of the bound of the quintic Hermite error on the cell;
        for terms left out, of the bound of their contribution to f on the cell;
        flags (2): 1 for kept terms, 0 for terms left out because they are too fast for the cell
    rows : (23, seen), in groups of two rows each:
        rows of f, f', f'', f^(3);
        from BOUND on, weights of |y| that bound |f_k|, |f_k^(4)| and
        |f_k^(DEGREE + 1)| / (DEGREE + 1)! for the time `window` (for a term that grows, or is slow,
        the first is its present size);
        from TAIL on, weights that bound at all later times the terms that do not drift, minus
        their steady responses; infinite where there is no bound;
        from DRIFT on, rows of the drifting and constant terms, of their rate and acceleration;
        the last row is 1 for a slot of two separate numbers, and 0 for a coupled pair
    generator : (6, slots) entries 11, 12, 21, 22, trace and determinant of G
    links : (L, 2) driven slot and driving slot
    link_step : (2 + all rungs, L, 4) entries 11, 12, 21, 22 of the coupling, of the contribution of
        the driving slot in a step of each rung, and of the steady response
    offset : constant term of f
    smallest : step of rung 0, a power of two
    smooth : largest rung without terms left out
    apart : whether a seen slot holds two separate numbers, or is driven by another
    grows : whether a term may grow beyond its present size, for long or without bound
    window : time for which the weights from BOUND on hold
    steady : slot of the pair that never decays (the table), or -1
    swing : bound of all contributions of that slot, including steady responses; infinite where
        there is no bound
    """

    step: Array
    cell: Array
    rows: Array
    generator: Array
    links: Indices
    link_step: Array
    offset: float
    smallest: float
    smooth: int
    apart: bool
    grows: bool
    window: float
    steady: int
    swing: float


class Workspace(NamedTuple):
    """Buffers of a search, modified in place.

    Attributes
    ----------
    states : (STATES, 2, slots); ``states[START]`` is the start of the search, ``states[FOUND]`` the
        state at the root, the others are scratch
    coefficients : (DEGREE + 1,) Taylor coefficients of f
    places : (PLACES,) whether the search is paused, then the integers of a paused search
    levels : (LEVELS,) real numbers of a paused search
    codes : (CODES,) addresses of compiled kernels, WANTED_CODE, or 0 for one not needed so far
    """

    states: Array
    coefficients: Array
    places: NDArray[np.int64]
    levels: Array
    codes: NDArray[np.int64]


@kernel(inline=True)
def _add_driven(links: Indices | None, b: Array, j: int, states: Array, k: int, to: int) -> None:
    """Add the contributions of the driving slots of state `k` in a step to state `to`, in place.

    For links of None, of a sum that is known to have none, there is nothing to compile.
    """
    if links is not None:
        for m in range(links.shape[0]):
            p = states[k, 0, links[m, 1]]
            q = states[k, 1, links[m, 1]]
            states[to, 0, links[m, 0]] += b[j + 1, m, 0] * p + b[j + 1, m, 1] * q
            states[to, 1, links[m, 0]] += b[j + 1, m, 2] * p + b[j + 1, m, 3] * q


@kernel(inline=True)
def propagate(
    step: Array,
    links: Indices | None,
    link_step: Array,
    j: int,
    states: Array,
    k: int,
    to: int,
    first: int,
    last: int,
) -> None:
    """Write slots `first` to `last` - 1 of state `k` after the step of rung `j` into state `to`.

    The error is about one rounding. The fused operation adds the low parts to the exact product.
    Added to a rounded product the low parts would be lost in every step, and the energy would
    drift.
    """
    for i in range(first, last):
        a = states[k, 0, i]
        b = states[k, 1, i]
        low = fused(step[j, 4, i], a, step[j, 5, i] * b)
        states[to, 0, i] = fused(step[j, 1, i], b, fused(step[j, 0, i], a, low))
        low = fused(step[j, 6, i], a, step[j, 7, i] * b)
        states[to, 1, i] = fused(step[j, 3, i], b, fused(step[j, 2, i], a, low))
    if first == 0:
        _add_driven(links, link_step, j, states, k, to)


@kernel(inline=True)
def walk(
    step: Array,
    links: Indices | None,
    link_step: Array,
    seen: int,
    j: int,
    states: Array,
    k: int,
    to: int,
) -> None:
    """Propagate the seen slots without the low parts: for the search only."""
    for i in range(seen):
        a = states[k, 0, i]
        b = states[k, 1, i]
        states[to, 0, i] = fused(step[j, 0, i], a, step[j, 1, i] * b)
        states[to, 1, i] = fused(step[j, 2, i], a, step[j, 3, i] * b)
    _add_driven(links, link_step, j, states, k, to)


@kernel(constants=True)
def propagate_steps(
    step: Array,
    links: Indices | None,
    link_step: Array,
    n: int,
    states: Array,
    keep: int,
    first: int,
    last: int,
) -> int:
    """Propagate slots of the start state by `n` smallest steps, one propagation per binary digit.

    Returns the index of the result, one of the two scratch states that are not `keep`.
    """
    top = step.shape[0] - 1
    k = START
    to = (keep + 1) % SCRATCH
    other = (keep + 2) % SCRATCH
    j = 0
    while n > 0 and j < top:
        if n & 1:
            propagate(step, links, link_step, j, states, k, to, first, last)
            k = to
            to = other
            other = k
        n >>= 1
        j += 1
    for _ in range(n):
        propagate(step, links, link_step, top, states, k, to, first, last)
        k = to
        to = other
        other = k
    return k


@kernel(constants=True)
def shift(
    generator: Array,
    e: float,
    states: Array,
    k: int,
    to: int,
    first: int,
    last: int,
) -> None:
    """Write uncoupled slots of state `k` after a time `e` <= the smallest step into state `to`.

    exp(G e) = x0 + x1 G (Cayley-Hamilton theorem), with Taylor series for x0 and x1.
    """
    for i in range(first, last):
        trace = generator[4, i] * e
        determinant = generator[5, i] * e * e
        before = 0.0
        now = 1.0
        x0 = 1.0
        x1 = 1.0
        factor = 1.0
        for j in range(2, DEGREE + 2):
            before, now = now, fused(trace, now, -determinant * before)
            factor = factor / j
            x0 = fused(-determinant * before, factor, x0)
            x1 = fused(now, factor, x1)
        x1 *= e
        a = states[k, 0, i]
        b = states[k, 1, i]
        rate = fused(generator[0, i], a, generator[1, i] * b)
        states[to, 0, i] = fused(x1, rate, x0 * a)
        rate = fused(generator[2, i], a, generator[3, i] * b)
        states[to, 1, i] = fused(x1, rate, x0 * b)


@kernel()
def _next_term(ladder: Ladder, factor: float, states: Array, k: int, to: int) -> None:
    """Write the rate of change of the seen slots of state `k`, times a factor, into state `to`."""
    g = ladder.generator
    for i in range(ladder.rows.shape[1]):
        p = factor * states[k, 0, i]
        q = factor * states[k, 1, i]
        states[to, 0, i] = g[0, i] * p + g[1, i] * q
        states[to, 1, i] = g[2, i] * p + g[3, i] * q
    links = ladder.links
    b = ladder.link_step
    for m in range(links.shape[0]):
        p = factor * states[k, 0, links[m, 1]]
        q = factor * states[k, 1, links[m, 1]]
        states[to, 0, links[m, 0]] += b[0, m, 0] * p + b[0, m, 1] * q
        states[to, 1, links[m, 0]] += b[0, m, 2] * p + b[0, m, 3] * q


@kernel()
def shift_linked(ladder: Ladder, e: float, states: Array, k: int, to: int) -> None:
    """Write driven slots of state `k` after a time `e` <= the smallest step into state `to`."""
    links = ladder.links
    for i in range(ladder.rows.shape[1]):
        states[TERM, 0, i] = states[k, 0, i]
        states[TERM, 1, i] = states[k, 1, i]
    for m in range(links.shape[0]):
        states[to, 0, links[m, 0]] = states[k, 0, links[m, 0]]
        states[to, 1, links[m, 0]] = states[k, 1, links[m, 0]]
    for j in range(1, DEGREE + 2):
        old = TERM + (j - 1) % 2
        new = TERM + j % 2
        _next_term(ladder, e / j, states, old, new)
        for m in range(links.shape[0]):
            t = links[m, 0]
            # a slot with several drivers gets the term once
            if m == 0 or links[m - 1, 0] != t:
                states[to, 0, t] += states[new, 0, t]
                states[to, 1, t] += states[new, 1, t]


_sums_ahead = pair_sums(3, 1)
_start_sums = pair_sums(2, 2)
_rates = pair_sums(3, 0)


@kernel(inline=True)
def look_ahead(cell: Array, j: int, states: Array, k: int) -> tuple[float, float, float, float]:
    """Return f, f', f'' after the step of rung `j`, and the bound of the Hermite error on it."""
    value, rate, second, error = _sums_ahead(cell, cell.shape[1] // 2 * j, states, k)
    return value, rate, second, error


@kernel(inline=True)
def start_sums(rows: Array, states: Array, k: int) -> tuple[float, float, float, float]:
    """Return f'', f^(3), and bounds of |f^(4)| and of |f| (its present size if it grows)."""
    second, third, reach, fourth = _start_sums(rows, 2, states, k)
    return second, third, fourth, reach


@kernel(inline=True)
def value_and_rates(
    rows: Array, offset: float, states: Array, k: int
) -> tuple[float, float, float]:
    """Return f, f' and f'' at the state `k`."""
    value, rate, second = _rates(rows, 0, states, k)
    return value + offset, rate, second


@kernel(reorder=True)
def expand(generator: Array, rows: Array, offset: float, states: Array, k: int, c: Array) -> None:
    """Compute the Taylor coefficients of f at the state `k`; `c` is modified in place.

    Every term and all its derivatives satisfy the characteristic equation,
    f'' = trace f' - determinant f. The loop over the orders is unrolled, because the compiler then
    keeps the sums in registers, which is ten times faster.
    """
    c0 = c1 = c2 = c3 = c4 = c5 = c6 = c7 = c8 = c9 = c10 = c11 = c12 = c13 = c14 = 0.0
    for i in range(rows.shape[1]):
        t = generator[4, i]
        d = generator[5, i]
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
def expand_apart(ladder: Ladder, states: Array, k: int, c: Array) -> None:
    """Compute the Taylor coefficients as `expand`, also for separate numbers and driven slots.

    For these the characteristic equation of a slot does not relate the derivatives of f.
    """
    rows = ladder.rows
    for i in range(rows.shape[1]):
        states[TERM, 0, i] = states[k, 0, i]
        states[TERM, 1, i] = states[k, 1, i]
    for j in range(DEGREE + 1):
        old = TERM + j % 2
        total = 0.0
        for i in range(rows.shape[1]):
            total += rows[0, i] * states[old, 0, i] + rows[1, i] * states[old, 1, i]
        c[j] = total
        _next_term(ladder, 1.0 / (j + 1.0), states, old, TERM + (j + 1) % 2)
    c[0] += ladder.offset
