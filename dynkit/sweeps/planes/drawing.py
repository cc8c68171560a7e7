"""Figures of maps of two parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.labels.label import OrbitKind
from dynkit.plotting.figures import ink
from dynkit.plotting.regions import Region, draw_regions, shades

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Largest number of labels of periodic motions with separate colours.
_MOST = 11


def draw_map(
    values: Mapping[str, Array],
    names: NDArray[np.str_],
    where_is: Callable[[OrbitKind], NDArray[np.bool_]],
    ax: Axes | None,
) -> Axes:
    """Draw the kinds of motion; see `ParameterMap.plot`."""
    (one, first), (other, second) = values.items()
    return draw_regions(ax, (first, second), (one, other), *regions_of(names, where_is))


def regions_of(
    names: NDArray[np.str_], where_is: Callable[[OrbitKind], NDArray[np.bool_]]
) -> tuple[NDArray[np.int64], list[Region]]:
    """Return the number of each pair's region, (k1, k2), and the regions."""
    cells = np.zeros(names.shape, dtype=np.int64)
    periodic = where_is(OrbitKind.PERIODIC)
    labels, counts = np.unique(names[periodic], return_counts=True)
    chosen = [str(labels[i]) for i in np.argsort(-counts, kind="stable")[:_MOST]]
    chosen.sort(key=_numbers)
    regions = [Region(name, shade) for name, shade in zip(chosen, shades(len(chosen)), strict=True)]
    for number, name in enumerate(chosen):
        cells[names == name] = number
    others = (
        (periodic & ~np.isin(names, chosen), Region("other P", ink(0.9))),
        (where_is(OrbitKind.STICKING), Region("P(inf,m)", ink(0.97), "////")),
        (where_is(OrbitKind.QUASI_PERIODIC), Region("quasi-periodic", ink(0.97), "----")),
        (where_is(OrbitKind.CHAOTIC), Region("chaotic", ink())),
        (where_is(OrbitKind.UNSETTLED), Region("unsettled", None, "xxxx")),
        (where_is(OrbitKind.NO_IMPACTS), Region("no impacts", None)),
        (names == "no motion", Region("no motion", None, "....")),
        (names == "refused", Region("refused", None, "xx")),
    )
    for where, region in others:
        cells[where] = len(regions)
        regions.append(region)
    return cells, regions


def _numbers(name: str) -> tuple[list[int], int, str]:
    """Return the sorting key of a label: periods of the forcing, iterates, stability."""
    numbers, _, stability = name.removeprefix("P(").partition(")")
    iterates, *periods = (int(part) for part in numbers.split(","))
    return periods, iterates, stability
