"""Predictors: guesses of the next point of a curve."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from dynkit.continuation.points import Point, interpolated
from dynkit.core.validation import Array

# How far a cubic is prolonged, in units of the last step.
_FURTHEST = 2.0


class Predictor(Protocol):
    """Guesses the unknowns (q,) a step, in scaled unknowns, further on than a point.

    `before` is the point before, or None where there is none.
    """

    def __call__(self, point: Point, before: Point | None, step: float) -> Array:
        """Return the guess."""
        ...


def tangent(point: Point, before: Point | None, step: float) -> Array:
    """Return the guess on the tangent."""
    del before
    return np.asarray(point.y + step * point.tangent * point.scale)


def cubic(point: Point, before: Point | None, step: float) -> Array:
    """Return the guess on the cubic through the last two points with their tangents.

    It is on the tangent where there is no point before, or where that is much nearer than the step.
    """
    if before is not None:
        way = (point.y - before.y) / point.scale
        part = step / max(float(np.sqrt(way @ way)), 1e-300)
        if part <= _FURTHEST:
            return interpolated(before, point, 1.0 + part)
    return tangent(point, before, step)
