"""What ends the modes of a periodic motion."""

from __future__ import annotations

from typing import NamedTuple

from dynkit.systems.impact.orbits.machine import Regimes, Rubs


class Happening(NamedTuple):
    """What ends a mode.

    Attributes
    ----------
    mode : Regimes
    element, guard : int
        The guard that is zero: of an element, by its number in the regime; element -1 is none, a
        period of the forcing that begins.
    kicked : Regimes or None
        Of an impact the mode in which it happens: what it opens is open, what it moves slips.
    chatters : bool
        Whether contact with the same stop follows, the next mode, at once or after impacts that are
        not events of the itinerary.
    piece : int
        Of an impact the number of the smooth piece of its law: see `ImpactLaw.piece`.
    rubs : tuple
        Of an impact the friction that leans on the stop: see `Rubs`.
    """

    mode: Regimes
    element: int
    guard: int
    kicked: Regimes | None = None
    chatters: bool = False
    piece: int = 0
    rubs: Rubs = ()


Itinerary = tuple[Happening, ...]
"""Events in their order; each mode follows the event before."""
