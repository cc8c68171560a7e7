"""Angles among the coordinates of a map, extents of states, grids, and correlation times."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array

_DOUBLINGS = 64
# Largest deviation from a grid, relative to its step, and least ratio of this deviation to
# rounding. By chance 64 states or more do not lie so close to a grid.
_ALIKE, _FINER = 1e-3, 2.0**10


def angles_of(system: SmoothMap, states: Array) -> Mapping[int, float]:
    """Return the coordinates that a map's `difference` wraps, and one turn of each.

    They are found by trial: differences along each coordinate, longer and longer, until one is
    wrapped. The result is then compared with the map's differences of the states.

    Raises
    ------
    ValueError
        When differences do more than wrap single coordinates to the shortest way.
    """
    extents = np.ptp(states, axis=0)
    lengths = 2.0 ** (np.arange(_DOUBLINGS) - _DOUBLINGS + 3)
    origin = np.zeros(states.shape[1])
    angles = {}
    for k in np.flatnonzero(extents > 0.0).tolist():
        steps = np.zeros((_DOUBLINGS, len(origin)))
        steps[:, k] = lengths * extents[k]
        gone = steps[:, k] - system.difference(steps, origin)[:, k]
        # the first wrapped difference lies between half a turn and a whole one
        turns = gone[abs(gone) > 0.25 * steps[:, k]]
        if len(turns):
            angles[k] = 2.0 * np.pi if np.isclose(turns[0], 2.0 * np.pi, 1e-12) else float(turns[0])
    _compare(system, states, angles)
    return angles


def _compare(system: SmoothMap, states: Array, angles: Mapping[int, float]) -> None:
    later, earlier = states, np.roll(states, len(states) // 2, axis=0)
    expected = abs(later - earlier)
    for k, turn in angles.items():
        expected[:, k] %= turn
        expected[:, k] = np.minimum(expected[:, k], turn - expected[:, k])
    apart = abs(abs(system.difference(later, earlier)) - expected).max()
    if apart > 1e-9 * abs(states).max():
        raise ValueError(
            "source must be of a system whose difference only wraps coordinates; "
            f"got one that departs from that by {apart:.3g}"
        )


def extents_of(states: Array, angles: Mapping[int, float]) -> Array:
    """Return the largest distance of two states along each coordinate, (d,)."""
    extents = np.ptp(states, axis=0)
    for k, turn in angles.items():
        around = np.sort(states[:, k] % turn)
        # the states on either side of the opposite one
        opposite = (around + 0.5 * turn) % turn
        after = np.searchsorted(around, opposite)
        largest = 0.0
        for neighbour in (after - 1, after % len(around)):
            gap = abs(around - around[neighbour])
            largest = max(largest, float(np.minimum(gap, turn - gap).max()))
        extents[k] = largest
    return np.asarray(extents)


def grid_of(states: Array) -> float:
    """Return the widest grid to which a coordinate was rounded; zero where none was.

    A coordinate was rounded when it has three or more values whose differences are all integer
    multiples of the least difference, within rounding; unit and origin do not matter.
    """
    widest = 0.0
    for column in states.T:
        values = np.unique(column)
        rounding = np.finfo(float).eps * float(abs(column).max())
        gaps = np.diff(values)
        gaps = gaps[gaps > 4.0 * rounding]  # smaller gaps: one point of the grid, rounded twice
        if len(gaps) < 2 or (least := float(gaps.min())) < _FINER * rounding / _ALIKE:
            continue
        steps = gaps / least
        # the rounding of the least difference is multiplied in long gaps
        if (abs(steps - np.round(steps)) <= _ALIKE + 4.0 * rounding / least * steps).all():
            widest = max(widest, least)
    return widest


def correlation_time(states: Array, angles: Mapping[int, float]) -> int:
    """Return the first lag at which the autocorrelation of the states is below 1/e in size.

    Coordinates are weighted by their variance over the square of their extent; angles enter as sine
    and cosine. The lag is at most a twentieth of the number of states.
    """
    columns = []
    for k, column in enumerate(states.T):
        if k in angles:
            turned = 2.0 * np.pi / angles[k] * column
            columns += [np.cos(turned), np.sin(turned)]
        elif (extent := float(np.ptp(column))) > 0.0:
            columns.append(column / extent)
    n = len(states)
    longest = max(n // 20, 1)
    total = np.zeros(longest + 1)
    for column in columns:
        spectrum = np.fft.rfft(column - column.mean(), 2 * n)
        total += np.fft.irfft(abs(spectrum) ** 2)[: longest + 1]
    below = np.flatnonzero(abs(total) < total[0] / np.e)
    return int(below[0]) if len(below) else longest
