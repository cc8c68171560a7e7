"""The motion of any impact oscillator to 40 digits, by exponentials of its state matrix.

State: positions, velocities, sine and cosine of the table's phase, and 1. Flight and contact are
both linear in it, so that exponentials of matrices (Arb's) propagate, and Newton's iteration finds
the events. It starts from the event times of the record under test: this tells whether those events
are right, and not whether others were missed (for that the gap is sampled).

Unlike `tests.reference.impact_chain` it knows no modes: mass, damping and stiffness are arbitrary.
They are those of the system as rounded to doubles, unless they are given exactly.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import mpmath
import numpy as np
from flint import arb, arb_mat, ctx
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.systems.impact.impact_map import ImpactMap
from dynkit.systems.impact.records.record import ImpactRecord
from tests.reference.impact_chain import to_mpf

DIGITS = 40
BITS = 256
"""Of working precision: what is left after rounding are `DIGITS` digits."""

Real: TypeAlias = Any
"""An mpf, which no type checker can name."""

ExactMatrices: TypeAlias = tuple[Any, Any, Any]
"""Mass, damping and stiffness in ball arithmetic."""


def chain_matrices(masses: Any, dashpots: Any, springs: Any) -> ExactMatrices:
    """Those of a chain whose first element is at the wall, without any rounding."""
    n = len(masses)
    mass, damping, stiffness = (arb_mat(n, n) for _ in range(3))
    with ctx.workprec(BITS):
        for i in range(n):
            mass[i, i] = masses[i]
            for matrix, constants in ((damping, dashpots), (stiffness, springs)):
                k = arb(constants[i])
                matrix[i, i] += k
                if i:
                    matrix[i - 1, i - 1] += k
                    matrix[i, i - 1] = matrix[i - 1, i] = -k
    return mass, damping, stiffness


class ExactMotion:
    """Follows the impacts and contacts of a record."""

    def __init__(self, system: ImpactMap, matrices: ExactMatrices | None = None) -> None:
        self.size = n = system.degrees_of_freedom
        amplitude, offset = arb(float(system.amplitude)), arb(float(system.offset))
        self.restitution = arb(float(system.restitution))
        with ctx.workprec(BITS):
            rounded = (system.mass, system.damping_matrix, system.stiffness)
            mass, damping, stiffness = matrices or (arb_mat(m.tolist()) for m in rounded)
            inverse = mass.inv()
            spring, dashpot = inverse * stiffness, inverse * damping
            free = arb_mat(2 * n + 3, 2 * n + 3)
            for i in range(n):
                free[i, n + i] = 1
                for j in range(n):
                    free[n + i, j], free[n + i, n + j] = -spring[i, j], -dashpot[i, j]
            free[2 * n, 2 * n + 1] = float(system.frequency)
            free[2 * n + 1, 2 * n] = -float(system.frequency)
            gap = arb_mat(1, 2 * n + 3)
            gap[0, n - 1], gap[0, 2 * n], gap[0, 2 * n + 2] = 1, -amplitude, -offset
            self.free, self.gap = free, gap
            self.gap_rate = gap * free
            self.acceleration = self.gap_rate * free
            self.kick = arb_mat(2 * n + 3, 1)
            for i in range(n):
                self.kick[n + i, 0] = inverse[i, n - 1] / inverse[n - 1, n - 1]
            self.held = free - self.kick * self.acceleration

    def follow(self, record: ImpactRecord) -> list[tuple[Real, list[Real], Real]]:
        """Time, and state and relative velocity just after it, of every impact of the record."""
        released = dict(
            zip(
                np.searchsorted(record.time, record.sticking[:, 0], side="right").tolist(),
                record.sticking[:, 1].tolist(),
                strict=True,
            )
        )
        time, impacts = arb(0), []
        with ctx.workprec(BITS):
            phase = arb(float(record.start.phase))
            start = [*record.start.position.tolist(), *record.start.velocity.tolist()]
            entries = [*start, phase.sin(), phase.cos(), 1]
            state = arb_mat(2 * self.size + 3, 1, entries)
            for i, claimed in enumerate(record.time.tolist()):
                if i in released:
                    state -= self.kick * (self.gap_rate * state)
                    wait, state = self._until(
                        self.held, self.acceleration, state, arb(released[i]) - time
                    )
                    time += wait
                wait, state = self._until(self.free, self.gap, state, arb(claimed) - time)
                time += wait
                state -= self.kick * (self.gap_rate * state) * (1 + self.restitution)
                speed = (self.gap_rate * state)[0, 0]
                impacts.append((to_mpf(time), [to_mpf(x) for x in state.entries()], to_mpf(speed)))
        return impacts

    def _until(self, matrix: arb_mat, row: arb_mat, state: arb_mat, guess: arb) -> Any:
        """When the row vanishes, near the guess, and the state then."""
        slope = row * matrix
        time, state = guess.mid(), _moved(matrix, guess.mid(), state)
        for _ in range(20):
            step = (-(row * state)[0, 0] / (slope * state)[0, 0]).mid()
            time, state = (time + step).mid(), _moved(matrix, step, state)
            if abs(step) < arb(10) ** (5 - DIGITS):
                return time, state
        raise ArithmeticError("no event near the claimed one")


def _moved(matrix: arb_mat, duration: arb, state: arb_mat) -> arb_mat:
    """The state later, rounding dropped once it is seen to be small."""
    moved = (matrix * duration).exp() * state
    if any(x.rad() > arb(10) ** -DIGITS for x in moved.entries()):
        raise ArithmeticError("rounding takes more digits than there are")
    return moved.mid()


def exact_errors(record: ImpactRecord) -> Array:
    """Errors (n, 2) of the impacts: of time, and of positions, velocities, u and phase."""
    n = record.system.degrees_of_freedom
    errors = []
    with mp.workdps(DIGITS):
        motion = ExactMotion(record.system)
        for i, (time, state, speed) in enumerate(motion.follow(record)):
            found = [*record.position[i].tolist(), *record.velocity[i].tolist()]
            parts = [mpf(x) - y for x, y in zip(found, state[: 2 * n], strict=True)]
            parts.append(mpf(float(record.relative_velocity[i])) - speed)
            turn = mpf(float(record.phase[i])) - mpmath.atan2(state[2 * n], state[2 * n + 1])
            parts.append(turn - 2 * mp.pi * mpmath.nint(turn / (2 * mp.pi)))
            late = mpf(float(record.time[i])) - time
            errors.append((abs(float(late)), max(abs(float(part)) for part in parts)))
    return np.array(errors).reshape(-1, 2)
