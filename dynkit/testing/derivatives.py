"""Derivatives by differences, with an estimate of their error."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from dynkit.core.validation import Array

VectorFunction: TypeAlias = Callable[[Array], Array]


def numerical_derivative(
    function: VectorFunction,
    point: Array,
    *,
    step: float = 1e-3,
    difference: Callable[[Array, Array], Array] = np.subtract,
    accuracy: float = 2.0**-52,
) -> tuple[Array, Array]:
    """Differentiate by central differences, extrapolated to step zero.

    Parameters
    ----------
    function : callable, (d,) array to (m,) array
    point : (d,) array
    step : float
        First step, relative to the point's largest coordinate; it is halved four times.
    difference : callable
        Difference of two values, for values that hold angles.
    accuracy : float
        How wrong the values are, relative to the largest: by one rounding, unless they are
        integrated.

    Returns
    -------
    derivative : (m, d) array
    error : (m, d) array
        Estimate of its error: how much the last extrapolation changed it, and the values' own.

    References
    ----------
    C. J. F. Ridders, Accurate computation of F'(x) and F'(x)F''(x), Advances in Engineering
    Software 4 (1982) 75-76.

    Examples
    --------
    >>> derivative, error = numerical_derivative(np.exp, np.array([1.0]))
    >>> bool(abs(derivative[0, 0] - np.e) < 10 * error[0, 0] < 1e-9)
    True
    """
    columns = []
    largest = float(np.abs(point).max(initial=0.0)) or 1.0
    for k in range(len(point)):
        best, error = np.empty(0), np.empty(0)
        previous: list[Array] = []
        for halving in range(5):
            ahead, behind = point.copy(), point.copy()
            ahead[k] += step * largest / 2.0**halving
            behind[k] -= step * largest / 2.0**halving
            width = ahead[k] - behind[k]
            values = function(ahead), function(behind)
            row = [np.asarray(difference(*values)) / width]
            own = accuracy * np.abs(values).max(initial=0.0) / width
            for order, coarse in enumerate(previous, start=1):
                row.append(row[-1] + (row[-1] - coarse) / (4.0**order - 1.0))
                change = np.maximum(abs(row[-1] - row[-2]), abs(row[-1] - coarse)) + own
                if not best.size:
                    best, error = row[-1], change
                better = change < error
                best, error = np.where(better, row[-1], best), np.where(better, change, error)
            previous = row
        columns.append((best, error))
    return (
        np.stack([column for column, _ in columns], axis=1),
        np.stack([error for _, error in columns], axis=1),
    )
