"""Figures of networks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dynkit.continuation.drawing import LINES, name_axes
from dynkit.continuation.lines import Line
from dynkit.plotting.figures import COLUMN_WIDTH, circles, crosses, ink, print_style, shown_axes
from dynkit.plotting.names import write_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTHS = {"stable": 0.9, "unstable": 0.6, "inadmissible": 0.4}
_TYPE = 5.0
"""Size of names, in points."""


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
    write_names(axes, sorted(marks[True]), _TYPE)
    return axes


def _look(kind: str) -> dict[str, Any]:
    return {"linestyle": LINES[kind], "linewidth": _WIDTHS[kind], "color": ink()}
