"""Products of the matrices of impacts of one mode, and how well they are conditioned."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.systems.impact.variational.tangent_kernels import fly, jump


@kernel()
def _set_unit(frame: Array) -> None:
    for i in range(frame.shape[0]):
        for j in range(frame.shape[0]):
            frame[i, j] = 1.0 if i == j else 0.0


@kernel(reorder=True)
def _square(frame: Array) -> float:
    """Sum of the squares of all entries."""
    total = 0.0
    for i in range(frame.shape[0]):
        for j in range(frame.shape[0]):
            total += frame[i, j] ** 2
    return total


@kernel()
def _fill_back(flight: Array, back: Array) -> None:
    """Fill the inverses, (1, 4, N), of the blocks of a flight."""
    for i in range(flight.shape[2]):
        a, b, c, d = flight[0, 0, i], flight[0, 1, i], flight[0, 2, i], flight[0, 3, i]
        determinant = a * d - b * c
        back[0, 0, i], back[0, 1, i] = d / determinant, -b / determinant
        back[0, 2, i], back[0, 3, i] = -c / determinant, a / determinant


@kernel(entry=True)
def multiply(
    blocks: Array,
    vectors: Array,
    turns: Array,
    sides: NDArray[np.intp],
    numbers: Array,
    back: Array,
    factor: Array,
    product: Array,
) -> float:
    """Multiply flights and the impacts after them; `back`, `factor`, `product` change in place.

    Parameters
    ----------
    blocks, back
        (n, 4, N), (1, 4, N) entries 11, 12, 21, 22 of the flights' matrices; a buffer
    vectors, turns
        (e, 4, 2N), (e,) as in `Windows`
    sides, numbers
        (n,), (n, 2): stops of the impacts, and `saltation`
    factor, product
        (2N, 2N): a buffer, and the product, transposed

    Returns
    -------
    float
        Product of the condition numbers, in Frobenius' norm, of all matrices but the worst: so many
        times larger than rounding of one matrix is what forming the product does. One for a
        single matrix, which needs no product, and infinite where one is singular.
    """
    count = blocks.shape[0]
    _set_unit(product)
    worst, whole = 1.0, 1.0
    for k in range(count):
        bend, kick = numbers[k]
        own, flight = vectors[sides[k]], blocks[k : k + 1]
        fly(flight, 0, product)
        jump(own, bend, kick, kick, product)
        if count > 1:
            _set_unit(factor)
            fly(flight, 0, factor)
            jump(own, bend, kick, kick, factor)
            square = _square(factor)
            # an impact is undone by another one, as c b = 0, c' b = c A b = 1, c' A b = turn
            left = 1.0 + kick
            undone = -kick / left
            twisted = (kick * (bend + kick * turns[sides[k]]) / left - bend) / left
            _set_unit(factor)
            jump(own, twisted, undone, undone, factor)
            _fill_back(flight, back)
            fly(back, 0, factor)
            condition = math.sqrt(square * _square(factor))
            if not condition < math.inf:
                return math.inf
            worst, whole = max(worst, condition), whole * condition
    return whole / worst
