"""Counts of distances between points by size, for two nodes of a tree at once where possible.

A node is a box that contains some of the points. Node v has the children 2v + 1 and 2v + 2. All
bounds are rigorous for computed distances, because rounding is monotone, and boxes and points use
the same operations in the same order. Distances are those of `distance`; Euclidean ones are
squared.
"""

from __future__ import annotations

from dynkit.analysis.dimension.box_kernels import (
    FEW_EDGES,
    SHIFT,
    Bins,
    Boxes,
    Buffers,
    Integers,
    bin_of,
    box_bounds,
    point_bounds,
)
from dynkit.core.jit import kernel
from dynkit.core.validation import Array

# indices of the counters in `Buffers.work`
_BOX_PAIRS, _DISTANCES = 0, 1


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
    for k in chosen:
        x = points[a, k, i]
        turn = turns[k]
        for j in range(slots):
            gap = abs(x - points[b, k, j])
            if turn > 0.0:
                gap = min(gap, turn - gap)
            if euclidean:
                out[j] += gap * gap
            else:
                out[j] = gap if gap > out[j] else out[j]


@kernel()
def _count_leaves(
    tree: Boxes, a: int, b: int, bins: Bins, own: Buffers, first: int, number: int
) -> int:
    """Count the pairs of points of two leaves, given as nodes; return the number of distances.

    The edges between the bounds of two different leaves are edges[first], and so on, `number` of
    them. Each distance is compared with all of them, for many points at once: distances need no
    bin. For -1 the bin of each distance is found.
    """
    euclidean, edges, shares, below = bins.euclidean, bins.edges, own.shares, own.below
    top = edges[edges.size - 2]
    first_cell = bins.first[bins.first.size - 1]
    last = first + number
    counts = last < edges.size - 1  # not beyond the largest radius
    node = b
    a -= tree.filled.size - 1
    b -= tree.filled.size - 1
    held = tree.filled[b]
    for e in range(number):
        for j in range(held):
            below[e, j] = 0
    measured = 0
    rows = 0
    for i in range(tree.filled[a]):
        block = tree.blocks[a, i]
        least = 0.0
        coordinates = tree.every
        if a != b:
            near, far = point_bounds(tree, a, i, node, euclidean, own.widest)
            if near > top:
                continue
            found = bin_of(near, edges)
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
        if number < 0:
            for j in range(begin, held):
                distance = own.row[j]
                if distance <= top:
                    cell = (own.row_bits[j] >> SHIFT) - first_cell
                    found = bins.first[cell if cell > 0 else 0]
                    while distance > edges[found]:
                        found += 1
                    shares[block, found] += 1
                    shares[tree.blocks[b, j], found] += 1
            continue
        rows += 1
        before = 0
        for e in range(number):
            edge = edges[first + e]
            count = 0
            for j in range(held):
                inside = 1 if own.row[j] <= edge else 0
                below[e, j] += inside
                count += inside
            shares[block, first + e] += count - before
            before = count
        if counts:
            shares[block, last] += held - before
    if number >= 0:
        for j in range(held):
            block = tree.blocks[b, j]
            before = 0
            for e in range(number):
                shares[block, first + e] += below[e, j] - before
                before = below[e, j]
            if counts:
                shares[block, last] += rows - before
    return int(measured)


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
    below: Integers,
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
    own = Buffers(row, row_bits, widest, chosen, below, stack, shares, lumps, work)
    top = edges[edges.size - 2]
    leaves = filled.size
    last = work[_BOX_PAIRS] + work[_DISTANCES] + pause
    while height > 0 and work[_BOX_PAIRS] + work[_DISTANCES] < last:
        height -= 1
        a = stack[height, 0]
        b = stack[height, 1]
        near, far = box_bounds(tree, a, b, euclidean)
        work[_BOX_PAIRS] += 1
        if near > top:
            continue
        found = bin_of(near, edges)
        if far <= edges[found]:
            if a == b:
                lumps[a, found] += sizes[a] - 1
            else:
                lumps[a, found] += sizes[b]
                lumps[b, found] += sizes[a]
        elif a >= leaves - 1 and b >= leaves - 1:
            inside = 0
            while inside <= FEW_EDGES and found + inside < edges.size - 1:
                if edges[found + inside] >= far:
                    break
                inside += 1
            if a == b or inside > FEW_EDGES:
                inside = -1
            work[_DISTANCES] += _count_leaves(tree, a, b, bins, own, found, inside)
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
                found = bin_of(apart, edges)
                shares[blocks[i], found] -= 1
                shares[blocks[j], found] -= 1


@kernel(entry=True)
def count_of_lag(
    points: Array, lag: int, turns: Array, euclidean: bool, edges: Array, counts: Integers
) -> None:
    """Count the pairs of rows that are one lag apart, by their distance: (k,), in place."""
    counts[:] = 0
    top = edges[edges.size - 1]
    for i in range(points.shape[0] - lag):
        total = 0.0
        for k in range(points.shape[1]):
            gap = abs(points[i, k] - points[i + lag, k])
            if turns[k] > 0.0:
                gap = min(gap, turns[k] - gap)
            total = total + gap * gap if euclidean else max(total, gap)
            if total > top:
                break
        if total <= top:
            counts[bin_of(total, edges)] += 1
