"""Counts of pairs of points by their distances, on all processors.

The pairs of nodes on one level of the tree are the parts of the work; each thread has separate
buffers. The parts do not depend on the number of threads, and sums of integers do not depend on
their order, so the counts depend on neither.
"""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import combinations_with_replacement, pairwise
from threading import Event
from typing import TYPE_CHECKING, Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array

if TYPE_CHECKING:
    from dynkit.analysis.dimension.box_kernels import Boxes, Buffers


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


Counts: TypeAlias = NDArray[np.int64]

_Part: TypeAlias = tuple[int, int]

BLOCKS = 64
"""Largest number of blocks of time to which pairs are attributed."""

_LEVEL = 5  # level of the tree: its 528 pairs of nodes are the parts
_PAIRS_OF_A_CALL = 1 << 22  # about ten milliseconds: interrupts are handled between calls
_MOST_THREADS = 16  # each thread has counts for all nodes


@final
@dataclass(frozen=True, eq=False)
class Counted:
    """Numbers of pairs by distance, and the work of counting.

    Parameters
    ----------
    shares : (blocks, k + 1) array
        For each block of time and each bin, the number of pairs with a point in the block; pairs
        with both points in it count twice.
    box_pairs, distances : int
        Numbers of examined pairs of boxes, and of computed distances.
    """

    shares: Counts
    box_pairs: int
    distances: int


def count(
    points: Array,
    turns: Array,
    edges: Array,
    window: int,
    *,
    euclidean: bool,
    threads: int | None = None,
) -> Counted:
    """Count the pairs of points that are more than a window apart in time, by their distances.

    Parameters
    ----------
    points : (n, d) array
        Points in the order of time; angles in [0, turn].
    turns : (d,) array
        One turn of each coordinate that is an angle; zero for others.
    edges : (k + 1,) array
        Ascending, squared in the Euclidean norm; a distance counts in the first bin whose edge it
        does not exceed. The last edge is infinite, and the count of its bin is incomplete.
    window : int
    euclidean : bool
        Whether the norm is Euclidean or the maximum norm.
    threads : int, optional
        By default one for each processor, at most 16. The result does not depend on it.
    """
    from dynkit.analysis.dimension.box_kernels import Bins
    from dynkit.analysis.dimension.correlation_kernels import count_pairs, uncount_near_in_time

    n, d = points.shape
    blocks = np.arange(n) * min(BLOCKS, n) // n
    number = int(blocks[-1]) + 1
    # the maximum norm does not depend on the order: coordinates with large extents first
    order = np.arange(d) if euclidean else np.argsort(-np.ptp(points, axis=0))
    tree = boxes_of(np.ascontiguousarray(points[:, order]), turns[order], blocks)
    bins = Bins(euclidean, edges, _first_bins(edges))

    def count_part(nodes: _Part, own: Buffers) -> Iterator[None]:
        arrays: tuple[Any, ...] = (*tree, *bins, *own)
        own.stack[0] = nodes
        height = 1
        while height > 0:
            height = count_pairs(height, _PAIRS_OF_A_CALL, *arrays)
            yield

    def uncount_part(rows: _Part, own: Buffers) -> Iterator[None]:
        size = max(_PAIRS_OF_A_CALL // max(window, 1), 1)
        for begin in range(*rows, size):
            end = min(begin + size, rows[1])
            uncount_near_in_time(
                begin, end, points, window, blocks, turns, euclidean, edges, own.shares
            )
            yield

    threads = threads or min(_processors(), _MOST_THREADS)
    buffers = [_buffers(tree, number, len(edges)) for _ in range(threads)]
    _share_out(count_part, _node_pairs(len(tree.filled)), buffers)
    _share_out(uncount_part, pairwise(n * k // number for k in range(number + 1)), buffers)
    total = buffers[0]
    for other in buffers[1:]:
        total.shares[:] += other.shares
        total.lumps[:] += other.lumps
        total.work[:] += other.work
    _share_lumps(tree, total)
    near = n * window - window * (window + 1) // 2
    return Counted(total.shares, int(total.work[0]), int(total.work[1]) + near)


def _processors() -> int:
    """Return the number of processors that this process may use."""
    if sys.platform != "linux":
        return os.cpu_count() or 1
    return len(os.sched_getaffinity(0))


def _node_pairs(leaves: int) -> Iterator[_Part]:
    """Return all pairs of nodes on one level of a tree, which contain all pairs of points."""
    nodes = min(2**_LEVEL, leaves)
    return combinations_with_replacement(range(nodes - 1, 2 * nodes - 1), 2)


def _share_out(
    task: Callable[[_Part, Buffers], Iterator[None]],
    parts: Iterable[_Part],
    buffers: Sequence[Buffers],
) -> None:
    """Run a task for all its parts, with one thread for each of the buffers.

    An interrupt ends each thread at its next step.
    """
    left, ended = deque(parts), Event()

    def work(own: Buffers) -> None:
        while True:
            try:
                part = left.popleft()
            except IndexError:
                return
            for _ in task(part, own):
                if ended.is_set():
                    return

    with ThreadPoolExecutor(len(buffers)) as pool:
        try:
            for _ in pool.map(work, buffers):  # raises exceptions of the threads
                pass
        finally:
            left.clear()  # threads take no further parts
            ended.set()


def _share_lumps(tree: Boxes, total: Buffers) -> None:
    """Add the counts of whole nodes to the shares; both are modified in place."""
    lumps, leaves = total.lumps, len(tree.filled)
    for v in range(leaves - 1):  # counts of a node are counts of its children
        lumps[2 * v + 1 : 2 * v + 3] += lumps[v]
    for blocks, points, lump in zip(tree.blocks, tree.filled, lumps[-leaves:], strict=True):
        held = np.bincount(blocks[:points], minlength=len(total.shares))
        there = np.flatnonzero(held)
        total.shares[there] += held[there, None] * lump


def _buffers(tree: Boxes, blocks: int, bins: int) -> Buffers:
    """Return buffers with zero counts."""
    from dynkit.analysis.dimension.box_kernels import FEW_EDGES, Buffers

    leaves, d, slots = tree.points.shape
    row = np.zeros(slots)
    sizes = (
        d,
        (FEW_EDGES, slots),
        (6 * leaves.bit_length() + 8, 2),
        (blocks, bins),
        (len(tree.sizes), bins),
        2,
    )
    counts = (np.zeros(size, dtype=np.int64) for size in sizes)
    return Buffers(row, row.view(np.int64), np.zeros(d), *counts)


def _first_bins(edges: Array) -> Counts:
    """Return the first bin of each cell of leading bits, and last the number of the first cell."""
    from dynkit.analysis.dimension.box_kernels import SHIFT

    ends = np.ascontiguousarray(edges[[0, -2]]).view(np.int64) >> SHIFT
    cells = np.arange(ends[0], ends[1] + 1) << SHIFT
    bins = np.searchsorted(edges, cells.view(np.float64))
    bins[0] = 0
    return np.append(bins, ends[0]).astype(np.int64)
