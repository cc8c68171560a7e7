"""Time series of motions for pages in the browser."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array

# Largest number of iterates of a map, and of returns of a flow to its section, that are shown of a
# motion without period.
_ITERATES, _RETURNS = 200, 20
# A short period is repeated up to this number of iterates.
_FEW = 24
_SAMPLES = 48
"""Samples of a flow from one return to the section to the next."""


@final
@dataclass(frozen=True, eq=False)
class Series:
    """A part of a motion, sampled.

    Parameters
    ----------
    times : (m,) array
        Ascending; numbers of iterates for a map.
    columns : mapping of str to (m,) array
        The coordinates, by name.
    shown : tuple of str
        Columns against time; the second one and later ones are dashed.
    portrait : (str, str)
        The two columns of the phase portrait.
    discrete : bool
        Whether the columns are states of a map, which are not joined by lines.
    marks : sequence of int
        Indices of the samples at impacts.
    machine : mapping
        The bodies of the animation: ``masses`` and ``stops``, in the form that the page's script
        reads; empty for a map or a flow.
    """

    times: Array
    columns: Mapping[str, Array]
    shown: tuple[str, ...]
    portrait: tuple[str, str]
    discrete: bool = False
    marks: Sequence[int] = ()
    machine: Mapping[str, Any] = field(default_factory=dict)


def series_of_states(system: SmoothMap, states: Array, *, periodic: bool = False) -> Series:
    """Return the motion through successive states, (n, d), of a map.

    A periodic motion is shown for one period, or for some short ones. For a Poincare map the motion
    of the flow between the states is shown.
    """
    paths = _paths(system, states[: None if periodic else _RETURNS])
    if paths:
        lasting = np.cumsum([0.0, *(times[-1] for times, _ in paths)])
        times = np.concatenate([t + t0 for (t, _), t0 in zip(paths, lasting, strict=False)])
        full = np.concatenate([columns for _, columns in paths])
        columns = {f"flow[{i}]": column for i, column in enumerate(full.T)}
        names = list(columns)
        return Series(times, columns, (names[0],), (names[0], names[min(1, len(names) - 1)]))
    n = len(states)
    shown = states[:_ITERATES]
    if periodic:
        shown = np.tile(states, (math.ceil(_FEW / n), 1))
    times = np.arange(float(len(shown)))
    columns = dict(system.coordinates(shown))
    first, *others = list(columns)
    if not others:
        following = np.append(shown[1:, 0], shown[0, 0] if periodic else np.nan)
        columns[f"next {first}"] = following
    return Series(times, columns, (first,), (first, list(columns)[1]), discrete=True)


def _paths(system: SmoothMap, states: Array) -> list[tuple[Array, Array]]:
    """Return times and states of the flow after each state, until the motion ends.

    The list is empty for a map that is not one of a flow.
    """
    found = []
    for state in states:
        try:
            path = system._path(state, _SAMPLES)
        except NoMotion:
            break
        if path is None:
            break
        found.append(path)
    return found
