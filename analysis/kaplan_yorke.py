"""Kaplan and Yorke's dimension from Lyapunov exponents."""

from __future__ import annotations

import numpy as np

from dynkit.core.validation import Array


def kaplan_yorke(exponents: Array) -> float:
    """Return Kaplan and Yorke's dimension for exponents (d,) in descending order.

    It is j + (lambda_1 + ... + lambda_j) / |lambda_{j+1}| for the largest j whose sum is not
    negative; d where no sum is negative, and NaN where it depends on an exponent that is NaN.

    Examples
    --------
    >>> kaplan_yorke(np.array([0.5, 0.0, -2.0]))
    2.25
    >>> kaplan_yorke(np.array([-0.1, -np.inf])), kaplan_yorke(np.array([0.1, -np.inf]))
    (0.0, 1.0)
    """
    total = 0.0
    exponent: float
    for j, exponent in enumerate(exponents.tolist()):
        if np.isnan(exponent):
            return np.nan
        if total + exponent < 0.0:
            return j - total / exponent
        total += exponent
    return float(len(exponents))
