"""How fast nearby motions of an impact oscillator part."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynkit.systems.impact.runs import MOST_CELLS, band_factor, mechanics_of, run, workspace
from dynkit.systems.impact.state import ImpactState
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.oscillator import ImpactOscillator

DISTANCE, BLOCK = 1e-8, 10
"""Distance of a twin from the motion, relative to its size, and impacts until it is put back."""


def growth_of_distance(oscillator: ImpactOscillator, start: ImpactState, impacts: int) -> Array:
    """Log growth of the distance of a twin, per block of 10 impacts, (impacts // 10,).

    After every block the twin is put back to the first distance, in the direction it has reached.
    Minus infinity where the motion ends, or where contact makes both the same.
    """
    from dynkit.exponential.evaluation_kernels import START
    from dynkit.systems.impact import clock_kernels, kernels

    base = run(oscillator, start, impacts, store=True, noise=0.0, seed=0)
    blocks = impacts // BLOCK
    if base.impacts < impacts:
        return np.full(blocks, -np.inf)
    n, free = oscillator.degrees_of_freedom, oscillator._free
    slots = free.layout.slots
    # Coordinates, sine and cosine of the phase, relative velocity; the time does not count.
    motion = np.empty((blocks + 1, 2 * n + 3))
    motion[0] = [*start._coordinates.ravel(), *start._turn, start.relative_velocity]
    motion[1:] = base.states[BLOCK - 1 : blocks * BLOCK : BLOCK, :-1]
    size = abs(base.states[:, :-1]).max(axis=0)
    size = np.maximum(size, 1e-3 * size.max())
    gap = np.sqrt(np.arange(2.0, 2.0 + size.size)) * size
    gap *= DISTANCE / np.linalg.norm(gap / size)

    mechanics, contact = mechanics_of(oscillator, with_contact=True)
    flight = workspace(slots)
    contacts = np.empty((BLOCK + 1, 3))
    unstored = np.empty((0, 2 * n + 4))
    logs = np.empty(blocks)
    for i in range(blocks):
        twin = motion[i] + gap
        flight.states[START] = free.states(twin[: 2 * n].reshape(2, n), *twin[2 * n : -1])
        clock = np.zeros(clock_kernels.CLOCK)
        clock[clock_kernels.SPEED] = abs(twin[-1])
        clock[clock_kernels.SIDE] = motion[i, -1] < 0.0
        clock[clock_kernels.PHASE_OF_MOTION] = kernels.BOUNCED
        done, _ = kernels.run(
            mechanics,
            clock,
            BLOCK,
            0.0,
            band_factor(slots),
            MOST_CELLS,
            unstored,
            contacts,
            flight,
            contact,
        )
        q, *turn = free.parts(flight.states[START])
        speed = (
            -clock[clock_kernels.SPEED]
            if clock[clock_kernels.SIDE] == 1.0
            else clock[clock_kernels.SPEED]
        )
        gap = np.array([*q.ravel(), *turn, speed]) - motion[i + 1]
        if free.layout.table < 0:
            gap[2 * n : -1] = 0.0
        length = float(np.linalg.norm(gap / size))
        if done < BLOCK or length == 0.0:
            return np.full(blocks, -np.inf)
        logs[i] = np.log(length / DISTANCE)
        gap *= DISTANCE / length
    return logs
