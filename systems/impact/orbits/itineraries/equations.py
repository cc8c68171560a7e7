"""The equations of periodic orbits with a given itinerary."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.orbits.multipliers import product_eigenvalues
from dynkit.orbits.newton import NoSolution, orbit_bound
from dynkit.systems.impact.orbits.borders import Border
from dynkit.systems.impact.orbits.itineraries import divided
from dynkit.systems.impact.orbits.itineraries.borders import Begun, beginnings, borders_of, named
from dynkit.systems.impact.orbits.itineraries.itinerary import (
    Happening,
    Itinerary,
    check_elements,
    counts_of,
    events_seen,
    returns_of,
)
from dynkit.systems.impact.orbits.itineraries.solution import (
    ItinerarySolution,
    Lap,
    Scene,
    moved,
)
from dynkit.systems.impact.orbits.machine import STEP, Machine
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.orbits.problem import ImpactProblem
from dynkit.systems.impact.orbits.solution import SAME
from dynkit.systems.impact.simulation.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

_ROUNDING = 2.0**-52


class Layout(NamedTuple):
    """Where unknowns and equations stand: of n events phases, k impulses, and n states."""

    events: int
    impacts: int
    dimension: int

    @property
    def size(self) -> int:
        """How many there are of either."""
        return self.events * (1 + self.dimension) + self.impacts

    def states(self, i: int) -> slice:
        """Those of event number `i`."""
        begin = self.events + self.impacts + i * self.dimension
        return slice(begin, begin + self.dimension)


class Station(NamedTuple):
    """An event, its phase, its impulse if it is an impact, and the state (2N,) just before."""

    event: Happening
    phase: float
    impulse: float | None
    state: Array


@final
class ItineraryEquations(ImpactProblem[ItinerarySolution]):
    """Periodic orbits of a machine with elements, by the modes that they pass and their events.

    The unknowns are the phases (n,) of the events, the impulses (k,) of the impacts among them and
    the states (n, 2N) just before the events. The equations: the guards are zero, (n,); gaps open
    after impacts at the rate of their law, (k,); each state is what becomes of the one before,
    (n, 2N). Where nothing drives the machine the first event is at phase 0, and the first unknown
    the time of a turn of the phase, of which the orbit takes `periods`. Nothing is eliminated, so
    that no mode is neutral, and rounding stays where it arises. Where an event follows another one
    at which its guard is zero by nature, the equation is the divided difference.

    The itinerary is a tuple of `Happening`; sizes are those of positions and velocities.
    """

    sticks = False
    _arguments: ClassVar[tuple[str, ...]] = (*ImpactProblem._arguments, "driven")

    def __init__(
        self,
        oscillator: ImpactMap,
        names: tuple[str, ...],
        periods: int,
        itinerary: Itinerary,
        sizes: Any,
        driven: bool,
    ) -> None:
        super().__init__(oscillator, names, periods, itinerary, sizes)
        check_elements(oscillator)
        self.driven = driven

    @cached_property
    def layout(self) -> Layout:
        """Of unknowns and equations."""
        hits = sum(event.kicked is not None for event in self.itinerary)
        return Layout(len(self.itinerary), hits, 2 * self.oscillator.degrees_of_freedom)

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
        n = self.oscillator.degrees_of_freedom
        length, speed = self.sizes
        return np.concatenate([np.full(n, length), np.full(n, speed), np.ones(3)])

    def _scene(self, p: Array) -> Scene:
        system = self.system(p) if self._names else self.oscillator
        return Scene(Machine(system), system, self._measures)

    def _lap(self, x: Array) -> Lap:
        n, k, d = self.layout
        phases, impulses, states = np.split(x, [n, n + k])
        turn, turns = TWO_PI / self.oscillator.frequency, TWO_PI * self.periods
        if not self.driven:
            turn, phases = phases[0], np.append(0.0, phases[1:])
        return Lap(np.append(phases, phases[0] + turns), turn, impulses, states.reshape(n, d))

    def _solution(self, x: Array, scene: Scene) -> ItinerarySolution:
        return ItinerarySolution(scene, self.itinerary, self._lap(x), self.driven)

    # --- equations --------------------------------------------------------------------------------

    @property
    def size(self) -> int:
        return self.layout.size

    @cached_property
    def _scale(self) -> Array:
        n, k, d = self.layout
        found = np.concatenate(
            [np.ones(n), np.full(k, self.sizes[1]), np.tile(self._measures[:d], n)]
        )
        if not self.driven:
            found[0] = self.sizes[0] / self.sizes[1]
        found.setflags(write=False)
        return found

    def scale(self, x: Array) -> Array:  # noqa: ARG002
        return self._scale

    @cached_property
    def _units(self) -> Array:
        """What the equations are measured in, at the oscillator's parameters."""
        n, k, d = self.layout
        m, machine = self._measures.copy(), Machine(self.oscillator)
        m[-3:] = 0.0
        units = np.ones(n)
        for i, event in enumerate(self.itinerary):
            if event.element >= 0:
                row = machine.watched(event.mode, event.element, event.guard)
                pair = self.pairs[i]
                units[i] = abs(row) @ m
                if pair is not None:
                    units[i] *= (self.sizes[1] / self.sizes[0]) ** pair.order
        return np.concatenate([units, np.full(k, self.sizes[1]), np.tile(m[:d], n)])

    def residual(self, x: Array, p: Array) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(self._left(self.at(x, p)) / self._units)

    def _left(self, s: ItinerarySolution) -> Any:
        """What is left of the equations, (m,): complex where the machine is."""
        found = (s.guards * s.before).sum(axis=1)
        for i, event in enumerate(self.itinerary):
            if event.element < 0:
                found[i] = s.event_phases[i] - TWO_PI * np.rint(s.event_phases[i] / TWO_PI)
            elif (pair := self.pairs[i]) is not None:
                found[i] = divided.value(s, i, pair)
        rates = (s.rates * s.before[s.hits]).sum(axis=1) + (1.0 - s.returned) * s.impulses
        states = s.lap.states
        missing = s.reached[:, : states.shape[1]] - np.roll(states, -1, axis=0)
        return np.concatenate([found, rates, missing.ravel()])

    def rounding(self, x: Array, p: Array) -> Array:
        s = self.at(x, p)
        d = self.layout.dimension
        turned = 8.0 + abs(s.event_phases)
        guards = turned * (abs(s.guards) * abs(s.before)).sum(axis=1)
        rates = turned[s.hits] * (abs(s.rates) * abs(s.before[s.hits])).sum(axis=1)
        for i, event in enumerate(self.itinerary):
            if event.element < 0:
                guards[i] = turned[i]
            elif (pair := self.pairs[i]) is not None:
                guards[i] = divided.rounding(s, i, pair) / _ROUNDING
        own = _ROUNDING * np.concatenate([guards, rates + 4.0 * abs(s.impulses)])
        missing = s.rounded[:, :d] + _ROUNDING * abs(s.lap.states)
        return np.asarray(np.concatenate([own, missing.ravel()]) / self._units)

    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        s = self.at(x, p)
        n, d = self.layout.events, self.layout.dimension
        kind: Any = np.result_type(multiplier, 1.0)
        out = np.zeros((self.size, self.size), dtype=kind)
        by_phase = np.zeros_like(s.before)
        by_phase[:, -3], by_phase[:, -2] = s.before[:, -2], -s.before[:, -3]
        for i in range(n):
            event, own, row = self.itinerary[i], self.layout.states(i), s.guards[i]
            # the state before event i as a function of its phase, of its impulse, and of itself
            columns = [i] * self._phase_is_free(i)
            columns += [n + s.impulse_of[i]] if i in s.impulse_of else []
            change = np.zeros((d + 3, len(columns) + d))
            change[:d, len(columns) :] = np.eye(d)
            if self._phase_is_free(i):
                change[:, 0] = by_phase[i]
            columns += range(own.start, own.stop)
            if event.element < 0:
                out[i, i] = 1.0
            elif self.pairs[i] is None:
                out[i, columns] += row @ change
            if i in s.impulse_of:
                j = s.impulse_of[i]
                out[n + j, columns] += s.rates[j] @ change
                out[n + j, n + j] += 1.0 - s.returned[j]
                change[:, columns.index(n + j)] += s.kicks[i]
            change = s.resets[i] @ change
            self._follow(out, s, i, columns, change, multiplier)
        for i, pair in enumerate(self.pairs):
            if pair is not None:
                self._divide(out, s, i, pair, by_phase, multiplier)
        return out / self._units[:, None]

    def _phase_is_free(self, i: int) -> bool:
        return self.driven or i > 0

    def _follow(
        self, out: Any, s: ItinerarySolution, i: int, columns: list[int], change: Array, mu: Any
    ) -> None:
        """Add what becomes of the state after event `i`: rows of the next state."""
        d, after = self.layout.dimension, (i + 1) % len(self.itinerary)
        rows = self.layout.states(i)
        out[rows, columns] += (s.transitions[i] @ change)[:d]
        for column, part in self._durations(s, i, mu):
            out[rows, column] += part * (s.flows[i] @ s.reached[i])[:d]
        there = self.layout.states(after)
        out[rows, there] -= np.eye(d) * (mu if after == 0 else 1.0)

    def _durations(self, s: ItinerarySolution, i: int, mu: Any) -> Iterator[tuple[int, Any]]:
        """Derivatives of the time from event `i` to the next, by columns."""
        after = (i + 1) % len(self.itinerary)
        if self._phase_is_free(i):
            yield i, -1.0 / s.clock
        if self._phase_is_free(after):
            yield after, (mu if after == 0 else 1.0) / s.clock
        if not self.driven:
            yield 0, s.durations[i] / s.lap.turn

    def _divide(
        self,
        out: Any,
        s: ItinerarySolution,
        i: int,
        pair: divided.Pair,
        by_phase: Array,
        mu: Any,
    ) -> None:
        """Add the row of a divided difference."""
        n, begun = len(self.itinerary), pair.first > i
        for j, by_state, by_time in divided.derivatives(s, i, pair):
            # what began before the period began: all in terms of the period before
            factor = mu if begun and j <= i else 1.0
            row, own = factor * (by_state @ s.resets[j]), self.layout.states(j)
            out[i, own] += row[: own.stop - own.start]
            if self._phase_is_free(j):
                out[i, j] += row @ by_phase[j]
            if j in s.impulse_of:
                out[i, n + s.impulse_of[j]] += row @ s.kicks[j]
            for column, part in self._durations(s, j, mu):
                out[i, column] += factor * by_time * part

    def _by(self, x: Array, p: Array, k: int) -> Array:
        system = self.system(p)
        machine = Machine(system, self._changes.by(p, k))
        scene = Scene(machine, system, self._measures)
        with np.errstate(all="ignore"):
            left = self._left(self._solution(x, scene))
        return np.asarray(left.imag / STEP / self._units)

    # --- orbits -----------------------------------------------------------------------------------

    def orbit(self, x: Array, p: Array, history: Sequence[float] = ()) -> ImpactOrbit:
        fixed = self.remade(oscillator=self.system(p), names=())
        return ImpactOrbit(fixed, x, tuple(history), Cost(0.0))

    def multipliers(self, x: Array, p: Array) -> Any:
        found = product_eigenvalues(self.factors(x, p)[0])
        return found if self.driven else found[:-1]

    def factors(self, x: Array, p: Array) -> tuple[Array, Array]:
        """From just before each event, at its phase, to just before the next one.

        Of what nothing drives from the guard of the first event to itself, along the motion.
        """
        s, d = self.at(x, p), self.layout.dimension
        found = []
        for i in range(len(self.itinerary)):
            moving = s.flows[i - 1] @ s.before[i]
            passed = s.resets[i].copy()
            if i in s.impulse_of:
                j = s.impulse_of[i]
                own = np.outer(s.kicks[i], s.rates[j]) / (1.0 - s.returned[j])
                passed = s.resets[i] @ (np.eye(len(own)) - own)
            rate = float(s.guards[i] @ moving)
            if rate and (self.driven or i):
                late = s.flows[i] @ s.after[i] - passed @ moving
                passed = passed + np.outer(late, s.guards[i] / rate)
            found.append((s.transitions[i] @ passed)[:d, :d])
        if not self.driven:
            moving = (s.flows[-1] @ s.reached[-1])[:d]
            row = s.guards[0][:d]
            found[-1] -= np.outer(moving / (row @ moving), row @ found[-1])
        factors = np.array(found)
        m = self._measures[:d]
        factors = factors * m / m[:, None]
        norms = (abs(s.flows) * self._measures / self._measures[:, None]).sum(axis=1).max(axis=1)
        grown = 16.0 + norms * abs(s.durations)
        return factors, _ROUNDING * grown * abs(factors).max(axis=(1, 2))

    @property
    def section_returns(self) -> int:
        return returns_of(self.oscillator, self.itinerary)

    def counts(self) -> dict[str, float]:
        return counts_of(self.oscillator, self.itinerary)

    def returns(self, x: Array, p: Array) -> Any:
        if not self.driven:
            raise NoSolution("the map of returns of a machine that nothing drives is not known")
        return super().returns(x, p)

    def state_error(self, x: Array, p: Array, residual: float) -> float:  # noqa: ARG002
        bound = orbit_bound(self, x, p)
        return max(float(bound.max()), self.states_moved(x, p, bound))

    def _may_repeat(self, k: int) -> bool:
        return bool(self.itinerary == self.itinerary[k:] + self.itinerary[:k])

    def _marked(self, x: Array) -> tuple[Array, Array]:
        lap = self._lap(x)
        return lap.phases[:-1], lap.states / self._measures[: self.layout.dimension]

    def _part(self, x: Array, k: int) -> Array:
        n, hits, d = self.layout
        phases, impulses, states = np.split(x, [n, n + hits])
        some = sum(event.kicked is not None for event in self.itinerary[:k])
        return np.concatenate([phases[:k], impulses[:some], states[: k * d]])

    def in_turn(self, x: Array) -> tuple[Self, Array]:
        """With its first event at a phase in [0, 2 pi)."""
        if self.driven:
            x = x.copy()
            x[: len(self.itinerary)] -= TWO_PI * np.floor(x[0] / TWO_PI)
        return self, x

    def proper(self, x: Array) -> bool:  # noqa: ARG002
        return True

    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        problem = self.remade(periods=2 * self.periods, itinerary=self.itinerary * 2)
        n, hits, _ = self.layout
        turn = TWO_PI * self.periods
        phases, impulses, states = np.split(x, [n, n + hits])
        a, b, c = np.split(disturbance, [n, n + hits])
        later, late = phases + turn, -a
        if not self.driven:
            stretched = a[0] / phases[0]
            a = np.append(0.0, a[1:] + phases[1:] * stretched)
            later, late = np.append(turn, phases[1:] + turn), turn * stretched - a
        twice = np.concatenate([phases, later, impulses, impulses, states, states])
        return problem, twice, np.concatenate([a, late, b, -b, c, -c])

    def canonical(self, x: Array) -> Array:
        lap, n = self._lap(x), len(self.itinerary)
        turn = np.exp(1j * lap.phases[:-1])
        weights = lap.states / self._measures[: self.layout.dimension]
        moments = [weights.sum(axis=0), (weights * turn.real[:, None]).sum(axis=0)]
        moments += [(weights * turn.imag[:, None]).sum(axis=0)]
        period = [] if self.driven else [lap.turn / self._scale[0]]
        return np.concatenate([np.concatenate(moments) / n, period])

    # --- what is watched --------------------------------------------------------------------------

    def borders(self, solution: ItinerarySolution) -> list[Border]:
        return list(borders_of(self, solution))

    def touching(self, event: int, x: Array, own: Array, p: Array) -> Mapping[str, float]:
        """Return phase, time from the first state, and element; and the time by what happens."""
        found, border = super().touching(event, x, own, p), self.border(event, x, p)
        kind = named(border, self.at(x, p))
        return {**found, kind: found["time"]}

    def _stations(self, x: Array) -> list[Station]:
        lap, hits = self._lap(x), iter(range(self.layout.impacts))
        return [
            Station(event, phase, lap.impulses[next(hits)] if event.kicked else None, state)
            for event, phase, state in zip(
                self.itinerary, lap.phases[:-1].tolist(), lap.states, strict=True
            )
        ]

    def _of(self, x: Array, stations: list[Station]) -> tuple[Self, Array]:
        """The equations and unknowns of some stations, the first one of them first."""
        own = [station for station in stations if station.event.element >= 0] or stations
        phases = np.array([station.phase for station in own])
        if not self.driven:
            phases -= phases[0]
            phases[0] = x[0]
        impulses = [station.impulse for station in own if station.impulse is not None]
        states = np.concatenate([station.state for station in own])
        itinerary = tuple(station.event for station in own)
        return self.remade(itinerary=itinerary), np.concatenate([phases, impulses, states])

    def with_events(
        self, x: Array, p: Array, i: int, phase: float, more: list[Happening]
    ) -> tuple[Self, Array]:
        """The same motion with events more after event `i`, at a phase, where guards touch zero."""
        s, stations = self.at(x, p), self._stations(x)
        state = _flown(s, i, phase)
        hits = [0.0 if event.kicked else None for event in more]
        stations[i + 1 : i + 1] = [
            Station(event, phase, hit, state) for event, hit in zip(more, hits, strict=True)
        ]
        return self._of(x, stations)

    def without(self, x: Array, p: Array, gone: list[int]) -> tuple[Self, Array] | None:
        """The same motion without some events; None where nothing drives it, nor happens."""
        stations = self._stations(x)
        left = [station for i, station in enumerate(stations) if i not in gone]
        if not left:
            if not self.driven:
                return None
            s, i = self.at(x, p), gone[0]
            phase = TWO_PI * float(np.ceil(s.event_phases[i] / TWO_PI))
            mode = stations[i].event.mode
            left = [Station(Happening(mode, -1, 0), phase, None, _flown(s, i, phase))]
        return self._of(x, left)

    def without_impact(self, x: Array, p: Array, i: int) -> tuple[Self, Array] | None:
        k = self.at(x, p).hits[i]
        same = self.itinerary[(k + 1) % len(self.itinerary)].mode == self.itinerary[k].mode
        return self.without(x, p, [k]) if same else None

    def units(self, solution: ItinerarySolution) -> tuple[float, float, float]:
        length, speed = self.sizes
        return length, speed, speed * solution.frequency

    def admissible(self, x: Array, p: Array) -> bool:
        """Whether it is a motion: no impulse pulls, and simulation finds the same events."""
        s = self.at(x, p)
        if (s.impulses < 0.0).any() or (s.durations < 0.0).any():
            return False
        if any(border.value(s) < 0.0 for border in self.borders(s)):
            return False
        i = int(np.argmax(s.durations))
        since = float(s.event_phases[i] - s.event_phases[0]) / s.clock + 0.5 * float(s.durations[i])
        late = float(s.event_phases[0] - s.phases[0]) / s.clock
        position, velocity = s.sample(np.array([since + late]))
        system, phase = s.oscillator, float(s.event_phases[0]) + s.clock * since
        phase = phase if self.driven else 0.0
        try:
            start = system.state(position[0], velocity[0], phase % TWO_PI)
            seen = simulated(system, start, s.period)
        except (NoMotion, NotImplementedError):
            return False
        return self._follows(s, seen, since)

    def _follows(self, s: ItinerarySolution, seen: Any, since: float) -> bool:
        """Whether events seen from a time on are those of the orbit."""
        times = np.asarray((s.event_phases - s.event_phases[0]) / s.clock)
        due = (times - since) % s.period
        order = [i for i in np.argsort(due).tolist() if self.itinerary[i].element >= 0]
        if len(seen.events) != len(order):
            return False
        same = all(
            (a.element, a.guard, a.mode.numbers) == (b.element, b.guard, b.mode.numbers)
            for a, b in zip(seen.events, (self.itinerary[i] for i in order), strict=True)
        )
        return same and bool((abs(seen.times - due[order]) <= SAME * s.period).all())


def _flown(s: ItinerarySolution, i: int, phase: float) -> Array:
    """The state (2N,) at a phase after event `i`."""
    late = np.array([(phase - s.event_phases[i]) / s.clock])
    z = moved(s.flows[i : i + 1], late, s.measures)[0] @ s.after[i]
    return np.asarray(z[:-3])


def simulated(system: Any, start: Any, length: float) -> Any:
    """The events of a motion from a state on, for some time."""
    count = 4
    while True:
        run = system._run(start, count, store=True)
        if run.duration > length or run.impacts < count:
            break
        count *= 4
    seen = events_seen(system, run)
    return seen.part(0, int(np.searchsorted(seen.times, length)))
