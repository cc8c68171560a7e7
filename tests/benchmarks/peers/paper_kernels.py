"""The paper's algorithm, compiled: closed-form modes, a sampled bracket, Newton's method.

A peer: it is written as the paper describes it, and as a careful user would write it, but nothing
that dynkit adds to it is in here. All modes are y'' + 2 sigma y' + w^2 y = 0.
"""

from __future__ import annotations

import math

from dynkit.core.jit import kernel
from dynkit.core.validation import Array

DONE, BUDGET, FULL, LOST = 0, 1, 2, 3
"""How a simulation ended; `LOST` when Newton's method did not converge."""

_NEWTON = 100
_HALVINGS = 60


@kernel(entry=True)
def motion(square: float, sigma: float, s: float) -> tuple[float, float, float, float]:
    """Rows of the matrix that takes (y, y') over a time s."""
    inner = square - sigma * sigma
    if inner > 0.0:
        root = math.sqrt(inner)
        decay = math.exp(-sigma * s)
        cosine = decay * math.cos(root * s)
        sine = decay * math.sin(root * s) / root
        return cosine + sigma * sine, sine, -square * sine, cosine - sigma * sine
    root = math.sqrt(-inner)
    if root * s < 1e-6:
        decay = math.exp(-sigma * s)
        return (1.0 + sigma * s) * decay, s * decay, -square * s * decay, (1.0 - sigma * s) * decay
    fast = -(sigma + root)
    slow = square / fast
    one = math.exp(slow * s)
    two = math.exp(fast * s)
    wide = 2.0 * root
    return (
        (slow * two - fast * one) / wide,
        (one - two) / wide,
        -square * (one - two) / wide,
        (slow * one - fast * two) / wide,
    )


@kernel()
def _value(
    modes: Array, rows: Array, state: Array, harmonic: Array, turn: Array, s: float
) -> tuple[float, float]:
    """A sum of modes and of the table's harmonic, and its rate, at s.

    ``modes`` (2, n) holds w^2 and sigma, ``rows`` (2, n) what multiplies y and y', ``state`` (2, n)
    y and y' at 0, ``harmonic`` (3,) what multiplies sine, cosine and one, ``turn`` (2,) the
    frequency and the phase at 0.
    """
    angle = turn[0] * s + turn[1]
    sine = math.sin(angle)
    cosine = math.cos(angle)
    value = harmonic[0] * sine + harmonic[1] * cosine + harmonic[2]
    rate = turn[0] * (harmonic[0] * cosine - harmonic[1] * sine)
    for k in range(modes.shape[1]):
        a, b, c, d = motion(modes[0, k], modes[1, k], s)
        y = a * state[0, k] + b * state[1, k]
        dy = c * state[0, k] + d * state[1, k]
        second = -2.0 * modes[1, k] * dy - modes[0, k] * y
        value += rows[0, k] * y + rows[1, k] * dy
        rate += rows[0, k] * dy + rows[1, k] * second
    return value, rate


@kernel()
def _newton(
    modes: Array,
    rows: Array,
    state: Array,
    harmonic: Array,
    turn: Array,
    low: float,
    high: float,
    tolerance: float,
) -> float:
    """The root in a bracket whose upper end is negative; negative itself without convergence."""
    s = high
    for _ in range(_NEWTON):
        value, rate = _value(modes, rows, state, harmonic, turn, s)
        if value > 0.0:
            low = s
        else:
            high = s
        following = s - value / rate
        if not (low < following < high):
            following = 0.5 * (low + high)
        step = abs(following - s)
        s = following
        if step <= tolerance or s in (low, high):
            return s
    return -1.0


@kernel()
def _fall(
    modes: Array,
    rows: Array,
    state: Array,
    harmonic: Array,
    turn: Array,
    steps: Array,
    h: float,
    tolerance: float,
    end: float,
    work: Array,
) -> tuple[float, int]:
    """First sampled fall of the sum through zero, infinite when none is seen before the end.

    ``steps`` (n, 4) are the motions over h, ``work`` (2, n) is modified; also the samples.
    """
    for k in range(modes.shape[1]):
        work[0, k] = state[0, k]
        work[1, k] = state[1, k]
    j = 0
    while j * h <= end:
        j += 1
        angle = turn[0] * (j * h) + turn[1]
        value = harmonic[0] * math.sin(angle) + harmonic[1] * math.cos(angle) + harmonic[2]
        for k in range(modes.shape[1]):
            y = work[0, k]
            dy = work[1, k]
            work[0, k] = steps[k, 0] * y + steps[k, 1] * dy
            work[1, k] = steps[k, 2] * y + steps[k, 3] * dy
            value += rows[0, k] * work[0, k] + rows[1, k] * work[1, k]
        if value < 0.0:
            low = (j - 1) * h
            high = j * h
            if j == 1:  # it begins at zero, or above: where is it positive?
                low = 0.5 * h
                found = False
                for _ in range(_HALVINGS):
                    above, _ = _value(modes, rows, state, harmonic, turn, low)
                    if above > 0.0:
                        found = True
                        break
                    high = low
                    low = 0.5 * low
                if not found:
                    return 0.0, j
            root = _newton(modes, rows, state, harmonic, turn, low, high, tolerance)
            return root, j
    return math.inf, j


@kernel()
def _advance(modes: Array, state: Array, s: float) -> None:
    """Move ``state`` (2, n), modified in place, over a time s."""
    for k in range(modes.shape[1]):
        a, b, c, d = motion(modes[0, k], modes[1, k], s)
        y = state[0, k]
        dy = state[1, k]
        state[0, k] = a * y + b * dy
        state[1, k] = c * y + d * dy


@kernel()
def _rate_of_gap(rows: Array, state: Array, harmonic: Array, turn: Array) -> float:
    rate: float = turn[0] * (harmonic[0] * math.cos(turn[1]) - harmonic[1] * math.sin(turn[1]))
    for k in range(rows.shape[1]):
        rate += rows[0, k] * state[1, k]
    return rate


@kernel()
def _change(matrix: Array, given: Array, shift: Array, turn: Array, out: Array) -> None:
    """Coordinates ``out`` (2, m) of the other regime: matrix (m, n) times given, and the table's.

    ``shift`` (m, 3) multiplies sine, cosine and one in the positions.
    """
    sine = math.sin(turn[1])
    cosine = math.cos(turn[1])
    for i in range(matrix.shape[0]):
        y = shift[i, 0] * sine + shift[i, 1] * cosine + shift[i, 2]
        dy = turn[0] * (shift[i, 0] * cosine - shift[i, 1] * sine)
        for k in range(matrix.shape[1]):
            y += matrix[i, k] * given[0, k]
            dy += matrix[i, k] * given[1, k]
        out[0, i] = y
        out[1, i] = dy


@kernel(entry=True)
def simulate_modes(
    modes: Array,
    rows: Array,
    harmonic: Array,
    kick: Array,
    steps: Array,
    held_modes: Array,
    held_rows: Array,
    held_harmonic: Array,
    held_steps: Array,
    to_held: Array,
    to_held_shift: Array,
    to_free: Array,
    to_free_shift: Array,
    turn: Array,
    state: Array,
    held: Array,
    work: Array,
    restitution: float,
    h: float,
    tolerance: float,
    shortest: float,
    end: float,
    budget: int,
    times: Array,
    states: Array,
    releases: Array,
) -> tuple[int, int, int, int]:
    """Simulate to the end: how it ended, and the numbers of impacts, releases and samples.

    ``turn``, ``state``, ``held`` and ``work`` are modified, ``times`` (k,), ``states`` (k, 2, n)
    and ``releases`` (l,) are filled. A flight shorter than ``shortest`` is contact.
    """
    time = 0.0
    impacts = 0
    released = 0
    samples = 0
    phase = turn[1]
    while time < end:
        s, more = _fall(modes, rows, state, harmonic, turn, steps, h, tolerance, end - time, work)
        samples += more
        if samples > budget:
            return BUDGET, impacts, released, samples
        if s < 0.0:
            return LOST, impacts, released, samples
        if s == math.inf:
            break
        if s < shortest and impacts > 0:
            speed = _rate_of_gap(rows, state, harmonic, turn)
            for k in range(modes.shape[1]):
                state[1, k] -= kick[k] * speed
            _change(to_held, state, to_held_shift, turn, held)
            force, _ = _value(held_modes, held_rows, held, held_harmonic, turn, 0.0)
            if force > 0.0:
                s, more = _fall(
                    held_modes, held_rows, held, held_harmonic, turn, held_steps, h, tolerance,
                    end - time, work,
                )  # fmt: skip
                samples += more
                if s < 0.0:
                    return LOST, impacts, released, samples
                if s == math.inf:
                    break
                _advance(held_modes, held, s)
                time += s
                turn[1] = phase + turn[0] * time
                _change(to_free, held, to_free_shift, turn, state)
                if released == releases.shape[0]:
                    return FULL, impacts, released, samples
                releases[released] = time
                released += 1
                continue
            for k in range(modes.shape[1]):
                state[1, k] += kick[k] * speed
        _advance(modes, state, s)
        time += s
        turn[1] = phase + turn[0] * time
        approach = _rate_of_gap(rows, state, harmonic, turn)
        for k in range(modes.shape[1]):
            state[1, k] -= kick[k] * (1.0 + restitution) * approach
        if impacts == times.shape[0]:
            return FULL, impacts, released, samples
        times[impacts] = time
        for k in range(modes.shape[1]):
            states[impacts, 0, k] = state[0, k]
            states[impacts, 1, k] = state[1, k]
        impacts += 1
    return DONE, impacts, released, samples
