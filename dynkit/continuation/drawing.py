"""Figures of branches and of curves of bifurcations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.plotting.figures import circles, crosses, ink, print_style, shown_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.continuation.branch import Branch
    from dynkit.continuation.curves import BifurcationCurve

LINES: dict[str, Any] = {"stable": "-", "unstable": (0, (4, 2)), "inadmissible": (0, (1, 1.5))}
"""How orbits are drawn."""

_CURVES: dict[str, Any] = {
    "SN": "-",
    "PD": (0, (5, 2)),
    "NS": (0, (5, 2, 1, 2)),
    "GR": (0, (3, 1.5)),
    "BP": (0, (5, 2, 1, 2, 1, 2)),
    "CB": (0, (9, 2)),
}
"""How curves of bifurcations are drawn: dots are left to inadmissible orbits."""
_TEXT: dict[str, Any] = {
    "textcoords": "offset points",
    "xytext": (3.0, 3.0),
    "fontsize": 7.0,
    "zorder": 4.0,
}
# Labels closer than this, in what is drawn, are put together.
_CLOSE = 0.04


@print_style()
def draw_branch(branch: Branch, ax: Axes | None, observable: str | None) -> Axes:
    """Draw a branch as `Branch.plot` says."""
    name = observable or branch.system.observables[0]
    axes = shown_axes(ax)
    values, parameter = branch.observable(name), branch.parameter
    marked = [(b, b.orbit.observable(name)) for b in branch.bifurcations]
    inserted = sorted((b.place, b.value, row) for b, row in marked)
    for kind, runs in _runs(branch, parameter, values, inserted).items():
        for column in range(values.shape[1]):
            x = np.concatenate([np.append(run[0], np.nan) for run in runs])
            y = np.concatenate([np.append(run[1][:, column], np.nan) for run in runs])
            label = kind if column == 0 else "_"
            axes.plot(x, y, linestyle=LINES[kind], label=label, color=ink(), linewidth=0.9)
    labels: list[tuple[str, float, float]] = []
    for bifurcation, row in marked:
        if bifurcation.kind == "BP" and not 0.0 <= bifurcation.place <= len(branch) - 1:
            continue  # where the branch ends on another one, whose bifurcation it is
        real = bifurcation.admissible
        axes.plot(
            np.full(len(row), bifurcation.value),
            row,
            label="_",
            zorder=3.0,
            **(circles(3.5, 0.7) if real else crosses(3.5, 0.5)),
        )
        text = bifurcation.kind if real else f"({bifurcation.kind})"
        labels.append((text, bifurcation.value, float(row.max())))
    for text, x_place, y_place in _merged(labels, np.ptp(parameter), np.ptp(values)):
        axes.annotate(text, (x_place, y_place), **_TEXT)
    axes.set_xlabel(_written(branch.name))
    axes.set_ylabel(_written(name))
    return axes


def _merged(
    labels: list[tuple[str, float, float]], width: float, height: float
) -> list[tuple[str, float, float]]:
    """Return labels of which those that would lie on one another are one."""
    merged: list[tuple[str, float, float]] = []
    for text, x, y in labels:
        for i, (other, u, v) in enumerate(merged):
            if abs(x - u) <= _CLOSE * width and abs(y - v) <= _CLOSE * height:
                merged[i] = (f"{other}, {text}", u, v)
                break
        else:
            merged.append((text, x, y))
    return merged


def _runs(
    branch: Branch, parameter: Array, values: Array, inserted: Sequence[tuple[float, float, Array]]
) -> dict[str, list[tuple[Array, Array]]]:
    """Return the parts of a branch that are drawn alike; bifurcations end them and begin others."""
    runs: dict[str, list[tuple[Array, Array]]] = {}
    place = 0
    x: list[float] = []
    y: list[Array] = []
    kind = _kind(branch, 0)

    def close() -> None:
        if len(x) > 1:
            runs.setdefault(kind, []).append((np.array(x), np.array(y)))

    for i in range(len(parameter) + 1):
        after = min(i, len(parameter) - 1)
        while place < len(inserted) and inserted[place][0] <= i:
            _, value, row = inserted[place]
            x.append(value)
            y.append(row)
            close()
            x, y, kind = [value], [row], _kind(branch, after)
            place += 1
        if i > after:
            break
        if _kind(branch, i) != kind:
            # no bifurcation was found in between: the change is drawn at the point before
            close()
            x, y, kind = x[-1:], y[-1:], _kind(branch, i)
        x.append(float(parameter[i]))
        y.append(values[i])
    close()
    return runs


def _kind(branch: Branch, place: int) -> str:
    if not branch.admissible[place]:
        return "inadmissible"
    return "stable" if branch.stable[place] else "unstable"


@print_style()
def draw_curve(curve: BifurcationCurve, ax: Axes | None) -> Axes:
    """Draw a curve of bifurcations as `BifurcationCurve.plot` says."""
    axes = shown_axes(ax)
    x, y = curve.parameters.T
    axes.plot(x, y, linestyle=_CURVES[curve.kind], label=curve.kind, color=ink(), linewidth=0.9)
    middle = _middle(x, y)
    axes.annotate(curve.kind, (float(x[middle]), float(y[middle])), **_TEXT)
    axes.set_xlabel(_written(curve.names[0]))
    axes.set_ylabel(_written(curve.names[1]))
    return axes


def _middle(x: Array, y: Array) -> int:
    """Return the point halfway along a curve as it is seen."""
    steps = np.hypot(np.diff(x) / (np.ptp(x) or 1.0), np.diff(y) / (np.ptp(y) or 1.0))
    way = np.append(0.0, np.cumsum(steps))
    return int(np.searchsorted(way, 0.5 * way[-1]))


def _written(name: str) -> str:
    return name.replace("_", " ")
