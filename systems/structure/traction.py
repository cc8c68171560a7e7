"""Friction proportional to contact forces, and its contribution to a structure's matrices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.systems.structure.double_double import DoubleDouble, add, scale
from dynkit.systems.structure.symmetric import SymmetricMatrix, exact_slices_product


class Traction(NamedTuple):
    """Forces along p directions, each a combination of the forces of springs and dashpots.

    They add ``along @ damping`` to the damping matrix and ``along @ stiffness`` to the stiffness
    matrix; the sums are not symmetric.

    Attributes
    ----------
    along : (N, p)
    damping, stiffness : (p, N), double-double
    """

    along: Array
    damping: DoubleDouble
    stiffness: DoubleDouble

    @staticmethod
    def of(
        along: Array, weights: Array, damping: SymmetricMatrix, stiffness: SymmetricMatrix
    ) -> Traction:
        """Return the forces ``along @ weights @ (C x' + K x)``, with weights (p, N)."""
        own = np.ascontiguousarray(weights.T)
        parts = (part.times(own) for part in (damping, stiffness))
        return Traction(along, *(DoubleDouble(high.T, low.T) for high, low in parts))

    def without(self, places: NDArray[np.intp], ties: Array | None) -> Traction:
        """Return the forces if coordinates (h,) are zero, or follow the m others by ties (h, m)."""
        others = np.delete(np.arange(len(self.along)), places)
        along, parts = self.along[others], []
        if ties is not None:
            along = along + ties.T @ self.along[places]
        for whole in self[1:]:
            part = DoubleDouble(*(own[:, others] for own in whole))
            for place, tie in zip(places.tolist(), () if ties is None else ties, strict=False):
                term = DoubleDouble(*(own[:, [place]] for own in whole))
                part = add(part, scale(term, tie[None]))
            parts.append(part)
        return Traction(along, *parts)


def product_of(a: DoubleDouble, b: Array) -> DoubleDouble:
    """Product (p, m) of a double-double matrix (p, N) with one of doubles (N, m)."""
    product = exact_slices_product(a.high, b)
    low = a.low @ b
    return add(product, DoubleDouble(low, np.zeros_like(low)))
