"""Kernel that proves the stability of an orbit by norms, without eigenvalues."""

from __future__ import annotations

import math

import numpy as np

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.systems.impact.variational.tangent_kernels import acceleration, fill_flight, fly, jump

TOLERANCE = 1e-6
"""Largest recurrence error: of the last state, relative to it, and of its time, in periods."""

REPETITIONS, SQUARINGS = 3, 10
"""Least number of periods in the motion; largest number of squarings of the derivative over one."""

ROUNDING = 1e-12
"""Relative error of the derivative for each impact, in its norm: far more than rounding."""

ROOM = 100.0
"""Multipliers must be below 1 - 1/ROOM in modulus. All later changes from period to period then sum
up to at most ROOM times the last one."""


@kernel()
def _period_of(time: Array, speed: Array, states: Array, turn: float) -> int:
    """Least number of impacts in whole forcing periods until the last state recurs, or 0."""
    last = time.shape[0] - 1
    for n in range(1, (last + 1) // REPETITIONS + 1):
        turns = (time[last] - time[last - n]) / turn
        whole = np.rint(turns)
        if whole == 0.0 or abs(turns - whole) > TOLERANCE:
            continue
        apart = (speed[last] - speed[last - n]) ** 2
        size = speed[last] ** 2
        for row in range(2):
            for i in range(states.shape[2]):
                apart += (states[last, row, i] - states[last - n, row, i]) ** 2
                size += states[last, row, i] ** 2
        if apart <= TOLERANCE * TOLERANCE * size:
            return n
    return 0


@kernel(reorder=True)
def _norm(matrix: Array, other: Array, part: float) -> float:
    """Norm of a matrix minus a part of another one."""
    total = 0.0
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[0]):
            total += (matrix[i, j] - part * other[i, j]) ** 2
    return math.sqrt(total)


@kernel(reorder=True)
def _square(matrix: Array, out: Array) -> None:
    for i in range(matrix.shape[0]):
        out[i] = 0.0
        for k in range(matrix.shape[0]):
            for j in range(matrix.shape[0]):
                out[i, j] += matrix[i, k] * matrix[k, j]


@kernel(entry=True)
def settled(
    time: Array,
    speed: Array,
    states: Array,
    turn: float,
    generator: Array,
    bend: Array,
    unit: Array,
    restitution: float,
    vectors: Array,
    block: Array,
    frames: Array,
) -> bool:
    """Whether a motion recurs and norms prove that its disturbances decay; false if not proved.

    Let A be the derivative over the last period, and B that over the period before. The derivative
    of the orbit itself differs from A by no more than a geometric series of the difference of A and
    B, as for `OrbitLabel.multiplier`. If the norm of its 2^k-th power is below 1, all multipliers
    are inside the unit circle.

    Parameters
    ----------
    time, speed, states
        (m,), (m,) and (m, 2, slots) of the impacts, with free flights between them.
    turn
        Period of the forcing.
    generator
        (4, N) of the modes.
    bend, unit
        (2, seen) row of the acceleration of the gap, and (2, slots) a unit kick.
    vectors
        (4, 2N), as for `stretch`.
    block
        (1, 4, N) buffer.
    frames
        (2, 2N, 2N) buffer.
    """
    n, end = _period_of(time, speed, states, turn), time.shape[0]
    if n == 0:
        return False
    kick = -(1.0 + restitution)
    for part in range(2):
        frames[part] = 0.0
        for i in range(frames.shape[1]):
            frames[part, i, i] = 1.0
        for k in range(end - (part + 1) * n, end - part * n):
            rate = -speed[k] / restitution
            if not rate < 0.0:
                return False
            before = acceleration(bend, unit, states, k, kick * rate)
            fill_flight(generator, time[k] - time[k - 1], block)
            fly(block, 0, frames[part])
            jump(vectors, -kick * before / rate, kick, kick, frames[part])
    size = _norm(frames[0], frames[1], 0.0)
    error = ROOM * _norm(frames[0], frames[1], 1.0) + ROUNDING * n * size
    limit = 1.0 - 1.0 / ROOM
    for k in range(SQUARINGS + 1):
        if not size + error < 1e100:
            return False
        if size + error < limit:
            return True
        now = 1 - k % 2
        _square(frames[1 - now], frames[now])
        error *= 2.0 * size + error
        size = _norm(frames[now], frames[now], 0.0)
        limit *= limit
    return False
