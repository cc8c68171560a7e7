"""Steps that are short enough to tell what happens within."""

from __future__ import annotations

from typing import final

import numpy as np

from dynkit.continuation.arclength import Point
from dynkit.continuation.crossings import Crossing, Located
from dynkit.continuation.initial_tangents import crossing_directions
from dynkit.continuation.locating import solved
from dynkit.continuation.orbit_equations import OrbitEquations
from dynkit.continuation.test_functions import crossings, examine
from dynkit.core.validation import Array
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.newton import NoSolution
from dynkit.orbits.problem import Problem

# Steps shorter than this, in scaled unknowns, are not halved to tell bifurcations apart. This and
# the next ones are parts of the distance to an orbit of a shorter period where that is below one.
_SHORTEST = 1e-4
# Nor than this, where events begin to tell something, so that little happens unseen.
_UNSEEN = 1e-3
# From one branch to another that comes so near it may step.
_JUMP = 1e-6
# The parameter's part in the tangent of a branch that folds.
_LEVEL = 1e-4
_BRANCH_POINT = Crossing(BifurcationKind.BP)


@final
class Watch:
    """Fills in what is seen at each point, and refuses steps within which too much happens."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem

    def __call__(self, before: Point, after: Point) -> bool:
        try:
            after.seen = examine(self._problem, after)
        except NoSolution:
            return False
        way = (after.y - before.y) / before.scale
        sizes = (self._problem.repetition(point.y[:-1]) for point in (before, after))
        length = float(np.sqrt(way @ way)) / min(max(sizes), 1.0)
        events = zip(before.seen.events, after.seen.events, strict=True)
        values = [(a.value, b.value) for a, b in events]
        # an event is beyond its border right where there is something to watch
        appears = any(max(pair) == np.inf and min(pair) < 0.0 for pair in values)
        # an event tells something on one side only
        clears = any(np.isnan(a) != np.isnan(b) for a, b in values)
        if (length > _SHORTEST and appears) or (length > _UNSEEN and clears):
            return False
        found = crossings(before, after)
        if _BRANCH_POINT in found:
            # with no branch point between them the two are on different branches
            located = solved(self._problem, before, after, _BRANCH_POINT)
            if located is None and length > _JUMP:
                return False
            after.seen.branch_point = located
            after.seen.flat = located and self._flat(located, before, way)
            if after.seen.flat is not None:
                found = tuple(
                    crossing for crossing in found if crossing.kind is not BifurcationKind.SN
                )
        after.seen.crossings = found
        return len(found) <= 1 or length <= _SHORTEST

    def _flat(self, located: Located, before: Point, way: Array) -> Array | None:
        equations = OrbitEquations(self._problem, float(before.scale[-1]))
        place = np.append(located.x, located.p)
        directions = crossing_directions(equations, place, before.scale)
        directions = directions or [way / np.sqrt(way @ way)]
        tangent = max(directions, key=lambda direction: abs(float(direction @ way)))
        return tangent if abs(tangent[-1]) < _LEVEL else None
