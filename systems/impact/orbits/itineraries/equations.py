"""The equations of periodic orbits with a given itinerary."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.newton import Correction, NoSolution, orbit_bound
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.free_motion import free_motion
from dynkit.systems.impact.orbits.borders import Border
from dynkit.systems.impact.orbits.itineraries import (
    crossings,
    divided,
    monodromy,
    responses,
    shooting,
)
from dynkit.systems.impact.orbits.itineraries.borders import Begun, beginnings, borders_of, named
from dynkit.systems.impact.orbits.itineraries.correcting import TableCorrector, corrector_of
from dynkit.systems.impact.orbits.itineraries.errors import error_of
from dynkit.systems.impact.orbits.itineraries.happening import Happening, Itinerary
from dynkit.systems.impact.orbits.itineraries.itinerary import (
    Course,
    counts_of,
    has_law,
    returns_of,
)
from dynkit.systems.impact.orbits.itineraries.linear import LinearSolution
from dynkit.systems.impact.orbits.itineraries.motion import ItinerarySolution, Lap
from dynkit.systems.impact.orbits.itineraries.openness import flights_are_open
from dynkit.systems.impact.orbits.itineraries.responses import ResponseSolution, Windows, windows_of
from dynkit.systems.impact.orbits.itineraries.shooting import ShootingSolution
from dynkit.systems.impact.orbits.itineraries.taylor import TaylorSolution
from dynkit.systems.impact.orbits.itineraries.terms import Terms
from dynkit.systems.impact.orbits.machine import Machine, difference
from dynkit.systems.impact.orbits.orbit import NONE
from dynkit.systems.impact.orbits.problem import APART, ImpactProblem
from dynkit.systems.impact.simulation.parameters import changes_alone
from dynkit.systems.impact.simulation.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

LEAST = 1e-13
"""Smaller impulses are rounding: at resonance those of all orbits are zero."""

SLOW = 1e-9
"""Impacts of what sticks that are slower, beside the fastest, are rounding."""

_ROUNDING = 2.0**-52
_STEPS, _SOLVED = 20, 1e-12
"""Steps of Newton's method to a return, and the last of them, in units of the unknowns."""


class Layout(NamedTuple):
    """Numbers of unknowns and equations: phases of events, impulses, and states at some of them."""

    events: int
    impacts: int
    states: int

    def split(self, x: Array) -> list[Array]:
        """The three parts of unknowns, or of equations."""
        n, end = self.events, self.events + self.impacts
        return [x[:n], x[n:end], x[end:]]


class Station(NamedTuple):
    """An event, its phase, its impulse if it is an impact, and the state (2N,) just before.

    And whether that state is unknown.
    """

    event: Happening
    phase: float
    impulse: float | None
    state: Array
    node: bool


def responds(oscillator: ImpactMap, itinerary: Itinerary, driven: bool) -> bool:
    """Whether states follow from the impulses alone, as periodic responses.

    That is so for impacts of one mode in which all motions have a restoring force.
    """
    stops = all(isinstance(element, HardStop) for element in oscillator._elements)
    if not (driven and stops) or has_law(oscillator) or oscillator._motion is not None:
        return False
    one = all(e.kicked == e.mode and not any(e.mode.numbers) for e in itinerary)
    return one and not len(free_motion(oscillator._contact).neutral)


@final
class ItineraryEquations(ImpactProblem):
    """Periodic orbits of an impact oscillator, by the modes that they pass and their events.

    The unknowns are the phases (n,) of the events, not wrapped, the impulses (k,) of the impacts
    among them, changes of the relative velocity, and the states (2N + J,), with the places of J
    sliders, just before the events that
    are nodes, the first one at least. The equations: the guards are zero, (n,); gaps open after
    impacts at the rate of their law, (k,); each state is what becomes of the one before. Where all
    events are impacts of one mode, whose motions all have a restoring force, states follow from the
    impulses and are no unknowns. Of a chatter the first impacts are events; the others, until
    contact, are simulated. Then the nodes are the releases. Where nothing drives the machine the
    first event is at phase 0, and the first unknown the time of a turn of the phase, of which the
    orbit takes `periods`. Nothing in the equations knows whether a gap is open in between, or an
    impulse positive. Where an event follows another one at which its guard is
    zero by nature, the equation is the divided difference.

    The itinerary is a tuple of `Happening`; sizes are those of positions and velocities; nodes are
    numbers of events.

    References
    ----------
    J. Shaw, S. W. Shaw, The onset of chaos in a two-degree-of-freedom impacting system, Journal of
    Applied Mechanics 56 (1989) 168-174 (impulse responses).
    A. B. Nordmark, P. T. Piiroinen, Simulation and stability analysis of impacting systems with
    complete chattering, Nonlinear Dynamics 58 (2009) 85-106.
    """

    _arguments: ClassVar[tuple[str, ...]] = (*ImpactProblem._arguments, "driven", "nodes")

    def __init__(
        self,
        oscillator: ImpactMap,
        names: tuple[str, ...],
        periods: int,
        itinerary: Itinerary,
        sizes: Any,
        driven: bool,
        nodes: tuple[int, ...] = (0,),
    ) -> None:
        super().__init__(oscillator, names, periods, itinerary, sizes)
        self.driven, self.nodes = driven, nodes

    @cached_property
    def layout(self) -> Layout:
        """Of unknowns and equations."""
        hits = len(self.course.hits)
        states = 0 if self.responds else self.dimension * len(self.nodes)
        return Layout(len(self.itinerary), hits, states)

    @property
    def dimension(self) -> int:
        """Number 2N + J of positions, velocities, and places of sliders."""
        return self.oscillator.degrees_of_freedom + self.oscillator._size

    @cached_property
    def responds(self) -> bool:
        """Whether states follow from the impulses: see `responds`."""
        return responds(self.oscillator, self.itinerary, self.driven)

    @cached_property
    def course(self) -> Course:
        """The itinerary, and what is asked of it."""
        return Course(self.itinerary, self.nodes)

    @property
    def sides(self) -> Any:
        """Of which stop each impact is, (k,)."""
        return self.course.sides

    @cached_property
    def pairs(self) -> list[divided.Pair | None]:
        """Of each event the one before at which its guard is zero by nature."""
        return divided.pairs(self.oscillator, self.itinerary)

    @cached_property
    def beginnings(self) -> list[Begun]:
        """Where something begins to hold or to stick, and where it might and does not."""
        return beginnings(self.oscillator, self.itinerary)

    @cached_property
    def _measures(self) -> Array:
        n, (length, speed) = self.oscillator.degrees_of_freedom, self.sizes
        return np.repeat([length, speed, length, 1.0], [n, n, self.dimension - 2 * n, 3])

    def _scene(self, p: Array) -> responses.Scene | shooting.Scene:
        if self.responds and self.plain:
            # No need of a system for each value.
            values = dict(zip(self._names, p.tolist(), strict=True))
            terms = self._terms.at(self.oscillator, values)
            own = self.oscillator, self.windows, terms, self._measures
            return responses.Scene(*own, partial(self.system, p))
        system = self.system(p) if self._names else self.oscillator
        if self.responds:
            own = system, windows_of(system), Terms.of(system), self._measures
            return responses.Scene(*own, partial(self.system, p))
        return shooting.Scene(Machine(system), system, self._measures)

    @cached_property
    def windows(self) -> Windows:
        """The gaps of all stops."""
        return windows_of(self.oscillator)

    @cached_property
    def _terms(self) -> Terms:
        return Terms.of(self.oscillator)

    @cached_property
    def plain(self) -> bool:
        """Whether the free parameters are in closed form, and change nothing but themselves."""
        own = self.oscillator
        return not own.elements and all(changes_alone(own, name) for name in self._names)

    def _solution(self, x: Array, scene: Any) -> ResponseSolution | ShootingSolution:
        own, impulses, states = self.layout.split(x)
        turn, phases = 0.0, np.empty(len(own) + 1)
        phases[:-1] = own
        if not self.driven:
            turn, phases[0] = own[0], 0.0
        phases[-1] = phases[0] + TWO_PI * self.periods
        lap = Lap(phases, turn, impulses, states.reshape(-1, self.dimension))
        if self.responds:
            return ResponseSolution(scene, self.course, lap)
        kind = LinearSolution if self.oscillator._motion is None else TaylorSolution
        return kind(scene, self.course, lap, self.pairs, self.driven)

    # --- equations --------------------------------------------------------------------------------

    @property
    def size(self) -> int:
        return sum(self.layout)

    @cached_property
    def _scale(self) -> Array:
        n, k, _ = self.layout
        found = np.concatenate([np.ones(n), np.full(k, self.sizes[1]), self._state_units])
        if not self.driven:
            found[0] = self.sizes[0] / self.sizes[1]
        found.setflags(write=False)
        return found

    @property
    def _state_units(self) -> Array:
        count = self.layout.states // self.dimension
        return np.tile(self._measures[: self.dimension], count)

    def scale(self, x: Array) -> Array:  # noqa: ARG002
        return self._scale

    @cached_property
    def units_of_equations(self) -> Array:
        """What the equations are measured in, at the oscillator's parameters."""
        pushed = np.full(self.layout.impacts, self.sizes[1])
        units = np.concatenate([self._guard_units, pushed, self._state_units])
        units.setflags(write=False)
        return units

    @property
    def _guard_units(self) -> Array:
        m, units, (length, speed) = self._measures.copy(), [], self.sizes
        m[-3:] = 0.0
        machine = Machine(self.oscillator)
        for event, pair in zip(self.itinerary, self.pairs, strict=True):
            row = np.zeros_like(m)
            if event.element >= 0:
                row = self._row(machine, event)
            size = float(abs(row) @ m) or 1.0
            units.append(size * (speed / length) ** (pair.order if pair else 0))
        return np.array(units)

    def _row(self, machine: Machine, event: Happening) -> Array:
        """Row (D,) of the size of what is watched at an event."""
        if not machine.elements[event.element].curved:
            return np.asarray(machine.watched(event.mode, event.element, event.guard))
        watch, row = divided.watch_of(self.oscillator, event), np.zeros_like(self._measures)
        pushed = watch.force * self.oscillator.frequency * float(machine.mass.max())
        row[0], row[machine.size] = watch.gap, watch.rate + pushed
        return row

    def residual(self, x: Array, p: Array) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(self.at(x, p).left / self.units_of_equations)

    def rounding(self, x: Array, p: Array) -> Array:
        return np.asarray(self.at(x, p).rounding / self.units_of_equations)

    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        return self.at(x, p).jacobian(multiplier) / self.units_of_equations[:, None]

    def _by(self, x: Array, p: Array, k: int) -> Array:
        s = self.at(x, p)
        change = self._changes.by(p, k)
        found = None if change is None else s.change(change)
        return self._numerically(x, p, k, s) if found is None else found / self.units_of_equations

    def _numerically(self, x: Array, p: Array, k: int, s: ItinerarySolution) -> Array:
        """Derivative (m,) by the free parameter number `k`, from differences."""
        # Small beside a turn of the fastest mode over the period.
        turns = s.period * float(self.oscillator.natural_frequencies[-1])
        h = 5e-3 * max(abs(float(p[k])), 1e-2) / (1.0 + turns)

        def residual(value: float) -> Array:
            moved = p.copy()
            moved[k] = value
            return self.residual(x, moved)

        return difference(residual, float(p[k]), h)

    @cached_property
    def _corrector(self) -> TableCorrector | None:
        return corrector_of(self)

    def corrected(
        self, y: Array, scale: Array, row: Array, limits: tuple[float, int, int]
    ) -> Correction | None:
        corrector = self._corrector
        return None if corrector is None else corrector(y, scale, row, *limits)

    # --- orbits -----------------------------------------------------------------------------------

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

    @property
    def sticks(self) -> bool:
        return self.course.sticks

    @property
    def section_returns(self) -> int:
        """Number of returns to the section in a period."""
        return len(self.nodes) if self.sticks else returns_of(self.oscillator, self.itinerary)

    def counts(self) -> dict[str, float]:
        """How often what happens in a period, by element: see `OrbitLabel.counts`."""
        return counts_of(self.oscillator, self.itinerary)

    def returns(self, x: Array, p: Array) -> Any:
        if not self.driven:
            raise NoSolution("the map of returns of a machine that nothing drives is not known")
        if not self.sticks:
            return super().returns(x, p)
        # From states in contact, at the phase of the first release, to those of a period later.
        # Where it releases earlier or later the map is the same to first order.
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
            # what is left of the last equations is the end less the next begin
            begin = matrix[np.ix_(last, own)] + np.eye(self.dimension)
            ended = begin @ (to + np.outer(moving, others_by[0]))
            ended += matrix[np.ix_(last, others)] @ others_by
            ended -= np.outer(there.moving[-1, : self.dimension] / s.clock, others_by[0])
            back = np.linalg.solve(passed[: self.dimension, : self.dimension], ended)
            return np.asarray(basis.T @ (back / unit[:, None]))

        return jacobian, np.zeros(basis.shape[1])

    def state_error(self, x: Array, p: Array, residual: float) -> float:  # noqa: ARG002
        s = self.at(x, p)
        if isinstance(s, ShootingSolution):
            return error_of(self, x, p)
        bound = orbit_bound(self, x, p)
        moved = self.states_moved(x, p, bound) + float(s.state_rounding.max(initial=0.0))
        sizes = 32.0 * 2.0**-52 * float(abs(s.section_states).max(initial=0.0))
        phases = bound[: self.layout.events].max(initial=0.0)
        return max(float(bound.max()), float(phases) + moved + sizes)

    @property
    def parts(self) -> int:
        """Number of parts of the orbit that may come again: from node to node, or events."""
        return len(self.nodes) if self._of_nodes else len(self.itinerary)

    @property
    def _of_nodes(self) -> bool:
        """Whether it comes again by its nodes: releases, or periods in which nothing happens."""
        return self.sticks or self.itinerary[0].element < 0

    def _may_repeat(self, k: int) -> bool:
        # how many impacts are named before a chatter is a choice
        return self.sticks or bool(self.itinerary == self.itinerary[k:] + self.itinerary[:k])

    def _marked(self, x: Array) -> tuple[Array, Array]:
        phases, impulses, states = self.layout.split(x)
        if self._of_nodes:
            return phases[list(self.nodes)], (states / self._state_units).reshape(self.parts, -1)
        pushed = np.zeros((self.layout.events, 1))
        pushed[self.course.hits, 0] = impulses
        if not self.driven:
            phases = np.append(0.0, phases[1:])
        return phases, pushed / self.sizes[1]

    def _shorter(self, k: int, periods: int) -> Self:
        nodes, end = (self.nodes[:k], self._end(k)) if self._of_nodes else ((0,), k)
        return self.remade(periods=periods, itinerary=self.itinerary[:end], nodes=nodes)

    def _end(self, k: int) -> int:
        """Number of the events of the first `k` parts."""
        return (*self.nodes, len(self.itinerary))[k] if self.sticks else k

    def _part(self, x: Array, k: int) -> Array:
        phases, impulses, states = self.layout.split(x)
        end, nodes = self._end(k), k if self._of_nodes else 1
        some = sum(event.kicked is not None for event in self.itinerary[:end])
        return np.concatenate([phases[:end], impulses[:some], states[: nodes * self.dimension]])

    def in_turn(self, x: Array) -> tuple[Self, Array]:
        """With its events in turn, from its first one at a phase in [0, 2 pi) on."""
        if self.sticks:
            return self.shortest(x)
        if not self.driven:
            return self, x
        x = x.copy()
        phases = x[: self.layout.events]
        turn = TWO_PI * self.periods
        if self.responds:
            phases -= turn * np.floor((phases - phases[0]) / turn)
        phases -= TWO_PI * np.floor(phases[0] / TWO_PI)
        return self._ascending(x) if self.responds else (self, x)

    def _ascending(self, x: Array) -> tuple[Self, Array]:
        """The same impacts of one mode in the order of their phases."""
        phases, impulses, _ = self.layout.split(x)
        order = np.argsort(phases)
        itinerary = tuple(self.itinerary[i] for i in order.tolist())
        same = self if itinerary == self.itinerary else self.remade(itinerary=itinerary)
        return same, np.concatenate([phases[order], impulses[order]])

    def proper(self, x: Array) -> bool:
        """Without rebound an impulse of zero follows any impact: two impacts are one."""
        phases, impulses, _ = self.layout.split(x)
        if self.sticks:
            # where the derivative is all but singular it is not solved for
            least = float(abs(impulses).min(initial=np.inf))
            return least >= SLOW * abs(impulses).max() and self.state_error(x, NONE, 0.0) < APART
        if not self.driven or not len(impulses):
            return True
        ends = np.append(phases, phases[0] + TWO_PI * self.periods)
        slow = bool((impulses <= LEAST * self.sizes[1]).any())
        return not slow and bool(np.diff(ends).min() >= APART)

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
        phases, pushed = self._marked(x)
        if self._of_nodes:  # means over the nodes, which do not depend on which is the first
            states = self.layout.split(x)[2].reshape(self.parts, -1)
            n = self.oscillator.degrees_of_freedom
            sizes = np.array([abs(states[:, :n]).max(), abs(states[:, n : 2 * n]).max()])
            sizes += self.dimension == 2
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

    # --- what is watched --------------------------------------------------------------------------

    def borders(self, solution: ItinerarySolution) -> list[Border]:
        return list(borders_of(self, solution))

    def touching(self, event: int, x: Array, own: Array, p: Array) -> Mapping[str, float]:
        """Return phase, time from the first state, and element; and the time by what happens."""
        found, border = super().touching(event, x, own, p), self.border(event, x, p)
        kind = named(border, self.at(x, p))
        return {**found, kind: found["time"]}

    def _stations(self, s: ResponseSolution | ShootingSolution) -> list[Station]:
        hits, found, before = iter(s.impulses.tolist()), [], s.before[:, : self.dimension]
        for i, (event, phase) in enumerate(
            zip(self.itinerary, s.event_phases.tolist(), strict=True)
        ):
            impulse = next(hits) if event.kicked else None
            found.append(Station(event, phase, impulse, before[i], i in self.nodes))
        return found

    def _of(self, x: Array, stations: list[Station]) -> tuple[Self, Array]:
        """The equations and unknowns of some stations, the first one of them first."""
        own = [station for station in stations if station.event.element >= 0] or stations
        phases = np.array([station.phase for station in own])
        if not self.driven:
            phases -= phases[0]
            phases[0] = x[0]
        impulses = [station.impulse for station in own if station.impulse is not None]
        nodes = 0, *(i for i, station in enumerate(own) if i and station.node)
        problem = self.remade(itinerary=tuple(station.event for station in own), nodes=nodes)
        if problem.responds:
            return problem._ascending(np.concatenate([phases, impulses]))
        return problem, np.concatenate([phases, impulses, *(own[i].state for i in nodes)])

    def with_events(
        self, x: Array, p: Array, i: int, phase: float, more: list[Happening]
    ) -> tuple[Self, Array]:
        """The same motion with events more after event `i`, at a phase, where guards touch zero."""
        s = self.at(x, p)
        stations = self._stations(s)
        state = s.flown(i, phase) if isinstance(s, ShootingSolution) else stations[0].state
        hits = [0.0 if event.kicked else None for event in more]
        stations[i + 1 : i + 1] = [
            Station(event, phase, hit, state, False) for event, hit in zip(more, hits, strict=True)
        ]
        return self._of(x, stations)

    def without(self, x: Array, p: Array, gone: list[int]) -> tuple[Self, Array] | None:
        """The same motion without some events; None where nothing drives it, nor happens."""
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

    def without_impact(self, x: Array, p: Array, i: int) -> tuple[Self, Array] | None:
        k = self.at(x, p).hits[i]
        same = self.itinerary[(k + 1) % len(self.itinerary)].mode == self.itinerary[k].mode
        return self.without(x, p, [k]) if same else None

    def units(self, solution: ItinerarySolution) -> tuple[float, float, float]:
        length, speed = self.sizes
        return length, speed, speed * solution.frequency

    def admissible(self, x: Array, p: Array) -> bool:
        """Whether it is a motion: no impulse pulls, nothing watched is negative, nor missed."""
        s = self.at(x, p)
        if isinstance(s, ResponseSolution):
            return bool((s.impulses > 0.0).all()) and flights_are_open(s)
        return not any(event.value < 0.0 for event in self.events(x, p)) and s.admissible
