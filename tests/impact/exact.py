"""The motion of any impact oscillator to 40 digits, by exponentials of its state matrix.

State: positions, velocities, sine and cosine of the table's phase, and 1. Flight and contact are
both linear in it, so that ``mpmath.expm`` propagates, and Newton's iteration finds the events. It
starts from the event times of the record under test: this tells whether those events are right, and
not whether others were missed (for that the gap is sampled).

Unlike `tests.reference.impact_chain` it knows no modes: mass, damping and stiffness are arbitrary.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import mpmath
import numpy as np
from mpmath import mp, mpf

from dynkit.systems.impact.oscillator import ImpactOscillator
from dynkit.systems.impact.record import ImpactRecord
from dynkit.validation import Array

DIGITS = 40

Real: TypeAlias = Any
"""An mpf or a matrix of them, which no type checker can name."""


class ExactMotion:
    """Follows the impacts and contacts of a record."""

    def __init__(self, system: ImpactOscillator) -> None:
        self.size = n = system.degrees_of_freedom
        amplitude, offset = mpf(system.amplitude), mpf(system.offset)
        self.restitution = mpf(system.restitution)
        inverse = mpmath.matrix(system.mass.tolist()) ** -1
        spring = inverse * mpmath.matrix(system.stiffness.tolist())
        dashpot = inverse * mpmath.matrix(system.damping_matrix.tolist())
        free = mpmath.matrix(2 * n + 3)
        for i in range(n):
            free[i, n + i] = 1
            for j in range(n):
                free[n + i, j], free[n + i, n + j] = -spring[i, j], -dashpot[i, j]
        free[2 * n, 2 * n + 1] = mpf(system.frequency)
        free[2 * n + 1, 2 * n] = -mpf(system.frequency)
        gap = mpmath.matrix(1, 2 * n + 3)
        gap[n - 1], gap[2 * n], gap[2 * n + 2] = 1, -amplitude, -offset
        self.free, self.gap = free, gap
        self.gap_rate = gap * free
        self.acceleration = self.gap_rate * free
        self.kick = mpmath.matrix(2 * n + 3, 1)
        for i in range(n):
            self.kick[n + i] = inverse[i, n - 1] / inverse[n - 1, n - 1]
        self.held = free - self.kick * self.acceleration

    def follow(self, record: ImpactRecord) -> list[tuple[Real, Real]]:
        """Time, and state just after it, of every impact of the record."""
        n = self.size
        state = mpmath.matrix(2 * n + 3, 1)
        for i in range(n):
            state[i] = mpf(float(record.start.position[i]))
            state[n + i] = mpf(float(record.start.velocity[i]))
        phase = mpf(record.start.phase)
        state[2 * n], state[2 * n + 1], state[2 * n + 2] = mpmath.sin(phase), mpmath.cos(phase), 1
        released = dict(
            zip(
                np.searchsorted(record.time, record.sticking[:, 0], side="right"),
                record.sticking[:, 1],
                strict=True,
            )
        )
        time, impacts = mpf(0), []
        for i, claimed in enumerate(record.time.tolist()):
            if i in released:
                state -= self.kick * (self.gap_rate * state)[0]
                wait, state = self._until(
                    self.held, self.acceleration, state, mpf(float(released[i])) - time
                )
                time += wait
            wait, state = self._until(self.free, self.gap, state, mpf(claimed) - time)
            time += wait
            state -= self.kick * ((1 + self.restitution) * (self.gap_rate * state)[0])
            impacts.append((time, state.copy()))
        return impacts

    def _until(self, matrix: Real, row: Real, state: Real, guess: Real) -> tuple[Real, Real]:
        """When the row vanishes, near the guess, and the state then."""
        time, state = guess, mpmath.expm(matrix * guess) * state
        for _ in range(20):
            step = -(row * state)[0] / (row * matrix * state)[0]
            time, state = time + step, mpmath.expm(matrix * step) * state
            if abs(step) < mpf(10) ** (5 - DIGITS):
                return time, state
        raise ArithmeticError("no event near the claimed one")


def exact_errors(record: ImpactRecord) -> Array:
    """Errors (n, 2) of the impacts: of time, and of positions, velocities, u and phase."""
    n = record.system.degrees_of_freedom
    errors = []
    with mp.workdps(DIGITS):
        motion = ExactMotion(record.system)
        for i, (time, state) in enumerate(motion.follow(record)):
            found = [*record.position[i].tolist(), *record.velocity[i].tolist()]
            parts = [mpf(x) - y for x, y in zip(found, state[: 2 * n], strict=True)]
            parts.append(mpf(float(record.relative_velocity[i])) - (motion.gap_rate * state)[0])
            turn = mpf(float(record.phase[i])) - mpmath.atan2(state[2 * n], state[2 * n + 1])
            parts.append(turn - 2 * mp.pi * mpmath.nint(turn / (2 * mp.pi)))
            late = mpf(float(record.time[i])) - time
            errors.append((abs(float(late)), max(abs(float(part)) for part in parts)))
    return np.array(errors).reshape(-1, 2)
