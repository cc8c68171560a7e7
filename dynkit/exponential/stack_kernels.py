"""Any number of exponential sums in padded arrays, for kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import Ladder

Indices = NDArray[np.intp]

GROUP, CELLS, SMOOTH, APART, GROWS, STEADY = range(6)
"""Columns of `Ladders.integers`."""

OFFSET, WINDOW, SWING = range(3)
"""Columns of `Ladders.numbers`."""


class Ladders(NamedTuple):
    """Sums in groups; those of a group have the same state. See `Ladder` for the fields.

    Attributes
    ----------
    step, generator, links, link_step, smallest : for each group, padded with zeros
    sizes : (groups, 2) numbers of rungs and of links
    cell, rows : for each sum, padded with zeros
    integers : (sums, 6) group, rungs of the cells, smooth, apart, grows, steady
    numbers : (sums, 3) offset, window, swing
    """

    step: Array
    generator: Array
    links: Indices
    link_step: Array
    smallest: Array
    sizes: Indices
    cell: Array
    rows: Array
    integers: Indices
    numbers: Array


@kernel(inline=True)
def ladder_at(ladders: Ladders, k: int) -> Ladder:
    """Return sum number `k` as views, without copying."""
    g = ladders.integers[k, GROUP]
    rungs = ladders.sizes[g, 0]
    return Ladder(
        ladders.step[g, :rungs],
        ladders.cell[k, : ladders.integers[k, CELLS]],
        ladders.rows[k],
        ladders.generator[g],
        ladders.links[g, : ladders.sizes[g, 1]],
        ladders.link_step[g, : rungs + 2],
        ladders.numbers[k, OFFSET],
        ladders.smallest[g],
        ladders.integers[k, SMOOTH],
        ladders.integers[k, APART] != 0,
        ladders.integers[k, GROWS] != 0,
        ladders.numbers[k, WINDOW],
        ladders.integers[k, STEADY],
        ladders.numbers[k, SWING],
    )
