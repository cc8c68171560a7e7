"""Error estimates of the states of orbits of several modes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.itineraries.several_modes.shooting import ShootingSolution

_MOST = 1000
"""Approximate limit of the coordinates of all states that are unknowns of the error estimate."""

_ROUNDING = 2.0**-52


def error_of(problem: Any, x: Array, p: Array) -> float:
    """Estimate of the largest error of a section coordinate, of `ItineraryEquations`.

    See `ImpactOrbit.error`.

    Here the states before all events are unknowns, up to `_MOST` coordinates. So the rounding error
    of a flight enters at its end, and is not first multiplied along the orbit and then reduced
    again by the inverse Jacobian.
    """
    phases, impulses, _ = problem.layout.split(x)
    n, d = len(phases), problem.dimension
    nodes = {*problem.nodes, *range(0, n, math.ceil(n * d / _MOST))}
    fine = problem.remade(nodes=tuple(sorted(nodes)))
    coarse = problem.at(x, p)
    begun = coarse.progression.removed(coarse.before[list(fine.nodes), :d])
    y = np.concatenate([phases, impulses, begun.ravel()])
    s, scale = fine.at(y, p), fine.scale(y)
    try:
        inverse = np.linalg.inv(fine.linearization(y, p) * scale)
    except np.linalg.LinAlgError:
        return math.inf
    some = coarse.course.nodes if coarse.course.sticks else s.hits
    by = (_sections(s, fine, some) * scale) @ inverse
    missed, rounded = abs(fine.residual(y, p)), fine.rounding(y, p)
    errors = abs(by) @ missed + 2.0 * np.sqrt(by**2 @ rounded**2)
    along = abs(s.progression.shift @ s.progression.part)
    lost = 2.0 * np.linalg.norm(s.rounded[:, :d] @ along.T, axis=0).max()  # not in any equation
    sizes = abs(coarse.section_states).max(initial=0.0), abs(phases).max()
    return float(errors.max() + lost + 4.0 * _ROUNDING * max(sizes))


def _sections(s: ShootingSolution, fine: Any, some: Sequence[int]) -> Array:
    """Derivatives (q, m) by the unknowns: of phases, impulses, section states and progression.

    Section states are those just after the events `some`, or inside flights if there are none.
    """
    n, d, unit = s.events, s.dimension, np.eye(fine.size)
    first = n + fine.layout.impacts
    after, gone = [], [np.zeros((d, fine.size))]
    along = s.progression.shift @ s.progression.part
    for i, _, changed, end in s.changes(1.0):
        after.append(changed)
        gone.append(gone[-1] + along @ end[:d] if i + 1 in s.course.nodes else gone[-1])
    ended = [gone[-1] + along @ end[:d]] if s.progression.shift.size else []
    if not some:
        return np.concatenate([unit[:n], *_passed(s, after, gone), *ended])
    own = [after[i][:d] + gone[i] for i in some]
    return np.concatenate([unit[:n], unit[n:first], *own, *ended])


def _passed(s: ShootingSolution, after: list[Array], gone: list[Array]) -> list[Array]:
    """Derivatives of the section states that lie inside flights, by the unknowns."""
    begins, found = (s.event_phases - s.event_phases[0]) / s.clock, []
    for time in ((s.phases - s.event_phases[0]) / s.clock % s.period).tolist():
        i = int(np.searchsorted(begins, time, side="right")) - 1
        flights = s.flights(s.following[i].mode)
        z, passed = flights.passed(s.after[i], time - float(begins[i]))
        change = passed @ after[i]
        if s.driven:
            change[:, i] -= flights.rates(z[None])[0] / s.clock
        found.append(change[: s.dimension] + gone[i])
    return found
