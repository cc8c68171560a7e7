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
    x : (2n + 2b,) phases, impulses, and what is neutral just before the first impact
    """

    def __init__(
        self, motion: FreeMotion, terms: Terms, periods: int, sides: Any, x: Array
    ) -> None:
        self.motion, self.terms, self.sides = motion, terms, sides
        n = len(sides)
        self.phases, self.impulses, self.border = x[:n], x[n : 2 * n], x[2 * n :]
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
        """What becomes of a state in all times `since`, (n, n, 2 slots).

        Of what is neutral there is nothing where the impulse comes later in the period that begins
        with the first impact.
        """
        n = len(self.sides)
        if n == 1:
            return state.reshape(1, 1, -1)
        which = np.zeros(n * n, dtype=np.intp)
        states = self.motion.mode.after(state[None], which, self.since.ravel())
        if len(self.border):
            begun = self.since[:, 0]
            later = (begun > begun[:, None]).reshape(-1, 1, 1)
            states[..., self.motion.neutral] *= ~later
        return states.reshape(n, n, -1)

    @cached_property
    def _kicks(self) -> Array:
        return self._spread(self.kicked)

    @cached_property
    def responses(self) -> Array:
        """Responses (4, n, n) of contact coordinate and derivatives, at rows to unit columns."""
        return np.asarray((self._kicks @ self.motion.rows.T).transpose(2, 0, 1))

    def disturbed(self, multiplier: complex) -> Any:
        """The same, (3, n, n), where impulses are multiplied from one period to the next."""
        state = self.motion.periodic(self.transition, multiplier)
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

    # --- what is neutral --------------------------------------------------------------------------

    def carry(self, start: Array) -> Array:
        """States (n, 2, slots) at the impacts of one just before the first."""
        which = np.zeros(len(self.sides), dtype=np.intp)
        return self.motion.mode.after(start[None], which, self.since[:, 0])

    @cached_property
    def carried(self) -> Any:
        """What is neutral, at the impacts, without impulses: (n, 2, slots); else zero."""
        return self.carry(self.motion.start(self.border)) if len(self.border) else np.zeros(())

    @cached_property
    def ends(self) -> Array:
        """At the end of the period: of what is neutral, and of unit impulses, (1 + n, 2, slots)."""
        kick = self.motion.start(self.motion.neutral_numbers(self.motion.kick), 0.0)
        starts = np.stack([self.motion.start(self.border), kick])
        which = np.append(0, np.ones(len(self.sides), dtype=np.intp))
        lasts = np.append(self.period, self.period - self.since[:, 0])
        return self.motion.mode.after(starts, which, lasts)

    def over(self, numbers: Array) -> Array:
        """States (k, 2, slots) a period after disturbances (k, 2b) of what is neutral."""
        starts = np.stack([self.motion.start(e, 0.0) for e in numbers])
        count = len(starts)
        return self.motion.mode.after(starts, np.arange(count), np.full(count, self.period))

    @property
    def rounded_ends(self) -> Array:
        """What rounding may make of it, (2b,): see `rounded`."""
        ends, weights = self.ends, np.append(1.0, abs(self.impulses))
        off = ROUNDING * abs(ends)
        off += LATE * self.period * abs(self.motion.mode.rate(ends))
        return self.motion.neutral_numbers(np.tensordot(weights, off, 1))

    @property
    def end(self) -> Array:
        """What is neutral just before the first impact, a period later, as a state (2, slots)."""
        weights = np.append(1.0, self.signs * self.impulses)
        return np.asarray(np.tensordot(weights, self.ends, 1))

    def before(self, i: int) -> Array:
        """What is neutral, (2b,), just before impact number `i`."""
        own = self.signs[i] * self.impulses[i] * self.motion.kick
        return self.motion.neutral_numbers(self.states[i] - own)

    # --- together ---------------------------------------------------------------------------------

    @cached_property
    def states(self) -> Array:
        """Free states (n, 2, slots) just after each impact."""
        n = len(self.sides)
        sums = np.einsum("j,ijs->is", self.signs * self.impulses, self._kicks)
        return np.asarray(sums.reshape(n, 2, -1) + self.carried)

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
        if len(self.border):
            late = late + LATE * self.period * abs(self.motion.mode.rate(self.carried))
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
        if len(self.border):
            free = free + self.carried.reshape(len(self.sides), -1) @ self.motion.rows[order]
        return np.asarray(steady + self.signs * free)

    def roundings(self, order: int) -> Array:
        """What rounding may make of `gaps`, (n,)."""
        t = self.terms
        steady = t.frequency**order * abs(t.drive)
        if order == 0:
            steady = steady + abs(t.gap(self.sides, self.phases)).max()
        free = self.rounded @ abs(self.motion.rows[order])
        return np.asarray(free + ROUNDING * self.turned * steady)
