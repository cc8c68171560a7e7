"""Labels above a diagram: which intervals get one, and where it stands."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol

import numpy as np

from dynkit.validation import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# In points: the type, and the pitch of upright labels side by side.
_TYPE, _PITCH = 6.0, 7.0
# In heights of the axes: bar, and foot of the labels.
_BAR, _FOOT = (1.01, 1.03), 1.08
# An interval gets a label when it is at least so wide, in widths of the axes.
_NARROWEST = 0.006


class Interval(Protocol):
    """A label and where it holds."""

    @property
    def label(self) -> str:
        """What to write."""
        ...

    @property
    def low(self) -> float:
        """Where it begins to hold."""
        ...

    @property
    def high(self) -> float:
        """Where it ceases to hold."""
        ...


def write_intervals(axes: Axes, intervals: Sequence[Interval]) -> None:
    """Write a bar of intervals above the axes, and the labels of those wide enough.

    The widest intervals are labelled, as many as there is room for. Labels that would touch are
    moved apart; a line leads from each to the middle of its interval.
    """
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    low, high = axes.get_xlim()
    place = axes.get_xaxis_transform()
    ordered = sorted(intervals, key=lambda interval: interval.low)
    edges = _edges(ordered, low, high)
    bars = [
        Rectangle((left, _BAR[0]), right - left, _BAR[1] - _BAR[0])
        for left, right in zip(edges[:-1:2], edges[1::2], strict=False)
    ]
    axes.add_collection(
        PatchCollection(bars, transform=place, clip_on=False, color="black", linewidth=0.0),
        autolim=False,
    )
    middles = 0.5 * (edges[1:] + edges[:-1])
    widths = np.diff(edges) / (high - low)
    room = _width_in_points(axes) / _PITCH
    widest = np.argsort(-widths, kind="stable")[: int(room)]
    chosen = np.sort(widest[widths[widest] >= _NARROWEST])
    standing = spread(middles[chosen], (high - low) / room)
    for i, x in zip(chosen.tolist(), standing.tolist(), strict=True):
        axes.plot(
            [middles[i], x],
            [_BAR[1], _FOOT - 0.005],
            transform=place,
            clip_on=False,
            color="black",
            linewidth=0.3,
        )
        axes.text(
            x,
            _FOOT,
            ordered[i].label,
            transform=place,
            fontsize=_TYPE,
            fontfamily=axes.xaxis.label.get_fontfamily(),
            rotation=90.0,
            ha="center",
            va="bottom",
        )


def _edges(ordered: Sequence[Interval], low: float, high: float) -> Array:
    """Edges of the intervals, (k + 1,): half-way between one and the next."""
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
    # pool adjacent violators: less the pitches, the places only have to ascend
    blocks: list[list[float]] = []
    for offset in (wanted - pitch * np.arange(len(wanted))).tolist():
        blocks.append([offset, 1.0])
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            mean, weight = blocks.pop()
            before, count = blocks[-1]
            blocks[-1] = [(before * count + mean * weight) / (count + weight), count + weight]
    means = [mean for mean, weight in blocks for _ in range(int(weight))]
    return np.array(means, dtype=np.float64) + pitch * np.arange(len(wanted))


def _width_in_points(axes: Axes) -> float:
    from matplotlib.figure import Figure

    figure = axes.get_figure(root=True)
    assert isinstance(figure, Figure)
    figure.draw_without_rendering()
    return float(axes.get_window_extent().width) * 72.0 / figure.dpi
