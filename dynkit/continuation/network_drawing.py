"""Figures of networks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.continuation.drawing import LINES
from dynkit.continuation.membership import Node, nodes_of
from dynkit.core.validation import Array
from dynkit.plotting.figures import COLUMN_WIDTH, circles, crosses, ink, print_style, shown_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation

    from dynkit.continuation.branch import Branch

_WIDTHS = {"stable": 0.9, "unstable": 0.6, "inadmissible": 0.4}
# In points: type, and how far from its point a name may stand, the best first.
_TYPE = 5.0
_PLACES = ((3, 2), (3, -6), (-3, 2), (-3, -6), (0, 4), (0, -8), (5, -2), (-5, -2))


@print_style()
def draw_branches(branches: Sequence[Branch], ax: Axes | None, observable: str | None) -> Axes:
    """Draw branches as `Network.plot` says."""
    if not branches:
        raise ValueError("network must have a branch to be drawn; got none")
    name = observable or branches[0].system.observables[0]
    axes = shown_axes(ax, 2.0 * COLUMN_WIDTH, 4.2)
    drawn: set[str] = set()
    marks: list[tuple[float, float, str]] = []
    others: list[tuple[float, float, str]] = []
    for branch in branches:
        nodes = nodes_of(branch)
        x, y = _values(branch, nodes, name)
        kinds = _kinds(branch, nodes)
        place = 0
        for kind, group in groupby(kinds):
            stop = place + len(list(group))
            drawn.add(kind)
            for column in y.T:
                axes.plot(
                    x[place : stop + 1],
                    column[place : stop + 1],
                    **_line(kind),
                )
            place = stop
        marks += _marks(nodes, x, y, admissible=True)
        others += _marks(nodes, x, y, admissible=False)
    for kind in LINES:
        if kind in drawn:
            axes.plot([], [], label=kind, **_line(kind))
    marks = sorted(set(marks))
    for entries, style in ((sorted(set(others)), crosses(1.8, 0.3)), (marks, circles(1.8, 0.4))):
        at = [x for x, _, _ in entries], [y for _, y, _ in entries]
        axes.plot(*at, label="_", zorder=3.0, **style)
    axes.set_xlabel(branches[0].name.replace("_", " "))
    axes.set_ylabel(name.replace("_", " "))
    write_names(axes, marks)
    return axes


def _line(kind: str) -> dict[str, Any]:
    return {"linestyle": LINES[kind], "linewidth": _WIDTHS[kind], "color": ink()}


def _values(branch: Branch, nodes: list[Node], name: str) -> tuple[Array, Array]:
    """Parameter (k,) and observable (k, n) at the nodes."""
    rows = branch.observable(name)
    x = [branch.parameter[int(place)] if b is None else b.value for place, b in nodes]
    y = [rows[int(place)] if b is None else b.orbit.observable(name) for place, b in nodes]
    return np.array(x), np.array(y)


def _kinds(branch: Branch, nodes: list[Node]) -> list[str]:
    """How the stretch after each node but the last is drawn.

    As the point before it or after it; not as one that is itself a bifurcation.
    """
    last = len(branch) - 1
    critical = {place for place, bifurcation in nodes if bifurcation is not None}
    kinds = []
    for (place, bifurcation), _ in pairwise(nodes):
        i = min(max(math.floor(place), 0), last)
        if bifurcation is not None or place in critical:
            i = min(max(math.floor(place) + 1, 0), last)
        if not branch.admissible[i]:
            kinds.append("inadmissible")
        else:
            kinds.append("stable" if branch.stable[i] else "unstable")
    return kinds


def _marks(
    nodes: list[Node], x: Array, y: Array, *, admissible: bool
) -> list[tuple[float, float, str]]:
    """Bifurcations of motions of the system, or those of none: where, and of what kind."""
    found = []
    for i, (_, bifurcation) in enumerate(nodes):
        if bifurcation is None or (bifurcation.kind == "BP" and i in (0, len(nodes) - 1)):
            continue  # where a branch ends on another one, the bifurcation is the other one's
        if bifurcation.admissible == admissible:
            found.append((float(x[i]), float(y[i].max()), bifurcation.kind))
    return found


def write_names(axes: Axes, marks: list[tuple[float, float, str]]) -> None:
    """Write names beside their points, where they touch neither one another nor another point.

    Points are given as (x, y, name). Names that have no room within the limits that the axes have
    by now are left out; the others cover as little of the curves as they can.
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
    curves = _drawn(axes, frame, point)
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
            corners = np.array([[box.x0, box.y0], [box.x1, box.y1]])
            inside = frame.x0 <= box.x0 and box.x1 <= frame.x1
            inside = inside and frame.y0 <= box.y0 and box.y1 <= frame.y1
            if inside and not any(box.overlaps(other) for other in taken):
                covered = ((curves > corners[0]) & (curves < corners[1])).all(axis=1)
                free.append((int(covered.sum()), place))
        if free:
            _, place = min(free, key=lambda entry: entry[0])
            taken.append(_moved(text, place).padded(0.5 * point))
        else:
            text.remove()


def _moved(text: Annotation, place: tuple[int, int]) -> Any:
    """The box of a text that is moved to a place beside its point."""
    text.set_position(place)
    text.set_horizontalalignment("left" if place[0] > 0 else "right" if place[0] < 0 else "center")
    return text.get_window_extent()


def _drawn(axes: Axes, frame: Any, point: float) -> Array:
    """Where curves are drawn: places (k, 2) in pixels, a point of type apart."""
    parts = [np.empty((0, 2))]
    for line in axes.lines:
        xy = axes.transData.transform(np.asarray(line.get_xydata()))
        if line.get_linestyle() == "None" or len(xy) < 2:
            continue
        way = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))
        at = np.arange(0.0, way[-1], point)
        parts.append(np.column_stack([np.interp(at, way, column) for column in xy.T]))
    places = np.concatenate(parts)
    low, high = (frame.x0, frame.y0), (frame.x1, frame.y1)
    return np.asarray(places[((places > low) & (places < high)).all(axis=1)])
