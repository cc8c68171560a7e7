"""Figures of maps of two parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynkit.labels.label import OrbitKind
from dynkit.plotting.figures import ink
from dynkit.plotting.regions import Region, css_of, shades
from dynkit.sweeps.swept import NO_SYSTEM
from dynkit.viewer.page import page_of_cells

if TYPE_CHECKING:
    from dynkit.viewer.page import Page


# Largest number of labels of periodic motions with separate colours.
_MOST = 11


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


def page_of(found: Any, motions: int) -> Page:
    """Return the page of a map of two parameters: the kinds of motion, and some time series."""
    (one, first), (other, second) = found.values.items()
    cells, regions = regions_of(found.names, found.where)
    columns = len(second)
    page = page_of_cells(
        f"Motions over {one} and {other}", (one, other), (first, second), cells, css_of(regions)
    )
    facts = {
        one: np.repeat(first, columns),
        other: np.tile(second, len(first)),
        "label": found.names.ravel().tolist(),
        **{f"largest {name}": found.largest(name).ravel() for name in found.observables},
        "ending": found.endings.ravel().tolist(),
    }
    page = replace(page, facts=facts)
    if found._plan.system is None:
        return page.noting(NO_SYSTEM)
    return page.with_series(motions, lambda at: found.attractor(*divmod(at, columns))._series())
