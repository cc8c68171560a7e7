"""Figures of maps of two parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynkit.figures import ink
from dynkit.labels import OrbitKind
from dynkit.regions import Region, draw_regions, shades

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.parameter_maps.result import ParameterMap

# So many labels of periodic motions have a colour of their own.
_MOST = 11


def draw_map(found: ParameterMap, ax: Axes | None) -> Axes:
    """Draw the kinds of motion as `ParameterMap.plot` says."""
    names = found.names
    cells = np.zeros(names.shape, dtype=np.int64)
    periodic = found.where(OrbitKind.PERIODIC)
    labels, counts = np.unique(names[periodic], return_counts=True)
    chosen = [str(labels[i]) for i in np.argsort(-counts, kind="stable")[:_MOST]]
    chosen.sort(key=_numbers)
    regions = [Region(name, shade) for name, shade in zip(chosen, shades(len(chosen)), strict=True)]
    for number, name in enumerate(chosen):
        cells[names == name] = number
    others = (
        (periodic & ~np.isin(names, chosen), Region("other P", ink(0.9))),
        (found.where(OrbitKind.STICKING), Region("P(inf,m)", ink(0.97), "////")),
        (found.where(OrbitKind.CHAOTIC), Region("chaotic", ink())),
        (found.where(OrbitKind.UNSETTLED), Region("unsettled", None, "xxxx")),
        (found.where(OrbitKind.AT_REST), Region("at rest", None)),
        (names == "no motion", Region("no motion", None, "....")),
        (names == "refused", Region("refused", None, "xx")),
    )
    for where, region in others:
        cells[where] = len(regions)
        regions.append(region)
    first, second = found.values.values()
    return draw_regions(ax, (first, second), found.parameters, cells, regions)


def _numbers(name: str) -> tuple[list[int], int, str]:
    """Order of labels: by table periods, then by impacts; the unstable orbit after the stable."""
    numbers, _, stability = name.removeprefix("P(").partition(")")
    impacts, *periods = (int(part) for part in numbers.split(","))
    return periods, impacts, stability
