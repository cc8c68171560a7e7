"""Borders of a branch of orbits of one itinerary, at which an event appears or vanishes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.elements.element import HALT, IMPACT, Element
from dynkit.systems.impact.elements.friction import BACKWARD, FORWARD, STICKS
from dynkit.systems.impact.elements.laws import ImpactLaw
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.orbits.borders import (
    Border,
    OfImpact,
    VanishingAcceleration,
    VanishingImpulse,
    acceleration,
)
from dynkit.systems.impact.orbits.flights import Curve
from dynkit.systems.impact.orbits.itineraries.corners import ZERO, Corner, opens, way_back
from dynkit.systems.impact.orbits.itineraries.happening import Happening, Itinerary
from dynkit.systems.impact.orbits.itineraries.itinerary import regimes_of, with_regime
from dynkit.systems.impact.orbits.itineraries.motion import AT_ONCE, SAME
from dynkit.systems.impact.orbits.itineraries.parting import reversed_order
from dynkit.systems.impact.orbits.itineraries.several_modes.shooting import ShootingSolution
from dynkit.systems.impact.orbits.machine import Regimes
from dynkit.systems.impact.simulation.state import turning

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.itineraries.motion import ItinerarySolution

_ZERO = 2.0**-30
"""Value, relative to its unit, below which a guard is zero at a border that is solved for."""


def borders_of(problem: Any, s: ItinerarySolution) -> Iterator[Border]:
    """All borders of an itinerary: impulses, intervals, guards between events, and beginnings."""
    n, itinerary, sticks, stops = (
        s.events,
        problem.itinerary,
        s.course.sticks,
        problem.oscillator._stops,
    )
    for k, i in enumerate(s.hits):
        part = s.course.node_before(i) if sticks else 0
        yield VanishingImpulse(problem, part if s.blind else k, k)
    for k, i in enumerate(s.hits):
        law: Any = problem.oscillator._elements[itinerary[i].element].restitution
        if isinstance(law, ImpactLaw):
            part, piece = s.course.node_before(i) if sticks else k, itinerary[i].piece
            for jump in range(max(piece - 1, 0), min(piece + 1, len(law.breaks))):
                yield LawJump(problem, part, k, jump)
    for k, i in enumerate(s.hits):
        part = s.course.node_before(i) if sticks else k
        for number in range(len(itinerary[i].rubs)):
            yield StickAtImpact(problem, part, k, number)
    for i in range(n):
        # impacts with one stop may pass each other; facing stops are never hit simultaneously
        one, other = itinerary[i].element, itinerary[(i + 1) % n].element
        both = sticks and one < len(stops) and other < len(stops)
        if (s.blind and not both) or (one != other and not problem.oscillator._faces):
            yield VanishingInterval(problem, i)
    for i in range(n):
        for element, guard in itinerary[(i + 1) % n].mode.watched:
            yield TouchingGuard(problem, i, element, guard)
    for k, i in enumerate(s.hits):
        if not itinerary[i].chatters:
            yield VanishingAcceleration(problem, s.course.node_before(i) if sticks else k, k)
        else:
            yield ChatterEnd(problem, i, 0, itinerary[i].element)
    if sticks:
        for i in problem.nodes:
            yield FlatRelease(problem, i, 0, itinerary[i].element)
    for begun in problem.beginnings:
        yield Beginning(problem, begun)
    for i, event in enumerate(() if problem.oscillator._faces else itinerary):
        both = event.mode, itinerary[(i + 1) % n].mode
        for late, mode in enumerate(both):
            for element, guard in mode.watched:
                own = element == event.element
                if event.chatters or (own and (late or guard == event.guard or not opens(s, i))):
                    continue
                numbers = [now.numbers[element] for now in both]
                # gaps of open stops are continuous at events: one border is enough
                if not (late and element < len(stops) and numbers == [0, 0]):
                    yield Corner(problem, i, element, guard, bool(late))


@final
class LawJump(OfImpact):
    """The approach velocity of an impact is that of jump number `side` of the impact law."""

    def value(self, solution: Any) -> float:
        i, k = solution.hits[self.number], self.number
        event = solution.itinerary[i]
        breaks = solution.oscillator._elements[event.element].restitution.breaks
        if self.side >= len(breaks):
            return math.inf
        approach = -float(solution.closing[k])
        return float(approach - breaks[self.side]) * (1.0 if event.piece > self.side else -1.0)


@final
class StickAtImpact(OfImpact):
    """The largest slip velocity that an impact can stop equals the slip of friction `side`."""

    problem: Any

    def value(self, solution: Any) -> float:
        i, k = solution.hits[self.number], self.number
        event, before = solution.itinerary[i], solution.before[i]
        flights, (friction, way) = solution.flights(event.kicked), event.rubs[self.side]
        slip = float(flights.rate_of(friction, before)[0])
        taken = flights.takes(friction, before) * float(solution.impulses[k])
        return float(way * slip - taken if way else taken - abs(slip))

    def place(self, solution: Any, own: Array) -> tuple[float, int]:  # noqa: ARG002
        event = solution.itinerary[solution.hits[self.number]]
        return float(solution.impact_phases[self.number]), event.rubs[self.side][0]

    def neighbour(self, x: Array, p: Array) -> tuple[Problem, Array] | None:
        s = self.problem.at(x, p)
        i = s.hits[self.number]
        rubs = list(s.itinerary[i].rubs)
        friction, way = rubs[self.side]
        slip = float(s.flights(s.itinerary[i].kicked).rate_of(friction, s.before[i])[0])
        rubs[self.side] = friction, 0 if way else int(math.copysign(1.0, slip))
        events = list(s.itinerary)
        events[i] = events[i]._replace(rubs=tuple(rubs))
        problem, after = self.problem.remade(itinerary=tuple(events)), s.following[i]
        found: tuple[Problem, Array] | None = (problem, x)
        if way and after.element == friction and abs(s.durations[i]) <= SAME * s.period:
            found = problem.without(x, p, [(i + 1) % s.events])  # the impact replaces the halt
        elif not way and after.mode.numbers[friction] == STICKS:
            numbers = list(after.mode.numbers)
            numbers[friction] = FORWARD if slip > 0.0 else BACKWARD
            slips = regimes_of(s.oscillator, numbers)
            phase = float(s.event_phases[i])
            found = problem.with_events(x, p, i, phase, [Happening(slips, friction, 0)])
        return found


class Begun(NamedTuple):
    """A guard of an element in a mode in which it holds or sticks, just after an event.

    If the element is in this mode from the event on, the guard is positive there and `sign` is 1.
    Otherwise the guard is negative and `sign` is -1.
    """

    event: int
    mode: Regimes
    element: int
    guard: int
    sign: float


def beginnings(system: Any, itinerary: Itinerary) -> list[Begun]:
    """Events at which an element begins to hold or to stick, or could begin and does not."""
    found = []
    for i, event in enumerate(itinerary):
        k, after = event.element, itinerary[(i + 1) % len(itinerary)].mode
        if k < 0:  # begin of a period of the forcing
            continue
        landed = [j for j, stop in system._parts.normal.items() if stop == k]
        begins = [j for j in ([] if event.chatters else [k]) + landed if j in after.held]
        found += [
            Begun(i, after, element, guard, 1.0)
            for element, guard in after.watched
            if element in begins and element not in event.mode.held
        ]
        regimes = system._elements[k].regimes
        watch = regimes[event.mode.numbers[k]].guards[event.guard]
        if watch.event == HALT and k not in after.held:
            stuck = with_regime(system, after, k, watch.to)
            way = [g for g, w in enumerate(regimes[watch.to].guards) if w.to == after.numbers[k]]
            if k in stuck.held and way:
                found.append(Begun(i, stuck, k, way[0], -1.0))
    return found


class _WhereItBegins(Border):
    """A test function at the begin of a mode."""

    problem: Any

    @final
    def place(self, solution: Any, own: Array) -> tuple[float, int]:  # noqa: ARG002
        return solution.begins(self.part), self.side


@final
class ChatterEnd(_WhereItBegins):
    """The contact force is zero where contact begins after a chatter."""

    def value(self, solution: Any) -> float:
        return float(solution.chatters[self.part].pressing)

    def size(self, solution: Any) -> float:
        return float(solution.force_unit(self.part, self.side))

    def begin(self, solution: Any) -> Array:
        law = solution.oscillator._elements[self.side].restitution
        if isinstance(law, ImpactLaw):
            law = solution.restitutions[solution.impulse_of[self.part]]
        if law > 0.0:
            raise NoSolution("the force where an endless chatter ends is not smooth there")
        return np.empty(0)


@final
class FlatRelease(_WhereItBegins):
    """The rate of the contact force is zero at a release, where the force is zero as well."""

    def value(self, solution: Any) -> float:
        return -float(solution.guards[self.part] @ solution.moving[self.part - 1])

    def size(self, solution: Any) -> float:
        row = abs(solution.guards[self.part]) @ solution.measures
        return float(row * solution.frequency)


@final
class Beginning(_WhereItBegins):
    """A guard is zero at the event where an element begins to hold or stick, or could begin."""

    def __init__(self, problem: Any, begun: Begun) -> None:
        super().__init__(problem, begun.event, begun.guard, begun.element)
        hard = isinstance(problem.oscillator._elements[begun.element], HardStop)
        self.begun, self.ends = begun, False
        self.kind = BifurcationKind.CB if hard else BifurcationKind.GR

    def value(self, solution: ItinerarySolution) -> float:
        assert isinstance(solution, ShootingSolution)
        event, mode, element, guard, sign = self.begun
        value, row = solution.watch(mode, element, guard, solution.begun(event))
        return float(sign * value / (abs(row) @ solution.measures))

    def name(self, solution: ItinerarySolution) -> str:  # noqa: ARG002
        """Name of the event at this border, as in the literature."""
        if self.kind is BifurcationKind.CB:
            return "contact"
        return "switching-sliding" if self.begun.sign > 0.0 else "crossing-sliding"

    def neighbour(self, x: Array, p: Array) -> tuple[Problem, Array] | None:
        event, mode, element, guard, sign = self.begun
        if sign > 0.0:
            return None
        s, found = self.problem.at(x, p), None
        z, flights = s.begun(event), s.flights(mode)
        if flights.observed(element, guard, z)[1] @ flights.rates(z[None])[0] < 0.0:
            more = [Happening(mode, element, guard)]  # it sticks for a short time
            found = self.problem.with_events(x, p, event, float(s.event_phases[event]), more)
        else:  # it sticks on: if that ends a slip, the motion without this slip is a guess
            after = (event + 1) % s.events
            if s.itinerary[after].element == element and s.following[after].mode == mode:
                found = self.problem.without(x, p, [after])
        return found


@final
class VanishingInterval(Border):
    """The time between two successive events is zero.

    If both events are of one element, its regime between them vanishes, and no orbit of this kind
    exists beyond the border. Otherwise the order of the events changes.
    """

    kind = BifurcationKind.GR
    problem: Any

    def value(self, solution: ItinerarySolution) -> float:
        first, second = self._events(solution.itinerary)
        self.ends = first.element == second.element
        if solution.events == 1:
            return math.inf
        value = float(solution.durations[self.part] / solution.period)
        # events of a symmetric machine stay simultaneous
        together = abs(value) <= solution.least_apart(self.part, self.problem.sizes[0])
        return 0.0 if together and not self.ends else value

    def _events(self, itinerary: Itinerary) -> tuple[Happening, Happening]:
        return itinerary[self.part], itinerary[(self.part + 1) % len(itinerary)]

    def place(self, solution: Any, own: Array) -> tuple[float, int]:  # noqa: ARG002
        return float(solution.event_phases[self.part]), solution.itinerary[self.part].element

    def name(self, solution: ItinerarySolution) -> str:
        """Name of the event at this border, as in the literature."""
        first, second = self._events(solution.itinerary)
        elements = solution.oscillator._elements
        if first.element != second.element or first.element < 0:
            return "at once"
        if isinstance(elements[first.element], HardStop):
            return "contact"
        element = elements[first.element]
        if element.slider:
            slides = _slides(element, second.mode, first.element)
            return "grazing-sliding" if slides else "adding-sliding"
        if first.element in second.mode.held:
            after = solution.following[(self.part + 1) % solution.events].mode
            same = after.numbers[first.element] == first.mode.numbers[first.element]
            return "grazing-sliding" if same else "crossing-sliding"
        if first.element in first.mode.held:
            return "adding-sliding"
        sticks = first.element in solution.following[(self.part + 1) % solution.events].mode.held
        return "switching-sliding" if sticks else "grazing"

    def neighbour(self, x: Array, p: Array) -> tuple[Problem, Array] | None:
        s, i = self.problem.at(x, p), self.part
        j = (i + 1) % s.events
        if s.itinerary[i].element != s.itinerary[j].element:
            # equations by responses accept impacts in any order
            return None if self.problem.responds else reversed_order(self.problem, x, p, i)
        if self._kicks(s, [i, j]):
            return None
        whole = self._at_once(s)
        if s.itinerary[i].mode == s.following[j].mode:
            whole = [i, j]
        back = s.itinerary[whole[0]].mode == s.following[whole[-1]].mode
        gone = whole if back and not self._kicks(s, whole) else [j]
        found: tuple[Problem, Array] | None = self.problem.without(x, p, gone)
        return found

    @staticmethod
    def _kicks(s: Any, events: list[int]) -> bool:
        return any(s.itinerary[i].kicked for i in events)

    def _at_once(self, s: Any) -> list[int]:
        """Numbers of all simultaneous events of the element, in order."""
        n, at_once = s.events, abs(s.durations) <= SAME * s.period
        element, found = s.itinerary[self.part].element, [self.part, (self.part + 1) % n]
        while len(found) < n and at_once[k := found[-1]] and s.following[k].element == element:
            found.append((k + 1) % n)
        while len(found) < n and at_once[k := found[0] - 1] and s.itinerary[k].element == element:
            found.insert(0, k % n)
        return found


@final
class TouchingGuard(Border):
    """A guard is zero at its minimum between two events, whose phase is an additional unknown.

    Parameters
    ----------
    problem : ItineraryEquations
    part : int
        Number of the event before.
    element, guard : int
    """

    kind, ends, unknowns = BifurcationKind.GR, False, 1
    problem: Any

    def __init__(self, problem: Any, part: int, element: int, guard: int) -> None:
        super().__init__(problem, part, guard, element)
        after = problem.itinerary[(part + 1) % len(problem.itinerary)].mode
        if element in after.held and element < len(problem.oscillator._stops):
            self.kind = BifurcationKind.CB

    def _curve(self, solution: ItinerarySolution) -> Curve:
        return solution.curve(self.part, self.side, self.number)

    def size(self, solution: ItinerarySolution) -> float:
        return solution.size_of(self.part, self.side, self.number)

    def begin(self, solution: ItinerarySolution) -> Array:
        after = solution.frequency * self._curve(solution).smallest[1]
        return np.array([solution.begins(self.part) + after])

    def left(self, solution: ItinerarySolution, own: Array) -> Any:
        since = (own - solution.begins(self.part)) / solution.frequency
        units = self.size(solution) * np.array([1.0, solution.frequency])
        return self._curve(solution).values(since, 2)[:, 0] / units

    def value(self, solution: ItinerarySolution) -> float:
        ends = [i for i in solution.ends(self.part) if i in solution.impulse_of]
        if any(solution.impulses[solution.impulse_of[i]] < 0.0 for i in ends):
            return math.nan
        curve = self._curve(solution)
        if curve.lasts <= AT_ONCE * solution.period:
            return math.nan  # between simultaneous events the minimum is a rounding error
        if not solution.blind:
            # without rebound the gap's acceleration may be negative just after the impact
            return (
                math.nan
                if acceleration(solution, solution.impulse_of[self.part]) < 0.0
                else curve.smallest[0]
            )
        event = solution.itinerary[self.part]
        if event.element == self.side and self.part in solution.course.releases:
            # at a release gap, rate and acceleration are zero: the first value is a rounding error
            seen, begins = curve.seen, float(curve.nodes[1][0, 0])
            return seen if abs(seen) > abs(begins) else math.inf
        begin, rate, bend = curve.nodes[1][:, 0].tolist()
        least = ZERO * max(curve.rounding, 2.0**-52 * self.size(solution))
        if abs(begin) > least:
            return curve.seen
        slow = abs(rate) * curve.lasts <= least
        if (bend if slow else rate) < 0.0:
            return math.nan  # a guard that falls from zero belongs to a border at its begin
        return curve.seen if abs(curve.seen) > least else math.inf

    def place(self, solution: Any, own: Array) -> tuple[float, int]:  # noqa: ARG002
        return float(own[0]), self.side

    def name(self, solution: ItinerarySolution) -> str:
        """Name of the event at this border, as in the literature."""
        element = solution.oscillator._elements[self.side]
        if not (element.slider or any(regime.sticks for regime in element.regimes)):
            return "grazing"
        slides = _slides(element, solution.following[self.part].mode, self.side)
        return "adding-sliding" if slides else "grazing-sliding"

    def neighbour(self, x: Array, p: Array) -> tuple[Problem, Array] | None:
        s, system = self.problem.at(x, p), self.problem.oscillator
        mode, k = s.following[self.part].mode, self.side
        regimes, number = system._elements[k].regimes, mode.numbers[k]
        watch = regimes[number].guards[self.number]
        if watch.event == IMPACT:
            return self._with(x, p, [Happening(mode, k, self.number, mode)])
        there = with_regime(system, mode, k, watch.to)
        if there.numbers[k] != watch.to or (watch.stretch and self._meets_stop(s)):
            return None
        back = way_back(system, there, k, number)
        found = self._with(x, p, [Happening(mode, k, self.number), *back]) if back else None
        return self._yielding(*found, p, 1 + len(back)) if found and watch.stretch else found

    def _meets_stop(self, s: Any) -> bool:
        """Whether a hard stop is touched there, too: its impact turns the slider back."""
        phase, mode = self.begin(s), s.following[self.part].mode
        z = np.append(s.flown(self.part, float(phase[0])), turning(phase))
        return any(
            s.oscillator._elements[k].regimes[mode.numbers[k]].guards[g].event == IMPACT
            and _is_zero(s, mode, k, g, z)
            for k, g in mode.watched
        )

    def _yielding(self, problem: Any, x: Array, p: Array, more: int) -> tuple[Problem, Array]:
        """Add the yield of a slider before the next impact, if it is at its limit there.

        An impact left it at its limit. After the slip that begins at this border, it reaches its
        limit just before the stop.
        """
        s, k, system = problem.at(x, p), self.side, problem.oscillator
        for i in range(self.part + more, self.part + s.events):
            j, own = (i + 1) % s.events, s.following[i % s.events]
            if own.element == k:
                break
            for g, watch in enumerate(system._elements[k].regimes[own.mode.numbers[k]].guards):
                if own.kicked and watch.stretch and _is_zero(s, own.mode, k, g, s.before[j]):
                    phase = float(s.lap.phases[i % s.events + 1])
                    yields = Happening(own.mode, k, g)
                    other, y = problem.with_events(x, p, i % s.events, phase, [yields])
                    slips, events = with_regime(system, own.mode, k, watch.to), [*other.itinerary]
                    events[j + bool(j)] = own._replace(mode=slips, kicked=slips)
                    return other.remade(itinerary=tuple(events)), y
        return problem, x

    def _with(self, x: Array, p: Array, more: list[Happening]) -> tuple[Problem, Array] | None:
        phase = float(self.begin(self.problem.at(x, p))[0])
        if not math.isfinite(phase):  # no minimum exists if the events are in another order
            return None
        found: tuple[Problem, Array] = self.problem.with_events(x, p, self.part, phase, more)
        return found


def _is_zero(s: Any, mode: Regimes, element: int, guard: int, z: Array) -> bool:
    """Whether a guard is zero at a state (D,)."""
    value, row = s.watch(mode, element, guard, z)
    return bool(abs(value) <= _ZERO * (abs(row) @ s.measures))


def _slides(element: Element, mode: Regimes, number: int) -> bool:
    """Whether the motion stays on a surface of discontinuity, in Filippov's sense.

    An element of friction does if it sticks. An element with a slider does if the slider slips: the
    surface is that of the slip force.
    """
    return bool(mode.numbers[number]) if element.slider else number in mode.held


def named(border: Border, solution: ItinerarySolution) -> str:
    """The name of the event at a border."""
    if isinstance(border, Beginning | VanishingInterval | TouchingGuard):
        return border.name(solution)
    if isinstance(border, Corner):
        own = border.side == solution.itinerary[border.part].element
        return "grazing" if own else "at once"
    if isinstance(border, StickAtImpact):
        return "stick at impact"
    return "jump of the law" if isinstance(border, LawJump) else "grazing"
