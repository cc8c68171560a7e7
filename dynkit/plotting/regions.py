"""Regions of a plane, distinguished by colour, lightness and name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.plotting.figures import COLUMN_WIDTH, ink, print_style, shown_axes, size_in_points
from dynkit.plotting.points import axis_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# In points: the font size of names, and the width of a letter with its share of the margins.
_TYPE, _LETTER = 5.5, 3.7


@final
@dataclass(frozen=True)
class Region:
    """A kind of cells: its name, its colour (None leaves it blank), its hatching."""

    name: str
    colour: Any = None
    hatch: str = ""


def shades(count: int) -> list[tuple[float, float, float]]:
    """Return colours in even steps of lightness, ordered so that neighbours differ in grey.

    Examples
    --------
    >>> light = [0.3 * r + 0.59 * g + 0.11 * b for r, g, b in shades(10)]
    >>> bool(np.all(abs(np.diff(light)) > 0.15))
    True
    """
    from matplotlib import colormaps

    places = np.linspace(0.98, 0.15, count) if count > 1 else np.array([0.8])
    colours = [(r, g, b) for r, g, b, _ in colormaps["viridis"](places).tolist()]
    half = (count + 1) // 2
    return [colours[i // 2 + half * (i % 2)] for i in range(count)]


def css_of(regions: Sequence[Region]) -> list[tuple[str, str]]:
    """Return names and opaque colours in CSS, for pages, which have no hatching.

    Regions that differ only in hatching get greys that differ.

    Examples
    --------
    >>> css_of([Region("chaotic", (0.0, 0.0, 0.0)), Region("no impacts"), Region("unsettled")])
    [('chaotic', '#000000'), ('no impacts', '#f2f2f2'), ('unsettled', '#bfbfbf')]
    """
    from matplotlib.colors import to_hex

    plain = [r for r in regions if r.colour is None or r.hatch]
    greys = np.linspace(0.95, 0.55, max(len(plain), 3))
    found = []
    for region in regions:
        grey = float(greys[plain.index(region)]) if region in plain else None
        found.append((region.name, to_hex(region.colour if grey is None else (grey,) * 3)))
    return found


@print_style()
def draw_regions(
    ax: Axes | None,
    axes_values: tuple[Array, Array],
    names: tuple[str, str],
    cells: NDArray[np.int64],
    regions: Sequence[Region],
) -> Axes:
    """Draw cells (k1, k2) of region numbers, with a legend, and names in regions with enough room.

    Parameters
    ----------
    ax : Axes or None
        Axes to draw into; None makes a new figure.
    axes_values : ((k1,), (k2,) arrays)
        Coordinates of the cells' centres, in any order.
    names : (str, str)
        Titles of the axes.
    cells : (k1, k2) array of int
        Indices into `regions`.
    regions : sequence of Region
    """
    from matplotlib.colors import ListedColormap

    first, second = (np.argsort(values, kind="stable") for values in axes_values)
    x, y = axes_values[0][first], axes_values[1][second]
    picture = cells[np.ix_(first, second)].T
    axes = shown_axes(ax, COLUMN_WIDTH, 3.2)
    paper = ink(1.0)
    colours = ListedColormap([paper if r.colour is None else r.colour for r in regions])
    edges = _edges(x), _edges(y)
    axes.pcolormesh(
        *edges, picture, cmap=colours, vmin=-0.5, vmax=len(regions) - 0.5, rasterized=True
    )
    for number, region in enumerate(regions):
        if region.hatch and (picture == number).any():
            _hatch(axes, edges, picture == number, region.hatch)
    axes.set(xlabel=axis_title(names[0]), ylabel=axis_title(names[1]))
    _write_legend(axes, [regions[number] for number in np.unique(cells).tolist()])
    size = size_in_points(axes)
    for number, region in enumerate(regions):
        if (picture == number).any():
            _write_name(axes, size, edges, picture == number, region)
    return axes


def _edges(values: Array) -> Array:
    if len(values) == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    middles = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2 * values[0] - middles[0]], middles, [2 * values[-1] - middles[-1]]])


def _hatch(axes: Axes, edges: tuple[Array, Array], where: NDArray[np.bool_], hatch: str) -> None:
    from matplotlib.collections import PolyCollection

    x, y = edges
    boxes = []
    for j, row in enumerate(where):  # one box for each run of cells in a row
        steps = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
        for i, k in steps.reshape(-1, 2).tolist():
            boxes.append([(x[i], y[j]), (x[k], y[j]), (x[k], y[j + 1]), (x[i], y[j + 1])])
    axes.add_collection(
        PolyCollection(boxes, facecolor="none", edgecolor=ink(0.35), linewidth=0.0, hatch=hatch),
        autolim=False,
    )


def _write_legend(axes: Axes, regions: Sequence[Region]) -> None:
    from matplotlib.patches import Patch

    patches = [
        Patch(
            facecolor=ink(1.0) if region.colour is None else region.colour,
            edgecolor=ink(0.35),
            linewidth=0.4,
            hatch=2 * region.hatch,
            label=region.name,
        )
        for region in regions
    ]
    axes.legend(
        handles=patches,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=4,
        fontsize=_TYPE,
        handlelength=1.4,
        columnspacing=1.0,
        frameon=False,
    )


def _write_name(
    axes: Axes,
    size: tuple[float, float],
    edges: tuple[Array, Array],
    where: NDArray[np.bool_],
    region: Region,
) -> None:
    """Write a region's name, level or upright, where it fits, far from the region's edges."""
    from scipy.ndimage import distance_transform_edt, minimum_filter

    pitch = size[1] / where.shape[0], size[0] / where.shape[1]
    depth = distance_transform_edt(np.pad(where, 1), sampling=pitch)[1:-1, 1:-1]
    needed = _LETTER * len(region.name), 1.5 * _TYPE
    rotation = 0
    room = np.zeros_like(where)
    for angle, (across, up) in ((0, needed), (90, needed[::-1])):
        box = (int(up / pitch[0]) + 1, int(across / pitch[1]) + 1)
        if not room.any():
            room = minimum_filter(where, size=box, mode="constant", cval=False)
            rotation = angle
    if not room.any():
        return
    j, i = np.unravel_index(int(np.argmax(np.where(room, depth, -1.0))), depth.shape)
    x, y = (0.5 * (edge[k] + edge[k + 1]) for edge, k in zip(edges, (i, j), strict=True))
    light = region.colour is None or np.dot(region.colour[:3], (0.3, 0.59, 0.11)) > 0.45
    axes.text(
        x,
        y,
        region.name,
        fontsize=_TYPE,
        ha="center",
        va="center",
        rotation=rotation,
        color="black" if light else "white",
        bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "linewidth": 0.0}
        if region.hatch
        else None,
    )
