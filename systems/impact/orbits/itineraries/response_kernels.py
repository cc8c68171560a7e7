"""Equations of impacts of one mode, and their derivative, from the responses to all impulses."""

from __future__ import annotations

import math

from dynkit.core.jit import kernel
from dynkit.core.validation import Array


@kernel(entry=True, reorder=True)
def assemble(
    rows: Array,
    spread: Array,
    sides: Array,
    numbers: Array,
    phases: Array,
    impulses: Array,
    clock: float,
    responses: Array,
    steady: Array,
    gaps: Array,
    left: Array,
    jacobian: Array,
) -> None:
    """Fill what follows from states at n impacts after unit impulses of each, in place.

    Parameters
    ----------
    rows
        (e, 4, d) products with a state: the gap of a stop, and three derivatives
    spread
        (n, n, d) states at the impacts, rows, after unit impulses, columns
    sides
        (n,) of which stop each impact is
    numbers
        (e, 4) of each stop: steady gap by sine and cosine of the phase, and at rest; restitution
    phases, impulses
        (n,)
    clock
        frequency of the phase
    responses
        (4, n, n) gaps and derivatives after unit impulses
    steady, gaps
        (3, n) of the steady response, and in the whole motion, just after the impacts
    left, jacobian
        (2n,), (2n, 2n) equations, gaps and laws, and their derivative by phases and impulses
    """
    n, d = spread.shape[1], spread.shape[2]
    for i in range(n):
        side = sides[i]
        for j in range(n):
            for order in range(4):
                total = 0.0
                for k in range(d):
                    total += rows[side, order, k] * spread[i, j, k]
                responses[order, i, j] = total
        sine, cosine = math.sin(phases[i]), math.cos(phases[i])
        a, b = numbers[side, 0], numbers[side, 1]
        steady[0, i] = a * sine + b * cosine + numbers[side, 2]
        steady[1, i] = clock * (a * cosine - b * sine)
        steady[2, i] = -clock * clock * (a * sine + b * cosine)
        for order in range(3):
            gaps[order, i] = steady[order, i]
            for j in range(n):
                gaps[order, i] += responses[order, i, j] * impulses[j]
        back = numbers[side, 3] / (1.0 + numbers[side, 3])
        left[i] = gaps[0, i]
        left[n + i] = gaps[1, i] - back * impulses[i]
        for order in range(2):
            row = order * n + i
            # its own impulse moves along with an impact
            own = gaps[order + 1, i]
            for j in range(n):
                part = impulses[j] * responses[order + 1, i, j]
                jacobian[row, j] = -part / clock
                jacobian[row, n + j] = responses[order, i, j]
            jacobian[row, i] += own / clock
        jacobian[n + i, n + i] -= back
