"""Certified first root of an exponential sum."""

from __future__ import annotations

from dynkit.compiled import kernel
from dynkit.exponential.evaluation_kernels import (
    BOUND,
    DEGREE,
    EPSILON,
    FOUND,
    SCRATCH,
    START,
    Ladder,
    Workspace,
    expand,
    expand_apart,
    look_ahead,
    propagate,
    propagate_steps,
    shift,
    shift_linked,
    start_sums,
    value_and_rates,
    walk,
)
from dynkit.exponential.polynomial_kernels import (
    BEYOND,
    LIMIT,
    NEVER,
    ROOT,
    TOUCH,
    polynomial,
    polynomial_first_root,
)
from dynkit.exponential.tail_kernels import stays_in_band, tail, weighted
from dynkit.validation import Array

FOREVER = 2**62
"""The farthest horizon."""

NEAR = 1.001
"""In units of the table's swing: how near to it long cells are still tried."""


@kernel(inline=True)
def _quintic_minimum(
    h: float,
    value: float,
    rate: float,
    second: float,
    new_value: float,
    new_rate: float,
    new_second: float,
) -> float:
    """Smallest Bernstein coefficient of the quintic Hermite polynomial, its lower bound."""
    left = min(value, value + 0.2 * h * rate, value + h * (0.4 * rate + 0.05 * h * second))
    right = min(
        new_value,
        new_value - 0.2 * h * new_rate,
        new_value - h * (0.4 * new_rate - 0.05 * h * new_second),
    )
    return min(left, right)


@kernel()
def _cubic_root(h: float, value: float, rate: float, new_value: float, new_rate: float) -> float:
    """Where, as a part of the cell, the cubic Hermite polynomial falls through zero."""
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


@kernel(inline=True)
def _first_rung(
    rate: float,
    second: float,
    third: float,
    fourth: float,
    smallest: float,
    top: int,
    band_factor: float,
) -> int:
    """Largest rung on which f, with f = 0 and f' = `rate` at its left end, is certainly positive.

    f/s = rate + f'' s/2 + f^(3) s^2/6 within fourth s^3/24; -1 if there is none.
    """
    most = 0
    h = smallest
    while most < top and fourth * h * h * h < 3.0 * rate:
        most += 1
        h *= 2.0
    for j in range(most, -1, -1):
        rounding = band_factor * EPSILON * (abs(second) + abs(third) * h)
        error = (fourth * h * h / 24.0 + rounding) * h
        if min(rate, rate + 0.25 * second * h, rate + h * (0.5 * second + third * h / 6.0)) > error:
            return j
        h *= 0.5
    return -1


@kernel()
def _taylor_rung(
    rows: Array, states: Array, k: int, smallest: float, most: int, band: float
) -> int:
    """Largest rung, up to `most`, on which the Taylor polynomial's remainder is below rounding."""
    remainder = 0.0
    for i in range(rows.shape[1]):
        remainder += rows[BOUND + 4, i] * abs(states[k, 0, i])
        remainder += rows[BOUND + 5, i] * abs(states[k, 1, i])
    for j in range(most, 0, -1):
        if remainder * (smallest * (1 << j)) ** (DEGREE + 1) <= 1e-3 * band:
            return j
    return 0


@kernel()
def first_root(
    ladder: Ladder,
    order: int,
    rate: float,
    band_factor: float,
    touches: bool,
    limit: int,
    horizon: int,
    work: Workspace,
) -> tuple[int, int, float, float, int]:
    """Certified first root of f at s > 0, from the state ``work.states[START]``.

    A cell [s, s + h] is passed when the Bernstein coefficients of the quintic Hermite polynomial of
    f exceed the bound M_6 h^6 / 46080 of its error; a cell of the smallest size is searched by its
    Taylor polynomial. Far from the table only the amplitude of its motion counts.

    Parameters
    ----------
    order
        How many leading Taylor coefficients of f are known to vanish: 0 (f > 0), 1 (then `rate` is
        f'(0) > 0), 2 or 3 (f''(0) or f^(3)(0) > 0 follows from the state).
    band_factor
        Rounding band in units of the amplitude sum.
    touches
        Whether a minimum within the rounding band counts as a root.
    limit
        Largest number of cells.
    horizon
        Number of smallest steps beyond which nobody asks.
    work
        Modified in place; ``work.states[FOUND]`` becomes the state at the root.

    Returns
    -------
    outcome, n, e, rate, cells : the root is at ``n * smallest + e``, `rate` is f' there.
    """
    step = ladder.step
    links = ladder.links
    link_step = ladder.link_step
    cell = ladder.cell
    rows = ladder.rows
    offset = ladder.offset
    top = cell.shape[0] - 1
    smallest = ladder.smallest
    table = ladder.steady
    seen = rows.shape[1]
    c = work.coefficients
    states = work.states
    current = START
    second, third, fourth, reach = start_sums(rows, states, START)
    band = band_factor * EPSILON * (reach + abs(offset))
    n = 0
    cells = 0
    value = 0.0
    slope = 0.0
    j = -1
    if order == 0:
        value, slope, second = value_and_rates(rows, offset, states, START)
        j = 0
    elif order == 1:
        j = _first_rung(rate, second, third, fourth, smallest, top, band_factor)
        if j >= 0:
            value, slope, second, error = look_ahead(cell, j, states, START)
            value += offset
            if value > 2.0 * band:
                current = 0
                walk(step, links, link_step, seen, j, states, START, current)
                n = 1 << j
                cells = 1
            else:
                j = -1
    expanded = False
    wide = 0
    carried = 0.0
    carried_to = -1
    passed = 0
    # What the table drives is not bounded by its swing.
    swing = ladder.swing
    swings = swing > 0.0 and links.shape[0] == 0
    pace = ladder.generator[1, table] if swings else 0.0
    while cells < limit and n <= horizon:
        if ladder.grows:
            reach = weighted(rows, BOUND, -1, states, current)
            band = max(band, band_factor * EPSILON * (reach + abs(offset)))
        if j >= 0 and not expanded:
            h = smallest * (1 << j)
            v = value
            r = slope
            a = second
            far = False
            if swings:
                p = states[current, 0, table]
                q = states[current, 1, table]
                v -= rows[0, table] * p + rows[1, table] * q
                far = v > 2.0 * swing
                if v > NEAR * swing:
                    r -= rows[2, table] * p + rows[3, table] * q
                    # What comes near but slowly is passed in cells longer than the table's motion.
                    far = far or (v - swing) * pace > 8.0 * abs(r)
                if far:
                    v -= swing
                    a -= rows[4, table] * p + rows[5, table] * q
                else:
                    v = value
                    r = slope
            # Rungs whose certificate must fail already at this end of the cell are not tried.
            while j > 0 and v + h * (0.4 * r + 0.05 * h * a) <= band:
                j -= 1
                h *= 0.5
            new_value, new_slope, new_second, error = look_ahead(cell, j, states, current)
            new_value += offset
            cells += 1
            margin = band * (1.0 + 0.25 * cells)
            if far:
                p = states[current, 0, table]
                q = states[current, 1, table]
                low = _quintic_minimum(
                    h,
                    v,
                    r,
                    a,
                    new_value - (cell[j, 0, table] * p + cell[j, 1, table] * q) - swing,
                    new_slope - (cell[j, 2, table] * p + cell[j, 3, table] * q),
                    new_second - (cell[j, 4, table] * p + cell[j, 5, table] * q),
                )
                error -= cell[j, 6, table] * abs(p) + cell[j, 7, table] * abs(q)
            else:
                low = _quintic_minimum(h, v, r, a, new_value, new_slope, new_second)
            if low > error + margin:
                walk(step, links, link_step, seen, j, states, current, (current + 1) % SCRATCH)
                current = (current + 1) % SCRATCH
                n += 1 << j
                value = new_value
                slope = new_slope
                second = new_second
                if j < top and low > 32.0 * error:
                    j += 1
                passed += 1
                if passed & 15 == 0 and tail(ladder, states, current) > band:
                    return NEVER, n, 0.0, 0.0, cells
                continue
            if ladder.apart:
                # Fast exponentials that have died out do not narrow the Taylor polynomial.
                wide = _taylor_rung(rows, states, current, smallest, j, band)
                if wide < j:
                    j -= 1
                    continue
            elif j > 0:
                m = 0
                if new_value < 0.0 and not far:
                    m = int((1 << j) * _cubic_root(h, value, slope, new_value, new_slope) - 0.2)
                if m <= 0:
                    j = j - 1 if new_value >= 0.0 or far else 0
                    continue
                # Jump to the last node before the estimated root, if the way there can be
                # certified.
                jumped = propagate_steps(step, links, link_step, n + m, states, current, 0, seen)
                expand(ladder.generator, rows, offset, states, jumped, c)
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
            current = propagate_steps(step, links, link_step, n, states, current, 0, seen)
            if ladder.apart:
                expand_apart(ladder, states, current, c)
            else:
                expand(ladder.generator, rows, offset, states, current, c)
        expanded = False
        threshold = band
        carries = n == carried_to
        if n == 0 and order > 0:
            first = order
            carries = True
            if order == 1:
                c[1] = rate
            threshold = 8.0 * EPSILON * abs(c[first])
        else:
            if carries:
                # Taken on from the start, the value has only the rounding of its changes.
                c[0] = carried
                speeds = weighted(rows, 2, -1, states, current)
                lost = EPSILON * (band_factor * speeds * n * smallest + 8.0 * carried)
                threshold = min(band, lost)
            if c[0] <= threshold:
                # Inside the band and certified not to have crossed: only a crossing beyond the band
                # counts.
                if stays_in_band(ladder, states, current, threshold):
                    return NEVER, n, 0.0, 0.0, cells
                c[0] = max(c[0], -threshold) + 2.0 * threshold
                carries = False
        h = smallest * (1 << wide)
        outcome, e, slope = polynomial_first_root(c, first, h, threshold)
        cells += 1
        if outcome == ROOT or (outcome == TOUCH and touches):
            m = int(e / smallest)
            if m > 0:
                n += m
                e -= m * smallest
                current = propagate_steps(step, links, link_step, n, states, current, 0, seen)
            shift(ladder.generator, e, states, current, FOUND, 0, seen)
            if links.shape[0] > 0:
                shift_linked(ladder, e, states, current, FOUND)
            if seen < states.shape[2]:
                other = propagate_steps(
                    step, links, link_step, n, states, current, seen, states.shape[2]
                )
                last = states.shape[2]
                shift(ladder.generator, e, states, other, FOUND, seen, last)
            for _ in range(first):
                slope *= e
            if first == 0 and outcome == ROOT:
                # The state keeps the digits that differentiating the polynomial costs.
                slope = value_and_rates(rows, offset, states, FOUND)[1]
            return outcome, n, e, slope, cells
        # No root here: on to the end of the cell.
        n += 1 << wide
        if carries:
            carried = polynomial(c, first, h)[0]
            for _ in range(first):
                carried *= h
            carried_to = n
        propagate(step, links, link_step, wide, states, current, (current + 1) % SCRATCH, 0, seen)
        current = (current + 1) % SCRATCH
        value, slope, second = value_and_rates(rows, offset, states, current)
        j = wide
        wide = 0
    if n > horizon:
        return BEYOND, n, 0.0, 0.0, cells
    return LIMIT, n, 0.0, 0.0, cells
