"""Pages of basins of attraction for the browser."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.plotting.regions import css_of
from dynkit.sweeps.basins.drawing import axis_of, name_of, regions_of
from dynkit.sweeps.viewing import NO_SYSTEM
from dynkit.viewer.page import Page, page_of_cells, page_of_motions

if TYPE_CHECKING:
    from dynkit.dynamics.attractor import Attractor
    from dynkit.viewer.series import Series

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
