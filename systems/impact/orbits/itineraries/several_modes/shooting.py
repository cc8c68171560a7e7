"""Equations of orbits by multiple shooting: residual, Jacobian and rounding errors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.itineraries.several_modes import divided
from dynkit.systems.impact.orbits.itineraries.several_modes.passage import ROUNDING, Passage
from dynkit.systems.impact.simulation.state import TWO_PI

_OF_ROWS = 8.0
"""Rounding errors of each term of an equation: rows, kicks and sines are rounded."""


class ShootingSolution(Passage):
    """A passage through an itinerary with the equations of an orbit; an abstract class."""

    @property
    def left(self) -> Any:
        """Residual (m,) of the equations."""
        found = self._watched[0].copy()
        for i, event in enumerate(self.itinerary):
            if event.element < 0:
                turns = np.rint(self.event_phases[i] / TWO_PI)
                found[i] = self.event_phases[i] - TWO_PI * turns
            elif (pair := self.pairs[i]) is not None:
                found[i] = divided.value(self, i, pair)
        rates = (1.0 + self.restitutions) * self.closing + self.impulses
        first, *others = self.course.nodes
        ended = self.reached[[node - 1 for node in (*others, first)], : self.dimension]
        begun = self.lap.states[[*range(1, len(self.lap.states)), 0]]
        missing = ended - begun
        if (along := self.progression).shift.size:  # ends may be shifted; begins have no shift
            missing = along.removed(missing) + begun - along.removed(begun)
        return np.concatenate([found, rates, missing.ravel()])

    def jacobian(self, multiplier: complex) -> Any:
        """Jacobian D(multiplier), (m, m), of the equations."""
        n, d, changes = self.events, self.dimension, []
        out = np.zeros((self.size, self.size), dtype=np.result_type(multiplier, 1.0))
        for i, change, after, ended in self.changes(multiplier):
            if self.itinerary[i].element < 0:
                out[i, i] = 1.0
            elif self.pairs[i] is None:
                out[i] += self.guards[i] @ change
            if i in self.impulse_of:
                j = n + self.impulse_of[i]
                out[j] += (1.0 + self.rebounds[1, j - n]) * (self.rates[j - n] @ change)
                out[j, j] += 1.0
            changes.append(after)
            if i == n - 1 or i + 1 in self._node_of:
                node = self._own(self.course.node_before(i))
                there = self._node_of.get(i + 1, 0)
                out[node] = ended[:d]
                out[node, self._own(there)] -= np.eye(d) * (1.0 if there else multiplier)
                if (along := self.progression).shift.size:
                    out[node] -= along.shift @ (along.part @ out[node])
                    out[node, self._own(there)] += along.shift @ along.part
        for i, pair in enumerate(self.pairs):
            if pair is not None:
                self._divide(out, i, pair, changes, multiplier)
        return out

    @property
    def size(self) -> int:
        """The number m of unknowns, and of equations."""
        return self.events + len(self.hits) + self.lap.states.size

    def changes(self, multiplier: complex) -> Iterator[tuple[int, Any, Any, Any]]:
        """Yield the number of each event, and derivatives (D, m) of states by all unknowns.

        They are those of the states just before the event, just after it, and just before the next.
        """
        n, d = self.events, self.dimension
        change = np.zeros((d + 3, self.size), dtype=np.result_type(multiplier, 1.0))
        for i in range(n):
            if i in self._node_of:
                change[:] = 0.0
                change[:d, self._own(self._node_of[i])] = np.eye(d)
            change[d:] = 0.0
            change[d:, i] = self.turns(i)
            after = self.resets[i] @ change
            if i in self.impulse_of:
                after[:, n + self.impulse_of[i]] += self.resets[i] @ self.kicks[i]
            ended = self.transitions[i] @ after
            for column, part in self.lasts(i, multiplier):
                ended[:, column] += part * self.moving[i]
            yield i, change, after, ended
            change = ended

    def _own(self, node: int) -> slice:
        """Indices of the unknown state at a node, and of the equations from it to the next node."""
        begin = self.events + len(self.hits) + self.dimension * node
        return slice(begin, begin + self.dimension)

    def turns(self, i: int) -> Array:
        """Derivative (3,) of sine, cosine and one by the phase of event `i`; zero if fixed."""
        sine, cosine, _ = self._turning[i]
        return float(self._phase_is_free(i)) * np.array([cosine, -sine, 0.0])

    def _phase_is_free(self, i: int) -> bool:
        return self.driven or i > 0

    def lasts(self, i: int, mu: Any) -> Iterator[tuple[int, Any]]:
        """Yield derivatives of the time from event `i` to the next, with the unknowns' numbers."""
        after = (i + 1) % self.events
        if self._phase_is_free(i):
            yield i, -1.0 / self.clock
        if self._phase_is_free(after):
            yield after, (mu if after == 0 else 1.0) / self.clock
        if not self.driven:
            yield 0, self.durations[i] / self.lap.turn

    def _divide(self, out: Any, i: int, pair: divided.Pair, changes: list[Any], mu: Any) -> None:
        """Add the row of a divided difference."""
        begun = pair.first > i
        for j, by_state, by_time in divided.derivatives(self, i, pair):
            # the part of the time before the period's begin belongs to the period before
            factor = mu if begun and j <= i else 1.0
            out[i] += factor * (by_state @ changes[j])
            for column, part in self.lasts(j, mu):
                out[i, column] += factor * by_time * part

    @cached_property
    def rounding(self) -> Array:
        """Bounds (m,) of the rounding errors of the residual, to first order."""
        n, k, d = self.events, len(self.hits), self.dimension
        # rows, sines and phases are rounded
        own = np.empty(n + k + self.lap.states.size)
        moved = np.roll(self.moving, 1, axis=0)
        moved *= (self.event_phases / self.clock)[:, None]
        own[:n] = _OF_ROWS * (abs(self.guards) * abs(self.before)).sum(axis=1)
        own[:n] += abs((self.guards * moved).sum(axis=1))
        rates = (abs(self.rates) * abs(self.before[self.hits])).sum(axis=1)
        rates += abs((self.rates * moved[self.hits]).sum(axis=1))
        own[n : n + k] = 2.0 * _OF_ROWS * rates + 4.0 * abs(self.impulses)
        own[n + k :] = abs(self.lap.states).ravel()
        for i, event in enumerate(self.itinerary):
            if event.element < 0:
                own[i] = 1.0 + abs(self.event_phases[i])
            elif (pair := self.pairs[i]) is not None:
                own[i] = divided.rounding(self, i, pair) / ROUNDING
        # rows through which errors of a state reach the equations of later events
        rows, out = np.zeros((len(own), d)), ROUNDING * own
        for j in reversed(range(n)):
            if j == n - 1 or j + 1 in self._node_of:
                node = max(number for at, number in self._node_of.items() if at <= j)
                rows[:] = 0.0
                rows[self._own(node)] = self.progression.removed(np.eye(d))
            out += abs(rows) @ self.rounded[j, :d]
            rows = rows @ (self.transitions[j, :d, :d] @ self.resets[j, :d, :d])
            if self.itinerary[j].element >= 0 and self.pairs[j] is None:
                rows[j] = self.guards[j, :d]
            if j in self.impulse_of:
                k = self.impulse_of[j]
                rows[n + k] = (1.0 + self.rebounds[1, k]) * self.rates[k, :d]
        return out
