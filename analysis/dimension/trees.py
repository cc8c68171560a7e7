"""Trees of boxes: points that are near to one another lie together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array

LEAF = 64
"""The most points of a leaf: fewer cost more boxes, more are measured although they are far."""

_LANES = 8


@final
@dataclass(frozen=True, eq=False)
class BoxTree:
    """Points in a balanced tree of boxes, each halved across its widest coordinate.

    Node v has the children 2v + 1 and 2v + 2; the leaves come last.

    Parameters
    ----------
    low, high : (nodes, d) arrays
        The boxes.
    sizes : (nodes,) array
        How many points each holds.
    points : (leaves, d, slots) array
        The points of each leaf, filled up with zeros.
    members : (leaves, slots) array
        Their numbers, filled up with zeros.
    """

    low: Array
    high: Array
    sizes: NDArray[np.int64]
    points: Array
    members: NDArray[np.int64]

    @classmethod
    def of(cls, points: Array) -> BoxTree:
        """Return the tree of some points, (n, d)."""
        n, d = points.shape
        leaves = 1
        while leaves * LEAF < n:
            leaves *= 2
        nodes = 2 * leaves - 1
        slots = _LANES * -(-n // (_LANES * leaves))
        low, high = np.empty((nodes, d)), np.empty((nodes, d))
        rows, order = points.copy(), np.arange(n)
        filled = np.zeros((leaves, d, slots))
        members = np.zeros((leaves, slots), dtype=np.int64)
        spans = [(0, n)]
        for v in range(nodes):
            begin, end = spans[v]
            part = rows[begin:end]
            low[v], high[v] = part.min(axis=0), part.max(axis=0)
            if v < leaves - 1:
                half = (end - begin) // 2
                turned = np.argpartition(part[:, np.argmax(high[v] - low[v])], half)
                rows[begin:end], order[begin:end] = part[turned], order[begin:end][turned]
                spans += [(begin, begin + half), (begin + half, end)]
            else:
                filled[v - leaves + 1, :, : end - begin] = part.T
                members[v - leaves + 1, : end - begin] = order[begin:end]
        sizes = np.array([end - begin for begin, end in spans], dtype=np.int64)
        return cls(low, high, sizes, filled, members)

    @property
    def leaves(self) -> int:
        """Number of leaves."""
        return len(self.members)
