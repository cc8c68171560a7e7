"""The motion between impacts: flight, the rest of a chatter, contact, flight after release."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.systems.impact.bases import row_by_row
from dynkit.systems.impact.runs import Run, workspace
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.oscillator import ImpactOscillator


def sample_run(oscillator: ImpactOscillator, run: Run, times: Array) -> Array:
    """Free coordinates (k, 2, N) at times (k,) within a run."""
    n = oscillator.degrees_of_freedom
    slots = oscillator._gap.step.shape[2]
    starts = np.zeros((run.impacts + 1, 2, slots))
    starts[0] = run.start._coordinates
    starts[1:, :, :n] = run.states[:, : 2 * n].reshape(-1, 2, n)
    starts[1:, 0, n], starts[1:, 1, n] = run.states[:, 2 * n], run.states[:, 2 * n + 1]
    began = np.append(0.0, run.states[:, -1])
    which = np.searchsorted(began, times, side="right") - 1
    since = times - began[which]
    if not len(run.contacts):
        return evolve(oscillator._gap, starts, which, since)[..., :n]

    to_stuck, to_free = oscillator._contact.to_stuck, oscillator._contact.to_free
    force = oscillator._contact.force
    before = run.contacts[:, 0].astype(np.intp)
    stuck = transformed(to_stuck, starts[before])
    contact = np.full(run.impacts + 1, -1)
    contact[before] = np.arange(len(before))
    during = contact[which]
    length = np.append(run.contacts[:, 2] - began[before], -np.inf)[during]
    in_contact = since < length
    released = (during >= 0) & ~in_contact

    # Flights after a release start from the released state, all others from the state after the
    # impact.
    ended = np.isfinite(run.contacts[:, 2])
    ends = np.flatnonzero(ended)
    at_release = transformed(
        to_free, evolve(force, stuck, ends, run.contacts[ends, 2] - began[before[ends]])
    )
    place = np.cumsum(ended) - 1
    flight_starts = np.concatenate([starts, at_release])
    flight = np.where(released, len(starts) + place[during], which)
    out = np.empty((len(times), 2, slots))
    free = ~in_contact
    out[free] = evolve(
        oscillator._gap,
        flight_starts,
        flight[free],
        np.where(released, since - length, since)[free],
    )
    out[in_contact] = transformed(
        to_free, evolve(force, stuck, during[in_contact], since[in_contact])
    )
    _add_bounces(oscillator, run, out, during, since, in_contact)
    return out[..., :n]


def longest_sample(oscillator: ImpactOscillator, run: Run) -> float:
    """Time up to which a run that ended by itself is sampled: 2^24 of the longest steps."""
    ladders = [oscillator._gap]
    if len(run.contacts):
        ladders.append(oscillator._contact.force)
    return float(min(2.0 ** (23 + len(part.step)) * part.smallest for part in ladders))


def evolve(ladder: Any, starts: Array, which: Any, durations: Array) -> Array:
    """States (m, 2, slots) at given durations from some of the starts (k, 2, slots)."""
    from dynkit.systems.impact.kernels import sample

    out = np.empty((len(durations), *starts.shape[1:]))
    sample(ladder, np.ascontiguousarray(starts), which, durations, workspace(starts.shape[2]), out)
    return out


def transformed(matrix: Array, states: Array) -> Array:
    """States (k, 2, slots) in the other basis, by a matrix of the kernels' `Mechanics`."""
    flat = states.reshape(len(states), states.shape[1] * states.shape[2])
    out = row_by_row(flat, matrix[:, :-1]) + matrix[:, -1]
    return np.asarray(out.reshape(len(states), 2, len(matrix) // 2))


def _add_bounces(
    oscillator: ImpactOscillator, run: Run, out: Array, during: Any, since: Array, in_contact: Any
) -> None:
    """Add the bounces that were replaced by contact: ever smaller parabolas."""
    r, structure = oscillator.restitution, oscillator._structure
    n = structure.size
    before = run.contacts[:, 0].astype(np.intp)
    speed = np.append(run.start.relative_velocity, run.states[:, -2])[before]
    began = np.append(0.0, run.states[:, -1])[before]
    rest = run.contacts[:, 1] - began
    inside = np.flatnonzero(in_contact & (since < np.append(rest, 0.0)[during]))
    if not len(inside):
        return
    k = during[inside]
    left = 1.0 - since[inside] / rest[k]
    bounce = np.floor(np.log(left) / np.log(r)) if r > 0.0 else np.zeros(len(k))
    u = speed[k] * r**bounce
    acceleration = 2.0 * speed[k] / (rest[k] * (1.0 - r))
    s = since[inside] - rest[k] * (1.0 - r**bounce)
    lift, rise = s * (u - 0.5 * acceleration * s), u - acceleration * s
    unit = structure.free.coordinates(np.eye(n)[-1], np.zeros(n))
    out[inside, :, :n] += lift[:, None, None] * unit + rise[:, None, None] * structure.kick[:2]
