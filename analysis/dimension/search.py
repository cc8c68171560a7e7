"""Search for the largest radius of correlation sums below which a range scales."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from math import ceil

import numpy as np

from dynkit.analysis.dimension.scaling import STEPS, Scaling, find_scaling
from dynkit.analysis.dimension.sums import CorrelationSums
from dynkit.core.cost import Cost
from dynkit.core.validation import Array

# Largest radii that are tried, relative to the diameter. With 0.3, a range of some sets of many
# dimensions, whose sums bend everywhere, would look straight.
_PARTS = 0.1, 0.2
_ROUNDING = 2.0**-42  # smallest distance above rounding, relative to the largest coordinate
_LEAST_SPAN = 128.0  # least ratio of the largest radius to the rounding of the states


def search_scaling(
    sums_at: Callable[[Array], CorrelationSums],
    states: Array,
    diameter: float,
    largest: float | None,
    least_ratio: float,
) -> tuple[CorrelationSums, Scaling, Cost]:
    """Return the sums of states (n, d), their scaling, and the cost of all trials.

    The sums are those up to the first of several largest radii below which a range scales, or up to
    the first one when no range scales.

    Parameters
    ----------
    sums_at : callable
        Function that returns the correlation sums at radii, (k,).
    states : (n, d) array
    diameter : float
        Largest distance of two states.
    largest : float, optional
        Largest radius, at most the diameter; by default fractions of it are tried.
    least_ratio : float
        As for `find_scaling`.

    Raises
    ------
    ValueError
        When the largest radius is near the rounding of the states.
    """
    tried: list[tuple[CorrelationSums, Scaling]] = []
    cost = Cost(0.0)
    for radii in _ladders(states, diameter, largest):
        sums = sums_at(radii)
        began = time.perf_counter()
        tried.append((sums, find_scaling(sums, states, least_ratio)))
        cost = cost + sums.cost + Cost(time.perf_counter() - began)
        if tried[-1][1].region is not None:
            return *tried[-1], cost
    return *tried[0], cost


def _ladders(states: Array, diameter: float, largest: float | None) -> Iterator[Array]:
    """Yield radii down to the rounding of the states, for each largest radius to try."""
    finest = max(_ROUNDING * float(abs(states).max()), 1e-140)
    least = _LEAST_SPAN * finest
    if largest is not None and largest < least:
        raise ValueError(
            f"largest must not be less than {least:.3g}, near the rounding of the states; "
            f"got {largest!r}"
        )
    # beyond the diameter any set looks like one point
    asked = [part * diameter for part in _PARTS] if largest is None else [min(largest, diameter)]
    tops = [max(float(top), least) for top in asked]
    for top in dict.fromkeys(tops):
        count = ceil(STEPS * np.log2(top / finest))
        yield top * 2.0 ** (np.arange(-count, 1) / STEPS)
