"""Figures of branches and of curves of bifurcations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.continuation.kinds import KINDS
from dynkit.continuation.lines import Line
from dynkit.core.validation import Array
from dynkit.orbits.kinds import BifurcationKind
from dynkit.plotting.figures import circles, crosses, ink, print_style, shown_axes
from dynkit.plotting.names import write_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINES: dict[str, Any] = {"stable": "-", "unstable": (0, (4, 2)), "inadmissible": (0, (1, 1.5))}
"""Line styles of orbits."""

_TEXT: dict[str, Any] = {
    "textcoords": "offset points",
    "xytext": (3.0, 3.0),
    "fontsize": 7.0,
    "zorder": 4.0,
}
# Labels closer than this fraction of the drawn range are joined.
_CLOSE = 0.04


@print_style()
def draw_branch(line: Line, ax: Axes | None) -> Axes:
    """Draw a branch; see `Branch.plot`."""
    axes = shown_axes(ax)
    runs: dict[str, list[tuple[Array, Array]]] = {}
    for kind, x, y in line.stretches():
        runs.setdefault(kind, []).append((x, y))
    for kind, parts in runs.items():
        for column in range(line.y.shape[1]):
            x = np.concatenate([np.append(part, np.nan) for part, _ in parts])
            y = np.concatenate([np.append(part[:, column], np.nan) for _, part in parts])
            label = kind if column == 0 else "_"
            axes.plot(x, y, linestyle=LINES[kind], label=label, color=ink(), linewidth=0.9)
    marks: list[tuple[str, float, float]] = []
    for b, x_place, row in sorted(line.marks(), key=lambda mark: not mark[0].admissible):
        look = circles(3.5, 0.7) if b.admissible else crosses(3.5, 0.5)
        axes.plot(np.full(len(row), x_place), row, label="_", zorder=3.0, **look)
        marks.append((b.kind if b.admissible else f"({b.kind})", x_place, float(row.max())))
    points = [i for i, (_, b) in enumerate(line.nodes) if b is None]
    name_axes(axes, line.names)
    merged = _merged(marks, np.ptp(line.x[points]), np.ptp(line.y[points]))
    write_names(axes, [(x, y, text) for text, x, y in merged], _TEXT["fontsize"])
    return axes


def name_axes(axes: Axes, names: Sequence[str]) -> None:
    """Set the titles of both axes, without underscores."""
    axes.set_xlabel(names[0].replace("_", " "))
    axes.set_ylabel(names[1].replace("_", " "))


def _merged(
    labels: list[tuple[str, float, float]], width: float, height: float
) -> list[tuple[str, float, float]]:
    """Return the labels; those that would overlap are joined."""
    merged: list[tuple[str, float, float]] = []
    for text, x, y in labels:
        for i, (other, u, v) in enumerate(merged):
            if abs(x - u) <= _CLOSE * width and abs(y - v) <= _CLOSE * height:
                merged[i] = (f"{other}, {text}", u, v)
                break
        else:
            merged.append((text, x, y))
    return merged


@print_style()
def draw_curve(kind: BifurcationKind, parameters: Mapping[str, Array], ax: Axes | None) -> Axes:
    """Draw a curve of bifurcations; see `BifurcationCurve.plot`."""
    axes = shown_axes(ax)
    x, y = parameters.values()
    axes.plot(x, y, linestyle=KINDS[kind].line, label=kind, color=ink(), linewidth=0.9)
    middle = _middle(x, y)
    axes.annotate(kind, (float(x[middle]), float(y[middle])), **_TEXT)
    name_axes(axes, list(parameters))
    return axes


def _middle(x: Array, y: Array) -> int:
    """Return the index of the point halfway along a drawn curve."""
    steps = np.hypot(np.diff(x) / (np.ptp(x) or 1.0), np.diff(y) / (np.ptp(y) or 1.0))
    way = np.append(0.0, np.cumsum(steps))
    return int(np.searchsorted(way, 0.5 * way[-1]))
