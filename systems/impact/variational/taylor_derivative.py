"""Derivative of the impact map by variational equations, if the energies are not quadratic.

A disturbance (x, v, positions of sliders, phase) compares states at their own events: if an event
is later by s, the disturbance also changes by s times the rate of the state.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.differences import STEP
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import IMPACT
from dynkit.systems.impact.elements.friction import FORWARD, STICKS
from dynkit.systems.impact.variational.saltation import comes_by_itself, reset

_LOW = 1e-7
"""Duration of a flight, in radians of the phase, below which rounding hides the changes over it."""

if TYPE_CHECKING:
    from dynkit.systems.impact.modes.taylor.mode import TaylorMode
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure
    from dynkit.systems.impact.simulation.trajectory import Trajectory


def followed(oscillator: DrivenStructure, run: Trajectory, lifted: Array) -> tuple[Array, Any]:
    """Disturbances (2 N + J + 1, d) before the last impact of a run, and the state there.

    Parameters
    ----------
    run : Trajectory
        One impact from a start.
    lifted : (2 (N + J + 1), d)
        Disturbances of the state at the start.
    """
    automaton, s, n = oscillator._automaton, run.segments, oscillator.degrees_of_freedom
    sine, cosine = run.start._turn
    parts = lifted.reshape(2, oscillator._size + 1, -1)
    turned = cosine * parts[0, -1] - sine * parts[1, -1]
    out = np.concatenate([parts[0, :n], parts[1, :n], parts[0, n:-1], turned[None]])
    last, ended = len(s.begin) - 1, out[-1] * 0.0
    for i in range(last):
        mode: TaylorMode = automaton.modes[int(s.mode[i])]
        state, duration = s.states[i], float(s.begin[i + 1] - s.begin[i])
        guard = automaton.guards[int(s.guard[i + 1])]
        number = int(s.guard[i + 1]) - automaton.guard(guard.mode, -1)
        final = oscillator._strobed and not oscillator._cycled and i == last - 1
        for j, k in enumerate(mode.scene.sliders):
            if not mode.regimes[k].anchored:
                out[2 * n + j] = mode.scene.rows_at(state[0, :n])[k] @ out[:n]
        low = i == last - 1 and _flies_low(oscillator, run, duration, int(s.element[i]))
        if low:
            state, out, late = _low_flight(oscillator, run, mode, state, duration, out)
            ended = ended + late
        else:
            if duration > 0.0:
                state, flow = mode.flow(state, duration, int(s.element[i]))
                out = flow @ out
            moving = mode.rate(state[None])[0]
            rate = np.concatenate([*moving[:, :n], moving[0, n:-1], [oscillator.frequency]])
            if final:
                later = -ended
            else:
                at_once = not oscillator._strobed and s.begin[i + 1] == s.begin[last]
                if duration > 0.0 and guard.watch.force and at_once:  # caused by the next impact
                    side = run.final.element
                    number = next(j for j, (k, _) in enumerate(mode.guards) if k == side)
                row = mode.gradient(number, state)
                speed = float(row @ rate)
                comes = duration > 0.0 or comes_by_itself(
                    s, i, guard, mode.watched(number, state)[0], row * rate, oscillator.frequency
                )
                later = -(row @ out) / speed if comes else 0.0 * ended
            out = out + np.outer(rate, later)
            ended = ended + later
        sticks = mode.scene.elements[guard.element].regimes[guard.watch.to].sticks
        if i < last - 1 and (guard.watch.event == IMPACT or sticks):
            rubs: Any = 0.0
            if guard.watch.event == IMPACT and float(s.speed[i + 1]) > 0.0:
                # friction in the bounces that contact replaces: see `map_derivative._kept_slipping`
                ways = partial(_way_on, automaton, s.begin[i + 1 :], s.guard[i + 1 :])
                u = mode.gap_at(guard.element, state)[1]
                rubs = rubbed(oscillator, guard, state, out, 0.0, 0.0, u, ways)
            out = hit(mode, guard.element, state, out, 0.0, 0.0)[0] + rubs
    return out, state


def hit(
    mode: TaylorMode, k: int, state: Array, disturbances: Array, slope: float, r: float
) -> tuple[Array, Array]:
    """Disturbances (2 N + J + 1, d) after an impact, and (d,) of the gap's rate before it."""
    n, out = mode.bodies, disturbances.copy()
    x, phase, rate = state[0, :n], float(np.arctan2(*state[:, -1])), mode.gap_at(k, state)[1]
    by_rate = mode.rate_row(k, state) @ disturbances
    out[n : 2 * n] += reset(slope, mode.kick(k, x, phase), by_rate)
    if not mode.constant_kicks:
        by_place = mode.kick_by_place(k, x, phase)
        moved = np.concatenate([disturbances[:n], disturbances[-1:]])
        out[n : 2 * n] -= (1.0 + r) * rate * (by_place @ moved)
    return out, by_rate


def _flies_low(oscillator: DrivenStructure, run: Trajectory, duration: float, left: int) -> bool:
    """Whether a flight returns to its stop so soon that rounding hides the changes over it."""
    side, brief = run.final.element, 0.0 < duration * oscillator.frequency < _LOW
    number = brief and not oscillator._strobed and not oscillator._bent
    r = oscillator._stops[side].restitution if number else 0.0
    return side == left == run.start.element and isinstance(r, float) and r > 0.0


def _low_flight(
    oscillator: DrivenStructure,
    run: Trajectory,
    mode: TaylorMode,
    start: Array,
    duration: float,
    given: Array,
) -> tuple[Array, Array, Array]:
    """State and disturbances at the end of such a flight, and disturbances (d,) of its end time.

    The gap and its disturbances are zero at the begin. Their values at the end are computed as
    changes over the flight alone, without cancellation.
    """
    k, n, out = run.final.element, mode.bodies, np.zeros_like(given)
    state, _ = mode.flow(start, duration, k)
    term = given
    by = mode.gradients(start, rates=True)
    for order in (1, 2):
        moved = np.zeros_like(given)
        moved[:n], moved[n : 2 * n] = term[n : 2 * n], by @ term
        for j, slider in enumerate(mode.scene.sliders):
            if not mode.regimes[slider].anchored:
                row = mode.scene.elements[slider].sign * mode.rate_row(slider, start)[: 2 * n]
                moved[2 * n + j] = row @ term[: 2 * n]
        term = moved * (duration / order)
        out += term
    row, speeds = mode.scene.elements[k].sign * mode.scene.rows[k], mode.rate_row(k, start)
    risen = row @ out[:n] + duration * speeds[-1] * given[-1]
    r: Any = oscillator._stops[k].restitution
    speed = float(run.log.speed[-1]) / r
    moving, later = mode.rate(state[None])[0], risen / speed
    rate = np.concatenate([*moving[:, :n], moving[0, n:-1], [oscillator.frequency]])
    return state, given + out + np.outer(rate, later), later


def rubs_on(automaton: Any, times: Array, guards: Any, element: int) -> int:
    """Regime of friction as contact begins, from the events at the first of some times."""
    now = (automaton.guards[g] for g in guards[times == times[0]].tolist())
    return next((g.watch.to for g in now if g.element == element), STICKS)


def _way_on(automaton: Any, times: Array, guards: Any, element: int) -> int:
    """Sign of the slip of friction as contact begins; 0 if it sticks: see `rubs_on`."""
    to = rubs_on(automaton, times, guards, element)
    return 0 if to == STICKS else 1 if to == FORWARD else -1


def rubbed(
    oscillator: DrivenStructure,
    guard: Any,
    state: Array,
    disturbances: Array,
    slope: float,
    r: float,
    rate: float,
    ways: Callable[[int], int] | None = None,
) -> Array:
    """Change (2 N + J + 1, d) of disturbances by the friction at an impact.

    `ways` is a function that returns the sign of each element's slip after the impact, and 0 if the
    impact stops the slip. By default the impact stops a slip that it can take completely.
    """
    automaton, stop, out = oscillator._automaton, guard.element, 0.0 * disturbances
    mode: TaylorMode = automaton.modes[guard.mode]
    x, phase = mode.motion(state)[0], float(np.arctan2(*state[:, -1]))
    for k, ratio in automaton.scrapes(guard, x, phase):
        w = mode.gap_at(k, state)[1]
        stops = abs(w) <= -(1.0 + r) * ratio * rate if ways is None else not ways(k)
        if stops:
            out += _slowed(mode, k, state, disturbances, w, mode.rate_row(k, state), None)
        else:
            way = np.sign(w) if ways is None else ways(k)
            row = -way * (1.0 + slope) * mode.rate_row(stop, state)
            out += _slowed(mode, k, state, disturbances, -way * (1.0 + r) * rate, row, ratio)
    return out


def _slowed(
    mode: TaylorMode,
    k: int,
    state: Array,
    disturbances: Array,
    lost: float,
    row: Array,
    ratio: float | None,
) -> Array:
    """Change of disturbances if friction reduces its slip by `lost`, times the ratio if given.

    The derivative of `lost` is the row (2 N + J + 1,); ratio and kick depend on the positions.
    """
    n, out, over = mode.bodies, 0.0 * disturbances, 1.0 if ratio is None else ratio
    x, phase = mode.motion(state)[0], float(np.arctan2(*state[:, -1]))
    out[n : 2 * n] = -over * np.outer(mode.kick(k, x, phase), row @ disturbances)
    if not mode.constant_kicks:
        here = np.append(x, phase) + 1j * STEP * np.eye(n + 1)
        kicks = [mode.kick_in(mode.scene, k, at[:-1], at[-1]) for at in here]
        parts = [1.0 if ratio is None else mode.takes(k, at[:-1], at[-1]) for at in here]
        by = np.array([a * b for a, b in zip(kicks, parts, strict=True)]).imag.T / STEP
        out[n : 2 * n] -= lost * (by @ np.concatenate([disturbances[:n], disturbances[-1:]]))
    return out
