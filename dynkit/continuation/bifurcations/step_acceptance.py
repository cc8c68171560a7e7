"""Acceptance of steps that are short enough to separate the bifurcations within them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from dynkit.continuation.bifurcations.locating import solved
from dynkit.continuation.crossings import Crossing, Located, Seen
from dynkit.continuation.initial_tangents import crossing_directions
from dynkit.continuation.orbit_equations import OrbitEquations
from dynkit.continuation.points import Point
from dynkit.continuation.test_functions import TestFunction, crossings, examine
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.kinds import BifurcationKind

# Shortest step, in scaled unknowns, that is halved to separate bifurcations. This and the next two
# lengths are relative to the `repetition` if the repetition is below one.
_SHORTEST = 1e-4
# Shortest step that is halved where the sign of an event is defined at one end only.
_UNSEEN = 1e-3
# Shortest step that is halved because it may jump to another branch.
_JUMP = 1e-6
# Largest component of the parameter in the tangent of a branch at a fold.
_LEVEL = 1e-4
_BRANCH_POINT = Crossing(BifurcationKind.BP)


@final
@dataclass(frozen=True)
class Acceptance:
    """Examines points, and refuses steps that contain several bifurcations."""

    problem: Problem
    tests: tuple[TestFunction, ...]

    def __call__(self, before: Point, after: Point) -> tuple[Point, bool]:
        """Return the examined point, and whether the step to it is short enough."""
        try:
            seen = examine(self.problem, after)
        except NoMotion:
            return after, False
        after = replace(after, seen=seen)
        found, (appears, clears) = crossings(before, after, self.tests), _unclear(before.seen, seen)
        if not (found or appears or clears):
            return after, True
        way = (after.y - before.y) / before.scale
        sizes = (self.problem.repetition(point.y[:-1]) for point in (before, after))
        length = float(np.sqrt(way @ way)) / min(max(sizes), 1.0)
        if (appears and length > _SHORTEST) or (clears and length > _UNSEEN):
            return after, False
        if not found:
            return after, True
        if _BRANCH_POINT in found:
            if length > _JUMP and any(each.event >= 0 for each in found):
                return after, False  # shorter steps separate them at less cost than solving
            # without a branch point between them the points are on different branches
            located = solved(self.problem, before, after, _BRANCH_POINT)
            if located is None and length > _JUMP:
                return after, False
            flat = None if located is None else self._flat(located, before, way)
            if flat is not None:
                found = tuple(each for each in found if each.kind is not BifurcationKind.SN)
            seen = replace(seen, branch_point=located, flat=flat)
        clear = len(found) <= 1 or length <= _SHORTEST
        return replace(after, seen=replace(seen, crossings=found)), clear

    def _flat(self, located: Located, before: Point, way: Array) -> Array | None:
        equations = OrbitEquations(self.problem, float(before.scale[-1]))
        place = located.place
        directions = crossing_directions(equations, place, before.scale)
        directions = directions or [way / np.sqrt(way @ way)]
        tangent = max(directions, key=lambda direction: abs(float(direction @ way)))
        return tangent if abs(tangent[-1]) < _LEVEL else None


def _unclear(before: Seen, after: Seen) -> tuple[bool, bool]:
    """Whether events appear, or become defined, within a step."""
    values = [(a.value, b.value) for a, b in zip(before.events, after.events, strict=True)]
    # an event is not defined (infinite) at one end, and beyond its border (negative) at the other
    appears = any(max(pair) == np.inf and min(pair) < 0.0 for pair in values)
    # the sign of an event is undefined (NaN) at one end only, and its value is finite at the other
    clears = any((a != a) != (b != b) and np.inf not in (a, b) for a, b in values)
    return appears, clears
