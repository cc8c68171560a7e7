"""Exact derivative of the impact map, through contact and release where they occur."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.flows import NoCrossing
from dynkit.systems.impact.motion import evolve, transformed
from dynkit.systems.impact.record import Ending
from dynkit.systems.impact.state import ImpactState
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.oscillator import ImpactOscillator


def impact_derivative(oscillator: ImpactOscillator, state: ImpactState) -> Array:
    """Derivative (2N, 2N) of the impact map in section coordinates.

    The chain of: section coordinates to free ones; contact until the force vanishes, where there is
    one; flight until the gap vanishes; the impact law. The rest of a chatter that is replaced by
    contact forgets the relative velocity.
    """
    run = oscillator._run(state, 1, store=True)
    if run.impacts < 1:
        raise NoCrossing(f"there is no next impact: {tuple(Ending)[run.ending].value}")
    structure, gap = oscillator._structure, oscillator._gap
    n, slots = structure.size, gap.step.shape[2]
    r = oscillator.restitution

    y = np.array(state._coordinates)
    began = 0.0
    derivative = _lift(oscillator, state.phase)
    if len(run.contacts):
        contact = oscillator._contact
        began = float(run.contacts[0, 2])
        stuck = transformed(contact.to_stuck, y[None])
        inner = _linear(contact.to_stuck) @ derivative
        end, flow = _flow(contact.force, stuck[0], began)
        inner = flow @ inner
        rate = _rate(contact.force, end)
        inner -= np.outer(rate, _row(contact.force, 0) @ inner) / float(
            _row(contact.force, 0) @ rate
        )
        # Time also moves the phase: it is part of the rate, through sine and cosine of the table.
        derivative = _linear(contact.to_free) @ inner
        y = transformed(contact.to_free, end[None])[0]
    end, flow = _flow(gap, y, float(run.states[0, -1]) - began)
    derivative = flow @ derivative
    rate = _rate(gap, end)
    speed = float(_row(gap, 2) @ end.ravel())
    derivative -= np.outer(rate, _row(gap, 0) @ derivative) / speed
    before = _row(gap, 2) @ derivative
    kick = np.zeros((2, slots))
    kick[:, :n] = structure.kick[:2]
    derivative -= (1.0 + r) * np.outer(kick.ravel(), before)

    position = structure.free.positions(_columns(derivative, n, slots)).T
    velocity = structure.free.velocities(_columns(derivative, n, slots)).T
    sine, cosine = end[0, n], end[1, n]
    phase = cosine * derivative[n] - sine * derivative[slots + n]
    return np.vstack([position[:-1], velocity[:-1], -r * before[None], phase[None]])


def _lift(oscillator: ImpactOscillator, phase: float) -> Array:
    """Derivative (2 slots, 2N) of the free coordinates, table included, by the section ones."""
    structure, table = oscillator._structure, oscillator._table
    n, slots = structure.size, oscillator._gap.step.shape[2]
    sine, cosine = math.sin(phase), math.cos(phase)
    x, v = np.zeros((2 * n, n)), np.zeros((2 * n, n))
    x[np.arange(n - 1), np.arange(n - 1)] = 1.0
    v[np.arange(n - 1) + n - 1, np.arange(n - 1)] = 1.0
    v[2 * n - 2, n - 1] = 1.0
    x[2 * n - 1, n - 1] = table.amplitude * cosine
    v[2 * n - 1, n - 1] = -table.amplitude * table.frequency * sine
    out = np.zeros((2 * n, 2, slots))
    out[..., :n] = structure.free.coordinates(x, v)
    out[-1, 0, n], out[-1, 1, n] = cosine, -sine
    return np.asarray(out.reshape(2 * n, -1).T)


def _flow(ladder: Any, y: Array, duration: float) -> tuple[Array, Array]:
    """The state after a duration, and its derivative (2 slots, 2 slots) by the state before."""
    slots = y.shape[1]
    starts = np.zeros((3, 2, slots))
    starts[0], starts[1, 0], starts[2, 1] = y, 1.0, 1.0
    ends = evolve(ladder, starts, np.arange(3), np.full(3, duration))
    flow = np.zeros((2, slots, 2, slots))
    place = np.arange(slots)
    for j in range(2):
        for i in range(2):
            flow[i, place, j, place] = ends[1 + j, i]
    return ends[0], flow.reshape(2 * slots, 2 * slots)


def _rate(ladder: Any, y: Array) -> Array:
    """Rate of change (2 slots,) of a state."""
    g = ladder.generator
    return np.concatenate([g[0] * y[0] + g[1] * y[1], g[2] * y[0] + g[3] * y[1]])


def _row(ladder: Any, order: int) -> Array:
    """The row of f (0) or f' (2) of an exponential sum, (2 slots,)."""
    return np.asarray(ladder.rows[order : order + 2].ravel())


def _linear(matrix: Array) -> Array:
    return matrix[:, :-1]


def _columns(derivative: Array, n: int, slots: int) -> Array:
    return np.asarray(derivative.T.reshape(-1, 2, slots)[..., :n])
