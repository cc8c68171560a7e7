"""Calls of a map in a search for periodic orbits, with a budget."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.progress import late_bar
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array, all_finite


class Spent(Exception):
    """The calls of a search are used up."""


@final
class MapCalls:
    """A map and its derivative; their values are NaN where they do not exist or are not finite.

    Parameters
    ----------
    system : Map
    most : int
        Number of calls of map and derivative, together, after which `Spent` is raised.
    """

    def __init__(self, system: SmoothMap, most: int) -> None:
        self.system = system
        self.most = most
        self.made = 0
        self.bar = late_bar("search", "call", most)

    def next(self, state: Array) -> Array:
        """Return the next state, (d,)."""
        return self._called(self.system.image, state, state.shape)

    def derivative(self, state: Array) -> Array:
        """Return the derivative of the next state by the state, (d, d)."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return self._called(self.system.jacobian, state, state.shape * 2)

    def _called(
        self, function: Callable[[Array], Array], state: Array, shape: tuple[int, ...]
    ) -> Array:
        if not all_finite(state):
            return np.full(shape, np.nan)
        if self.made >= self.most:
            raise Spent
        self.made += 1
        self.bar.update()
        try:
            found = np.asarray(function(state), dtype=np.float64)
        except NoMotion:
            return np.full(shape, np.nan)
        return found if all_finite(found) else np.full(shape, np.nan)
