"""Samples of the motion between impacts: flight, omitted bounces, contact, flight after release."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.elements.laws import ImpactLaw, Restitution, share
from dynkit.systems.impact.modes.mode import Mode
from dynkit.systems.impact.modes.taylor.mode import TaylorMode
from dynkit.systems.impact.simulation.trajectory import Events, Trajectory

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure


_HIDDEN = 2.0**-20
"""Samples omit bounces that begin at less than this part of the first one's velocity: their heights
are less than 2^-40 of its height."""


def sample_run(oscillator: DrivenStructure, run: Trajectory, times: Array) -> tuple[Array, Array]:
    """Positions and velocities (k, N) at times (k,) within a run."""
    parts = run.segments
    x, v = np.empty((2, len(times), oscillator.degrees_of_freedom))
    for mode, here, states in states_at(run, times):
        x[here], v[here] = mode.motion(states)
    rested = np.append(-1, np.flatnonzero(parts.rest))
    which = rested[np.searchsorted(parts.begin[rested[1:]], times, side="right")]
    since = times - parts.begin[which]
    bouncing = np.flatnonzero((which >= 0) & (since < parts.rest[which]))
    if len(bouncing):
        k = which[bouncing]
        for number in np.unique(parts.guard[k]).tolist():
            here = bouncing[parts.guard[k] == number]
            guard, some = oscillator._automaton.guards[number], which[here]
            given = parts.speed[some], parts.rest[some], since[here]
            lift, rise = _bounces(oscillator._stops[guard.element].restitution, *given)
            moved = _bouncing(oscillator, run, guard, some, x[here])
            x[here] += lift[:, None] * moved
            v[here] += rise[:, None] * moved
    return x, v


def _bouncing(
    oscillator: DrivenStructure, run: Trajectory, guard: Any, some: Array, x: Array
) -> Array:
    """Velocity changes (m, N) per unit change of the gap's rate, in bounces at positions (m, N)."""
    automaton, elements = oscillator._automaton, oscillator._elements
    mode, stop = automaton.modes[guard.mode], elements[guard.element]
    if isinstance(mode, TaylorMode):
        # sine and cosine where the bounces were completed
        turns = run.segments.states[some, :, mode.layout.slots - 1]
        phases = np.arctan2(turns[:, 0], turns[:, 1]).tolist()
        moved = np.empty(x.shape)
        for i, (at, phase) in enumerate(zip(x, phases, strict=True)):
            moved[i] = mode.kick(guard.element, at, phase)
            for k, ratio in automaton.scrapes(guard, at, phase):
                pushed = _pushing(oscillator, run, k, some[i : i + 1])
                moved[i] += ratio * pushed * mode.kick(k, at, phase)
        return moved
    kick = stop.sign * mode.pushed(oscillator._contacts[guard.element].row)
    moved = np.tile(kick[: x.shape[1]], (len(x), 1))
    for part in guard.scrapes:
        friction = elements[part.element]
        rub = friction.sign * mode.pushed(friction.row(len(kick)))[: x.shape[1]]
        pushed = _pushing(oscillator, run, part.element, some)
        moved += part.ratio * np.outer(pushed, rub)
    return moved


def _pushing(oscillator: DrivenStructure, run: Trajectory, element: int, some: Array) -> Array:
    """Signs (k,) of the friction force of an element after some segments.

    They are taken from the last of all segments that begin at the same time.
    """
    s, now = run.segments, oscillator._automaton.parts.now
    after = np.searchsorted(s.begin, s.begin[some], side="right") - 1
    tractions = np.array([now(regimes)[element].traction for regimes in run.regimes])
    return np.asarray(np.sign(tractions[s.mode[after]]))


def states_at(run: Trajectory, times: Array) -> Iterator[tuple[Mode, Any, Array]]:
    """For each mode at times (k,) within a run: the mode, indices of its times, states there."""
    parts = run.segments
    which = np.searchsorted(parts.begin, times, side="right") - 1
    since = times - parts.begin[which]
    for mode, here in run.modes(parts.mode[which]):
        some, place = np.unique(which[here], return_inverse=True)
        yield mode, here, mode.after(parts.of(mode, some), place, since[here])


def sample_sliders(oscillator: DrivenStructure, run: Trajectory, times: Array) -> Array:
    """Positions (k, J) of sliders at times (k,) within a run."""
    out = np.empty((len(times), len(oscillator._sliders)))
    for mode, here, states in states_at(run, times):
        out[here] = mode.sliders(states)
    return out


def events_of(oscillator: DrivenStructure, run: Trajectory) -> Events:
    """Impacts, contacts, releases and other switches of a run, without those of its start."""
    parts = run.segments
    time = parts.begin + parts.rest
    happened = (time > 0.0) | (parts.kind != EventKind.SWITCH)
    if oscillator._strobed:  # the beginning of a period is not an event
        happened[1:] &= parts.kind[1:] != EventKind.IMPACT
    some = np.flatnonzero(happened)[1:]
    numbers = parts.kind[some], parts.element[some], parts.mode[some]
    return Events(time[some], *numbers, *sample_run(oscillator, run, time[some]))


def longest_sample(oscillator: DrivenStructure, run: Trajectory) -> float:
    """Time for which a run that ended by itself can be sampled: 2^24 of the longest steps.

    For Taylor's method it is the time up to which an event was searched.
    """
    if oscillator._motion is not None:
        return run.searched
    ladders = list(oscillator._gaps)
    for number in np.unique(run.segments.mode).tolist():
        (guards,) = np.nonzero(run.guards[:, 0] == number)
        ladders += [oscillator._automaton.guards[k].sum for k in guards.tolist()]
    return float(min(2.0 ** (23 + len(part.cell)) * part.smallest for part in ladders))


def _bounces(
    restitution: Restitution, speed: Array, rest: Array, since: Array
) -> tuple[Array, Array]:
    """Gap and its rate in the omitted bounces of a chatter, as parabolas of decreasing size.

    The bounces begin with `speed` and last for `rest`. The times `since` count from their start.
    """
    acceleration = 2.0 * speed / (rest * share(restitution, speed))
    if isinstance(restitution, ImpactLaw):
        u, s = _by_law(restitution, speed, acceleration, since)
    else:
        r = restitution
        left = 1.0 - since / rest
        bounce = np.floor(np.log(left) / np.log(r)) if r > 0.0 else np.zeros(len(left))
        u = speed * r**bounce
        s = since - rest * (1.0 - r**bounce)
    return s * (u - 0.5 * acceleration * s), u - acceleration * s


def _by_law(law: ImpactLaw, speed: Array, acceleration: Array, since: Array) -> tuple[Array, Array]:
    """Velocities at which the present bounces began, and times since then.

    Both are zero once bounces are slower than `_HIDDEN` times the first one.
    """
    u, s = speed.copy(), since.copy()
    while (over := (s >= 2.0 * u / acceleration) & (u > _HIDDEN * speed)).any():
        s[over] -= 2.0 * u[over] / acceleration[over]
        u[over] *= law.at(u[over])
    rests = s >= 2.0 * u / acceleration
    return np.where(rests, 0.0, u), np.where(rests, 0.0, s)
