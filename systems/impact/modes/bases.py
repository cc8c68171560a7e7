"""Bases in which a linear structure falls into pairs of numbers that evolve by themselves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.exponential.modes import Pairs
from dynkit.systems.impact.modes.block_schur import real_blocks
from dynkit.systems.structure.modes import Derivation, Modes

_CACHED = 2**14
"""So many numbers are summed up at a time: processors hold them close by."""


def row_by_row(rows: Array, matrix: Array) -> Array:
    """Products (..., m) of each row (..., n) with a matrix (m, n): the same bits in any company.

    BLAS sums in an order that depends on the number of rows.
    """
    if rows.ndim == 1:  # `accumulate` sums one after the other, too
        return np.asarray(np.add.accumulate(matrix.T * rows[:, None])[-1])
    most = max(1, _CACHED // max(1, len(matrix)))
    if rows.ndim == 2 and len(rows) > most:
        parts = [rows[first : first + most] for first in range(0, len(rows), most)]
        columns = np.asfortranarray(matrix)
        return np.concatenate([row_by_row(part, columns) for part in parts])
    out = rows[..., :1] * matrix[:, 0]
    for j in range(1, matrix.shape[1]):
        out += rows[..., j, None] * matrix[:, j]
    return np.asarray(out)


class Basis(ABC):
    """Coordinates y (2, n) of a linear structure with n degrees of freedom.

    A subclass owes `pairs`, how each pair evolves, the positions, velocities and energies of
    coordinates, and the coordinates of positions and velocities.
    """

    pairs: Pairs

    @cached_property
    def arranged(self) -> dict[Any, Any]:
        """Layouts and steps of its pairs beside a table of the last frequency; see `Forced`."""
        return {}

    @abstractmethod
    def positions(self, y: Array) -> Array:
        """Positions (..., n) from coordinates (..., 2, n)."""

    @abstractmethod
    def velocities(self, y: Array) -> Array:
        """Velocities (..., n) from coordinates (..., 2, n)."""

    @abstractmethod
    def coordinates(self, position: Array, velocity: Array) -> Array:
        """Coordinates (..., 2, n) from positions and velocities (..., n)."""

    @abstractmethod
    def position_row(self, coefficients: Array) -> Array:
        """Row (2, n) that gives a sum (n,) of positions from coordinates."""

    @abstractmethod
    def units(self) -> tuple[Array, Array]:
        """Positions and velocities (2 n, n) of unit coordinates, both rows one after the other."""

    @abstractmethod
    def pushes(self, force: Array) -> Array:
        """Rates (..., 2, n) of the coordinates under forces (..., n)."""

    @abstractmethod
    def energies(self, y: Array) -> Array:
        """Kinetic plus potential energy (...) from coordinates (..., 2, n)."""

    @cached_property
    def changes(self) -> dict[Any, Array]:
        """Changes (2 n, 2 m) from other bases; see `Mode`."""
        return {}

    def kick(self, velocity: Array, row: Array) -> Array:  # noqa: ARG002
        """Coordinates of the velocities (n,) of a unit jump along a row (n,), low parts, (4, n)."""
        high = self.coordinates(np.zeros_like(velocity), velocity)
        return np.concatenate([high, np.zeros_like(high)])


@final
@dataclass(frozen=True, eq=False)
class NormalModes(Basis):
    """Normal modes of a structure whose damping leaves them uncoupled.

    A mode is (q, q'), or its two real exponentials where it is clearly overdamped: (q, q') = mixing
    y.

    Attributes
    ----------
    pairs : Pairs
    matrix : (N, N) modal matrix
    projector : (N, N) its inverse, ``matrix' M``
    mixing, unmixing : (2, 2, N), or None where every mode is (q, q')
    stiffness : (N,) squares of the frequencies
    """

    pairs: Pairs
    matrix: Array
    projector: Array
    mixing: Array | None
    unmixing: Array | None
    stiffness: Array

    @staticmethod
    def of(modes: Modes, mass: Array) -> NormalModes:
        """The normal modes and the mass matrix of a structure."""
        pairs, mixing = Pairs.oscillators(
            modes.frequencies, modes.frequencies_low, modes.decay, modes.decay_low
        )
        unmixing = None
        if mixing is not None:
            determinant = mixing[0, 0] * mixing[1, 1] - mixing[0, 1] * mixing[1, 0]
            unmixing = (
                np.array([[mixing[1, 1], -mixing[0, 1]], [-mixing[1, 0], mixing[0, 0]]])
                / determinant
            )
        return NormalModes(
            pairs,
            modes.matrix,
            modes.matrix.T @ mass,
            mixing,
            unmixing,
            modes.frequencies**2,
        )

    def _modal(self, y: Array) -> tuple[Array, Array]:
        q, p = y[..., 0, :], y[..., 1, :]
        if self.mixing is None:
            return q, p
        b = self.mixing
        return b[0, 0] * q + b[0, 1] * p, b[1, 0] * q + b[1, 1] * p

    def positions(self, y: Array) -> Array:
        return row_by_row(self._modal(y)[0], self.matrix)

    def velocities(self, y: Array) -> Array:
        return row_by_row(self._modal(y)[1], self.matrix)

    def coordinates(self, position: Array, velocity: Array) -> Array:
        return self._from_modal(position @ self.projector.T, velocity @ self.projector.T)

    def _from_modal(self, q: Array, p: Array) -> Array:
        if self.unmixing is not None:
            b = self.unmixing
            q, p = b[0, 0] * q + b[0, 1] * p, b[1, 0] * q + b[1, 1] * p
        return np.stack([q, p], axis=-2)

    def position_row(self, coefficients: Array) -> Array:
        row = coefficients @ self.matrix
        if self.mixing is None:
            return np.stack([row, np.zeros_like(row)])
        return np.asarray(self.mixing[0] * row)

    def units(self) -> tuple[Array, Array]:
        n = len(self.matrix)
        b = np.zeros((2, 2, n)) + np.eye(2)[..., None] if self.mixing is None else self.mixing
        x, v = (b[..., None] * self.matrix.T).reshape(2, 2 * n, n)
        return x, v

    def pushes(self, force: Array) -> Array:
        return self._from_modal(np.zeros_like(force), force @ self.matrix)

    def energies(self, y: Array) -> Array:
        q, p = self._modal(y)
        return np.asarray(0.5 * (p * p + q * q * self.stiffness).sum(axis=-1))

    def kick(self, velocity: Array, row: Array) -> Array:
        if self.mixing is not None:
            return super().kick(velocity, row)
        # In normal modes the kick is parallel to the row of the contact velocity.
        along = [(Fraction(row[j]), self.matrix[j].tolist()) for j in np.flatnonzero(row)]
        shares = [sum(a * Fraction(b[i]) for a, b in along) for i in range(len(row))]
        square = sum(share * share for share in shares)
        out = np.zeros((4, len(row)))
        for i, entry in enumerate(shares):
            out[1, i] = float(entry / square)
            out[3, i] = float(entry / square - Fraction(out[1, i]))
        return out


@final
@dataclass(frozen=True, eq=False)
class CoupledModes(Basis):
    """Blocks of a structure whose damping couples the normal modes.

    Attributes
    ----------
    pairs : Pairs
    position_matrix, velocity_matrix : (N, 2 N) from the coordinates, both rows of pairs one after
        the other
    inverse : (2 N, 2 N) from positions and velocities
    energy : (2 N, 2 N) numbers from the coordinates whose square sum is twice the energy
    mass : (N, N)
    """

    pairs: Pairs
    position_matrix: Array
    velocity_matrix: Array
    inverse: Array
    energy: Array
    mass: Array

    @staticmethod
    def of(given: Derivation) -> CoupledModes:
        """The blocks of a structure, complex modes where they are well apart."""
        blocks = real_blocks(given)
        g, n = blocks.generator, given.mass.size
        # Two rates that have nothing in common, and rigid-body motions, are bounded one by one.
        apart = (g[2] == 0.0) & ((g[1] == 0.0) | (g[0] == 0.0))
        links = np.stack([blocks.target, blocks.source])
        # The norm of a cluster never grows, unless it holds rigid bodies.
        cluster = np.arange(n)
        rigid = apart & ((g[0] == 0.0) | (g[3] == 0.0))
        for target, source in links.T.tolist():  # from the first target of a cluster on
            if not (rigid[target] or rigid[source]):
                cluster[source] = min(cluster[source], cluster[target])
        return CoupledModes(
            Pairs(
                g,
                blocks.generator_low,
                np.where(apart & ((cluster == np.arange(n)) | rigid), 0.0, 1.0),
                links,
                blocks.coupling.T,
                cluster,
            ),
            blocks.matrix[:n],
            blocks.matrix[n:],
            blocks.inverse,
            blocks.energy,
            given.mass.dense,
        )

    def _flat(self, y: Array) -> Array:
        return y.reshape(*y.shape[:-2], 2 * len(self.mass))

    def positions(self, y: Array) -> Array:
        return row_by_row(self._flat(y), self.position_matrix)

    def velocities(self, y: Array) -> Array:
        return row_by_row(self._flat(y), self.velocity_matrix)

    def coordinates(self, position: Array, velocity: Array) -> Array:
        y = np.concatenate([position, velocity], axis=-1) @ self.inverse.T
        return np.asarray(y.reshape(*y.shape[:-1], 2, len(self.mass)))

    def position_row(self, coefficients: Array) -> Array:
        return np.asarray((coefficients @ self.position_matrix).reshape(2, -1))

    def units(self) -> tuple[Array, Array]:
        return self.position_matrix.T, self.velocity_matrix.T

    def pushes(self, force: Array) -> Array:
        velocity = np.linalg.solve(self.mass, force.T).T
        return self.coordinates(np.zeros_like(force), np.asarray(velocity, dtype=np.float64))

    def energies(self, y: Array) -> Array:
        return np.asarray(0.5 * (row_by_row(self._flat(y), self.energy) ** 2).sum(axis=-1))


def basis_of(given: Derivation) -> Basis:
    """Normal modes where the damping allows, coupled ones elsewhere."""
    if given.modes.proportional:
        return NormalModes.of(given.modes, given.mass.dense)
    return CoupledModes.of(given)
