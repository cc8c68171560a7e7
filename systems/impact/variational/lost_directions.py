"""Directions in which disturbances vanish because of stops, sticking friction and sliders."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import RIDES
from dynkit.systems.impact.elements.laws import ImpactLaw, rebound
from dynkit.systems.impact.modes.structure import independent
from dynkit.systems.impact.simulation.trajectory import grouped
from dynkit.systems.impact.variational.saltation import along

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure
    from dynkit.systems.impact.simulation.joined_modes import Guard
    from dynkit.systems.impact.simulation.trajectory import Trajectory

_Rates: TypeAlias = "tuple[float, list[tuple[float, float]]]"


def lost_directions(oscillator: DrivenStructure, run: Trajectory) -> NDArray[np.intp]:
    """Lower bound (n,) of the number of directions in which the map to each impact is constant.

    The rank of a product is at most that of each factor. A closed stop removes a position and a
    velocity, sticking friction a velocity, and a sliding slider its position. An impact whose
    rebound velocity has slope zero removes the relative velocity, and an impact whose friction ends
    a slip removes this slip velocity.
    """
    s, known = run.segments, dict[int, int]()
    lasts, numbers = np.diff(s.begin), s.mode[:-1]
    for number in np.unique(numbers).tolist():
        known[number] = _taken(oscillator, run.regimes[number])
    taken = np.array([known[number] for number in numbers.tolist()])
    found = np.zeros(run.impacts, dtype=np.intp)
    np.maximum.at(found, s.point[:-1], np.where(lasts > 0.0, taken, 0))
    if not oscillator._strobed:
        last = np.flatnonzero(s.point[1:] > s.point[:-1])
        ends = taken[last]
        for number, where in grouped(s.guard[last + 1]):
            ends[where] += _at_impacts(oscillator, run, last[where], number)
        found = np.maximum(found, ends)
    return np.minimum(found, oscillator.dimension)


def _taken(oscillator: DrivenStructure, regimes: tuple[int, ...]) -> int:
    """Number of directions of the free structure that a mode removes."""
    parts, n = oscillator._automaton.parts, oscillator.degrees_of_freedom
    held, sticking = parts.grips(regimes)
    still, moving = (_rank(oscillator, some) for some in (held, (*held, *sticking)))
    slide = sum(way not in (0, RIDES) for way in parts.slides(regimes))
    return min(still + moving, 2 * n) + slide


def _rank(oscillator: DrivenStructure, elements: tuple[int, ...]) -> int:
    """Number of independent rows of elements, or of functions of the coordinates."""
    own = [oscillator._elements[k] for k in elements]
    rows = [each.row(oscillator._size) for each in own if not each.curved]
    functions = {each.coordinate for each in own if each.curved}
    rank = len(independent(np.array(rows))) if rows else 0
    return min(rank + len(functions), oscillator.degrees_of_freedom)


def _at_impacts(oscillator: DrivenStructure, run: Trajectory, some: Any, number: int) -> Any:
    """Number of directions that each impact at the end of some segments removes.

    All of them are impacts of one guard.
    """
    s, automaton = run.segments, oscillator._automaton
    guard = automaton.guards[number]
    law = oscillator._stops[int(run.element[s.point[some[0]]])].restitution
    mode, bent = automaton.modes[guard.mode], oscillator._motion is not None
    varies = bent and automaton.parts.most_rubs > 0 and not mode.constant_kicks
    if not (isinstance(law, ImpactLaw) or guard.scrapes or varies):
        return int(law == 0.0)
    return [_at_impact(oscillator, run, k, guard, law) for k in some.tolist()]


def _at_impact(oscillator: DrivenStructure, run: Trajectory, k: int, guard: Any, law: Any) -> int:
    """Number of directions that the impact at the end of segment k removes."""
    s, automaton = run.segments, oscillator._automaton
    mode, bent = automaton.modes[guard.mode], oscillator._motion is not None
    lasts, first = s.begin[[k + 1]] - s.begin[k], np.zeros(1, dtype=np.intp)
    y = mode.after(s.states[[k]] if bent else s.of(mode, [k]), first, lasts)[0]
    rate, slips = _rates(automaton, guard, y) if bent else _sums(guard, y)
    r, slope = (float(np.ravel(each)[0]) for each in rebound(law, np.array([rate])))
    stopped = [abs(slip) <= abs((1.0 + r) * ratio * rate) for ratio, slip in slips]
    return int(slope == 0.0) + sum(stopped)


def _sums(guard: Guard, y: Array) -> _Rates:
    """Rate of a gap, and ratio and slip of each friction at its impact, by exponential sums."""
    slips = [
        (part.ratio, along(part.slip, 0) @ y.ravel() + part.slip.offset) for part in guard.scrapes
    ]
    return float(along(guard.sum, 2) @ y.ravel()), slips


def _rates(automaton: Any, guard: Guard, y: Array) -> _Rates:
    """As `_sums`, for a structure whose energies are not quadratic."""
    mode = automaton.modes[guard.mode]
    rubs = automaton.scrapes(guard, mode.motion(y)[0], float(np.arctan2(*y[:, -1])))
    slips = [(ratio, mode.gap_at(k, y)[1]) for k, ratio in rubs]
    return mode.gap_at(guard.element, y)[1], slips
