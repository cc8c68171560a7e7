"""Figures of branches, networks, and curves of bifurcations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.continuation.bifurcations.kinds import KINDS
from dynkit.continuation.results.lines import Line, curves_of
from dynkit.core.validation import Array
from dynkit.orbits.kinds import BifurcationKind
from dynkit.plotting.figures import (
    COLUMN_WIDTH,
    colour,
    ink,
    open_symbols,
    print_style,
    shown_axes,
)
from dynkit.plotting.names import write_names
from dynkit.plotting.points import axis_title, without_rounding

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINES: dict[str, Any] = {"stable": "-", "unstable": (0, (4, 2)), "inadmissible": (0, (1, 1.5))}
"""Line styles of orbits."""

_WIDTHS = {"stable": 1.0, "unstable": 0.7, "inadmissible": 0.9}
_TYPE = 7.0
"""Size of names, in points."""
# In a figure with more bifurcations than this the symbols are smaller.
_MANY = 100
# Fractions of a curve's length at which its name may be written, the best first.
_FRACTIONS = (0.5, 0.4, 0.6, 0.25, 0.75, 0.1, 0.9)


@print_style()
def draw_branches(
    lines: Sequence[Line], ax: Axes | None, width: float = COLUMN_WIDTH, height: float = 2.6
) -> Axes:
    """Draw branches; see `Branch.plot`. A new figure has this size in inches."""
    axes = shown_axes(ax, width, height)
    known = set(axes.get_legend_handles_labels()[1])
    curves = curves_of(lines)
    for number, (kind, style) in enumerate(LINES.items()):
        if kind in curves:
            look = {"linestyle": style, "linewidth": _WIDTHS[kind], "color": colour(number)}
            axes.plot(*curves[kind], label="_" if kind in known else kind, **look)
    without_rounding(axes)
    marks: dict[tuple[bool, BifurcationKind], list[tuple[float, float]]] = {}
    for line in lines:
        for b, x, row in line.marks():
            marks.setdefault((b.admissible, b.kind), []).extend((x, y) for y in row)
    shrunk = 0.6 if sum(map(len, marks.values())) > _MANY else 1.0
    for (admissible, kind), places in sorted(
        marks.items(), key=lambda one: (not one[0][0], one[0][1])
    ):
        name = kind.value if admissible else f"({kind})"
        size, edge = (3.5, ink()) if admissible else (3.0, ink(0.55))
        look = open_symbols(KINDS[kind].marker, shrunk * size, shrunk * 0.6, edge)
        label = "_" if name in known else name
        axes.plot(*zip(*places, strict=True), label=label, zorder=3.0 + admissible / 2, **look)
    for way, title in zip("xy", lines[0].names, strict=True):
        axes.set(**{f"{way}label": axis_title(title)})
    axes.legend(loc="best", frameon=True, framealpha=0.8, edgecolor="none", borderpad=0.2)
    named = [(stretch, line.label) for line in lines if len(stretch := _longest(line, axes))]
    named.sort(key=lambda one: -float(np.ptp(one[0][:, 0])))
    write_names(axes, [(_along(*points.T), name) for points, name in named], _TYPE)
    return axes


def _longest(line: Line, axes: Axes) -> Array:
    """Return points (k, 2) of the widest stretch inside the axes, of stable orbits if possible."""
    low, high = sorted(axes.get_xlim())
    floor, ceiling = sorted(axes.get_ylim())
    best, rank = np.empty((0, 2)), (-len(LINES), -1.0)
    for kind, x, rows in line.stretches():
        for y in rows.T:
            inside = (low <= x) & (x <= high) & (floor <= y) & (y <= ceiling)
            points = np.column_stack([x, y])[inside]
            own = (-list(LINES).index(kind), float(np.ptp(points[:, 0]))) if len(points) else rank
            if own > rank:
                best, rank = points, own
    return best


def _along(x: Array, y: Array) -> Array:
    """Return the points (k, 2) at `_FRACTIONS` of the length of a drawn curve."""
    steps = np.hypot(np.diff(x) / (np.ptp(x) or 1.0), np.diff(y) / (np.ptp(y) or 1.0))
    way = np.append(0.0, np.cumsum(steps))
    at = way[-1] * np.array(_FRACTIONS)
    return np.column_stack([np.interp(at, way, x), np.interp(at, way, y)])


@print_style()
def draw_curve(kind: BifurcationKind, parameters: Mapping[str, Array], ax: Axes | None) -> Axes:
    """Draw a curve of bifurcations; see `BifurcationCurve.plot`."""
    axes = shown_axes(ax)
    x, y = parameters.values()
    axes.plot(x, y, linestyle=KINDS[kind].line, label=kind, color=ink(), linewidth=0.9)
    for way, title in zip("xy", parameters, strict=True):
        axes.set(**{f"{way}label": axis_title(title)})
    write_names(axes, [(_along(x, y), kind)], _TYPE)
    return axes
