"""Borders at which a guard of an element is zero just at an event of another element."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, final

from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.kinds import BifurcationKind
from dynkit.systems.impact.elements.element import HALT
from dynkit.systems.impact.elements.stops import SoftStop
from dynkit.systems.impact.orbits.borders import Border
from dynkit.systems.impact.orbits.itineraries.happening import Happening
from dynkit.systems.impact.orbits.itineraries.itinerary import with_regime
from dynkit.systems.impact.orbits.itineraries.motion import SAME
from dynkit.systems.impact.orbits.itineraries.several_modes.divided import watch_of
from dynkit.systems.impact.orbits.machine import Regimes

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.itineraries.motion import ItinerarySolution

ZERO = 16.0
"""A curve whose first value is below this many rounding errors begins at zero."""


def opens(s: ItinerarySolution, i: int) -> bool:
    """Whether the gap of a preloaded soft stop opens at event `i`, with a positive force."""
    event = s.itinerary[i]
    watch, own = watch_of(s.oscillator, event), s.oscillator._elements[event.element]
    preloaded = isinstance(own, SoftStop) and own.preload > 0.0
    return preloaded and watch.gap < 0.0 and not (watch.rate or watch.force)


@final
class Corner(Border):
    """A guard of another element is zero at an event, just before or after which it is positive.

    Beyond this border that element would switch just before the event, or just after it. A guard
    that is continuous at the event has its minimum there; otherwise it jumps at the event. In one
    case the guard is of the event's own element: the force of a preloaded stop with a dashpot,
    where its gap opens.

    Parameters
    ----------
    problem : ItineraryEquations
    part : int
        Number of the event.
    element, guard : int
    late : bool
        Whether the guard is watched just after the event, and not just before it.
    """

    kind, ends = BifurcationKind.GR, False
    problem: Any

    def __init__(self, problem: Any, part: int, element: int, guard: int, late: bool) -> None:
        super().__init__(problem, part, guard, element)
        modes = [problem.itinerary[i % len(problem.itinerary)].mode for i in (part, part + 1)]
        self.late, self.both = late, all((element, guard) in mode.watched for mode in modes)
        if element in modes[late].held and element < len(problem.oscillator._stops):
            self.kind = BifurcationKind.CB

    def value(self, solution: ItinerarySolution) -> float:
        if min(solution.durations[self.part], solution.durations[self.part - 1]) <= (
            SAME * solution.period
        ):
            return math.nan  # simultaneous events change their order: see `VanishingInterval`
        value, rises, rounding = self._beside(solution, self.late)
        if not rises:
            return math.inf
        if self.both:
            other, too, _ = self._beside(solution, not self.late)
            if abs(value - other) <= rounding:  # a continuous guard is watched once only
                rises = too and not self.late
        return value if rises and abs(value) > rounding else math.inf

    def _beside(self, solution: ItinerarySolution, late: bool) -> tuple[float, bool, float]:
        """Guard just before or after the event, whether it rises away from it, rounding error."""
        curve = solution.curve((self.part - 1 + late) % solution.events, self.side, self.number)
        value, rate, bend = curve.nodes[1][:, 0 if late else -1].tolist()
        least = ZERO * max(curve.rounding, 2.0**-52 * self.size(solution))
        # a minimum at the event, as of a gap when the friction at its own mass changes direction
        lowest = bend > 0.0 and rate * rate <= 2.0 * bend * least
        return value, lowest or (rate > 0.0 if late else rate < 0.0), least

    def size(self, solution: Any) -> float:
        begins = (self.part - 1 + self.late) % solution.events
        return float(solution.size_of(begins, self.side, self.number))

    def left(self, solution: Any, own: Array) -> Any:  # noqa: ARG002
        return [self._beside(solution, self.late)[0] / self.size(solution)]

    def neighbour(self, x: Array, p: Array) -> tuple[Problem, Array] | None:
        s, system, k = self.problem.at(x, p), self.problem.oscillator, self.side
        event, gone = s.itinerary[self.part], s.following[self.part].mode.numbers[k]
        if event.element != k:
            return None
        lifts = Happening(event.mode, k, self.number)
        lifted = with_regime(system, event.mode, k, watch_of(system, lifts).to)
        events = [*s.itinerary]
        events[self.part] = lifts
        problem = self.problem.remade(itinerary=tuple(events))
        phase, leaves = float(s.event_phases[self.part]), way_back(system, lifted, k, gone)
        found: tuple[Problem, Array] = problem.with_events(x, p, self.part, phase, leaves)
        return found

    def place(self, solution: Any, own: Array) -> tuple[float, int]:  # noqa: ARG002
        return float(solution.event_phases[self.part]), self.side


def way_back(system: Any, mode: Regimes, k: int, number: int) -> list[Happening]:
    """Shortest sequence of events by which an element gets from a mode to a regime; else empty.

    An example has two events, since a dashpot's force vanishes before the gap opens: pressing,
    lifted, outside.
    """
    ways: list[tuple[Regimes, list[Happening]]] = [(mode, [])]
    regimes, seen = system._elements[k].regimes, {mode.numbers[k]}
    for now, way in ways:
        for g, watch in enumerate(regimes[now.numbers[k]].guards):
            if (k, g) not in now.watched:
                continue
            events = [*way, Happening(now, k, g)]
            if watch.to == number or watch.event == HALT:
                return events
            if watch.to not in seen:
                seen.add(watch.to)
                ways.append((with_regime(system, now, k, watch.to), events))
    return []
