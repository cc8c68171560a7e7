"""Boxes of points, bins of distances, and bounds of the distances between boxes."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array

Integers: TypeAlias = NDArray[np.int64]

CELLS = 7
"""Leading bits of the mantissa that select the first bin of a distance: 128 cells to an octave."""

SHIFT = 52 - CELLS
"""Number of lower bits of the mantissa."""

FEW_EDGES = 6
"""Largest number of edges between the bounds of two leaves for counts by comparison with each."""


class Boxes(NamedTuple):
    """Points in a balanced tree of boxes.

    Parameters
    ----------
    low, high : (nodes, d)
        The boxes; nodes = 2 leaves - 1, a power of two minus one, and the leaves come last.
    sizes : (nodes,)
        Number of points in each box.
    points : (leaves, d, slots)
        The points of each leaf; unused slots contain finite numbers.
    filled : (leaves,)
        Number of used slots.
    blocks : (leaves, slots)
        The block of each point.
    turns : (d,)
        One turn of each coordinate that is an angle in [0, turn]; zero for others.
    every : (d,)
        0, 1, ..., d - 1.
    """

    low: Array
    high: Array
    sizes: Integers
    points: Array
    filled: Integers
    blocks: Integers
    turns: Array
    every: Integers


class Bins(NamedTuple):
    """Bins of distances, and the norm.

    Parameters
    ----------
    euclidean
        Whether the norm is Euclidean, with squared distances, or the maximum norm.
    edges : (k + 1,)
        Ascending; a distance counts in the first bin whose edge it does not exceed. The last edge
        is infinite, and the count of its bin is incomplete.
    first : (cells + 1,)
        For each cell of leading bits, from that of the first edge on, the first bin that it meets;
        last the number of the first cell.
    """

    euclidean: bool
    edges: Array
    first: Integers


class Buffers(NamedTuple):
    """Buffers that a thread modifies in place.

    Parameters
    ----------
    row, row_bits : (slots,)
        Scratch: floats, and the same memory as integers.
    widest, chosen : (d,)
        Scratch.
    below : (FEW_EDGES, slots)
        Scratch.
    stack : (any, 2)
        Pairs of nodes that remain to be counted; it can hold six pairs for each level of the tree,
        and eight more.
    shares : (blocks, k + 1)
        Counts by blocks: each computed distance counts in the blocks of both points, and a whole
        box at once for a single point.
    lumps : (nodes, k + 1)
        Numbers of points at the distances of each bin from every point of a node, for pairs that
        are not included in `shares`.
    work : (2,)
        Numbers of examined pairs of boxes, and of computed distances.
    """

    row: Array
    row_bits: Integers
    widest: Array
    chosen: Integers
    below: Integers
    stack: Integers
    shares: Integers
    lumps: Integers
    work: Integers


@kernel(inline=True)
def _gap_bounds(
    low: float, high: float, other_low: float, other_high: float, turn: float
) -> tuple[float, float]:
    """Return bounds of the distances between two intervals; for angles `turn` is not zero."""
    least = max(low - other_high, other_low - high, 0.0)
    most = max(high - other_low, other_high - low)
    if turn > 0.0:
        wrapped = min(least, turn - most)
        most = min(most, turn - least)
        least = wrapped
    return least, most


@kernel()
def box_bounds(tree: Boxes, a: int, b: int, euclidean: bool) -> tuple[float, float]:
    """Return bounds of the distances between points of two boxes."""
    low, high = tree.low, tree.high
    near = 0.0
    far = 0.0
    for k in range(low.shape[1]):
        least, most = _gap_bounds(low[a, k], high[a, k], low[b, k], high[b, k], tree.turns[k])
        near = near + least * least if euclidean else max(near, least)
        far = far + most * most if euclidean else max(far, most)
    return near, far


@kernel()
def point_bounds(
    tree: Boxes, a: int, i: int, node: int, euclidean: bool, widest: Array
) -> tuple[float, float]:
    """Return bounds of the distances of a point to a box; `widest` gets those by coordinate."""
    near = 0.0
    far = 0.0
    for k in range(widest.size):
        x = tree.points[a, k, i]
        least, most = _gap_bounds(x, x, tree.low[node, k], tree.high[node, k], tree.turns[k])
        widest[k] = most
        near = near + least * least if euclidean else max(near, least)
        far = far + most * most if euclidean else max(far, most)
    return near, far


@kernel()
def bin_of(distance: float, edges: Array) -> int:
    """Return the index of the first edge that the distance does not exceed."""
    begin = 0
    end = edges.size
    while begin < end:
        middle = (begin + end) // 2
        if distance > edges[middle]:
            begin = middle + 1
        else:
            end = middle
    return begin
