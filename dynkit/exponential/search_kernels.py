"""Certified first root of an exponential sum."""

from __future__ import annotations

from dynkit.core.jit import by_address, kernel
from dynkit.core.validation import Array
from dynkit.exponential.bound_kernels import stays_in_band, tail, weighted
from dynkit.exponential.certificate_kernels import (
    HURDLE,
    leap,
    leap_by_address,
    quintic_minimum,
    taylor_rung,
)
from dynkit.exponential.evaluation_kernels import (
    BOUND,
    EPSILON,
    FOUND,
    LEAP,
    SCRATCH,
    START,
    WANTED_CODE,
    Indices,
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
    PAUSED,
    ROOT,
    TOUCH,
    polish,
    polynomial,
    polynomial_first_root,
)

FOREVER = 2**62
"""The farthest horizon, in smallest steps; a search that reaches it is at its limit."""

LOW = 1024.0
"""Height in units of the rounding band: a flight that stays lower is followed by Taylor
polynomials, each continued from the value of the previous one."""

SMALLEST = 1e-300
"""Smallest value that is treated as positive."""


@kernel()
def _cubic_root(h: float, value: float, rate: float, new_value: float, new_rate: float) -> float:
    """Return the downward zero of the cubic Hermite polynomial, as a fraction of the cell."""
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
    """Return the largest rung on which f, with f(0) = 0 and f'(0) = `rate`, is certainly positive.

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
def _lowered(c: Array, first: int, raised: float, e: float, earliest: float) -> float:
    """Return the root of a polynomial from the root `e` of the polynomial plus `raised`.

    The coefficient c[first] is reduced by `raised`, in place. A nearly double root is not moved.
    """
    c[first] -= raised
    if c[first] > 0.0 and polynomial(c, first, e)[0] < 0.0:
        return polish(c, first, e, 0.0, e)[1]
    for _ in range(3):
        value, rate = polynomial(c, first, e)
        second = 2.0 * abs(c[first + 2]) + 6.0 * abs(c[first + 3] * e)
        if rate >= 0.0 or 8.0 * second * raised > rate * rate:
            break
        e = max(e - value / rate, earliest)
    return e


@kernel()
def _value_at(ladder: Ladder, links: Indices | None, n: int, states: Array) -> float:
    """Return the sum after n smallest steps; two scratch states are modified."""
    seen = ladder.rows.shape[1]
    keep = n - n  # not the literal 0, for which the kernel would be compiled once more
    k = propagate_steps(ladder.step, links, ladder.link_step, n, states, keep, 0, seen)
    return value_and_rates(ladder.rows, ladder.offset, states, k)[0]


@kernel()
def _last_above(ladder: Ladder, links: Indices | None, n: int, states: Array) -> int:
    """Return the last node before `n` at which f is not negative; 0 if there is none."""
    low = n - 1
    high = n
    while low > 0 and _value_at(ladder, links, low, states) < 0.0:
        low, high = max(0, low - 2 * (high - low)), low
    while high - low > 1:
        middle = low + (high - low) // 2
        if _value_at(ladder, links, middle, states) < 0.0:
            high = middle
        else:
            low = middle
    return low


@kernel()
def first_root(
    ladder: Ladder,
    order: int,
    rate: float,
    band_factor: float,
    touches: bool,
    limit: int,
    pause: int,
    horizon: int,
    work: Workspace,
    general: int | None,
) -> tuple[int, int, float, float, int]:
    """Return the certified first root of f at s > 0, from the state ``work.states[START]``.

    A cell [s, s + h] is passed when the Bernstein coefficients of the quintic Hermite polynomial of
    f exceed the bound M_6 h^6 / 46080 of its error; a cell of the smallest size is searched by its
    Taylor polynomial.

    Parameters
    ----------
    order
        Number of leading Taylor coefficients of f that are zero: 0 (f > 0), 1, 2 or 3 (f''(0) or
        f^(3)(0) > 0 follows from the state).
    rate
        With order 1, f'(0) > 0. With order 0, f(0) if it is known with more digits than the state
        gives, otherwise zero.
    band_factor
        Rounding band in units of the amplitude sum.
    touches
        Whether a minimum within the rounding band counts as a root.
    limit
        Largest number of cells.
    pause
        Number of cells after which this call returns PAUSED, so that its time is bounded; the next
        call with the same arguments continues with the same bits.
    horizon
        Number of smallest steps after which the search ends.
    work
        Modified in place; ``work.states[FOUND]`` becomes the state at the root.
    general
        With None the sum must be `plain`, and the code for other sums is not compiled.

    Returns
    -------
    outcome, n, e, rate, cells : the root is at ``n * smallest + e``, `rate` is f' there.
    """
    step = ladder.step
    # with None no code for driven slots is compiled
    links = None if general is None else ladder.links
    link_step = ladder.link_step
    cell = ladder.cell
    rows = ladder.rows
    offset = ladder.offset
    top = cell.shape[0] - 1
    smallest = ladder.smallest
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
    expanded = False
    wide = 0
    wider = 0
    carried = 0.0
    carried_to = -1
    passed = 0
    leaping = False
    leapt = 0
    places = work.places
    levels = work.levels
    if places[0] != 0:
        places[0] = 0
        n, cells, current, j, wide = places[1], places[2], places[3], places[4], places[5]
        wider, carried_to, passed, leapt = places[6], places[7], places[8], places[9]
        leaping = places[10] != 0
        value, slope, second = levels[0], levels[1], levels[2]
        band, carried = levels[3], levels[4]
    elif order == 0:
        value, slope, second = value_and_rates(rows, offset, states, START)
        j = 0
        if rate > 0.0:
            value = carried = rate
            carried_to = 0
    elif order == 1:
        j = _first_rung(rate, second, third, fourth, smallest, top, band_factor)
        if j >= 0:
            value, slope, second, error = look_ahead(cell, j, states, START)
            value += offset
            if value > LOW * band:
                current = 0
                walk(step, links, link_step, seen, j, states, START, current)
                n = 1 << j
                cells = 1
            else:
                j = -1
    last_cell = min(limit, cells + pause)
    while cells < last_cell and n <= horizon:
        if ladder.grows:
            reach = weighted(rows, BOUND, -1, states, current)
            band = max(band, band_factor * EPSILON * (reach + abs(offset)))
        low_flight = n == carried_to and value <= LOW * band
        if leaping or (j > ladder.smooth and not expanded and not low_flight):
            if general is None and work.codes[LEAP] <= 0:
                work.codes[LEAP] = WANTED_CODE
                break
            rung, before = max(j, wider), leapt if leaping else 0
            if general is None:
                never, j, wide, n, current, cells, band, leapt = leap_by_address(
                    work.codes[LEAP], (ladder, rung, n, current, cells, last_cell, horizon,
                    band_factor, band, touches, before, states)
                )  # fmt: skip
            else:
                never, j, wide, n, current, cells, band, leapt = leap(
                    ladder, rung, n, current, cells, last_cell, horizon,
                    band_factor, band, touches, before, states,
                )  # fmt: skip
            wider = 0
            leaping = wide == 0 and j > ladder.smooth
            if never:
                return NEVER, n, 0.0, 0.0, cells
            if wide == 0:
                value, slope, second = value_and_rates(rows, offset, states, current)
                continue
        if low_flight:
            if general is not None and ladder.apart:
                # the remainder is below the rounding of the carried value
                rest = 1e3 * EPSILON * carried
                wide = taylor_rung(rows, states, current, smallest, min(j + 1, top), rest)
        elif j >= 0 and wide == 0 and not expanded:
            h = smallest * (1 << j)
            # skip rungs whose certificate fails already at the left end of the cell
            while j > 0 and value + h * (0.4 * slope + 0.05 * h * second) <= band:
                j -= 1
                h *= 0.5
            new_value, new_slope, new_second, error = look_ahead(cell, j, states, current)
            new_value += offset
            cells += 1
            margin = band * (1.0 + 0.25 * cells)
            low = quintic_minimum(h, value, slope, second, new_value, new_slope, new_second)
            if low > error + margin:
                walk(step, links, link_step, seen, j, states, current, (current + 1) % SCRATCH)
                current = (current + 1) % SCRATCH
                n += 1 << j
                value = new_value
                slope = new_slope
                second = new_second
                if j < top and low > 32.0 * error:
                    # a longer cell beyond `smooth` only if its certificate may hold
                    j += j < ladder.smooth or value + 0.8 * h * slope > band
                passed += 1
                if passed & 15 == 0:
                    # without touches only a crossing beyond the band counts
                    if tail(ladder, links, states, current) > (band if touches else -band):
                        return NEVER, n, 0.0, 0.0, cells
                    if passed & 31 == 0 and j >= ladder.smooth - 2:
                        j = min(j + HURDLE, top)
                continue
            if general is not None and ladder.apart:
                # fast exponentials that have decayed do not limit the Taylor polynomial
                wide = taylor_rung(rows, states, current, smallest, max(j, wider), band)
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
                # jump to the last node before the estimated root, if the cell up to it is certified
                jumped = propagate_steps(step, links, link_step, n + m, states, current, 0, seen)
                expand(ladder.generator, rows, offset, states, jumped, c)
                part = m * smallest / h
                error *= part * part * part * part * part * part
                h *= part
                low = quintic_minimum(h, value, slope, second, c[0], c[1], 2.0 * c[2])
                if low <= error + margin:
                    j -= 1
                    continue
                n += m
                expanded = True
                current = jumped
        # the smallest cell, or the first one: Taylor polynomial at its state
        first = 0
        if not expanded:
            current = propagate_steps(step, links, link_step, n, states, current, 0, seen)
            if general is not None and ladder.apart:
                expand_apart(ladder, states, current, c)
            else:
                expand(ladder.generator, rows, offset, states, current, c)
        expanded = False
        threshold = band
        raised = 0.0
        carries = n == carried_to
        if n == 0 and order > 0:
            first = order
            carries = True
            if order == 1:
                c[1] = rate
            threshold = 8.0 * EPSILON * abs(c[first])
        else:
            if carries:
                # the carried value has only the rounding errors of its changes since the start
                c[0] = carried
                speeds = weighted(rows, 2, -1, states, current)
                lost = EPSILON * (band_factor * speeds * n * smallest + 8.0 * carried)
                threshold = min(band, lost)
            if c[0] <= threshold:
                # f is inside the band, and certainly has no crossing so far: from here on only a
                # crossing beyond the band counts
                if stays_in_band(ladder, links, states, current, threshold):
                    return NEVER, n, 0.0, 0.0, cells
                if n == 0 and touches:
                    # the start is positive, but may be tiny
                    c[0] = max(c[0], SMALLEST)
                    threshold = 8.0 * EPSILON * c[0]
                    carries = True
                else:
                    if n == 0:
                        c[0] = max(c[0], -threshold)
                    raised = max(2.0 * threshold, SMALLEST - c[0])
                    c[0] += raised
                    carries = False
        h = smallest * (1 << wide)
        outcome, e, slope = polynomial_first_root(c, first, h, threshold)
        if outcome == TOUCH and not touches:
            # f may rise again, and cross beyond the band, in the same cell
            c[first] += 4.0 * threshold
            raised += 4.0 * threshold
            outcome, e, slope = polynomial_first_root(c, first, h, threshold)
        cells += 1
        if outcome == ROOT and raised > 0.0:
            if n > 0 and n != carried_to and c[0] < raised and c[1] < 0.0:
                # the band is wide: f took several cells to cross it
                n = _last_above(ladder, links, n, states)
                e = smallest
                current = propagate_steps(step, links, link_step, n, states, current, 0, seen)
                if general is not None and ladder.apart:
                    expand_apart(ladder, states, current, c)
                else:
                    expand(ladder.generator, rows, offset, states, current, c)
                c[0] += raised
            e = _lowered(c, first, raised, e, -smallest if n > 0 else 0.0)
        if outcome == ROOT or (outcome == TOUCH and touches):
            for _ in range(first):
                slope *= e
            m = int(e / smallest)
            slots = states.shape[2]
            if m > 0 or seen < slots:
                n += m
                e -= m * smallest
                current = propagate_steps(step, links, link_step, n, states, current, 0, slots)
            shift(ladder.generator, e, states, current, FOUND, 0, slots)
            if general is not None and ladder.links.shape[0] > 0:
                shift_linked(ladder, e, states, current, FOUND)
            if first == 0 and outcome == ROOT:
                # the state gives a more accurate slope than the derivative of the polynomial
                slope = value_and_rates(rows, offset, states, FOUND)[1]
            return outcome, n, e, slope, cells
        # no root in this cell: continue at its end
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
        wider = min(wide + 1, top) if ladder.apart else 0
        wide = 0
    if cells < limit and n <= horizon:
        places[0] = 1
        places[1], places[2], places[3], places[4], places[5] = n, cells, current, j, wide
        places[6], places[7], places[8], places[9] = wider, carried_to, passed, leapt
        places[10] = 1 if leaping else 0
        levels[0], levels[1], levels[2], levels[3], levels[4] = value, slope, second, band, carried
        return PAUSED, n, 0.0, 0.0, cells
    if horizon < FOREVER and n > horizon:
        return BEYOND, n, 0.0, 0.0, cells
    return LIMIT, n, 0.0, 0.0, cells


@kernel()
def plain(ladder: Ladder) -> bool:
    """Whether no seen slot holds two separate numbers, or is driven by another."""
    return not ladder.apart and ladder.links.shape[0] == 0


@kernel(entry=True)
def search(
    ladder: Ladder,
    order: int,
    rate: float,
    band_factor: float,
    touches: bool,
    limit: int,
    pause: int,
    horizon: int,
    work: Workspace,
) -> tuple[int, int, float, float, int]:
    """Call `first_root` for any sum from Python, or by its address."""
    return first_root(ladder, order, rate, band_factor, touches, limit, pause, horizon, work, 0)


search_by_address = by_address(search, int, int, float, float, int)
"""Calls `search` by its address."""
