"""How far the limit of small radii lies from the slope of a scaling region.

A density with square-root singularities has C(r) ~ r (a + b ln(1/r)), and products of such
densities have powers of that: the local slopes approach the dimension like 1 / ln(1/r), too slowly
for any range of radii to look bent. The borders of a set add a part in proportion to r.
Self-similar sets have waves in ln r. The models are fitted to the slopes over all radii by maximum
likelihood, each with the waves that it needs.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dynkit.analysis.dimension.counting import Counts
from dynkit.analysis.dimension.errors import standard_errors
from dynkit.validation import Array

# the width of a slope is a sixth of the range at most: two numbers of a model, four for the scatter
_FEWEST_SLOPES = 6
# Akaike's criterion: twice the number of parameters that a model has more than another
_PENALTY = 2.0
# -2 ln likelihood above its least: one and two standard errors of a parameter, three of a plateau
_LIKELY, _EXCLUDED, _CERTAIN = 1.0, 4.0, 9.0
# 1 / (A + ln(R/r)) at the largest radius R: at 1/2 the logarithm takes half of the slope
_LOGARITHMS = np.linspace(0.0, 0.5, 51)[1:]
# Waves of ln C: from a tenth of the error of 1e6 pairs to half of C, at steps below a factor of
# two; independent at successive radii, or alike over two octaves, as contractions by 1/16 give.
_WAVES = np.geomspace(1e-4, 0.5, 15)
_OCTAVES = (0.0, 2.0)


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
    """Slopes over disjoint steps of ln r, and the covariance of their chance."""

    nodes: Array
    values: Array
    weights: Array
    chance: Array


class _Fits(NamedTuple):
    """-2 ln likelihood, and the shift of the limit of small radii, of models of a drift."""

    misfits: Array
    shifts: Array

    def better(self, other: _Fits) -> _Fits:
        chosen = self.misfits <= other.misfits
        return _Fits(
            np.where(chosen, self.misfits, other.misfits),
            np.where(chosen, self.shifts, other.shifts),
        )


def drift_of(
    radii: Array, pairs: Counts, shares: Counts, region: Array, *, steps: int, coordinates: int
) -> Drift:
    """Return how far the slope of a region may lie from the limit of small radii.

    Slopes over successive octaves, or sixths of the range where that is less, are fitted by a
    constant D; by the slope of (r (A + ln(R/r)))^D; and by D + B r. Their covariance is that of
    chance, from bootstrap over blocks of time, and that of waves of ln C about the model, as
    self-similar sets have them: of each model the likeliest, or none. The shift is the larger of
    those of the two models of the drift: each counts by Akaike's weight against the constant, and
    does not count when the other fits better by two standard errors. Slopes without waves are those
    of a density, which may have singularities: there the shift is no less than the largest that
    the likelihood of a logarithm does not exclude by one standard error. No dimension exceeds the
    number of coordinates: no shift leads beyond it.

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
    # ln C less D ln r: a constant, of borders, and of logarithms
    border = radii / radii[-1]
    bends = np.log1p(np.append(0.0, _LOGARITHMS)[:, None] * np.log(radii[-1] / radii))
    smooth = _fits(slopes, slopes.chance, border, bends, region)
    likeliest = smooth
    for covariance, parameters in _with_waves(slopes):
        fits = _fits(slopes, covariance, border, bends, region)
        fits = fits._replace(misfits=fits.misfits + _PENALTY * parameters)
        likeliest = likeliest.better(fits)
    room = max(coordinates - float(region @ np.log(pairs)), 0.0)
    # the border's comes first, then that of no drift
    edge, flat, *logarithms = likeliest.misfits
    best = 2 + int(np.argmin(logarithms))
    least = float(likeliest.misfits.min())
    squares = [
        min(likeliest.shifts[i], room) ** 2
        / (1.0 + np.exp(0.5 * (likeliest.misfits[i] + _PENALTY - flat)))
        for i in (0, best)
        if likeliest.misfits[i] <= least + _EXCLUDED
    ]
    likely = smooth.shifts[1:][smooth.misfits[1:] <= least + _LIKELY]
    shift = max(np.sqrt(max(squares, default=0.0)), min(likely.max(initial=0.0), room))
    # slopes that only bend near the borders have a plateau below
    logarithmic = likeliest.misfits[best] + _EXCLUDED < edge
    return Drift(float(shift), bool(logarithmic and flat > least + _CERTAIN))


def _fits(slopes: _Slopes, covariance: Array, border: Array, bends: Array, region: Array) -> _Fits:
    """Fits of the model with a border, and of those with a logarithm each, by least squares."""
    whitening = np.linalg.inv(np.linalg.cholesky(covariance))
    values = whitening @ slopes.values
    models = whitening @ (1.0 + slopes.weights @ bends.T)
    sizes = (values @ models) / (models * models).sum(axis=0)
    edge = np.column_stack([models[:, 0], whitening @ (slopes.weights @ border)])
    both = np.linalg.lstsq(edge, values, rcond=None)[0]
    apart = values[:, None] - np.column_stack([edge @ both, models * sizes])
    misfits = (apart * apart).sum(axis=0) - 2.0 * np.log(np.diag(whitening)).sum()
    return _Fits(misfits, -np.append(both[1] * (region @ border), sizes * (bends @ region)))


def _with_waves(slopes: _Slopes) -> Iterator[tuple[Array, int]]:
    """Covariances that contain waves of ln C, and how many parameters the waves have."""
    count, length = len(slopes.values), np.diff(slopes.nodes[:2])
    steps = (np.eye(count, count + 1, k=1) - np.eye(count, count + 1)) / length
    octaves = abs(slopes.nodes[:, None] - slopes.nodes) / np.log(2.0)
    for memory in _OCTAVES:
        alike = np.exp(-octaves / memory) if memory else np.eye(count + 1)
        waves = steps @ alike @ steps.T
        parameters = 2 if memory else 1
        yield from ((slopes.chance + size**2 * waves, parameters) for size in _WAVES)


def _slopes(radii: Array, pairs: Counts, shares: Counts, width: int) -> _Slopes:
    nodes = np.arange(len(radii) - 1, -1, -width)[::-1]
    count = len(nodes) - 1
    length = float(np.log(radii[nodes[1]] / radii[nodes[0]]))
    weights = np.zeros((count, len(radii)))
    weights[np.arange(count), nodes[1:]] = 1.0 / length
    weights[np.arange(count), nodes[:-1]] = -1.0 / length
    # counts between successive radii are independent: so is their chance
    chance = np.diag(standard_errors(pairs, shares, weights) ** 2)
    return _Slopes(np.log(radii[nodes] / radii[-1]), weights @ np.log(pairs), weights, chance)
