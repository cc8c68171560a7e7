"""Tangents of curves at a given solution."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from dynkit.continuation.defining_systems import DIFFERENCE
from dynkit.continuation.points import Point
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.orbits.newton import Equations


def start_points(equations: Equations, y: Array) -> list[Point]:
    """Return a solution as the start of each curve through it.

    The last unknown grows along the tangents; the one with the largest growth comes first. Where
    the derivative has two null vectors, two curves cross.

    Raises
    ------
    NoMotion
        When the derivative is not defined.
    """
    scale = equations.scale(y)
    residual = float(abs(equations.residual(y)).max())
    jacobian = equations.jacobian(y) * scale
    n = len(jacobian)
    _, sizes, rows = np.linalg.svd(jacobian)
    directions = [rows[n]]
    if sizes[-1] <= 1e-7 * sizes[0]:
        with suppress(NoMotion):  # raised at the end of a parameter's range: no crossing there
            directions = crossing_directions(equations, y, scale) or directions
    points = []
    for direction in directions:
        # the sign of a tiny last component is rounding, and does not matter
        tangent = direction if direction[-1] >= 0.0 else -direction
        tangent[-1] = max(tangent[-1], np.finfo(float).tiny)
        sign, _ = np.linalg.slogdet(np.vstack([jacobian, tangent]))
        points.append(Point(y, scale, tangent, float(sign) or 1.0, residual, 0))
    return sorted(points, key=lambda point: -point.tangent[-1])


def crossing_directions(equations: Equations, y: Array, scale: Array) -> list[Array]:
    """Return the tangents, in scaled unknowns, of the two curves that cross at a branch point.

    They solve the algebraic bifurcation equation (H. B. Keller, in Applications of Bifurcation
    Theory, ed. P. H. Rabinowitz, Academic Press 1977, 359-384); its second derivatives are central
    differences of the first.
    """
    jacobian = equations.jacobian(y) * scale
    n = len(jacobian)
    left, _, rows = np.linalg.svd(jacobian)
    normal, basis = left[:, -1], rows[n - 1 :]
    h = DIFFERENCE
    quadratic = np.empty((2, 2))
    for i in range(2):
        ahead = equations.jacobian(y + h * basis[i] * scale) * scale
        behind = equations.jacobian(y - h * basis[i] * scale) * scale
        quadratic[i] = (normal @ (ahead - behind)) @ basis.T / (2.0 * h)
    quadratic = 0.5 * (quadratic + quadratic.T)
    sizes, axes = np.linalg.eigh(quadratic)
    if not sizes[0] < 0.0 < sizes[1]:
        return []
    slope = np.sqrt(-sizes[0] / sizes[1])
    found = []
    for sign in (1.0, -1.0):
        mix = axes[:, 0] + sign * slope * axes[:, 1]
        direction = mix @ basis
        found.append(np.asarray(direction / np.sqrt(direction @ direction)))
    return found
