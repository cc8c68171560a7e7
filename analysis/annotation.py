"""Labels above a diagram: selection and placement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.plotting.figures import ink, print_style, size_in_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# In points: font size, and distance of adjacent labels, written upwards and written level.
_TYPE, _PITCH, _LEVEL_PITCH = 6.0, 7.0, 10.0
# In heights of the axes: the bar, and the lower end of the labels.
_BAR, _FOOT = (1.01, 1.03), 1.08
# Least width of an interval with a label, in widths of the axes.
_NARROWEST = 0.012
# Largest distance of a label from the middle of its interval, in points.
_FARTHEST = 8.0


@final
@dataclass(frozen=True)
class LabelInterval:
    """Successive values of a sweep whose orbits have one label.

    Parameters
    ----------
    label : str
    low, high : float
        Smallest and largest of the values.
    count : int
        Number of values.
    """

    label: str
    low: float
    high: float
    count: int


def write_intervals(axes: Axes, intervals: Sequence[LabelInterval]) -> None:
    """Draw a bar of intervals above the axes, and label the widest ones.

    The widest intervals come first. Labels that would touch are moved apart, and a line leads from
    each to the middle of its interval; a label that would move others too far is left out.
    """
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    low, high = axes.get_xlim()
    ordered = sorted(intervals, key=lambda interval: interval.low)
    edges = _edges(ordered, low, high)
    bars = [
        Rectangle((left, _BAR[0]), right - left, _BAR[1] - _BAR[0])
        for left, right in zip(edges[:-1:2], edges[1::2], strict=False)
    ]
    place = axes.get_xaxis_transform()
    axes.add_collection(
        PatchCollection(bars, transform=place, clip_on=False, color=ink(), linewidth=0.0),
        autolim=False,
    )
    middles = 0.5 * (edges[1:] + edges[:-1])
    point = (high - low) / size_in_points(axes)[0]
    chosen: list[int] = []
    for i in np.argsort(-np.diff(edges), kind="stable").tolist():
        more = sorted([*chosen, i])
        moved = spread(middles[more], _PITCH * point) - middles[more]
        wide = edges[i + 1] - edges[i] >= _NARROWEST * (high - low)
        if wide and abs(moved).max() <= _FARTHEST * point:
            chosen = more
    _write(axes, [ordered[i].label for i in chosen], middles[chosen], _PITCH, 90.0)


@print_style()
def mark_values(axes: Axes, marks: Mapping[str, float]) -> None:
    """Write names above the axes at their values; values outside the axes are left out.

    Names that would touch are moved apart; a line leads from each name to its value.

    Parameters
    ----------
    axes : Axes
        Axes of a diagram over the parameter, with its final limits.
    marks : mapping of str to float
        Names, such as those of natural frequencies, and values of the parameter.

    Examples
    --------
    >>> from dynkit.plotting.figures import new_figure
    >>> _, (axes,) = new_figure()
    >>> _ = axes.set_xlim(0.0, 1.0)
    >>> mark_values(axes, {"$w_1$": 0.149, "$w_9$": 1.911})
    >>> [text.get_text() for text in axes.texts]
    ['$w_1$']
    """
    low, high = axes.get_xlim()
    there = sorted((value, name) for name, value in marks.items() if low <= value <= high)
    values = np.array([value for value, _ in there])
    _write(axes, [name for _, name in there], values, _LEVEL_PITCH, 0.0, begin=1.0)
    axes.vlines(
        values, 0.0, 1.0, transform=axes.get_xaxis_transform(), color=ink(0.85), lw=0.4, zorder=0
    )


def _write(
    axes: Axes,
    names: Sequence[str],
    at: Array,
    pitch: float,
    rotation: float,
    begin: float = _BAR[1],
) -> None:
    """Write names above the axes, a pitch (in points) or more apart, with lines to their values."""
    low, high = axes.get_xlim()
    place = axes.get_xaxis_transform()
    standing = spread(at, pitch * (high - low) / size_in_points(axes)[0])
    for name, x, text_x in zip(names, at.tolist(), standing.tolist(), strict=True):
        axes.plot(
            [x, text_x],
            [begin, _FOOT - 0.005],
            transform=place,
            clip_on=False,
            color=ink(),
            linewidth=0.3,
        )
        axes.text(
            text_x,
            _FOOT,
            name,
            transform=place,
            fontsize=_TYPE,
            fontfamily=axes.xaxis.label.get_fontfamily(),
            rotation=rotation,
            ha="center",
            va="bottom",
        )


def _edges(ordered: Sequence[LabelInterval], low: float, high: float) -> Array:
    """Return the edges of the intervals, (k + 1,), half-way between successive intervals."""
    inner = [0.5 * (left.high + right.low) for left, right in pairwise(ordered)]
    return np.asarray(np.clip([low, *inner, high], low, high))


def spread(wanted: Array, pitch: float) -> Array:
    """Return the places nearest to the wanted ones, in the least-squares sense, a pitch apart.

    Parameters
    ----------
    wanted : (k,) array
        Ascending.
    pitch : float

    Examples
    --------
    >>> spread(np.array([0.0, 1.0, 1.0, 5.0]), 1.0).tolist()
    [-0.3333333333333333, 0.6666666666666667, 1.6666666666666667, 5.0]
    """
    from scipy.optimize import isotonic_regression

    # after subtraction of the pitches the places must only ascend
    pitches = pitch * np.arange(len(wanted))
    return np.asarray(isotonic_regression(wanted - pitches).x + pitches)
