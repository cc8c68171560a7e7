"""Brute force: the impact chain by small fixed steps of the classical Runge-Kutta method.

Nothing clever: the matrices are stepped, an impact is where the gap is negative after a step (found
by bisecting that step), and contact is a clamp. Without grazing the error of impact times and
states falls with the fourth power of the step; a bounce shorter than the step is contact, so with
chatter the order is lower. Use it for orders of convergence and for orbits, not for digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BISECTIONS: Final = 60


def chain_matrices(masses: Array, springs: Array, damping: float) -> tuple[Array, Array, Array]:
    """Mass, damping and stiffness matrix of a chain tied to a wall at its first mass."""
    n = masses.size
    stiffness = np.diag(springs + np.append(springs[1:], 0.0))
    for i in range(1, n):
        stiffness[i, i - 1] = stiffness[i - 1, i] = -springs[i]
    return np.diag(masses), damping * stiffness, stiffness


@dataclass(frozen=True)
class BruteForceRun:
    """After each impact: time, phase and relative velocity (n,), position and velocity (n, N).

    ``contact`` holds the (start, release) times of clamped intervals, shape (k, 2).
    """

    time: Array
    phase: Array
    relative_velocity: Array
    position: Array
    velocity: Array
    contact: Array


@final
class BruteForceChain:
    """The chain, stepped with a fixed step. Parameters as in `impact_chain.ReferenceChain`."""

    def __init__(
        self,
        masses: Array,
        springs: Array,
        *,
        damping: float,
        restitution: float,
        amplitude: float,
        offset: float,
        frequency: float,
        step: float,
    ) -> None:
        mass, damper, stiffness = chain_matrices(masses, springs, damping)
        n = masses.size
        self.size, self.restitution, self.step = n, restitution, step
        self.amplitude, self.offset, self.frequency = amplitude, offset, frequency
        self.tip_mass = float(masses[-1])
        self.force_row = np.concatenate((stiffness[-1], damper[-1]))
        inverse = np.linalg.inv(mass)
        self.free = np.block(
            [[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damper]]
        )

    def table(self, time: float) -> tuple[float, float, float]:
        """Position, velocity and acceleration of the table, whose phase is 0 at time 0."""
        w, a = self.frequency, self.amplitude
        s, c = sin(w * time), cos(w * time)
        return a * s + self.offset, a * w * c, -a * w * w * s

    def run(self, position: Array, velocity: Array, *, impacts: int, limit: float) -> BruteForceRun:
        """Step from time 0 until the count of impacts or the time limit."""
        n, time = self.size, 0.0
        state = np.concatenate((position, velocity))
        rows: list[tuple[float, float, Array]] = []
        contacts: list[tuple[float, float]] = []
        while len(rows) < impacts and time < limit:
            after = self._runge_kutta(state, time, self.step, held=False)
            if after[n - 1] >= self.table(time + self.step)[0]:
                state, time = after, time + self.step
                continue
            hit = self._bisect(state, time)
            state = self._runge_kutta(state, time, hit, held=False)
            time += hit
            there, speed, _ = self.table(time)
            u = self.restitution * (speed - state[-1])
            state[n - 1], state[-1] = there, speed + u
            rows.append((time, u, state.copy()))
            force = self.contact_force(state, time)
            if force > 0 and 2.0 * abs(u) * self.tip_mass / force < self.step:
                started = time
                state, time = self._clamp(state, time, limit)
                contacts.append((started, time))
        return self._collect(rows, contacts)

    def contact_force(self, state: Array, time: float) -> float:
        """Force of the table that keeps the tip on it."""
        there, speed, acceleration = self.table(time)
        held = state.copy()
        held[self.size - 1], held[-1] = there, speed
        return self.tip_mass * acceleration + float(self.force_row @ held)

    def _rate(self, state: Array, time: float, *, held: bool) -> Array:
        if not held:
            return self.free @ state
        there, speed, acceleration = self.table(time)
        state = state.copy()
        state[self.size - 1], state[-1] = there, speed
        rate = self.free @ state
        rate[-1] = acceleration
        return rate

    def _runge_kutta(self, state: Array, time: float, h: float, *, held: bool) -> Array:
        k1 = self._rate(state, time, held=held)
        k2 = self._rate(state + 0.5 * h * k1, time + 0.5 * h, held=held)
        k3 = self._rate(state + 0.5 * h * k2, time + 0.5 * h, held=held)
        k4 = self._rate(state + h * k3, time + h, held=held)
        return state + (h / 6.0) * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    def _bisect(self, state: Array, time: float) -> float:
        """Longest part of this step that leaves the gap open, to rounding."""
        low, high = 0.0, self.step
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            tip = self._runge_kutta(state, time, middle, held=False)[self.size - 1]
            if tip > self.table(time + middle)[0]:
                low = middle
            else:
                high = middle
        return high

    def _clamp(self, state: Array, time: float, limit: float) -> tuple[Array, float]:
        """Hold the tip on the table until the contact force is no longer positive."""
        h = self.step
        while time < limit and self.contact_force(state, time) > 0:
            state = self._runge_kutta(state, time, h, held=True)
            time += h
            state[self.size - 1], state[-1], _ = self.table(time)
        return state, time

    def _collect(
        self, rows: list[tuple[float, float, Array]], contacts: list[tuple[float, float]]
    ) -> BruteForceRun:
        n = self.size
        time = np.array([row[0] for row in rows])
        states = np.array([row[2] for row in rows]).reshape(-1, 2 * n)
        return BruteForceRun(
            time,
            np.mod(self.frequency * time, 2.0 * pi),
            np.array([row[1] for row in rows]),
            states[:, :n],
            states[:, n:],
            np.array(contacts).reshape(-1, 2),
        )
