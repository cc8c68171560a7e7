"""Certified first root of an exponential sum."""

from __future__ import annotations

from dynkit.compiled import kernel
from dynkit.exponential.evaluation_kernels import (
    DEGREE,
    EPSILON,
    FOUND,
    SCRATCH,
    START,
    Ladder,
    Workspace,
    expand,
    expand_separate,
    look_ahead,
    propagate,
    propagate_steps,
    shift,
    start_sums,
    value_and_rates,
    walk,
)
from dynkit.exponential.polynomial_kernels import LIMIT, NEVER, ROOT, TOUCH, polynomial_first_root
from dynkit.validation import Array


@kernel(reorder=True)
def _tail(bound: Array, offset: float, steady: int, swing: float, states: Array, k: int) -> float:
    """Lower bound of f from now on."""
    reach = 0.0
    for i in range(states.shape[2]):
        if i != steady:
            reach += bound[0, i] * abs(states[k, 0, i]) + bound[1, i] * abs(states[k, 1, i])
    return offset - swing - reach


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
    bound: Array, states: Array, k: int, smallest: float, most: int, band: float
) -> int:
    """Largest rung, up to `most`, on which the Taylor polynomial's remainder is below rounding."""
    remainder = 0.0
    for i in range(states.shape[2]):
        remainder += bound[4, i] * abs(states[k, 0, i]) + bound[5, i] * abs(states[k, 1, i])
    for j in range(most, 0, -1):
        if remainder * (smallest * (1 << j)) ** (DEGREE + 1) <= 1e-3 * band:
            return j
    return 0


@kernel(reorder=True)
def _stays_in_band(
    bound: Array, offset: float, steady: int, swing: float, states: Array, k: int, band: float
) -> bool:
    """Whether abs(f) never exceeds the band from now on."""
    reach = 0.0
    for i in range(states.shape[2]):
        if i != steady:
            reach += bound[0, i] * abs(states[k, 0, i]) + bound[1, i] * abs(states[k, 1, i])
    return abs(offset) + swing + reach <= band


@kernel()
def first_root(
    ladder: Ladder,
    order: int,
    rate: float,
    band_factor: float,
    touches: bool,
    limit: int,
    work: Workspace,
) -> tuple[int, int, float, float, int]:
    """Certified first root of f at s > 0, from the state ``work.states[START]``.

    A cell [s, s + h] is passed when the Bernstein coefficients of the quintic Hermite polynomial of
    f exceed the bound M_6 h^6 / 46080 of its error; a cell of the smallest size is searched by its
    Taylor polynomial.

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
        j = _first_rung(rate, second, third, fourth, smallest, top, band_factor)
        if j >= 0:
            value, slope, second, error = look_ahead(cell, j, states, START)
            value += offset
            if value > 2.0 * band:
                current = 0
                walk(step, j, states, START, current)
                n = 1 << j
                cells = 1
            else:
                j = -1
    expanded = False
    wide = 0
    while cells < limit:
        if j >= 0 and not expanded:
            h = smallest * (1 << j)
            # Rungs whose certificate must fail already at this end of the cell are not tried.
            while j > 0 and value + h * (0.4 * slope + 0.05 * h * second) <= band:
                j -= 1
                h *= 0.5
            new_value, new_slope, new_second, error = look_ahead(cell, j, states, current)
            new_value += offset
            cells += 1
            margin = band * (1.0 + 0.25 * cells)
            low = _quintic_minimum(h, value, slope, second, new_value, new_slope, new_second)
            if low > error + margin:
                walk(step, j, states, current, (current + 1) % SCRATCH)
                current = (current + 1) % SCRATCH
                n += 1 << j
                value = new_value
                slope = new_slope
                second = new_second
                if j < top and low > 32.0 * error:
                    j += 1
                if cells & 15 == 0 and (
                    _tail(
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
            if ladder.separate:
                # Fast exponentials that have died out do not narrow the Taylor polynomial.
                wide = _taylor_rung(ladder.bound, states, current, smallest, j, band)
                if wide < j:
                    j -= 1
                    continue
            elif j > 0:
                m = 0
                if new_value < 0.0:
                    m = int((1 << j) * _cubic_root(h, value, slope, new_value, new_slope) - 0.2)
                if m <= 0:
                    j = j - 1 if new_value >= 0.0 else 0
                    continue
                # Jump to the last node before the estimated root, if the way there can be
                # certified.
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
            if ladder.separate:
                expand_separate(ladder.generator, ladder.rows, offset, states, current, c)
            else:
                expand(ladder.characteristic, ladder.rows, offset, states, current, c)
        expanded = False
        threshold = band
        if n == 0 and order > 0:
            first = order
            if order == 1:
                c[1] = rate
            threshold = 8.0 * EPSILON * abs(c[first])
        elif c[0] <= band:
            # Inside the band and certified not to have crossed: only a crossing beyond the band
            # counts.
            if _stays_in_band(
                ladder.bound, offset, ladder.steady, ladder.swing, states, current, band
            ):
                return NEVER, n, 0.0, 0.0, cells
            c[0] += 2.0 * band
        h = smallest * (1 << wide)
        outcome, e, slope = polynomial_first_root(c, first, h, threshold)
        cells += 1
        if outcome == ROOT or (outcome == TOUCH and touches):
            m = int(e / smallest)
            if m > 0:
                n += m
                e -= m * smallest
                current = propagate_steps(step, n, states, current)
            shift(ladder.generator, ladder.characteristic, e, states, current, FOUND)
            for _ in range(first):
                slope *= e
            if first == 0 and outcome == ROOT:
                # The state keeps the digits that differentiating the polynomial costs.
                slope = value_and_rates(ladder.rows, offset, states, FOUND)[1]
            return outcome, n, e, slope, cells
        # No root here: on to the end of the cell.
        n += 1 << wide
        propagate(step, wide, states, current, (current + 1) % SCRATCH)
        current = (current + 1) % SCRATCH
        value, slope, second = value_and_rates(ladder.rows, offset, states, current)
        j = wide
        wide = 0
    return LIMIT, n, 0.0, 0.0, cells
