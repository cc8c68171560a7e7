"""Saltation: the effect of events on small disturbances.

An impact changes the rate g' of the gap by J = -(1 + r) g', and the state by J b, where b is the
kick. Let c and c' be the rows of the gap and of its rate, A the generator of the flow, and g' and
g'' the values before the impact. Let y be a disturbance of the state, and s one of the time of the
impact. The disturbance of the state after the impact, compared at one time, is

    y - (1 + r) b (c' y + g'' s) + (1 + r) g' A b s.

For an impact where the gap is zero, s = -c y / g'. If r depends on the velocity -g', the first r
in this formula is the slope d(r g')/dg', and the second one is r.

References
----------
P. C. Mueller, Calculation of Lyapunov exponents for dynamic systems with discontinuities, Chaos,
Solitons & Fractals 5 (1995) 1671-1681 (saltation matrices).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import HALT, EventKind
from dynkit.systems.impact.modes.mode import transformed

_AT_ONCE = 1e-9
"""Time, in radians of the forcing, within which a guard counts as zero. Also the relative size of a
speed, which is a sum, below which it counts as rounding: abs(sum) < _AT_ONCE * sum(abs(terms))."""

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure
    from dynkit.systems.impact.simulation.trajectory import Segments


def comes_by_itself(
    s: Segments, k: int, guard: Any, value: float, rates: Array, frequency: float
) -> bool:
    """Whether the event after segment k of zero duration is independent of the event before it.

    Such events occur in symmetric machines: the guard is zero, and falls at a speed, the sum of the
    rates, beyond rounding. Friction that sticks from an impact on is excluded, as the impact makes
    its slip zero, and so is a second event of the same element.
    """
    sticks = guard.watch.event == HALT and s.kind[k] == EventKind.IMPACT
    own = s.element[k] == guard.element
    return falls(value, rates, frequency) and not sticks and not bool(own)


def falls(value: float, rates: Array, frequency: float) -> bool:
    """Whether a guard is zero, and falls at a speed, the sum of the rates, beyond rounding."""
    speed, size = float(rates.sum()), float(abs(rates).sum())
    return speed < -_AT_ONCE * size and abs(value) * frequency <= -_AT_ONCE * speed


def reset(slope: float | Array, kick: Array, by_rate: Array) -> Array:
    """Change (..., d, k) of disturbances by impacts, from disturbances (..., k) of the gap's rate.

    The slope is one number, or an array (..., 1, 1).
    """
    return np.asarray(-(1.0 + slope) * (kick[:, None] * by_rate[..., None, :]))


def struck(
    oscillator: DrivenStructure, guard: Any, slope: Array, y: Array, derivative: Array
) -> Array:
    """Change of derivatives (m, 2 slots, d) by impacts at states (m, 2, slots) of one guard.

    The slopes are (m,). Friction at the impacts is included.
    """
    stop, mode = oscillator._stops[guard.element], oscillator._automaton.modes[guard.mode]
    kick = mode.placed(stop.sign * mode.contact(stop.row(oscillator._size)).kick[:2])
    change = reset(slope[:, None, None], kick.ravel(), along(guard.sum, 2) @ derivative)
    for i in range(len(y)) if guard.scrapes else ():
        own = float(slope[i]), guard.sum, y[i], derivative[i]
        change[i] += sum(scraped(part, *own) for part in guard.scrapes)
    return change


def slowed(part: Any, jump: float, y: Array) -> Array:
    """Change that friction at an impact subtracts from a state (2, slots).

    The jump is (1 + r) times the gap's rate. Friction reduces the slip velocity by `ratio` times
    this jump, or to zero if the slip velocity is less.
    """
    w = float(along(part.slip, 0) @ y.ravel()) + part.slip.offset
    most = abs(part.ratio * jump)
    return np.asarray(min(max(w, -most), most) * part.kick[:2])


def scraped(part: Any, restitution: float, gap: Any, y: Array, derivative: Array) -> Array:
    """Change of a derivative (2 slots, d) by the friction at an impact: see `slowed`."""
    w, kick = float(along(part.slip, 0) @ y.ravel()) + part.slip.offset, part.kick[:2].ravel()
    by_rate = (1.0 + restitution) * part.ratio * along(gap, 2)
    if abs(w) <= abs(float(by_rate @ y.ravel())):
        return -np.outer(kick, along(part.slip, 0) @ derivative)
    return np.outer(kick, np.sign(w) * by_rate @ derivative)


def along(ladder: Any, order: int) -> Array:
    """The row (2 slots,) of f (order 0) or f' (order 2) of an exponential sum."""
    row = np.zeros((2, ladder.step.shape[2]))
    row[:, : ladder.rows.shape[1]] = ladder.rows[order : order + 2]
    return row.ravel()


def saltation(slope: float | Array, rates: Array, bends: Array) -> Array:
    """Numbers p and q, (n, 2), of saltation matrices 1 + b (p c + q c') - (1 + r) A b c of impacts.

    They depend on g' and g'' before the impacts, (n,); q is -(1 + r) if r is constant. They are
    zero for a grazing impact, g' = 0, since no derivative exists there.
    """
    found, hit = np.empty((len(rates), 2)), rates != 0.0
    found[:, 0] = (1.0 + slope) * bends / np.where(hit, rates, np.inf)
    found[:, 1] = -(1.0 + slope) * hit
    return found


def release(oscillator: DrivenStructure, guard: Any) -> Array:
    """Derivative (2N, 2 stuck modes) of the free state by the stuck state at a release.

    The contact force is zero at the release. Therefore the rate of the state does not jump, and a
    change of the time of release has no effect.
    """
    layout, free = oscillator._automaton.modes[guard.mode].layout, oscillator._free.layout
    rows = guard.change[:, :-1].reshape(2, -1, 2, layout.slots)[:, free.modes][..., layout.modes]
    return np.asarray(rows.reshape(oscillator.dimension, 2 * len(layout.modes)))


def closing(oscillator: DrivenStructure, guard: Any, states: Array, speeds: Array) -> Array:
    """Derivatives (k, 2 stuck modes, 2N) of stuck states by the free states (k, 2, slots) before.

    Contact begins at an impact, in place of the omitted bounces. A disturbance g of the gap just
    after this impact means that the impact is later by -g / u. This delay has an effect, since the
    rate of the state jumps as contact begins.
    """
    stuck, matrix = oscillator._automaton.modes[guard.target], guard.change[:, :-1]
    modes, slots, n = stuck.layout.modes, stuck.layout.slots, oscillator.degrees_of_freedom
    free_modes = oscillator._free.layout.modes
    down = matrix.reshape(2, slots, 2, -1)[:, modes][..., free_modes]
    rates = oscillator._free.rate(states).reshape(len(states), -1)
    change = (rates @ matrix.T).reshape(-1, 2, slots)
    change -= stuck.rate(transformed(guard.change, states))
    change = change[..., modes].reshape(len(states), 2 * len(modes))
    bounces: Any = speeds > 0.0
    by_gap = np.zeros_like(change)
    by_gap[bounces] = -change[bounces] / speeds[bounces, None]
    place = along(guard.sum, 0).reshape(2, -1)[:, free_modes].reshape(2 * n)
    return np.asarray(down.reshape(-1, 2 * n) + by_gap[:, :, None] * place)
