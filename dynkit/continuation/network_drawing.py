"""Figures of networks, black on white."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.continuation.drawing import LINES
from dynkit.continuation.trails import Node, nodes_of
from dynkit.sweeps.sweepable import sweepable
from dynkit.validation import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.continuation.branch import Branch

_WIDTHS = {"stable": 0.9, "unstable": 0.6, "inadmissible": 0.4}
_POINT: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 1.8,
    "markerfacecolor": "white",
    "markeredgecolor": "black",
    "markeredgewidth": 0.4,
    "zorder": 3.0,
}
# In points: type, and how far from its point a name may stand.
_TYPE, _PLACES = 5.0, ((3, 2), (3, -7), (-3, 2), (-3, -7), (0, 5), (0, -10))


def draw_branches(branches: Sequence[Branch], ax: Axes | None, observable: str | None) -> Axes:
    """Draw branches as `Network.plot` says."""
    if not branches:
        raise ValueError("network must have a branch to be drawn; got none")
    name = observable or sweepable(branches[0].system).observables[0]
    axes = _axes(ax)
    drawn: set[str] = set()
    marks: list[tuple[float, float, str]] = []
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
        marks += _marks(nodes, kinds, x, y)
    for kind in LINES:
        if kind in drawn:
            axes.plot([], [], label=kind, **_line(kind))
    marks = sorted(set(marks))
    axes.plot([x for x, _, _ in marks], [y for _, y, _ in marks], label="_", **_POINT)
    axes.set_xlabel(branches[0].name.replace("_", " "))
    axes.set_ylabel(name.replace("_", " "))
    write_names(axes, marks)
    return axes


def _line(kind: str) -> dict[str, Any]:
    return {"linestyle": LINES[kind], "linewidth": _WIDTHS[kind], "color": "black"}


def _values(branch: Branch, nodes: list[Node], name: str) -> tuple[Array, Array]:
    """Parameter (k,) and observable (k, n) at the nodes."""
    rows = branch.observable(name)
    x = [branch.parameter[int(place)] if b is None else b.value for place, b in nodes]
    y = [rows[int(place)] if b is None else b.orbit.observable(name) for place, b in nodes]
    return np.array(x), np.array(y)


def _kinds(branch: Branch, nodes: list[Node]) -> list[str]:
    """How the stretch after each node but the last is drawn: as the next point is, or this one."""
    last = len(branch) - 1
    kinds = []
    for (place, bifurcation), _ in pairwise(nodes):
        i = int(place) if bifurcation is None else min(max(int(np.ceil(place)), 0), last)
        if not branch.admissible[i]:
            kinds.append("inadmissible")
        else:
            kinds.append("stable" if branch.stable[i] else "unstable")
    return kinds


def _marks(
    nodes: list[Node], kinds: list[str], x: Array, y: Array
) -> list[tuple[float, float, str]]:
    """Bifurcations beside which motions of the system are: where, and of what kind."""
    found = []
    for i, (_, bifurcation) in enumerate(nodes):
        beside = kinds[max(i - 1, 0) : i + 1]
        if bifurcation is None or (bifurcation.kind == "BP" and i in (0, len(nodes) - 1)):
            continue  # where a branch ends on another one, the bifurcation is the other one's
        if any(kind != "inadmissible" for kind in beside):
            found.append((float(x[i]), float(y[i].max()), bifurcation.kind))
    return found


def write_names(axes: Axes, marks: list[tuple[float, float, str]]) -> None:
    """Write names beside their points, where they touch neither one another nor another point.

    Points are given as (x, y, name). Names that have no room within the limits that the axes have
    by now are left out.
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
    for (x, y, name), spot in zip(marks, places, strict=True):
        if not frame.contains(*spot):
            continue
        for right, up in _PLACES:
            text = axes.annotate(
                name,
                (x, y),
                xytext=(right, up),
                textcoords="offset points",
                fontsize=_TYPE,
                ha="left" if right > 0 else "right" if right < 0 else "center",
                zorder=4.0,
                path_effects=[withStroke(linewidth=1.0, foreground="white")],
            )
            box = text.get_window_extent().padded(0.5 * point)
            inside = frame.x0 <= box.x0 and box.x1 <= frame.x1
            inside = inside and frame.y0 <= box.y0 and box.y1 <= frame.y1
            if inside and not any(box.overlaps(other) for other in taken):
                taken.append(box)
                break
            text.remove()


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    from matplotlib import pyplot as plt

    return plt.subplots(figsize=(6.8, 4.2), layout="constrained")[1]
