"""What unknowns of an itinerary's equations stand for: states at its events, and all between."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.flights import Curve
from dynkit.systems.impact.orbits.itineraries.itinerary import Itinerary
from dynkit.systems.impact.orbits.machine import Machine, exponentials
from dynkit.systems.impact.orbits.solution import Solution
from dynkit.systems.impact.simulation.state import SHEET, TWO_PI

_ROUNDING = 2.0**-52


class Scene(NamedTuple):
    """The machine at some parameters, the oscillator, and what states are measured in, (D,)."""

    machine: Machine
    oscillator: Any
    measures: Array


class Lap(NamedTuple):
    """The unknowns of an itinerary of n events and k impacts.

    Attributes
    ----------
    phases : (n + 1,)
        Of the events, and of the first one a period later.
    turn : Any
        Time of a turn of the phase.
    impulses : (k,)
    states : (n, 2N)
        Just before the events.
    """

    phases: Array
    turn: Any
    impulses: Array
    states: Array


@final
class ItinerarySolution(Solution):
    """The motion of an itinerary.

    Parameters
    ----------
    scene : Scene
    itinerary : Itinerary
    lap : Lap
    driven : bool
    """

    def __init__(self, scene: Scene, itinerary: Itinerary, lap: Lap, driven: bool) -> None:
        self.machine, self.oscillator, self.measures = scene
        self.itinerary, self.lap, self.driven = itinerary, lap, driven
        self.events = len(itinerary)
        self.clock = self.machine.frequency if driven else TWO_PI / lap.turn
        self.hits = [i for i, event in enumerate(itinerary) if event.kicked]
        self.impulse_of = dict(zip(self.hits, range(len(self.hits)), strict=True))
        self.impulses, self.event_phases = lap.impulses, lap.phases[:-1]
        self.sides = np.array([itinerary[i].element for i in self.hits], dtype=np.intp)
        self.parts = [range(self.events)]

    # --- what equations ask for; with complex numbers of a machine complex ------------------------

    @cached_property
    def durations(self) -> Any:
        """Times (n,) from each event to the next."""
        return np.diff(self.lap.phases) / self.clock

    @cached_property
    def before(self) -> Array:
        """Whole states (n, D) just before the events."""
        phases = self.event_phases
        turning = np.stack([np.sin(phases), np.cos(phases), np.ones_like(phases)], axis=1)
        return np.concatenate([self.lap.states, turning], axis=1)

    @cached_property
    def kicks(self) -> Any:
        """Changes (n, D) by unit impulses; zero where there is none."""
        kicks = [
            self.machine.kick(e.kicked, e.element) if e.kicked else np.zeros(self.before.shape[1])
            for e in self.itinerary
        ]
        return np.array(kicks)

    @cached_property
    def resets(self) -> Any:
        """(n, D, D): rates of what begins to hold, or to stick, are lost."""
        return np.array(
            [
                self.machine.caught(event.mode, after.mode)
                for event, after in zip(self.itinerary, self._following, strict=True)
            ]
        )

    @property
    def _following(self) -> Itinerary:
        return *self.itinerary[1:], self.itinerary[0]

    @cached_property
    def after(self) -> Any:
        """Whole states (n, D) just after the events."""
        pushed = self.before.astype(self.kicks.dtype)
        for i, k in self.impulse_of.items():
            pushed[i] = pushed[i] + self.impulses[k] * self.kicks[i]
        return np.asarray((self.resets @ pushed[:, :, None])[:, :, 0])

    @cached_property
    def flows(self) -> Any:
        """A, (n, D, D), of the modes that follow the events."""
        return np.array([self.machine.flow(event.mode) for event in self._following])

    @cached_property
    def transitions(self) -> Any:
        """(n, D, D) from just after each event to just before the next."""
        return moved(self.flows, self.durations, self.measures)

    @cached_property
    def reached(self) -> Any:
        """Whole states (n, D) just before the next events."""
        return (self.transitions @ self.after[:, :, None])[:, :, 0]

    @cached_property
    def guards(self) -> Any:
        """Rows (n, D) of what is zero at the events; zero where a period begins."""
        none = np.zeros(self.before.shape[1])
        return np.array(
            [
                self.machine.watched(e.mode, e.element, e.guard) if e.element >= 0 else none
                for e in self.itinerary
            ]
        )

    @cached_property
    def rates(self) -> Any:
        """Rows (k, D) of the rates of the gaps that impacts close."""
        rows = [self.machine.rate(int(side)) for side in self.sides]
        return np.array(rows).reshape(len(rows), self.before.shape[1])

    @cached_property
    def returned(self) -> Any:
        """By how much of the impulse the gap opens after each impact, (k,): r / (1 + r)."""
        r = np.array([self.machine.restitution(int(side)) for side in self.sides])
        return r / (1.0 + r)

    @cached_property
    def rounded(self) -> Array:
        """What rounding may make of `reached`, (n, D), to first order."""
        m = self.measures
        scaled = abs(self.flows) * m / m[:, None]
        norms = scaled.sum(axis=1).max(axis=1) * abs(self.durations)
        sizes = abs(self.transitions) @ abs(self.after)[:, :, None]
        level = (sizes[:, :, 0] / m).max(axis=1, keepdims=True)
        turned = 1.0 + abs(self.lap.phases).max()
        late = turned / self.clock * abs(self.flows @ self.reached[:, :, None])[:, :, 0]
        return np.asarray(_ROUNDING * ((8.0 + norms[:, None]) * level * m + 2.0 * late))

    # --- the motion -------------------------------------------------------------------------------

    @property
    def frequency(self) -> float:  # type: ignore[override]
        """Of the phase."""
        return float(self.clock)

    @property
    def period(self) -> float:  # type: ignore[override]
        """Time until the motion repeats itself."""
        return float((self.lap.phases[-1] - self.event_phases[0]) / self.clock)

    @property
    def impact_phases(self) -> Array:  # type: ignore[override]
        """Phases (k,) of the impacts."""
        return np.asarray(self.event_phases[self.hits])

    @property
    def relative_velocity(self) -> Array:
        u = self.returned * np.maximum(self.impulses, 0.0)
        return np.asarray(np.where((self.sides == 1) & self.oscillator._faces, -u, u))

    @property
    def phases(self) -> Array:  # type: ignore[override]
        """Phases of the section states: of impacts, of periods that begin, or of all events."""
        if len(self.hits):
            return self.impact_phases
        if not self.driven:
            return self.event_phases
        turns = round((self.lap.phases[-1] - self.event_phases[0]) / TWO_PI)
        first = np.ceil(self.event_phases[0] / TWO_PI - 1e-12)
        return np.asarray(TWO_PI * (first + np.arange(turns)))

    @property
    def section_states(self) -> Array:
        if not len(self.hits):
            x, v = self.sample((self.phases - self.phases[0]) / self.clock)
            return np.concatenate([x, v], axis=1)
        n, found = self.machine.size, []
        u = self.relative_velocity
        for k, i in enumerate(self.hits):
            side, z = int(self.sides[k]), self.after[i]
            others = self.oscillator._contacts[side].others
            phase = self.event_phases[i] % TWO_PI + SHEET * side * self.oscillator._several
            found.append([*z[others], *z[n + others], u[k], phase])
        return np.array(found)

    def sample(self, since: Array) -> tuple[Array, Array]:
        begin = (self.event_phases - self.event_phases[0]) / self.clock
        late = float(self.phases[0] - self.event_phases[0]) / self.clock
        since = (since + late) % self.period
        which = np.clip(np.searchsorted(begin, since, side="right") - 1, 0, None)
        z = moved(self.flows[which], since - begin[which], self.measures)
        z = (z @ self.after[which][:, :, None])[:, :, 0]
        n = self.machine.size
        return z[:, :n], z[:, n : 2 * n]

    @property
    def contact_phases(self) -> Array:
        found = [
            [self.event_phases[i], self._released(i, k)]
            for i, (event, after) in enumerate(zip(self.itinerary, self._following, strict=True))
            for k in range(len(self.oscillator._stops))
            if k in after.mode.held and k not in event.mode.held
        ]
        return np.array(found).reshape(-1, 2)

    def _released(self, i: int, stop: int) -> float:
        """Phase at which a contact that event number `i` begins is over."""
        for j in range(i + 1, i + self.events + 1):
            turns, k = divmod(j, self.events)
            if stop not in self._following[k].mode.held:
                lasts = self.lap.phases[-1] - self.event_phases[0]
                return float(self.event_phases[k] + turns * lasts)
        return float("inf")

    # --- what is watched --------------------------------------------------------------------------

    def curve(self, i: int, element: int, guard: int) -> Curve:
        """What an element watches from event number `i` to the next."""
        mode = self._following[i].mode
        row, flow = self.machine.watched(mode, element, guard), self.flows[i]
        start, m = self.after[i], self.measures
        rows = [row, row @ flow, row @ flow @ flow]

        def values(times: Array, orders: int) -> Array:
            states = _run_through(flow, start, times, m)
            return np.array([r @ states.T for r in rows[:orders]])

        ends = np.maximum(abs(start), abs(self.reached[i]))
        sizes = float(abs(rows[0]) @ ends), float(abs(rows[2]) @ ends)
        return Curve(values, float(self.durations[i]), sizes)


def _run_through(flow: Array, start: Array, times: Array, measures: Array) -> Array:
    """States (k, D) at times (k,) from a start; of equal steps from zero on by doubling."""
    count, step = len(times), float(times[-1]) / max(len(times) - 1, 1)
    if count < 4 or times[0] != 0.0 or (abs(np.diff(times) - step) > 1e-12 * times[-1]).any():
        each = np.broadcast_to(flow, (count, *flow.shape))
        return np.asarray(moved(each, times, measures) @ start)
    matrix, out = moved(flow[None], np.array([step]), measures)[0], start[None]
    while len(out) < count:
        out = np.concatenate([out, out @ matrix.T])
        matrix = matrix @ matrix
    return out[:count]


def moved(flows: Any, lasts: Any, measures: Array) -> Any:
    """exp(A t), (n, D, D), in units in which states are of order one."""
    scaled = flows * measures / measures[:, None] * np.asarray(lasts)[:, None, None]
    return np.asarray(exponentials(scaled)) * measures[:, None] / measures
