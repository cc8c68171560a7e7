"""How figures look in print, and how they are saved."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynkit.files import whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN_WIDTH = 3.4
"""Width of a journal's column, in inches."""

PRINT_STYLE: Mapping[str, Any] = {
    "font.size": 8.0,
    "font.family": "serif",
    "font.serif": ["DejaVu Serif"],
    "mathtext.fontset": "dejavuserif",
    "axes.labelsize": 8.0,
    "axes.titlesize": 8.0,
    "axes.linewidth": 0.6,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.top": True,
    "ytick.right": True,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "lines.linewidth": 0.8,
    "figure.constrained_layout.use": True,
    # the same figure gives the same file
    "svg.hashsalt": "dynkit",
}
"""Matplotlib settings: type of 7 to 8 points at column width, black on white."""

DOTS: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markeredgewidth": 0.0,
    "color": "black",
}
"""Settings of a cloud of points; the size is the drawer's choice."""


def print_style() -> AbstractContextManager[None]:
    """Return a context in which figures get the type sizes and lines of `PRINT_STYLE`.

    Examples
    --------
    >>> with print_style():
    ...     _, (axes,) = new_figure()
    >>> axes.xaxis.label.get_size()
    8.0
    """
    from matplotlib import rc_context

    settings: Any = dict(PRINT_STYLE)  # matplotlib's own type lists every name that it knows
    return rc_context(settings)


def new_figure(
    width: float = COLUMN_WIDTH, height: float = 2.6, rows: int = 1
) -> tuple[Figure, list[Axes]]:
    """Return a new figure that stands alone, and its axes, one under the other; sizes in inches.

    pyplot does not know it: no window is opened, no display is needed, and it is gone when nothing
    refers to it any more.
    """
    from matplotlib.figure import Figure

    with print_style():
        figure = Figure(figsize=(width, height))
        return figure, list(figure.subplots(rows, squeeze=False)[:, 0])


def shown_axes(ax: Axes | None, width: float = COLUMN_WIDTH, height: float = 2.6) -> Axes:
    """Return the axes, or those of a new figure that pyplot shows; sizes in inches."""
    if ax is not None:
        return ax
    from matplotlib import pyplot as plt

    with print_style():
        return plt.subplots(figsize=(width, height))[1]


def save_figure(figure: Figure, stem: Path, resolution: float = 600.0) -> tuple[Path, ...]:
    """Save a figure as PNG and SVG; each file is the new one, or after any failure the old one.

    Parameters
    ----------
    figure : Figure
    stem : Path
        Where to, without the ending.
    resolution : float
        Dots an inch, where it is made of dots.

    Returns
    -------
    tuple of Path
        The two files.

    Raises
    ------
    ValueError, OSError
        When they cannot be written.
    """
    files = []
    # dates would make the same figure another file
    for ending, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
        files.append(stem.with_name(f"{stem.name}.{ending}"))
        with print_style(), whole("stem", files[-1]) as stream:
            figure.savefig(stream, format=ending, dpi=resolution, metadata=metadata)
    return tuple(files)
