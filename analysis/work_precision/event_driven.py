"""Event-driven simulation: the loop of methods that integrate from one impact to the next.

It adds to an integrator the impact law, the transition to contact when bounces have become small,
the release, and the start of flights whose event function is zero at the beginning.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import final

import numpy as np

from dynkit.analysis.work_precision.methods import FoundImpacts, GaveUp
from dynkit.analysis.work_precision.models import ImpactModel, first_order
from dynkit.core.validation import Array

BLIND = 1e-3
"""Fraction of the period after a release without search for impacts: the gap opens from zero with
the third power of the time, and its sign is rounding at first."""

SMALLEST = 1e-12
"""Tolerance below which the smallest simulated bounce no longer decreases."""


class Integrator(ABC):
    """Integrates an `ImpactModel` to its next event; states are positions, then velocities."""

    def __init__(self, contact: ContactMatrices) -> None:
        self.contact, self.model = contact, contact.model

    @abstractmethod
    def fly(
        self, time: float, state: Array, end: float, flight: float
    ) -> tuple[float, Array, bool]:
        """Fly freely to the next impact or to the end; return time, state (2N,), whether it hits.

        ``flight`` is an estimate of the duration, or infinite.
        """

    @abstractmethod
    def pass_freely(self, time: float, state: Array, end: float) -> Array:
        """Fly freely to the end without search for impacts; return the state (2N,)."""

    @abstractmethod
    def hold(self, time: float, state: Array, end: float) -> tuple[float, Array, bool]:
        """Hold contact until its force falls to zero or to the end, for states (2N - 2,)."""

    @abstractmethod
    def work(self) -> dict[str, int]:
        """Return the work so far."""


@final
class ContactMatrices:
    """Matrices of contact: other coordinates driven by the table, and the contact force."""

    def __init__(self, model: ImpactModel) -> None:
        c, others = model.contact, model.others
        self.model, self.others, self.kick = model, others, model.kick
        self.inner = np.concatenate([others, model.size + others])
        # acceleration of the contact coordinate by a unit force on it
        self.compliance = float(model.response[c])
        n, inner = len(others), np.ix_(others, others)
        self.inverse, self.matrix = first_order(
            model.mass[inner], model.damping[inner], model.stiffness[inner]
        )
        # effect of the table on the others, by its position, velocity and acceleration
        columns = (model.stiffness, model.damping, model.mass)
        self.drive = -self.inverse @ np.stack([part[others, c] for part in columns], axis=1)
        # contact force from the state of the others
        row = np.concatenate([model.stiffness[c, others], model.damping[c, others]])
        self.row = row + model.mass[c, others] @ self.matrix[n:]
        self.own = np.array([part[c, c] for part in columns]) + model.mass[c, others] @ self.drive

    def rate(self, time: float, y: Array) -> Array:
        """Return the derivative (2N - 2,) of positions and velocities of the others."""
        out = self.matrix @ y
        n, model = len(self.others), self.model
        out[n:] += self.drive @ np.array(model.table(time))
        if model.forced:
            out[n:] += self.inverse @ model.forces(time)[self.others]
        return np.asarray(out)

    def force(self, time: float, y: Array) -> float:
        """Return the contact force, positive for compression."""
        model, c = self.model, self.model.contact
        pull = float(self.row @ y + self.own @ np.array(model.table(time)))
        if model.forced:
            acting = model.forces(time)
            inner = float(model.mass[c, self.others] @ (self.inverse @ acting[self.others]))
            pull += inner - float(acting[c])
        return model.sign * pull


def simulate(integrator: Integrator, stick_below: float) -> FoundImpacts:
    """Simulate to the end of the model.

    Parameters
    ----------
    integrator : Integrator
    stick_below : float
        Relative velocity after an impact below which a mass pressed onto the table sticks. The
        error of the position is about the square of this.
    """
    contact, model = integrator.contact, integrator.model
    n, c, end, kick = model.size, model.contact, model.until, contact.kick
    state, time = np.concatenate([model.position, model.velocity]), 0.0
    rows: list[tuple[float, Array]] = []
    releases: list[float] = []
    flight = math.inf
    while time < end:
        time, state, hit = integrator.fly(time, state, end, flight)
        if not hit:
            break
        if not np.isfinite(state).all():
            raise GaveUp("gave up: not finite")
        there, speed, _ = model.table(time)
        approach = state[n + c] - speed
        state = state.copy()
        state[n:] -= (1.0 + model.restitution) * approach * kick
        state[c], state[n + c] = there, speed - model.restitution * approach
        rows.append((time, state))
        rebound = abs(model.restitution * approach)
        force = contact.force(time, state[contact.inner])
        pressed = force > 0.0
        # the gap closes with the acceleration force / (effective mass at the contact)
        flight = 2.0 * rebound / (force * contact.compliance) if pressed else math.inf
        if pressed and rebound <= stick_below:
            state = state.copy()
            state[n:] -= model.sign * rebound * kick
            time, y, released = integrator.hold(time, state[contact.inner], end)
            if not released:
                break
            releases.append(time)
            there, speed, _ = model.table(time)
            state = np.empty(2 * n)
            state[contact.inner] = y
            state[c], state[n + c] = there, speed
            later = min(end, time + BLIND * 2.0 * math.pi / model.frequency)
            state, time, flight = integrator.pass_freely(time, state, later), later, math.inf
    return FoundImpacts(
        np.array([row[0] for row in rows]),
        np.array([row[1][:n] for row in rows]).reshape(-1, n),
        np.array([row[1][n:] for row in rows]).reshape(-1, n),
        np.array(releases),
        integrator.work(),
    )


def smallest_bounce(model: ImpactModel, tolerance: float) -> float:
    """Return the `weakest_bounce` of a model."""
    return weakest_bounce(model.amplitude * model.frequency, model.velocity, tolerance)


def weakest_bounce(table: float, velocity: Array, tolerance: float) -> float:
    """Return the relative velocity below which a mass sticks; its square is about the tolerance.

    In units of the table's velocity it is at least 1e-6, which is above rounding: such a bounce
    rises by about 1e-13 of the table's amplitude.

    Parameters
    ----------
    table : float
        Largest velocity of the table.
    velocity : (N,)
        Velocities of the masses at the start.
    tolerance : float
    """
    speed = max(table, 1e-3 * float(abs(velocity).max()))
    return math.sqrt(max(tolerance, SMALLEST)) * speed
