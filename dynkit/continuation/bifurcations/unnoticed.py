"""Bifurcations that come in pairs within a step, so that no test function changes its sign over it.

Between three points a test function is about a parabola. Where that turns back beyond the border,
between two of them on the other side of it, the branch is examined. So it is between two numbers of
the spectrum that pass the border within a step.
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
            found = _between(curve, points[max(i - 1, 0) : i + 2], part)
            if found:
                yield i, _with_others(curve, points[i], found)


def _with_others(curve: Continuation, before: Point, found: list[Point]) -> list[Point]:
    """Points after the first, and those that separate further pairs between them."""
    every = [before, *found]
    for i, after in unnoticed(curve, every):
        every[i + 1 : i + 2] = after
    return every[1:]


def _between(curve: Continuation, points: Sequence[Point], part: float) -> list[Point]:
    """Points from between the last two to the last: between them a test function has another sign.

    The first one that is tried is at a part of the step. Empty where there is none.
    """
    known, places = list(points), [-1.0, 0.0, 1.0][-len(points) :]
    before, after = points[-2:]
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
        parts[: len(points) - 2] = np.nan
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
    """Parts of steps, (k - 1,), at which a parabola turns beyond a border; NaN for none.

    Or those half-way between two numbers of the spectrum that pass it.
    """
    k, ways = len(points), [(b.y - a.y) / a.scale for a, b in pairwise(points)]
    steps = np.array([float(np.sqrt(way @ way)) for way in ways])
    heights, passing = _heights(points, steps)
    out = _halfway(passing)
    if k < 3:
        return out
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


def _halfway(heights: Array) -> Array:
    """Of each step, (k - 1,), the part between the first two changes of sign; NaN for none."""
    a, b = heights[:-1], heights[1:]
    with np.errstate(all="ignore"):
        part = np.where((a > 0.0) != (b > 0.0), a / (a - b), np.nan)
    part = np.sort(np.pad(part, ((0, 0), (0, 2)), constant_values=np.nan), axis=1)[:, :2]
    return np.where(part[:, 0] < part[:, 1], part.mean(axis=1), np.nan)


def _heights(points: Sequence[Point], steps: Array) -> tuple[Array, Array]:
    """Numbers (k, j) whose signs are those of test functions; NaN or infinite where they have none.

    They are the tangent's part along the parameter; how far the numbers of the spectrum that are
    nearest to the border of stability are beyond it, in the order in which they continue each
    other; what events watch. The second array, (k, i), has those of the spectrum, of complex pairs
    one.
    """
    rows, singles, last, ahead = list[Array](), list[Array](), np.empty(0), np.empty(0)
    for i, point in enumerate(points):
        seen, kind = point.seen, point.seen.kind
        with np.errstate(all="ignore"):  # infinite where an orbit grazes
            beyond = np.log(abs(seen.spectrum)) if kind.periodic else seen.spectrum.real
            near = np.argsort(abs(beyond), kind="stable")[:_MOST]
            values = seen.spectrum[near]
            ahead = ahead if rows else values
            gaps = np.nan_to_num(abs(np.subtract.outer(ahead, values)), nan=_FAR, posinf=_FAR)
            order = linear_sum_assignment(gaps)[1]
            known, last, outside = last, values[order], beyond[near][order]
            ahead = last
            if 0 < i < len(steps):  # on the line through both: numbers may pass each other
                ahead = last + (last - known) * (steps[i] / steps[i - 1])
        if kind is Spectrum.CONSERVATIVE:  # all of them are on the border
            outside = np.full(len(last), np.nan)
        events = [math.nan if event.ends else event.value for event in seen.events]
        rows.append(np.concatenate([point.tangent[-1:], outside, events]))
        singles.append(np.where(last.imag < 0.0, np.nan, outside))
    return np.array(rows), np.array(singles)
