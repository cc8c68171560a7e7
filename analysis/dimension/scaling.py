"""Scaling regions of correlation sums, and their exponents."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import final

import numpy as np

from dynkit.analysis.dimension.coordinates import grid_of
from dynkit.analysis.dimension.counting import Counts
from dynkit.analysis.dimension.drift import drift_of
from dynkit.analysis.dimension.errors import counting_errors, standard_errors
from dynkit.analysis.dimension.sums import CorrelationSums
from dynkit.core.reprs import span
from dynkit.core.validation import Array

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
        `dynkit.analysis.dimension.drift.drift_of`. Sets with wide gaps, such as attractors that
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
