"""Bifurcations that come in pairs within a step, so that no test function changes its sign over it.

Between three points a test function is about a parabola. Where that turns back beyond the border,
between two of them on the other side of it, the branch is examined.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy.optimize import linear_sum_assignment

from dynkit.continuation.arclength import Continuation
from dynkit.continuation.corrector import Failure
from dynkit.continuation.points import Point
from dynkit.core.validation import Array
from dynkit.orbits.spectrum import Spectrum

# So often a step is divided in search of a pair.
_TRIES = 3
# Of the fall to where a parabola turns: what is not parabolic may add as much to it.
_DOUBT = 0.05
# A point nearer to the border than this is on it.
_BORDER = 1e-9
# Most numbers of a spectrum that are followed.
_MOST = 32
# In place of an infinite or undefined distance of multipliers.
_FAR = 1e150


def unnoticed(curve: Continuation, points: Sequence[Point]) -> Iterator[tuple[int, list[Point]]]:
    """Yield the numbers of points before pairs, and the points after these that separate them.

    From the last to the first; the last of the points is the one that followed before. The points
    know the bifurcations since the points before them.
    """
    for i, part in reversed(list(enumerate(_turns(points)))):
        if not math.isnan(part):
            found = _between(curve, points[i], points[i + 1], part)
            if found:
                yield i, found


def _between(curve: Continuation, before: Point, after: Point, part: float) -> list[Point]:
    """Points from between two to the second: between them a test function has the other sign.

    The first one that is tried is at a part of the step. Empty where there is none.
    """
    known, places = [before, after], [0.0, 1.0]
    for _ in range(_TRIES):
        middle = curve.between(before, after, part)
        if isinstance(middle, Failure):
            return []
        first = _separated(curve, before, middle)
        rest = _separated(curve, first[-1], after) if first else []
        if not rest:
            return []
        found, middle = first + rest, first[-1]
        if sum(len(each.seen.crossings) for each in found) > len(after.seen.crossings):
            return found
        at = int(np.searchsorted(places, part))
        known.insert(at, middle)
        places.insert(at, part)
        parts = _turns(known)
        if np.isnan(parts).all():
            return []
        at = int(np.flatnonzero(~np.isnan(parts))[0])
        part = places[at] + float(parts[at]) * (places[at + 1] - places[at])
    return []


def _separated(curve: Continuation, before: Point, after: Point) -> list[Point]:
    """Accepted points from the first to the second, between which bifurcations are separate.

    Empty where there is no such point.
    """
    after, clear = curve.accept(before, after)
    if after.seen is None:
        return []
    if clear:
        return [after]
    middle = curve.between(before, after, 0.5)
    if isinstance(middle, Failure):
        return []
    first = _separated(curve, before, middle)
    rest = _separated(curve, first[-1], after) if first else []
    return first + rest if rest else []


def _turns(points: Sequence[Point]) -> Array:
    """Of each step, (k - 1,), the part at which a parabola turns beyond a border; NaN for none."""
    k, out = len(points), np.full(len(points) - 1, np.nan)
    if k < 3:
        return out
    heights = _heights(points)
    ways = [(b.y - a.y) / a.scale for a, b in pairwise(points)]
    steps = np.array([float(np.sqrt(way @ way)) for way in ways])
    # the third point is the one before the step, or the one after it
    for first, third, place in (
        (slice(1, k - 1), slice(0, k - 2), -steps[:-1] / steps[1:]),
        (slice(0, k - 2), slice(2, k), 1.0 + steps[1:] / steps[:-1]),
    ):
        a, b, c = heights[first], heights[first.start + 1 : first.stop + 1], heights[third]
        at = place[:, None]
        with np.errstate(all="ignore"):
            bend = ((c - a) / at - (b - a)) / (at - 1.0)
            slope = b - a - bend
            part = -0.5 * slope / bend
            fall = -0.5 * slope * part * np.sign(a)
            same = (a * b > 0.0) | (abs(b) < _BORDER)
            beyond = same & (abs(a) < (1.0 + _DOUBT) * fall)
        part[~(beyond & (part > 0.0) & (part < 1.0))] = np.nan
        with_any = ~np.isnan(part).all(axis=1)
        out[first][with_any] = np.nanmin(part[with_any], axis=1)
    return out


def _heights(points: Sequence[Point]) -> Array:
    """Numbers (k, j) whose signs are those of test functions; NaN or infinite where they have none.

    They are the tangent's part along the parameter; how far the numbers of the spectrum that are
    nearest to the border of stability are beyond it, in the order in which they continue each
    other; what events watch.
    """
    rows, last = list[Array](), np.empty(0)
    for point in points:
        seen, kind = point.seen, point.seen.kind
        with np.errstate(all="ignore"):  # infinite where an orbit grazes
            beyond = np.log(abs(seen.spectrum)) if kind.periodic else seen.spectrum.real
            near = np.argsort(abs(beyond), kind="stable")[:_MOST]
            values = seen.spectrum[near]
            last = last if rows else values
            gaps = np.nan_to_num(abs(np.subtract.outer(last, values)), nan=_FAR, posinf=_FAR)
        order = linear_sum_assignment(gaps)[1]
        last, outside = values[order], beyond[near][order]
        if kind is Spectrum.CONSERVATIVE:  # all of them are on the border
            outside = np.full(len(last), np.nan)
        events = [math.nan if event.ends else event.value for event in seen.events]
        rows.append(np.concatenate([point.tangent[-1:], outside, events]))
    return np.array(rows)
