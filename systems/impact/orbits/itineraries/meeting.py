"""Borders of an orbit that are met at once, as in both halves of a symmetric orbit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.borders import Border
from dynkit.systems.impact.orbits.itineraries.borders import TouchingGuard
from dynkit.systems.impact.orbits.itineraries.motion import AT_ONCE
from dynkit.systems.impact.simulation.state import TWO_PI

_MET = 1e-6
"""Largest residual of a border that is met, in its units, and largest difference of equal phases.

The parameter may be quadratic in the residual. Then the residual at another phase is the square
root of a rounding error.
"""

_ASIDE, _WIDE = 1e-6, 1e-2
"""Distance of guesses from the border, relative to the parameter, and shift of their phases.

The shift is large so that Newton's method keeps the order of the events.
"""


def beyond(problem: Any, event: int, x: Array, p: Array) -> list[tuple[Any, Array, Array]]:
    """Equations, unknowns and parameters of the orbit that meets this one at border number `event`.

    If the orbit meets borders of the same kind at other phases, as in both halves of a symmetric
    orbit, the events change at all of them. If these are events without impacts, Newton's method
    does not converge from the border itself. Then there are two guesses, one on either side of it.
    """
    solution = problem.at(x, p)
    borders = problem.borders(solution)
    border, found = borders[event], borders[event].neighbour(x, p)
    own = _meeting(problem, border, solution)
    if found is None:
        return []
    if own is None:
        return [(*found, p)]
    alike = [_meeting(problem, each, solution) for each in borders if type(each) is type(border)]
    places = [each for each in alike if each and not _agree(problem, own, each)]
    for place in places:
        other, y = found
        now = other.at(y, p)
        for each in other.borders(now):
            same = type(each) is type(border) and _agree(other, _meeting(other, each, now), place)
            if same:
                found = each.neighbour(y, p) or found
                break
    other, y = found
    switches = isinstance(border, TouchingGuard) and other.layout.impacts == problem.layout.impacts
    if not (places and switches):
        return [(other, y, p)]
    guess, now = y.copy(), other.at(y, p)
    for i in np.flatnonzero(abs(now.durations) <= AT_ONCE * now.period):
        guess[[i, (i + 1) % now.events]] += [-_WIDE, _WIDE]
    aside = _ASIDE * np.where(p, abs(p), 1.0)
    return [(other, guess, p + aside), (other, guess, p - aside)]


def _meeting(problem: Any, border: Border, solution: Any) -> tuple[float, int] | None:
    """Phase and element where a border is met; None where it is not."""
    try:
        own = border.begin(solution)
        left = border.left(solution, own)
    except NoMotion:
        return None
    phase, element = border.place(solution, own)
    begins = isinstance(border, TouchingGuard) and any(
        _apart(problem, phase, each) <= _MET for each in solution.event_phases
    )
    return None if begins or not np.abs(left).max() <= _MET else (phase, element)


def _agree(problem: Any, one: tuple[float, int] | None, other: tuple[float, int]) -> bool:
    return one is not None and one[1] == other[1] and _apart(problem, one[0], other[0]) <= _MET


def _apart(problem: Any, one: float, other: float) -> float:
    return abs(math.remainder(one - other, TWO_PI * problem.periods))
