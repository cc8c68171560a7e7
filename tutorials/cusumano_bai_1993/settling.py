"""How a motion settles: slowly and geometrically, or late."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from dynkit.systems import ImpactChain, ImpactRecord, ImpactState
from tutorials.cusumano_bai_1993.arrays import Array

# Distances between these, relative, show the decay: below what begins it, above rounding.
_BEGIN, _END = 1e-2, 1e-10

# Impacts that recur before a motion is said to do so.
_SHOWN = 20

RECURS = 1e-4
"""A settled motion recurs this well, relative."""

NEAR, FAR = 1e-9, 1e-3
"""How far motions are apart at first, and when they have parted."""


@dataclass(frozen=True)
class Settling:
    """How a motion with sticking settles on the periodic one.

    Parameters
    ----------
    periods : int
        Table periods in a period of the motion.
    ratio : float
        Of the distances before and after one period.
    count : int
        Sticking events that the ratio was fitted to.
    impacts, turns : float
        Impacts, and table periods, from one sticking event to the next, on average.
    after : (k,) array
        Numbers of the first impacts after each sticking event.
    distances : (k,) array
        Distance of each event to the last one, over the largest state.
    times : (n,) array
        Times of all impacts, in table periods.
    """

    periods: int
    ratio: float
    count: int
    impacts: float
    turns: float
    after: Array
    distances: Array
    times: Array

    def table_periods(self, impacts: int) -> float:
        """Table periods that so many impacts last."""
        return float(self.times[impacts - 1])

    def events(self, impacts: int) -> int:
        """Sticking events during so many impacts."""
        return int(np.searchsorted(self.after, impacts))

    def distance(self, impacts: int) -> float:
        """Distance to the periodic motion at the first sticking event after so many impacts."""
        return float(self.distances[np.searchsorted(self.after, impacts)])


def settling_of(record: ImpactRecord, *, periods: int) -> Settling:
    """Return how the motion settles that sticks once in a number of table periods."""
    turns = record.time * record.system.frequency / (2.0 * pi)
    released = record.sticking[np.isfinite(record.sticking[:, 1]), 1]
    after = np.searchsorted(record.time, released)
    after = after[after < len(record)]
    states = record.states[after, :-1]
    scale = float(np.linalg.norm(states, axis=1).max())
    # one event in so many table periods is one period of the motion
    per_period = round(periods / float(np.median(np.diff(turns[after]))))
    steps = np.linalg.norm(states[per_period:] - states[:-per_period], axis=1) / scale
    used = np.flatnonzero((steps < _BEGIN) & (steps > _END))
    slope = np.polyfit(used, np.log(steps[used]), 1)[0]
    return Settling(
        periods,
        float(np.exp(slope * per_period)),
        len(used),
        float(np.diff(after).mean()),
        float(np.diff(turns[after]).mean()),
        after.astype(np.float64),
        np.linalg.norm(states - states[-1], axis=1) / scale,
        turns,
    )


def impacts_until_settled(
    record: ImpactRecord, period: int, *, within: float = RECURS
) -> int | None:
    """Return after how many impacts the motion recurs for good with a period, in impacts.

    None when it does not by the end of the record, for 20 impacts and three periods at least.
    """
    states = record.states[:, :-1]
    scale = float(np.linalg.norm(states, axis=1).max())
    apart = np.linalg.norm(states[period:] - states[:-period], axis=1) / scale
    unsettled = np.flatnonzero(apart > within)
    first = int(unsettled[-1]) + 1 if len(unsettled) else 0
    return first if first + max(_SHOWN, 3 * period) <= len(apart) else None


def impacts_until_parted(
    chain: ImpactChain, state: ImpactState, *, limit: int = 3000
) -> int | None:
    """Return after how many impacts a motion that begins near to another is far from it.

    None when it is not within the limit.
    """
    here = chain.section_state(state)
    there = here.copy()
    there[0] += NEAR
    motions = [
        chain.simulate(impacts=limit, start=chain.impact_state(each)).states
        for each in (here, there)
    ]
    apart = np.linalg.norm(chain.difference(motions[1], motions[0]), axis=1)
    parted = np.flatnonzero(apart > FAR)
    return int(parted[0]) + 1 if len(parted) else None
