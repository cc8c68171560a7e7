"""Coordinates of a linear structure whose square sum is twice its energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.systems.structure.double_double import ROUNDING, DoubleDouble, add, divide, negative
from dynkit.systems.structure.modes import Modes
from dynkit.systems.structure.symmetric import exact_slices_product
from dynkit.validation import Array


@final
@dataclass(frozen=True, eq=False)
class EnergyCoordinates:
    """Coordinates (scale q, q') of a structure, x = shapes q.

    The shapes are normal modes as rounded to doubles. They are taken as exact numbers: mass,
    damping and stiffness are transformed to double-double accuracy, without the assumption that M
    becomes 1 and K diagonal.

    Attributes
    ----------
    mass : (N, N) array
    shapes : (N, n) array
        Rigid-body motions first; those that no dashpot holds are left out.
    free : (N, N - n) array
        Rigid-body motions that no dashpot holds: q'' = 0.
    held : int
        Number of rigid-body motions among the shapes.
    scale : (n,) array
        Natural frequencies; for rigid-body motions, whose positions have no energy, the smallest
        of the others.
    damping, stiffness : DoubleDouble, (n, n)
        M^-1 C and M^-1 K for q. The columns of rigid-body positions vanish.
    """

    mass: Array
    shapes: Array
    free: Array
    held: int
    scale: Array
    damping: DoubleDouble
    stiffness: DoubleDouble

    @staticmethod
    def of(mass: Array, damping: Array, stiffness: Array) -> EnergyCoordinates:
        """Of checked matrices; whether motions are rigid or undamped is decided up to rounding."""
        modes = Modes.from_matrices(mass, damping, stiffness)
        shapes = modes.matrix.copy()
        rigid = int(np.sum(modes.frequencies == 0.0))
        free = _undamped(shapes[:, :rigid], shapes, damping)
        kept = np.setdiff1d(np.arange(len(mass)), free)
        held = rigid - len(free)
        scale = modes.frequencies[kept]
        scale[:held] = scale[held] if held < len(kept) else 1.0
        chosen = np.ascontiguousarray(shapes[:, kept])
        deviation = add(_congruent(chosen, mass), double_double(-np.eye(len(kept))))
        springs = _congruent(chosen, stiffness)
        for part in springs:
            part[:held] = part[:, :held] = 0.0
        return EnergyCoordinates(
            mass=mass,
            shapes=chosen,
            free=shapes[:, free],
            held=held,
            scale=scale,
            damping=_divided(_congruent(chosen, damping), deviation),
            stiffness=_divided(springs, deviation),
        )

    def state_matrix(self) -> DoubleDouble:
        """(2n, 2n) matrix of the derivatives; its first `held` columns vanish."""
        forces = divide(self.stiffness, double_double(self.scale[None]))
        zero = np.zeros_like(forces.high)
        return DoubleDouble(
            np.block([[zero, np.diag(self.scale)], [-forces.high, -self.damping.high]]),
            np.block([[zero, zero], [-forces.low, -self.damping.low]]),
        )

    def states(self, columns: list[DoubleDouble]) -> Array:
        """Positions and velocities (2N, 2N) of coordinates (2n, ..), then of the free motions."""
        n = len(self.scale)
        parts = [np.concatenate(part, axis=1) for part in zip(*columns, strict=True)]
        zero = np.zeros_like(self.free)
        free = np.block([[self.free, zero], [zero, self.free]])
        if not parts:
            return free
        top = divide(DoubleDouble(*(p[:n] for p in parts)), double_double(self.scale[:, None]))
        both = (np.concatenate([p, q[n:]], axis=1) for p, q in zip(top, parts, strict=True))
        states = np.split(_times(self.shapes, DoubleDouble(*both)).high, 2, axis=1)
        return np.concatenate([np.concatenate(states), free], axis=1)

    def inverse(self, matrix: Array) -> Array:
        """The inverse of a matrix (2N, 2N) of states, to the last bits of its rows."""
        shapes = np.concatenate([self.shapes, self.free], axis=1)
        scale = np.concatenate([self.scale, np.ones(self.free.shape[1])])
        projector = shapes.T @ self.mass
        zero = np.zeros_like(projector)
        coordinates = np.block([[scale[:, None] * projector, zero], [zero, projector]])
        inverse: Array = np.linalg.inv(coordinates @ matrix) @ coordinates
        for _ in range(2):
            product = exact_slices_product(matrix, inverse)
            residual = add(product, double_double(-np.eye(len(matrix))))
            inverse = inverse - inverse @ residual.high
        return inverse


def double_double(a: Array) -> DoubleDouble:
    """Doubles as double-double numbers."""
    return DoubleDouble(a, np.zeros_like(a))


def _undamped(rigid: Array, shapes: Array, damping: Array) -> NDArray[np.intp]:
    """Which rigid-body motions no dashpot resists, but for a rounding of the dashpots.

    `rigid` is modified in place: such motions are separated from the others.
    """
    drag = rigid.T @ damping @ rigid
    if np.any(drag - np.diag(np.diagonal(drag))):
        rigid[:] = rigid @ np.linalg.eigh(drag)[1]
    forces = np.abs(_times(rigid.T, exact_slices_product(damping, shapes)).high)
    level = 8.0 * 2.0**-53 * (np.abs(rigid).T @ np.abs(damping) @ np.abs(shapes))
    return np.flatnonzero(np.all(forces <= level, axis=1))


def _times(a: Array, b: DoubleDouble) -> DoubleDouble:
    """Product of a matrix of doubles with one of double-doubles."""
    return add(exact_slices_product(a, b.high), double_double(a @ b.low))


def _congruent(shapes: Array, matrix: Array) -> DoubleDouble:
    """The matrix shapes' matrix shapes."""
    return _times(np.ascontiguousarray(shapes.T), exact_slices_product(matrix, shapes))


def _divided(matrix: DoubleDouble, deviation: DoubleDouble) -> DoubleDouble:
    """The quotient (1 + deviation)^-1 matrix, of a small deviation."""
    quotient = matrix
    size = float(np.linalg.norm(deviation.high))
    error = size
    while error > ROUNDING:
        product = _times(deviation.high, quotient)
        product = add(product, double_double(deviation.low @ quotient.high))
        quotient = add(matrix, negative(product))
        error *= size
    return quotient
