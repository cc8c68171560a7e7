"""How a frame of directions is stretched along a motion: what Lyapunov exponents are made of."""

from dataclasses import dataclass
from typing import final

import numpy as np

from dynkit.core.validation import Array

CLEAR = 1e3
"""A direction shorter than this many of its errors is hidden: its log is not right to 1e-3."""


@final
@dataclass(frozen=True, eq=False)
class Stretching:
    """How iterates, or times, stretch a frame of d directions that is made orthonormal after each.

    Attributes
    ----------
    logs : (n, d) array
        Logarithms of the diagonal of R in the QR decomposition after each step. Minus infinity
        where a direction is lost for good; NaN where its error hides it.
    errors : (n, d) array
        Estimates of the errors of the logarithms, to first order.
    times : (n,) array or None
        How long each step took; None for a map without a time.
    state : (d,) array
        The state after the last step.
    """

    logs: Array
    errors: Array
    times: Array | None
    state: Array


def stretched(factors: Array, errors: Array, frame: Array) -> tuple[Array, Array, Array]:
    """Return the frame (d, k) that factors (n, d, d) carry on, logs (k,) of lengths, their errors.

    The frame's columns are orthonormal, and are made so again after each factor. A length is that
    of a direction's part beside the directions before it: its log is minus infinity where the
    length is zero, NaN where the length is less than a thousand errors of the factor's entries.
    """
    logs, off = np.zeros((2, frame.shape[1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        for factor, error in zip(factors, errors, strict=True):
            frame, triangle = np.linalg.qr(factor @ frame)
            lengths = abs(triangle.diagonal())
            hidden = (lengths > 0.0) & (lengths <= CLEAR * error)
            logs += np.where(hidden, np.nan, np.log(lengths))
            off += error / lengths
    # a direction that is lost for good has no error
    off[np.isneginf(logs)] = 0.0
    return frame, logs, off


def product_with_error(factors: Array, errors: Array) -> tuple[Array, float]:
    """Return a product A_n ... A_1 of factors (n, d, d), and a bound of the error of an entry.

    The entries of each factor are wrong by its error, (n,), at most; rounding is left out, and
    so are products of errors.
    """
    product, error = factors[0], float(errors[0])
    for factor, off in zip(factors[1:], errors[1:], strict=True):
        grown = error * np.linalg.norm(factor, np.inf)
        error = float(grown + off * np.linalg.norm(product, 1))
        product = factor @ product
    return product, error
