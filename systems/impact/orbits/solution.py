"""What unknowns of an orbit's equations stand for: a motion, whether it is possible or not."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.simulation.trajectory import Trajectory

SAME = 1e-6
"""In units of a period: how far a simulated event may be from that of the orbit."""


class Solution(ABC):
    """The motion of a periodic orbit at given unknowns and parameters.

    A subclass must implement what is abstract here. It has n impacts, without those of a chatter,
    and k states, from which the motion can be simulated: P(n,m) just after each impact, P(inf,m) at
    each release.
    """

    frequency: float
    """Of the forcing."""
    period: float
    """Time until the motion repeats itself."""
    sides: Any
    """Of which stop, (n,), each impact is: 0 for the table and 1 for the far stop."""
    phases: Array
    """Phases (k,) of the states, not wrapped, read-only."""
    impact_phases: Array
    """Phases (n,) of the impacts, not wrapped."""
    impulses: Array
    """Changes (n,) of the relative velocity by the impacts; negative where they would pull."""

    @property
    @abstractmethod
    def relative_velocity(self) -> Array:
        """Relative velocities (n,) just after the impacts; negative on the far side of a play."""

    @property
    @abstractmethod
    def section_states(self) -> Array:
        """Section coordinates (k, 2N) of the states."""

    @abstractmethod
    def sample(self, since: Array) -> tuple[Array, Array]:
        """Positions and velocities (j, N) at times (j,) from the first state on, in one period."""

    @property
    def bounces(self) -> tuple[Array, Array]:
        """Phases and relative velocities (l,) of all impacts, those of chatters included."""
        return self.impact_phases, self.relative_velocity

    @property
    def contact_phases(self) -> Array:
        """Phases (c, 2) at which contacts begin and end."""
        return np.empty((0, 2))

    @property
    def chatter_error(self) -> float:
        """Largest change of a position or velocity by replacing the rest of a chatter."""
        return 0.0


def follows(run: Trajectory, times: Array, sides: Sequence[int], within: float) -> bool:
    """Whether a simulated run makes the same impacts, without contact.

    Parameters
    ----------
    times, sides : (n,)
    within : float
        How much times may differ.
    """
    n = len(times)
    if run.impacts < n or run.sides[1 : n + 1].tolist() != list(sides) or len(run.contacts):
        return False
    return bool((abs(run.time[:n] - times) <= within).all())
