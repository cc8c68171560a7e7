"""The motion between impacts: flight, the rest of a chatter, contact, flight after release."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.systems.impact.bases import row_by_row
from dynkit.systems.impact.contact import Contact
from dynkit.systems.impact.trajectory import Trajectory

if TYPE_CHECKING:
    from dynkit.systems.impact.driven import DrivenStructure


def sample_run(oscillator: DrivenStructure, run: Trajectory, times: Array) -> tuple[Array, Array]:
    """Positions and velocities (k, N) at times (k,) within a run."""
    n, free = oscillator.degrees_of_freedom, oscillator._free
    starts, began = run.free_states, run.times
    which = np.searchsorted(began, times, side="right") - 1
    since = times - began[which]
    if not len(run.contacts):
        return free.motion(free.after(starts, which, since))

    before = run.before
    contact = np.full(run.impacts + 1, -1)
    contact[before] = np.arange(len(before))
    during = contact[which]
    length = np.append(run.contacts[:, 2] - began[before], -np.inf)[during]
    in_contact = since < length
    released = (during >= 0) & ~in_contact
    speed, rest = run.speeds[before], run.contacts[:, 1] - began[before]

    x, v = np.empty((len(times), n)), np.empty((len(times), n))
    flying = ~in_contact & ~released
    x[flying], v[flying] = free.motion(free.after(starts, which[flying], since[flying]))
    for stay in stays(oscillator, run, starts):
        held, own = stay.contact, np.isin(during, stay.which)
        # Flights after a release start from the released state.
        part = np.flatnonzero(released & own)
        at = np.searchsorted(stay.which, during[part])
        x[part], v[part] = free.motion(free.after(stay.released, at, since[part] - length[part]))
        part = np.flatnonzero(in_contact & own)
        at = np.searchsorted(stay.which, during[part])
        x[part], v[part] = held.mode.motion(held.mode.after(stay.stuck, at, since[part]))
        part = part[since[part] < rest[during[part]]]
        k = during[part]
        lift, rise = _bounces(oscillator.restitution, speed[k], rest[k], since[part])
        sign = oscillator._stands[stay.side].sign
        x[part, oscillator.contact] += sign * lift
        v[part] += sign * np.outer(rise, oscillator._structure.kick_velocity)
    return x, v


@dataclass(frozen=True, eq=False)
class Stay:
    """Contacts with one stop.

    Attributes
    ----------
    side : int
    contact : Contact
    which : (k,) their numbers in the trajectory, rising
    stuck : (k, 2, stuck slots) states where they begin
    lasts : (k,) durations, infinite for ever
    released : (k, 2, slots) free states at their ends; where there is no end, where they begin
    """

    side: int
    contact: Contact
    which: NDArray[np.intp]
    stuck: Array
    lasts: Array
    released: Array


def stays(oscillator: DrivenStructure, run: Trajectory, starts: Array) -> Iterator[Stay]:
    """Contacts of a trajectory by the stop, from its free states (impacts + 1, 2, slots)."""
    before, sides = run.before, run.contact_sides
    for side in np.unique(sides).tolist():
        contact, which = oscillator._contacts[side], np.flatnonzero(sides == side)
        stuck = transformed(contact.to_stuck, starts[before[which]])
        lasts = run.contacts[which, 2] - run.times[before[which]]
        end = np.where(np.isfinite(lasts), lasts, 0.0)
        ends = contact.mode.after(stuck, np.arange(len(which)), end)
        yield Stay(side, contact, which, stuck, lasts, transformed(contact.to_free, ends))


def longest_sample(oscillator: DrivenStructure, run: Trajectory) -> float:
    """Time up to which a run that ended by itself is sampled: 2^24 of the longest steps."""
    ladders = [oscillator._gaps[0]]
    if len(run.contacts):
        ladders.append(oscillator._contacts[0].force)
    return float(min(2.0 ** (23 + len(part.cell)) * part.smallest for part in ladders))


def transformed(matrix: Array, states: Array) -> Array:
    """States (k, 2, slots) in the other basis, by a matrix of the kernels' `Stop`."""
    flat = states.reshape(len(states), states.shape[1] * states.shape[2])
    out = np.broadcast_to(matrix[:, -1], (len(flat), len(matrix)))
    if flat.shape[1]:  # a single mass on a table at rest has no state
        out = row_by_row(flat, matrix[:, :-1]) + out
    return np.asarray(out.reshape(len(states), 2, len(matrix) // 2))


def _bounces(restitution: float, speed: Array, rest: Array, since: Array) -> tuple[Array, Array]:
    """Gap and its rate in bounces that were replaced by contact: ever smaller parabolas."""
    r = restitution
    left = 1.0 - since / rest
    bounce = np.floor(np.log(left) / np.log(r)) if r > 0.0 else np.zeros(len(left))
    u = speed * r**bounce
    acceleration = 2.0 * speed / (rest * (1.0 - r))
    s = since - rest * (1.0 - r**bounce)
    return s * (u - 0.5 * acceleration * s), u - acceleration * s
