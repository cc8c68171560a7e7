"""What unknowns of an itinerary's equations stand for: states at its events, and all between."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, final

import numpy as np

from dynkit.core.kept import kept
from dynkit.core.validation import Array, read_only
from dynkit.systems.impact.modes.progression import Progression
from dynkit.systems.impact.orbits.flights import Curve
from dynkit.systems.impact.orbits.itineraries.itinerary import Course
from dynkit.systems.impact.simulation.state import SHEET, TWO_PI

ROUNDING = 32.0 * 2.0**-52
"""Of each term of an equation, relative: rows, kicks, sines and transitions are rounded."""

LATE = 2.0 * 2.0**-52
"""Of the period, relative: it is a rounded multiple of a rounded turn, divided and rounded."""


SAME = 1e-6
"""In units of a period: how far a simulated event may be from that of the orbit."""

AT_ONCE = 2.0**-45
"""In units of a period: events so near happen at once, as of a symmetric machine."""

_ROUNDING = 64.0 * 2.0**-52
"""In units of the largest position: rounding of gaps."""


class Lap(NamedTuple):
    """The unknowns of an itinerary of n events and k impacts.

    Attributes
    ----------
    phases : (n + 1,)
        Of the events, and of the first one a period later.
    turn : Any
        Time of a turn of the phase, where nothing drives the machine.
    impulses : (k,)
    states : (j, 2N + J)
        Just before the events that are nodes; none where they follow from the impulses.
    """

    phases: Array
    turn: Any
    impulses: Array
    states: Array


class ItinerarySolution(ABC):
    """The motion of an itinerary at given unknowns and parameters, whether it is possible or not.

    It has n impacts, without those of a chatter, and k states, from which the motion can be
    simulated: P(n,m) just after each impact, P(inf,m) at each release.

    A subclass must implement what is abstract here, and in addition, for guards (n,), laws of the
    impacts (k,), and what becomes of each unknown state less the next one, (m,) together:

    1. ``left``, what is left of these equations;
    2. ``jacobian(multiplier)``, their derivative D(multiplier), (m, m);
    3. ``rounding``, what rounding may make of them;
    4. ``change(change)``, their derivative by a change of all numbers; None where it is not known;
    5. ``before``, positions and velocities (n, 2N), or more, just before the events.

    Parameters
    ----------
    oscillator : ImpactMap
    measures : (D,)
        What states are measured in.
    course : Course
    lap : Lap
    clock : Any
        Frequency of the phase, complex where the machine is.
    """

    LARGEST: ClassVar[int] = 50
    """Of so many coordinates at most derivatives by complex steps: of the third power of them."""

    blind: ClassVar[bool]
    """Whether dips below rounding are not told from none, as flights may begin at zero."""

    def __init__(
        self, oscillator: Any, measures: Array, course: Course, lap: Lap, clock: Any
    ) -> None:
        self.oscillator, self.measures = oscillator, measures
        self.progression: Progression = oscillator._progression
        self.course, self.lap, self.clock = course, lap, clock
        self.itinerary, self.following = course.itinerary, course.following
        self.hits, self.impulse_of, self.sides = course.hits, course.impulse_of, course.sides
        self.events = len(self.itinerary)
        self.impulses, self.event_phases = lap.impulses, lap.phases[:-1]

    @property
    def durations(self) -> Any:
        """Times (n,) from each event to the next, negative where their order is another one."""
        return np.diff(self.lap.phases) / self.clock

    def least_apart(self, i: int, size: float) -> float:
        """Part of a period within which the order of event number `i` and the next is rounding.

        That of slow impacts is rounding of gaps, at positions of some size, over the impulses.
        """
        pair = [k for k in (i, (i + 1) % self.events) if k in self.impulse_of]
        slowest = min(abs(float(self.impulses[self.impulse_of[k]])) for k in pair) if pair else 0.0
        if len(pair) < 2 or slowest == 0.0:
            return AT_ONCE
        return max(AT_ONCE, _ROUNDING * size / (slowest * float(self.period)))

    # --- states -----------------------------------------------------------------------------------

    @property
    @abstractmethod
    def restitutions(self) -> Any:
        """Coefficients of restitution (k,) of the impacts."""

    @property
    def reached(self) -> Any:
        """Whole states (n, D) just before the next events, of motions with unknown states."""
        raise NotImplementedError

    @property
    @abstractmethod
    def whole(self) -> Array:
        """Positions and velocities (n, 2N), or more, just after the events."""

    @abstractmethod
    def passed(self, since: Array) -> Array:
        """States (j, 2N + J) at times (j,) from the first event on, in one period."""

    # --- what is watched --------------------------------------------------------------------------

    @final
    @kept
    def curve(self, i: int, element: int, guard: int = 0) -> Curve:
        """What an element watches from event number `i` to the next."""
        return self._curve(i, element, guard)

    @abstractmethod
    def _curve(self, i: int, element: int, guard: int) -> Curve:
        """The same, not kept."""

    @abstractmethod
    def size_of(self, i: int, element: int, guard: int) -> float:
        """What it is measured in."""

    def begins(self, i: int) -> float:
        """Phase from which it is watched: of event number `i`, or of contact after its chatter."""
        return float(self.event_phases[i])

    def ends(self, i: int) -> tuple[int, int]:
        """Numbers of the events between which it is watched."""
        return i, (i + 1) % self.events

    @abstractmethod
    def acceleration(self, i: int) -> tuple[float, float]:
        """That of the gap just after impact number `i`; what rounding makes of it."""

    # --- the motion -------------------------------------------------------------------------------

    @property
    def frequency(self) -> float:
        """Of the phase, that of the forcing where there is one."""
        return float(self.clock)

    @property
    def period(self) -> float:
        """Time until the motion repeats itself."""
        return float((self.lap.phases[-1] - self.event_phases[0]) / self.clock)

    @property
    def impact_phases(self) -> Array:
        """Phases (n,) of the impacts, not wrapped."""
        return read_only(self.event_phases[self.hits])

    @property
    def relative_velocity(self) -> Array:
        """Relative velocities (n,) just after the impacts; negative on the far side of a play."""
        r = self.restitutions
        u = r / (1.0 + r) * np.maximum(self.impulses, 0.0)
        return np.asarray(np.where((self.sides == 1) & self.oscillator._faces, -u, u))

    @property
    def phases(self) -> Array:
        """Phases (k,) of the section states, not wrapped, read-only.

        Of releases, of impacts, of periods that begin, or of all events.
        """
        if self.course.sticks:
            return read_only(self.event_phases[list(self.course.nodes)])
        if len(self.hits):
            return self.impact_phases
        if not self.oscillator._excitation.turns:
            return self.event_phases
        turns = round((self.lap.phases[-1] - self.event_phases[0]) / TWO_PI)
        first = np.ceil(self.event_phases[0] / TWO_PI - 1e-12)
        return read_only(TWO_PI * (first + np.arange(turns)))

    @property
    def progress(self) -> Array:
        """Change (2N + J,) of the state in a period, of a machine that progresses."""
        return np.asarray(self._elsewhere[-1])

    @cached_property
    def _elsewhere(self) -> Array:
        """Shifts (n + 1, 2N + J) from the first node to each event, and to the end of the period.

        States at nodes are without the shift of a machine that progresses.
        """
        along = self.progression
        out = np.zeros((self.events + 1, len(along.shift)))
        for node in (*self.course.nodes[1:], self.events) if along.shift.size else ():
            ended = self.reached[node - 1, : len(along.shift)]
            out[node:] += ended - along.removed(ended)
        return out

    @final
    def _at(self, since: Array) -> Array:
        """States (j, 2N + J) at any times (j,) from the first event on."""
        states = self.passed(since % self.period)
        if (progress := self.progress).any():
            states = states + np.outer(since // self.period, progress)
        return states

    @property
    def section_states(self) -> Array:
        """Section coordinates (k, 2N) of the states."""
        if not len(self.hits):
            return self._at((self.phases - self.event_phases[0]) / self.clock)
        n, system = self.oscillator.degrees_of_freedom, self.oscillator
        some, sides, speeds = self.hits, self.sides, self.relative_velocity
        if self.course.sticks:
            some = list(self.course.nodes)
            sides = np.array([self.itinerary[i].element for i in some])
            speeds = np.where((sides == 1) & system._faces, -0.0, 0.0)
        whole = self.whole[some]
        found = np.empty((len(some), system.dimension))
        found[:, -2] = speeds
        found[:, -1] = self.event_phases[some] % TWO_PI + SHEET * sides * system._several
        for side in np.unique(sides).tolist():
            others = system._others[side]
            here = np.flatnonzero(sides == side)[:, None]
            kept = np.concatenate([others, n + others, 2 * n + np.arange(len(system._sliders))])
            found[here[:, 0], :-2] = whole[here, kept]
        return found

    def sample(self, since: Array) -> tuple[Array, Array]:
        """Positions and velocities (j, N) at times (j,) from the first state on, in one period."""
        late = float(self.phases[0] - self.event_phases[0]) / self.clock
        z, n = self._at(since + late), self.oscillator.degrees_of_freedom
        return z[:, :n], z[:, n : 2 * n]

    @property
    def bounces(self) -> tuple[Array, Array]:
        """Phases and relative velocities (l,) of all impacts, those of chatters included."""
        return self.impact_phases, self.relative_velocity

    @property
    def chatter_error(self) -> float:
        """Largest change of a position or velocity by replacing the rest of a chatter."""
        return 0.0

    @property
    def contact_phases(self) -> Array:
        """Phases (c, 2) at which contacts begin and end."""
        found = [
            [self.begins(i), self._released(i, k)]
            for i, (event, after) in enumerate(zip(self.itinerary, self.following, strict=True))
            for k in range(len(self.oscillator._stops))
            if k in after.mode.held and k not in event.mode.held
        ]
        return np.array(found).reshape(-1, 2)

    def _released(self, i: int, stop: int) -> float:
        """Phase at which a contact that event number `i` begins is over."""
        for j in range(i + 1, i + self.events + 1):
            turns, k = divmod(j, self.events)
            if stop not in self.following[k].mode.held:
                lasts = self.lap.phases[-1] - self.event_phases[0]
                return float(self.event_phases[k] + turns * lasts)
        return float("inf")
