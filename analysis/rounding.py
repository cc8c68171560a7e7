"""Effects of rounding on the logarithms of stretching along the motion of a map."""

from __future__ import annotations

import numpy as np

from dynkit.analysis.averages import LEAST
from dynkit.core.no_motion import NoMotion
from dynkit.core.smooth_map import SmoothMap, generic_direction
from dynkit.core.stretching import Stretching
from dynkit.core.validation import Array

_MATCHES = 32
"""Number of rows that agree before the states themselves are compared."""

_AROUND = 16
"""Number of iterates whose largest coordinates are the sizes of disturbances."""

_ROUNDINGS = 8.0 * 2.0**-52
"""Least error of an iterate, relative to a coordinate: a call has several roundings."""


def distinct_iterates(system: SmoothMap, state: Array, logs: Array) -> int:
    """Return the number of logarithms (n, d) before a motion with growing disturbances repeats.

    In exact arithmetic a motion whose disturbances grow does not return to its own states. Rounding
    makes it return, soonest in one dimension and where the map is flat. Later iterates then add no
    information to an average. All n count if the motion does not repeat itself bit by bit, or if it
    has fewer than 128 different states, because it is then on an unstable periodic orbit.

    Parameters
    ----------
    system : SmoothMap
    state : (d,) array
        The state after the last iterate.
    logs : (n, d) array
    """
    count = len(logs)
    periods = np.arange(1, (count - _MATCHES) // 2 + 1)
    for row in range(count - 1, count - 1 - _MATCHES, -1):
        periods = periods[(logs[row - periods] == logs[row]).all(axis=1)]
    for period in periods[:1].tolist():
        if logs[-period:, 0].sum() > 0.0 and (system.iterate(state, period)[-1] == state).all():
            others = np.flatnonzero((logs[period:] != logs[:-period]).any(axis=1))
            first = period + (int(others[-1]) + 1 if len(others) else 0)
            return first if first >= LEAST else count
    return count


def rounding_of(system: SmoothMap, found: Stretching, iterates: int) -> Array:
    """Return errors (d,) of average logarithms of a stable motion, from rounding of its states.

    A disturbance of one state changes the logarithms of all later iterates. The error of every
    iterate is such a disturbance: the map's `accuracy` of each coordinate, at least eight
    roundings. The changes are computed to first order from a run that starts at a state disturbed
    in a generic direction. The errors are infinite if this run ends.

    Parameters
    ----------
    system : SmoothMap
    found : Stretching
        Stretching of the motion; the runs start at its end.
    iterates : int
        Number of iterates in which the disturbance decays.
    """
    state, part = found.state, np.sqrt(max(system.accuracy, _ROUNDINGS))
    try:
        sizes = abs(system.iterate(state, _AROUND)).max(axis=0)
        moved = state + part * sizes * np.sqrt(len(state)) * generic_direction(len(state))
        near, far = (
            system.stretching(start, iterates, np.array(found.frame)).logs
            for start in (state, moved)
        )
    except NoMotion:
        return np.full(found.logs.shape[1], np.inf)
    with np.errstate(invalid="ignore"):
        changes = np.nan_to_num(abs(far - near), posinf=0.0).sum(axis=0)
    return np.asarray(part * changes)
