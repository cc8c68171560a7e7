"""Equations of periodic orbits with a given itinerary, their repetitions and their borders."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Self, final

import numpy as np

from dynkit.core.angles import in_turn
from dynkit.core.cost import Cost
from dynkit.core.smooth_map import proper_divisors
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import Condition, Event
from dynkit.orbits.newton import NoSolution
from dynkit.orbits.solving import orbit_bound
from dynkit.systems.impact.orbits.borders import Border
from dynkit.systems.impact.orbits.itineraries.borders import borders_of, named
from dynkit.systems.impact.orbits.itineraries.happening import Happening
from dynkit.systems.impact.orbits.itineraries.meeting import beyond
from dynkit.systems.impact.orbits.itineraries.motion import ItinerarySolution
from dynkit.systems.impact.orbits.itineraries.one_mode import monodromy
from dynkit.systems.impact.orbits.itineraries.one_mode.responses import ResponseSolution
from dynkit.systems.impact.orbits.itineraries.parting import commute, ordered, parted
from dynkit.systems.impact.orbits.itineraries.several_modes import crossings
from dynkit.systems.impact.orbits.itineraries.several_modes.errors import error_of
from dynkit.systems.impact.orbits.itineraries.several_modes.shooting import ShootingSolution
from dynkit.systems.impact.orbits.orbit import (
    NONE,
    PROGRESSION,
    ImpactOrbit,
    observables_of,
    progression_of,
)
from dynkit.systems.impact.orbits.problem import ImpactProblem
from dynkit.systems.impact.simulation.state import TWO_PI

REPEATED = 1e-7
"""Phases, states and impulses that differ by less, in their units, are the same."""

APART = 1e-6
"""Two solutions whose scaled unknowns differ by less are the same orbit."""

LEAST = 1e-13
"""Scaled impulses below this count as zero: at resonance the impulses of all orbits are zero."""

SLOW = 1e-9
"""Impulses of orbits P(inf,m) below this fraction of the largest one count as zero."""

_MOVED = 1e-6
"""Step of differences, in units of the unknowns; impacts within this phase are simultaneous."""

_AT_REST = 2.0**-40
"""Largest position or velocity, relative to its typical size, of orbits at rest at zero."""

_STEPS, _SOLVED = 20, 1e-12
"""Largest number of Newton steps to a return, and largest last step in units of the unknowns."""


class Station(NamedTuple):
    """An event, its phase, its impulse if it is an impact, the state (2N + J,) just before it.

    `node` says whether this state is an unknown.
    """

    event: Happening
    phase: float
    impulse: float | None
    state: Array
    node: bool


@final
class ItineraryEquations(ImpactProblem):
    """Periodic orbits of an impact oscillator with a given itinerary; see `ImpactProblem`."""

    def orbit(self, x: Array, p: Array, history: Sequence[float] = ()) -> ImpactOrbit:
        fixed = self.remade(oscillator=self.system(p), names=())
        return ImpactOrbit(fixed, x, tuple(history), Cost(0.0))

    def observed(self, x: Array, p: Array, name: str) -> Array:
        solution = self.at(x, p)
        found = observables_of(solution) if len(solution.impulses) else {}
        if name == PROGRESSION:
            return progression_of(solution)
        return found[name] if name in found else super().observed(x, p, name)

    def multipliers(self, x: Array, p: Array) -> Any:
        s = self.at(x, p)
        of = monodromy.multipliers if isinstance(s, ResponseSolution) else crossings.multipliers
        return of(s)

    def factors(self, x: Array, p: Array) -> tuple[Array, Array] | None:
        s = self.at(x, p)
        if isinstance(s, ResponseSolution):
            return monodromy.factors(s)
        grazes = self.sticks and not s.impulses.all()
        return None if grazes or not s.factors[0].size else s.factors

    def monodromy(self, x: Array, p: Array) -> Array:
        """Monodromy matrix from the event at the end of the longest flight to a period later."""
        s = self.at(x, p)
        last = (int(np.argmax(s.durations)) + 1) % s.events
        if isinstance(s, ResponseSolution):
            return monodromy.monodromy_from(s, last)
        return crossings.monodromy_from(s, last)

    def returns(self, x: Array, p: Array) -> Any:
        if not self.driven:
            raise NoSolution("the map of returns of a machine that nothing drives is not known")
        if not self.sticks:
            return self._across(*super().returns(x, p))
        # The map takes states in contact at the phase of the first release to those a period later.
        # To first order it is the same if the release is a little earlier or later.
        s, at, n = self.at(x, p), float(x[0]), len(x)
        basis, unit = crossings.held_directions(s, 0), self._measures[: self.dimension]
        first = n - self.layout.states
        own, last = np.arange(first, first + self.dimension), np.arange(n - self.dimension, n)
        others, rest = np.setdiff1d(np.arange(n), own), np.setdiff1d(np.arange(n), last)
        place, flights = s.before[0], s.flights(s.following[-1].mode)

        def jacobian(state: Array) -> Array:
            begun, y = place.copy(), x.copy()
            begun[: self.dimension] += unit * (basis @ state)
            for _ in range(_STEPS):
                z, passed = flights.passed(begun, float((y[0] - at) / s.clock))
                y[own] = z[: self.dimension]
                there = self.at(y, p)
                matrix = there.jacobian(1.0)
                moving = flights.rates(z[None])[0, : self.dimension] / s.clock
                whole = matrix.copy()
                whole[:, 0] += matrix[:, own] @ moving
                step = np.linalg.solve(whole[np.ix_(rest, others)], there.left[rest])
                y[others] -= step
                if (abs(step) / self._scale[others]).max() < _SOLVED:
                    break
            else:
                raise NoSolution("there is no such return")
            to = passed[: self.dimension, : self.dimension] @ (unit[:, None] * basis)
            others_by = -np.linalg.solve(
                whole[np.ix_(rest, others)], matrix[np.ix_(rest, own)] @ to
            )
            # the residual of the last equations is the end of the last flight less the next state
            begin = matrix[np.ix_(last, own)] + np.eye(self.dimension)
            ended = begin @ (to + np.outer(moving, others_by[0]))
            ended += matrix[np.ix_(last, others)] @ others_by
            ended -= np.outer(there.moving[-1, : self.dimension] / s.clock, others_by[0])
            back = np.linalg.solve(passed[: self.dimension, : self.dimension], ended)
            return np.asarray(basis.T @ (back / unit[:, None]))

        return jacobian, np.zeros(basis.shape[1])

    def _across(self, jacobian: Any, place: Array) -> tuple[Any, Array]:
        """Jacobian of returns, and a state, in coordinates orthogonal to the machine's shift."""
        if not self.oscillator._progression.shift.size:
            return jacobian, place
        across = self.oscillator._progression_at(place).across
        own = across.T @ place
        return lambda state: across.T @ jacobian(place + across @ (state - own)) @ across, own

    def state_error(self, x: Array, p: Array) -> float:
        """Estimate of the largest error of a section coordinate: see `ImpactOrbit.error`."""
        s = self.at(x, p)
        if isinstance(s, ShootingSolution):
            return error_of(self, x, p)
        bound = orbit_bound(self, x, p)
        moved = self.states_moved(x, p, bound) + float(s.state_rounding.max(initial=0.0))
        sizes = 32.0 * 2.0**-52 * float(abs(s.section_states).max(initial=0.0))
        phases = bound[: self.layout.events].max(initial=0.0)
        return max(float(bound.max()), float(phases) + moved + sizes)

    def states_moved(self, x: Array, p: Array, moved: Array) -> float:
        """Largest change of a section coordinate by errors (m,) of the unknowns."""
        s, scale, worst = self.at(x, p), self.scale(x), 0.0
        if not np.isfinite(moved).all():
            return math.inf
        for k in np.flatnonzero(moved).tolist():
            h = _MOVED * scale[k]
            later = self._next_at_once(s, k)
            # steps keep the order of simultaneous impacts
            for some in [[k, *later], later] if later else [[k]]:
                there = x.copy()
                there[some] += h
                change = self.oscillator.difference(
                    self.at(there, p).section_states, s.section_states
                )
                worst += float(abs(change).max() / h * moved[k])
        return worst

    def _next_at_once(self, s: ResponseSolution, k: int) -> list[int]:
        """Numbers of the impacts simultaneous with, and after, the one with phase unknown `k`."""
        found: list[int] = []
        while k < s.events and s.lasts[k] * s.frequency <= _MOVED:
            k = s.ends(k)[1]
            if k in found:
                break
            found.append(k)
        return found

    # --- repetitions ------------------------------------------------------------------------------

    def apart(self, x: Array, other: Array) -> Array:
        key = other.tobytes()
        if self._home is None or self._home[0] != key:
            self._home = key, self.canonical(other)
        return self.canonical(x) - self._home[1]

    def shortest(self, x: Array) -> tuple[Self, Array]:
        for k, periods, changes in self._repetitions(x):
            if abs(changes).max() < REPEATED:
                return self._shorter(k, periods), self._part(x, k)
        return self, x

    def departing(self, x: Array, way: float) -> tuple[Self, Array]:
        return (self, x) if self.responds else ordered(*parted(self, x, way), way)

    def repeats(self, x: Array, within: float) -> bool:
        """Whether the orbit is a shorter one that is run through several times."""
        return any(abs(changes).max() < within for _, _, changes in self._repetitions(x))

    def repetition(self, x: Array) -> float:
        parts = [changes for _, _, changes in self._repetitions(x)]
        return min((float(np.sqrt(np.mean(part**2))) for part in parts), default=np.inf)

    def _repetitions(self, x: Array) -> Iterator[tuple[int, int, Array]]:
        """Numbers of items and periods after which the itinerary may repeat, with the changes.

        Changes are differences of the phases, and of the scaled marks, of each item and the item
        that repeats it.
        """
        count, m = self.parts, self.periods
        for k in proper_divisors(count):
            if m % (count // k) == 0 and self._may_repeat(k):
                phases, others = self._marked(x)
                periods = m // (count // k)
                later = np.append(phases[k:], phases[:k] + TWO_PI * m) - TWO_PI * periods
                changes = (np.roll(others, -k, axis=0) - others).ravel()
                yield k, periods, np.concatenate([later - phases, changes])

    @property
    def parts(self) -> int:
        """Number of parts of the orbit that may come again: from node to node, or events."""
        return len(self.nodes) if self.of_nodes else len(self.itinerary)

    @property
    def of_nodes(self) -> bool:
        """Whether it comes again by its nodes: releases, or periods in which nothing happens."""
        return self.sticks or self.itinerary[0].element < 0

    def _may_repeat(self, k: int) -> bool:
        """Whether the itinerary may repeat after `k` of its items."""
        # P(inf,m): the number of impacts of a chatter that are events is a choice
        return self.sticks or bool(self.itinerary == self.itinerary[k:] + self.itinerary[:k])

    def _marked(self, x: Array) -> tuple[Array, Array]:
        """Phases (count,) of the items, and their scaled states or impulses (count, j)."""
        phases, impulses, states = self.layout.split(x)
        if self.of_nodes:
            return phases[list(self.nodes)], (states / self._state_units).reshape(self.parts, -1)
        pushed = np.zeros((self.layout.events, 1))
        pushed[self.course.hits, 0] = impulses
        if not self.driven:
            phases = np.append(0.0, phases[1:])
        return phases, pushed / self.sizes[1]

    def _shorter(self, k: int, periods: int) -> Self:
        """The equations of the first `k` items of the itinerary."""
        nodes, end = (self.nodes[:k], self._end(k)) if self.of_nodes else ((0,), k)
        return self.remade(periods=periods, itinerary=self.itinerary[:end], nodes=nodes)

    def _end(self, k: int) -> int:
        """Number of the events of the first `k` parts."""
        return (*self.nodes, len(self.itinerary))[k] if self.sticks else k

    def _part(self, x: Array, k: int) -> Array:
        """Unknowns of the first `k` items of the itinerary."""
        phases, impulses, states = self.layout.split(x)
        end, nodes = self._end(k), k if self.of_nodes else 1
        some = sum(event.kicked is not None for event in self.itinerary[:end])
        return np.concatenate([phases[:end], impulses[:some], states[: nodes * self.dimension]])

    def in_turn(self, x: Array) -> tuple[Self, Array]:
        """Return equations and unknowns with ordered events, the first at a phase in [0, 2 pi)."""
        own, x = self.shortest(x.copy()) if self.sticks else (self, x.copy())
        if not self.driven:
            return own, x
        phases = x[: own.layout.events]
        turn = TWO_PI * self.periods
        if self.responds:
            phases -= turn * np.floor((phases - phases[0]) / turn)
        phases -= TWO_PI * np.floor(phases[0] / TWO_PI)
        return own._ascending(x) if self.responds else (own, x)

    def _ascending(self, x: Array) -> tuple[Self, Array]:
        """Return equations and unknowns with the impacts of one mode in the order of phases."""
        phases, impulses, _ = self.layout.split(x)
        order = np.argsort(phases, kind="stable")
        itinerary = tuple(self.itinerary[i] for i in order.tolist())
        same = self if itinerary == self.itinerary else self.remade(itinerary=itinerary)
        return same, np.concatenate([phases[order], impulses[order]])

    def proper(self, x: Array) -> bool:
        """Whether no impulse counts as zero, and simultaneous impacts are of stops that commute.

        Without rebound an additional impact of zero impulse, just after any impact, would solve
        the equations too. An orbit P(inf,m) must also have a small estimated error.
        """
        phases, impulses, _ = self.layout.split(x)
        if self.sticks:
            # with a nearly singular Jacobian the estimated error is large: no solution
            least = float(abs(impulses).min(initial=np.inf))
            return least >= SLOW * abs(impulses).max() and self.state_error(x, NONE) < APART
        if not self.driven or not len(impulses):
            return True
        ends = np.append(phases, phases[0] + TWO_PI * self.periods)
        if (impulses <= LEAST * self.sizes[1]).any():
            return False
        n, own = len(phases), [event.element for event in self.itinerary]
        near = np.flatnonzero(np.diff(ends) < APART).tolist()
        return all(own[i] != own[(i + 1) % n] and commute(self, x, i) for i in near)

    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        turn, count = TWO_PI * self.periods, len(self.itinerary)
        nodes = *self.nodes, *(count + node for node in self.nodes)
        more = {"itinerary": self.itinerary * 2, "nodes": nodes}
        problem = self.remade(periods=2 * self.periods, **more)
        phases, impulses, states = self.layout.split(x)
        a, b, c = self.layout.split(disturbance)
        later, late = phases + turn, -a
        if not self.driven:
            stretched = a[0] / phases[0]
            a = np.append(0.0, a[1:] + phases[1:] * stretched)
            later, late = np.append(turn, phases[1:] + turn), turn * stretched - a
        twice = np.concatenate([phases, later, impulses, impulses, states, states])
        return problem, twice, np.concatenate([a, late, b, -b, c, -c])

    def canonical(self, x: Array) -> Array:
        """Return numbers, (l,), of order one that are equal for equivalent solutions."""
        phases, pushed = self._marked(x)
        if self.of_nodes:  # means over the nodes, which do not depend on which is the first
            states = self.layout.split(x)[2].reshape(self.parts, -1)
            n = self.oscillator.degrees_of_freedom
            sizes = np.array([abs(states[:, :n]).max(), abs(states[:, n : 2 * n]).max()])
            sizes = np.maximum(sizes, _AT_REST * self._measures[[0, n]])
            if self.dimension == 2:  # sizes that are the same for all guesses of one orbit
                sizes += self.oscillator._length * np.array([1.0, self.oscillator.frequency])
            scaled = states / sizes[np.repeat([0, 1, 0], [n, n, self.dimension - 2 * n])]
            turn = np.exp(1j * phases)[:, None]
            marks = [scaled, scaled**2, scaled * turn.real, turn.real, turn.imag]
            mean = np.concatenate(marks, axis=1).mean(axis=0)
            return np.append(mean, sizes[0] / sizes[1])
        turn, weights = np.exp(1j * phases), self.course.signs * pushed[:, 0]
        marks = [turn, weights * turn, weights**2 * turn, self.course.kinds * turn, 1j * weights]
        found = [np.array(marks).sum(axis=1).view(float) / len(turn)]
        period = [] if self.driven else [x[:1] / self._scale[0]]
        return np.concatenate([*found, *period])

    # --- borders ----------------------------------------------------------------------------------

    def events(self, x: Array, p: Array) -> list[Event]:
        solution = self.at(x, p)
        if self._watched is None or self._watched[0] is not solution:
            self._borders = self._borders or self.borders(solution)
            self._watched = solution, [_event(border, solution) for border in self._borders]
        return list(self._watched[1])

    def event(self, number: int, x: Array, p: Array) -> Event:
        solution = self.at(x, p)
        self._borders = self._borders or self.borders(solution)
        return _event(self._borders[number], solution)

    def condition(self, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
        border = self.border(event, x, p)
        return border, border.begin(self.at(x, p))

    def border(self, event: int, x: Array, p: Array) -> Border:
        """The border of event number `event`."""
        return self.borders(self.at(x, p))[event]

    def borders(self, solution: ItinerarySolution) -> list[Border]:
        """All borders, in the order of the events."""
        return list(borders_of(self, solution))

    def touching(self, event: int, x: Array, own: Array, p: Array) -> Mapping[str, float]:
        """Return phase, time from the first state, element; also the time by the border's name."""
        solution, border = self.at(x, p), self.border(event, x, p)
        at, side = border.place(solution, own)
        turns = (at - float(solution.phases[0])) % (TWO_PI * self.periods)
        time = turns / solution.frequency
        found = {"phase": float(in_turn(at)), "time": time, "side": float(side)}
        return {**found, named(border, solution): time}

    def _stations(self, s: ResponseSolution | ShootingSolution) -> list[Station]:
        hits, found, before = iter(s.impulses.tolist()), [], s.before[:, : self.dimension]
        for i, (event, phase) in enumerate(
            zip(self.itinerary, s.event_phases.tolist(), strict=True)
        ):
            impulse = next(hits) if event.kicked else None
            found.append(Station(event, phase, impulse, before[i], i in self.nodes))
        return found

    def _of(self, x: Array, stations: list[Station]) -> tuple[Self, Array]:
        """Return equations and unknowns of the motion with the events of some stations."""
        own = [station for station in stations if station.event.element >= 0] or stations
        phases = np.array([station.phase for station in own])
        if not self.driven:
            phases -= phases[0]
            phases[0] = x[0]
        impulses = [station.impulse for station in own if station.impulse is not None]
        nodes = 0, *(i for i, station in enumerate(own) if i and station.node)
        along = self.oscillator._progression
        problem = self.remade(itinerary=tuple(station.event for station in own), nodes=nodes)
        if problem.responds:
            return problem._ascending(np.concatenate([phases, impulses]))
        return problem, np.concatenate(
            [phases, impulses, *(along.removed(own[i].state) for i in nodes)]
        )

    def with_events(
        self, x: Array, p: Array, i: int, phase: float, more: list[Happening]
    ) -> tuple[Self, Array]:
        """Return the same motion with more events after event `i`, at a phase.

        The guards of these events touch zero at this phase.
        """
        s = self.at(x, p)
        stations = self._stations(s)
        state = s.flown(i, phase) if isinstance(s, ShootingSolution) else stations[0].state
        hits = [0.0 if event.kicked else None for event in more]
        stations[i + 1 : i + 1] = [
            Station(event, phase, hit, state, False) for event, hit in zip(more, hits, strict=True)
        ]
        return self._of(x, stations)

    def without(self, x: Array, p: Array, gone: list[int]) -> tuple[Self, Array] | None:
        """Return the same motion without some events; None if no event is left.

        A driven motion whose states are unknowns gets the begin of a period in place of events.
        """
        s = self.at(x, p)
        stations = self._stations(s)
        left = [station for i, station in enumerate(stations) if i not in gone]
        if not left:
            if not (self.driven and isinstance(s, ShootingSolution)):
                return None
            i = gone[0]
            phase = TWO_PI * float(np.ceil(s.event_phases[i] / TWO_PI))
            mode = stations[i].event.mode
            left = [Station(Happening(mode, -1, 0), phase, None, s.flown(i, phase), True)]
        return self._of(x, left)

    def neighbours(self, event: int, x: Array, p: Array) -> list[tuple[Problem, Array, Array]]:
        """Return the same motion as an orbit with more or fewer events.

        Where a gap touches zero, an impact with zero impulse is added; where an impulse vanishes,
        its impact is left out. Both are solutions, up to rounding, unless their parameter is not
        `p`: those are guesses on both sides of the border, as described at `beyond`.

        Raises
        ------
        NoMotion
            When the equations of the other orbit are not defined.
        """
        return beyond(self, event, x, p)

    def admissible(self, x: Array, p: Array) -> bool:
        """Whether all impulses are compressive, all guards positive, and no event is missed."""
        s = self.at(x, p)
        if not self.responds and any(event.value < 0.0 for event in self.events(x, p)):
            return False
        return bool(s.admissible)


def _event(border: Border, solution: ItinerarySolution) -> Event:
    value = border.value(solution)  # may set border.ends: evaluated first
    return Event(border.kind, border.part, value, border.ends)
