"""Derivatives by differences, where nothing exact is known."""

from collections.abc import Callable, Iterable
from functools import cache

import numpy as np

from dynkit.core.no_motion import NoMotion, Refused
from dynkit.core.validation import Array

# First step, relative; at eighth order it balances truncation and the accuracy of the values.
_ORDER = 8
# Each step is half of the one before. Where so many give no better estimate it is rounding by now,
# if the derivative is clear of its error. Nothing better is asked for than the last, relative.
_HALVINGS, _PATIENCE, _CLEAR, _ENOUGH = 40, 3, 1e-6, 1e-11
# Of a state the coordinates that are small beside others count as a tenth: as orbits do.
_TENTH = 0.1
# At a corner whose slopes differ by 1 the mean of both values is step / 4 in units of the width, of
# which the extrapolation leaves (2/3)(14/15)(62/63)... = 0.61: 0.15 for a slope off by 0.5.
_MARGIN = 4.0
# Errors of smooth functions fall by many digits. Where this part of the slope is left, none did.
_UNSETTLED = 0.25
# A slope of zero is settled when nothing is left but errors of values, over the fifth of all steps.
_BLUR = _MARGIN * 16.0


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
    Refused
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
    scale = max(abs(value), 1.0)
    return _derivative(function, value, scale, center, size, accuracy, difference)[0]


def numerical_derivative(
    function: Callable[[Array], Array],
    point: Array,
    *,
    accuracy: float = 2.0**-52,
    difference: Callable[[Array, Array], Array] = np.subtract,
) -> tuple[Array, Array]:
    """Differentiate by each coordinate of a point, as `parameter_difference` does by a number.

    Steps are relative to the coordinate, or to a tenth of the largest number in the point and its
    value where it is smaller.

    Parameters
    ----------
    function : callable, (d,) array to (m,) array
        `NoMotion`, such as `Diverged` or `Refused`, is a refusal.
    point : (d,) array
        Where to differentiate.
    accuracy : float
        How wrong values are, relative to the largest number in the point and its value.
    difference : callable
        Difference of two values, for values that hold angles.

    Returns
    -------
    derivative : (m, d) array
    error : (m, d) array
        Estimate of its error. At a corner it is no less than the distance from the slope on either
        side.

    Raises
    ------
    NoMotion
        What refuses the function at the point itself.
    Refused
        When there is no derivative: the function is refused on both sides however near, or its
        differences do not settle, as at a jump, a sharp corner or the end of a square root.

    References
    ----------
    See `parameter_difference`.

    Examples
    --------
    >>> derivative, error = numerical_derivative(np.exp, np.array([1.0]))
    >>> bool(abs(derivative[0, 0] - np.e) < error[0, 0] < 1e-10)
    True
    >>> numerical_derivative(abs, np.array([0.0]))
    Traceback (most recent call last):
    ...
    dynkit.core.no_motion.Refused: there is no derivative by number 0 of [0.0]: differences do ...
    """
    center = np.asarray(function(point))
    size = float(max(np.abs(center).max(initial=0.0), np.abs(point).max(initial=0.0)))
    derivative, error = np.empty((2, len(center), len(point)))
    for k, value in enumerate(point.tolist()):

        def along(there: float, k: int = k) -> Array:
            moved = np.array(point, dtype=np.float64)
            moved[k] = there
            return function(moved)

        scale = max(abs(value), _TENTH * size) or 1.0
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            slope, off, steep = _derivative(along, value, scale, center, size, accuracy, difference)
        # a value of zero is rounded only beside the point: its slope is rounded then
        derivative[:, k], error[:, k] = slope, _MARGIN * off + accuracy * abs(slope)
        blur = _BLUR * accuracy ** (_ORDER / (_ORDER + 1.0)) * size / scale
        if error[:, k].max() > max(_UNSETTLED * max(abs(slope).max(), steep), blur):
            raise Refused(
                f"there is no derivative by number {k} of {point.tolist()}: differences do not "
                "settle"
            )
    return derivative, error


def _derivative(
    function: Callable[[float], Array],
    value: float,
    scale: float,
    center: Array,
    size: float,
    accuracy: float,
    difference: Callable[[Array, Array], Array],
) -> tuple[Array, Array, float]:
    """The derivative, its error, and the steepest of the first differences on either side.

    For values of a size, by steps in units of a scale.
    """
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

    first = scale * accuracy ** (1.0 / (_ORDER + 1))
    steps = [first / 2.0**k for k in range(_HALVINGS)]
    kinds = [(central, 4.0)]
    if np.isnan(change(steps[0])[0] + change(-steps[0])[0]).any():
        # near an end of the range central differences are short of room
        kinds = [(ahead, 2.0), (behind, 2.0), (central, 4.0)]
    best, error = refused, np.full(center.shape, np.inf)
    for kind, power in kinds:
        found, its_error = extrapolated(map(kind, steps), power, accuracy * size)
        if not its_error.max(initial=0.0) >= error.max(initial=0.0):
            best, error = found, its_error
        if error.max(initial=0.0) <= _ENOUGH * abs(best).max(initial=0.0):
            break
    if not np.isfinite(error).all():
        raise Refused(f"values must exist on one side of {value!r} at least; there are none")
    ends = [abs(found / way) for found, way in map(change, (steps[0], -steps[0]))]
    return best, error, float(np.nan_to_num(ends).max(initial=0.0))


def extrapolated(
    quotients: Iterable[tuple[Array, Array, float]], power: float, noise: float
) -> tuple[Array, Array]:
    """Extrapolate to step zero what is known at ever smaller steps, each half of the one before.

    Parameters
    ----------
    quotients : iterable of ((m,) array, (m,) array, float)
        At each step a quotient of differences, as (value, mean, width): rounding makes it wrong by
        the noise, and by the mean of the values, over the width. NaN where it is not defined. No
        more are taken than help.
    power : float
        By how much the error falls from one step to the next: 4 where it goes as the square.
    noise : float
        How wrong values are.

    Returns
    -------
    limit, error : (m,) arrays
        NaN and infinity where no two steps have a value.

    References
    ----------
    See `parameter_difference`.
    """
    rows: list[Array] = []
    waited = 0
    for slope, mean, width in quotients:
        row = [np.stack([slope, mean])]
        if not rows:
            best, error = slope, np.full(slope.shape, np.inf)
        found, its_error = slope, np.full(slope.shape, np.inf)
        for order, coarse in enumerate(rows, start=1):
            row.append(row[-1] + (row[-1] - coarse) / (power**order - 1.0))
            moved = np.maximum(abs(row[-1] - row[-2])[0], abs(row[-1] - coarse)[0])
            change = moved + (abs(row[-1][1]) + noise) / width
            nearer = change < its_error
            found = np.where(nearer, row[-1][0], found)
            its_error = np.where(nearer, change, its_error)
        # what smaller steps contradict agreed by chance
        contradicted = abs(found - best) > _MARGIN * (error + its_error)
        better = (its_error < error) | contradicted
        best, error = np.where(better, found, best), np.where(better, its_error, error)
        rows = row
        largest, worst = float(abs(best).max(initial=0.0)), float(error.max(initial=0.0))
        waited = 0 if better.any() or not worst <= _CLEAR * largest else waited + 1
        if waited == _PATIENCE or worst <= _ENOUGH * largest:
            break
    return best, error
