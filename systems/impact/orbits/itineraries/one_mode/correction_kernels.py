"""Kernel of Newton's method with a parameter of the table, for impacts of one mode."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import Ladder, Workspace
from dynkit.systems.impact.modes.transition_kernels import repeat_kicks
from dynkit.systems.impact.orbits.itineraries.one_mode.response_kernels import Assembled, assemble


class Family(NamedTuple):
    """Impacts of one mode with one parameter p; the numbers of the table are linear in p.

    Attributes
    ----------
    low, high : smallest and largest p
    clock : (2,) constant part, and factor of p, of the frequency of the phase
    numbers : (2, e, 4) constant parts, and factors of p, of the numbers of `assemble`
    turn : phase of a period
    sides : (n,) the number of the stop of each impact
    alone : slots of the modes, which have no links
    kicks, rows : (e, 2, slots), (e, 4, 2 slots) as in `Windows`
    units : (2n,) units of the equations
    """

    low: float
    high: float
    clock: Array
    numbers: Array
    turn: float
    sides: NDArray[np.intp]
    alone: NDArray[np.intp]
    kicks: Array
    rows: Array
    units: Array


class Buffers(NamedTuple):
    """Buffers of the correction, modified in place.

    Attributes
    ----------
    out : of `assemble`
    own, joint, kicked, moved, period : of `repeat_kicks`
    numbers : (e, 4)
    left, y, step : (2n,), (2n + 1,), (2n + 1,)
    matrix, targets : (2n + 1, 2n + 1), (2n + 1, 2)
    """

    out: Assembled
    own: Array
    joint: Array
    kicked: Array
    moved: Array
    period: Array
    numbers: Array
    left: Array
    y: Array
    step: Array
    matrix: Array
    targets: Array


def buffers_of(family: Family) -> Buffers:
    """Uninitialized buffers for a family."""
    q, shape, empty = 2 * len(family.sides) + 1, family.kicks.shape, np.empty
    repeated = np.zeros((1, 2, 2, shape[2])), empty((1, 2, 0, 0)), empty(shape), empty(shape)
    out, numbers = Assembled.of(len(family.sides), shape[1:]), empty(family.numbers.shape[1:])
    own = empty(q - 1), empty(q), empty(q), empty((q, q)), empty((q, 2))
    return Buffers(out, *repeated, empty(1), numbers, *own)


@kernel()
def _evaluate(ladder: Ladder, work: Workspace, family: Family, y: Array, b: Buffers) -> float:
    """Compute the residual at y; return its largest modulus, or -1 where it is not defined."""
    n, p = len(family.sides), y[y.shape[0] - 1]
    if not family.low <= p <= family.high:
        return -1.0
    clock = family.clock[0] + p * family.clock[1]
    for e in range(family.numbers.shape[1]):
        for k in range(4):
            b.numbers[e, k] = family.numbers[0, e, k] + p * family.numbers[1, e, k]
    b.period[0] = family.turn / clock
    if not repeat_kicks(
        ladder, work, family.alone, b.period, family.kicks, b.own, b.joint, b.kicked, b.moved
    ):
        return -1.0
    assemble(
        ladder,
        work,
        family.rows,
        b.kicked,
        b.moved,
        family.sides,
        b.numbers,
        y[:n],
        y[n : 2 * n],
        clock,
        family.turn,
        b.out,
    )
    size = 0.0
    for i in range(2 * n):
        b.left[i] = b.out.left[i] / family.units[i]
        if not abs(b.left[i]) <= size:
            size = abs(b.left[i])
            if not size < math.inf:
                return math.inf
    return size


@kernel()
def _fill(family: Family, y: Array, scale: Array, row: Array, b: Buffers) -> None:
    """Fill the bordered Jacobian in scaled unknowns, and its two right-hand sides."""
    n = len(family.sides)
    q = 2 * n + 1
    p = y[q - 1]
    clock = family.clock[0] + p * family.clock[1]
    for i in range(n):
        side = family.sides[i]
        by = family.numbers[1, side]
        sine, cosine = math.sin(y[i]), math.cos(y[i])
        r = 1.0 + b.numbers[side, 3]
        gap = by[0] * sine + by[1] * cosine + by[2]
        rate = clock * (by[0] * cosine - by[1] * sine) - by[3] / (r * r) * y[n + i]
        b.matrix[i, q - 1] = gap + family.clock[1] * b.out.by_frequency[i]
        b.matrix[n + i, q - 1] = rate + family.clock[1] * b.out.by_frequency[n + i]
    for i in range(q - 1):
        for j in range(q - 1):
            b.matrix[i, j] = b.out.jacobian[i, j] * scale[j] / family.units[i]
        b.matrix[i, q - 1] *= scale[q - 1] / family.units[i]
        b.targets[i, 0], b.targets[i, 1] = -b.left[i], 0.0
    for j in range(q):
        b.matrix[q - 1, j] = row[j]
    b.targets[q - 1, 0], b.targets[q - 1, 1] = 0.0, 1.0


@kernel()
def solve(matrix: Array, targets: Array) -> float:
    """Solve by Gaussian elimination with row exchanges; both arrays are modified in place.

    Returns the sign of the determinant; zero where the matrix is singular.
    """
    n, sign = matrix.shape[0], 1.0
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        pivot = matrix[best, k]
        if not 0.0 < abs(pivot) < math.inf:
            return 0.0
        if best != k:
            sign = -sign
            for j in range(k, n):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
            for j in range(targets.shape[1]):
                targets[k, j], targets[best, j] = targets[best, j], targets[k, j]
        if pivot < 0.0:
            sign = -sign
        for i in range(k + 1, n):
            part = matrix[i, k] / pivot
            if part != 0.0:
                for j in range(k + 1, n):
                    matrix[i, j] -= part * matrix[k, j]
                for j in range(targets.shape[1]):
                    targets[i, j] -= part * targets[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(targets.shape[1]):
            for i in range(k + 1, n):
                targets[k, j] -= matrix[k, i] * targets[i, j]
            targets[k, j] /= matrix[k, k]
            if not abs(targets[k, j]) < math.inf:
                return 0.0
    return sign


@kernel(entry=True)
def correct(
    ladder: Ladder,
    work: Workspace,
    family: Family,
    y: Array,
    scale: Array,
    row: Array,
    level: float,
    acceptable: float,
    short: float,
    halvings: int,
    history: Array,
    tangent: Array,
    b: Buffers,
) -> tuple[int, float]:
    """Take the steps of `dynkit.orbits.newton.correct` along a row.

    Parameters
    ----------
    ladder, work
        propagators and buffers of the free motion; buffers are modified in place
    y
        (2n + 1,) the guess, modified in place: phases, impulses and the parameter
    scale, row
        (2n + 1,)
    level, acceptable, short, halvings
        as in `newton.correct`; after a last step below `short` the direction is not recomputed
    history
        (steps + 1,) modified in place: the largest residuals
    tangent
        (2n + 1,) modified in place: direction of the curve along the row

    Returns
    -------
    int, float
        Number of residuals in the history, zero where there is no solution; and the sign of the
        bordered determinant.
    """
    q, count, turn, moved = y.shape[0], 1, 0.0, math.inf
    size = _evaluate(ladder, work, family, y, b)
    history[0] = size
    for taken in range(history.shape[0]):
        if not 0.0 <= size < math.inf:
            return 0, 0.0
        if size <= level and moved < short:
            break
        # also at the solution, for the direction of the curve
        _fill(family, y, scale, row, b)
        turn = solve(b.matrix, b.targets)
        if turn == 0.0:
            return 0, 0.0
        if size <= level or taken == history.shape[0] - 1:
            break
        length, there = 1.0, size
        for i in range(q):
            b.step[i] = b.targets[i, 0] * scale[i]
        for _ in range(halvings + 1):
            for i in range(q):
                b.y[i] = y[i] + length * b.step[i]
            there = _evaluate(ladder, work, family, b.y, b)
            if there < 0.0:
                return 0, 0.0
            if there < size or size <= acceptable:
                break
            length *= 0.5
        if not there < size:
            break
        if there > 0.5 * size and there <= acceptable:
            level = acceptable
        moved = 0.0
        for i in range(q):
            y[i] = b.y[i]
            moved += (length * b.targets[i, 0]) ** 2
        moved = math.sqrt(moved)
        size = there
        history[count] = size
        count += 1
    square = 0.0
    for i in range(q):
        square += b.targets[i, 1] ** 2
    for i in range(q):
        tangent[i] = b.targets[i, 1] / math.sqrt(square)
    return (count if size <= acceptable else 0), turn
