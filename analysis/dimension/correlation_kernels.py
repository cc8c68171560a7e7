"""Counts of distances between points by size, for two nodes of a tree at once where possible.

A node is a box that contains some of the points. Node v has the children 2v + 1 and 2v + 2. All
bounds are rigorous for computed distances, because rounding is monotone, and boxes and points use
the same operations in the same order. Distances are those of `distance`; Euclidean ones are
squared.
"""

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

# indices of the counters in `Buffers.work`
_BOX_PAIRS, _DISTANCES = 0, 1


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
    stack : (any, 2)
        Pairs of nodes that remain to be done; capacity for more than six for each level of the
        tree.
    shares : (blocks, k + 1)
        Counts by blocks: each computed distance counts in the blocks of both points, and a whole
        box at once for a single point.
    lumps : (nodes, k + 1)
        Number of points, besides those in `shares`, at such distances from every point of a node.
    work : (2,)
        Numbers of examined pairs of boxes, and of computed distances.
    """

    row: Array
    row_bits: Integers
    widest: Array
    chosen: Integers
    stack: Integers
    shares: Integers
    lumps: Integers
    work: Integers


@kernel(inline=True)
def _gap_bounds(
    low: float, high: float, other_low: float, other_high: float, turn: float
) -> tuple[float, float]:
    """Return bounds of the distances between two intervals; of angles where turn is not zero."""
    least = max(low - other_high, other_low - high, 0.0)
    most = max(high - other_low, other_high - low)
    if turn > 0.0:
        wrapped = min(least, turn - most)
        most = min(most, turn - least)
        least = wrapped
    return least, most


@kernel()
def _box_bounds(tree: Boxes, a: int, b: int, euclidean: bool) -> tuple[float, float]:
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
def _point_bounds(
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
def _deciding(near: float, widest: Array, chosen: Integers) -> int:
    """Write coordinates whose distances may exceed `near` into `chosen`; return their number."""
    count = 0
    for k in range(widest.size):
        if widest[k] > near:
            chosen[count] = k
            count += 1
    return count


@kernel()
def _bin_of(distance: float, edges: Array) -> int:
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


@kernel()
def _distances(
    tree: Boxes, a: int, i: int, b: int, euclidean: bool, least: float, chosen: Integers, out: Array
) -> None:
    """Compute distances of a point to all slots of a leaf; `out` is modified in place.

    Only the chosen coordinates are used; `least` is a lower bound of all distances in the maximum
    norm.
    """
    points, turns = tree.points, tree.turns
    slots = points.shape[2]
    for j in range(slots):
        out[j] = least
    n = 0
    while n < chosen.size:
        k = chosen[n]
        x = points[a, k, i]
        turn = turns[k]
        if turn > 0.0:
            for j in range(slots):
                gap = abs(x - points[b, k, j])
                gap = min(gap, turn - gap)
                if euclidean:
                    out[j] += gap * gap
                else:
                    out[j] = gap if gap > out[j] else out[j]
            n += 1
        elif n + 4 <= chosen.size and (
            turns[chosen[n + 1]] + turns[chosen[n + 2]] + turns[chosen[n + 3]] == 0.0
        ):
            # four coordinates at once: fewer visits to `out`; the sum keeps its order
            g, h, m = chosen[n + 1], chosen[n + 2], chosen[n + 3]
            y, z, w = points[a, g, i], points[a, h, i], points[a, m, i]
            if euclidean:
                for j in range(slots):
                    p = x - points[b, k, j]
                    q = y - points[b, g, j]
                    r = z - points[b, h, j]
                    s = w - points[b, m, j]
                    out[j] = (((out[j] + p * p) + q * q) + r * r) + s * s
            else:
                for j in range(slots):
                    p = abs(x - points[b, k, j])
                    q = abs(y - points[b, g, j])
                    r = abs(z - points[b, h, j])
                    s = abs(w - points[b, m, j])
                    p = p if p > q else q
                    r = r if r > s else s
                    p = p if p > r else r
                    out[j] = p if p > out[j] else out[j]
            n += 4
        else:
            for j in range(slots):
                gap = abs(x - points[b, k, j])
                if euclidean:
                    out[j] += gap * gap
                else:
                    out[j] = gap if gap > out[j] else out[j]
            n += 1


@kernel()
def _count_leaves(tree: Boxes, a: int, b: int, bins: Bins, own: Buffers) -> int:
    """Count the pairs of points of two leaves, given as nodes; return the number of distances."""
    euclidean, edges, first_bins, shares = bins.euclidean, bins.edges, bins.first, own.shares
    top = edges[edges.size - 2]
    first = first_bins[first_bins.size - 1]
    node = b
    a -= tree.filled.size - 1
    b -= tree.filled.size - 1
    held = tree.filled[b]
    measured = 0
    for i in range(tree.filled[a]):
        block = tree.blocks[a, i]
        least = 0.0
        coordinates = tree.every
        if a != b:
            near, far = _point_bounds(tree, a, i, node, euclidean, own.widest)
            if near > top:
                continue
            found = _bin_of(near, edges)
            if far <= edges[found]:
                shares[block, found] += held
                own.lumps[node, found] += 1
                continue
            if not euclidean:
                least = near
                coordinates = own.chosen[: _deciding(near, own.widest, own.chosen)]
        begin = i + 1 if a == b else 0
        measured += held - begin
        _distances(tree, a, i, b, euclidean, least, coordinates, own.row)
        for j in range(begin, held):
            distance = own.row[j]
            if distance <= top:
                cell = (own.row_bits[j] >> SHIFT) - first
                found = first_bins[cell if cell > 0 else 0]
                while distance > edges[found]:
                    found += 1
                shares[block, found] += 1
                shares[tree.blocks[b, j], found] += 1
    return measured


@kernel(entry=True, nogil=True)
def count_pairs(
    height: int,
    pause: int,
    low: Array,
    high: Array,
    sizes: Integers,
    points: Array,
    filled: Integers,
    blocks: Integers,
    turns: Array,
    every: Integers,
    euclidean: bool,
    edges: Array,
    first: Integers,
    row: Array,
    row_bits: Integers,
    widest: Array,
    chosen: Integers,
    stack: Integers,
    shares: Integers,
    lumps: Integers,
    work: Integers,
) -> int:
    """Count the pairs of points of pairs of nodes by their distances.

    Parameters
    ----------
    height
        Number of pairs of nodes on the stack: a node with itself, or two nodes without a common
        point.
    pause
        Number of pairs of boxes and distances after which the call returns, to bound its time.
    low, ...
        The fields of `Boxes`, `Bins` and `Buffers`, because Numba takes twice as long for tuples.

    Returns
    -------
    height : number of pairs that remain on the stack; 0 when all are done
    """
    tree = Boxes(low, high, sizes, points, filled, blocks, turns, every)
    bins = Bins(euclidean, edges, first)
    own = Buffers(row, row_bits, widest, chosen, stack, shares, lumps, work)
    top = edges[edges.size - 2]
    leaves = filled.size
    last = work[_BOX_PAIRS] + work[_DISTANCES] + pause
    while height > 0 and work[_BOX_PAIRS] + work[_DISTANCES] < last:
        height -= 1
        a = stack[height, 0]
        b = stack[height, 1]
        near, far = _box_bounds(tree, a, b, euclidean)
        work[_BOX_PAIRS] += 1
        if near > top:
            continue
        found = _bin_of(near, edges)
        if far <= edges[found]:
            if a == b:
                lumps[a, found] += sizes[a] - 1
            else:
                lumps[a, found] += sizes[b]
                lumps[b, found] += sizes[a]
        elif a >= leaves - 1 and b >= leaves - 1:
            work[_DISTANCES] += _count_leaves(tree, a, b, bins, own)
        elif a == b:
            for i in range(3):
                stack[height + i, 0] = 2 * a + 1 + i // 2
                stack[height + i, 1] = 2 * a + 1 + (i + 1) // 2
            height += 3
        else:
            split_first = b >= leaves - 1 or (a < leaves - 1 and sizes[a] >= sizes[b])
            for i in range(2):
                stack[height + i, 0] = 2 * a + 1 + i if split_first else a
                stack[height + i, 1] = b if split_first else 2 * b + 1 + i
            height += 2
    return height


@kernel()
def distance(points: Array, i: int, j: int, turns: Array, euclidean: bool) -> float:
    """Return the distance of two rows of points, (n, d); its square in the Euclidean norm."""
    total = 0.0
    for k in range(points.shape[1]):
        gap = abs(points[i, k] - points[j, k])
        if turns[k] > 0.0:
            gap = min(gap, turns[k] - gap)
        total = total + gap * gap if euclidean else max(total, gap)
    return total


@kernel(entry=True, nogil=True)
def uncount_near_in_time(
    begin: int,
    end: int,
    points: Array,
    window: int,
    blocks: Integers,
    turns: Array,
    euclidean: bool,
    edges: Array,
    shares: Integers,
) -> None:
    """Subtract the pairs of rows at most a window apart from the shares, (blocks, k + 1), in place.

    These are the pairs whose earlier row is in [begin, end).
    """
    top = edges[edges.size - 2]
    for i in range(begin, end):
        for j in range(i + 1, min(i + window + 1, points.shape[0])):
            apart = distance(points, i, j, turns, euclidean)
            if apart <= top:
                found = _bin_of(apart, edges)
                shares[blocks[i], found] -= 1
                shares[blocks[j], found] -= 1
