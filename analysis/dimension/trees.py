"""Trees of boxes that group near points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array

if TYPE_CHECKING:
    from dynkit.analysis.dimension.box_kernels import Boxes

LEAF = 64
"""Most points of a leaf: a balance between the number of boxes and of distances of far points."""

_LANES = 8


def boxes_of(points: Array, turns: Array, blocks: NDArray[np.int64]) -> Boxes:
    """Return the balanced tree of points; each box is halved across its widest coordinate.

    Node v has the children 2v + 1 and 2v + 2; the leaves come last.

    Parameters
    ----------
    points : (n, d) array
    turns : (d,) array
        One turn of each coordinate that is an angle; zero for others.
    blocks : (n,) array
        The block of time of each point.
    """
    from dynkit.analysis.dimension.box_kernels import Boxes

    n, d = points.shape
    leaves = 1
    while leaves * LEAF < n:
        leaves *= 2
    nodes = 2 * leaves - 1
    slots = _LANES * -(-n // (_LANES * leaves))
    low, high = np.empty((2, nodes, d))
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
    return Boxes(
        low,
        high,
        sizes,
        filled,
        sizes[-leaves:],
        blocks[members],
        turns,
        np.arange(d, dtype=np.int64),
    )
