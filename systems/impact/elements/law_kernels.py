"""Kernels of impact laws: restitution as a function of the approach velocity, and chatter by it.

A law is a program: rows (operation, two or three earlier rows or a number), of which each gives one
number and the last one the result. So no law, and no number in it, is compiled.
"""

from __future__ import annotations

import math

import numpy as np

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import Ladder
from dynkit.systems.impact.simulation.contact_kernels import (
    PLACE,
    SMALLEST,
    Tables,
    bounce_terms,
    chatter_completes,
    drag,
    place_error,
)

(
    CONSTANT,
    VELOCITY,
    ADD,
    MULTIPLY,
    POWER,
    EXP,
    LOG,
    SIN,
    COS,
    TANH,
    ATAN,
    LESS,
    SELECT,
) = range(13)
"""Operations: LESS gives 1 or 0, SELECT one of two numbers by whether a third one is not 0."""

REGISTERS = 64
"""Rows that a program may have."""

LIMIT, SCALE, EXPONENT, NEXT_SCALE, NEXT_EXPONENT = range(5)
"""Of slow impacts: r(0+); where it is 1 r = 1 - scale u^exponent + (the next term), scale 0 where
that is not known."""

BOUNCES, LEADING = 1 << 20, 4096
"""Bounces that are summed up at most, and after which sums go on by their asymptotic series."""

NEGLIGIBLE, _LARGEST = 2.0**-56, 0.01
"""Velocities less than this part of the first count no more; and the largest x of `_leading`, which
misses x^2 of itself: after so many bounces x = 1/(4096 p) for the exponent p."""


@kernel()
def evaluate(program: Array, velocity: float, registers: Array) -> float:
    """The number that a program makes of a velocity; the registers are modified in place."""
    value = 0.0
    for i in range(program.shape[0]):
        what = int(program[i, 0])
        if what < 0:
            break
        x = registers[int(program[i, 1])]
        y = registers[int(program[i, 2])]
        if what == CONSTANT:
            value = program[i, 3]
        elif what == VELOCITY:
            value = velocity
        elif what == ADD:
            value = x + y
        elif what == MULTIPLY:
            value = x * y
        elif what == POWER:
            value = x**y
        elif what == EXP:
            value = np.exp(x)
        elif what == LOG:
            value = np.log(x)
        elif what == SIN:
            value = np.sin(x)
        elif what == COS:
            value = np.cos(x)
        elif what == TANH:
            value = np.tanh(x)
        elif what == ATAN:
            value = np.arctan(x)
        elif what == LESS:
            value = 1.0 if x < y else 0.0
        else:
            value = x if registers[int(program[i, 3])] != 0.0 else y
        registers[i] = value
    return value


@kernel(entry=True)
def evaluate_all(program: Array, velocities: Array, registers: Array, found: Array) -> None:
    """`evaluate` of velocities (n,); found (n,) is modified in place."""
    for i in range(velocities.shape[0]):
        found[i] = evaluate(program, velocities[i], registers)


@kernel()
def bounce_sums(
    program: Array, tail: Array, slowed: float, u: float, registers: Array
) -> tuple[float, float, float]:
    """Sums of v/u and its cube over the bounces that leave at v, from u on; the largest r in them.

    Friction makes each of them arrive `slowed` times as fast as it left. Infinite where they have
    no end, or none that is known. With x = C v^p the sums of a law 1 - x go on, from v on, as v
    s(x) where s(x) = 1 + (1 - x) s(x (1 - x)^p): s = 1/((1 - p) x) - p/2 - p x/6 + O(x^2).
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
            series, of_cubes = _leading(tail, v)
            return first + part * series, cubes + part**3 * of_cubes, most
        first += part
        cubes += part * part * part
        r = evaluate(program, slowed * v, registers)
        most = max(most, r)
        v *= slowed * r
        if not 0.0 <= v < math.inf:
            break
    return math.inf, math.inf, 1.0


@kernel()
def _leading(tail: Array, v: float) -> tuple[float, float]:
    """The sums of `bounce_sums` by their asymptotic series, from the velocity v on, over v."""
    c, p = tail[SCALE], tail[EXPONENT]
    x = c * v**p
    if x > _LARGEST:
        return math.inf, math.inf
    by_next = 1.0 + tail[NEXT_EXPONENT] - 2.0 * p
    series = 1.0 / ((1.0 - p) * x) - p / 2.0 - p * x / 6.0
    series += tail[NEXT_SCALE] / (c * c) * v ** (by_next - 1.0) / by_next
    return series, 1.0 / ((3.0 - p) * x) + (2.0 - p) / 6.0


@kernel(entry=True)
def sum_all(program: Array, tail: Array, velocities: Array, registers: Array, found: Array) -> None:
    """The first of `bounce_sums` of velocities (n,); found (n,) is modified in place."""
    for i in range(velocities.shape[0]):
        found[i] = bounce_sums(program, tail, 1.0, velocities[i], registers)[0]


@kernel()
def chatter_by_law(
    tables: Tables,
    k: int,
    gap: Ladder,
    u: float,
    second: float,
    third: float,
    fourth: float,
    registers: Array,
) -> tuple[bool, float, float, float]:
    """As `chatter_completes`, by the law of guard `k`, and where it does: what is left out.

    The time that the bounces take, the time integral of the gap, and the sum of their velocities.
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
    program, tail, kick = tables.programs[law], tables.tails[law], tables.kick[k]
    powers = tail[LIMIT] * slowed >= 1.0
    if powers and tail[SCALE] > 0.0 and tail[EXPONENT] < 1.0:
        # Half of the time by its leading term, before it is worked out.
        half = u / (a * (1.0 - tail[EXPONENT]) * tail[SCALE] * u ** tail[EXPONENT])
        if tolerance > 0.0 and _late(abs(third), 2.0 * half, a) > PLACE * tolerance:
            return none
    first, cubes, most = bounce_sums(program, tail, slowed, u, registers)
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
        # Each bounce loses 1 - r of its velocity: the acceleration must change by less in it.
        rest = 4.0 * u * first / a
        change = abs(third) + abs(drag(gap, kick)) * a + 0.5 * fourth * rest
        r = evaluate(program, u, registers)
        if error > tolerance or rest > gap.window or change * rest > 0.25 * a:
            return none
        if change * (2.0 * u / a) > 0.25 * (1.0 - r) * a:
            return none
        place = place_error(gap, kick, u, rest, second, third)
        if tolerance > 0.0 and max(place, _late(change, rest, a)) > PLACE * tolerance:
            return none
    rest = _rest(gap, kick, program, tail, drop, u, second, third, registers)
    return True, rest, lost, u * first


@kernel()
def _late(change: float, rest: float, a: float) -> float:
    """What terms of second order leave out of a time, where a changes at a rate."""
    return (change * rest / a) ** 2 * rest


@kernel()
def _rest(
    gap: Ladder,
    kick: Array,
    program: Array,
    tail: Array,
    drop: float,
    u: float,
    second: float,
    third: float,
    registers: Array,
) -> float:
    """As `chatter_rest`, by a law: bounce by bounce."""
    once, p, q, v, w, s, a, b = bounce_terms(gap, kick, drop, u, second, third)
    powers = tail[LIMIT] * s >= 1.0
    time = 0.0
    rate = u
    for n in range(BOUNCES):
        if rate <= NEGLIGIBLE * u * (1.0 if powers else 1.0 - tail[LIMIT] * s):
            break
        if powers and n == LEADING:
            time += 2.0 * rate * _leading(tail, rate)[0] / (a + b * time)
            break
        begun = time
        time += once * rate + p * rate * rate + q * rate * begun
        rate *= s * (1.0 + v * rate + w * begun)
        rate *= evaluate(program, rate, registers)
    return time
