"""Sums over batches of a long motion, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.analysis.regimes import RegimeChange, regime_change
from dynkit.core.validation import Array

Edges = NDArray[np.intp]
"""Numbers (b + 1,) of the values at which batches begin, and last the number of all values."""


@final
class Batches:
    """Sums over successive batches of equal numbers of values; the last batch may hold fewer.

    The number of values in a batch is the least power of two for which there are at most `most`
    batches: pairs of neighbours are merged when there would be more. So the batches depend on the
    number of values, and not on the blocks in which the values came.

    Attributes
    ----------
    most, length, count : int
        Largest number of batches, values in a batch, and values in all batches.
    sums : (b, k) array
    """

    _stored: ClassVar = ("most", "length", "count", "sums")
    most: int
    length: int
    count: int
    sums: Array

    def __init__(self, most: int) -> None:
        self.most, self.length, self.count = most, 1, 0
        self.sums = np.zeros((0, 0))

    def add(self, count: int, sums_over: Callable[[Edges], Array]) -> None:
        """Add values: ``sums_over(edges)`` returns sums (b, k) over parts of them."""
        while self.count + count > self.most * self.length:
            self.length *= 2
            if len(self.sums):
                self.sums = np.add.reduceat(self.sums, np.arange(0, len(self.sums), 2))
        begun = self.count % self.length
        edges = np.append(np.arange(-begun, count, self.length), count)
        edges[0] = 0
        new = sums_over(edges)
        if begun:
            new[0] += self.sums[-1]
        before = self.sums[: len(self.sums) - bool(begun)]
        self.sums = np.concatenate([before, new]) if len(before) else new
        self.count += count

    def add_rows(self, rows: Array) -> None:
        """Add the rows (n, k) of an array, each as one value."""
        if len(rows):
            self.add(len(rows), lambda edges: np.add.reduceat(rows, edges[:-1]))

    @property
    def means(self) -> Array:
        """Means (b, k) over the batches that are complete."""
        return np.asarray(self.sums[: self.count // self.length] / self.length)

    @property
    def change(self) -> RegimeChange | None:
        """The change of regime of the means of complete batches, which counts values."""
        return in_values(regime_change(self.means), self.length)


def in_values(change: RegimeChange | None, length: int) -> RegimeChange | None:
    """Return a change of regime of means over batches of this length, counted in values."""
    if change is None:
        return None
    return RegimeChange(length * change.at, length * change.states, periodic=change.periodic)
