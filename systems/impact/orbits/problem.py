"""Unknowns and equations of periodic orbits with a given itinerary, and their derivatives."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.no_motion import replaced
from dynkit.core.validation import Array
from dynkit.orbits.events import Event, WatchedProblem
from dynkit.orbits.newton import Correction
from dynkit.orbits.problem import PeriodicProblem
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.free_motion import free_motion
from dynkit.systems.impact.orbits.borders import Border
from dynkit.systems.impact.orbits.itineraries.borders import Begun, beginnings
from dynkit.systems.impact.orbits.itineraries.happening import Happening, Itinerary
from dynkit.systems.impact.orbits.itineraries.itinerary import (
    Course,
    counts_of,
    has_law,
    regimes_of,
    returns_of,
)
from dynkit.systems.impact.orbits.itineraries.motion import ItinerarySolution, Lap
from dynkit.systems.impact.orbits.itineraries.one_mode import responses
from dynkit.systems.impact.orbits.itineraries.one_mode.correcting import Corrector, corrector_of
from dynkit.systems.impact.orbits.itineraries.one_mode.responses import (
    ResponseSolution,
    Windows,
    windows_of,
)
from dynkit.systems.impact.orbits.itineraries.one_mode.terms import Terms
from dynkit.systems.impact.orbits.itineraries.several_modes import divided, passage
from dynkit.systems.impact.orbits.itineraries.several_modes.linear import LinearSolution
from dynkit.systems.impact.orbits.itineraries.several_modes.shooting import ShootingSolution
from dynkit.systems.impact.orbits.itineraries.several_modes.taylor import TaylorSolution
from dynkit.systems.impact.orbits.machine import Changes, Machine, Regimes, derivative, machine_of
from dynkit.systems.impact.records.event_counts import LASTING
from dynkit.systems.impact.simulation.parameters import changes_alone
from dynkit.systems.impact.simulation.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap


class Layout(NamedTuple):
    """Numbers of unknowns and equations: event phases, impulses, and components of states."""

    events: int
    impacts: int
    states: int

    def split(self, x: Array) -> list[Array]:
        """The three parts of unknowns, or of equations."""
        n, end = self.events, self.events + self.impacts
        return [x[:n], x[n:end], x[end:]]


def responds(oscillator: ImpactMap, itinerary: Itinerary, driven: bool) -> bool:
    """Whether all states follow from the impulses, as periodic responses.

    They do if all events are impacts of hard stops with constant restitution, in the mode without
    contact, and if all motions in this mode have a restoring force.
    """
    stops = all(isinstance(element, HardStop) for element in oscillator._elements)
    if not (driven and stops) or has_law(oscillator) or oscillator._motion is not None:
        return False
    one = all(e.kicked == e.mode and not any(e.mode.numbers) for e in itinerary)
    return one and not len(free_motion(oscillator._contact).neutral)


class ImpactProblem(PeriodicProblem, WatchedProblem):
    """Periodic orbits of an impact oscillator with a given itinerary of modes and events.

    The unknowns are the phases (n,) of the events, not wrapped; the impulses (k,) of the impacts
    among them, as changes of the relative velocity; and the states (2N + J,), with the positions of
    J sliders, just before the nodes. Nodes are some of the events, at least the first one. The
    equations: the guards are zero, (n,); the gaps open after impacts at the rate of their impact
    law, (k,); each node's state is the state to which the motion from the node before leads. Where
    all states follow from the impulses, they are no unknowns: see `responds`. The first impacts of
    a chatter are events; its other impacts, until contact, are simulated. Then the nodes are the
    releases. Where nothing drives the machine the first event is at phase 0. Then the first unknown
    is the time of one turn of the phase, and the orbit takes `periods` turns. The equations do not
    demand open gaps between the events or positive impulses. Where a guard is zero at an earlier
    event for any motion, the equation is a divided difference: see `divided.pairs`.

    The itinerary is a tuple of `Happening`. `sizes` are those of positions and velocities. `nodes`
    are the numbers of the events that are nodes.

    References
    ----------
    J. Shaw, S. W. Shaw, The onset of chaos in a two-degree-of-freedom impacting system, Journal of
    Applied Mechanics 56 (1989) 168-174 (impulse responses).
    A. B. Nordmark, P. T. Piiroinen, Simulation and stability analysis of impacting systems with
    complete chattering, Nonlinear Dynamics 58 (2009) 85-106.
    """

    _stored: ClassVar = ("periods", "itinerary", "sizes", "driven", "nodes")
    _arguments: ClassVar = ("oscillator", "names", *_stored)
    _given: ClassVar = "oscillator"
    periods: int
    itinerary: Itinerary
    sizes: Sequence[float]
    driven: bool
    nodes: tuple[int, ...]
    _names: tuple[str, ...] = ()

    def __init__(
        self,
        oscillator: ImpactMap,
        names: tuple[str, ...],
        periods: int,
        itinerary: Itinerary,
        sizes: Sequence[float],
        driven: bool,
        nodes: tuple[int, ...] = (0,),
    ) -> None:
        self.oscillator, self.periods, self.itinerary = oscillator, periods, itinerary
        self.sizes, self.driven, self.nodes = sizes, driven, nodes
        self._names = names
        self._changes = Changes(self.system, self._flights)
        self._known: list[tuple[bytes, Any]] = []
        self._last: tuple[bytes, Any] | None = None
        self._watched: tuple[Any, list[Event]] | None = None
        self._borders: list[Border] = []
        self._home: tuple[bytes, Array] | None = None

    # --- parameters -------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        return self._names

    def free(self, *names: str) -> Self:
        """Return the same problem with other parameters free.

        Raises
        ------
        ValueError
            When the oscillator has no such parameter, or when it is undriven and the parameter is
            an amplitude, which would drive it.
        """
        for name in names:
            value = self.oscillator.value_of(name)
            if not self.driven and name.rpartition(".")[2] == "amplitude":
                raise ValueError(
                    f"{name} must stay {value} on a branch of cycles that nothing drives: with "
                    "another value it drives the machine, and these cycles are no motions"
                )
        return self.remade(names=names)

    @property
    def values(self) -> Array:
        return np.array([self.oscillator.value_of(name) for name in self._names], dtype=float)

    def system(self, p: Array) -> ImpactMap:
        """The oscillator with these values (k,) of the free parameters."""
        changes: Any = dict(zip(self._names, p.tolist(), strict=True))
        return replaced(self.oscillator, **changes)

    def _restored(self) -> Self:
        """Return the same equations after a check of arguments read from a store.

        Raises
        ------
        ValueError
            When the oscillator has no such modes or events, or nodes, periods or sizes are wrong.
        """
        count = len(self.itinerary)
        for event in self.itinerary:
            for mode in (event.mode, event.kicked or event.mode):
                self.oscillator._automaton.checked_mode(mode.numbers)
                if mode != regimes_of(self.oscillator, mode.numbers):
                    raise ValueError(f"{mode} is no mode of the oscillator")
            if not self._may_happen(event):
                raise ValueError(f"{event} is no event of the oscillator")
        if list(self.nodes) != sorted({*self.nodes} & {*range(count)}) or self.periods < 1:
            raise ValueError(f"nodes {self.nodes} of {count} events in {self.periods} periods")
        if len(self.sizes) != 2:
            raise ValueError(f"sizes are {self.sizes}")
        return self.remade()

    def _may_happen(self, event: Happening) -> bool:
        k, elements, hits = event.element, self.oscillator._elements, event.kicked is not None
        if k == -1 and not (hits or event.chatters):  # begin of a period of the forcing
            return True
        among = len(self.oscillator._stops) if hits else len(elements)
        rubs = all(0 <= j < len(elements) and -1 <= sign <= 1 for j, sign in event.rubs)
        if not (0 <= k < among and rubs and event.piece >= 0) or event.chatters > hits:
            return False
        return 0 <= event.guard < len(elements[k].regimes[event.mode.numbers[k]].guards)

    @final
    def remade(self, **changes: Any) -> Self:
        """The same equations with other arguments of the constructor."""
        return type(self)(*(changes.get(name, getattr(self, name)) for name in self._arguments))

    def __reduce__(self) -> tuple[Any, ...]:
        # The arguments alone; caches are left out.
        return type(self), tuple(getattr(self, name) for name in self._arguments)

    # --- the itinerary ----------------------------------------------------------------------------

    @cached_property
    def layout(self) -> Layout:
        """Numbers of unknowns of each kind, which are those of the equations as well."""
        hits = len(self.course.hits)
        states = 0 if self.responds else self.dimension * len(self.nodes)
        return Layout(len(self.itinerary), hits, states)

    @property
    def dimension(self) -> int:
        """Number 2N + J of positions, velocities, and positions of sliders."""
        return self.oscillator.degrees_of_freedom + self.oscillator._size

    @cached_property
    def responds(self) -> bool:
        """Whether states follow from the impulses: see `responds`."""
        return responds(self.oscillator, self.itinerary, self.driven)

    @cached_property
    def course(self) -> Course:
        """The itinerary, with the derived numbers of its events."""
        return Course(self.itinerary, self.nodes)

    @property
    def sticks(self) -> bool:
        """Whether orbits are P(inf,m): contact with a stop begins with an impact."""
        return self.course.sticks

    @property
    def section_returns(self) -> int:
        """Number of returns to the section in a period."""
        return len(self.nodes) if self.sticks else returns_of(self.oscillator, self.itinerary)

    def counts(self, x: Array) -> dict[str, float]:
        """Numbers of events in a period, by element: see `OrbitLabel.counts`."""
        s = self.at(x, self.values)
        lasting = np.roll(s.durations, 1) > LASTING * s.period
        return counts_of(self.oscillator, self.itinerary, lasting)

    @property
    def sides(self) -> Any:
        """Number (k,) of the stop of each impact."""
        return self.course.sides

    @cached_property
    def pairs(self) -> list[divided.Pair | None]:
        """For each event the earlier event at which its guard is zero for any motion, or None."""
        return divided.pairs(self.oscillator, self.itinerary, self._names)

    @cached_property
    def beginnings(self) -> list[Begun]:
        """Events at which an element begins to hold or to stick, or could begin and does not."""
        return beginnings(self.oscillator, self.itinerary)

    @property
    def _flights(self) -> Sequence[Regimes]:
        """The modes whose flights are computed by Taylor's method."""
        smooth = self.oscillator._motion is not None
        return sorted({event.mode for event in self.itinerary}) if smooth else ()

    # --- motions ----------------------------------------------------------------------------------

    @final
    def scene(self, p: Array) -> Any:
        """Matrices that all solutions at these values (k,) share; the last eight are kept."""
        key = p.tobytes()
        for known, scene in self._known:
            if known == key:
                return scene
        scene = self._scene(p)
        self._known = [(key, scene), *self._known[:7]]
        return scene

    def _scene(self, p: Array) -> responses.Scene | passage.Scene:
        """Matrices that all solutions at these values (k,) share."""
        if self.responds and self.plain:
            # The terms follow from the values; no oscillator is built for each value.
            values = dict(zip(self._names, p.tolist(), strict=True))
            terms = self._terms.at(self.oscillator, values)
            own = self.oscillator, self.windows, terms, self._measures
            return responses.Scene(*own, partial(self.system, p))
        system = self.system(p) if self._names else self.oscillator
        if self.responds:
            own = system, windows_of(system), Terms.of(system), self._measures
            return responses.Scene(*own, partial(self.system, p))
        known = self._known[0][1].machine if self._known else None
        machine, parts = known.like(system) if known else machine_of(system), system._parts
        if parts.falls and system._motion is None:
            for mode in {event.mode for event in self.itinerary}:
                parts.check_slopes(machine.dashpots(mode))
        return passage.Scene(machine, system, self._measures)

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
        return all(self._alone)

    @cached_property
    def _alone(self) -> list[bool]:
        """Which of the free parameters are in closed form, and change nothing but themselves."""
        own = self.oscillator
        return [not own.elements and changes_alone(own, name) for name in self._names]

    @final
    def at(self, x: Array, p: Array) -> Any:
        """Return the motion given by unknowns x and parameters p; the last one is kept."""
        key = x.tobytes() + p.tobytes()
        if self._last is None or self._last[0] != key:
            x = x.copy()
            x.setflags(write=False)
            self._last = key, self._solution(x, self.scene(p))
        return self._last[1]

    def _solution(self, x: Array, scene: Any) -> ResponseSolution | ShootingSolution:
        """Return the motion given by read-only unknowns (m,)."""
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

    @cached_property
    def _measures(self) -> Array:
        n, (length, speed) = self.oscillator.degrees_of_freedom, self.sizes
        return np.repeat([length, speed, length, 1.0], [n, n, self.dimension - 2 * n, 3])

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

    def scale(self, x: Array) -> Array:
        if self.responds:
            return self._scale
        # units that grow with the motion keep the relative step size of a branch at a resonance
        n, d, (events, impacts, _) = self.oscillator.degrees_of_freedom, self.dimension, self.layout
        moved = abs(x[events + impacts :].reshape(-1, d)).max(axis=0)
        length, speed = np.maximum(self.sizes, [moved[:n].max(), moved[n : 2 * n].max()])
        own = np.tile(np.repeat([length, speed, length], [n, n, d - 2 * n]), len(self.nodes))
        return np.concatenate([self._scale[:events], np.full(impacts, speed), own])

    @cached_property
    def units_of_equations(self) -> Array:
        """Units (m,) of the equations, at the oscillator's parameters."""
        pushed = np.full(self.layout.impacts, self.sizes[1])
        units = np.concatenate([self._guard_units, pushed, self._state_units])
        units.setflags(write=False)
        return units

    @property
    def _guard_units(self) -> Array:
        m, units, (length, speed) = self._measures.copy(), [], self.sizes
        m[-3:] = 0.0
        machine = machine_of(self.oscillator)
        for event, pair in zip(self.itinerary, self.pairs, strict=True):
            row = np.zeros_like(m)
            if event.element >= 0:
                row = self._row(machine, event)
            size = float(abs(row) @ m) or 1.0
            units.append(size * (speed / length) ** (pair.order if pair else 0))
        return np.array(units)

    def _row(self, machine: Machine, event: Happening) -> Array:
        """Row (D,) of the guard of an event; along a curved stop a row of the same magnitude."""
        acting = (event.element, *event.mode.held)
        if not any(machine.elements[k].curved for k in acting):
            return np.asarray(machine.watched(event.mode, event.element, event.guard))
        watch, row = divided.watch_of(self.oscillator, event), np.zeros_like(self._measures)
        pushed = watch.force * self.oscillator.frequency * float(machine.mass.max())
        row[0], row[machine.size] = watch.gap, watch.rate + pushed
        return row

    def units(self, solution: ItinerarySolution) -> tuple[float, float, float]:
        """Units of gaps, of their rates and of their accelerations."""
        length, speed = self.sizes
        return length, speed, speed * solution.frequency

    def residual(self, x: Array, p: Array) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(self.at(x, p).left / self.units_of_equations)

    def rounding(self, x: Array, p: Array) -> Array:
        return np.asarray(self.at(x, p).rounding / self.units_of_equations)

    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        with np.errstate(over="ignore", invalid="ignore"):
            return self.at(x, p).jacobian(multiplier) / self.units_of_equations[:, None]

    @final
    def parameter_derivative(self, x: Array, p: Array) -> Array:
        columns = [self._by(x, p, k) for k in range(len(self._names))]
        return np.array(columns).T if columns else np.empty((self.size, 0))

    def _by(self, x: Array, p: Array, k: int) -> Array:
        """Derivative (m,) of the equations by the free parameter number `k`."""
        s = self.at(x, p)
        change = self._changes.by(p, k, self._alone[k])
        found = None if change is None else s.change(change)
        if found is not None:
            return np.asarray(found / self.units_of_equations)

        def residual(value: float) -> Array:
            moved = p.copy()
            moved[k] = value
            return self.residual(x, moved)

        return derivative(residual, float(p[k]))

    @abstractmethod
    def state_error(self, x: Array, p: Array) -> float:
        """Estimate of the largest error of a section coordinate: see `ImpactOrbit.error`."""

    @cached_property
    def _corrector(self) -> Corrector | None:
        return corrector_of(self)

    def corrected(
        self, y: Array, scale: Array, row: Array, limits: tuple[float, int, int]
    ) -> Correction | None:
        corrector = self._corrector
        return None if corrector is None else corrector(y, scale, row, *limits)
