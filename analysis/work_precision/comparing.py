"""Found impacts beside exact ones: which belong together, and how far they are apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.methods import FoundImpacts
from dynkit.core.validation import Array

NEAR = 0.05
"""Part of the period within which a found impact may be an exact one."""


@final
@dataclass(frozen=True)
class Comparison:
    """What was right and wrong in one simulation.

    Parameters
    ----------
    impacts : int
        Exact impacts and releases.
    missed, invented : int
        Exact ones that were not found; found ones that are none.
    error : float
        Largest error of those that were found, 0 without any.
    """

    impacts: int
    missed: int
    invented: int
    error: float

    @property
    def right(self) -> bool:
        """Whether none is missed and none invented."""
        return not (self.missed or self.invented)


def compare(found: FoundImpacts, exact: ExactImpacts) -> Comparison:
    """Compare found impacts and releases with exact ones, up to the end of these.

    Found and exact ones are matched in the order of time, each with one at most, none with one that
    is further away than `NEAR` of the period: as many as possible of them, then as near as
    possible.
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
        No pair is further apart.

    Examples
    --------
    >>> matched(np.array([1.0, 1.9, 3.1]), np.array([0.9, 3.0, 4.0]), 0.2)
    (array([0, 2]), array([0, 1]))
    """
    from scipy.optimize import linear_sum_assignment

    apart = abs(found[:, None] - exact)
    # a pair saves more than all distances together cost: pairs are as many as can be
    saved = near * (1.0 + min(apart.shape))
    ours, theirs = linear_sum_assignment(np.where(apart <= near, apart - saved, 0.0))
    paired = apart[ours, theirs] <= near
    # in the order of time no pair is further apart than in any other
    return ours[paired], np.sort(theirs[paired])


def _within(times: Array, intervals: Array) -> NDArray[np.bool_]:
    inside = (intervals[:, :1] <= times) & (times <= intervals[:, 1:])
    return np.asarray(inside.any(axis=0))
