"""Many starts of one oscillator, simulated until they arrive at known periodic orbits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.validation import Array
from dynkit.dynamics.map import Arrivals
from dynkit.exponential.propagators import cells_of_a_call, workspace
from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.runs import (
    MOST_CELLS,
    band_factor,
    fill_codes,
    log_of_impacts,
    log_of_switches,
)
from dynkit.systems.impact.simulation.trajectory import Impacts

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

_SWITCHES = 64
"""Most switches between two comparisons with the orbits; a motion with more is given up."""
_CLEAR = 2.0**-40
"""A start is in flight if its gaps exceed this part of their terms, and slips if its slip
velocities do."""


@final
@dataclass(frozen=True, eq=False)
class Ensemble:
    """Periodic orbits of one oscillator, for comparison with many motions.

    Parameters
    ----------
    system : ImpactMap
    records : sequence of ImpactRecord
        One period of each orbit; of a sticking orbit also more than one.
    """

    system: ImpactMap
    records: Sequence[ImpactRecord]

    @staticmethod
    def serves(system: ImpactMap) -> bool:
        """Whether this simulation is possible for a system.

        Positions, velocities and phase must determine the motion, and the slots of a mode must hold
        all of them.
        """
        kind = type(system)
        # `state` methods of this package differ only in defaults; others are called one by one
        usual = kind.state.__module__.startswith("dynkit.")
        usual = usual and kind.state_from.__module__.startswith("dynkit.")
        own = usual and system._motion is None and not system._strobed and not system._sliders
        rests = any(regime.holds for element in system._soft for regime in element.regimes)
        return own and not rests and system._free.layout.table >= 0

    def arrivals(self, starts: Array, most: int, near: float) -> Arrivals:
        """Arrivals of starts (n, 2N + 1): see `dynkit.dynamics.map.Map.arrivals`."""
        from dynkit.exponential.evaluation_kernels import WANTED_CODE
        from dynkit.systems.impact.simulation.ensemble_kernels import STRIDE, Members, arrive

        system, n = self.system, len(starts)
        numbers, found = np.full(n, -1), np.full((n, system.dimension), np.nan)
        if not n:
            return numbers, found, Cost(0.0)
        free, tables = system._free, system._automaton.tables
        orbits, slots = self._orbits(near), tables.ladders.step.shape[3]
        turns, states, flies = self._begun(starts)
        (able,) = np.nonzero(flies)
        members: Any = Members(
            np.ascontiguousarray(states[able]),
            turns[able],
            np.full(len(able), -1),
            np.zeros((len(able), 4), np.intp),
            log_of_impacts(len(able), free.layout),
        )
        noted = log_of_impacts(max(STRIDE, int(orbits.period.max(initial=0))), free.layout)
        buffers = self._buffers(noted, slots)
        contact = system._automaton.table[: len(tables.event), 3] == EventKind.CONTACT
        limits = band_factor(free.layout.slots), MOST_CELLS, cells_of_a_call(slots)
        beside, gap = system._automaton.beside, system._automaton.guards[0].sum
        given = contact, near, most, beside, *limits
        clock, left, _, switches, work, _, waits = buffers
        work.codes[:] = WANTED_CODE  # compile all code now: a member cannot pause for it
        fill_codes(gap, tables, clock, left, beside, 0.0, limits[0], noted, switches, work, waits)
        first = 0
        while first < len(able):
            first = arrive(tables, orbits, *given, first, members, *buffers)

        (there,) = np.nonzero(members.number >= 0)
        here = able[there]
        numbers[here] = members.number[there]
        time, speed, guard, reached, none = members.last
        last = Impacts(time[there], speed[there], guard[there], reached[there], none)
        found[here] = ImpactRecord(system, self.records[0]._run.holding(last)).states
        names = "impacts", "cells", "contacts", "touches"
        counts = dict(zip(names, members.counts.sum(axis=0).tolist(), strict=True))
        return numbers, found, Cost(0.0, counts)

    def _buffers(self, impacts: Any, slots: int) -> Any:
        """Buffers of a run, among them the given log of impacts."""
        from dynkit.systems.impact.simulation.clock_kernels import BEGIN, CLOCK
        from dynkit.systems.impact.simulation.loop_kernels import WAITING

        left = np.zeros((len(self.system._elements), BEGIN))
        logs = impacts, log_of_switches(_SWITCHES, slots)
        waiting = np.zeros(WAITING, dtype=np.int64), np.zeros(3)
        return np.zeros(CLOCK), left, *logs, workspace(slots), *waiting

    def _orbits(self, near: float) -> Any:
        """The impacts of one period of each orbit, packed for the kernel."""
        from dynkit.systems.impact.simulation.ensemble_kernels import Orbits

        logs = [_one_period(record, near) for record in self.records]
        sizes = [_size(log) for log in logs]
        periods = np.array([len(log.time) for log in logs])
        return Orbits(
            np.concatenate([log.guard for log in logs]),
            np.concatenate([log.speed for log in logs]),
            np.concatenate([log.states for log in logs]),
            np.repeat(sizes, periods),
            np.repeat(np.arange(len(logs)), periods),
            np.repeat(periods, periods),
        )

    def _begun(self, starts: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Sines and cosines (n, 2), states (n, 2, slots), and whether starts fly and slip (n,).

        States are identical bit for bit to those of `ImpactMap.state`.
        """
        system, n = self.system, self.system.degrees_of_freedom
        x, v, angles = starts[:, :n], starts[:, n : 2 * n], starts[:, -1].tolist()
        turns = np.array([list(map(math.sin, angles)), list(map(math.cos, angles))]).T.copy()
        able = np.ones(len(starts), dtype=bool)
        for stop, contact in zip(system._stops, system._contacts, strict=True):
            row = contact.row[:n]
            table = stop.swing(*turns.T) + stop.offset
            size = abs(x) @ abs(row) + stop.amplitude + abs(stop.offset)
            able &= stop.sign * (x @ row - table) > _CLEAR * size
        for element in system._soft:
            if any(regime.sticks for regime in element.regimes):
                row = element.row(n)
                speed = element.drift + element.swing_rate(system.frequency, *turns.T)
                size = abs(row).sum() * abs(v).max(axis=1) + abs(speed)
                able &= abs(v @ row - speed) > _CLEAR * size
        free = system._free
        if n == 1:
            q = free.coordinates(x, v, *turns.T)
        else:  # one by one: the order of sums in a matrix product depends on the number of rows
            rows = zip(x, v, turns, strict=True)
            q = np.array([free.coordinates(a, b, *turn) for a, b, turn in rows])
        able &= np.isfinite(q).all(axis=(1, 2)) & ((q * q).sum(axis=(1, 2)) < 1e100)
        return turns, free.states(q, *turns.T), able


def _size(log: Impacts) -> float:
    """The largest magnitude in the states and speeds of a log."""
    return max(float(abs(log.states).max(initial=0.0)), float(log.speed.max(initial=0.0)))


def _one_period(record: ImpactRecord, near: float) -> Impacts:
    """The impacts of one period: all impacts of P(n,m); for a sticking orbit, those of one return.

    A sticking orbit is followed from its fastest impact in the first half of the record, since the
    last bounces of a chatter are similar. If it does not return within the record, the result is
    empty.
    """
    log: Impacts = record._run.log
    if not len(record.sticking):
        return log
    first = int(np.argmax(log.speed[: max(len(log.speed) // 2, 1)]))
    gaps = abs(log.states[first + 1 :] - log.states[first]).max(axis=(1, 2))
    gaps = np.maximum(gaps, abs(log.speed[first + 1 :] - log.speed[first]))
    again = np.flatnonzero(gaps <= near * _size(log))
    return log.part(first, first + 1 + int(again[0]) if len(again) else first)
