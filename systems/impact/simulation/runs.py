"""Runs of the simulation kernels: buffers, tables and code for them, and their results."""

from __future__ import annotations

import math
import time
from functools import cache
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.jit import address_of
from dynkit.core.validation import Array
from dynkit.exponential.propagators import cells_of_a_call, workspace
from dynkit.systems.impact.elements.element import HALT, IMPACT, JUMP, REST, RIDES, EventKind
from dynkit.systems.impact.modes.constrained import ContactParadox
from dynkit.systems.impact.modes.mode import transformed
from dynkit.systems.impact.simulation.guard_sums import displaced, value_and_rate
from dynkit.systems.impact.simulation.state import (
    MOTIONS,
    TOUCHED,
    TWO_PI,
    ImpactState,
    Motion,
    state_of,
    sticking,
)
from dynkit.systems.impact.simulation.trajectory import Ending, Impacts, Switches, Trajectory

if TYPE_CHECKING:
    from dynkit.systems.impact.modes.steady_response import Layout
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure
    from dynkit.systems.impact.simulation.taylor.runs import TaylorCourse

MOST_CELLS = 1_000_000
"""Cells after which the search for the next event ends the run, with `Ending.SEARCH_LIMIT`.

The run also ends if more cells than this are searched between two enlargements of the log of
switches without an impact.
"""

MOST_SWITCHES = 1 << 16
"""Switches without an impact after which the run ends, with `Ending.SEARCH_LIMIT`."""

_ON_SECTION = 2.0**-44
"""Relative size below which a gap counts as zero: relative to the sum of its absolute terms, and to
its change in the smallest step. Rounding errors are smaller."""

_FEW = 32
"""Initial capacity of the log of switches."""

_ENDINGS = tuple(Ending)


@cache
def _kernels() -> Any:
    """Kernel modules of the clock, the loop and the log, imported at the first run."""
    from dynkit.systems.impact.simulation import clock_kernels, log_kernels, loop_kernels as kernels

    return clock_kernels, kernels, log_kernels


def band_factor(slots: int) -> float:
    """Half-width of the rounding band of a guard, in units of 2^-52 times its sum of amplitudes."""
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
    most_switches: int | None = None,
) -> Trajectory:
    """Simulate `count` impacts from a state of this oscillator; see `Course`."""
    began = time.perf_counter()
    course = course_from(oscillator, start, noise=noise, seed=seed, most_cells=most_cells)
    if isinstance(course, Course):
        course.most_switches = most_switches
    log = course.advance(count, store=store)
    found = course.trajectory(log, time.perf_counter() - began)
    if isinstance(course, Course):
        course.lend()
    return found


def to_contact(
    oscillator: DrivenStructure, start: ImpactState, count: int
) -> tuple[Trajectory, bool]:
    """Simulate up to `count` impacts; and whether the run ended before contact with a stop.

    The stop is that of the start. The run ends before contact if no motion has entered the mode of
    this contact. Otherwise it continues.
    """
    if oscillator._motion is not None:
        return trajectory_of(oscillator, start, count, store=True), False
    course = Course(oscillator, start, noise=0.0, seed=1, most_cells=MOST_CELLS)
    log = course.advance(count, store=True, lands=start.element)
    found = course.trajectory(log, 0.0), course.waits
    course.lend()
    return found


def course_from(
    oscillator: DrivenStructure,
    start: ImpactState,
    *,
    noise: float = 0.0,
    seed: int = 1,
    most_cells: int = MOST_CELLS,
    longest: float = 0.0,
) -> Course | TaylorCourse:
    """A simulation by the engine of this oscillator; see `Course`."""
    if oscillator._motion is not None:
        from dynkit.systems.impact.simulation.taylor.runs import TaylorCourse

        return TaylorCourse(oscillator, start, noise=noise, seed=seed)
    return Course(oscillator, start, noise=noise, seed=seed, most_cells=most_cells, longest=longest)


def log_of_impacts(rows: int, layout: Layout) -> Any:
    """A log of impacts for the kernels; its contents are undefined."""
    turns = np.empty((rows if layout.table < 0 else 0, 2))
    guard, states = np.empty(rows, dtype=np.intp), np.empty((rows, 2, layout.slots))
    return _kernels()[2].Impacts(*np.empty((2, rows)), guard, states, turns)


def log_of_switches(rows: int, slots: int) -> Any:
    """A log of switches for the kernels; only its states are defined, as zero."""
    numbers, states = np.empty((2, rows), dtype=np.intp), np.zeros((rows, 2, slots))
    return _kernels()[2].Switches(*np.empty((3, rows)), *numbers, states)


_LENT: list[tuple[Any, ...]] = []
"""Buffers of the last run that has ended, for reuse by the next run."""

_ADDRESSES: dict[Any, int] = {}
"""Addresses of machine code that runs have needed in this process."""


def fill_codes(
    gap: Any,
    tables: Any,
    clock: Array,
    left: Array,
    beside: int | None,
    noise: float,
    factor: float,
    impacts: Any,
    switches: Any,
    work: Any,
    waits: Array,
) -> None:
    """Put addresses of machine code into ``work.codes``; compile the code a run has paused for."""
    from dynkit.exponential import evaluation_kernels as own

    if noise > 0.0:
        work.codes[own.NOISE] = own.WANTED_CODE
    for place in range(own.CODES):
        if work.codes[place] == own.WANTED_CODE and (place, beside is None) not in _ADDRESSES:
            from dynkit.exponential import bound_kernels, certificate_kernels, search_kernels
            from dynkit.systems.impact.simulation.change_kernels import change

            if place == own.LEAP:
                given: Any = gap, 0, 0, 0, 0, 0, 0, factor, 0.0, True, 0, work.states
                code: Any = certificate_kernels.leap
            elif place == own.SEARCH:
                given, code = (gap, 0, 0.0, factor, True, 0, 0, 0, work), search_kernels.search
            elif place == own.DEATH:
                given, code = (gap, work.states, 0), bound_kernels.motion_died_out
            elif place == own.NOISE:
                given = gap, tables.slots[0], True, work.states, clock, left[0], noise, factor
                code = _kernels()[0].disturb
            else:
                motion = tables, clock, left, beside, noise, factor
                given = 0, 0, 0, 0.0, 0, *motion, impacts, switches, work, waits
                code = change
            _ADDRESSES[place, beside is None] = address_of(code, *given)
        work.codes[place] = _ADDRESSES.get((place, beside is None), 0)


@final
class Course:
    """A simulation that can be continued in pieces; the pieces do not change a bit of the result.

    `noise` is the relative size of pseudo-random disturbances of the start and of the states after
    impacts. Every number is disturbed relative to itself, and with noise / 32 relative to its bound
    along the flight. Offsets of guards are disturbed relative to the sum of their absolute terms.
    The bounds hold for flights of up to `longest`, or up to the longest flight so far. The search
    for an event ends after `most_cells`.

    Attributes
    ----------
    impacts : int
        Number of impacts so far.
    ending : Ending
        Why the simulation ended.
    most_switches : int
        Approximate number of switches without an impact after which it ends, with
        `Ending.SEARCH_LIMIT`; `MOST_SWITCHES` by default.
    """

    most_switches: int | None = None

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
        clock_kernels, kernels, _ = _kernels()
        free = oscillator._free
        q, turn = start._coordinates, start._turn
        clock = np.zeros(clock_kernels.CLOCK)
        clock[clock_kernels.GUARD] = start.element
        clock[clock_kernels.LEFT_FROM] = clock[clock_kernels.AMBIGUOUS] = -1
        clock[clock_kernels.MARKED] = -1.0
        clock[clock_kernels.SEED] = seed
        clock[clock_kernels.LONGEST] = longest
        self._left = np.zeros((len(oscillator._elements), clock_kernels.BEGIN))
        order = 3 if start.motion is Motion.RELEASE else 0
        self._left[start.element, :3] = MOTIONS.index(start.motion), order, start.speed
        self._shifts: Array | None = None
        if noise > 0.0:
            random, n = np.random.default_rng(seed), oscillator._size
            # Half of the disturbance covers the rounding of the change of coordinates.
            x, v = 0.5 * noise * random.uniform(-1.0, 1.0, (2, n)) * start._place
            q = q * (1.0 + noise * random.uniform(-1.0, 1.0, q.shape))
            assert free.forced.basis is not None
            q = free.steady(q + free.forced.basis.coordinates(x, v))
            turn = turn * (1.0 + noise * random.uniform(-1.0, 1.0, 2))
            self._left[start.element, 2] *= 1.0 + noise * random.uniform(-1.0, 1.0)
            elements = max(len(oscillator._elements), 2)
            self._shifts = noise * random.uniform(-1.0, 1.0, (elements, 2))
        clock[clock_kernels.SINE], clock[clock_kernels.COSINE] = turn
        if oscillator._strobed:
            clock[clock_kernels.REMAINING] = (TWO_PI - start.phase) / oscillator.frequency
        self._oscillator, self._start, self._noise = oscillator, start, noise
        self._most_cells, self._clock, self._full = most_cells, clock, (0, 0)
        self._waiting: Any = np.zeros(kernels.WAITING, dtype=np.int64), np.zeros(3)
        self._switches: Any = None
        self._prepare(kernels.START, free.states(q, *turn)[None])
        if noise > 0.0:
            generator = oscillator._automaton.guards[0].sum.generator
            slots = free.layout.modes
            clock_kernels.perturb_reached(generator, slots, self._work.states, clock, noise)
        for element in start.closed:
            self._close(element)
            if element in oscillator._automaton.parts.normal:
                self._left[element, clock_kernels.MOTION] = clock_kernels.STILL
        if oscillator._automaton.parts.sliders:
            self._stretch()
        if oscillator._cycled:
            self._leave_section()
        self.impacts, self.ending, self.waits = 0, Ending.COUNT_REACHED, False

    def _own(self, element: int) -> list[int]:
        """Numbers of the guards of an element in the mode at the start."""
        guards = self._oscillator._automaton.guards
        mode = guards[int(self._clock[_kernels()[0].GUARD])].mode
        return [k for k, g in enumerate(guards) if (g.mode, g.element) == (mode, element)]

    def _slip(self) -> None:
        """Enter the regimes of friction that slips at the start, for its direction of slip.

        The forces on elements that stick or hold then include this friction.
        """
        guards = self._oscillator._automaton.guards
        for k in set(range(len(self._oscillator._elements))).difference(self._start.closed):
            for number in [i for i in self._own(k) if guards[i].watch.event == JUMP]:
                there = self._work.states[_kernels()[1].START]
                value, _, size = value_and_rate(guards[number].sum, there)
                if value < -TOUCHED * size:
                    self._switch(number)
                    break

    def _close(self, element: int) -> None:
        """Enter contact with a stop on which the motion starts."""
        self._slip()
        automaton, own = self._oscillator._automaton, self._own(element)
        number = next((k for k in own if automaton.guards[k].watch.event == REST), -1)
        if number < 0 and own and automaton.guards[own[0]].watch.event in (IMPACT, HALT):
            number = own[0]
        if number < 0 and own and element in automaton.parts.sliders:  # the guard that is exceeded
            there = self._work.states[_kernels()[1].START]
            number = min(own, key=lambda k: value_and_rate(automaton.guards[k].sum, there)[0])
        if number >= 0:  # otherwise other elements hold its row
            self._switch(number)

    def _stretch(self) -> None:
        """Note which sticking sliders are at their limits, to rounding."""
        clock_kernels, automaton = _kernels()[0], self._oscillator._automaton
        mode = automaton.guards[int(self._clock[clock_kernels.GUARD])].mode
        x, places = self._start.position, self._start.sliders
        for k, place in zip(automaton.parts.sliders, places.tolist(), strict=True):
            element = self._oscillator._elements[k]
            row = element.row(len(x))
            stretch = element.sign * (float(row @ x) - place)
            rounding = TOUCHED * (float(abs(row) @ abs(x)) + abs(place))
            now = int(self._tables.slides[mode, k])
            if now in (0, RIDES) and abs(stretch) >= element.reach - rounding:
                self._left[k, clock_kernels.AT_LIMIT] = math.copysign(max(now, 1), stretch)

    def _switch(self, number: int) -> None:
        """Enter the mode that a guard leads to."""
        _, kernels, log_kernels = _kernels()
        automaton, clock = self._oscillator._automaton, self._clock
        guard = automaton.guards[number]
        automaton.enter(number)
        self._prepare(0, self._work.states)
        states = self._work.states
        begin = states[kernels.START][None]
        states[kernels.START] = transformed(self._tables.change[self._tables.row[number]], begin)[0]
        after = automaton.guard(guard.target, self._start.element)
        log_kernels.enter(number, after, clock, 0.0, 0.0, states, self._switches)

    def _leave_section(self) -> None:
        """Enter the mode beyond the section if a motion begins on it.

        Friction is beyond the section anyway because it sticks there.
        """
        clock_kernels, kernels, _ = _kernels()
        automaton, element = self._oscillator._automaton, self._oscillator._crossed.element
        k = self._oscillator._elements.index(element)
        mode = automaton.guards[int(self._clock[clock_kernels.GUARD])].mode
        number = automaton.guard(mode, k)
        guard = automaton.guards[number]
        if not automaton.marks(guard) or guard.watch.event == HALT:
            return
        value, rate, size = value_and_rate(guard.sum, self._work.states[kernels.START])
        near = _ON_SECTION * (size + abs(rate) * guard.sum.smallest)
        if abs(value) > near or rate >= 0.0:
            return
        self._switch(number)
        after = automaton.guards[guard.partner].sum
        rate = value_and_rate(after, self._work.states[kernels.START])[1]
        self._left[k, :3] = clock_kernels.SWITCHED, guard.watch.order, rate

    def _prepare(self, first: int, states: Array) -> None:
        """Make tables and buffers for the present modes; copy states into rows from `first` on."""
        self._tables = self._oscillator._automaton.tables
        slots = self._tables.ladders.step.shape[3]
        if self._shifts is not None:
            # Another thread may have entered more modes in the meantime.
            terms = self._oscillator._automaton.rest_terms()[: len(self._tables.event)]
            self._tables = displaced(self._tables, terms, self._shifts)
        if self._switches is not None or not self._borrows(slots):
            self._work = workspace(slots)
            self._enlarge(slots)
        self._work.states[first : first + len(states), :, : states.shape[2]] = states

    def _key(self, slots: int) -> tuple[Any, ...]:
        """Key of buffers that a run can reuse: their size, and the kind of machine code."""
        return slots, len(self._left), self._oscillator._automaton.beside is None

    def lend(self) -> None:
        """Leave the buffers to the next run if this run had no noise and logged no switches."""
        if not (self._noise or self._clock[_kernels()[0].SWITCHES]):
            slots = self._work.states.shape[2]
            _LENT[:] = [(self._key(slots), self._work, self._switches)]

    def _borrows(self, slots: int) -> bool:
        """Reuse the buffers of an earlier run if they fit; they contain the addresses of code."""
        try:
            key, work, switches = _LENT.pop()
        except IndexError:
            return False
        if self._noise or key != self._key(slots):
            return False
        work.states.fill(0.0)
        work.places.fill(0)
        self._work, self._switches = work, switches
        return True

    def _enlarge(self, slots: int) -> None:
        """Enlarge the log of switches."""
        clock_kernels, old, rows = _kernels()[0], self._switches, _FEW + 2 * len(self._left)
        if old is not None:
            rows = max(rows, 2 * int(self._clock[clock_kernels.SWITCHES]))
        self._switches = log_of_switches(rows, slots)
        for few, more in zip(old or (), self._switches, strict=False):
            more[tuple(map(slice, few.shape))] = few

    def _hits_nothing(self) -> bool:
        """Whether the limit on switches since the last impact is exceeded."""
        clock_kernels, before = _kernels()[0], self._switches.before
        count, impacts = self._clock[[clock_kernels.SWITCHES, clock_kernels.IMPACTS]].astype(int)
        most = MOST_SWITCHES if self.most_switches is None else self.most_switches
        return bool(count > most and before[count - most] == impacts)

    def _tires(self) -> bool:
        """Whether too many cells, and no impact, came since the log of switches was last full."""
        (impacts, cells), clock_kernels = self._full, _kernels()[0]
        self._full = int(self._clock[clock_kernels.IMPACTS]), self.cells
        return self._full[0] == impacts and self._full[1] - cells > self._most_cells

    def _refuse_law(self) -> None:
        """Raise the ValueError of an impact law that gives no restitution in [0, 1]."""
        guard, velocity = int(self._clock[_kernels()[0].WANTED]), float(self._waiting[1][1])
        stop = self._oscillator._stops[self._oscillator._automaton.table[guard, 1]]
        stop.restitution.at(velocity)

    def _hangs(self) -> bool:
        """Whether the last switches are at a preloaded stop, and too many in one period.

        A force that jumps drives a mass back across the edge of the stop from both sides. Damping
        makes its velocity u decay exponentially, and each crossing takes 2 u/a.
        """
        count, few = int(self._clock[_kernels()[0].SWITCHES]), MOST_SWITCHES // 64
        if count < few:  # the limit on switches was set lower
            return False
        times, guard = self._switches.time[:count], self._switches.guard[count - 1]
        last = self._oscillator._elements[self._oscillator._automaton.table[guard, 1]]
        turns = (times[-1] - times[-few]) * self._oscillator.frequency / TWO_PI
        return bool(getattr(last, "preload", 0.0) > 0.0 and turns * MOST_SWITCHES < few)

    def advance(self, count: int, *, store: bool, lands: int | None = None) -> Impacts:
        """Simulate up to `count` further impacts; return their log, empty unless stored.

        It ends before contact with the stop `lands` if no motion has entered the mode of this
        contact; then `waits` is true.
        """
        kernels, free, rows = _kernels()[1], self._oscillator._free, count if store else 0
        slots = free.layout.slots
        log: Any = log_of_impacts(rows, free.layout)
        done, ending, paradox = 0, kernels.RUN_PAUSED, False
        gap = self._oscillator._automaton.guards[0].sum
        given = self._oscillator._automaton.beside, self._noise, band_factor(slots)
        limits = self._most_cells, cells_of_a_call(slots)
        while ending in kernels.AGAIN:
            rows = log._make([array[done:] for array in log]) if store and done else log
            motion = self._tables, self._clock, self._left
            buffers = rows, self._switches, self._work
            fill_codes(gap, *motion, *given, *buffers, self._waiting[1])
            impacts, ending = kernels.run(
                *motion, count - done, *given, *limits, *buffers, *self._waiting
            )
            done += impacts
            if ending == kernels.MODE_WANTED:
                wanted, table = int(self._clock[kernels.WANTED]), self._oscillator._automaton.table
                self.waits = table[wanted, 1::2].tolist() == [lands, EventKind.CONTACT]
                if self.waits:
                    ending = kernels.COUNT_REACHED
                    break
                try:
                    self._oscillator._automaton.enter(wanted)
                except ContactParadox:
                    paradox = True
                    break
                self._prepare(0, self._work.states)
            elif ending == kernels.SWITCHES_FULL:
                self._enlarge(self._work.states.shape[2])
                if self._tires() or self._hits_nothing():
                    ending = kernels.SEARCH_LIMIT
        if ending == kernels.LAW_BROKEN:
            self._refuse_law()
        self.impacts += done
        self.ending = Ending.PARADOX if paradox else _ENDINGS[ending]
        if self.ending is Ending.SEARCH_LIMIT and self._hits_nothing() and self._hangs():
            self.ending = Ending.HANGS
        return Impacts(*(array[:done] for array in log))

    @property
    def cells(self) -> int:
        """Cells of all searches so far."""
        return int(self._clock[_kernels()[0].CELLS])

    def trajectory(self, log: Impacts, seconds: float) -> Trajectory:
        """The trajectory of all events so far, with a log of impacts."""
        clock_kernels, kernels, _ = _kernels()
        oscillator, clock = self._oscillator, self._clock
        free, k = oscillator._free, int(clock[clock_kernels.SWITCHES])
        state, automaton = self._work.states[kernels.START], oscillator._automaton
        mode, element, _, _ = automaton.table[int(clock[clock_kernels.GUARD])].tolist()
        kind, _, speed = self._left[element, :3].tolist()
        motion = MOTIONS[int(kind)]
        closed: list[int] = []
        switched = element if element >= len(oscillator._stops) else -1
        if mode:
            state, closed = automaton.freed(mode, state)
        if automaton.beside is not None:
            still = self._left[:, clock_kernels.MOTION] == clock_kernels.STILL
            closed += [k for k in np.flatnonzero(still).tolist() if k not in closed]
        hard = [k for k in closed if k < len(oscillator._stops)]
        if hard and (element in hard or element >= len(oscillator._stops)):
            speed, element, motion = 0.0, hard[0], Motion.TABLE
        elif element >= len(oscillator._stops):
            element, motion = 0, Motion.FLIGHT
        closed, ending = [k for k in closed if k != element or oscillator._strobed], self.ending
        if hard and ending is Ending.NO_FURTHER_CONTACT:
            ending = Ending.CONTACT_FOR_EVER
        if oscillator._cycled and ending in (Ending.NO_FURTHER_CONTACT, Ending.DIED_OUT):
            ending = Ending.CYCLE_ENDED
        q, sine, cosine = free.parts(state[:, : free.layout.slots])
        turn = np.array([sine, cosine])
        if free.layout.table < 0:
            turn = clock[[clock_kernels.SINE, clock_kernels.COSINE]]
        reached = state_of(oscillator, q, turn, speed, element, motion, tuple(closed))
        if switched not in (-1, *closed) and not oscillator._cycled:
            # Just as slip begins, the velocity does not show its direction: store it as sticking.
            places = reached.position, reached.velocity, turn, tuple(hard)
            if switched in sticking(oscillator, *places):
                closed.append(switched)
                reached = state_of(oscillator, q, turn, speed, element, motion, tuple(closed))
        return Trajectory(
            self._start,
            reached,
            log,
            Switches(*(array[:k] for array in self._switches)),
            tuple(automaton.regimes),
            automaton.table,
            self.impacts,
            ending,
            float(clock[clock_kernels.CHATTER_ERROR]),
            self.cells,
            int(clock[clock_kernels.TOUCHES]),
            seconds,
            float(clock[clock_kernels.LONGEST]),
            float(clock[clock_kernels.TIME]),
            int(clock[clock_kernels.AMBIGUOUS]),
            float(clock[clock_kernels.TIME]),
        )
