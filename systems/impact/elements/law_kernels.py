"""Kernels of impact laws: restitution as a function of the approach velocity, sums of bounces.

A law is a program: rows (operation, two or three earlier rows or a number), of which each gives one
number and the last one the result. So no law, and no number in it, is compiled.
"""

from __future__ import annotations

import math

import numpy as np

from dynkit.core.jit import kernel
from dynkit.core.validation import Array

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
"""Velocities below this part of the first one are negligible. Largest x of `leading_sums`, whose
error is x^2 of the sum; after so many bounces x = 1/(4096 p) for the exponent p."""


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
            series, of_cubes = leading_sums(tail, v)
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
def leading_sums(tail: Array, v: float) -> tuple[float, float]:
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
