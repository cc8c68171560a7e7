"""Kernels of chatter by an impact law that depends on the approach velocity."""

from __future__ import annotations

import math
from typing import Any

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import Ladder
from dynkit.systems.impact.elements.law_kernels import (
    BOUNCES,
    EXPONENT,
    LEADING,
    LIMIT,
    NEGLIGIBLE,
    SCALE,
    bounce_sums,
    evaluate,
    leading_sums,
)
from dynkit.systems.impact.simulation.contact_kernels import (
    PLACE,
    SMALLEST,
    Tables,
    bounce_terms,
    chatter_completes,
    drag,
    place_error,
)


@kernel()
def chatter_by_law(
    tables: Tables,
    k: int,
    gap: Ladder,
    u: float,
    second: float,
    third: float,
    fourth: float,
    buffer: Array,
) -> tuple[bool, float, float, float]:
    """Whether a chatter completes, as `chatter_completes`, for the impact law of guard `k`.

    Then the duration of its bounces, the time integral of the gap over them, and the sum of the
    velocities at which they begin; zeros if the chatter does not complete.
    """
    none = False, 0.0, 0.0, 0.0
    drop, tolerance = tables.drop[k], tables.tolerance
    a = -second
    if a - drop <= 0.0 or (tolerance == 0.0 and u > SMALLEST):
        return none
    slowed = math.sqrt(1.0 - drop / a) if drop > 0.0 else 1.0
    fall = a * (2.0 * slowed / (1.0 + slowed))
    once = (2.0 / 3.0) * u * u * u / (a * fall)
    if u >= SMALLEST and tables.coupling[k] * once > tolerance:
        return none
    law = tables.law[k]
    code, numbers = tables.codes[law], tables.numbers[law]
    tail, kick = tables.tails[law], tables.kick[k]
    powers = tail[LIMIT] * slowed >= 1.0
    if powers and tail[SCALE] > 0.0 and tail[EXPONENT] < 1.0:
        # An early test, by the leading term of half of the duration.
        half = u / (a * (1.0 - tail[EXPONENT]) * tail[SCALE] * u ** tail[EXPONENT])
        if tolerance > 0.0 and _late(abs(third), 2.0 * half, a) > PLACE * tolerance:
            return none
    first, cubes, most = bounce_sums(code, numbers, tail, slowed, u, buffer)
    if not first < math.inf:
        return none
    lost = once * cubes if u >= SMALLEST else 0.0
    error = tables.coupling[k] * lost
    if not powers:
        if not chatter_completes(
            gap, kick, most, drop, tables.hold[k], tolerance, u, second, third, fourth, error
        ):
            return none
    else:
        # A bounce loses the part 1 - r of its velocity: the relative change of the acceleration
        # within the bounce must be at most a quarter of this part.
        rest = 4.0 * u * first / a
        change = abs(third) + abs(drag(gap, kick)) * a + 0.5 * fourth * rest
        r = evaluate(code, numbers, u, buffer)
        if error > tolerance or rest > gap.window or change * rest > 0.25 * a:
            return none
        if change * (2.0 * u / a) > 0.25 * (1.0 - r) * a:
            return none
        place = place_error(gap, kick, u, rest, second, third)
        if tolerance > 0.0 and max(place, _late(change, rest, a)) > PLACE * tolerance:
            return none
    rest = _rest(gap, kick, code, numbers, tail, drop, u, second, third, buffer)
    return True, rest, lost, u * first


@kernel()
def _late(change: float, rest: float, a: float) -> float:
    """Error of the duration `rest`, if the acceleration `a` changes at the rate `change`.

    The terms up to second order are included in `rest`; this is the size of the next one.
    """
    return (change * rest / a) ** 2 * rest


@kernel()
def _rest(
    gap: Ladder,
    kick: Array,
    code: Any,
    numbers: Array,
    tail: Array,
    drop: float,
    u: float,
    second: float,
    third: float,
    buffer: Array,
) -> float:
    """Duration of the bounces from velocity `u` on by an impact law, summed bounce by bounce.

    It is accurate to second order, as that of `chatter_rest`.
    """
    once, p, q, v, w, s, a, b = bounce_terms(drag(gap, kick), drop, u, second, third)
    powers = tail[LIMIT] * s >= 1.0
    time = 0.0
    rate = u
    for n in range(BOUNCES):
        if rate <= NEGLIGIBLE * u * (1.0 if powers else 1.0 - tail[LIMIT] * s):
            break
        if powers and n == LEADING:
            time += 2.0 * rate * leading_sums(tail, rate)[0] / (a + b * time)
            break
        begun = time
        time += once * rate + p * rate * rate + q * rate * begun
        rate *= s * (1.0 + v * rate + w * begun)
        rate *= evaluate(code, numbers, rate, buffer)
    return time
