"""Derivatives by extrapolated differences, for functions without an exact derivative."""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from itertools import pairwise
from typing import Any, final

import numpy as np

from dynkit.core.no_motion import NoDerivative, NoMotion, Refused, replaced
from dynkit.core.validation import Array, finite_scalar

STEP = 1e-40
"""Imaginary step of complex-step derivatives: its square is negligible beside one."""

# The first relative step is accuracy**(1 / (_ORDER + 1)): at order 8 it balances the truncation
# error and the errors of the values.
_ORDER = 8
# There are at most _HALVINGS steps, each half of the one before. The extrapolation ends when the
# relative error is _ENOUGH. It also ends after _PATIENCE steps without a better estimate, if the
# relative error is below _CLEAR (smaller steps only add rounding) or all values are the same.
_HALVINGS, _PATIENCE, _CLEAR, _ENOUGH = 40, 3, 1e-6, 1e-11
# Steps of a small coordinate are relative to this fraction of the largest number of the state, as
# in the scales of periodic orbits.
_TENTH = 0.1
# A parameter below this is first changed relative to itself: steps relative to one do not resolve
# a function that varies over so small a change.
_SMALL = 1e-8
# At a corner whose slopes differ by 1 the mean of both values is step / 4 in units of the width.
# Extrapolation reduces it by (2/3)(14/15)(62/63)... = 0.61 to 0.15, while the slope is off by 0.5.
_MARGIN = 4.0
# Differences do not converge if their error is above this fraction of the slope: for a smooth
# function the error falls by many digits.
_UNSETTLED = 0.25
# A slope near zero is accepted if its error is below that of a difference quotient at the fifth
# step, a sixteenth of the first, which follows from the errors of the values.
_BLUR = _MARGIN * 16.0
# Slopes on both sides differ if their difference is above this many times their estimated errors.
_CORNER = 64.0
# A jump below _ROUGH, relative to the values, counts as an error of the values. These errors are
# judged from the steps after the first _SMALLER ones, over which smooth functions are straight.
_ROUGH, _SMALLER = 1e-8, 20
# Errors that show at the smallest steps are judged from the last _SMALLEST ones. Values are rounded
# ones if this many changes in succession are multiples of the first.
_SMALLEST, _MULTIPLES = 8, 5
# A limit is compared with the quotient at the step after the next _FARTHER ones; a relative
# difference below _TRUSTED is none. A number below _OWN of the scale may be that over which the
# function varies: then the limit is also compared with every _SPARSE-th step from there on. A
# number that is smaller by more than _DUST halvings is taken for zero.
_FARTHER, _OWN, _SPARSE, _TRUSTED, _DUST = 6, 2.0**-6, 8, 1e-3, 64

_OR = ", or the values are less exact than their `accuracy`"


def parameter_difference(
    function: Callable[[float], Array],
    value: float,
    *,
    accuracy: float = 2.0**-52,
    difference: Callable[[Array, Array], Array] = np.subtract,
    scales: Sequence[float] = (),
) -> Array:
    """Differentiate by one number: differences at ever smaller steps, extrapolated to step zero.

    The differences are central, or one-sided where the function is refused on the other side. The
    result is the extrapolation, over all steps and orders, with the smallest estimated error. That
    estimate adds the last change of the extrapolation, the error of the mean of the values at both
    ends, and the accuracy of the values. Steps at which the function is refused are left out, and
    so are large steps whose estimates contradict those of smaller steps. The result is compared
    with the difference at a step that is up to 128 times smaller than the last one.

    Parameters
    ----------
    function : callable, float to (m,) array
        It refuses a value by raising `NoMotion`, such as `NoCrossing` or `Refused`.
    value : float
        Where to differentiate.
    accuracy : float
        Error of the function's values, relative to the largest of them.
    difference : callable
        Difference of two values, for values that hold angles.
    scales : sequence of float
        Changes of the number over which the function may vary; by default ``max(|value|, 1)``, then
        ``|value|``, which comes first below 1e-8. A later one is tried where those before leave a
        hundred times that error.

    Returns
    -------
    (m,) array
        Its relative error is the larger of 1e-11 and about ``accuracy**(8 / 9)`` for functions that
        vary over one of the scales: 1e-9 for an accuracy of 1e-11.

    Raises
    ------
    NoMotion
        When the function is refused at the value itself.
    Refused
        When the function is refused at all steps on both sides.
    NoDerivative
        When the slopes on both sides differ, the function jumps, or differences do not converge.
        Corners of values that are small beside the largest, and jumps below 1e-8 of it, pass.

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
    best, least, before = np.zeros(center.shape), np.full(center.shape, np.inf), np.inf
    if not scales:
        scales = sorted({max(abs(value), 1.0), abs(value) or 1.0}, reverse=abs(value) >= _SMALL)
    for scale in scales:
        quotients = _Quotients(function, value, scale, center, accuracy, size, difference)
        found, error = quotients.derivative()
        # where two scales disagree, the larger steps do not resolve the function
        apart = abs(found - best) > _MARGIN * (error + least)
        better = np.where(apart, scale < before, error < least)
        best, least = np.where(better, found, best), np.where(better, error, least)
        before = scale
        if least.max(initial=0.0) <= _wanted(accuracy) * abs(best).max(initial=0.0):
            return best
    if quotients.jumps(best):
        raise NoDerivative(f"there is no derivative at {value!r}: the function jumps")
    if quotients.corner(best).any():
        raise NoDerivative(f"there is no derivative at {value!r}: the slopes on both sides differ")
    if not quotients.settled(best, _MARGIN * least, size):
        raise NoDerivative(f"there is no derivative at {value!r}: differences do not settle{_OR}")
    return best


def _wanted(accuracy: float) -> float:
    """Relative error of a derivative above which its steps or its values are examined again."""
    return 100.0 * max(_ENOUGH, float(accuracy ** (_ORDER / (_ORDER + 1.0))))


def by_parameter(system: Any, name: str, function: Callable[[Any], Array], **options: Any) -> Array:
    """Differentiate a function of a system by one of its parameters, as `parameter_difference`.

    Raises
    ------
    ValueError
        When there is no such parameter, or its value is not finite.
    """
    value = finite_scalar(name, system.value_of(name))
    return parameter_difference(
        lambda changed: function(replaced(system, **{name: changed})), value, **options
    )


def numerical_derivative(
    function: Callable[[Array], Array],
    point: Array,
    *,
    accuracy: float = 2.0**-52,
    difference: Callable[[Array, Array], Array] = np.subtract,
    least: float = 0.0,
) -> tuple[Array, Array]:
    """Differentiate with respect to each coordinate of a point, as `parameter_difference` does.

    Steps are relative to the coordinate, or to a tenth of the largest number in the point and its
    value, or of `least`, where the coordinate is smaller than that.

    Parameters
    ----------
    function : callable, (d,) array to (m,) array
        It refuses a point by raising `NoMotion`, such as `Diverged` or `Refused`.
    point : (d,) array
        Where to differentiate.
    accuracy : float
        Error of the function's values, relative to the largest number in the point and its value.
    difference : callable
        Difference of two values, for values that hold angles.
    least : float
        Change over which the function varies, for points near zero whose values are near zero.

    Returns
    -------
    derivative : (m, d) array
    error : (m, d) array
        Estimate of the error of the derivative. At a corner it is at least the distance to the
        slope on either side.

    Raises
    ------
    NoMotion
        When the function is refused at the point itself.
    Refused
        When the function is refused at all steps on both sides.
    NoDerivative
        When differences do not converge: at a jump, a sharp corner or the end of a square root.

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
    dynkit.core.no_motion.NoDerivative: there is no derivative by number 0 of [0.0]: differences ...
    """
    center = np.asarray(function(point))
    size = float(max(np.abs(center).max(initial=0.0), np.abs(point).max(initial=least)))
    derivative, error = np.empty((2, len(center), len(point)))
    for k, value in enumerate(point.tolist()):

        def along(there: float, k: int = k) -> Array:
            moved = np.array(point, dtype=np.float64)
            moved[k] = there
            return function(moved)

        scale = max(abs(value), _TENTH * size) or 1.0
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            quotients = _Quotients(along, value, scale, center, accuracy, size, difference)
            slope, off = quotients.derivative()
            # if values and point are zero, the only rounding error is that of the slope
            off = _MARGIN * off + accuracy * abs(slope)
            if off.max(initial=0.0) > _CLEAR * abs(slope).max(initial=0.0):
                off = np.maximum(off, quotients.corner(slope))
            settled = quotients.settled(slope, off, size)
        if not settled:
            raise NoDerivative(
                f"there is no derivative by number {k} of {point.tolist()}: differences do not "
                f"settle{_OR}"
            )
        derivative[:, k], error[:, k] = slope, off
    return derivative, error


_Quotient = Callable[[float], tuple[Array, Array, float]]


@final
class _Quotients:
    """Difference quotients of a function (m,) at ever smaller steps, in units of `scale`.

    The error of its values is `accuracy`, relative to their `size`.
    """

    def __init__(
        self,
        function: Callable[[float], Array],
        value: float,
        scale: float,
        center: Array,
        accuracy: float,
        size: float,
        difference: Callable[[Array, Array], Array],
    ) -> None:
        self._refused = np.full(center.shape, np.nan)
        self._value, self._scale, self._accuracy = value, scale, accuracy
        self._size, self._noise = size, accuracy * size
        first = scale * accuracy ** (1.0 / (_ORDER + 1))
        # the last step is as small beside the number as beside the scale
        more = max(math.frexp(scale)[1] - math.frexp(value)[1], 0)
        if value == 0.0 or more > _DUST:
            more = 0
        self._steps = [first / 2.0**k for k in range(_HALVINGS + more)]

        @cache
        def change(step: float) -> tuple[Array, float]:
            there = value + step
            try:
                return np.asarray(difference(function(there), center)), there - value
            except NoMotion:
                return self._refused, there - value

        self._change = change

    def _central(self, step: float) -> tuple[Array, Array, float]:
        (ahead, forward), (behind, backward) = self._change(step), self._change(-step)
        return (ahead - behind) / (forward - backward), 0.5 * (ahead + behind), forward - backward

    def _ahead(self, step: float) -> tuple[Array, Array, float]:
        found, forward = self._change(step)
        return found / forward, 0.0 * found, forward

    def _behind(self, step: float) -> tuple[Array, Array, float]:
        found, backward = self._change(-step)
        return found / backward, 0.0 * found, -backward

    def _limit(self, kind: _Quotient, power: float, noise: float | Array) -> tuple[Array, Array]:
        return extrapolated(map(kind, self._steps), power, noise)

    def _confirmed(self, kind: _Quotient, power: float) -> tuple[Array, Array]:
        """The limit of quotients, not contradicted by the quotients at far smaller steps.

        At steps near multiples of its period, a function looks like another smooth function. At
        steps over many periods it looks straight.
        """
        steps, wide = iter(self._steps), abs(self._value) < _OWN * self._scale
        best, error = extrapolated(map(kind, steps), power, self._noise)
        while best.any() and (left := list(steps)):
            left = left[min(_FARTHER, len(left) - 1) :]
            for step in left[::_SPARSE] if wide else left[:1]:
                there, _, width = kind(step)
                off = abs(there - best)
                off[~(off > error + _CORNER * self._noise / width + _TRUSTED * abs(best))] = 0.0
                if off.any():
                    break
            else:
                break
            steps = iter(left)
            found, its_error = extrapolated(map(kind, steps), power, self._noise)
            if its_error.max(initial=0.0) > _CLEAR * abs(found).max(initial=0.0):
                error = np.where(off > 0.0, off, error)
                break
            best, error = found, its_error
        return best, error

    def derivative(self) -> tuple[Array, Array]:
        """The derivative (m,) and its error (m,)."""
        first, last = self._steps[0], self._steps[-1]
        kinds = [(self._central, 4.0)]
        within = np.isfinite(self._change(first)[0] + self._change(-first)[0]).all()
        if not within:
            # near an end of the range the first central steps are refused
            kinds = [(self._ahead, 2.0), (self._behind, 2.0), (self._central, 4.0)]
        best, error, own = self._refused, np.full(self._refused.shape, np.inf), kinds[0]
        for kind, power in kinds:
            found, its_error = self._confirmed(kind, power)
            if not its_error.max(initial=0.0) >= error.max(initial=0.0):
                best, error, own = found, its_error, (kind, power)
            if error.max(initial=0.0) <= _ENOUGH * abs(best).max(initial=0.0):
                break
        if not np.isfinite(error).all():
            raise Refused(
                f"values must exist on at least one side of {self._value!r}; there are none"
            )
        # rounded values may not change over small steps, beside others that do
        wide = abs(self._change(first)[0] - self._change(-first)[0])
        flat = (best == 0.0) & (wide > _CORNER * self._noise)
        unsure = error.max(initial=0.0) > _wanted(self._accuracy) * abs(best).max(initial=0.0)
        unsure = unsure and (best.any() or wide.any())
        # at zero the smallest steps are not small beside the number
        if self._value != 0.0 and (unsure or flat.any()):
            noise = np.where(flat | unsure, self._graininess(), self._noise)
            if (noise > _CORNER * self._noise).any():
                best, error = self._limit(*own, noise)
        if not within and np.isfinite(self._change(last)[0] + self._change(-last)[0]).all():
            # one side alone does not show a corner
            error = np.maximum(error, self._apart(self._noise)[2])
        return best, error

    def _roughness(self) -> Array:
        """Errors (m,) of the values, which may be less exact than said.

        They are the distances from straight lines on both sides, over small steps.
        """
        rough = np.full(self._refused.shape, self._noise)
        for way in (1.0, -1.0):
            changes = map(self._change, [way * step for step in self._steps[_SMALLER:]])
            for (one, wide), (other, narrow) in pairwise(changes):
                rough = np.fmax(rough, abs(one - wide / narrow * other))
        return rough

    def _graininess(self) -> Array:
        """Errors (m,) of the values at the smallest steps, where smooth functions are straight.

        Where nothing changes over these steps, and changes over larger steps are multiples of the
        smallest one, as those of rounded values are, it is the smallest one.
        """
        grain = np.full(self._refused.shape, self._noise)
        for way in (1.0, -1.0):
            changes = [self._change(way * step) for step in self._steps[::-1]]
            for (one, narrow), (other, wide) in pairwise(changes[:_SMALLEST]):
                grain = np.fmax(grain, abs(other - wide / narrow * one))
            sizes = np.array([abs(found) for found, _ in changes])
            first = (sizes > 0.0).argmax(axis=0)
            rows = np.minimum(first + np.arange(_MULTIPLES)[:, None], len(sizes) - 1)
            found = np.take_along_axis(sizes, rows, axis=0)
            ratios = found / np.where(found[0] > 0.0, found[0], 1.0)
            rounded = (abs(ratios - np.rint(ratios)) < _TRUSTED).all(axis=0)
            known = (first >= _SMALLEST) & (first <= len(sizes) - _MULTIPLES)
            grain = np.where(rounded & known, np.fmax(grain, found[0]), grain)
        return grain

    def _apart(self, noise: float | Array) -> tuple[Array, Array, Array]:
        """Slopes (m,) ahead and behind, and their differences; zero where they agree."""
        (ahead, off), (behind, its_off) = (
            self._limit(kind, 2.0, noise) for kind in (self._ahead, self._behind)
        )
        apart = abs(ahead - behind)
        return ahead, behind, np.where(apart > _CORNER * (off + its_off), apart, 0.0)

    def corner(self, slope: Array) -> Array:
        """Differences (m,) of the slopes on both sides; zero where they agree within errors.

        Beside a corner, the slope agrees with that on one side, and on the other side the smallest
        steps do.
        """
        ahead, behind, apart = self._apart(self._noise)
        if apart.any():
            ahead, behind, apart = self._apart(self._roughness())
        off = np.minimum(abs(ahead - slope), abs(behind - slope))
        return np.where(off > apart / 16.0, apart, 0.0)

    def jumps(self, slope: Array) -> bool:
        """Whether changes over the smallest steps are not those of the slope (m,), nor fall."""
        for way in (1.0, -1.0):
            first, before, last = (
                self._change(way * self._steps[k])[0] - way * self._steps[k] * slope
                for k in (0, -4, -1)
            )
            least = np.fmax(_CORNER * self._noise, _ROUGH * self._size)
            least = np.fmax(least, _CLEAR * abs(first))
            if (abs(last) > np.maximum(least, 0.5 * abs(before))).any():
                return True
        return False

    def settled(self, slope: Array, error: Array, size: float) -> bool:
        """Whether an error (m,) is small beside the slope (m,), or beside that of the values."""
        first = self._steps[0]
        ends = [abs(found / way) for found, way in map(self._change, (first, -first))]
        steepest = np.nan_to_num(ends).max(initial=abs(slope).max(initial=0.0))
        blur = _BLUR * self._accuracy ** (_ORDER / (_ORDER + 1.0)) * size / self._scale
        return bool(error.max(initial=0.0) <= max(_UNSETTLED * steepest, blur))


def extrapolated(
    quotients: Iterable[tuple[Array, Array, float]], power: float, noise: float | Array
) -> tuple[Array, Array]:
    """Extrapolate difference quotients to step zero; each step is half of the one before.

    Parameters
    ----------
    quotients : iterable of ((m,) array, (m,) array, float)
        For each step (quotient, mean of the values, width of the step). The rounding error of a
        quotient is (noise + mean) / width. A quotient that is not defined is NaN. Iteration stops
        when further steps no longer reduce the error.
    power : float
        Factor by which the error falls from one step to the next: 4 for an error that is
        proportional to the square of the step.
    noise : float or (m,) array
        Absolute error of the function's values.

    Returns
    -------
    limit, error : (m,) arrays
        NaN and infinity where no two steps have a value.

    References
    ----------
    See `parameter_difference`.
    """
    coarse = np.empty((0, 2, 0))
    waited, constant = 0, True
    for slope, mean, width in quotients:
        row = np.empty((len(coarse) + 1, 2, slope.size))
        row[0, 0], row[0, 1] = slope.ravel(), mean.ravel()
        for k, before in enumerate(coarse):
            np.add(row[k], (row[k] - before) / (power ** (k + 1) - 1.0), out=row[k + 1])
        if len(coarse):
            limits = row[1:, 0]
            changes = np.maximum(abs(limits - row[:-1, 0]), abs(limits - coarse[:, 0]))
            changes += (abs(row[1:, 1]) + np.ravel(noise)) / width
            changes[np.isnan(changes)] = np.inf
            nearest = changes.argmin(axis=0), np.arange(slope.size)
            its_error = changes[nearest].reshape(slope.shape)
            found = np.where(its_error < np.inf, limits[nearest].reshape(slope.shape), slope)
        else:
            found = best = slope
            its_error = error = np.full(slope.shape, np.inf)
        # an earlier estimate that smaller steps contradict had a small error by chance
        contradicted = abs(found - best) > _MARGIN * (error + its_error)
        better = (its_error < error) | contradicted
        best, error = np.where(better, found, best), np.where(better, its_error, error)
        coarse = row
        largest, worst = float(abs(best).max(initial=0.0)), float(error.max(initial=0.0))
        constant = constant and not (slope.any() or mean.any())
        clear = constant or worst <= _CLEAR * largest
        waited = 0 if better.any() or not clear else waited + 1
        if waited == _PATIENCE or worst <= _ENOUGH * largest:
            break
    return best, error
