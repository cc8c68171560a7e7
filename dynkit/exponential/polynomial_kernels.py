"""Certified first root of a polynomial."""

from __future__ import annotations

import math

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import DEGREE, EPSILON
from dynkit.exponential.product_kernels import fused

ROOT, TOUCH, NEVER, LIMIT, BEYOND, PAUSED = 0, 1, 2, 3, 4, 5
"""Outcomes: sign change, double root within rounding, no later root, limit of cells reached, no
root up to the horizon, search paused."""


@kernel(inline=True)
def polynomial(c: Array, first: int, e: float) -> tuple[float, float]:
    """Return value and derivative at `e` of the polynomial c[first] + c[first + 1] e + ..."""
    value = c[DEGREE]
    rate = 0.0
    for j in range(DEGREE - 1, first - 1, -1):
        rate = fused(rate, e, value)
        value = fused(value, e, c[j])
    return value, rate


@kernel()
def polish(c: Array, first: int, e: float, low: float, high: float) -> tuple[int, float, float]:
    """Find a root by Newton's method inside a bracket with a change from positive to negative."""
    for _ in range(80):
        value, rate = polynomial(c, first, e)
        if value > 0.0:
            low = e
        elif value < 0.0:
            high = e
        trial = e - value / rate if rate < 0.0 else low
        if trial == e:
            break
        if not low < trial < high:
            if value == 0.0 or not low < 0.5 * (low + high) < high:
                break
            trial = 0.5 * (low + high)
            e = trial
            continue
        change = trial - e
        # the change of the next Newton step is about (curvature / rate) change^2 / 2
        second = 2.0 * abs(c[first + 2]) + 6.0 * abs(c[first + 3]) * e
        # after a change longer than the root the new point keeps the rounding of the old one
        if abs(change) <= trial and second * change * change <= -EPSILON * rate * trial:
            e = trial
            break
        e = trial
    value, rate = polynomial(c, first, e)
    return ROOT, e, rate


@kernel()
def _downhill(c: Array, first: int, e: float, end: float, band: float) -> tuple[int, float, float]:
    """Descend from a point within the band to a crossing or to a minimum within the band.

    The interval is extended slightly: otherwise a crossing at its end could be taken for a minimum.
    If the function still falls at the end, the next cell must be searched: the outcome is NEVER.
    """
    low = e
    high = e
    move = 1e-3 * end
    last = end + move
    value, rate = polynomial(c, first, e)
    if value < -band:
        return polish(c, first, e, 0.0, e)
    while rate < 0.0 and high < last:
        high = min(high + move, last)
        value, rate = polynomial(c, first, high)
        if value < -band:
            return polish(c, first, low, low, high)
    if rate < 0.0:
        return NEVER, end, 0.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        value, rate = polynomial(c, first, middle)
        if value < -band:
            return polish(c, first, e, e, middle)
        if rate < 0.0:
            low = middle
        else:
            high = middle
    return TOUCH, low, 0.0


@kernel()
def polynomial_first_root(
    c: Array, first: int, end: float, band: float
) -> tuple[int, float, float]:
    """Return the first root in (0, `end`] of c[first] + c[first + 1] e + ..., positive at 0.

    From a point x on the left, the root of p(x) + p'(x) e - M e^2/2 with M >= |p''| cannot lie
    beyond a root of p. If the polynomial is below -`band` at 0, the root is at 0.

    Returns
    -------
    outcome : ROOT, TOUCH (a minimum within +-band of zero) or NEVER (above -band on the whole
        interval)
    e : place of the root or of the touching minimum
    slope : derivative there
    """
    slope = c[first + 1]
    power = 1.0
    for j in range(first + 2, DEGREE + 1):
        power *= end
        slope += (j - first) * max(c[j], 0.0) * power
    if slope < 0.0:
        # the polynomial decreases on the whole interval
        value, rate = polynomial(c, first, end)
        if value > band:
            return NEVER, end, 0.0
        if value < -band:
            discriminant = c[first + 1] * c[first + 1] - 4.0 * c[first] * c[first + 2]
            guess = 2.0 * c[first] / (math.sqrt(max(discriminant, 0.0)) - c[first + 1])
            return polish(c, first, min(max(guess, 0.0), end), 0.0, end)
    curvature = 0.0
    power = 1.0
    for j in range(first + 2, DEGREE + 1):
        m = j - first
        curvature += m * (m - 1) * abs(c[j]) * power
        power *= end
    e = 0.0
    for _ in range(400):
        value, rate = polynomial(c, first, e)
        if value <= band:
            break
        if curvature <= 0.0:
            if rate >= 0.0:
                return NEVER, end, 0.0
            e -= value / rate
        else:
            square = rate * rate + 2.0 * curvature * value
            root = math.sqrt(square)
            if square < 1e-280:
                # squares of the smallest numbers underflow
                root = math.hypot(rate, math.sqrt(2.0 * curvature) * math.sqrt(value))
            if rate < 0.0:
                e += 2.0 * value / (root - rate)
            else:
                e += (rate + root) / curvature
        if e > end:
            return NEVER, end, 0.0
    return _downhill(c, first, e, end, band)
