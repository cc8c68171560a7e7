"""Pages of sweeps for the browser."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dynkit.dynamics.attractor import Attractor
from dynkit.viewer.page import Page, page_of_motions
from dynkit.viewer.series import Series

NO_SYSTEM = "The result was loaded without its system: the page has no time series."
"""Note of a page without motions."""


def page_of(sweep: Any, motions: int) -> Page:
    """Return the page of a sweep: the first observable, and time series of at most `motions`."""
    name, k = sweep.observables[0], len(sweep)
    numbers = sweep.observable(name)
    place, column = np.nonzero(~np.isnan(numbers))
    title, names = f"Sweep of {sweep.parameter}", (sweep.parameter, name)
    page = page_of_motions(title, names, k, place, sweep.values[place], numbers[place, column])

    def series(at: int) -> Series:
        attractor: Attractor = sweep.attractor(at)
        sweep._labels[at] = attractor.label
        return attractor._series()

    if sweep._plan.system is None:
        page = page.noting(NO_SYSTEM)
    else:
        page = page.with_series(motions, series)
    labels = [sweep._labels[at].name if at in sweep._labels else "" for at in range(k)]
    facts = {
        sweep.parameter: sweep.values,
        "label": labels,
        "kept states": sweep.counts.astype(float),
        "ending": list(sweep.endings),
        "displaced": ["from an unstable orbit" if moved else "" for moved in sweep.displaced],
    }
    return replace(page, facts=facts)
