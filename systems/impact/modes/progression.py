"""Directions along which a machine progresses: nothing that acts on it depends on its place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space, qr

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element

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
        return cls(shift, np.linalg.pinv(shift))

    def removed(self, states: Array) -> Array:
        """States (..., d) without their parts along the directions; the same where there is none."""
        return states - states @ self.part.T @ self.shift.T if self.shift.size else states

    @property
    def across(self) -> Array:
        """Orthonormal changes (d, d - m) of states across all directions."""
        return np.asarray(null_space(self.shift.T))


def depends_on_place(element: Element) -> bool:
    """Whether an element acts by its gap; others see its rate alone, or carry their spring along."""
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
    elements : sequence of Element
        All along rows.
    """
    n, rows = len(rigid), [(depends_on_place(e), e.row(len(rigid))) for e in elements]
    basis = np.linalg.qr(rigid)[0]
    seen = [row for placed, row in rows if placed]
    slips = [*damping, *(row for placed, row in rows if not placed)]
    free = basis @ _null(np.array(seen).reshape(-1, n) @ basis, seen)
    if _null(np.array(slips) @ free, slips).size:
        free = free[:, :0]
    if free.size:  # one coordinate of each direction is one there, and zero along all others
        own = qr(free.T, mode="r", pivoting=True)[1][: free.shape[1]]
        free = free @ np.linalg.inv(free[own])
    return np.vstack([free, *(e.row(n)[None] @ free for e in elements if e.slider)])


def _null(products: Array, rows: Sequence[Array]) -> Array:
    """Orthonormal combinations (r, k) of directions that no row sees, by their products (j, r)."""
    sizes = np.linalg.norm(np.array(rows).reshape(len(products), -1), axis=1)
    scaled = products[sizes > 0.0] / sizes[sizes > 0.0, None]
    count = products.shape[1]
    if not scaled.size:
        return np.eye(count)
    values, vectors = np.linalg.svd(scaled)[1:]
    rank = int((values > _ROUNDING * max(len(rows), len(rows[0]))).sum())
    return np.asarray(vectors[rank:].T)
