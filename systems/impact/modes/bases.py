"""Modal bases of linear structures: coordinates in 2x2 blocks of the state matrix."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.exponential.modes import Pairs
from dynkit.systems.impact.modes.schur_forms.block_schur import Blocks, real_blocks
from dynkit.systems.structure.modes import Derivation, Modes


@cache
def _fill_products() -> Any:
    """The kernel of `row_by_row`; an import at each call would take as long as the products."""
    from dynkit.systems.impact.modes.row_kernels import fill_products

    return fill_products


def row_by_row(rows: Array, matrix: Array) -> Array:
    """Products (..., m) of each row (..., n) with a matrix (m, n).

    The bits of a product do not depend on the other rows, unlike with BLAS, whose order of
    summation depends on their number.
    """
    flat = np.ascontiguousarray(rows).reshape(-1, rows.shape[-1])
    out = np.empty((len(flat), len(matrix)))
    _fill_products()(flat, np.ascontiguousarray(matrix.T), out)
    return out.reshape(*rows.shape[:-1], len(matrix))


def energy_of(x: Array, v: Array, mass: Array, stiffness: Array) -> Array:
    """Kinetic plus elastic energy (...) at positions and velocities (..., n)."""
    momentum, force = row_by_row(v, mass), row_by_row(x, stiffness)
    return np.asarray(0.5 * (momentum * v + force * x).sum(axis=-1))


class Basis(ABC):
    """Coordinates y (2, n) of a linear structure with n degrees of freedom.

    A subclass must implement `pairs`, the 2x2 blocks by which pairs of coordinates evolve, the
    conversions between coordinates, positions and velocities, and the energies.
    """

    pairs: Pairs

    @cached_property
    def arranged(self) -> dict[Any, Any]:
        """Cache of layouts and propagators for the last table frequency, see `Forced`."""
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
        """Row (2, n) whose product with coordinates is a given combination (n,) of positions."""

    @abstractmethod
    def units(self) -> tuple[Array, Array]:
        """Positions and velocities (2 n, n) of unit coordinates: all of row one, then row two."""

    @abstractmethod
    def pushes(self, force: Array) -> Array:
        """Rates of change (..., 2, n) of the coordinates due to forces (..., n)."""

    @abstractmethod
    def energies(self, y: Array) -> Array:
        """Kinetic plus potential energy (...) from coordinates (..., 2, n)."""

    @cached_property
    def changes(self) -> dict[Any, Array]:
        """Cache of changes of basis (2 n, 2 m) from other bases, see `Mode`."""
        return {}

    def kick(self, velocity: Array, row: Array) -> Array:  # noqa: ARG002
        """Coordinates (2, n) of the velocities (n,) of an impulse, then their low parts: (4, n).

        The impulse acts along a row (n,), and changes the rate of this row by one.
        """
        high = self.coordinates(np.zeros_like(velocity), velocity)
        return np.concatenate([high, np.zeros_like(high)])


@final
@dataclass(frozen=True, eq=False)
class NormalModes(Basis):
    """Normal modes of a structure whose damping leaves them uncoupled.

    The coordinates of a mode are (q, q'). For a clearly overdamped mode they are instead the
    amplitudes y of its two real exponentials, with (q, q') = mixing y.

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
        """Make the basis from the normal modes and the mass matrix of a structure."""
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
        out = np.empty((*q.shape[:-1], 2, q.shape[-1]))
        out[..., 0, :], out[..., 1, :] = q, p
        return out

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
        # In normal modes the kick is parallel to the row of the contact velocity, Phi^T J.
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
    """Basis of a structure whose damping couples the normal modes: blocks of its Schur form.

    Attributes
    ----------
    pairs : Pairs
    position_matrix, velocity_matrix : (N, 2 N) positions and velocities from coordinates, which
        are ordered by the rows of pairs
    inverse : (2 N, 2 N) coordinates from positions and velocities
    energy : (2 N, 2 N) matrix from coordinates to numbers whose square sum is twice the energy
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
        """Make the basis of a structure; if modes are well separated, each block is one mode."""
        blocks = real_blocks(given)
        g, n = blocks.generator, given.mass.size
        # The numbers of two unrelated real rates, or of a rigid body, have separate bounds.
        apart = (g[2] == 0.0) & ((g[1] == 0.0) | (g[0] == 0.0))
        links = np.stack([blocks.target, blocks.source])
        # The norm of a cluster never grows, unless it holds rigid bodies.
        cluster = np.arange(n)
        rigid = apart & ((g[0] == 0.0) | (g[3] == 0.0))
        for target, source in links.T.tolist():  # targets ascend
            if not (rigid[target] or rigid[source]):
                cluster[source] = min(cluster[source], cluster[target])
        growth = None if given.traction is None else _growths(blocks, apart, cluster)
        return CoupledModes(
            Pairs(
                g,
                blocks.generator_low,
                np.where(apart & ((cluster == np.arange(n)) | rigid), 0.0, 1.0),
                links,
                blocks.coupling.T,
                cluster,
                growth,
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


def _growths(blocks: Blocks, apart: NDArray[np.bool_], cluster: NDArray[np.intp]) -> Array:
    """Largest growth rates (N,) of the norms of clusters, and of numbers with separate bounds.

    For a norm it is the largest eigenvalue of the symmetric part of the cluster's matrix.
    """
    n, g = len(cluster), blocks.generator
    matrix = np.zeros((n, 2, n, 2))
    matrix[np.arange(n), :, np.arange(n), :] = g.T.reshape(n, 2, 2)
    for target, source, b in zip(blocks.target, blocks.source, blocks.coupling, strict=True):
        matrix[target, :, source] = b.reshape(2, 2)
    growth = np.where(apart, np.maximum(g[0], g[3]), 0.0)
    for number in np.unique(cluster[~apart]).tolist():
        own = np.flatnonzero((cluster == number) & ~apart)
        part = matrix[own][:, :, own].reshape(2 * len(own), -1)
        even = 0.5 * (part + part.T)
        rounding = 0.0 if np.array_equal(even, np.diag(np.diag(even))) else 2.0**-48
        growth[own] = np.linalg.eigvalsh(even)[-1] + rounding * abs(part).max()
    return np.maximum(growth, 0.0)


def basis_of(given: Derivation) -> Basis:
    """Normal modes if the damping leaves them uncoupled, else coupled modes."""
    if given.modes.proportional and given.traction is None:
        return NormalModes.of(given.modes, given.mass.dense)
    return CoupledModes.of(given)
