"""Kernels of exponential sums: propagation ladder, certified first root.

A sum is f(s) = offset + sum_k rows_k . y_k(s), y_k' = G_k y_k, with one pair y_k of two numbers in each slot: a mode
(displacement, velocity), two real exponentials, or (sine, cosine) of the table. Arrays are C-contiguous float64,
slots last; slots beyond the last term hold zeros.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.compiled import kernel

Array = NDArray[np.float64]

EPSILON = 2.220446049250313e-16
DEGREE = 14
"""Degree of the Taylor polynomials; with |lambda| h <= REACH their remainder is below 3e-17 of the amplitude."""
REACH = 0.5
"""Largest |lambda| h of the smallest step."""

START, FOUND = 3, 4
"""Places of the start and of the result in the states of a workspace."""

ROOT, TOUCH, NEVER, LIMIT = 0, 1, 2, 3
"""Outcomes of a search: sign change, double root within rounding, no root in the future, step limit reached."""


class Ladder(NamedTuple):
    """One exponential sum, prepared for steps of ``smallest * 2**j``.

    Attributes
    ----------
    step : (rungs, 8, slots) propagators exp(G h), entries 11, 12, 21, 22, then the low parts of the same
    cell : (rungs, 8, slots) rows that give f, f', f'' after the step from the state before it, two each, then the
        weights of |y| in the bound of the quintic Hermite error on a cell of that size
    rows : (8, slots) rows that give f, f', f'', f^(3) from y, two each
    bound : (4, slots) weights of |y| that bound sup |f_k| and sup |f_k^(4)| for all later times
    generator : (4, slots) entries 11, 12, 21, 22 of G
    characteristic : (2, slots) trace and determinant of G
    offset : constant term of f
    smallest : step of rung 0, a power of two
    smooth : largest rung on which every term's bound grows as h^6
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
    steady: int
    swing: float


class Workspace(NamedTuple):
    """Buffers of a search, modified in place.

    Attributes
    ----------
    states : (5, 2, slots); ``states[START]`` is the state that a search starts from, ``states[FOUND]`` the one at the
        root, the others are scratch
    coefficients : (DEGREE + 1,) Taylor coefficients of f
    """

    states: Array
    coefficients: Array


# --- double-double arithmetic: error-free transformations, so never re-ordered ------------------------------------------


@kernel()
def two_product(a, b):
    """Product and its rounding error (Dekker)."""
    product = a * b
    t = 134217729.0 * a
    a_high = t - (t - a)
    a_low = a - a_high
    t = 134217729.0 * b
    b_high = t - (t - b)
    b_low = b - b_high
    return product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low


@kernel()
def dd_add(a, a_low, b, b_low):
    """Sum of two double-double numbers."""
    s = a + b
    t = s - a
    e = (a - (s - t)) + (b - t) + a_low + b_low
    high = s + e
    return high, e - (high - s)


@kernel()
def dd_multiply(a, a_low, b, b_low):
    """Product of two double-double numbers."""
    p, e = two_product(a, b)
    e += a * b_low + a_low * b
    high = p + e
    return high, e - (high - p)


@kernel()
def _dd_matmul(a, b, out):
    """Product of two 2x2 double-double matrices given as 8 numbers; `out` is modified in place."""
    for i in range(2):
        for j in range(2):
            p, p_low = dd_multiply(a[2 * i], a[4 + 2 * i], b[j], b[4 + j])
            q, q_low = dd_multiply(a[2 * i + 1], a[5 + 2 * i], b[2 + j], b[6 + j])
            out[2 * i + j], out[4 + 2 * i + j] = dd_add(p, p_low, q, q_low)


@kernel()
def fill_steps(generator, generator_low, smallest, first, last, step, work):
    """Propagators of the slots `first` to `last` - 1 over every rung, in double-double.

    Taylor series over the smallest step, then repeated squaring. `step` and the scratch (4, 8) array `work` are
    modified in place.
    """
    scaled = work[0]
    term = work[1]
    total = work[2]
    product = work[3]
    for k in range(first, last):
        for i in range(4):
            scaled[i] = generator[i, k] * smallest
            scaled[4 + i] = generator_low[i, k] * smallest
            term[i] = 1.0 if i == 0 or i == 3 else 0.0
            term[4 + i] = 0.0
            total[i] = term[i]
            total[4 + i] = 0.0
        for order in range(1, 26):
            _dd_matmul(term, scaled, product)
            for i in range(4):
                # Division by a small integer: quotient, then the remainder's quotient.
                quotient = product[i] / order
                p, e = two_product(quotient, float(order))
                rest = ((product[i] - p) - e + product[4 + i]) / order
                term[i] = quotient + rest
                term[4 + i] = rest - (term[i] - quotient)
                total[i], total[4 + i] = dd_add(total[i], total[4 + i], term[i], term[4 + i])
        for j in range(step.shape[0]):
            for i in range(8):
                step[j, i, k] = total[i]
            _dd_matmul(total, total, product)
            for i in range(8):
                total[i] = product[i]


# --- evaluation ---------------------------------------------------------------------------------------------------------


# States are addressed as states[k], never passed as views: taking a view costs more than the loop over a few slots.


@kernel(reorder=True, inline=True)
def propagate(step, j, states, k, to):
    """State `k` after the step of rung `j`, to about one rounding error, into state `to`."""
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
def _walk(step, j, states, k, to):
    """As `propagate` without the low parts: for the search only."""
    for i in range(states.shape[2]):
        a = states[k, 0, i]
        b = states[k, 1, i]
        states[to, 0, i] = step[j, 0, i] * a + step[j, 1, i] * b
        states[to, 1, i] = step[j, 2, i] * a + step[j, 3, i] * b


@kernel()
def propagate_steps(step, n, states, keep):
    """The start state after `n` smallest steps, one propagation per binary digit.

    Returns the place of the result, one of the two scratch states that are not `keep`.
    """
    top = step.shape[0] - 1
    k = START
    to = (keep + 1) % 3
    other = (keep + 2) % 3
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
def shift(generator, characteristic, e, states, k, to):
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
def _look_ahead(cell, j, states, k):
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
def start_sums(rows, bound, states, k):
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


@kernel(reorder=True)
def value_and_rates(rows, offset, states, k):
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
def expand(characteristic, rows, offset, states, k, c):
    """Taylor coefficients of f at the state `k`; `c` is modified in place.

    Every term obeys its characteristic equation, f'' = trace f' - determinant f, and so do all its derivatives.
    Written out, because the compiler then keeps the sums in registers, ten times as fast as a loop over the orders.
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


# --- polynomials --------------------------------------------------------------------------------------------------------


@kernel(reorder=True, inline=True)
def _polynomial(c, first, e):
    """Value and derivative at `e` of the polynomial c[first] + c[first + 1] e + ..."""
    value = c[DEGREE]
    rate = 0.0
    for j in range(DEGREE - 1, first - 1, -1):
        rate = rate * e + value
        value = value * e + c[j]
    return value, rate


@kernel()
def _polish(c, first, e, low, high):
    """Newton's iteration inside a bracket of one sign change, from positive to negative; root and slope there."""
    for _ in range(80):
        value, rate = _polynomial(c, first, e)
        if value > 0.0:
            low = e
        elif value < 0.0:
            high = e
        trial = e - value / rate if rate < 0.0 else low
        if not low < trial < high:
            if value == 0.0 or not low < 0.5 * (low + high) < high:
                break
            trial = 0.5 * (low + high)
            e = trial
            continue
        change = trial - e
        # The next change would be about (curvature / rate) change^2 / 2.
        second = 2.0 * abs(c[first + 2]) + 6.0 * abs(c[first + 3]) * e
        if second * change * change <= -EPSILON * rate * trial:
            e = trial
            break
        e = trial
    value, rate = _polynomial(c, first, e)
    return ROOT, e, rate


@kernel()
def _downhill(c, first, e, end, band):
    """From a point within the band, follow the polynomial down to a crossing or to a minimum within the band."""
    low = e
    high = e
    move = 1e-3 * end
    value, rate = _polynomial(c, first, e)
    if value < -band:
        return _polish(c, first, e, 0.0, e)
    while rate < 0.0 and high < end:
        high = min(high + move, end)
        value, rate = _polynomial(c, first, high)
        if value < -band:
            return _polish(c, first, low, low, high)
    for _ in range(80):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        value, rate = _polynomial(c, first, middle)
        if value < -band:
            return _polish(c, first, e, e, middle)
        if rate < 0.0:
            low = middle
        else:
            high = middle
    return TOUCH, low, 0.0


@kernel()
def polynomial_first_root(c, first, end, band):
    """First root in (0, `end`] of c[first] + c[first + 1] e + ..., positive at 0.

    From a point x on the left, the root of p(x) + p'(x) e - M e^2/2 with M >= |p''| cannot lie beyond a root of p.

    Returns
    -------
    outcome : ROOT, TOUCH (a minimum within +-band of zero) or NEVER (above -band on the whole interval)
    e : place of the root or of the touching minimum
    slope : derivative there
    """
    slope = c[first + 1]
    curvature = 0.0
    power = 1.0
    for j in range(first + 2, DEGREE + 1):
        m = j - first
        curvature += m * (m - 1) * abs(c[j]) * power
        power *= end
        slope += m * max(c[j], 0.0) * power
    if slope < 0.0:
        # The polynomial falls all the way.
        value, rate = _polynomial(c, first, end)
        if value > band:
            return NEVER, end, 0.0
        if value < -band:
            discriminant = c[first + 1] * c[first + 1] - 4.0 * c[first] * c[first + 2]
            guess = 2.0 * c[first] / (math.sqrt(max(discriminant, 0.0)) - c[first + 1])
            return _polish(c, first, min(guess, end), 0.0, end)
    e = 0.0
    for _ in range(400):
        value, rate = _polynomial(c, first, e)
        if value <= band:
            break
        if curvature <= 0.0:
            if rate >= 0.0:
                return NEVER, end, 0.0
            e -= value / rate
        elif rate < 0.0:
            e += 2.0 * value / (math.sqrt(rate * rate + 2.0 * curvature * value) - rate)
        else:
            e += (rate + math.sqrt(rate * rate + 2.0 * curvature * value)) / curvature
        if e > end:
            return NEVER, end, 0.0
    return _downhill(c, first, e, end, band)


# --- first root ---------------------------------------------------------------------------------------------------------


@kernel(reorder=True)
def _tail(rows, bound, offset, steady, swing, states, k):
    """Lower bound of f from now on."""
    reach = 0.0
    for i in range(states.shape[2]):
        if i != steady:
            reach += bound[0, i] * abs(states[k, 0, i]) + bound[1, i] * abs(states[k, 1, i])
    return offset - swing - reach


@kernel(inline=True)
def _quintic_minimum(h, value, rate, second, new_value, new_rate, new_second):
    """Smallest Bernstein coefficient of the quintic Hermite polynomial: a lower bound of it on the cell."""
    left = min(value, min(value + 0.2 * h * rate, value + h * (0.4 * rate + 0.05 * h * second)))
    right = min(
        new_value,
        min(
            new_value - 0.2 * h * new_rate, new_value - h * (0.4 * new_rate - 0.05 * h * new_second)
        ),
    )
    return min(left, right)


@kernel()
def _cubic_root(h, value, rate, new_value, new_rate):
    """Where, as a part of the cell, the cubic Hermite polynomial falls through zero; an estimate."""
    a = h * rate
    b = 3.0 * (new_value - value) - h * (2.0 * rate + new_rate)
    c = 2.0 * (value - new_value) + h * (rate + new_rate)
    low = 0.0
    high = 1.0
    x = value / (value - new_value)
    for _ in range(6):
        p = ((c * x + b) * x + a) * x + value
        slope = (3.0 * c * x + 2.0 * b) * x + a
        if p > 0.0:
            low = x
        else:
            high = x
        trial = x - p / slope if slope < 0.0 else low
        if not low < trial < high:
            trial = 0.5 * (low + high)
        change = abs(trial - x)
        x = trial
        if change < 1e-2 * x:
            break
    return x


@kernel()
def first_root(ladder, order, rate, band_factor, touches, limit, work):
    """Certified first root of f at s > 0, from the state ``work.states[START]``.

    A cell [s, s + h] is passed when the Bernstein coefficients of the quintic Hermite polynomial of f exceed the bound
    M_6 h^6 / 46080 of its error; a cell of the smallest size is searched by its Taylor polynomial.

    Parameters
    ----------
    order
        How many leading Taylor coefficients of f are known to vanish: 0 (f > 0), 1 (then `rate` is f'(0) > 0),
        2 or 3 (f''(0) or f^(3)(0) > 0 follows from the state).
    band_factor
        Rounding band in units of the amplitude sum.
    touches
        Whether a minimum within the rounding band counts as a root.
    limit
        Largest number of cells.
    work
        Modified in place; ``work.states[FOUND]`` becomes the state at the root.

    Returns
    -------
    outcome, n, e, rate, cells : the root is at ``n * smallest + e``, `rate` is f' there.
    """
    step = ladder.step
    cell = ladder.cell
    offset = ladder.offset
    top = step.shape[0] - 1
    smallest = ladder.smallest
    c = work.coefficients
    states = work.states
    current = START
    second, third, fourth, reach = start_sums(ladder.rows, ladder.bound, states, START)
    band = band_factor * EPSILON * (reach + abs(offset))
    n = 0
    cells = 0
    value = 0.0
    slope = 0.0
    j = -1
    if order == 0:
        value, slope, second = value_and_rates(ladder.rows, offset, states, START)
        j = 0
    elif order == 1:
        # f/s = rate + f'' s/2 + f^(3) s^2/6 within fourth s^3/24: positive on the whole first cell?
        h = smallest * (1 << top)
        for trial in range(top, -1, -1):
            error = (
                fourth * h * h / 24.0 + band_factor * EPSILON * (abs(second) + abs(third) * h)
            ) * h
            if (
                min(rate, rate + min(0.25 * second * h, h * (0.5 * second + third * h / 6.0)))
                > error
            ):
                j = trial
                break
            h *= 0.5
        if j >= 0:
            value, slope, second, error = _look_ahead(cell, j, states, START)
            value += offset
            if value > 2.0 * band:
                current = 0
                _walk(step, j, states, START, current)
                n = 1 << j
                cells = 1
            else:
                j = -1
    expanded = False
    while cells < limit:
        if j >= 0 and not expanded:
            h = smallest * (1 << j)
            # Rungs whose certificate must fail already at this end of the cell are not tried.
            while j > 0 and value + h * (0.4 * slope + 0.05 * h * second) <= band:
                j -= 1
                h *= 0.5
            new_value, new_slope, new_second, error = _look_ahead(cell, j, states, current)
            new_value += offset
            cells += 1
            margin = band * (1.0 + 0.25 * cells)
            low = _quintic_minimum(h, value, slope, second, new_value, new_slope, new_second)
            if low > error + margin:
                _walk(step, j, states, current, (current + 1) % 3)
                current = (current + 1) % 3
                n += 1 << j
                value = new_value
                slope = new_slope
                second = new_second
                if j < top and low > 32.0 * error:
                    j += 1
                if cells & 15 == 0 and (
                    _tail(
                        ladder.rows,
                        ladder.bound,
                        offset,
                        ladder.steady,
                        ladder.swing,
                        states,
                        current,
                    )
                    > band
                ):
                    return NEVER, n, 0.0, 0.0, cells
                continue
            if j > 0:
                m = 0
                if new_value < 0.0:
                    m = int((1 << j) * _cubic_root(h, value, slope, new_value, new_slope) - 0.2)
                if m == 0:
                    j = j - 1 if new_value >= 0.0 else 0
                    continue
                # Jump to the last node before the estimated root, if the way there can be certified.
                jumped = propagate_steps(step, n + m, states, current)
                expand(ladder.characteristic, ladder.rows, offset, states, jumped, c)
                part = m * smallest / h
                if j <= ladder.smooth:
                    error *= part * part * part * part * part * part
                h *= part
                low = _quintic_minimum(h, value, slope, second, c[0], c[1], 2.0 * c[2])
                if low <= error + margin:
                    j -= 1
                    continue
                n += m
                expanded = True
                current = jumped
        # The smallest cell, or the first one: Taylor polynomial of the state itself.
        first = 0
        if not expanded:
            current = propagate_steps(step, n, states, current)
            expand(ladder.characteristic, ladder.rows, offset, states, current, c)
        expanded = False
        threshold = band
        if n == 0 and order > 0:
            first = order
            if order == 1:
                c[1] = rate
            threshold = 8.0 * EPSILON * abs(c[first])
        elif c[0] <= band:
            # Inside the band and certified not to have crossed: only a crossing beyond the band counts.
            c[0] += 2.0 * band
        outcome, e, slope = polynomial_first_root(c, first, smallest, threshold)
        cells += 1
        if outcome == ROOT or (outcome == TOUCH and touches):
            shift(ladder.generator, ladder.characteristic, e, states, current, FOUND)
            for _ in range(first):
                slope *= e
            return outcome, n, e, slope, cells
        # No root here: on to the end of the smallest cell.
        n += 1
        propagate(step, 0, states, current, (current + 1) % 3)
        current = (current + 1) % 3
        value, slope, second = value_and_rates(ladder.rows, offset, states, current)
        j = 0
    return LIMIT, n, 0.0, 0.0, cells
