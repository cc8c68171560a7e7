"""Events that end the modes of a periodic motion."""

from __future__ import annotations

from typing import NamedTuple

from dynkit.systems.impact.orbits.machine import Regimes, Rubs


class Happening(NamedTuple):
    """An event that ends a mode.

    Attributes
    ----------
    mode : Regimes
        The mode that ends.
    element, guard : int
        The guard that is zero: its element, and its number in the element's regime. Element -1
        marks the begin of a period of the forcing, without a guard.
    kicked : Regimes or None
        Mode of the impact, if the event is one: stops that it opens are open, and friction that it
        moves slips.
    chatters : bool
        Whether the next mode is contact with the same stop. It follows at once, or after impacts
        that are not events of the itinerary.
    piece : int
        Number of the smooth piece of the impact law that an impact uses: see `ImpactLaw.piece`.
    rubs : tuple
        Friction at the stop that an impact hits: see `Rubs`.
    """

    mode: Regimes
    element: int
    guard: int
    kicked: Regimes | None = None
    chatters: bool = False
    piece: int = 0
    rubs: Rubs = ()


Itinerary = tuple[Happening, ...]
"""The events of a period in their order; the mode of each begins at the event before."""
