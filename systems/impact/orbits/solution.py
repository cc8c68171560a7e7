"""Responses to all impulses of an orbit."""

from __future__ import annotations

from functools import cached_property
from typing import Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.mode import Transitions
from dynkit.systems.impact.orbits.flights import Flight
from dynkit.systems.impact.orbits.responses import FreeMotion
from dynkit.systems.impact.orbits.terms import Terms
from dynkit.systems.impact.state import TWO_PI

ROUNDING = 32.0 * 2.0**-52
"""Of each term of an equation, relative: rows, kicks, sines and transitions are rounded."""

LATE = 2.0 * 2.0**-52
"""Of the period, relative: it is a rounded multiple of a rounded turn, divided and rounded."""


@final
class Solution:
    """What the equations need at one place: all responses to all impulses.

    Parameters
    ----------
    motion : FreeMotion
    terms : Terms
    periods : int
    sides : (n,) of which stop each impact is
    x : (2n,) phases and impulses
    """

    def __init__(
        self, motion: FreeMotion, terms: Terms, periods: int, sides: Any, x: Array
    ) -> None:
        self.motion, self.terms, self.sides = motion, terms, sides
        n = len(sides)
        self.phases, self.impulses = x[:n], x[n:]
        self.turn = TWO_PI * periods
        self.period = self.turn / terms.frequency
        self.signs = terms.signs[sides]
        ahead = self.phases[:, None] - self.phases[None, :]
        np.fill_diagonal(ahead, 0.0)
        self.turns = np.floor(ahead / self.turn)
        """(n, n) whole periods, of -1 where an impulse comes later in the period."""
        self.since = (ahead - self.turns * self.turn) / terms.frequency
        """(n, n) times from an impulse, a column, to an impact, a row."""

    @property
    def transition(self) -> Transitions:
        """Over the period."""
        return self.motion.repeated(self.period)[0]

    @property
    def kicked(self) -> Array:
        """Periodic state (2, slots) just after a unit impulse once a period."""
        return self.motion.repeated(self.period)[1]

    def _spread(self, state: Array) -> Array:
        """What becomes of a state in all times `since`, (n, n, 2 slots)."""
        n = len(self.sides)
        if n == 1:
            return state.reshape(1, 1, -1)
        which = np.zeros(n * n, dtype=np.intp)
        return self.motion.mode.after(state[None], which, self.since.ravel()).reshape(n, n, -1)

    @cached_property
    def _kicks(self) -> Array:
        return self._spread(self.kicked)

    @cached_property
    def responses(self) -> Array:
        """Responses (4, n, n) of contact coordinate and derivatives, at rows to unit columns."""
        return np.asarray((self._kicks @ self.motion.rows.T).transpose(2, 0, 1))

    def disturbed(self, multiplier: complex) -> Any:
        """The same, (3, n, n), where impulses are multiplied from one period to the next."""
        state = self.transition.periodic(self.motion.kick, multiplier)
        parts = [self._spread(np.ascontiguousarray(state.real))]
        if np.iscomplexobj(state):
            parts.append(self._spread(np.ascontiguousarray(state.imag)))
        found = [(part @ self.motion.rows[:3].T).transpose(2, 0, 1) for part in parts]
        out = found[0] + 1j * found[1] if len(found) == 2 else found[0]
        return out * multiplier**self.turns

    @cached_property
    def by_period(self) -> Array:
        """Derivatives (2, n, n) of the first two responses by the period."""
        moved = self.motion.mode.rate(self.transition.apply(0, self.kicked))
        state = np.asarray(self.transition.periodic(moved))
        return np.asarray((self._spread(state) @ self.motion.rows[:2].T).transpose(2, 0, 1))

    @cached_property
    def states(self) -> Array:
        """Free states (n, 2, slots) just after each impact."""
        n = len(self.sides)
        sums = np.einsum("j,ijs->is", self.signs * self.impulses, self._kicks)
        return np.asarray(sums.reshape(n, 2, -1))

    @cached_property
    def rounded(self) -> Array:
        """What rounding may make of the free states, (n, 2 slots).

        Their numbers are rounded, and grow in the periodic response; so are the times in which
        they change: the period T, with (1 - E)^-1 E times the rate of change for each part of the
        state (E the transition over T), and the times since the other impacts.
        """
        n, slots = len(self.sides), self.motion.kick.shape[1]
        grown = self.transition.amplification(slots)
        rates = abs(self.motion.mode.rate(self._kicks.reshape(n, n, 2, slots)))
        rates *= abs(self.impulses)[:, None, None]
        others = rates * (1.0 - np.eye(n))[..., None, None]
        late = LATE * self.period * (grown * rates + others).sum(axis=1)
        own = ROUNDING * self.turned * abs(self.states * np.maximum(1.0, grown))
        return np.asarray((own + late).reshape(n, -1))

    @property
    def turned(self) -> float:
        """How often more than other numbers phases are rounded."""
        return float(1.0 + abs(self.phases).max())

    @cached_property
    def lasts(self) -> Array:
        """Times (n,) from each impact to the next."""
        ahead = (self.phases[None, :] - self.phases[:, None]) % self.turn
        np.fill_diagonal(ahead, self.turn)
        return np.asarray(ahead.min(axis=1) / self.terms.frequency)

    @cached_property
    def flights(self) -> list[Flight]:
        """The flights after each impact, as seen from each stop."""
        stops = range(len(self.terms.signs))
        return [Flight(self, i, side) for i in range(len(self.sides)) for side in stops]

    def gaps(self, order: int) -> Array:
        """Gaps (n,) at the impacts, or a derivative in time just after them."""
        t = self.terms
        steady = t.frequency**order * t.gap(self.sides, self.phases, order)
        free = self.responses[order] @ (self.signs * self.impulses)
        return np.asarray(steady + self.signs * free)

    def roundings(self, order: int) -> Array:
        """What rounding may make of `gaps`, (n,)."""
        t = self.terms
        steady = t.frequency**order * abs(t.drive)
        if order == 0:
            steady = steady + abs(t.gap(self.sides, self.phases)).max()
        free = self.rounded @ abs(self.motion.rows[order])
        return np.asarray(free + ROUNDING * self.turned * steady)
