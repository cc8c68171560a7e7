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

# A marker larger than _DOT, in points, is a symbol. A name that covers a symbol counts as if it
# covered _SYMBOL dots.
_DOT, _SYMBOL = 1.5, 50
_NAME = "name beside a curve"
"""Group of the texts that `write_names` has written (`gid` of matplotlib)."""


def write_names(axes: Axes, marks: list[tuple[Array, str]], size: float) -> None:
    """Write names of a size in points, each beside one of its points (k, 2), without overlaps.

    Names without room within the current limits of the axes are left out; the others are placed
    where they cover the least of the curves, the first point before the second. Names that were
    written before are placed anew.
    """
    from matplotlib.figure import Figure
    from matplotlib.patheffects import withStroke

    old: list[Any] = [written for written in axes.texts if written.get_gid() == _NAME]
    marks = [(written.marked, written.get_text()) for written in old] + marks
    for written in old:
        written.remove()
    figure = axes.get_figure(root=True)
    assert isinstance(figure, Figure)
    figure.draw_without_rendering()
    frame = axes.get_window_extent()
    point = figure.dpi / 72.0
    taken: list[Any] = [text.get_window_extent() for text in axes.texts]
    if (legend := axes.get_legend()) is not None:
        taken.append(legend.get_window_extent())
    curves = _drawn(axes, point)
    curves = curves[np.argsort(curves[:, 0])]
    for points, name in marks:
        pixels = axes.transData.transform(points)
        seen = [axes.contains_point(pixel) for pixel in pixels]
        if not any(seen):
            continue
        (first, *_), (corner, *_) = points[seen].tolist(), pixels[seen]
        best: Any = None
        text: Any = axes.annotate(
            name,
            first,
            xytext=(0, 0),
            textcoords="offset points",
            fontsize=size,
            zorder=4.0,
            path_effects=[withStroke(linewidth=0.2 * size, foreground=ink(1.0))],
            gid=_NAME,
        )
        text.marked = points
        places = [(size * x_off, size * y_off) for x_off, y_off in _PLACES]
        boxes = [_moved(text, place).padded(0.5 * point) for place in places]
        for xy, way in zip(map(tuple, points[seen].tolist()), pixels[seen] - corner, strict=True):
            for place, at_first in zip(places, boxes, strict=True):
                box = at_first.translated(*way)
                inside = frame.count_contains(box.corners()) == 4
                if inside and not any(box.overlaps(other) for other in taken):
                    near = slice(*np.searchsorted(curves[:, 0], [box.x0, box.x1]).tolist())
                    covered = box.count_contains(curves[near])
                    if best is None or covered < best[0]:
                        best = covered, xy, place
        if best is None:
            text.remove()
        else:
            _, text.xy, place = best
            taken.append(_moved(text, place).padded(0.5 * point))


def _moved(text: Annotation, place: tuple[float, float]) -> Any:
    """Move a text to an offset from its point, and return its box."""
    text.set_position(place)
    text.set_horizontalalignment("left" if place[0] > 0 else "right" if place[0] < 0 else "center")
    return text.get_window_extent()


def _drawn(axes: Axes, point: float) -> Array:
    """Return positions (k, 2) in pixels of markers, and of points along the drawn curves.

    The points on curves are one typographic point apart.
    """
    parts = [np.empty((0, 2))]
    for line in axes.lines:
        xy = axes.transData.transform(np.asarray(line.get_xydata()))
        if line.get_linestyle() == "None":
            symbols = line.get_markersize() > _DOT
            parts.append(np.repeat(xy, _SYMBOL if symbols else 1, axis=0))
            continue
        broken = np.isnan(xy).any(axis=1)
        for run in np.split(xy, np.flatnonzero(broken)):
            part = run[~np.isnan(run).any(axis=1)]
            if len(part) > 1:
                way = np.append(0.0, np.cumsum(np.hypot(*np.diff(part, axis=0).T)))
                at = np.arange(0.0, way[-1], point)
                parts.append(np.column_stack([np.interp(at, way, column) for column in part.T]))
    return np.concatenate(parts)
