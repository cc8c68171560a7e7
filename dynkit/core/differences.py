"""Derivatives by differences, where nothing exact is known."""

from collections.abc import Callable, Iterable
from functools import cache

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array

# First step, relative; at eighth order it balances truncation and the accuracy of the values.
_ORDER = 8
# Each step is half of the one before. Where so many give no better estimate it is rounding by now,
# if the derivative is clear of its error. Nothing better is asked for than the last, relative.
_HALVINGS, _PATIENCE, _CLEAR, _ENOUGH = 40, 3, 1e-6, 1e-11


def parameter_difference(
    function: Callable[[float], Array],
    value: float,
    *,
    accuracy: float = 2.0**-52,
    difference: Callable[[Array, Array], Array] = np.subtract,
) -> Array:
    """Differentiate by one number: differences at ever smaller steps, extrapolated to step zero.

    The differences are central, or one-sided where the function is refused on the other side. Of
    all steps and orders that one is taken whose estimated error is least: the extrapolation's last
    change, that of the mean of the values at both ends, and the accuracy of the values. Steps on
    which the function is refused do not count, and neither do those so large that its values, or
    their mean, do not go with the smaller ones.

    Parameters
    ----------
    function : callable, float to (m,) array
        `NoMotion`, such as `NoCrossing` or `Refused`, is a refusal.
    value : float
        Where to differentiate.
    accuracy : float
        How wrong values are, relative to the largest.
    difference : callable
        Difference of two values, for values that hold angles.

    Returns
    -------
    (m,) array
        Right to 1e-11 or about ``accuracy**(8 / 9)``, relative, for functions that vary over
        ``max(|value|, 1)``: 1e-9 for an accuracy of 1e-11.

    Raises
    ------
    NoMotion
        What refuses the function at the value itself.
    ValueError
        When the function is refused on both sides however near.

    References
    ----------
    C. J. F. Ridders, Accurate computation of F'(x) and F'(x)F''(x), Advances in Engineering
    Software 4 (1982) 75-76.

    Examples
    --------
    >>> parameter_difference(lambda x: np.array([np.exp(x)]), 1.0) - np.e < 1e-11
    array([ True])
    """
    center = function(value)
    size = float(np.abs(center).max(initial=0.0))
    refused = np.full(center.shape, np.nan)

    @cache
    def change(step: float) -> tuple[Array, float]:
        there = value + step
        try:
            return np.asarray(difference(function(there), center)), there - value
        except NoMotion:
            return refused, there - value

    def central(step: float) -> tuple[Array, Array, float]:
        (ahead, forward), (behind, backward) = change(step), change(-step)
        return (ahead - behind) / (forward - backward), 0.5 * (ahead + behind), forward - backward

    def ahead(step: float) -> tuple[Array, Array, float]:
        found, forward = change(step)
        return found / forward, 0.0 * found, forward

    def behind(step: float) -> tuple[Array, Array, float]:
        found, backward = change(-step)
        return found / backward, 0.0 * found, -backward

    first = max(abs(value), 1.0) * accuracy ** (1.0 / (_ORDER + 1))
    steps = [first / 2.0**k for k in range(_HALVINGS)]
    kinds = [(central, 4.0)]
    if np.isnan(change(steps[0])[0] + change(-steps[0])[0]).any():
        # near an end of the range central differences are short of room
        kinds = [(ahead, 2.0), (behind, 2.0), (central, 4.0)]
    best, error = refused, np.full(center.shape, np.inf)
    for kind, power in kinds:
        found, its_error = _extrapolated(map(kind, steps), power, accuracy * size)
        if not its_error.max(initial=0.0) >= error.max(initial=0.0):
            best, error = found, its_error
        if error.max(initial=0.0) <= _ENOUGH * abs(best).max(initial=0.0):
            break
    if not np.isfinite(error).all():
        raise ValueError(f"values must exist on one side of {value!r} at least; there are none")
    return best


def _extrapolated(
    quotients: Iterable[tuple[Array, Array, float]], power: float, noise: float
) -> tuple[Array, Array]:
    """Ridders's tableau; `noise` is the error of a value. Returns the best and its error."""
    rows: list[Array] = []
    waited = 0
    for slope, mean, width in quotients:
        row = [np.stack([slope, mean])]
        if not rows:
            best, error = slope, np.full(slope.shape, np.inf)
        better = np.zeros(slope.shape, dtype=bool)
        for order, coarse in enumerate(rows, start=1):
            row.append(row[-1] + (row[-1] - coarse) / (power**order - 1.0))
            moved = np.maximum(abs(row[-1] - row[-2])[0], abs(row[-1] - coarse)[0])
            change = moved + (abs(row[-1][1]) + noise) / width
            nearer = change < error
            best, error = np.where(nearer, row[-1][0], best), np.where(nearer, change, error)
            better |= nearer
        rows = row
        largest, worst = float(abs(best).max(initial=0.0)), float(error.max(initial=0.0))
        waited = 0 if better.any() or not worst <= _CLEAR * largest else waited + 1
        if waited == _PATIENCE or worst <= _ENOUGH * largest:
            break
    return best, error
