"""How far the limit of small radii lies from the slope of a scaling region.

A density with square-root singularities has C(r) ~ r (a + b ln(1/r)), and products of such
densities have powers of that: the local slopes approach the dimension like 1 / ln(1/r), too slowly
for any range of radii to look bent. The borders of a set add a part in proportion to r. Both models
are fitted to the slopes over all radii, beside the model of a constant slope.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dynkit.analysis.dimension.counting import Counts
from dynkit.analysis.dimension.errors import standard_errors
from dynkit.validation import Array

# two models of one parameter more than none, and four slopes beyond them for the scatter
_FEWEST_SLOPES = 6
# Akaike's criterion: twice the number of parameters that a model has more than another
_PENALTY = 2.0
# differences of chi-square: two standard errors exclude a model of the drift, three a plateau
_EXCLUDED, _CERTAIN = 4.0, 9.0
# 1 / (A + ln(R/r)) at the largest radius R: at 1/2 the logarithm takes half of the slope
_LOGARITHMS = np.linspace(0.0, 0.5, 51)[1:]


class Drift(NamedTuple):
    """A drift of the local slopes.

    Parameters
    ----------
    shift : float
        One standard error of a slope for the limit of small radii.
    certain : bool
        Whether a constant slope is excluded by three standard errors, and by two one that bends
        towards the borders only.
    """

    shift: float
    certain: bool


class _Slopes(NamedTuple):
    """Slopes over disjoint steps of ln r, and the covariance of chance and of waves."""

    values: Array
    weights: Array
    chance: Array
    waves: Array

    def misfit(self, regressors: Array, wave: float) -> tuple[float, Array]:
        """Chi-square of generalized least squares, and the coefficients."""
        covariance = self.chance + wave * self.waves
        weighted = np.linalg.solve(covariance, regressors)
        coefficients = np.linalg.solve(regressors.T @ weighted, weighted.T @ self.values)
        apart = self.values - regressors @ coefficients
        chi_square = float(apart @ np.linalg.solve(covariance, apart))
        return chi_square, np.asarray(coefficients, dtype=np.float64)

    def wave(self, regressors: Array) -> float:
        """Variance of waves of ln C with which chi-square is the number of degrees of freedom."""
        freedom = regressors.shape[0] - regressors.shape[1]
        if self.misfit(regressors, 0.0)[0] <= freedom:
            return 0.0
        low, high = -60.0, 0.0  # ln: rounding; waves as large as C itself
        for _ in range(20):
            middle = 0.5 * (low + high)
            misfit = self.misfit(regressors, float(np.exp(middle)))[0]
            low, high = (middle, high) if misfit > freedom else (low, middle)
        return float(np.exp(high))


def drift_of(
    radii: Array, pairs: Counts, shares: Counts, region: Array, *, steps: int, coordinates: int
) -> Drift:
    """Return how far the slope of a region may lie from the limit of small radii.

    Slopes over successive octaves, or sixths of the range where that is less, are fitted by a
    constant D; by the slope of (r (A + ln(R/r)))^D; and by D + B r. Their covariance is that of
    chance, from bootstrap over blocks of time, and that of waves of ln C about the model, as
    self-similar sets have them. The shift is the larger of those of the two models of the drift:
    each counts by Akaike's weight against the constant, and does not count when the other fits
    better by two standard errors. No dimension exceeds the number of coordinates: no shift leads
    beyond it.

    Parameters
    ----------
    radii : (k,) array
        Ascending, at equal steps of the logarithm, all that are resolved.
    pairs : (k,) array of int
    shares : (b, k) array of int
    region : (k,) array
        Weights of ln C in the slope of the region.
    steps : int
        Radii to the octave.
    coordinates : int

    References
    ----------
    E. Ott, W. D. Withers, J. A. Yorke, J. Stat. Phys. 36 (1984) 687-697: dimensions where densities
    are singular. K. P. Burnham, D. R. Anderson, Model Selection and Multimodel Inference, 2nd ed.,
    Springer 2002, section 2.9: weights. R. Badii, A. Politi, Phys. Lett. A 104 (1984) 303-305:
    waves of self-similar sets.
    """
    width = min(steps, (len(radii) - 1) // _FEWEST_SLOPES)
    if width < 1:
        return Drift(0.0, False)
    slopes = _slopes(radii, pairs, shares, width)
    constant = np.ones((len(slopes.values), 1))
    # ln C less D ln r: of borders, and of logarithms
    border = radii / radii[-1]
    bends = [np.log1p(u * np.log(radii[-1] / radii)) for u in _LOGARITHMS]
    borders = np.column_stack([constant, slopes.weights @ border])
    logarithms = [constant + (slopes.weights @ bend)[:, None] for bend in bends]
    wave = min(slopes.wave(each) for each in (constant, borders, *logarithms[::10]))
    flat, _ = slopes.misfit(constant, wave)
    misfit, (_, size) = slopes.misfit(borders, wave)
    found = [(misfit, -float(size * (region @ border)))]
    fits = [slopes.misfit(each, wave) for each in logarithms]
    best = int(np.argmin([fit[0] for fit in fits]))
    found.append((fits[best][0], -float(fits[best][1][0] * (region @ bends[best]))))
    room = max(coordinates - float(region @ np.log(pairs)), 0.0)
    least = min(misfit for misfit, _ in found)
    parts = [
        min(shift, room) ** 2 / (1.0 + np.exp(0.5 * (misfit + _PENALTY - flat)))
        for misfit, shift in found
        if misfit <= least + _EXCLUDED
    ]
    # slopes that only bend near the borders have a plateau below
    logarithmic = found[1][0] + _EXCLUDED < found[0][0]
    return Drift(float(np.sqrt(max(parts))), logarithmic and flat > least + _CERTAIN)


def _slopes(radii: Array, pairs: Counts, shares: Counts, width: int) -> _Slopes:
    nodes = np.arange(len(radii) - 1, -1, -width)[::-1]
    count = len(nodes) - 1
    length = float(np.log(radii[nodes[1]] / radii[nodes[0]]))
    weights = np.zeros((count, len(radii)))
    weights[np.arange(count), nodes[1:]] = 1.0 / length
    weights[np.arange(count), nodes[:-1]] = -1.0 / length
    # counts between successive radii are independent: so is their chance
    chance = np.diag(standard_errors(pairs, shares, weights) ** 2)
    waves = (2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)) / length**2
    return _Slopes(weights @ np.log(pairs), weights, chance, waves)
