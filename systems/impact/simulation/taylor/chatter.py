"""Tests of whether the bounces of a chatter may be omitted, for flights by Taylor's method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import HALT, SWITCH
from dynkit.systems.impact.elements.laws import ImpactLaw, Restitution, share
from dynkit.systems.impact.simulation.contact_kernels import PLACE, SMALLEST, chatter_rest, falling

if TYPE_CHECKING:
    from dynkit.systems.impact.modes.taylor.chart import Chart
    from dynkit.systems.impact.modes.taylor.mode import TaylorMode

_TURN = 1e-4
"""Second differences of a kick along the path have the time step _TURN / (1 + |v|)."""


def chatter(
    mode: TaylorMode,
    chart: Chart,
    k: int,
    state: Array,
    law: Restitution,
    allowed: float,
    u: float,
    found: Array,
    rubs: Sequence[tuple[int, float]],
    turns: tuple[float, float],
) -> tuple[float | None, float]:
    """Duration of the bounces of a gap from velocity `u` on (None: do not omit them); the error.

    With a contact acceleration a they last T = 2 u / (a (1 - r)). They are omitted if a varies by
    less than a (1 - r) / 4 over 2 T, and if the omission changes no position or velocity by more
    than the tolerance, to leading order. For an impact law 1 - r is the velocity of the first
    bounce over the sum of the velocities of all bounces.

    Parameters
    ----------
    state : (2, N + 1)
        The state just after the impact.
    allowed : float
        Largest tolerated change of the state; with 0 no bounces are omitted.
    found : (order + 1,)
        Taylor coefficients of the gap.
    rubs : sequence of (int, float)
        Friction at the impacts: number, and largest change of slip over change of the gap's rate.
    turns : (float, float)
        Decrease of the gap's acceleration when friction along its row reverses, and the largest
        acceleration that this friction holds. With such friction and an impact law, no bounces are
        omitted.
    """
    a, (drop, hold) = -2.0 * float(found[2]), turns
    least, part, by_law = a - drop, _part(law, u), isinstance(law, ImpactLaw)
    if not (part > 0.0 and least > 0.0) or (allowed == 0.0 and u > SMALLEST):
        return None, 0.0
    if by_law and (drop > 0.0 or hold > 0.0):
        return None, 0.0
    slowed, fall = falling(1.0, -a, drop)
    lasts = slowed * (1.0 - part)
    left, cubes = (part, part) if by_law else (1.0 - lasts, 1.0 - lasts**3)
    if not (pull := a * fall * cubes):  # accelerations whose squares underflow do not hold
        return None, 0.0
    lost = (2.0 / 3.0) * u**3 / pull
    rest = 4.0 * u / (fall * left)
    if lost > PLACE * allowed > 0.0:
        return None, 0.0
    order = np.arange(3, len(found))
    terms = abs(found[3:]) * order * (order - 1) * rest ** (order - 2.0)
    change = float(terms.sum())
    if change > 0.25 * part * least or terms[-1] > 1e-6 * a:
        return None, 0.0
    largest, drag = coupling(mode, chart, k, state, rubs)
    change += abs(drag) * drop * rest
    if change > min(0.25 * part * least, least + 0.5 * drop - hold):
        return None, 0.0
    third = 6.0 * float(found[3])
    place = 0.025 * u * rest * rest * (abs(drag - third / a) + abs(drag))
    place += 0.5 * u * u / least if drop > 0.0 else 0.0
    if largest * lost > allowed or place > PLACE * allowed > 0.0:
        return None, 0.0
    time = 0.5 * rest if by_law else chatter_rest(drag, 1.0 - part, drop, u, -a, third)
    return time, largest * lost


def _part(law: Restitution, u: float) -> float:
    """The velocity of a bounce over the sum of the velocities of all bounces from this one on."""
    return float(share(law, np.array([u]))[0]) if isinstance(law, ImpactLaw) else 1.0 - law


def disturbed(
    mode: TaylorMode,
    k: int,
    state: Array,
    u: float,
    lasts: float,
    law: Restitution,
    allowed: float,
    rubs: Sequence[tuple[int, float]],
    rubbed: Sequence[bool],
) -> bool:
    """Whether the bounces of a chatter from velocity `u` on may make other elements switch.

    They have the duration `lasts`. Friction that is at rest in contact (`rubbed`) does not count.
    In total the impulses of the bounces change another guard by less than twice the sum of their
    velocities times its change by a unit jump.
    """
    (x, v), n, phase = mode.motion(state), mode.bodies, math.atan2(*state[:, -1])
    watched = [
        i for i, (j, w) in enumerate(mode.guards) if w.event in (SWITCH, HALT) and not rubbed[j]
    ]
    if not watched:
        return False
    part = _part(law, u)
    kicks = [mode.kick(k, x, phase), *(ratio * mode.kick(j, x, phase) for j, ratio in rubs)]
    by_v = mode.gradients(state, rates=True)[:, n : 2 * n]
    moving = mode.rate(state[None])[0, :, :n]
    for i in watched:
        by_place, by_rate, *_ = np.split(mode.gradient(i, state), [n, 2 * n])
        at_once = sum(abs(float(by_rate @ kick)) for kick in kicks)
        in_time = sum(abs(float(by_place @ kick + by_rate @ by_v @ kick)) for kick in kicks)
        change = (at_once + in_time * lasts) * 2.0 * u / part
        value, falls = mode.watched(i, state)[0], abs(float(by_place @ v + by_rate @ moving[1]))
        if change > max(allowed, SMALLEST) and value < 2.0 * (change + falls * lasts):
            return True
    return False


def coupling(
    mode: TaylorMode, chart: Chart, k: int, state: Array, rubs: Sequence[tuple[int, float]]
) -> tuple[float, float]:
    """Largest change of the state by a brief excursion of a gap, over its integral; the gap's drag.

    Positions of the other coordinates change by the derivative of their accelerations by the gap's
    rate. Their velocities change by the derivative of their accelerations by the gap, plus the
    derivative by their velocities times the change of positions.
    """
    n, p, (x, v) = mode.bodies, chart.places[k], mode.motion(state)
    curved = bool(mode.scene.curves)
    w, scene, phase = mode.scene.excitation.frequency, mode.scene, math.atan2(*state[:, -1])
    mass, _ = scene.motion.inertia(w, x, v, phase)
    by_x, by_v = scene.motion.tangent(w, x, v, phase)
    for row, regime in zip(scene.rows_at(x), mode.regimes, strict=True):
        along = np.outer(row, row)
        by_x, by_v = by_x - regime.stiffness * along, by_v - regime.damping * along
    by_x, by_v = (np.asarray(np.linalg.solve(mass, part), dtype=float) for part in (by_x, by_v))
    if curved or not scene.motion.equations.constant_mass:
        by_x = mode.gradients(state, rates=True)[:, :n]
    if curved:
        largest, drag = _along_function(mode, k, state, by_x, by_v)
    else:
        by_gap = chart.to_v @ by_x @ chart.back_x[:n, p]
        through = chart.to_v @ by_v @ chart.back_v
        others = np.delete(np.arange(n), p)
        moved = through[others, p]
        turned = by_gap[others] + through[np.ix_(others, others)] @ moved
        largest = max(abs(part).max(initial=0.0) for part in (moved, turned, by_gap[others]))
        drag = -through[p, p]
    for j, ratio in rubs:
        rub = ratio * mode.kick(j, x, phase)
        pulled = by_v @ rub
        largest += max(abs(pulled).max(), abs(by_x @ rub + by_v @ pulled).max())
    return float(largest) or 1.0, float(drag)


def _along_function(
    mode: TaylorMode, k: int, state: Array, by_x: Array, by_v: Array
) -> tuple[float, float]:
    """As `coupling`, along a function of the coordinates: kicks change direction with position."""
    (x, v), phase = mode.motion(state), math.atan2(*state[:, -1])
    kick, row = mode.kick(k, x, phase), mode.scene.rows_at(x)[k]
    moved, by_gap = by_v @ kick, by_x @ kick
    step = _TURN / (1.0 + float(np.linalg.norm(v)))
    ends = mode.kick(k, x + step * v, phase), mode.kick(k, x - step * v, phase)
    turned = (ends[0] - 2.0 * kick + ends[1]) / step**2
    parts = moved, by_gap + by_v @ moved, by_gap, turned
    largest = max(float(abs(part).max()) for part in parts)
    return largest, -float(mode.scene.elements[k].sign * (row @ moved))
