"""Detection of closed curves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dynkit.continuation.corrector import Failure
from dynkit.continuation.orbit_equations import CurveEquations
from dynkit.continuation.points import SAME, Point, interpolated
from dynkit.core.validation import Array

# Largest number of iterations for the position of the start within a step, and tolerance of this
# position beyond the ends of the step, in steps: rounding may shift a start that is at an end.
_RETURNS, _SLACK = 12, 1e-3


def passes(before: Array, after: Array) -> bool:
    """Whether a step passes within 0.3 of its length from the start.

    `before` and `after` are the two ends of the step, relative to the start.
    """
    way = after - before
    length = way @ way
    if not length > 0.0:
        return False
    part = min(max(float(-before @ way / length), 0.0), 1.0)
    gap = before + part * way
    return bool(gap @ gap <= 0.09 * length)


def return_to(
    equations: CurveEquations,
    corrected: Callable[[Array, Point, Array], Point | Failure],
    home: Array,
    point: Point,
    after: Point,
) -> Point | None:
    """Return the point between two points that equals the start, or None.

    Parameters
    ----------
    equations : CurveEquations
    corrected : callable
        (guess, near point, row) -> the point of the curve, as a `Corrector`.
    home : (q,) array
        Unknowns of the start.
    point, after : Point
        The ends of the step.
    """
    place, beyond = (equations.apart(end.y, home) for end in (point, after))
    for gap, end in ((place, point), (beyond, after)):
        if abs(gap).max() < SAME:
            return end
    row = (after.y - point.y) / point.scale
    row /= np.sqrt(row @ row)
    known = {0.0: place, 1.0: beyond}
    for _ in range(_RETURNS):
        low, high = sorted(known, key=lambda part: float(known[part] @ known[part]))[:2]
        way = (known[high] - known[low]) / (high - low)
        part = low - float(known[low] @ way) / max(float(way @ way), 1e-300)
        if part in known or not -_SLACK < part < 1.0 + _SLACK:
            return None
        trial = corrected(interpolated(point, after, part), point, row)
        if isinstance(trial, Failure):
            return None
        known[part] = equations.apart(trial.y, home)
        if abs(known[part]).max() < SAME:
            return trial
    return None
