"""Derivatives of the equations of an orbit by, and of, the modes that no spring holds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.modes.impulse_responses import FreeMotion
    from dynkit.systems.impact.orbits.impulses.solution import ImpulseSolution


def sizes(motion: FreeMotion, period: float, speed: float) -> Array:
    """What an impulse of this speed makes of those modes within a period, (2b,), positive."""
    if not len(motion.neutral):
        return np.empty(0)
    kick = motion.start(motion.neutral_numbers(motion.kick), 0.0)[None]
    both = np.concatenate([kick, motion.mode.after(kick, np.array([0]), np.array([period]))])
    found = abs(motion.neutral_numbers(both)).max(axis=0).reshape(2, -1)
    largest = found.max(axis=1, keepdims=True)
    return np.asarray(speed * np.where(found > 0.0, found, largest).ravel())


def add_to_linearization(out: Any, s: ImpulseSolution, multiplier: complex) -> None:
    """Add them to the derivative D(multiplier), (2n + 2b, 2n + 2b), with no units."""
    n, w, motion = len(s.sides), s.terms.frequency, s.motion
    numbers, rate = motion.neutral_numbers, motion.mode.rate
    one = np.eye(len(s.border))
    drift = rate(s.carried).reshape(n, -1)
    carried = np.stack([s.carry(motion.start(e, 0.0)).reshape(n, -1) for e in one], axis=1)
    for order in range(2):
        rows, row = slice(order * n, (order + 1) * n), motion.rows[order]
        moved = s.signs * (drift @ row) / w
        moved[0] = 0.0
        out[rows, :n] += np.diag(moved)
        out[rows, 0] -= moved
        out[rows, 2 * n :] = s.signs[:, None] * (carried @ row)
    ends, rates = numbers(s.ends[1:]), numbers(rate(s.ends))
    out[2 * n :, :n] = -(s.signs * s.impulses * rates[1:].T) / w
    out[2 * n :, 0] += (multiplier * numbers(rate(s.end)) - rates[0]) / w
    out[2 * n :, n : 2 * n] = s.signs * ends.T
    out[2 * n :, 2 * n :] = numbers(s.over(one)).T - multiplier * one


def by_frequency(s: ImpulseSolution) -> Array:
    """Derivative (2b,) of how those modes return, by the frequency at given phases."""
    lasts = np.append(s.period, s.period - s.since[:, 0])
    weights = np.append(1.0, s.signs * s.impulses) * lasts
    rates = s.motion.neutral_numbers(s.motion.mode.rate(s.ends))
    return np.asarray(-(weights @ rates) / s.terms.frequency)
