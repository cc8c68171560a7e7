"""A branch in one direction, and the bifurcations along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import final

import numpy as np

from dynkit.continuation.arclength import Continuation
from dynkit.continuation.bifurcations.locating import locate
from dynkit.continuation.bifurcations.unnoticed import unnoticed
from dynkit.continuation.corrector import Failure
from dynkit.continuation.crossings import Located
from dynkit.continuation.defining_systems import merges
from dynkit.continuation.points import Point
from dynkit.continuation.termination import Ending, Reason
from dynkit.core.reprs import measured
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.kinds import BifurcationKind

# Both sides of a symmetric branch are compared at this distance from its centre: _OF_STEP times the
# step over the centre, at most _ASIDE, in scaled unknowns. Folds closer to the centre do not count.
_OF_STEP, _ASIDE = 0.25, 1e-3
_OF_MULTIPLIERS = (BifurcationKind.SN, BifurcationKind.PD, BifurcationKind.NS)


@final
@dataclass
class Trace:
    """Points of a curve in one direction; bifurcations with their places and directions.

    `centres` are the places where the branch meets a branch about which it is symmetric. Each has
    the distance described at `_ASIDE`, and the length of the step over it.
    """

    points: list[Point] = field(default_factory=list)
    located: list[tuple[float, Located, Array]] = field(default_factory=list)
    centres: list[tuple[Array, float, float]] = field(default_factory=list)
    ending: Ending | None = None


def trace(problem: Problem, curve: Continuation, inadmissible: bool) -> Trace:
    """Follow a branch in one direction to its end.

    Parameters
    ----------
    problem : Problem
    curve : Continuation
        It accepts points by an `Acceptance` of the same problem; its start is examined.
    inadmissible : bool
        Whether the branch continues where its orbits are inadmissible.
    """
    found = Trace()
    for point in curve.shown():
        if isinstance(point, Ending):
            found.ending = point
            break
        if not found.points:
            found.points.append(point)
            continue
        before = found.points[-1]
        index, way = len(found.points) - 1, point.y - before.y
        here = _between(problem, curve, before, point)
        borders = [located for _, located in here if located.crossing.ends]
        if borders:
            # other bifurcations at the same value are effects of the border
            here = [pair for pair in here if pair[1] is borders[0] or not _at(borders[0], pair[1])]
        found.located += [(index + part, located, way) for part, located in here]
        if borders:
            p, error = float(borders[0].p[0]), float(borders[0].errors[-1])
            where = f"{borders[0].crossing.kind} at {measured(p, error, 10)}"
            found.ending = Ending(Reason.BORDER, f"{Reason.BORDER.value}: {where}")
            break
        if any(crossing.ends for crossing in point.seen.crossings):
            found.ending = _ends(Reason.NO_SOLUTION, point)  # the border was not located
            break
        if not inadmissible and not point.seen.admissible:
            found.ending = _ends(Reason.INADMISSIBLE, point)
            break
        centre = point.seen.branch_point
        if centre is not None and point.seen.flat is not None:
            place = centre.place
            step = float(np.linalg.norm(way / before.scale))
            aside = min(_ASIDE, _OF_STEP * step)
            found.centres.append((place, aside, step))
            if _same_on_both_sides(problem, curve, before, place, aside * point.seen.flat):
                found.ending = _ends(Reason.RETRACED, point)
                break
        found.points.append(point)
    for index, after in unnoticed(curve, found.points):
        _insert(problem, curve, found, index, after)
        for last in range(index, index + len(after)):
            point = found.points[last + 1]
            if not inadmissible and not point.seen.admissible:
                found.ending = _ends(Reason.INADMISSIBLE, point)
                del found.points[last + 1 :]
                found.located = [entry for entry in found.located if entry[0] <= last + 1]
                break
    return found


def _insert(
    problem: Problem, curve: Continuation, found: Trace, index: int, after: list[Point]
) -> None:
    """Insert bifurcations in the step after point number `index`, and the points between them.

    They replace the bifurcations that were found in this step without these points.
    """
    here = [
        (index + k + part, located, end.y - begin.y)
        for k, (begin, end) in enumerate(pairwise([found.points[index], *after]))
        for part, located in _between(problem, curve, begin, end)
    ]
    known = [it for at, it, _ in found.located if index <= at <= index + 1]
    new = [it for _, it, _ in here if not any(_same(it, other) for other in known)]
    if len(new) > bool(known):  # a single new one beside known ones is an inaccurate copy of one
        found.points[index + 1 : index + 2] = after
        late = len(after) - 1
        here += [
            (at + late * (at >= index + 1), it, way)
            for at, it, way in found.located
            if not any(_same(it, other) for _, other, _ in here)
        ]
        found.located = sorted(here, key=lambda entry: entry[0])


def _ends(reason: Reason, point: Point) -> Ending:
    return Ending(reason, f"{reason.value}: near {point.y[-1]:.6g}")


def both_ways(start: Point, follow: Callable[[Point], Trace]) -> tuple[Trace, Trace]:
    """Return a curve in both directions; for a closed curve the second has the start only.

    Parameters
    ----------
    start : Point
    follow : callable
        Point whose tangent is the direction -> the trace from there on.
    """
    forward = follow(start.along(1.0))
    if forward.ending is not None and forward.ending.reason is Reason.CLOSED:
        return forward, Trace(forward.points[:1], ending=forward.ending)
    return forward, follow(start.along(-1.0))


def joined(forward: Trace, backward: Trace) -> tuple[list[Point], tuple[Ending, Ending]]:
    """Return the points in the order of the curve, and its endings."""
    assert forward.ending is not None
    assert backward.ending is not None
    points = [*backward.points[:0:-1], *forward.points]
    return points, (backward.ending, forward.ending)


def is_of_event(place: float, located: Located, events: list[tuple[float, Located]]) -> bool:
    """Whether a bifurcation is the effect of a GR or CB at the same value, within two steps.

    At a grazing orbit two events may merge, or an impact may vanish. The equations are then
    singular, and the parameter may turn back, although no multiplier is critical. Values with an
    infinite error are not compared.
    """
    if located.crossing.kind not in _OF_MULTIPLIERS or not np.isfinite(located.errors[-1]):
        return False
    near = [event for other, event in events if abs(place - other) < 2.0]
    return any(np.isfinite(event.errors[-1]) and _at(event, located) for event in near)


def is_of_symmetry(
    located: Located, centres: list[tuple[Array, float, float]], scale: Array
) -> bool:
    """Whether a fold is the centre of a symmetric branch.

    Near the centre the branch is flat: rounding decides whether the parameter grows along the
    tangent. Such an apparent fold is within two steps of the centre, and is not solved for.
    """
    place = located.place
    near = [
        np.linalg.norm((place - other) / scale) < (aside if located.solved else 2.0 * step)
        for other, aside, step in centres
    ]
    return located.crossing.kind is BifurcationKind.SN and any(near)


def _between(
    problem: Problem, curve: Continuation, before: Point, after: Point
) -> list[tuple[float, Located]]:
    """Return the bifurcations within a step, each with its position in the step from 0 to 1."""
    way = (after.y - before.y) / before.scale
    found: list[tuple[float, Located]] = []
    for crossing in after.seen.crossings:
        located = locate(problem, curve, before, after, crossing)
        if located is None or any(_same(located, other) for _, other in found):
            continue
        near = before.y[:-1], before.y[-1:]
        of_multiplier = crossing.kind in (*_OF_MULTIPLIERS, BifurcationKind.BP)
        if not of_multiplier or not merges(problem, located.x, located.p, *near):
            gap = (located.place - before.y) / before.scale
            found.append((float(np.clip(gap @ way / (way @ way), 0.0, 1.0)), located))
    return sorted(found, key=lambda entry: entry[0])


def _same(a: Located, b: Located) -> bool:
    return a.crossing == b.crossing and _at(a, b)


def _at(a: Located, b: Located) -> bool:
    """Whether two bifurcations have the same value of the parameter, within their errors."""
    return bool(abs(a.p[0] - b.p[0]) <= 2.0 * (a.errors[-1] + b.errors[-1]))


def _same_on_both_sides(
    problem: Problem, curve: Continuation, near: Point, place: Array, aside: Array
) -> bool:
    """Whether the branch has the same orbits at the same distance on both sides of a place."""
    sides, tangent = [], aside / np.linalg.norm(aside)
    for sign in (1.0, -1.0):
        start = Point(place, near.scale, sign * tangent, 1.0, 0.0, 0)
        side = curve.corrected(place + sign * aside * near.scale, start, tangent)
        if isinstance(side, Failure):
            return False
        sides.append(side)
    here, there = (side.y[:-1] for side in sides)
    apart = (sides[0].y - sides[1].y)[:-1] / near.scale[:-1]
    return bool(abs(problem.apart(here, there)).max() < 0.05 * abs(apart).max())
