"""Names beside points of a figure, placed where they have room."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.plotting.figures import ink

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation

# Offsets of a name from its point, in sizes of the type, the best first.
_PLACES = (
    *((0.6, 0.4), (0.6, -1.2), (-0.6, 0.4), (-0.6, -1.2)),
    *((0.0, 0.8), (0.0, -1.6), (1.0, -0.4), (-1.0, -0.4)),
)


def write_names(axes: Axes, marks: list[tuple[float, float, str]], size: float) -> None:
    """Write names of a size in points beside their points (x, y, name), without overlaps.

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
            fontsize=size,
            zorder=4.0,
            path_effects=[withStroke(linewidth=0.2 * size, foreground=ink(1.0))],
        )
        free = []
        for x_off, y_off in _PLACES:
            place = (size * x_off, size * y_off)
            box = _moved(text, place).padded(0.5 * point)
            inside = frame.count_contains(box.corners()) == 4
            if inside and not any(box.overlaps(other) for other in taken):
                free.append((box.count_contains(curves), place))
        if free:
            _, place = min(free, key=lambda entry: entry[0])
            taken.append(_moved(text, place).padded(0.5 * point))
        else:
            text.remove()


def _moved(text: Annotation, place: tuple[float, float]) -> Any:
    """Move a text to an offset from its point, and return its box."""
    text.set_position(place)
    text.set_horizontalalignment("left" if place[0] > 0 else "right" if place[0] < 0 else "center")
    return text.get_window_extent()


def _drawn(axes: Axes, point: float) -> Array:
    """Return positions (k, 2) in pixels along all drawn curves, a typographic point apart."""
    parts = [np.empty((0, 2))]
    for line in axes.lines:
        if line.get_linestyle() == "None":
            continue
        xy = axes.transData.transform(np.asarray(line.get_xydata()))
        broken = np.isnan(xy).any(axis=1)
        for run in np.split(xy, np.flatnonzero(broken)):
            part = run[~np.isnan(run).any(axis=1)]
            if len(part) > 1:
                way = np.append(0.0, np.cumsum(np.hypot(*np.diff(part, axis=0).T)))
                at = np.arange(0.0, way[-1], point)
                parts.append(np.column_stack([np.interp(at, way, column) for column in part.T]))
    return np.concatenate(parts)
