"""Scaling regions of correlation sums, and their exponents."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple, final

import numpy as np

from dynkit.analysis.dimension.coordinates import grid_of
from dynkit.analysis.dimension.counting import Counts
from dynkit.analysis.dimension.errors import counting_errors, standard_errors
from dynkit.analysis.dimension.sums import CorrelationSums
from dynkit.core.reprs import span
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


STEPS = 8
"""Number of radii per octave."""

TOLERANCE = 0.05
"""Largest relative difference of slopes in a scaling region beyond two standard errors."""

_PITCH = np.log(2.0) / STEPS  # step of ln r
_PARTS = 4  # a scaling region is divided into quarters
_LOCAL = STEPS // 2  # steps of a local slope: half an octave
_FEWEST_PAIRS = 30  # fewer have no reliable logarithm
# a finite set: least ratio of radii over which the sum is flat; largest relative change of a flat
# sum; least number of visits per point
_FLAT_RATIO, _FLAT, _VISITS = 100.0, 0.01, 10
# Rounding to a grid changes a distance by half a step. At 8 steps ln r changes by 1/16: the slope
# of a region of 4:1, the default least ratio, changes by 1 / 16 / ln 4 = 4.5 %, less than
# TOLERANCE.
_GRID_STEPS = 8


class Outcome(Enum):
    """Outcome of the search for a scaling region; the value says it in words."""

    FOUND = "there is a scaling region"
    DRIFT = "the local slopes drift: there is no plateau"
    FINITE = "the states are finitely many points: as a set they have dimension 0"
    NONE = "there is no scaling region"


@final
@dataclass(frozen=True)
class Estimate:
    """A number and one standard error, which covers about 68 % and is not a bound.

    Parameters
    ----------
    value, error : float
    """

    value: float
    error: float

    def __str__(self) -> str:
        return f"{self.value:.4g} +- {self.error:.2g}"


@final
@dataclass(frozen=True, eq=False)
class LocalSlopes:
    """Slopes d ln C / d ln r, fitted over half an octave about each radius.

    Parameters
    ----------
    radii : (k,) array
    values : (k,) array
    errors : (k,) array
        One standard error each, from bootstrap over blocks of time.
    """

    radii: Array
    values: Array
    errors: Array

    def __repr__(self) -> str:
        return f"<LocalSlopes: {len(self.radii)} radii {span(self.radii)}>"


@final
@dataclass(frozen=True)
class ScalingRegion:
    """A range of radii over which the correlation sum is a power.

    Parameters
    ----------
    low, high : float
        The first and the last radius.
    slope : float
        The exponent, by least squares of ln C on ln r.
    statistical : float
        One standard error of the slope, from bootstrap over blocks of time.
    systematic : float
        Scatter of the slopes of the region's quarters beyond the statistical one: the mean variance
        of the quarters and the standard error of a variance of four are subtracted.
    drift : float
        One standard error for the limit of small radii, where the local slopes drift: see
        `dynkit.analysis.dimension.scaling.drift_of`. Sets with wide gaps, such as attractors that
        contract strongly, have a curve like a staircase: where the local slopes outside the region
        leave its slope and come back to it, this includes the largest change of the slope when it
        is taken over more radii.
    """

    low: float
    high: float
    slope: float
    statistical: float
    systematic: float
    drift: float

    @property
    def ratio(self) -> float:
        """Largest radius over the smallest."""
        return self.high / self.low

    @property
    def error(self) -> float:
        """One standard error: statistical, systematic and drift combined; not a bound."""
        return float(np.hypot(self.scatter, self.drift))

    @property
    def scatter(self) -> float:
        """One standard error of the slope within the region, without the drift."""
        return float(np.hypot(self.statistical, self.systematic))


@final
@dataclass(frozen=True)
class Scaling:
    """The scaling of a correlation sum.

    Parameters
    ----------
    outcome : Outcome
    region : ScalingRegion or None
    """

    outcome: Outcome
    region: ScalingRegion | None


def local_slopes(sums: CorrelationSums) -> LocalSlopes:
    """Return the local slopes of sums at 8 radii per octave, where there are 30 pairs or more."""
    radii, pairs, shares = _populated(sums)
    weights = _slope_weights(len(radii), _LOCAL)
    return LocalSlopes(
        radii[_LOCAL // 2 :][: len(weights)],
        weights @ np.log(pairs),
        standard_errors(pairs, shares, weights),
    )


def find_scaling(sums: CorrelationSums, states: Array, least_ratio: float) -> Scaling:
    """Find the scaling region of the sums of states, (n, d), at 8 radii per octave.

    It is the longest range of radii, with a ratio of `least_ratio` or more, whose quarters have
    slopes that agree with that of the whole within `TOLERANCE` plus two standard errors, and have
    errors below `TOLERANCE`. Among ranges of one length it is that of the smallest radii.

    The outcome is a drift when the local slopes over all resolved radii raise the odds of a
    singular density by a factor of 20, and the drift shifts the limit of small radii by more than
    two other errors.

    Where a coordinate was rounded to a grid, radii below 8 of its steps are not searched. A sum
    that is flat over a factor of 100 shows clusters of points: then only smaller radii are searched
    (not below 8 steps of a grid). When no range scales there, the set is finite at this resolution.
    """
    every, pairs, shares = _populated(sums)
    flat = _flat_range(every, pairs, sums.total, len(states))
    begin, end = int(np.searchsorted(every, _GRID_STEPS * grid_of(states))), len(every)
    if flat is not None and begin <= flat[0]:
        end = flat[0] + 1
    part = slice(begin, end)
    radii, pairs, shares = every[part], pairs[part], shares[:, part]
    found = _longest_region(radii, pairs, shares, least_ratio)
    if found is not None:
        region, weights = found
        extended = int((np.ptp(states, axis=0) > 0.0).sum())
        drift = drift_of(radii, pairs, shares, weights, steps=STEPS, coordinates=extended)
        drifts = drift.certain and drift.shift > 2.0 * region.scatter
        outcome = Outcome.DRIFT if drifts else Outcome.FOUND
        shift = np.hypot(drift.shift, _shift_by_gaps(radii, pairs, shares, region))
        return Scaling(outcome, replace(region, drift=float(shift)))
    if flat is None:
        return Scaling(Outcome.NONE, None)
    low, high = (float(every[i]) for i in flat)
    return Scaling(Outcome.FINITE, ScalingRegion(low, high, 0.0, 0.0, 0.0, 0.0))


def takens(sums: CorrelationSums, region: ScalingRegion) -> Estimate:
    """Return Takens' maximum-likelihood estimate of the exponent, from all pairs below `high`.

    The likelihood is that of the counts in bins, where distances below `low` are one bin; nothing
    is interpolated. The error has three parts. The first is the error of a bootstrap over blocks of
    time. The second is the largest change of the estimate, beyond the statistical one, when only
    pairs below a smaller radius are used, down to the middle of the region in ln r: most pairs are
    at the largest radii, and a curve that bends there, or oscillates about a line, shifts the
    estimate. This change is extrapolated as a shift in proportion to the radius, as at the borders
    of a set. The third is the drift of the region.

    References
    ----------
    F. Takens, in Lecture Notes in Mathematics 1125 (1985) 99-106. S. Ellner, Phys. Lett. A 133
    (1988) 128-133: distances that are only known to be small.
    """
    inside = (sums.radii >= region.low) & (sums.radii <= region.high) & (sums.pairs > 0)
    pairs, shares = sums.pairs[inside], sums.shares[:, inside]
    values, weights = _likeliest(pairs, (len(pairs) + 1) // 2)
    statistical, *errors = standard_errors(
        pairs, shares, np.vstack([weights[-1], weights - weights[-1]])
    )
    expected = (1.0 + np.sqrt(2.0)) * np.square(errors)  # mean and standard error of a square
    square = float(((values - values[-1]) ** 2 - expected).max())
    shift = np.sqrt(max(square, 0.0)) / (1.0 - region.ratio**-0.5)
    error = np.hypot(np.hypot(statistical, shift), region.drift)
    return Estimate(float(values[-1]), float(error))


def _likeliest(pairs: Counts, fewest: int) -> tuple[Array, Array]:
    """Return Takens' estimates (m,) from the first `fewest` or more counts, and derivatives (m, k).

    The derivatives are with respect to the logarithms of the counts (k,) at successive radii.
    """
    counts = np.arange(max(fewest, 2), len(pairs) + 1)
    later = np.cumsum(pairs[1:], dtype=np.float64)[counts - 2]
    parts = (pairs[counts - 1] - pairs[0]) / later
    weights = np.where(np.arange(len(pairs)) < counts[:, None], -parts[:, None], 0.0)
    weights[np.arange(len(counts)), counts - 1] += 1.0
    weights[:, 0] = -1.0
    weights *= pairs / (later * (1.0 - parts) * _PITCH)[:, None]
    return -np.log1p(-parts) / _PITCH, weights


def _populated(sums: CorrelationSums) -> tuple[Array, Counts, Counts]:
    there = sums.pairs >= _FEWEST_PAIRS
    return sums.radii[there], sums.pairs[there], sums.shares[:, there]


def _slope_weights(count: int, width: int) -> Array:
    """Return weights, (count - width, count), of the slopes over width + 1 successive radii."""
    offsets = np.arange(width + 1) - 0.5 * width
    begins = np.arange(max(count - width, 0))[:, None]
    weights = np.zeros((len(begins), count))
    weights[begins, begins + np.arange(width + 1)] = offsets / (offsets @ offsets) / _PITCH
    return weights


def _flat_range(radii: Array, pairs: Counts, total: int, states: int) -> tuple[int, int] | None:
    """Return the first and last index of the lowest flat range of radii, if any."""
    logs = np.log(pairs)
    ends = np.searchsorted(logs, logs + _FLAT, side="right") - 1
    often = pairs * states >= _VISITS * total
    for i in np.flatnonzero(often & (radii[ends] >= _FLAT_RATIO * radii))[:1].tolist():
        return i, int(ends[i])
    return None


def _longest_region(
    radii: Array, pairs: Counts, shares: Counts, least_ratio: float
) -> tuple[ScalingRegion, Array] | None:
    """Return the region and the weights of ln C in its slope, or None."""
    logs = np.log(pairs)
    shortest = int(np.ceil(np.log(least_ratio) / (_PARTS * _PITCH) - 1e-9))
    for width in range((len(radii) - 1) // _PARTS, max(shortest, 1) - 1, -1):
        whole = _slope_weights(len(radii), _PARTS * width)
        quarters = _slope_weights(len(radii), width)
        slopes = whole @ logs
        begins = np.arange(len(whole))[:, None] + width * np.arange(_PARTS)
        parts = (quarters @ logs)[begins]
        apart = abs(parts - slopes[:, None]).max(axis=1)
        # TOLERANCE plus two errors, which are at most TOLERANCE each
        likely = np.flatnonzero((slopes > 0.0) & (apart <= 3.0 * TOLERANCE * slopes))
        # the lowest quarter has the fewest pairs
        errors = counting_errors(pairs, (quarters[: len(whole)] - whole)[likely])
        for i in likely[errors <= TOLERANCE * slopes[likely]].tolist():
            if _agree(pairs, shares, whole[i], quarters[begins[i]]):
                region = _region(radii, pairs, shares, whole[i], quarters[begins[i]])
                return region, whole[i]
    return None


def _shift_by_gaps(radii: Array, pairs: Counts, shares: Counts, region: ScalingRegion) -> float:
    """Return the shift of the slope of a region that is one step of a staircase; otherwise zero."""
    inside = np.flatnonzero((radii >= region.low) & (radii <= region.high))
    low, high = int(inside[0]), int(inside[-1])
    octaves = _slope_weights(len(radii), STEPS)
    errors = standard_errors(pairs, shares, octaves)
    apart, allowed = abs(octaves @ np.log(pairs) - region.slope), TOLERANCE * region.slope
    away = apart > allowed + 3.0 * errors
    back = (apart <= 2.0 * allowed) & (errors <= 2.0 * allowed)
    below, above = np.arange(low - STEPS, -1, -1), np.arange(high, len(octaves))
    shift = 0.0
    for outwards in (below, above):
        gone = np.flatnonzero(away[outwards])
        if not len(gone) or not back[outwards[gone[0] :]].any():
            continue
        others = np.arange(low) if outwards is below else np.arange(high + 1, len(radii))
        begins, ends = np.minimum(others, low), np.maximum(others, high)
        lengths, rows = np.log(radii[ends] / radii[begins]), np.arange(len(others))
        chords = np.zeros((len(others), len(radii)))
        chords[rows, ends], chords[rows, begins] = 1.0 / lengths, -1.0 / lengths
        known = standard_errors(pairs, shares, chords) <= 2.0 * allowed
        shifts = abs(chords @ np.log(pairs) - region.slope)
        shift = max(shift, float(shifts[known].max(initial=0.0)))
    return shift


def _agree(pairs: Counts, shares: Counts, whole: Array, quarters: Array) -> bool:
    logs = np.log(pairs)
    allowed = TOLERANCE * float(whole @ logs)
    errors = standard_errors(pairs, shares, quarters - whole)
    apart = abs((quarters - whole) @ logs)
    return bool((errors <= allowed).all() and (apart <= allowed + 2.0 * errors).all())


def _region(
    radii: Array, pairs: Counts, shares: Counts, whole: Array, quarters: Array
) -> ScalingRegion:
    logs = np.log(pairs)
    statistical, *errors = standard_errors(pairs, shares, np.vstack([whole, quarters]))
    expected = (1.0 + np.sqrt(2.0 / (_PARTS - 1))) * float(np.mean(np.square(errors)))
    scatter = float((quarters @ logs).var(ddof=1)) - expected
    inside = np.flatnonzero(whole)
    return ScalingRegion(
        float(radii[inside[0]]),
        float(radii[inside[-1]]),
        float(whole @ logs),
        float(statistical),
        float(np.sqrt(max(scatter, 0.0))),
        0.0,
    )
