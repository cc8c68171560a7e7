"""Drawings shared by several results: time series, point clouds, diagrams."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.plotting.figures import DOTS, colour, ink, print_style, shown_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PHASE = r"phase $\varphi$"
RELATIVE_VELOCITY = "relative velocity $u$"

_QUARTERS = [0.5 * math.pi * i for i in range(5)]
_QUARTER_NAMES = ["0", r"$\pi/2$", r"$\pi$", r"$3\pi/2$", r"$2\pi$"]

# Points closer than this fraction of the axes' width look like one; fewer than _FEW points are
# drawn large.
_SHARP, _FEW = 0.005, 50
# An axis of values that differ by less than _ALIKE, relative, would show rounding errors only: it
# extends to the fraction _WIDE of the values on both sides.
_ALIKE, _WIDE = 1e-9, 0.05


def displacement(coordinate: int) -> str:
    """Return the axis title of a displacement; coordinates count from 0."""
    return f"displacement $x_{{{coordinate + 1}}}$"


SYMBOLS: Mapping[str, str] = {
    "frequency": r"\omega", "restitution": "r", "amplitude": "A", "offset": "A_0",
    "damping": r"\gamma", "springs": "k", "relative_velocity": "u", "energy": "E",
    "phase": r"\varphi", "time": "t",
}  # fmt: skip
"""Symbols of parameters and observables on axes."""


_COORDINATES = {
    "state": ("state", "z"),
    "position": ("displacement", "x"),
    "velocity": ("velocity", "v"),
}


def axis_title(name: str, symbols: Mapping[str, str] | None = None) -> str:
    """Return the title of the axis of a parameter or an observable: words, and its symbol if any.

    Examples
    --------
    >>> axis_title("relative_velocity"), axis_title("belt.force"), axis_title("state[0]")
    ('relative velocity $u$', 'belt force', 'state $z_{1}$')
    """
    if coordinate := re.fullmatch(r"(state|position|velocity)\[(\d+)\]", name):
        word, letter = _COORDINATES[coordinate[1]]
        return f"{word} ${letter}_{{{int(coordinate[2]) + 1}}}$"
    words = name.replace("_", " ").replace(".", " ")
    symbol = {**SYMBOLS, **(symbols or {})}.get(name)
    return f"{words} ${symbol}$" if symbol else words


@print_style()
def draw_motion(
    ax: Axes | None,
    times: Array,
    values: Array,
    name: str,
    stops: Mapping[str, Array] | None = None,
    impacts: tuple[Array, Array] | None = None,
) -> Axes:
    """Draw values (k,) against time: stops, (k,) each by name, dashed, and impacts as dots."""
    axes = shown_axes(ax, height=1.8)
    axes.plot(times, values, color=colour(0), linewidth=0.8, label=name)
    without_rounding(axes, "y")
    for label, stop in (stops or {}).items():
        axes.plot(times, stop, "--", color=colour(1), linewidth=0.6, label=label)
    if impacts is not None and len(impacts[0]):
        axes.plot(*impacts, "o", color=ink(), markersize=1.8, label="impacts")
    axes.set(xlabel="time $t$", ylabel=name)
    if len(times) > 1:
        axes.set_xlim(times[0], times[-1])
    return axes


@print_style()
def draw_points(ax: Axes | None, points: Array, names: Sequence[str]) -> Axes:
    """Draw points, (p, 2), and name the axes; few distinct points are drawn large.

    The axis of a coordinate named `PHASE` runs from 0 to 2 pi.
    """
    axes = shown_axes(ax)
    size = 3.0 if _distinct(points) < _FEW else 1.2
    axes.plot(points[:, 0], points[:, 1], markersize=size, color=ink(), **DOTS)
    if not len(points):
        _say_empty(axes)
    without_rounding(axes)
    for way, name in zip("xy", names, strict=True):
        axes.set(**{f"{way}label": name})
        if name == PHASE:
            axes.set(**{f"{way}lim": (0.0, 2.0 * math.pi), f"{way}ticks": _QUARTERS})
            axes.set(**{f"{way}ticklabels": _QUARTER_NAMES})
    return axes


def without_rounding(axes: Axes, ways: str = "xy") -> None:
    """Extend those of the axes along which all that is drawn differs by rounding only."""
    low, high = axes.dataLim.get_points()
    size = np.maximum(abs(low), abs(high))
    alike = (high - low < _ALIKE * size) & [way in ways for way in "xy"]
    wide = np.where(alike, _WIDE * size, 0.0)
    if np.isfinite(wide).all():
        axes.update_datalim([low - wide, high + wide])
        axes.autoscale_view()


def _say_empty(axes: Axes) -> None:
    middle: Any = {"horizontalalignment": "center", "verticalalignment": "center"}
    axes.text(0.5, 0.5, "no states", color=ink(0.4), transform=axes.transAxes, **middle)


def _distinct(points: Array) -> int:
    """Return the number of points (p, 2) that a reader can distinguish."""
    if not len(points):
        return 0
    widths = np.maximum(np.ptp(points, axis=0), _SHARP * abs(points).max(axis=0))
    steps = points / np.where(widths > 0.0, widths, 1.0) / _SHARP
    return len(np.unique(np.rint(steps), axis=0))


@print_style()
def draw_diagram(
    ax: Axes | None, values: Array, numbers: Array, names: Sequence[str], size: float = 0.7
) -> Axes:
    """Draw numbers (k, n) against values (k,) as dots of a size in points, and name the axes."""
    axes = shown_axes(ax)
    across, up = dots(values, numbers)
    axes.plot(across, up, markersize=size, rasterized=True, color=ink(), **DOTS)
    if not len(across):
        _say_empty(axes)
    without_rounding(axes)
    axes.set(xlabel=names[0], ylabel=names[1])
    grid = np.unique(values)
    if len(grid) > 1:  # half a step of margin for the dots at the ends
        first, last = 0.5 * (grid[1] - grid[0]), 0.5 * (grid[-1] - grid[-2])
        axes.set_xlim(grid[0] - first, grid[-1] + last)
    return axes


def dots(values: Array, numbers: Array) -> tuple[Array, Array]:
    """Return x and y, (p,) each, of the numbers (k, n) that are not NaN."""
    there = ~np.isnan(numbers.ravel())
    return np.repeat(values, numbers.shape[1])[there], numbers.ravel()[there]
