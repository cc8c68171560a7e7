"""Pages of maps of two parameters for the browser."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.plotting.regions import css_of
from dynkit.sweeps.planes.drawing import regions_of
from dynkit.sweeps.viewing import NO_SYSTEM
from dynkit.viewer.page import page_of_cells

if TYPE_CHECKING:
    from dynkit.viewer.page import Page


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
