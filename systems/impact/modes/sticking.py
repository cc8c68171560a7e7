"""Structures with sticking friction: some rows of coordinates have constant rates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.exponential.modes import Pairs
from dynkit.systems.impact.modes.bases import Basis, energy_of, row_by_row
from dynkit.systems.structure.double_double import DoubleDouble, add, negative
from dynkit.systems.structure.symmetric import product_with

if TYPE_CHECKING:
    from dynkit.systems.impact.modes.structure import Held, Structure

_CONSISTENT, _REFINEMENTS = 1e-9, 3
"""Largest residual of a static solution, relative to the largest force; a larger one means that a
force acts on a rigid motion. Number of steps of iterative refinement."""


@final
class StuckModes(Basis):
    """Coordinates of a structure while the sums z = J x, (h,), have constant rates.

    The first coordinates are those of the structure in which these sums are held; the pairs (z, z')
    follow. Independent positions x_o determine all positions x = T x_o + U z. They are x_o = A z +
    B z' plus a motion in the basis of the held structure, whose matrices are K_o and C_o: K_o A =
    -T' K U, K_o B = -T' C U - C_o A.
    """

    def __init__(self, structure: Structure, rows: Array, still: Any, held: Held) -> None:
        s, n = structure, structure.size
        self._rows, self._others = rows, held.others
        self._inner: Basis | None = None
        self._mass, self._stiffness = s.mass, s.stiffness
        h, m = len(rows), len(held.others)
        spread = np.zeros((n, m))
        spread[held.others] = np.eye(m)
        if held.ties is not None:
            spread[held.pivots] = held.ties
        spread_sums = np.zeros((n, h))
        spread_sums[held.pivots] = held.by_sums
        self._spread = spread
        none = np.zeros(1)
        moves, stays = Pairs.oscillators(none, none, none, none)[0], Pairs.constant()
        own = Pairs.join(*(stays if rests else moves for rests in still.tolist()))
        place, drag = np.zeros((2, m, h))
        if held.structure is None:
            self.pairs = own
        else:
            self._inner = held.structure.free
            self.pairs = Pairs.join(self._inner.pairs, own)
            inner, onto = held.structure, np.ascontiguousarray(-spread.T)
            place = _solved(inner, product_with(onto, s.forces("stiffness", spread_sums)))
            pull = product_with(onto, s.forces("damping", spread_sums))
            pull = add(pull, negative(inner.forces("damping", place)))
            for part in pull:
                part[:, still] = 0.0
            drag = _solved(inner, pull)
        self._place, self._drag = place, drag
        self._by_place, self._by_rate = spread_sums + spread @ place, spread @ drag

    def _parts(self, y: Array) -> tuple[Array, Array, Array]:
        m = len(self._others)
        return y[..., :m], y[..., 0, m:], y[..., 1, m:]

    def positions(self, y: Array) -> Array:
        own, z, rate = self._parts(y)
        out = row_by_row(z, self._by_place) + row_by_row(rate, self._by_rate)
        if self._inner is not None:
            out = out + row_by_row(self._inner.positions(own), self._spread)
        return out

    def velocities(self, y: Array) -> Array:
        own, _, rate = self._parts(y)
        out = row_by_row(rate, self._by_place)
        if self._inner is not None:
            out = out + row_by_row(self._inner.velocities(own), self._spread)
        return out

    def coordinates(self, position: Array, velocity: Array) -> Array:
        z, rate = position @ self._rows.T, velocity @ self._rows.T
        own = np.stack([z, rate], axis=-2)
        if self._inner is None:
            return own
        x = position[..., self._others] - z @ self._place.T - rate @ self._drag.T
        v = velocity[..., self._others] - rate @ self._place.T
        return np.concatenate([self._inner.coordinates(x, v), own], axis=-1)

    def position_row(self, coefficients: Array) -> Array:
        own = np.stack([coefficients @ self._by_place, coefficients @ self._by_rate])
        if self._inner is None:
            return own
        return np.concatenate([self._inner.position_row(coefficients @ self._spread), own], axis=1)

    def units(self) -> tuple[Array, Array]:
        n = len(self._spread)
        y = np.eye(2 * n).reshape(2 * n, 2, n)
        return self.positions(y), self.velocities(y)

    def pushes(self, force: Array) -> Array:
        none = np.zeros((*force.shape[:-1], 2, len(self._rows)))
        if self._inner is None:
            return none
        return np.concatenate([self._inner.pushes(force @ self._spread), none], axis=-1)

    def energies(self, y: Array) -> Array:
        return energy_of(self.positions(y), self.velocities(y), self._mass, self._stiffness)


def stuck(structure: Structure, rows: Array, still: NDArray[np.bool_]) -> Structure:
    """The structure while rows (h, N) of coordinates have constant rates; cached.

    `still` (h,) marks rates that are zero. Impacts act as on the original structure, since friction
    forces are finite.
    """
    key = rows.tobytes() + still.tobytes()
    if key not in structure.stuck:
        basis = StuckModes(structure, rows, still, structure.holding(rows))
        structure.stuck[key] = structure.with_basis(basis)
    return structure.stuck[key]


def _solved(structure: Structure, forces: DoubleDouble) -> Array:
    """Static displacements (m, h) due to forces (m, h), which must not act on rigid motions.

    The solution is refined, since a structure with a large condition number amplifies rounding.
    """
    stiffness = structure.stiffness
    even = np.array_equal(stiffness, stiffness.T)
    back = np.linalg.pinv(stiffness, len(stiffness) * 2.0**-52, hermitian=even)
    found: Array = back @ forces.high
    for _ in range(_REFINEMENTS):
        missed = add(forces, negative(structure.forces("stiffness", found)))
        found = found + back @ missed.high
    off = abs(stiffness @ found - forces.high).max(initial=0.0)
    if off > _CONSISTENT * abs(forces.high).max(initial=0.0):
        raise NotImplementedError(
            "what sticks must not push, by springs or dashpots, what else could move away freely"
        )
    return found
