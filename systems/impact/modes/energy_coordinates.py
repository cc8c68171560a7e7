"""Coordinates of a linear structure whose square sum is twice its energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.structure.double_double import ROUNDING, DoubleDouble, add, divide, negative
from dynkit.systems.structure.modes import Derivation
from dynkit.systems.structure.symmetric import SymmetricMatrix, exact_slices_product


@final
@dataclass(frozen=True, eq=False)
class EnergyCoordinates:
    """Coordinates (scale q, q') of a structure, x = shapes q.

    The shapes are normal modes as rounded to doubles. They are taken as exact numbers: mass,
    damping and stiffness are transformed to double-double accuracy, without the assumption that M
    becomes 1 and K diagonal.

    Attributes
    ----------
    shapes : (N, N) array
        Rigid-body motions first.
    rigid : int
        Their number.
    scale : (N,) array
        Natural frequencies; for rigid-body motions, whose positions have no energy, the smallest
        of the others.
    matrix : DoubleDouble, (2N, 2N)
        Derivatives of the coordinates. The columns of rigid-body positions vanish.
    mass : (N, N) array
    drag_rounding : (N, N) array
        What the elements of the damping matrix may owe to rounding.
    """

    shapes: Array
    rigid: int
    scale: Array
    matrix: DoubleDouble
    mass: Array
    drag_rounding: Array

    @staticmethod
    def of(given: Derivation) -> EnergyCoordinates:
        """Of a structure whose modes say which motions are rigid."""
        modes = given.modes
        shapes = np.ascontiguousarray(modes.matrix)
        rigid = int(np.sum(modes.frequencies == 0.0))
        scale = modes.frequencies.copy()
        scale[:rigid] = scale[rigid] if rigid < len(scale) else 1.0
        parts = (given.mass, given.damping, given.stiffness)
        inertia, drag, springs = (_congruent(shapes, part) for part in parts)
        for part in springs:
            part[:rigid] = part[:, :rigid] = 0.0
        deviation = add(inertia, _double_double(-np.eye(len(scale))))
        drag = _divided(drag, deviation)
        springs = divide(_divided(springs, deviation), _double_double(scale[None]))
        zero = np.zeros_like(shapes)
        matrix = DoubleDouble(
            np.block([[zero, np.diag(scale)], [-springs.high, -drag.high]]),
            np.block([[zero, zero], [-springs.low, -drag.low]]),
        )
        drag_rounding = given.rounding * np.abs(given.damping.dense)
        return EnergyCoordinates(shapes, rigid, scale, matrix, given.mass.dense, drag_rounding)

    def states(self, columns: DoubleDouble) -> DoubleDouble:
        """Positions and velocities (2N, m) of coordinates (2N, m)."""
        n = len(self.scale)
        top, bottom = (DoubleDouble(*(p[s] for p in columns)) for s in (np.s_[:n], np.s_[n:]))
        top = divide(top, _double_double(self.scale[:, None]))
        parts = [_times(self.shapes, part) for part in (top, bottom)]
        return DoubleDouble(*(np.concatenate(p) for p in zip(*parts, strict=True)))

    def uncertain_drag(self, column: Array) -> float:
        """How much the decay of a motion (2N,) may owe to a rounding of the dashpots."""
        velocity = np.abs(self.shapes @ column[len(self.scale) :])
        return float(velocity @ self.drag_rounding @ velocity)

    def inverse(self, matrix: DoubleDouble) -> Array:
        """The inverse of a matrix (2N, 2N) of states, to the last bits of its entries.

        Of the matrix as it is, not as it is rounded: what a slow motion owes to fast ones is small.
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


def _times(a: Array, b: DoubleDouble) -> DoubleDouble:
    """Product of a matrix of doubles with one of double-doubles."""
    return add(exact_slices_product(a, b.high), _double_double(a @ b.low))


def _congruent(shapes: Array, matrix: SymmetricMatrix) -> DoubleDouble:
    """The matrix shapes' matrix shapes."""
    return _times(np.ascontiguousarray(shapes.T), matrix.times(shapes))


def _divided(matrix: DoubleDouble, deviation: DoubleDouble) -> DoubleDouble:
    """The quotient (1 + deviation)^-1 matrix, of a small deviation."""
    quotient = matrix
    size = float(np.linalg.norm(deviation.high))
    error = size
    while error > ROUNDING:
        product = _times(deviation.high, quotient)
        product = add(product, _double_double(deviation.low @ quotient.high))
        quotient = add(matrix, negative(product))
        error *= size
    return quotient
