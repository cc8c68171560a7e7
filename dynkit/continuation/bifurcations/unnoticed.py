"""Pairs of bifurcations within one step, over which no test function changes its sign.

The values of a test function at three successive points determine a parabola. If its extremum lies
within a step and has the sign opposite to both ends of the step, a point near the extremum is
examined. If two multipliers cross the border of stability within a step, a point between their
crossings is examined, because no test function may change its sign over the step.
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

# Largest number of divisions of a step in search of a pair.
_TRIES = 3
# Relative error of the depth of a parabola, from the value at the end of the step to the extremum:
# a step is examined if the depth increased by this fraction reaches zero.
_DOUBT = 0.05
# A test function with a magnitude below this is zero: the point is on the border.
_BORDER = 1e-9
# Largest number of multipliers or eigenvalues that are followed from point to point.
_MOST = 32
# Finite number in place of an infinite or undefined distance of two multipliers.
_FAR = 1e150


def unnoticed(curve: Continuation, points: Sequence[Point]) -> Iterator[tuple[int, list[Point]]]:
    """Yield for each step with a pair the index of its first point, and the points that follow.

    These points separate the bifurcations of the step; the last one is its old end. Their
    `seen.crossings` are the bifurcations since the point before. Steps come in descending order.
    """
    for i, part in reversed(list(enumerate(_turns(points)))):
        if not math.isnan(part):
            found = _between(curve, points[max(i - 1, 0) : i + 2], part)
            if found:
                yield i, _with_others(curve, points[i], found)


def _with_others(curve: Continuation, before: Point, found: list[Point]) -> list[Point]:
    """Return the points found after `before`, with points that separate further pairs."""
    every = [before, *found]
    for i, after in unnoticed(curve, every):
        every[i + 1 : i + 2] = after
    return every[1:]


def _between(curve: Continuation, points: Sequence[Point], part: float) -> list[Point]:
    """Return points within the last step that separate bifurcations, and the end of the step.

    The points are two or three; the step is the one between the last two. It is divided first at
    the fraction `part`. The result is empty if no more bifurcations are found than before.
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
    """Return accepted points from the first, which is left out, to the second.

    Steps between them are halved until they separate the bifurcations. The result is empty where a
    point is not found.
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
    """Return the fraction of each step, (k - 1,), at which it is to be examined; NaN for none.

    It is where a parabola through three values of a test function has its extremum beyond zero, or
    half-way between the crossings of two multipliers.
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
    """Return the fraction of each step, (k - 1,), half-way between the first two sign changes.

    It is NaN for a step with fewer than two sign changes of the columns of `heights`.
    """
    a, b = heights[:-1], heights[1:]
    with np.errstate(all="ignore"):
        part = np.where((a > 0.0) != (b > 0.0), a / (a - b), np.nan)
    part = np.sort(np.pad(part, ((0, 0), (0, 2)), constant_values=np.nan), axis=1)[:, :2]
    return np.where(part[:, 0] < part[:, 1], part.mean(axis=1), np.nan)


def _heights(points: Sequence[Point], steps: Array) -> tuple[Array, Array]:
    """Return values (k, j) of test functions; NaN or infinite where they have no sign.

    The columns are the component of the tangent along the parameter; for the multipliers nearest to
    the unit circle the logarithms of their moduli, or the real parts of eigenvalues; the values of
    events. A column follows one multiplier from point to point. The second array, (k, i), has the
    columns of multipliers only, and one of each complex pair.
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
            if 0 < i < len(steps):  # extrapolate linearly: two multipliers may pass each other
                ahead = last + (last - known) * (steps[i] / steps[i - 1])
        if kind is Spectrum.CONSERVATIVE:  # the multipliers may all be on the unit circle
            outside = np.full(len(last), np.nan)
        events = [math.nan if event.ends else event.value for event in seen.events]
        rows.append(np.concatenate([point.tangent[-1:], outside, events]))
        singles.append(np.where(last.imag < 0.0, np.nan, outside))
    return np.array(rows), np.array(singles)
