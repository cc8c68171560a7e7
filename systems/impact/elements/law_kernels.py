"""Kernels of impact laws: restitution as a function of the approach velocity, sums of bounces.

A law is a program: the address of its machine code, and the numbers (k,) that this code uses.
"""

from __future__ import annotations

import math
from typing import Any

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.systems.symbolic.call_kernels import call

LIMIT, SCALE, EXPONENT, NEXT_SCALE, NEXT_EXPONENT = range(5)
"""Places in `ImpactLaw.tail`: r(0+), then the terms of r = 1 - scale u^exponent + next_scale
u^next_exponent for r(0+) = 1. The scale is 0 where these terms are not known."""

BOUNCES, LEADING = 1 << 20, 4096
"""Largest number of bounces in a sum, and the number after which the asymptotic series replaces the
sum, if r(0+) = 1."""

NEGLIGIBLE, _LARGEST = 2.0**-56, 0.01
"""Velocity, relative to the first one, below which bounces are negligible. Largest x at which
`leading_sums` is used: its relative error is x^2; after `LEADING` bounces x = 1/(4096 p), with the
exponent p."""


@kernel()
def evaluate(code: Any, numbers: Array, velocity: float, buffer: Array) -> float:
    """Value of a program at a velocity; the buffer (1,) is modified in place."""
    buffer[0] = velocity
    call(code, buffer, numbers, buffer)
    return float(buffer[0])


@kernel()
def bounce_sums(
    code: Any, numbers: Array, tail: Array, slowed: float, u: float, buffer: Array
) -> tuple[float, float, float]:
    """Sums of v/u and (v/u)^3 over all bounces, and the largest restitution among them.

    Here v is the velocity at the begin of a bounce, and u that of the first bounce. With friction a
    bounce ends with the velocity `slowed` v. The sums are infinite if the bounces do not end, or if
    their end is not known. For a law r = 1 - x with x = C v^p, the sum from v on is v s(x), where
    s(x) = 1 + (1 - x) s(x (1 - x)^p): s = 1/((1 - p) x) - p/2 - p x/6 + O(x^2).
    """
    powers = tail[LIMIT] * slowed >= 1.0
    if powers and (tail[SCALE] <= 0.0 or tail[EXPONENT] >= 1.0):
        return math.inf, math.inf, 1.0
    first = 0.0
    cubes = 0.0
    most = 0.0
    v = u
    for n in range(BOUNCES):
        part = v / u
        if part <= NEGLIGIBLE * (1.0 if powers else 1.0 - tail[LIMIT] * slowed):
            return first, cubes, most
        if powers and n == LEADING:
            series, of_cubes = leading_sums(tail, v)
            return first + part * series, cubes + part**3 * of_cubes, most
        first += part
        cubes += part * part * part
        r = evaluate(code, numbers, slowed * v, buffer)
        most = max(most, r)
        v *= slowed * r
        if not 0.0 <= v < math.inf:
            break
    return math.inf, math.inf, 1.0


@kernel()
def leading_sums(tail: Array, v: float) -> tuple[float, float]:
    """Sums of `bounce_sums` from the velocity v on, relative to v, by their asymptotic series."""
    c, p = tail[SCALE], tail[EXPONENT]
    x = c * v**p
    if x > _LARGEST:
        return math.inf, math.inf
    by_next = 1.0 + tail[NEXT_EXPONENT] - 2.0 * p
    series = 1.0 / ((1.0 - p) * x) - p / 2.0 - p * x / 6.0
    series += tail[NEXT_SCALE] / (c * c) * v ** (by_next - 1.0) / by_next
    return series, 1.0 / ((3.0 - p) * x) + (2.0 - p) / 6.0


@kernel(entry=True)
def sum_all(
    code: Any, numbers: Array, tail: Array, velocities: Array, buffer: Array, found: Array
) -> None:
    """First sum of `bounce_sums` for velocities (n,); found (n,) is modified in place."""
    for i in range(velocities.shape[0]):
        found[i] = bounce_sums(code, numbers, tail, 1.0, velocities[i], buffer)[0]
