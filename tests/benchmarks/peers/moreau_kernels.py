"""Moreau's time stepping, compiled: fixed steps, impacts within them by Newton's law."""

from __future__ import annotations

import math

from dynkit.core.jit import kernel
from dynkit.core.validation import Array

DONE, BUDGET, FULL = 0, 1, 2
"""How a simulation ended."""

_CONTACT = 3
"""So many steps in a row with an impulse are a contact; fewer are bounces."""


@kernel(entry=True)
def step_through(
    by_velocity: Array,
    by_position: Array,
    forcing: Array,
    pushed: Array,
    table: Array,
    contact: int,
    sign: int,
    restitution: float,
    h: float,
    steps: int,
    state: Array,
    velocity: Array,
    times: Array,
    states: Array,
    releases: Array,
) -> tuple[int, int, int]:
    """Step to the end: how it ended, and the numbers of impacts and releases.

    v+ = ``by_velocity`` v + ``by_position`` x + ``forcing`` (N, 3) (sine, cosine, one of the middle
    of the step) + ``pushed`` p, x+ = x + h (v + v+) / 2, where the impulse p is the smallest that
    leaves the gap the rate -restitution times the one before, if it is predicted to be closed in
    the middle of the step. ``table`` is amplitude, offset, frequency, phase. ``state`` (2, N) and
    ``velocity`` (N,) are modified, ``times``, ``states`` (k, 2, N) and ``releases`` are filled.
    """
    n = state.shape[1]
    amplitude = table[0]
    frequency = table[2]
    impacts = 0
    released = 0
    row = 0  # steps in a row with an impulse
    sine = math.sin(table[3])
    cosine = math.cos(table[3])
    for j in range(steps):
        gap = sign * (state[0, contact] - amplitude * sine - table[1])
        rate = sign * (state[1, contact] - amplitude * frequency * cosine)
        middle = frequency * (j + 0.5) * h + table[3]
        acting_sine = math.sin(middle)
        acting_cosine = math.cos(middle)
        for i in range(n):
            v = forcing[i, 0] * acting_sine + forcing[i, 1] * acting_cosine + forcing[i, 2]
            for k in range(n):
                v += by_velocity[i, k] * state[1, k] + by_position[i, k] * state[0, k]
            velocity[i] = v
        ahead = frequency * (j + 1) * h + table[3]
        sine = math.sin(ahead)
        cosine = math.cos(ahead)
        struck = False
        if gap + 0.5 * h * rate <= 0.0:
            after = sign * (velocity[contact] - amplitude * frequency * cosine)
            if after + restitution * rate < 0.0:
                struck = True
                push = -sign * (after + restitution * rate) / pushed[contact]
                for i in range(n):
                    velocity[i] += pushed[i] * push
        for i in range(n):
            state[0, i] += 0.5 * h * (state[1, i] + velocity[i])
            state[1, i] = velocity[i]
        if struck:
            row += 1
            if row == 1:
                if impacts == times.shape[0]:
                    return FULL, impacts, released
                times[impacts] = (j + 1) * h
                for i in range(n):
                    states[impacts, 0, i] = state[0, i]
                    states[impacts, 1, i] = state[1, i]
                impacts += 1
        else:
            if row >= _CONTACT:
                if released == releases.shape[0]:
                    return FULL, impacts, released
                releases[released] = j * h
                released += 1
            row = 0
    return DONE, impacts, released
