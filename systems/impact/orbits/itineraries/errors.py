"""Errors of the states of orbits of several modes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.itineraries.shooting import ShootingSolution

_MOST = 1000
"""The states before so many events at most are unknowns that these have as many coordinates."""

_ROUNDING = 2.0**-52


def error_of(problem: Any, x: Array, p: Array) -> float:
    """Estimate of the largest error of a section coordinate, of `ItineraryEquations`.

    See `ImpactOrbit.error`.

    The states before all events are unknowns here: so rounding of a flight is an error of its own
    end, and need not grow along the orbit before the inverse derivative shrinks it again.
    """
    phases, impulses, _ = problem.layout.split(x)
    n, d = len(phases), problem.dimension
    nodes = {*problem.nodes, *range(0, n, math.ceil(n * d / _MOST))}
    fine = problem.remade(nodes=tuple(sorted(nodes)))
    coarse = problem.at(x, p)
    y = np.concatenate([phases, impulses, coarse.before[list(fine.nodes), :d].ravel()])
    s, scale = fine.at(y, p), fine.scale(y)
    try:
        inverse = np.linalg.inv(fine.linearization(y, p) * scale)
    except np.linalg.LinAlgError:
        return math.inf
    some = coarse.course.nodes if coarse.course.sticks else s.hits
    by = (_sections(s, fine, some) * scale) @ inverse
    missed, rounded = abs(fine.residual(y, p)), fine.rounding(y, p)
    errors = abs(by) @ missed + 2.0 * np.sqrt(by**2 @ rounded**2)
    sizes = abs(coarse.section_states).max(initial=0.0), abs(phases).max()
    return float(errors.max() + 4.0 * _ROUNDING * max(sizes))


def _sections(s: ShootingSolution, fine: Any, some: Sequence[int]) -> Array:
    """Rows (q, m): phases, and changes of states just after the events of the section."""
    n, d, unit = s.events, s.dimension, np.eye(fine.size)
    first = n + fine.layout.impacts
    after = [changed for _, _, changed, _ in s.changes(1.0)]
    if not some:
        return np.concatenate([unit[:n], *_passed(s, after)])
    return np.concatenate([unit[:n], unit[n:first], *(after[i][:d] for i in some)])


def _passed(s: ShootingSolution, after: list[Array]) -> list[Array]:
    """Changes of the section's states amid flights."""
    begins, found = (s.event_phases - s.event_phases[0]) / s.clock, []
    for time in ((s.phases - s.event_phases[0]) / s.clock % s.period).tolist():
        i = int(np.searchsorted(begins, time, side="right")) - 1
        flights = s.flights(s.following[i].mode)
        z, passed = flights.passed(s.after[i], time - float(begins[i]))
        change = passed @ after[i]
        if s.driven:
            change[:, i] -= flights.rates(z[None])[0] / s.clock
        found.append(change[: s.dimension])
    return found
