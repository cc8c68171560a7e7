"""The motion of an itinerary at given unknowns: states at its events, and flights in between."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple, final

import numpy as np

from dynkit.core.angles import in_turn
from dynkit.core.kept import cached_property, kept
from dynkit.core.validation import Array, read_only
from dynkit.systems.impact.modes.progression import Progression
from dynkit.systems.impact.orbits.flights import Curve
from dynkit.systems.impact.orbits.itineraries.itinerary import Course
from dynkit.systems.impact.simulation.state import SHEET, TWO_PI

ROUNDING = 32.0 * 2.0**-52
"""Relative rounding error of each term of an equation: of rows, kicks, sines and transitions."""

LATE = 2.0 * 2.0**-52
"""Relative rounding error of the period: 2 pi, its multiple and the quotient are rounded."""


SAME = 1e-6
"""Largest time, in periods, between a simulated event and the same event of the orbit."""

AT_ONCE = 2.0**-45
"""Events within this time, in periods, are simultaneous, such as those of a symmetric machine."""

_ROUNDING = 64.0 * 2.0**-52
"""Rounding error of gaps, relative to the largest position."""


class Lap(NamedTuple):
    """The unknowns of an itinerary of n events and k impacts.

    Attributes
    ----------
    phases : (n + 1,)
        Phases of the events, and of the first one a period later.
    turn : Any
        Time of one turn of the phase, where nothing drives the machine.
    impulses : (k,)
    states : (j, 2N + J)
        States just before the nodes; none where they follow from the impulses.
    """

    phases: Array
    turn: Any
    impulses: Array
    states: Array


class ItinerarySolution(ABC):
    """The motion of an itinerary at given unknowns and parameters, admissible or not.

    It has n impacts, without those of a chatter, and k section states, from which the motion can be
    simulated: P(n,m) just after each impact, P(inf,m) at each release.

    The m equations are the guards (n,), the impact laws (k,), and the states reached from each node
    less the next node's. A subclass must implement the abstract methods and:

    1. ``left``, the residual (m,) of the equations;
    2. ``jacobian(multiplier)``, its derivative D(multiplier), (m, m);
    3. ``rounding``, rounding errors (m,) of the residual;
    4. ``change(change)``, its derivative by a change of all numbers; None where it is not known;
    5. ``before``, positions and velocities (n, 2N), or more, just before the events.

    Parameters
    ----------
    oscillator : ImpactMap
    measures : (D,)
        Units of states.
    course : Course
    lap : Lap
    clock : Any
        Frequency of the phase, complex where the machine is.
    """

    LARGEST: ClassVar[int] = 50
    """Most coordinates for derivatives by complex steps, whose cost is the third power of them."""

    blind: ClassVar[bool]
    """Whether minima below rounding are ignored, as guards may be zero where flights begin."""

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
        """Times (n,) from each event to the next, negative where they are in reverse order."""
        return np.diff(self.lap.phases) / self.clock

    def least_apart(self, i: int, size: float) -> float:
        """Fraction of a period within which rounding decides the order of event `i` and the next.

        For two impacts it is at least the rounding error of gaps, at positions of this size,
        divided by the smaller impulse.
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
        """Whole states (n, D) just before the next events, for motions with unknown states."""
        raise NotImplementedError

    @property
    @abstractmethod
    def whole(self) -> Array:
        """Positions and velocities (n, 2N), or more, just after the events."""

    @abstractmethod
    def passed(self, since: Array) -> Array:
        """States (j, 2N + J) at times (j,) from the first event on, in one period."""

    # --- guards between events --------------------------------------------------------------------

    @final
    @kept
    def curve(self, i: int, element: int, guard: int = 0) -> Curve:
        """A guard of an element as a curve, from event number `i` to the next event."""
        return self._curve(i, element, guard)

    @abstractmethod
    def _curve(self, i: int, element: int, guard: int) -> Curve:
        """Compute the curve that `curve` keeps."""

    @abstractmethod
    def size_of(self, i: int, element: int, guard: int) -> float:
        """Unit of the guard of an element after event number `i`."""

    def begins(self, i: int) -> float:
        """Phase at which the curve begins: event number `i`, or the contact after its chatter."""
        return float(self.event_phases[i])

    def ends(self, i: int) -> tuple[int, int]:
        """Numbers of the events between which the curve lasts."""
        return i, (i + 1) % self.events

    @abstractmethod
    def acceleration(self, i: int) -> tuple[float, float]:
        """Acceleration of the gap just after impact number `i`, and its rounding error."""

    # --- the motion -------------------------------------------------------------------------------

    @property
    def frequency(self) -> float:
        """Angular frequency of the phase; that of the forcing where there is one."""
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

        These are the phases of releases, of impacts, of begins of periods, or of all events.
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
        """Change (2N + J,) of the state in a period; not zero if the machine progresses."""
        return np.asarray(self._elsewhere[-1])

    @cached_property
    def _elsewhere(self) -> Array:
        """Shifts (n + 1, 2N + J) from the first node to each event, and to the end of the period.

        The unknown states at nodes do not contain the shift of a machine that progresses.
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
        """Section coordinates (k, 2N + J) of the states."""
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
        found[:, -1] = in_turn(self.event_phases[some]) + SHEET * sides * system._several
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
        """Largest change of a position or velocity by the omission of bounces of a chatter."""
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
        """Phase at which the contact with a stop ends that begins at event number `i`."""
        for j in range(i + 1, i + self.events + 1):
            turns, k = divmod(j, self.events)
            if stop not in self.following[k].mode.held:
                lasts = self.lap.phases[-1] - self.event_phases[0]
                return float(self.event_phases[k] + turns * lasts)
        return float("inf")
