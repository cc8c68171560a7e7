"""Points of a curve, and interpolation between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.validation import Array

SAME = 1e-6
"""Largest distance of equal orbits, in scaled unknowns."""
LEAST_LEVEL = 16.0 * 2.0**-52
"""Residuals up to this are rounding for all equations."""


@final
@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """A corrected point of a curve.

    Parameters
    ----------
    y, scale : (q,) arrays
        The unknowns, and their units.
    tangent : (q,) array
        Direction of the curve, of unit length in scaled unknowns.
    turn : float
        Sign of the determinant of the derivative with the tangent as last row.
    residual : float
        Largest residual.
    iterations : int
        Steps of Newton's method.
    level : float
        Residuals up to this are rounding near this point; corrections from it end there.
    seen : Any
        Properties of its orbit for the test functions; see `Seen`.
    """

    y: Array
    scale: Array
    tangent: Array
    turn: float
    residual: float
    iterations: int
    level: float = LEAST_LEVEL
    seen: Any = None

    def along(self, sign: float) -> Point:
        """Return the point as the start of a curve in the direction of a sign: 1.0 or -1.0."""
        tangent, turn = sign * self.tangent, sign * self.turn
        return replace(self, tangent=tangent, turn=turn, iterations=0)


def cost_of(points: Sequence[Point], seconds: float) -> Cost:
    """Return the cost of the points of a curve."""
    steps = sum(point.iterations for point in points)
    return Cost(seconds, {"points": len(points), "newton_steps": steps})


def rescaled(point: Point, scale: Array) -> Array:
    """Return the unit tangent of a point in other units."""
    if scale is point.scale:
        return point.tangent
    tangent = point.tangent * point.scale / scale
    return np.asarray(tangent / np.sqrt(tangent @ tangent))


def beside(before: Point, after: Point, y: Array, slack: tuple[float, float], most: float) -> bool:
    """Whether unknowns lie between two points, and near the line between them.

    Parameters
    ----------
    before, after : Point
    y : array
    slack : (float, float)
        Tolerance beyond the points: slack[0] L^2 + slack[1] L, for the projection on the line times
        its length L, in scaled unknowns.
    most : float
        Largest squared distance from the first point, relative to L^2.
    """
    way, gap = ((end - before.y) / before.scale for end in (after.y, y))
    length, along = float(way @ way), float(gap @ way)
    more = slack[0] * length + slack[1] * length**0.5
    return -more <= along <= length + more and float(gap @ gap) <= most * length


def slope(point: Point, way: Array) -> Array:
    """Return the tangent of a point with the length of the vector `way`, in the point's scale."""
    return np.asarray(point.tangent * point.scale * np.linalg.norm(way / point.scale))


def interpolated(before: Point, after: Point, part: float) -> Array:
    """Return unknowns between two points on the cubic through both with their tangents."""
    way = after.y - before.y
    first, last = slope(before, way), slope(after, way)
    s, r = part, 1.0 - part
    return np.asarray(before.y + way * s * s * (3.0 - 2.0 * s) + s * r * (r * first - s * last))
