"""Trajectories: the events of one motion, from its start on, in plain arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.systems.impact.state import ImpactState

Indices = NDArray[np.intp]

_ROWS = 1 << 16
"""Impacts whose states are worked out in one step: an interrupt is heard between steps."""


class Ending(Enum):
    """Why a simulation ended; the value of each is what the user reads."""

    COUNT_REACHED = "the number of impacts was reached"
    NO_FURTHER_CONTACT = "the mass cannot reach the table any more"
    CONTACT_FOR_EVER = "the mass stays on the table for ever"
    SEARCH_LIMIT = "no further event was found within the search limit"
    DIED_OUT = "the motion has died out on the table, its impacts too small for doubles"


@final
@dataclass(frozen=True, eq=False)
class Trajectory:
    """Impacts of one motion, and contacts between them.

    Points are the start and the impacts; contact number k begins after point ``before[k]``. Stops
    are numbered: 0 the table, 1 the far stop of a play.

    Attributes
    ----------
    start, final : ImpactState
    states : (impacts, 2N + 4)
        Coordinates, sine and cosine of the phase, relative velocity, time; no rows when not asked
        for.
    contacts : (k, 3)
        Impacts before the contact, its start, its end (infinite for ever).
    impacts : int
    ending : Ending
    chatter_error, cells, touches, seconds
        What it lost and cost.
    longest : float
        The longest flight, or contact, of all.
    """

    start: ImpactState
    final: ImpactState
    states: Array
    contacts: Array
    impacts: int
    ending: Ending
    chatter_error: float
    cells: int
    touches: int
    seconds: float
    longest: float

    # --- impacts (n,) -----------------------------------------------------------------------------

    @property
    def time(self) -> Array:
        """Times of the impacts."""
        return self.states[:, -1]

    @property
    def relative_velocity(self) -> Array:
        """Rates of the gap just after them; negative at the far stop."""
        return self.states[:, -2]

    @property
    def coordinates(self) -> tuple[Array, Array, Array]:
        """Modal coordinates (n, 2, N), sine and cosine of the phase (n,)."""
        rows, width = self.states.shape
        q = self.states[:, : width - 4].reshape(rows, 2, (width - 4) // 2)
        return q, self.states[:, -4], self.states[:, -3]

    # --- points (n + 1,) --------------------------------------------------------------------------

    @property
    def times(self) -> Array:
        """Times of the points."""
        return np.append(0.0, self.time)

    @property
    def speeds(self) -> Array:
        """Rates of the gap of the stop that is left, just after the points."""
        return np.asarray(abs(np.append(self.start.relative_velocity, self.relative_velocity)))

    @property
    def sides(self) -> Indices:
        """The stop at each point."""
        speeds = np.append(self.start.relative_velocity, self.relative_velocity)
        return np.asarray(np.signbit(speeds), dtype=np.intp)

    @property
    def free_states(self) -> Array:
        """States (n + 1, 2, slots) in free flight just after the points."""
        free = self.start._system._free
        out = np.empty((len(self.states) + 1, 2, free.layout.slots))
        out[0] = free.states(self.start._coordinates, *self.start._turn)
        for now in in_steps(len(self.states)):
            out[1:][now] = free.states(*(part[now] for part in self.coordinates))
        return out

    # --- contacts (k,) ----------------------------------------------------------------------------

    @property
    def before(self) -> Indices:
        """The point after which each contact begins."""
        return self.contacts[:, 0].astype(np.intp)

    @property
    def contact_sides(self) -> Indices:
        """The stop of each contact."""
        return np.asarray(self.sides[self.before])

    @property
    def durations(self) -> tuple[Array, Array]:
        """Durations (n,) of the flights before impacts, and (j,) of the contacts before these."""
        count, flights = self.ended, np.diff(self.time, prepend=0.0)
        before = self.before[:count]
        held = self.contacts[:count, 2] - self.times[before]
        flights[before] -= held
        return flights, held

    @property
    def ended(self) -> int:
        """How many of the contacts are before an impact."""
        return int(np.searchsorted(self.before, self.impacts))


def in_steps(count: int) -> Iterator[slice]:
    """Successive parts of so many impacts, each of them quickly worked out."""
    return (slice(low, low + _ROWS) for low in range(0, count, _ROWS))
