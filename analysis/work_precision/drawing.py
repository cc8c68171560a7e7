"""Figures of error against run time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from dynkit.analysis.work_precision.measurement import Measurement
from dynkit.plotting.figures import ink, print_style, shown_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _HEIGHT, _COLUMNS = 7.0, 2.3, 2
_LOWEST, _DOUBLE = 1e-17, 2.0**-53
_LOST = 30.0
"""Height at which runs with a missed or invented impact are drawn: above all errors."""

# methods are distinguishable in black and white by markers, dashes, and full or hollow symbols
_MARKERS = ("*", "o", "s", "^", "v", "D", "X", "P", "h", "<", ">", "p")
_DASHES: tuple[Any, ...] = ("-", "-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)), (0, (3, 1, 1, 1)))
_COLORS = ("black", "tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple", "tab:brown",
           "tab:pink", "tab:gray", "tab:olive", "tab:cyan")  # fmt: skip


Lines: TypeAlias = Sequence[Sequence[Measurement]]
"""Measurements of a job by method; the index of the method determines its marker and dashes."""


class Job(NamedTuple):
    """Properties of a job besides its measurements.

    Parameters
    ----------
    name : str
    starts : int
    floor : float
        Error from the rounding of the start; NaN if unknown.
    error : float
        Error of the exact impacts.
    """

    name: str
    starts: int
    floor: float
    error: float


@print_style()
def draw_job(job: Job, lines: Lines, ax: Axes | None) -> Axes:
    """Draw one job, with a legend."""
    axes = shown_axes(ax, _WIDTH / _COLUMNS, 3.0)
    _draw(job, lines, axes)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    return axes


@print_style()
def draw_all(panels: Sequence[tuple[Job, Lines]]) -> Figure:
    """Return a figure with a panel for each job, and one legend."""
    from matplotlib.figure import Figure

    rows = math.ceil(len(panels) / _COLUMNS)
    figure = Figure(figsize=(_WIDTH, _HEIGHT * rows + 0.5), layout="constrained")
    grid = list(figure.subplots(rows, _COLUMNS, squeeze=False).flat)
    for (job, lines), axes in zip(panels, grid, strict=False):
        _draw(job, lines, axes)
        axes.set_title(job.name)
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    entries: dict[str, Any] = {}
    for axes in grid:
        for line, name in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(name, line)
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=5)
    return figure


def _draw(job: Job, lines: Lines, axes: Axes) -> None:
    from matplotlib.ticker import NullFormatter, NullLocator

    several = job.starts > 1
    axes.set_xscale("log")
    if several:
        axes.set_yscale("symlog", linthresh=1.0)
    else:
        axes.set_yscale("log")
    for k, measured in enumerate(lines):
        rows = [one for one in measured if not math.isnan(one.seconds)]
        if rows:
            _line(axes, rows, k, several=several)
    axes.set_xlabel("seconds")
    low, high = np.log10(axes.get_xlim())
    axes.set_xlim(10.0 ** math.floor(low), 10.0 ** math.ceil(high))  # only whole decades are named
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_locator(NullLocator())
    if several:
        axes.set_ylabel(f"starts lost, of {job.starts}")
        axes.set_ylim(-0.3, 1.6 * job.starts)
        ticks = [0, 1, 10, 100, job.starts]
        axes.set_yticks(ticks, [str(tick) for tick in ticks])
        return
    axes.set_ylabel("error")
    axes.set_ylim(_LOWEST, 10.0 * _LOST)
    names = ["$10^{-16}$", "$10^{-12}$", "$10^{-8}$", "$10^{-4}$", "1", "lost"]
    axes.set_yticks([1e-16, 1e-12, 1e-8, 1e-4, 1.0, _LOST], names)
    if job.error > _DOUBLE:
        axes.axhspan(_LOWEST, job.error, color=ink(0.88), lw=0.0, label="error of the reference")
    if job.floor > 0.0:
        axes.axhline(job.floor, color="0.6", linewidth=0.6, label="rounding of the start")


def _line(axes: Axes, rows: Sequence[Measurement], k: int, *, several: bool) -> None:
    style: dict[str, Any] = {
        "marker": _MARKERS[k % len(_MARKERS)],
        "markersize": 7.0 if k == 0 else 3.5,
        "markeredgewidth": 0.7,
        "markerfacecolor": _COLORS[k % len(_COLORS)] if k % 2 == 0 else "white",
        "color": _COLORS[k % len(_COLORS)],
        "linestyle": _DASHES[k % len(_DASHES)],
        "linewidth": 0.7,
        "label": rows[0].method,
        "zorder": 4.0 if k == 0 else 3.0,
    }
    seconds = [one.seconds for one in rows]
    if several:
        axes.plot(seconds, [one.lost for one in rows], clip_on=False, **style)
        return
    heights = [max(one.error, _DOUBLE) if one.right else _LOST for one in rows]
    axes.plot(seconds, heights, **style)
