"""Figures of basins of attraction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.labels.label import OrbitKind
from dynkit.plotting.figures import DOTS, ink, open_symbols, shown_axes
from dynkit.plotting.regions import Region, css_of, draw_regions, shades
from dynkit.sweeps.basins.classification import NO_CROSSING, NO_STATE, RUNS_AWAY, UNSETTLED
from dynkit.sweeps.basins.matching import Basin
from dynkit.sweeps.swept import NO_SYSTEM
from dynkit.viewer.page import Page, page_of_cells, page_of_motions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.dynamics.attractor import Attractor
    from dynkit.viewer.series import Series


def _others() -> dict[int, Region]:
    """Return the regions of starts in no basin, in the current colours of matplotlib."""
    return {
        UNSETTLED: Region("unsettled", None, "xxxx"),
        RUNS_AWAY: Region("runs away", None),
        NO_CROSSING: Region("no crossing", None, "...."),
        NO_STATE: Region("no state", ink(0.5)),
    }


def draw_basins(
    basins: Sequence[Basin],
    starts: Array,
    numbers: NDArray[np.int64],
    coordinates: Sequence[str],
    ax: Axes | None,
) -> Axes:
    """Draw basins of starts, whose coordinates have these names; see `Basins.plot`."""
    if numbers.ndim == 1:
        return _draw_fractions(basins, numbers, ax)
    (first, x), (second, y) = (axis_of(starts, axis) for axis in (0, 1))
    names = name_of(coordinates, first, 0), name_of(coordinates, second, 1)
    axes = draw_regions(ax, (x, y), names, *regions_of(basins, numbers))
    size = starts.shape[-1]
    for basin in basins:
        if first >= 0 and second >= 0 and size == basin.states.shape[1] == 2:
            many = basin.label.kind in (OrbitKind.CHAOTIC, OrbitKind.QUASI_PERIODIC)
            look = (
                {"color": ink(), "markersize": 0.5, **DOTS}
                if many
                else open_symbols("o", 2.5, 0.5, ink())
            )
            states = basin.states[:, [first, second]]
            axes.plot(*states.T, scalex=False, scaley=False, **look)
    return axes


def regions_of(
    basins: Sequence[Basin], numbers: NDArray[np.int64]
) -> tuple[NDArray[np.int64], list[Region]]:
    """Return the number of each start's region, (k1, k2), and the regions."""
    names = [f"{basin.number}: {basin.label}" for basin in basins]
    colours = shades(len(names))
    regions = [Region(name, colour) for name, colour in zip(names, colours, strict=True)]
    cells = numbers.copy()
    for number, region in _others().items():
        cells[numbers == number] = len(regions)
        regions.append(region)
    return cells, regions


def axis_of(starts: Array, axis: int) -> tuple[int, Array]:
    """Return the coordinate that changes along this axis only, and its values.

    If several coordinates do, it is the first that ascends or descends, otherwise the first. If no
    coordinate does, return -1 and the indices along the axis.
    """
    other = np.moveaxis(starts, axis, 0)
    found = []
    for coordinate in range(starts.shape[-1]):
        values = other[:, 0, coordinate]
        alone = (other[:, :, coordinate] == values[:, None]).all()
        if alone and len(np.unique(values)) == len(values) > 1:
            found.append((coordinate, values))
    steady = [one for one in found if len(set(np.sign(np.diff(one[1])))) == 1]
    return (steady + found + [(-1, np.arange(len(other), dtype=np.float64))])[0]


def name_of(coordinates: Sequence[str], coordinate: int, axis: int) -> str:
    """Return the name of an axis with a coordinate, or with indices if the coordinate is -1."""
    return coordinates[coordinate] if coordinate >= 0 else f"starts, axis {axis}"


def _draw_fractions(basins: Sequence[Basin], numbers: NDArray[np.int64], ax: Axes | None) -> Axes:
    axes = shown_axes(ax)
    bars = [(f"{b.number}: {b.label}", b.fraction) for b in basins]
    for number, region in _others().items():
        part = float((numbers == number).mean())
        bars += [(region.name, part)] if part else []
    names, parts = [name for name, _ in bars], np.array([part for _, part in bars])
    errors = np.sqrt(parts * (1.0 - parts) / numbers.size)
    axes.bar(range(len(bars)), parts, yerr=errors, color=ink(0.6), ecolor=ink(), capsize=2.0)
    axes.set_xticks(range(len(bars)), names, rotation=45, ha="right")
    axes.set_ylabel("fraction of the starts")
    return axes


# Largest number of coordinates in the description of a start.
_COORDINATES = 8


def page_of(found: Any, motions: int) -> Page:
    """Return the page of basins, and the motion on each attractor."""
    starts, numbers, title = found.starts, found.numbers, "Basins of attraction"
    own = found.coordinates
    flat, group = starts.reshape(-1, starts.shape[-1]), numbers.ravel()
    if numbers.ndim == 2:
        cells, regions = regions_of(found.basins, numbers)
        (first, x), (second, y) = (axis_of(starts, axis) for axis in (0, 1))
        names = name_of(own, first, 0), name_of(own, second, 1)
        page = page_of_cells(title, names, (x, y), cells, css_of(regions))
    else:
        widest = int(np.argmax(np.ptp(flat, axis=0)))
        names, every = (own[widest], "attractor"), np.arange(len(flat))
        page = page_of_motions(title, names, len(flat), every, flat[:, widest], group.astype(float))
    facts = {
        **dict(zip(own, flat.T[:_COORDINATES], strict=False)),
        "leads to": [found.outcome(*at) for at in np.ndindex(numbers.shape)],
        "attractor": np.where(group < 0, np.nan, group),
    }
    page = replace(page, facts=facts)
    if found._look is None:
        return page.noting(NO_SYSTEM)

    def series(at: int) -> Series:
        motion: Attractor = found.attractor(*map(int, np.unravel_index(at, numbers.shape)))
        return motion._series()

    chosen = sorted(int(np.ravel_multi_index(b.start, numbers.shape)) for b in found.basins)
    return page.with_series(motions, series, chosen=chosen, group=group).noting(
        "All starts of a basin show the motion from its first start, after the transient."
    )
