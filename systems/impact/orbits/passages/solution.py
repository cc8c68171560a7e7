"""All passages of an orbit P(inf,m)."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.flights import Flight
from dynkit.systems.impact.orbits.passages.passage import Passage
from dynkit.systems.impact.orbits.solution import TableSolution
from dynkit.systems.impact.simulation.state import TWO_PI


@final
class PassageSolution(TableSolution):
    """The passages (k,) from each release to the next; its states are those at the releases.

    The impacts are those that words name, passage by passage.

    Parameters
    ----------
    passages : list of Passage
    periods : int
    """

    def __init__(self, passages: list[Passage], periods: int) -> None:
        self.passages = passages
        first = passages[0]
        self.frequency, self.restitution = first.w, first.r
        self.period = periods * TWO_PI / self.frequency
        self.stops = len(first.scene.holdings)
        self.sides = [side for passage in passages for side in passage.word.sides]
        ends = np.cumsum([0, *(len(passage.word.sides) for passage in passages)]).tolist()
        self.parts = [range(a, b) for a, b in pairwise(ends)]
        self._passage_of = [k for k, part in enumerate(self.parts) for _ in part]
        self.phases = np.array([float(passage.phases[0]) for passage in passages])
        self.phases.setflags(write=False)
        self.impact_phases = np.concatenate([passage.phases[1:-1] for passage in passages])
        rates = np.concatenate([passage.rates for passage in passages])
        self.impulses = -(1.0 + self.restitution) * rates
        self.impulses.setflags(write=False)

    @cached_property
    def relative_velocity(self) -> Array:
        return np.concatenate([passage.rebounds for passage in self.passages])

    @property
    def section_states(self) -> Array:
        rows = [
            np.append(q.places, [-0.0 if q.word.start else 0.0, q.phases[0] % TWO_PI])
            for q in self.passages
        ]
        return np.array(rows)

    def flight(self, i: int, side: int) -> Flight:
        passage, number = self._within(i)
        start = i - 1 if number else -1
        return Flight(start, i, side, float(passage.phases[number]), passage.gap(number, side))

    def acceleration(self, i: int) -> tuple[float, float]:
        passage, number = self._within(i)
        return float(passage.scene.gap(passage.states[number + 1], self.sides[i], 2)), 0.0

    @property
    def restitutions(self) -> Array:
        """Of each impact, (n,)."""
        return np.full(len(self.sides), self.restitution)

    def _within(self, i: int) -> tuple[Passage, int]:
        """Passage of impact number `i`, and its number there."""
        k = self._passage_of[i]
        return self.passages[k], i - self.parts[k].start

    @property
    def bounces(self) -> tuple[Array, Array]:
        parts = [
            [
                np.append(q.phases[1:-1], q.phases[-2] + q.w * q.run.time),
                np.append(q.rebounds, q.run.relative_velocity),
            ]
            for q in self.passages
        ]
        phases, speeds = np.concatenate(parts, axis=1)
        return phases, speeds

    @property
    def contact_phases(self) -> Array:
        return np.array([[q.contact_phase, q.phases[-1]] for q in self.passages])

    @property
    def chatter_error(self) -> float:
        return max(passage.run.chatter_error for passage in self.passages)

    def sample(self, since: Array) -> tuple[Array, Array]:
        out = np.empty((2, len(since), self.passages[0].scene.system.degrees_of_freedom))
        begins = (self.phases - self.phases[0]) / self.frequency
        which = np.searchsorted(begins, since, side="right") - 1
        for k, passage in enumerate(self.passages):
            here = which == k
            out[:, here] = passage.sample(since[here] - begins[k])
        return out[0], out[1]
