"""Predictors: guesses of the next point of a curve."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from dynkit.continuation.points import Point, interpolated
from dynkit.core.validation import Array

# Largest extrapolation by a cubic, in units of the last step.
_FURTHEST = 2.0


class Predictor(Protocol):
    """Guesses the unknowns (q,) at a step, in scaled unknowns, after a point.

    `before` is the previous point, or None.
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

    Without a previous point, and for a step of more than `_FURTHEST` times the last one, the guess
    is on the tangent.
    """
    if before is not None:
        way = (point.y - before.y) / point.scale
        part = step / max(float(np.sqrt(way @ way)), 1e-300)
        if part <= _FURTHEST:
            return interpolated(before, point, 1.0 + part)
    return tangent(point, before, step)
