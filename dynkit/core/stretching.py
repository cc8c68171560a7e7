"""Stretching of a frame of directions along a motion, for Lyapunov exponents."""

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from dynkit.core.validation import Array

CLEAR = 1e3
"""A direction shorter than this many times its error has no logarithm (NaN): the logarithm would be
less accurate than 1e-3."""


@final
@dataclass(frozen=True, eq=False)
class Stretching:
    """Growth of a frame of d directions, made orthonormal again after each iterate or interval.

    Attributes
    ----------
    logs : (n, d) array
        Logarithms of the diagonal of R in the QR decomposition after each step. Minus infinity
        where the length is zero; NaN where the length is at most `CLEAR` times its error.
    errors : (n, d) array
        Estimates of the errors of the logarithms, to first order.
    times : (n,) array or None
        Duration of each step; None for a map without a time.
    state : (d,) array
        The state after the last step.
    frame : (d, k) array
        The frame after the last step, in the coordinates of the system that made it.
    final : start
        The start from which the motion, with this frame, continues: by default the state.
    """

    logs: Array
    errors: Array
    times: Array | None
    state: Array
    frame: Array
    final: Any = None

    def __post_init__(self) -> None:
        if self.final is None:
            object.__setattr__(self, "final", self.state)


def product_with_error(factors: Array, errors: Array) -> tuple[Array, float]:
    """Return the product A_n ... A_1 of factors (n, d, d), and a bound of the error of an entry.

    `errors` (n,) bound the errors of the entries of each factor. The bound is of first order in
    them and leaves out rounding.
    """
    product, error = factors[0], np.full(factors[0].shape, errors[0])
    for factor, off in zip(factors[1:], errors[1:], strict=True):
        # bound each entry: with norms of factors the units of different coordinates would mix
        error = abs(factor) @ error + off * abs(product).sum(axis=0)
        product = factor @ product
    return product, float(error.max())
