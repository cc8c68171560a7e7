"""Kernels of the tangent map: stretching of a frame of directions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array

Indices = NDArray[np.intp]

LOST = 1e-6
"""Ratio of squared lengths after and before orthogonalisation, below which it is repeated."""


@kernel(reorder=True)
def _multiply(matrix: Array, frame: Array, scratch: Array) -> None:
    """Multiply each row of the frame by the matrix, in place."""
    n = frame.shape[1]
    for j in range(frame.shape[0]):
        for i in range(n):
            total = 0.0
            for k in range(n):
                total += matrix[i, k] * frame[j, k]
            scratch[i] = total
        for i in range(n):
            frame[j, i] = scratch[i]


@kernel(reorder=True)
def fly(blocks: Array, step: int, frame: Array) -> None:
    """Multiply each row of the frame by the 2x2 blocks of a flight, one for each pair."""
    pairs = blocks.shape[2]
    for j in range(frame.shape[0]):
        for i in range(pairs):
            a = frame[j, i]
            b = frame[j, pairs + i]
            frame[j, i] = blocks[step, 0, i] * a + blocks[step, 1, i] * b
            frame[j, pairs + i] = blocks[step, 2, i] * a + blocks[step, 3, i] * b


@kernel(reorder=True)
def jump(vectors: Array, bend: float, kick: float, push: float, frame: Array) -> None:
    """Add the effect of an impact, b (bend c + kick c') + push A b c: see `stretch`."""
    n = frame.shape[1]
    for j in range(frame.shape[0]):
        place = 0.0
        speed = 0.0
        for i in range(n):
            place += vectors[2, i] * frame[j, i]
            speed += vectors[3, i] * frame[j, i]
        by_kick = bend * place + kick * speed
        by_rate = push * place
        for i in range(n):
            frame[j, i] += by_kick * vectors[0, i] + by_rate * vectors[1, i]


@kernel(reorder=True)
def _project(frame: Array, j: int) -> float:
    """Subtract from row `j` its parts along earlier rows; return its squared length."""
    n = frame.shape[1]
    for row in range(j):
        part = 0.0
        for i in range(n):
            part += frame[row, i] * frame[j, i]
        for i in range(n):
            frame[j, i] -= part * frame[row, i]
    square = 0.0
    for i in range(n):
        square += frame[j, i] * frame[j, i]
    return square


@kernel(reorder=True)
def _refill(frame: Array, j: int) -> None:
    """Replace row `j` by the unit vector that is farthest from the rows before it."""
    n = frame.shape[1]
    best = 0
    most = -1.0
    for i in range(n):
        rest = 1.0
        for row in range(j):
            rest -= frame[row, i] * frame[row, i]
        if rest > most:
            best = i
            most = rest
    for i in range(n):
        frame[j, i] = 0.0
    frame[j, best] = 1.0


@kernel(reorder=True)
def _normalise(frame: Array, j: int, square: float) -> None:
    """Divide row `j` by its length."""
    scale = 1.0 / math.sqrt(square)
    for i in range(frame.shape[1]):
        frame[j, i] *= scale


@kernel()
def _orthonormalise(frame: Array, lost: int, logs: Array, step: int) -> None:
    """Gram-Schmidt orthonormalisation of the rows of the frame, repeated once where needed.

    Row 2N - `lost` and the rows after it have no length left: their logarithm is -inf, and they get
    new directions. Two passes suffice: W. Kahan, in B. N. Parlett, The Symmetric Eigenvalue
    Problem, SIAM 1998, section 6-9.
    """
    n = frame.shape[1]
    for j in range(frame.shape[0]):
        before = 0.0
        for i in range(n):
            before += frame[j, i] * frame[j, i]
        square = 0.0
        if j < n - lost:
            square = _project(frame, j)
            if square <= LOST * before:
                square = _project(frame, j)
        if square > 0.0:
            logs[step, j] = 0.5 * math.log(square)
        else:
            logs[step, j] = -math.inf
            _refill(frame, j)
            _project(frame, j)
            square = _project(frame, j)
        _normalise(frame, j, square)


@kernel(entry=True)
def strike(vectors: Array, sides: Indices, jumps: Array, frames: Array) -> None:
    """Multiply the rows of each frame by the saltation matrix of an impact: see `stretch`.

    Parameters
    ----------
    vectors
        (e, 4, 2N) of each stop.
    sides
        (n,) number of the stop of each impact.
    jumps
        (n, 2): bend, and the common value of kick and push.
    frames
        (n, k, 2N) modified in place.
    """
    for step in range(sides.shape[0]):
        bend, kick = jumps[step]
        jump(vectors[sides[step]], bend, kick, kick, frames[step])


@kernel(entry=True)
def stretch(
    blocks: Array,
    which: Indices,
    dense: Array,
    vectors: Array,
    jumps: Array,
    lost: Indices,
    frame: Array,
    scratch: Array,
    logs: Array,
) -> None:
    """Multiply a frame of disturbances by steps; each is a matrix, a flight and an impact.

    A disturbance (2N,) of the free state holds the first numbers of all pairs, then the second
    ones. An impact multiplies it by 1 + b (bend c + kick c') + push A b c; push equals kick if r is
    a constant.

    Parameters
    ----------
    blocks
        (n, 4, N) entries 11, 12, 21, 22 of the flights' matrices.
    which, dense
        (n,) and (m, 2N, 2N): number of the matrix that precedes a flight, -1 for none.
    vectors
        (4, 2N): b, A b, c, c'.
    jumps
        (n, 3): bend, kick and push.
    lost
        (n,) number of directions that a step maps to zero.
    frame
        (k, 2N) orthonormal rows, modified in place.
    scratch
        (2N,) modified in place.
    logs
        (n, k) logarithms of the stretching of each row, modified in place; empty if the rows are
        only multiplied, and not orthonormalised.
    """
    for step in range(which.shape[0]):
        if which[step] >= 0:
            _multiply(dense[which[step]], frame, scratch)
        fly(blocks, step, frame)
        jump(vectors, jumps[step, 0], jumps[step, 1], jumps[step, 2], frame)
        if logs.shape[0] > 0:
            _orthonormalise(frame, lost[step], logs, step)
