"""Coordinates of a linear structure whose square sum is twice its energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.structure.double_double import ROUNDING, DoubleDouble, add, divide, negative
from dynkit.systems.structure.modes import Derivation
from dynkit.systems.structure.symmetric import (
    SymmetricMatrix,
    exact_slices_product,
    product_of,
    product_with,
)


@final
@dataclass(frozen=True, eq=False)
class EnergyCoordinates:
    """Coordinates (scale q, q') of a structure, x = shapes q.

    The shapes are normal modes rounded to doubles, and these doubles are used as exact numbers:
    mass, damping and stiffness are transformed to double-double accuracy, without the assumption
    that M becomes 1 and K becomes diagonal.

    Attributes
    ----------
    shapes : (N, N) array
        Rigid-body motions first.
    rigid : int
        Number of rigid-body motions.
    scale : (N,) array
        Natural frequencies; for rigid-body motions, whose positions have no energy, the smallest
        nonzero one.
    matrix : DoubleDouble, (2N, 2N)
        State matrix in these coordinates. The columns of rigid-body positions are zero.
    mass : (N, N) array
    drag_rounding : (N, N) array
        Bounds on the rounding errors of the damping matrix.
    """

    shapes: Array
    rigid: int
    scale: Array
    matrix: DoubleDouble
    mass: Array
    drag_rounding: Array

    @staticmethod
    def of(given: Derivation) -> EnergyCoordinates:
        """Energy coordinates of a structure; modes of frequency zero are its rigid motions."""
        modes = given.modes
        shapes = np.ascontiguousarray(modes.matrix)
        rigid = int(np.sum(modes.frequencies == 0.0))
        scale = modes.frequencies.copy()
        scale[:rigid] = scale[rigid] if rigid < len(scale) else 1.0
        parts = (given.mass, given.damping, given.stiffness)
        inertia, drag, springs = (_congruent(shapes, part) for part in parts)
        for part in springs:
            part[:rigid] = part[:, :rigid] = 0.0
        if given.traction is not None:
            own = shapes.T @ given.traction.along
            drag, springs = (
                add(part, product_with(own, product_of(by, shapes)))
                for part, by in zip((drag, springs), given.traction[1:], strict=True)
            )
            for part in springs:
                part[:, :rigid] = 0.0
        deviation = add(inertia, _double_double(-np.eye(len(scale))))
        drag = _divided(drag, deviation)
        springs = divide(_divided(springs, deviation), _double_double(scale[None]))
        zero = np.zeros_like(shapes)
        matrix = DoubleDouble(
            np.block([[zero, np.diag(scale)], [-springs.high, -drag.high]]),
            np.block([[zero, zero], [-springs.low, -drag.low]]),
        )
        drag_rounding = given.rounding * np.abs(given.damping.dense)
        if given.traction is not None:
            rubbed = abs(given.traction.along) @ abs(given.traction.damping.high)
            drag_rounding = drag_rounding + given.rounding * rubbed
        return EnergyCoordinates(shapes, rigid, scale, matrix, given.mass.dense, drag_rounding)

    def states(self, columns: DoubleDouble) -> DoubleDouble:
        """Positions and velocities (2N, m) from coordinates (2N, m)."""
        n = len(self.scale)
        top, bottom = (DoubleDouble(*(p[s] for p in columns)) for s in (np.s_[:n], np.s_[n:]))
        top = divide(top, _double_double(self.scale[:, None]))
        parts = [product_with(self.shapes, part) for part in (top, bottom)]
        return DoubleDouble(*(np.concatenate(p) for p in zip(*parts, strict=True)))

    def uncertain_drag(self, column: Array) -> float:
        """Bound on the effect of rounded dashpots on the decay rate of a motion, (2N,)."""
        velocity = np.abs(self.shapes @ column[len(self.scale) :])
        return float(velocity @ self.drag_rounding @ velocity)

    def inverse(self, matrix: DoubleDouble) -> Array:
        """The inverse of a matrix (2N, 2N) of states, accurate to the last bits of its entries.

        The matrix is not rounded to doubles first, since this would lose the small shares of fast
        motions in slow ones.
        """
        projector = self.shapes.T @ self.mass
        zero = np.zeros_like(projector)
        coordinates = np.block([[self.scale[:, None] * projector, zero], [zero, projector]])
        inverse: Array = np.linalg.inv(coordinates @ matrix.high) @ coordinates
        for _ in range(2):
            product = exact_slices_product(matrix.high, inverse)
            product = add(product, _double_double(matrix.low @ inverse))
            residual = add(product, _double_double(-np.eye(len(inverse))))
            inverse = inverse - inverse @ residual.high
        return inverse


def _double_double(a: Array) -> DoubleDouble:
    """Doubles as double-double numbers."""
    return DoubleDouble(a, np.zeros_like(a))


def _congruent(shapes: Array, matrix: SymmetricMatrix) -> DoubleDouble:
    """The congruent matrix shapes' matrix shapes."""
    return product_with(np.ascontiguousarray(shapes.T), matrix.times(shapes))


def _divided(matrix: DoubleDouble, deviation: DoubleDouble) -> DoubleDouble:
    """The product (1 + deviation)^-1 matrix, for a small deviation, by fixed-point iteration."""
    quotient = matrix
    size = float(np.linalg.norm(deviation.high))
    error = size
    while error > ROUNDING:
        product = product_with(deviation.high, quotient)
        product = add(product, _double_double(deviation.low @ quotient.high))
        quotient = add(matrix, negative(product))
        error *= size
    return quotient
