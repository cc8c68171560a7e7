"""Standard errors of what is linear in the logarithm of a correlation sum.

Neighbouring radii share most of their pairs, and pairs share states that follow one another in
time. So whole curves are resampled, over blocks of time: with weights m_a that are drawn like the
numbers of times that each block is taken, the curve becomes

    ln C*(r) = ln C(r) + sum_a (m_a - 1) shares_a(r) / pairs(r)

to first order. What is linear in ln C then has the variance sum_a (g_a - mean g)^2 over infinitely
many resamples, g_a being the share of block a: no resample need be drawn.

Each pair has a part in two blocks, so that the pairs' own scatter, that of independent counts, is
counted twice: it is subtracted once, and never comes out below itself. Blocks are too short when
the variance grows as they are joined, two and two, by more than the standard error that a variance
over so many blocks has: then those that were joined are taken.
"""

from __future__ import annotations

import numpy as np

from dynkit.analysis.dimension.counting import Counts
from dynkit.core.validation import Array

_FEWEST = 16


def standard_errors(pairs: Counts, shares: Counts, weights: Array) -> Array:
    """Return the standard errors, (w,), of ``weights @ log(pairs)``.

    Parameters
    ----------
    pairs : (k,) array of int
        Above zero.
    shares : (b, k) array of int
        As for `CorrelationSums`.
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
    """Return what the standard errors, (w,), would be of independent pairs: they are no smaller."""
    # a pair counts at its distance and at all larger radii
    reach = np.cumsum((weights / pairs)[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(np.sqrt(reach**2 @ np.append(pairs[:1], pairs[1:] - pairs[:-1])))


def _variances(groups: Array) -> Array:
    """Variances, (w,), of sums over blocks of what each has, (b, w)."""
    count = len(groups)
    apart = groups - groups.sum(axis=0) / count
    return np.asarray((apart * apart).sum(axis=0) * (count / (count - 1)))
