"""Directions in which disturbances vanish: what stops, sticking friction and sliders take."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynkit.systems.impact.elements.element import RIDES
from dynkit.systems.impact.elements.laws import ImpactLaw, rebound
from dynkit.systems.impact.modes.structure import independent
from dynkit.systems.impact.variational.map_derivative import along

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure
    from dynkit.systems.impact.simulation.trajectory import Trajectory


def lost_directions(oscillator: DrivenStructure, run: Trajectory) -> NDArray[np.intp]:
    """Number (n,) of directions, at least, in which the map to each impact of a run is constant.

    The rank of a product is at most that of each factor. A closed stop takes a position and a
    velocity, friction that sticks a velocity, a slider that slides its place. An impact of slope
    zero takes the relative velocity, and one that stops the slip of friction this slip.
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
        ends = [taken[k] + _at_impact(oscillator, run, k) for k in last.tolist()]
        found = np.maximum(found, ends)
    return np.minimum(found, oscillator.dimension)


def _taken(oscillator: DrivenStructure, regimes: tuple[int, ...]) -> int:
    """Number of directions that a mode has less than the free structure."""
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


def _at_impact(oscillator: DrivenStructure, run: Trajectory, k: int) -> int:
    """Number of directions that the impact at the end of segment k takes.

    Where the energies are not quadratic, without friction at the contact that it stops.
    """
    s, automaton = run.segments, oscillator._automaton
    guard, point = automaton.guards[int(s.guard[k + 1])], int(s.point[k])
    law = oscillator._stops[int(run.element[point])].restitution
    law_of_speed = isinstance(law, ImpactLaw)
    if oscillator._motion is not None or not (law_of_speed or guard.scrapes):
        return int(run.log.speed[point] == 0.0 if law_of_speed else law == 0.0)
    mode = automaton.modes[guard.mode]
    lasts = s.begin[[k + 1]] - s.begin[k]
    y = mode.after(s.of(mode, [k]), np.zeros(1, dtype=np.intp), lasts)[0]
    rate = along(guard.sum, 2) @ y.ravel()
    r, slope = rebound(law, np.array([rate]))
    taken = int(np.ravel(slope)[0] == 0.0)
    for part in guard.scrapes:
        slip = along(part.slip, 0) @ y.ravel() + part.slip.offset
        taken += int(abs(slip) <= abs((1.0 + np.ravel(r)[0]) * part.ratio * rate))
    return taken
