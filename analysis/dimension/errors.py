"""Standard errors of linear functions of the logarithm of a correlation sum.

Neighbouring radii share most of their pairs, and pairs share successive states. Therefore whole
curves are resampled over blocks of time. If m_a is the number of times that block a is drawn, the
curve becomes

    ln C*(r) = ln C(r) + sum_a (m_a - 1) shares_a(r) / pairs(r)

to first order. A linear function of ln C then has the variance sum_a (g_a - mean g)^2 over
infinitely many resamples, where g_a is the share of block a: no resample has to be drawn.

Each pair belongs to two blocks, so that the variance of independent counts is included twice: it is
subtracted once, and is a lower bound. Blocks are too short when the variance grows, as pairs of
blocks are joined, by more than the standard error of a variance over this number of blocks: then
the joined blocks are used.
"""

from __future__ import annotations

import numpy as np

from dynkit.analysis.dimension.counting import Counts
from dynkit.core.validation import Array

_FEWEST = 16  # least number of blocks for a variance
_LAGS = 500  # largest number of lags that are counted


def standard_errors(pairs: Counts, shares: Counts, weights: Array) -> Array:
    """Return the standard errors, (w,), of ``weights @ log(pairs)``.

    Parameters
    ----------
    pairs : (k,) array of int
        Positive counts.
    shares : (b, k) array of int
        As in `CorrelationSums`.
    weights : (w, k) array

    Returns
    -------
    (w,) array
        NaN when there are fewer than 16 blocks.

    References
    ----------
    H. R. Kuensch, Ann. Statist. 17 (1989) 1217-1241: blocks. W. Hoeffding, Ann. Math. Statist. 19
    (1948) 293-325: means over pairs. H. Flyvbjerg, H. G. Petersen, J. Chem. Phys. 91 (1989)
    461-466: blocks that are joined.
    """
    groups = (shares / pairs) @ weights.T
    scatter = _variances(groups) if len(groups) >= _FEWEST else np.full(len(weights), np.nan)
    while len(groups) >= 2 * _FEWEST:
        half = len(groups) // 2
        groups = groups[: 2 * half].reshape(half, 2, -1).sum(axis=1)
        joined = _variances(groups)
        scatter = np.where(joined > (1.0 + np.sqrt(2.0 / half)) * scatter, joined, scatter)
    own = counting_errors(pairs, weights) ** 2
    return np.asarray(np.sqrt(np.maximum(scatter - own, own)))


def counting_errors(pairs: Counts, weights: Array) -> Array:
    """Return the standard errors, (w,), for independent pairs: lower bounds."""
    # a pair counts at its distance and at all larger radii
    reach = np.cumsum((weights / pairs)[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(np.sqrt(reach**2 @ np.append(pairs[:1], pairs[1:] - pairs[:-1])))


def error_by_lags(
    pairs: Counts,
    weights: Array,
    radii: Array,
    points: Array,
    turns: Array,
    lags: Counts,
    *,
    euclidean: bool,
) -> float:
    """Return the standard error of ``weights @ log(pairs)`` where lags in time are independent.

    In quasi-periodic motion all pairs of one lag have similar distances: there are as many
    independent counts as lags, and blocks of time, which contain all lags, hardly differ.

    Parameters
    ----------
    pairs, weights, radii : (k,) arrays
    points, turns : (n, d) and (d,) arrays
        As for `dynkit.analysis.dimension.counting.count`.
    lags : (m,) array of int
        All lags that count. If there are more than 500, a random choice represents them.
    euclidean : bool
    """
    from dynkit.analysis.dimension.correlation_kernels import count_of_lag

    chosen = np.random.default_rng(0).permutation(lags)[:_LAGS]
    edges = radii * radii if euclidean else np.ascontiguousarray(radii)
    total, counts = 0.0, np.empty(len(radii), dtype=np.int64)
    for lag in chosen.tolist():
        count_of_lag(points, lag, turns, euclidean, edges, counts)
        total += float(np.cumsum(counts) / pairs @ weights) ** 2
    return float(np.sqrt(total * len(lags) / len(chosen)))


def _variances(groups: Array) -> Array:
    """Return the variances, (w,), of sums over blocks of their contributions, (b, w)."""
    count = len(groups)
    apart = groups - groups.sum(axis=0) / count
    return np.asarray((apart * apart).sum(axis=0) * (count / (count - 1)))
