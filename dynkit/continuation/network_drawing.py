"""Figures of networks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.continuation.drawing import LINES, name_axes
from dynkit.continuation.lines import Line
from dynkit.core.validation import Array
from dynkit.plotting.figures import COLUMN_WIDTH, circles, crosses, ink, print_style, shown_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation

_WIDTHS = {"stable": 0.9, "unstable": 0.6, "inadmissible": 0.4}
# In points: font size, and offsets of a name from its point, the best first.
_TYPE = 5.0
_PLACES = ((3, 2), (3, -6), (-3, 2), (-3, -6), (0, 4), (0, -8), (5, -2), (-5, -2))


@print_style()
def draw_branches(lines: Sequence[Line], ax: Axes | None) -> Axes:
    """Draw branches; see `Network.plot`."""
    if not lines:
        raise ValueError("network must have a branch to be drawn; got none")
    axes = shown_axes(ax, 2.0 * COLUMN_WIDTH, 4.2)
    drawn: set[str] = set()
    marks: dict[bool, set[tuple[float, float, str]]] = {False: set(), True: set()}
    for line in lines:
        for kind, x, y in line.stretches():
            drawn.add(kind)
            for column in y.T:
                axes.plot(x, column, **_look(kind))
        for b, place, row in line.marks():
            marks[b.admissible].add((place, float(row.max()), b.kind))
    for kind in LINES:
        if kind in drawn:
            axes.plot([], [], label=kind, **_look(kind))
    for admissible, style in ((False, crosses(1.8, 0.3)), (True, circles(1.8, 0.4))):
        entries = sorted(marks[admissible])
        at = [x for x, _, _ in entries], [y for _, y, _ in entries]
        axes.plot(*at, label="_", zorder=3.0, **style)
    name_axes(axes, lines[0].names)
    write_names(axes, sorted(marks[True]))
    return axes


def _look(kind: str) -> dict[str, Any]:
    return {"linestyle": LINES[kind], "linewidth": _WIDTHS[kind], "color": ink()}


def write_names(axes: Axes, marks: list[tuple[float, float, str]]) -> None:
    """Write names beside their points (x, y, name), without overlaps.

    Names without room within the current limits of the axes are left out; the others are placed
    where they cover the least of the curves.
    """
    from matplotlib.figure import Figure
    from matplotlib.patheffects import withStroke
    from matplotlib.transforms import Bbox

    figure = axes.get_figure(root=True)
    assert isinstance(figure, Figure)
    figure.draw_without_rendering()
    frame = axes.get_window_extent()
    point = figure.dpi / 72.0
    places = [axes.transData.transform((x, y)) for x, y, _ in marks]
    taken: list[Any] = [
        Bbox.from_bounds(x - point, y - point, 2.0 * point, 2.0 * point) for x, y in places
    ]
    curves = _drawn(axes, point)
    for (x, y, name), spot in zip(marks, places, strict=True):
        if not frame.contains(*spot):
            continue
        text = axes.annotate(
            name,
            (x, y),
            xytext=(0, 0),
            textcoords="offset points",
            fontsize=_TYPE,
            zorder=4.0,
            path_effects=[withStroke(linewidth=1.0, foreground=ink(1.0))],
        )
        free = []
        for place in _PLACES:
            box = _moved(text, place).padded(0.5 * point)
            inside = frame.count_contains(box.corners()) == 4
            if inside and not any(box.overlaps(other) for other in taken):
                free.append((box.count_contains(curves), place))
        if free:
            _, place = min(free, key=lambda entry: entry[0])
            taken.append(_moved(text, place).padded(0.5 * point))
        else:
            text.remove()


def _moved(text: Annotation, place: tuple[int, int]) -> Any:
    """Move a text to an offset from its point, and return its box."""
    text.set_position(place)
    text.set_horizontalalignment("left" if place[0] > 0 else "right" if place[0] < 0 else "center")
    return text.get_window_extent()


def _drawn(axes: Axes, point: float) -> Array:
    """Return positions (k, 2) in pixels along all drawn curves, a typographic point apart."""
    parts = [np.empty((0, 2))]
    for line in axes.lines:
        xy = axes.transData.transform(np.asarray(line.get_xydata()))
        if line.get_linestyle() == "None" or len(xy) < 2:
            continue
        way = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))
        at = np.arange(0.0, way[-1], point)
        parts.append(np.column_stack([np.interp(at, way, column) for column in xy.T]))
    return np.concatenate(parts)
