"""Averages over a motion, with errors as estimates of the averages over an infinite motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np

from dynkit.analysis.regimes import RegimeChange, regime_change
from dynkit.core.validation import Array

LEAST = 128
"""Least number of values of a series."""

_SLOWEST, _WAVES = 6, 12
"""Numbers of slow waves whose amplitudes give the error: the larger of both estimates."""

_ALL_WAVES, _STEEP = 32, 8.0
"""Number of waves, and largest ratio of the mean squares of the slowest and the other waves."""

_BINS = 1024
"""Number of bins of a series for the waves: the fastest wave has a period of 64 bins."""

_RAMP = 0.05
"""Fraction of a series over which its weight rises, and over which it falls."""

_BLOCKS, _QUARTERS, _CLEAR, _FLOOR = 32, 4, 0.01, 1e-9
"""Numbers of blocks and of quarters of a series. A motion is regular if the weighted averages over
quarters differ by at most _CLEAR times the scatter of blocks, or _FLOOR relative to the series."""


@final
class TimeAverages:
    """Time averages (k,) of a series (n, k), and functions of them, with errors.

    The weight rises over the first twentieth and falls over the last. So terms that telescope, such
    as logarithms of growth along a rotating direction, have little effect at both ends. The errors
    are estimated from the slow waves in the series, see `amplitudes` and `standard_errors`: twice
    the error is the half-width of a 95 % interval. When the slowest waves are much larger than the
    others, the correlation time is as long as their periods, and the motion is not `resolved`.

    A periodic or quasi-periodic motion is averaged with a smooth weight, for which the error falls
    faster than any power of n. It is distinguished from chaos by such averages over four quarters:
    they agree a hundred times better than the means of 32 blocks. The error is then the largest
    difference between a quarter and the whole.

    Where the run changes its regime (`change`) the averages of the whole belong to no regime, and
    the errors are increased by the largest difference to those before and after the change.

    Parameters
    ----------
    series : (n, k) array
    growths : int
        Number of first columns that are logarithms of stretching: see `regime_change`.

    References
    ----------
    U. K. Müller, M. W. Watson, Low-frequency econometrics, in Advances in Economics and
    Econometrics 2, Cambridge University Press (2017) 53-94 (waves). S. Das, Y. Saiki, E. Sander, J.
    A. Yorke, Quantitative quasiperiodicity, Nonlinearity 30 (2017) 4111-4140 (the weight).
    """

    def __init__(self, series: Array, *, growths: int = 0) -> None:
        count = len(series)
        weight = _ramps(count)
        self._mean = weight @ series
        waves = _slow_waves(weight[:, None] * (series - self._mean), weight)
        self._amplitudes = waves[:_WAVES]
        length = count // _BLOCKS
        blocks = series[count - _BLOCKS * length :].reshape(_BLOCKS, length, -1).mean(axis=1)
        self._whole = weighted(series)
        self._quarters = np.array([weighted(q) for q in np.array_split(series, _QUARTERS)])
        floor = _FLOOR * abs(series).max(axis=0)
        scatter = blocks.std(axis=0, ddof=1)
        spread = abs(self._quarters - self._whole).max(axis=0)
        self.regular = bool((spread <= np.maximum(_CLEAR * scatter, floor)).all())
        """Whether weighted averages converge as for periodic and quasi-periodic motions."""
        squares = waves[:, scatter > floor] ** 2
        slow, fast = squares[:_SLOWEST].mean(axis=0), squares[_SLOWEST:].mean(axis=0)
        self.resolved = self.regular or bool((slow <= _STEEP * fast).all())
        """Whether correlations are shorter than the slow waves: only then are the errors valid."""
        self.change = None if self.regular else regime_change(series, growths=growths)
        """The change of regime: see `dynkit.analysis.regimes.regime_change`."""
        at = 0 if self.change is None else self.change.at
        self._regimes = [series[:at].mean(axis=0), series[at:].mean(axis=0)] if at else []

    def estimate(self, function: Callable[[Array], Array]) -> tuple[Array, Array]:
        """Return a function (m,) of the averages (k,), and its errors (m,).

        The change of the function by a wave is half of its difference between the averages plus and
        minus the amplitudes of the wave.
        """
        if self.regular:
            value = function(self._whole)
            others = np.array([function(quarter) for quarter in self._quarters])
            return value, np.asarray(abs(others - value).max(axis=0))
        changes = [
            0.5 * (function(self._mean + wave) - function(self._mean - wave))
            for wave in self._amplitudes
        ]
        value, error = function(self._mean), standard_errors(np.array(changes))
        apart = [abs(function(regime) - value) for regime in self._regimes]
        return value, error + np.max(apart, axis=0, initial=0.0)


def amplitudes(deviations: Array, weights: Array, count: int = _WAVES) -> Array:
    """Return the amplitudes (w, k) of the slowest waves in the deviations (b, k) of parts of a sum.

    Wave j is sqrt(2) cos(pi j s), j = 1, 2, ..., w, where s is the weight before the middle of a
    part; w is `count`, or b - 1 where that is less. The waves are orthogonal to one another and to
    the constant. When distant parts are independent, the amplitudes are independent samples from
    the distribution of the error of the sum, also if neighbouring parts are correlated. Telescoping
    terms hardly change them, while they increase the scatter of single parts.

    Parameters
    ----------
    deviations : (b, k) array
        Their sum over the parts is zero.
    weights : (b,) array
        Weights of the parts; their sum is one.
    count : int
        Largest number of waves.
    """
    order = np.arange(1, min(count, len(weights) - 1) + 1)[:, None]
    waves = np.sqrt(2.0) * np.cos(np.pi * order * (np.cumsum(weights) - 0.5 * weights))
    return np.asarray(waves @ deviations)


def standard_errors(amplitudes: Array) -> Array:
    """Return the errors (k,) of sums, from the amplitudes (w, k) of their slow waves.

    An error is half of the half-width of a 95 % interval (two standard deviations of a normal
    distribution) from Student's t with w degrees of freedom, or from the slower half of the waves
    where that is larger, as for long correlations. It is infinite without waves.
    """
    from scipy.special import ndtr, stdtrit

    errors = np.zeros(amplitudes.shape[1])
    for count in (len(amplitudes), (len(amplitudes) + 1) // 2):
        if not count:
            return np.full(len(errors), np.inf)
        student = float(stdtrit(count, ndtr(2.0))) / 2.0
        errors = np.maximum(errors, student * np.sqrt(np.mean(amplitudes[:count] ** 2, axis=0)))
    return errors


def batch_errors(deviations: Array, weights: Array, change: RegimeChange | None) -> Array:
    """Return the `standard_errors` (k,) of sums of deviations (b, k) of batches.

    The weights (b,) have the sum one. Where the run changes its regime, the errors are increased by
    the largest difference to the sums before and after the batch with the change.
    """
    errors = standard_errors(amplitudes(deviations, weights))
    if change is None:
        return errors
    cut = min(change.at * len(weights) // change.states, len(weights) - 1)
    sides = [slice(None, cut), slice(cut + 1, None)]
    apart = [
        abs(deviations[side].sum(axis=0)) / weights[side].sum()
        for side in sides
        if weights[side].sum() > 0.0
    ]
    return np.asarray(errors + np.max(apart, axis=0, initial=0.0))


def _ramps(count: int) -> Array:
    """Return weights (n,) with sum one that are equal except near both ends."""
    t = (np.arange(count) + 0.5) / count
    weight = np.sin(0.5 * np.pi * np.minimum(np.minimum(t, 1.0 - t) / _RAMP, 1.0)) ** 2
    return np.asarray(weight / weight.sum())


def _slow_waves(deviations: Array, weight: Array) -> Array:
    """Return the amplitudes (w, k) of waves in deviations (n, k) of values with weights (n,)."""
    bins = min(_BINS, len(weight))
    begins = np.arange(bins) * len(weight) // bins
    parts, weights = (np.add.reduceat(a, begins, axis=0) for a in (deviations, weight))
    return amplitudes(parts, weights, _ALL_WAVES)


def weighted(series: Array) -> Array:
    """Return the average (k,) with the weight exp(-1 / (t (1 - t))), 0 < t < 1."""
    t = (np.arange(len(series)) + 0.5) / len(series)
    weight = np.exp(-1.0 / (t * (1.0 - t)))
    return np.asarray((weight / weight.sum()) @ series)
