"""Pages of single motions: their states on the section, and the motion behind them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.viewer.page import LOOKS, Page, page_of_motions
from dynkit.viewer.series import Series


def page_of_section(
    title: str,
    motion: Any,
    series: Callable[[int], Series],
    motions: int,
    look: str = "motion",
) -> Page:
    """Return the page of an attractor or an orbit: its states in the plane of its figures.

    Parameters
    ----------
    title : str
    motion : Attractor or PeriodicOrbit
        Something with a `system`, `states` and ``observable(name)``.
    series : callable
        Returns the time series of the whole motion; its argument has no effect.
    motions : int
        Without motions, the page has no time series.
    look : str
        One of `LOOKS`.
    """
    (across, x), (up, y) = _plane(motion)
    page = page_of_motions(title, (across, up), max(len(x), 1), np.arange(len(x)), x, y)
    page = replace(page, look=page.look + LOOKS.index(look))
    if len(x):
        page = replace(page, facts={"state": np.arange(float(len(x))), across: x, up: y})
    else:
        page = page.noting("The motion has no states on its section: the diagram is empty.")
    return page.with_series(motions, series, chosen=[0])


def _plane(motion: Any) -> list[tuple[str, Array]]:
    """Return names and columns of both axes of a section."""
    if names := motion.system._section_axes:
        return [(name, motion.observable(name)) for name in names]
    states = motion.states
    first, *others = motion.system.coordinates(states).items()
    if others:
        return [first, others[0]]
    beyond = [motion.system.image(state) for state in states[-1:]]
    return [first, (f"next {first[0]}", np.concatenate([*states[1:], *beyond]))]
