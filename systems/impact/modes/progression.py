"""Directions along which a machine progresses: no force depends on its position along them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.structure.equations import in_echelon

_ROUNDING = 8.0 * 2.0**-52
"""Rounding error per term: a product of unit vectors counts as zero below this times its number of
terms."""


class Progression(NamedTuple):
    """Directions along which states shift, and the components of a state along them.

    Attributes
    ----------
    shift : (d, m)
        Columns: changes of a state (d,) that only shift the motion.
    part : (m, d)
        Rows that give the components of a state: ``part @ shift`` is the identity.
    """

    shift: Array
    part: Array

    @classmethod
    def along(cls, shift: Array) -> Progression:
        """The progression along independent directions (d, m)."""
        part = np.linalg.pinv(shift) if shift.size else shift.T
        return cls(shift, np.asarray(part, dtype=np.float64))

    def removed(self, states: Array) -> Array:
        """States (..., d) without their components along the directions."""
        return states - states @ self.part.T @ self.shift.T if self.shift.size else states

    @property
    def across(self) -> Array:
        """Orthonormal basis (d, d - m) of the changes of states orthogonal to all directions."""
        return np.asarray(null_space(self.shift.T))


def depends_on_place(element: Element) -> bool:
    """Whether an element depends on its gap; others depend on rates, or on a slider's stretch."""
    return any(
        regime.holds
        or (regime.stiffness and not regime.anchored)
        or any(watch.gap for watch in regime.guards)
        for regime in element.regimes
    )


def directions(rigid: Array, damping: Array, elements: Sequence[Element]) -> Array:
    """Shifts (N + J, m) of positions and sliders that change no force of springs and elements.

    There are none if neither a dashpot nor friction resists some velocity along them: the motions
    then form families with the mean velocity as parameter.

    Parameters
    ----------
    rigid : (N, r)
        Independent motions without restoring force.
    damping : (N, N)
        Derivatives of the forces with respect to velocities.
    elements : sequence of Element
        All of them act along rows of coordinates.
    """
    n, rows = len(rigid), [(depends_on_place(e), e.row(len(rigid))) for e in elements]
    slips = [*damping, *(row for placed, row in rows if not placed)]
    free = _unseen([row for placed, row in rows if placed], np.linalg.qr(rigid)[0])
    if not free.size or _unseen(slips, free).size:
        free = free[:, :0]
    else:
        free = in_echelon(free)
        whole = np.rint(free)
        free = np.where(abs(free - whole) <= n * _ROUNDING, whole, free)
    return np.vstack([free, *(e.row(n)[None] @ free for e in elements if e.slider)])


def _unseen(rows: Sequence[Array], basis: Array) -> Array:
    """Basis (N, k) of the subspace of orthonormal directions (N, r) on which all rows vanish."""
    sizes = [float(np.linalg.norm(row)) for row in rows]
    units = [row / size for row, size in zip(rows, sizes, strict=True) if size > 0.0]
    if not units:
        return basis
    values, vectors = np.linalg.svd(np.array(units) @ basis)[1:]
    rank = int((values > _ROUNDING * (len(units) + len(basis))).sum())
    return np.asarray(basis @ vectors[rank:].T)
