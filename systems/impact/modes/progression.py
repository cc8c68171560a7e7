"""Directions along which a machine progresses: nothing that acts on it depends on its place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.structure.equations import in_echelon

_ROUNDING = 8.0 * 2.0**-52
"""Of each of N terms: what a row of length one makes of a direction of length one is zero."""


class Progression(NamedTuple):
    """Directions along which states shift, and which part of a state lies along each.

    Attributes
    ----------
    shift : (d, m)
        Columns: changes of a state (d,) that change no motion but for its place.
    part : (m, d)
        Rows: ``part @ shift`` is the identity.
    """

    shift: Array
    part: Array

    @classmethod
    def along(cls, shift: Array) -> Progression:
        """The progression along independent directions (d, m)."""
        part = np.linalg.pinv(shift) if shift.size else shift.T
        return cls(shift, np.asarray(part, dtype=np.float64))

    def removed(self, states: Array) -> Array:
        """States (..., d) without their parts along the directions."""
        return states - states @ self.part.T @ self.shift.T if self.shift.size else states

    @property
    def across(self) -> Array:
        """Orthonormal changes (d, d - m) of states across all directions."""
        return np.asarray(null_space(self.shift.T))


def depends_on_place(element: Element) -> bool:
    """Whether an element acts by its gap; others act by its rate, or their spring moves along."""
    return any(
        regime.holds
        or (regime.stiffness and not regime.anchored)
        or any(watch.gap for watch in regime.guards)
        for regime in element.regimes
    )


def directions(rigid: Array, damping: Array, elements: Sequence[Element]) -> Array:
    """Shifts (N + J, m) of positions and sliders that no spring and no element sees.

    There are none where neither a dashpot nor friction resists all velocities along them: then
    motions are families, by their mean velocity.

    Parameters
    ----------
    rigid : (N, r)
        Independent motions without restoring force.
    damping : (N, N)
        Derivatives of the forces by velocities.
    elements : sequence of Element
        All along rows.
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
    """The part (N, k) of orthonormal directions (N, r) along which all rows (N,) are zero."""
    sizes = [float(np.linalg.norm(row)) for row in rows]
    units = [row / size for row, size in zip(rows, sizes, strict=True) if size > 0.0]
    if not units:
        return basis
    values, vectors = np.linalg.svd(np.array(units) @ basis)[1:]
    rank = int((values > _ROUNDING * (len(units) + len(basis))).sum())
    return np.asarray(basis @ vectors[rank:].T)
