"""Responses to all impulses of an orbit P(n,m)."""

from __future__ import annotations

from functools import cached_property, partial
from typing import Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.modes.impulse_responses import FreeMotion
from dynkit.systems.impact.modes.mode import Transitions
from dynkit.systems.impact.modes.structure import Contact
from dynkit.systems.impact.orbits.flights import Curve, Flight
from dynkit.systems.impact.orbits.impulses.terms import Terms
from dynkit.systems.impact.orbits.solution import TableSolution
from dynkit.systems.impact.simulation.state import TWO_PI

ROUNDING = 32.0 * 2.0**-52
"""Of each term of an equation, relative: rows, kicks, sines and transitions are rounded."""

LATE = 2.0 * 2.0**-52
"""Of the period, relative: it is a rounded multiple of a rounded turn, divided and rounded."""


@final
class ImpulseSolution(TableSolution):
    """What the equations need at one place: all responses to all impulses.

    Its states are those just after the impacts.

    Parameters
    ----------
    contact : Contact
    motion : FreeMotion
    terms : Terms
    periods : int
    sides : (n,) of which stop each impact is
    x : (2n + 2b,) phases, impulses, and what is neutral just before the first impact
    """

    def __init__(
        self,
        contact: Contact,
        motion: FreeMotion,
        terms: Terms,
        periods: int,
        sides: Any,
        x: Array,
    ) -> None:
        self.contact, self.motion, self.terms, self.sides = contact, motion, terms, sides
        n = len(sides)
        self.phases, self.impulses, self.border = x[:n], x[n : 2 * n], x[2 * n :]
        self.impact_phases, self.parts = self.phases, [range(n)]
        self.turn = TWO_PI * periods
        self.frequency, self.restitution = terms.frequency, terms.restitution
        self.period = self.turn / terms.frequency
        self.stops = len(terms.signs)
        self.signs = terms.signs[sides]

    @cached_property
    def _apart(self) -> Array:
        return self.phases[:, None] - self.phases

    @cached_property
    def turns(self) -> Array:
        """(n, n) whole periods, of -1 where an impulse comes later in the period."""
        return np.asarray(np.floor(self._apart / self.turn))

    @cached_property
    def since(self) -> Array:
        """(n, n) times from an impulse, a column, to an impact, a row."""
        return np.asarray((self._apart - self.turns * self.turn) / self.frequency)

    @cached_property
    def turning(self) -> Any:
        """exp(i phase), (n,), at the impacts."""
        return np.exp(1j * self.phases)

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
        states = self.motion.mode.flown(state, self.since.ravel())
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
        # What the period makes of a periodic state is what it is just before the impulse.
        moved = self.motion.mode.rate(self.kicked - self.motion.kick)
        state = np.asarray(self.transition.periodic(moved))
        return np.asarray((self._spread(state) @ self.motion.rows[:2].T).transpose(2, 0, 1))

    # --- what is neutral --------------------------------------------------------------------------

    def carry(self, start: Array) -> Array:
        """States (n, 2, slots) at the impacts of one just before the first."""
        return self.motion.mode.flown(start, self.since[:, 0])

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
    def _ahead(self) -> Array:
        """Turns (n, n) from each impact to the others, and to itself a period later."""
        ahead = (self.phases[None, :] - self.phases[:, None]) % self.turn
        np.fill_diagonal(ahead, self.turn)
        return np.asarray(ahead)

    @cached_property
    def lasts(self) -> Array:
        """Times (n,) from each impact to the next."""
        return np.asarray(self._ahead.min(axis=1) / self.frequency)

    def flight(self, i: int, side: int) -> Flight:
        """From impact number `i` to the next."""
        t, lasts = self.terms, float(self.lasts[i])
        end = int(np.argmin(self._ahead[i]))
        size, bend = self.sizes(i)[::2].reshape(2, -1).sum(axis=1).tolist()
        total = size + abs(t.drive), bend + abs(t.drive) * t.frequency**2
        gap = Curve(partial(self._gap, i, side), lasts, total)
        return Flight(i, end, side, float(self.phases[i]), gap)

    def sizes(self, i: int) -> Array:
        """Bounds (4, 2, slots) of the terms of the free gap after impact number `i`.

        And of its derivatives of order 1, 2 and 6.
        """
        return np.asarray(self.motion.bounds(float(self.lasts[i])) * abs(self.states[i]))

    def _gap(self, i: int, side: int, since: Array, orders: int) -> Array:
        """Gap and derivatives (orders, k) at times (k,) after impact number `i`."""
        t = self.terms
        states = self.motion.mode.flown(self.states[i], since)
        free = self.motion.rows[:orders] @ states.reshape(len(since), -1).T
        turn = np.exp(1j * (self.phases[i] + t.frequency * since))
        return np.asarray(t.signs[side] * free + t.gaps(side, turn)[:orders])

    def acceleration(self, i: int) -> float:
        return float(self.gaps[2, i])

    def acceleration_rounding(self, i: int) -> float:
        """Of the accelerations of the modes and of the table, which cancel.

        Fast modes have the larger ones.
        """
        return float(self.roundings(2)[i])

    @cached_property
    def steady(self) -> Array:
        """Steady part (3, n) of `gaps`."""
        return self.terms.gaps(self.sides, self.turning)

    @cached_property
    def gaps(self) -> Array:
        """Gaps (3, n) at the impacts, and two derivatives in time just after them."""
        free = self.responses[:3] @ (self.signs * self.impulses)
        if len(self.border):
            free += self.motion.rows[:3] @ self.carried.reshape(len(self.sides), -1).T
        return np.asarray(self.steady + self.signs * free)

    def roundings(self, order: int) -> Array:
        """What rounding may make of `gaps`, (n,)."""
        t = self.terms
        steady = t.frequency**order * abs(t.drive)
        if order == 0:
            steady = steady + abs(self.steady[0]).max()
        free = self.rounded @ abs(self.motion.rows[order])
        return np.asarray(free + ROUNDING * self.turned * steady)

    # --- the motion -------------------------------------------------------------------------------

    @property
    def relative_velocity(self) -> Array:
        """Impulses that pull count as zero."""
        r = self.restitution
        u = r / (1.0 + r) * np.maximum(self.impulses, 0.0)
        return np.where(self.sides == 1, -u, u)

    @property
    def section_states(self) -> Array:
        position, velocity = self._motion(self.states, self.turning)
        others = self.contact.others
        parts = [position[:, others], velocity[:, others], self.relative_velocity[:, None]]
        return np.concatenate([*parts, (self.phases % TWO_PI)[:, None]], axis=1)

    def sample(self, since: Array) -> tuple[Array, Array]:
        times = (self.phases - self.phases[0]) / self.frequency
        which = np.searchsorted(times, since, side="right") - 1
        states = self.motion.mode.after(self.states, which, since - times[which])
        return self._motion(states, np.exp(1j * (self.phases[0] + self.frequency * since)))

    def _motion(self, states: Array, turn: Any) -> tuple[Array, Array]:
        """Positions and velocities (k, N) of free states (k, 2, slots) at exp(i phase), (k,)."""
        t, free, turn = self.terms, self.contact.structure.free, turn[:, None]
        q = states[..., self.motion.mode.layout.modes]
        position = free.positions(q) + (t.shape * turn).imag + t.still
        velocity = free.velocities(q) + t.frequency * (t.shape * turn).real
        return position, velocity + self.motion.mode.forced.drift
