"""A branch in one direction, and what happens along it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import final

import numpy as np

from dynkit.continuation.arclength import Ending, Follower, Point, Reason
from dynkit.continuation.bifurcations import Located, examine, locate
from dynkit.continuation.problem import Problem
from dynkit.continuation.starting import crossing_directions
from dynkit.validation import Array

# The parameter's part in a tangent below which a branch folds; how far aside it is looked at.
_FLAT, _ASIDE = 1e-4, 1e-3


@final
@dataclass
class Trace:
    """Points as they were found; bifurcations with their places and directions."""

    points: list[Point] = field(default_factory=list)
    located: list[tuple[float, Located, Array]] = field(default_factory=list)
    ending: Ending | None = None


def trace(problem: Problem, follower: Follower, inadmissible: bool) -> Trace:
    """Follow a branch in one direction to its end.

    Parameters
    ----------
    problem : Problem
    follower : Follower
        Not yet iterated; its `watch` is a `Watch` of the same problem.
    inadmissible : bool
        Whether it goes on where the orbits are no motions of the system.
    """
    found = Trace()
    for point in follower:
        if not found.points:
            point.seen = examine(problem, point)
            found.points.append(point)
            continue
        before = found.points[-1]
        here, retraced = _between(problem, follower, before, point)
        index = len(found.points) - 1
        found.located += [(index + part, located, point.y - before.y) for part, located in here]
        if not inadmissible and not point.seen.admissible:
            follower.ending = _ends(Reason.INADMISSIBLE, point)
            break
        if retraced:
            follower.ending = _ends(Reason.RETRACED, point)
            break
        found.points.append(point)
    found.ending = follower.ending
    return found


def _ends(reason: Reason, point: Point) -> Ending:
    return Ending(reason, f"{reason.value}: near {point.y[-1]:.6g}")


def _between(
    problem: Problem, follower: Follower, before: Point, after: Point
) -> tuple[list[tuple[float, Located]], bool]:
    """Return the bifurcations within a step, each with its place there, and whether it retraces.

    A place is from 0 to 1. A branch retraces where it crosses one that it is symmetric about: its
    orbits behind are those before. It folds there, and that is no fold of its own.
    """
    way = (after.y - before.y) / before.scale
    found = []
    symmetric = retraced = False
    # branch points first: they tell what a fold is worth
    for crossing in sorted(after.seen.crossings, key=lambda crossing: crossing.kind != "BP"):
        if crossing.kind == "SN" and symmetric:
            continue
        located = locate(problem, follower, before, after, crossing)
        if located is None:
            continue
        place = np.append(located.x, located.p)
        part = float(np.clip((place - before.y) / before.scale @ way / (way @ way), 0.0, 1.0))
        found.append((part, located))
        if crossing.kind == "BP":
            tangent = _tangent(follower, place, before.scale, way)
            symmetric = abs(tangent[-1]) < _FLAT
            retraced = symmetric and _same_on_both_sides(problem, follower, before, place, tangent)
    return sorted(found, key=lambda entry: entry[0]), retraced


def _tangent(follower: Follower, place: Array, scale: Array, way: Array) -> Array:
    """Return the direction of a branch at a branch point, in scaled unknowns."""
    directions = crossing_directions(follower.equations, place, scale)
    directions.append(way / np.sqrt(way @ way))
    return max(directions[:2], key=lambda direction: abs(float(direction @ way)))


def _same_on_both_sides(
    problem: Problem, follower: Follower, near: Point, place: Array, tangent: Array
) -> bool:
    sides = []
    for sign in (1.0, -1.0):
        start = Point(place, near.scale, sign * tangent, 1.0, 0.0, 0)
        side = follower.corrected(place + sign * _ASIDE * tangent * near.scale, start, tangent)
        if side is None:
            return False
        sides.append(side)
    here, there = (problem.canonical(side.y[:-1]) for side in sides)
    apart = (sides[0].y - sides[1].y)[:-1] / near.scale[:-1]
    return bool(abs(here - there).max() < 0.05 * abs(apart).max())
