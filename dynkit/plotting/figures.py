"""Figures for print: creation, style, and files."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynkit.data.atomic_files import whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["new_figure", "print_style", "save_figure"]

COLUMN_WIDTH = 3.4
"""Width of a journal's column, in inches."""

# Lightness of the first lines of a figure where the user has chosen no colours.
_GREYS = (0.0, 0.35, 0.55, 0.7)

# Files have no dates, so that the same figure gives the same file. Compression at level 3 takes two
# thirds of the time.
_OPTIONS: dict[str, dict[str, Any]] = {
    ".png": {"metadata": {"Software": None}, "pil_kwargs": {"compress_level": 3}},
    ".svg": {"metadata": {"Date": None}},
    ".pdf": {"metadata": {"CreationDate": None}},
}
PICTURES = tuple(_OPTIONS)
"""Endings of the files that a figure is written to."""

DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markeredgewidth": 0.0}
"""Settings of a cloud of points; size and colour are the drawer's choice."""


@cache
def _journal() -> Mapping[str, Any]:
    """Return the settings of the style ``dynkit.plotting.journal`` for the content of figures."""
    from matplotlib import rc_params_from_file

    file = Path(__file__).with_name("journal.mplstyle")
    settings = dict(rc_params_from_file(file, use_default_template=False))
    others = "axes.prop_cycle", "figure.figsize", "figure.constrained_layout.use"
    return {name: settings[name] for name in settings if name not in others}


@contextmanager
def print_style() -> Generator[None, None, None]:
    """Apply the style ``dynkit.plotting.journal`` to figures, as a context or a decorator.

    Settings in ``matplotlib.rcParams`` that differ from matplotlib's defaults are kept, and so are
    other settings that are made inside the context.

    Examples
    --------
    >>> with print_style():
    ...     _, (axes,) = new_figure()
    >>> axes.xaxis.label.get_size()
    8.0
    """
    from matplotlib import rcParams, rcParamsDefault

    now: Any = rcParams  # matplotlib's own type lists every name that it knows
    default: Any = rcParamsDefault
    style = _journal()
    before = {name: now[name] for name in style if now[name] == default[name]}
    now.update({name: style[name] for name in before})
    try:
        yield
    finally:
        # matplotlib's rc_context would undo the settings that pyplot makes when it loads a backend
        now.update(before)


def ink(lightness: float = 0.0) -> tuple[float, float, float]:
    """Return the colour of text, mixed with this fraction of the axes' background colour.

    Examples
    --------
    >>> ink(), ink(1.0)
    ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    """
    from matplotlib import rcParams
    from matplotlib.colors import to_rgb

    text, paper = to_rgb(rcParams["text.color"]), to_rgb(rcParams["axes.facecolor"])
    red, green, blue = (a + lightness * (b - a) for a, b in zip(text, paper, strict=True))
    return red, green, blue


def colour(number: int) -> Any:
    """Return the colour of a figure's line with this number, from 0.

    It is of matplotlib's setting ``axes.prop_cycle``, or a grey where that is matplotlib's default.

    Examples
    --------
    >>> from matplotlib import pyplot as plt
    >>> with plt.style.context("dynkit.plotting.colour"):
    ...     colour(1)
    '#d55e00'
    >>> colour(0)
    (0.0, 0.0, 0.0)
    """
    from matplotlib import rcParams, rcParamsDefault

    cycle = rcParams["axes.prop_cycle"]
    colours = cycle.by_key().get("color")
    if not colours or cycle == rcParamsDefault["axes.prop_cycle"]:
        return ink(_GREYS[number % len(_GREYS)])
    return colours[number % len(colours)]


def open_symbols(marker: str, size: float, width: float, edge: Any) -> dict[str, Any]:
    """Return the settings of markers without filling; size and line width in points."""
    return {
        "linestyle": "none",
        "marker": marker,
        "markersize": size,
        "markeredgewidth": width,
        "markerfacecolor": ink(1.0),
        "markeredgecolor": edge,
    }


def new_figure(
    width: float = COLUMN_WIDTH, height: float = 2.6, rows: int = 1
) -> tuple[Figure, list[Axes]]:
    """Return a new figure that pyplot does not manage, and its axes, one below the other.

    It opens no window, needs no display, and is deleted with its last reference.

    Parameters
    ----------
    width, height : float
        In inches; the default width is a journal's column.
    rows : int
        Number of axes.

    Examples
    --------
    >>> figure, axes = new_figure(height=4.0, rows=2)
    >>> figure.get_size_inches().tolist(), len(axes)
    ([3.4, 4.0], 2)
    """
    from matplotlib.figure import Figure

    from dynkit.plotting.ticks import write_whole_numbers

    with print_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        return figure, list(map(write_whole_numbers, figure.subplots(rows, squeeze=False)[:, 0]))


def shown_figure(width: float = COLUMN_WIDTH, height: float = 2.6) -> Figure:
    """Return a new figure managed by pyplot; sizes in inches."""
    from matplotlib import pyplot as plt

    return plt.figure(figsize=(width, height), layout="constrained")


def shown_axes(ax: Axes | None, width: float = COLUMN_WIDTH, height: float = 2.6) -> Axes:
    """Return the given axes, or those of a new figure managed by pyplot; sizes in inches."""
    if ax is not None:
        from matplotlib.axes import Axes

        if not isinstance(ax, Axes):
            raise ValueError(f"ax must be axes of matplotlib; got {ax!r}")
        return ax
    from dynkit.plotting.ticks import write_whole_numbers

    figure = shown_figure(width, height)
    with print_style():
        return write_whole_numbers(figure.subplots())


def size_in_points(axes: Axes) -> tuple[float, float]:
    """Return the width and the height of axes in points, after a layout of their content."""
    from matplotlib.figure import Figure

    figure = axes.get_figure(root=True)
    assert isinstance(figure, Figure)
    figure.draw_without_rendering()
    box = axes.get_window_extent()
    return 72.0 * box.width / figure.dpi, 72.0 * box.height / figure.dpi


def save_figure(figure: Figure, stem: Path, resolution: float = 600.0) -> tuple[Path, ...]:
    """Save a figure as PNG and SVG. After a failure the old file remains.

    Parameters
    ----------
    figure : Figure
    stem : Path
        Path of both files without the ending.
    resolution : float
        Dots per inch of raster images.

    Returns
    -------
    tuple of Path
        The two files.

    Raises
    ------
    ValueError, OSError
        When a file cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     [file.name for file in save_figure(new_figure()[0], Path(folder, "empty"))]
    ['empty.png', 'empty.svg']
    """
    from matplotlib import rc_context

    files = tuple(stem.with_name(f"{stem.name}{ending}") for ending in (".png", ".svg"))
    engine = figure.get_layout_engine()
    try:
        for file in files:
            write_figure("stem", file, figure, resolution)
            with rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
                figure.set_layout_engine(None)  # both have the layout of the first
    finally:
        if engine is not None:
            figure.set_layout_engine(engine)
    return files


def write_figure(name: str, path: Path, figure: Figure, resolution: float = 600.0) -> None:
    """Write a figure in the format of the file's ending, one of `PICTURES`.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    path : Path
    figure : Figure
    resolution : float
        Dots per inch of raster images.

    Raises
    ------
    ValueError, OSError
        When the file cannot be written; an old file is unchanged then.
    """
    options = {"format": path.suffix[1:], "dpi": resolution, **_OPTIONS[path.suffix]}
    with print_style(), whole(name, path) as stream:
        figure.savefig(stream, **options)
