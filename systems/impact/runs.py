"""One run of the kernels: buffers in, plain arrays out."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.exponential.propagators import cells_of_a_call, workspace
from dynkit.systems.impact.state import ImpactState, Motion, state_of
from dynkit.systems.impact.trajectory import Ending, Trajectory

if TYPE_CHECKING:
    from dynkit.systems.impact.driven import DrivenStructure

MOST_CELLS = 1_000_000
"""Cells after which the search for the next event gives up, with an ending that says so."""

_MOTIONS = (Motion.FLIGHT, Motion.TABLE, Motion.RELEASE)


def band_factor(slots: int) -> float:
    """Rounding band in units of 2^-52 times the sum of amplitudes."""
    return 8.0 + slots


def trajectory_of(
    oscillator: DrivenStructure,
    start: ImpactState,
    count: int,
    *,
    store: bool,
    noise: float = 0.0,
    seed: int = 1,
    most_cells: int = MOST_CELLS,
) -> Trajectory:
    """Simulate `count` impacts from a state of this oscillator; see `Course`."""
    began = time.perf_counter()
    course = Course(oscillator, start, noise=noise, seed=seed, most_cells=most_cells)
    states = np.empty((count if store else 0, 2 * oscillator.degrees_of_freedom + 4))
    done = course.advance(count, states)
    return course.trajectory(states[:done], time.perf_counter() - began)


@final
class Course:
    """A motion that is simulated on and on, in any pieces: the bits do not depend on them.

    With noise every number of the start, and of the states after impacts, is changed by up to this
    part of itself and a 32nd of it of what it becomes, pseudo-randomly, and the rest by this part
    of the terms of which it is the sum. What a number becomes is bounded for flights of up to
    `longest`, or the longest one so far. The search for an event gives up after `most_cells`.

    Attributes
    ----------
    impacts : int
        How many there were so far.
    ending : Ending
        Why it does not go on.
    """

    def __init__(
        self,
        oscillator: DrivenStructure,
        start: ImpactState,
        *,
        noise: float,
        seed: int,
        most_cells: int,
        longest: float = 0.0,
    ) -> None:
        from dynkit.exponential.evaluation_kernels import START
        from dynkit.systems.impact import clock_kernels

        n, free = oscillator.degrees_of_freedom, oscillator._free
        q, turn = start._coordinates, start._turn
        clock = np.zeros(clock_kernels.CLOCK)
        clock[clock_kernels.SPEED] = abs(start.relative_velocity)
        clock[clock_kernels.SIDE] = start._side
        clock[clock_kernels.PHASE_OF_MOTION] = _MOTIONS.index(start.motion)
        clock[clock_kernels.SEED] = seed
        clock[clock_kernels.LONGEST] = longest
        self._shifts: Array | None = None
        if noise > 0.0:
            random = np.random.default_rng(seed)
            # What turning positions into coordinates rounds: half of the disturbance.
            x, v = (
                0.5 * noise * random.uniform(-1.0, 1.0, (2, n)) * [start.position, start.velocity]
            )
            q = q * (1.0 + noise * random.uniform(-1.0, 1.0, q.shape))
            q += oscillator._structure.free.coordinates(x, v)
            turn = turn * (1.0 + noise * random.uniform(-1.0, 1.0, 2))
            clock[clock_kernels.SPEED] *= 1.0 + noise * random.uniform(-1.0, 1.0)
            self._shifts = noise * random.uniform(-1.0, 1.0, (2, 2))
        clock[clock_kernels.SINE], clock[clock_kernels.COSINE] = turn
        flight = workspace(free.layout.slots)
        flight.states[START] = free.states(q, *turn)
        if noise > 0.0:
            generator = oscillator._gaps[0].generator
            slots = free.layout.modes
            clock_kernels.perturb_reached(generator, slots, flight.states, clock, noise)
        self._oscillator, self._start = oscillator, start
        self._noise, self._most_cells = noise, most_cells
        self._clock, self._flight = clock, flight
        self._contacts = np.empty((16 if "_touching" in vars(oscillator) else 0, 3))
        self._prepare()
        self.impacts, self.ending = 0, Ending.COUNT_REACHED

    def _prepare(self) -> None:
        oscillator = self._oscillator
        self._mechanics, slots = oscillator._touching if len(self._contacts) else oscillator._flying
        self._contact = workspace(slots)
        if self._shifts is not None:
            self._mechanics = _displaced(self._mechanics, self._oscillator, self._shifts)

    def advance(self, count: int, states: Array) -> int:
        """Simulate so many impacts more, and return how many there were.

        Their states are written into `states`, (count, 2N + 4), which has no rows for none.
        """
        from dynkit.systems.impact import kernels

        slots = self._oscillator._free.layout.slots
        done, ending = 0, kernels.RUN_PAUSED
        while ending in (kernels.CONTACTS_FULL, kernels.RUN_PAUSED):
            impacts, ending = kernels.run(
                self._mechanics,
                self._clock,
                count - done,
                self._noise or None,
                band_factor(slots),
                self._most_cells,
                cells_of_a_call(slots),
                states[done:],
                self._contacts,
                self._flight,
                self._contact,
            )
            done += impacts
            if ending == kernels.CONTACTS_FULL:
                more = np.empty((max(16, len(self._contacts)), 3))
                self._contacts = np.concatenate([self._contacts, more])
                self._prepare()
        self.impacts, self.ending = self.impacts + done, tuple(Ending)[ending]
        return done

    @property
    def cells(self) -> int:
        """Cells of all searches so far."""
        from dynkit.systems.impact import clock_kernels

        return int(self._clock[clock_kernels.CELLS])

    def trajectory(self, states: Array, seconds: float) -> Trajectory:
        """The events so far, with the states that were kept of it."""
        from dynkit.exponential.evaluation_kernels import START
        from dynkit.systems.impact import clock_kernels

        oscillator, clock = self._oscillator, self._clock
        free = oscillator._free
        q, sine, cosine = free.parts(self._flight.states[START])
        turn = np.array([sine, cosine])
        if free.layout.table < 0:
            turn = clock[[clock_kernels.SINE, clock_kernels.COSINE]]
        speed, motion = clock[clock_kernels.SPEED], int(clock[clock_kernels.PHASE_OF_MOTION])
        if clock[clock_kernels.SIDE] == 1.0:
            speed = -speed
        return Trajectory(
            self._start,
            state_of(oscillator, q, turn, speed, _MOTIONS[motion]),
            states,
            self._contacts[: int(clock[clock_kernels.CONTACTS])],
            self.impacts,
            self.ending,
            float(clock[clock_kernels.CHATTER_ERROR]),
            self.cells,
            int(clock[clock_kernels.TOUCHES]),
            seconds,
            float(clock[clock_kernels.LONGEST]),
        )


def _displaced(mechanics: Any, oscillator: DrivenStructure, parts: Array) -> Any:
    """The same with gaps and forces (k, 2) changed by these parts of the terms of their rest.

    Where the structure rests on the table, all but exactly, their differences are rounding.
    """
    structure, free = oscillator._structure, oscillator._free.forced
    if not free.rest_terms.any():
        return mechanics
    c, stops = structure.contact, []
    gap_terms = float(free.rest_terms[c])
    force_terms = float(abs(structure.stiffness[c]) @ free.rest_terms)
    for stop, (place, push) in zip(mechanics.stops, parts.tolist(), strict=False):
        gap = stop.gap._replace(offset=stop.gap.offset + place * gap_terms)
        force = stop.force._replace(offset=stop.force.offset + push * force_terms)
        stops.append(stop._replace(gap=gap, force=force))
    return mechanics._replace(stops=tuple(stops))
