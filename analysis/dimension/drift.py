"""Distance between the slope of a scaling region and the limit of small radii.

A density with square-root singularities has C(r) ~ r (a + b ln(1/r)), and products of such
densities have powers of that: the local slopes approach the dimension like 1 / ln(1/r), so slowly
that no range of radii looks bent. The borders of a set change the slope in proportion to r, its
curvature in proportion to r^2. Self-similar sets have waves in ln r. Each of these models has a
posterior probability, and the shift is the root mean square over all models.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dynkit.analysis.dimension.counting import Counts
from dynkit.analysis.dimension.errors import standard_errors
from dynkit.core.validation import Array

# least number of slopes: two for the two parameters of a model, four for the scatter
_FEWEST_SLOPES = 6
# Prior odds of a singular density without waves. A short range of radii cannot decide, and too
# small an error is worse than too large a one. The odds, and the square roots of 1 / A, are
# calibrated: two errors cover nine of ten products of two arcsine densities at 1000 states (three
# of four with even odds and values). With waves the odds are even.
_SINGULAR = 3.0
_CERTAIN = 20.0  # posterior over prior odds that is strong evidence (Kass, Raftery)
# 1 / (A + ln(R/r)) at the largest radius R. Two arcsine singularities and nothing else have
# C(r) ~ r (1 + ln(4 L/r)) over a length L: 0.21 at L/10. A narrower coordinate has more.
_LOGARITHMS = np.linspace(0.0, 0.25, 11)[1:]
# the relative change of the slope by a bend at R: at most half
_BENDS = np.append(_HALF := np.linspace(0.0, 0.5, 9)[1:], -_HALF)
_POWERS = (1.0, 2.0, 4.0)  # powers of r in bends: from borders, curvature and its next order
# waves of ln C: from the error of 1e6 pairs to half of C, at steps below a factor of two
_WAVES = np.geomspace(1e-3, 0.5, 10)


class Drift(NamedTuple):
    """A drift of the local slopes.

    Parameters
    ----------
    shift : float
        One standard error of a slope for the limit of small radii.
    certain : bool
        Whether the data raise the odds of a singular density by a factor of 20 or more.
    """

    shift: float
    certain: bool


class _Slopes(NamedTuple):
    """Slopes over disjoint steps of ln r, and their statistical covariance."""

    length: float
    values: Array
    weights: Array
    chance: Array


def drift_of(
    radii: Array, pairs: Counts, shares: Counts, region: Array, *, steps: int, coordinates: int
) -> Drift:
    """Return the distance of the slope of a region from the limit of small radii.

    The models of the slopes over successive octaves, or sixths of the range where that is less, are
    a constant D; D (1 - b (r/R)^p) for p = 1, 2 and 4; and the slope of (r (A + ln(R/r)))^D. Each
    model has statistical scatter, from a bootstrap over blocks of time, without or with waves of
    ln C as in self-similar sets. The likelihood is normal, and integrated over D. The prior is 3/4
    for a logarithm, 1/8 for a constant and 1/8 for a bend; with waves 1/2, 1/4 and 1/4. Waves have
    probability 1/2; values of 1 / A have odds like their square roots, and all values of other
    parameters are equally probable. The shift is the root mean square over the posterior. It is
    limited because no dimension exceeds the number of coordinates.

    Parameters
    ----------
    radii : (k,) array
        All resolved radii, ascending at equal steps of the logarithm.
    pairs : (k,) array of int
    shares : (b, k) array of int
    region : (k,) array
        Weights of ln C in the slope of the region.
    steps : int
        Number of radii per octave.
    coordinates : int
        Number of coordinates with an extent.

    References
    ----------
    E. Ott, W. D. Withers, J. A. Yorke, J. Stat. Phys. 36 (1984) 687-697: dimensions where densities
    are singular. J. A. Hoeting, D. Madigan, A. E. Raftery, C. T. Volinsky, Statist. Sci. 14 (1999)
    382-401: means over models. R. E. Kass, A. E. Raftery, J. Am. Stat. Assoc. 90 (1995) 773-795:
    odds. R. Badii, A. Politi, Phys. Lett. A 104 (1984) 303-305: waves of self-similar sets.
    """
    width = min(steps, (len(radii) - 1) // _FEWEST_SLOPES)
    if width < 1:
        return Drift(0.0, False)
    slopes = _slopes(radii, pairs, shares, width)
    curves, prior = _models(radii / radii[-1])
    covariances, wave_prior = _with_waves(slopes)
    whitening = np.linalg.inv(np.linalg.cholesky(covariances))
    values, models = whitening @ slopes.values, whitening @ (1.0 + slopes.weights @ curves.T)
    squares = (models * models).sum(axis=1)
    dimensions = np.einsum("ci,cim->cm", values, models) / squares
    apart = values[:, :, None] - models * dimensions[:, None]
    logs = np.log(np.diagonal(whitening, axis1=1, axis2=2)).sum(axis=1)[:, None]
    logs = logs - 0.5 * ((apart * apart).sum(axis=1) + np.log(squares))
    prior = wave_prior[:, None] * np.repeat(prior, [1, len(_WAVES)], axis=0)
    posterior = prior * np.exp(logs - logs.max())
    posterior /= posterior.sum()
    room = max(coordinates - float(region @ np.log(pairs)), 0.0)
    shifts = np.minimum(-dimensions * (curves @ region), room)
    before, after = (float(each[:, -len(_LOGARITHMS) :].sum()) for each in (prior, posterior))
    certain = after * (1.0 - before) > _CERTAIN * before * (1.0 - after)
    return Drift(float(np.sqrt((posterior * shifts * shifts).sum())), certain)


def _models(parts: Array) -> tuple[Array, Array]:
    """Return models of (ln C - D ln r) / D at fractions of the largest radius, (k, n), and priors.

    The priors, (2, k), are those without and with waves.
    """
    bends = np.vstack([-_BENDS[:, None] * parts**power / power for power in _POWERS])
    logarithms = np.log1p(-_LOGARITHMS[:, None] * np.log(parts))
    counts = np.array([1, len(bends), len(logarithms)])
    prior = np.repeat(np.array([[0.5, 0.5, _SINGULAR], [0.5, 0.5, 1.0]]) / counts, counts, axis=1)
    prior[:, -len(_LOGARITHMS) :] *= np.sqrt(_LOGARITHMS) / np.sqrt(_LOGARITHMS).mean()
    prior /= prior.sum(axis=1, keepdims=True)
    return np.vstack([np.zeros(len(parts)), bends, logarithms]), prior


def _with_waves(slopes: _Slopes) -> tuple[Array, Array]:
    """Return covariances (c, m, m) without and with waves of ln C, and their prior."""
    count = len(slopes.values)
    steps = (np.eye(count, count + 1, k=1) - np.eye(count, count + 1)) / slopes.length
    sizes = np.append(0.0, _WAVES)
    prior = np.append(0.5, np.full(len(_WAVES), 0.5 / len(_WAVES)))
    return slopes.chance + sizes[:, None, None] ** 2 * (steps @ steps.T), prior


def _slopes(radii: Array, pairs: Counts, shares: Counts, width: int) -> _Slopes:
    nodes = np.arange(len(radii) - 1, -1, -width)[::-1]
    count = len(nodes) - 1
    length = float(np.log(radii[nodes[1]] / radii[nodes[0]]))
    weights = np.zeros((count, len(radii)))
    weights[np.arange(count), nodes[1:]] = 1.0 / length
    weights[np.arange(count), nodes[:-1]] = -1.0 / length
    # where a step adds no pair, the error is at least that of one pair
    errors = np.maximum(standard_errors(pairs, shares, weights), 1.0 / (length * pairs[nodes[1:]]))
    groups = (shares / pairs) @ weights.T
    groups = groups - groups.mean(axis=0)
    sizes = np.sqrt((groups * groups).sum(axis=0))
    groups /= np.where(sizes > 0.0, sizes, 1.0)
    # counts between successive radii are independent, but their density is not: half of the
    # correlations, which are uncertain for so few blocks, are used
    correlations = 0.5 * (groups.T @ groups)
    np.fill_diagonal(correlations, 1.0)
    chance = correlations * np.outer(errors, errors)
    return _Slopes(length, weights @ np.log(pairs), weights, chance)
