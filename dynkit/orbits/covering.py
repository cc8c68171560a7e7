"""Starts for periodic orbits of maps of several dimensions, from a covering by cells.

The edges of a graph lead from each cell to the cells that its image meets. Periodic orbits lie in
the strongly connected components of this graph. Of all cells that iterates reach from a box, those
in components are kept and halved in each direction, repeatedly. Newton's method for f^n(x) = x
starts from each of the remaining cells.

M. Dellnitz, A. Hohmann, Numerische Mathematik 75 (1997) 293-317 (covering by halved boxes);
G. Osipenko, Dynamical Systems, Graphs, and Algorithms, Springer 2007 (components of the graph).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any, final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dynkit.core.validation import Array
from dynkit.orbits.map_calls import MapCalls, Spent
from dynkit.orbits.map_problem import TURN, angles

# The first covering has 2^2 cells in each direction of the box.
_FIRST = 2
# Largest number of edges of the graph: more edges need too much memory, and exclude too few cells.
_PAIRS = 20_000_000
# Longest first step of Newton's method, in cells: a point of an orbit is at most half a cell from
# the centre of its cell, and the step is not exact.
_STEP = 1.5
# Largest number of Newton steps from a start, each at most half as long as the one before it. The
# iteration ends after a step below _CONVERGED, in cells.
_STEPS = 12
_CONVERGED = 1e-9


@final
class Covering:
    """Cells that contain all periodic orbits, of side ``width / 2^level`` in each direction.

    Parameters
    ----------
    calls : MapCalls
    box, limit : (d, 2) arrays
        Box that contains a state of each orbit, and limits of all their states.

    Raises
    ------
    Spent
        From here and all methods: when there are no calls left.
    """

    def __init__(self, calls: MapCalls, box: Array, limit: Array) -> None:
        self._calls = calls
        self._turning = angles(calls.system)
        self._low = box[:, 0].copy()
        self._width = box[:, 1] - box[:, 0]
        # the cells of an angle cover a turn, and the last is beside the first
        self._width[self._turning] = TURN
        self._limit = limit
        self.level = _FIRST
        self.cells = self._reached()

    @property
    def side(self) -> Array:
        """Sides of a cell, (d,)."""
        return np.asarray(self._width / 2**self.level)

    @property
    def centers(self) -> Array:
        """Centres of the cells, (c, d)."""
        return np.asarray(self._low + (self.cells + 0.5) * self.side)

    def halve(self) -> None:
        """Halve all cells in each direction, and keep those in components of the graph."""
        self.level += 1
        parts = np.array(list(product((0, 1), repeat=len(self._width))))
        self.cells = (2 * self.cells[:, None] + parts).reshape(-1, len(self._width))
        sources, targets = self._edges(*self._images(self.cells))
        self.cells = self.cells[_returning(len(self.cells), sources, targets)]

    @property
    def region(self) -> Array:
        """Least and greatest coordinates of the cells, (d, 2)."""
        ends = np.stack([self.cells.min(axis=0), self.cells.max(axis=0) + 1], axis=1)
        return np.asarray(self._low[:, None] + ends * self.side[:, None])

    def starts(self, period: int) -> Iterator[tuple[int, Array]]:
        """Yield n, from 1 to `period`, and solutions (d,) of f^n(x) = x by Newton's method.

        It starts from each cell where its first step ends in the cell or in a neighbour.
        """
        for center in self.centers:
            for n, step in enumerate(self._steps(center, period), start=1):
                x = self._solved(center, step, n)
                if x is not None:
                    yield n, x

    def _solved(self, x: Array, step: Array, n: int) -> Array | None:
        """Return the limit of Newton's method from a point and its first step; None without one."""
        longest = _STEP
        for _ in range(_STEPS):
            length = float(abs(step / self.side).max())
            if not length <= longest:
                return None
            x = x + step
            if length <= _CONVERGED:
                return x
            longest = max(0.5 * length, _CONVERGED)
            *_, step = self._steps(x, n)
        return None

    def _steps(self, x: Array, period: int) -> Iterator[Array]:
        """Yield Newton's steps for f^n(x) = x, n = 1 to `period`; NaN for singular derivatives."""
        state, slope, one = x, np.eye(len(x)), np.eye(len(x))
        for _ in range(period):
            with np.errstate(over="ignore", invalid="ignore"):
                slope = self._calls.derivative(state) @ slope
            state = self._calls.next(state)
            gap = self._calls.system.difference(state, x)
            try:
                with np.errstate(over="ignore", invalid="ignore"):
                    step = np.asarray(np.linalg.solve(one - slope, gap))
                yield step
            except np.linalg.LinAlgError:
                yield np.full(len(x), np.nan)

    # --- the graph of cells -----------------------------------------------------------------------

    def _reached(self) -> Any:
        """Return the cells of the first level that iterates of the box reach within the limit."""
        d = len(self._width)
        new = np.array(list(product(range(2**self.level), repeat=d)))
        known = {tuple(cell) for cell in new.tolist()}
        while len(new):
            low, high = self._images(new)
            spans = np.where(low <= high, high - low + 1, 0).prod(axis=1)
            hit: set[tuple[int, ...]] = set()
            for first, last in zip(low[spans > 0].tolist(), high[spans > 0].tolist(), strict=True):
                ranges = [range(a, b + 1) for a, b in zip(first, last, strict=True)]
                hit.update(product(*ranges))
            turned = {self._wrapped(cell) for cell in hit}
            new = np.array(sorted(turned - known), dtype=np.intp).reshape(-1, d)
            known |= turned
        return np.array(sorted(known), dtype=np.intp)

    def _wrapped(self, cell: tuple[int, ...]) -> tuple[int, ...]:
        count = 2**self.level
        return tuple(
            k % count if turns else k for k, turns in zip(cell, self._turning.tolist(), strict=True)
        )

    def _images(self, cells: Any) -> tuple[Any, Any]:
        """Return first and last cell, (c, d) each, of a box around the image of each cell.

        The box follows from the mean value theorem, with the largest derivatives at the centre and
        the corners. The last cell is before the first where no image lies within the limit.
        """
        calls, d = self._calls, cells.shape[1]
        corners = (cells[:, None] + np.array(list(product((0, 1), repeat=d)))).reshape(-1, d)
        places, which = np.unique(corners, axis=0, return_inverse=True)
        slopes = np.array([abs(calls.derivative(self._low + k * self.side)) for k in places])
        slopes = slopes[which.ravel()].reshape(len(cells), -1, d, d)
        middles = self._low + (cells + 0.5) * self.side
        inner = np.array([abs(calls.derivative(x)) for x in middles])[:, None]
        with np.errstate(invalid="ignore"):
            slope = np.fmax.reduce(np.concatenate([slopes, inner], axis=1), axis=1)
        images = np.array([calls.next(x) for x in middles])
        # shift angles to the turn around the centre of the cells
        center = self._low + 0.5 * self._width
        turned = center + calls.system.difference(images, np.broadcast_to(center, images.shape))
        images = np.where(self._turning, turned, images)
        reach = slope @ (0.5 * self.side)
        first, last = images - reach, images + reach
        known = np.isfinite(first).all(axis=1) & np.isfinite(last).all(axis=1)
        first[~known], last[~known] = 1.0, 0.0
        limit = np.where(self._turning[:, None], [-np.inf, np.inf], self._limit)
        first, last = np.maximum(first, limit[:, 0]), np.minimum(last, limit[:, 1])
        # a box that ends at the boundary of a cell does not meet the next cell
        low = np.floor((first - self._low) / self.side + 1e-9).astype(np.intp)
        high = np.ceil((last - self._low) / self.side - 1e-9).astype(np.intp) - 1
        high = np.maximum(high, np.where(first <= last, low, high))
        whole = self._turning & (high - low >= 2**self.level)
        low, high = np.where(whole, 0, low), np.where(whole, 2**self.level - 1, high)
        low[~known], high[~known] = 1, 0
        return low, high

    def _edges(self, low: Any, high: Any) -> tuple[Any, Any]:
        """Return the edges: numbers of the first and of the second cells."""
        counts = np.where((low <= high).all(axis=1)[:, None], high - low + 1, 0)
        total = counts.prod(axis=1)
        if total.sum() > _PAIRS:
            raise Spent
        source = np.repeat(np.arange(len(low)), total)
        number = np.arange(len(source)) - np.repeat(np.cumsum(total) - total, total)
        target = np.empty((len(source), low.shape[1]), dtype=np.intp)
        for k in range(low.shape[1]):
            number, rest = np.divmod(number, counts[source, k])
            target[:, k] = low[source, k] + rest
        target[:, self._turning] %= 2**self.level
        bottom = np.minimum(self.cells.min(axis=0), target.min(axis=0, initial=0))
        shape = np.maximum(self.cells.max(axis=0), target.max(axis=0, initial=0)) - bottom + 1
        keys = np.ravel_multi_index(tuple((self.cells - bottom).T), tuple(shape))
        wanted = np.ravel_multi_index(tuple((target - bottom).T), tuple(shape))
        order = np.argsort(keys)
        place = np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)
        held = keys[order[place]] == wanted
        return source[held], order[place[held]]


def _returning(count: int, sources: Any, targets: Any) -> Any:
    """Return whether each of `count` cells lies on a cycle of the graph, (count,) of bool."""
    graph = coo_array((np.ones(len(sources), dtype=bool), (sources, targets)), (count, count))
    _, component = connected_components(graph, connection="strong")
    large = np.bincount(component, minlength=count)[component] > 1
    large[sources[sources == targets]] = True
    return large
