"""Comparison of found impacts with exact ones: matching and errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.methods import FoundImpacts
from dynkit.core.validation import Array

NEAR = 0.05
"""Largest distance of a found impact from its exact one, relative to the period."""


@final
@dataclass(frozen=True)
class Comparison:
    """Comparison of one simulation with exact impacts.

    Parameters
    ----------
    impacts : int
        Number of exact impacts and releases.
    missed, invented : int
        Number of exact impacts and releases that were not found, and of found ones that do not
        exist.
    error : float
        Largest error of those that were found; 0 if there are none.
    """

    impacts: int
    missed: int
    invented: int
    error: float

    @property
    def right(self) -> bool:
        """Whether no impact is missed and none invented."""
        return not (self.missed or self.invented)


def compare(found: FoundImpacts, exact: ExactImpacts) -> Comparison:
    """Compare found impacts and releases with exact ones, up to the end of the exact ones.

    Found and exact ones are matched in the order of time, one to one, at distances up to `NEAR` of
    the period: first as many as possible, then as near as possible.
    """
    times, near = found.times, NEAR * exact.period
    ours, theirs = matched(times, exact.times, near)
    errors = exact.errors(times[ours], found.positions[ours], found.velocities[ours], theirs)
    let, go = matched(found.releases, exact.releases, near)
    late = exact.lateness(found.releases[let], go)
    wrong = (times <= exact.until) & ~_within(times, exact.chatters)
    wrong[ours] = False
    early = found.releases <= exact.until
    early[let] = False
    return Comparison(
        len(exact.times) + len(exact.releases),
        len(exact.times) - len(theirs) + len(exact.releases) - len(go),
        int(wrong.sum()) + int(early.sum()),
        max(float(errors.max(initial=0.0)), float(late.max(initial=0.0))),
    )


def matched(found: Array, exact: Array, near: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Match two ascending lists of times; return the places of the pairs in both.

    Parameters
    ----------
    found, exact : (k,), (n,)
    near : float
        Largest distance of a pair.

    Examples
    --------
    >>> matched(np.array([1.0, 1.9, 3.1]), np.array([0.9, 3.0, 4.0]), 0.2)
    (array([0, 2]), array([0, 1]))
    """
    from scipy.optimize import linear_sum_assignment

    apart = abs(found[:, None] - exact)
    # a pair reduces the sum by more than all distances increase it: the number of pairs is largest
    saved = near * (1.0 + min(apart.shape))
    ours, theirs = linear_sum_assignment(np.where(apart <= near, apart - saved, 0.0))
    paired = apart[ours, theirs] <= near
    # pairs in the order of time have the smallest largest distance
    return ours[paired], np.sort(theirs[paired])


def _within(times: Array, intervals: Array) -> NDArray[np.bool_]:
    inside = (intervals[:, :1] <= times) & (times <= intervals[:, 1:])
    return np.asarray(inside.any(axis=0))
