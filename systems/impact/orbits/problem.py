"""What the equations of periodic orbits of impact oscillators have in common."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import Refused, replaced
from dynkit.core.smooth_map import proper_divisors
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import Condition, Event, WatchedProblem
from dynkit.orbits.newton import NoSolution
from dynkit.orbits.problem import PeriodicProblem
from dynkit.systems.impact.orbits.borders import Border
from dynkit.systems.impact.orbits.machine import Changes, Regimes
from dynkit.systems.impact.orbits.orbit import ImpactOrbit, observables_of
from dynkit.systems.impact.simulation.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

REPEATED = 1e-7
"""States and impulses that agree so well, in their units, are the same."""

APART = 1e-6
"""Two solutions that differ by less, scaled, are the same orbit."""


def has_table_alone(oscillator: ImpactMap) -> None:
    """Raise NotImplementedError where other elements than a table act, or energies are smooth."""
    if oscillator._table_alone:
        return
    other = oscillator._own or oscillator.elements
    got = repr(other[0]) if other else f"engine {oscillator.engine}"
    raise NotImplementedError(
        "orbits from phases are those of quadratic energies and a table of one coordinate, alone; "
        f"got {got}: find_orbits() searches, and periodic_orbit(start=...) and "
        "attractor.periodic_orbit() find those near a motion"
    )


class ImpactProblem(PeriodicProblem, WatchedProblem):
    """Periodic orbits of an impact oscillator with a given itinerary.

    A subclass must implement, beside the equations, what is abstract here.

    Parameters
    ----------
    oscillator : ImpactMap
        At whose parameters the others than the free ones stay.
    names : tuple of str
    periods : int
        Number m of periods of the forcing.
    itinerary : sequence
        Which impacts happen, one item for each part of the orbit that may come again.
    sizes : float or (2,)
        Typical speed, or typical size of positions and of velocities.
    """

    driven = True
    """Whether the motion has the period of the forcing, or some; else one of its own."""
    _arguments: ClassVar[tuple[str, ...]] = "oscillator", "names", "periods", "itinerary", "sizes"

    def __init__(
        self,
        oscillator: ImpactMap,
        names: tuple[str, ...],
        periods: int,
        itinerary: Any,
        sizes: Any,
    ) -> None:
        self.oscillator = oscillator
        self._names = names
        self.periods = periods
        self.itinerary = itinerary
        self.sizes = sizes
        self._changes = Changes(self.system, self._flights)
        self._known: list[tuple[bytes, Any]] = []
        self._last: tuple[bytes, Any] | None = None
        self._watched: tuple[Any, list[Event]] | None = None
        self._home: tuple[bytes, Array] | None = None

    @property
    def _flights(self) -> Sequence[Regimes]:
        """The modes in which flights are followed by Taylor's method."""
        smooth = self.oscillator._motion is not None
        return sorted({event.mode for event in self.itinerary}) if smooth else ()

    @final
    def remade(self, **changes: Any) -> Self:
        """The same equations with other arguments of the constructor."""
        return type(self)(*(changes.get(name, getattr(self, name)) for name in self._arguments))

    def __reduce__(self) -> tuple[Any, ...]:
        # Without what is kept for the next call.
        return type(self), tuple(getattr(self, name) for name in self._arguments)

    # --- parameters -------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        return self._names

    def free(self, *names: str) -> Self:
        """Return the same problem with other parameters free.

        Raises
        ------
        ValueError
            When the oscillator has no such parameter.
        """
        for name in names:
            self.oscillator.value_of(name)
        return self.remade(names=names)

    @property
    def values(self) -> Array:
        return np.array([self.oscillator.value_of(name) for name in self._names], dtype=float)

    def system(self, p: Array) -> ImpactMap:
        """The oscillator with these values (k,) of the free parameters."""
        try:
            changes: Any = dict(zip(self._names, p.tolist(), strict=True))
            return replaced(self.oscillator, **changes)
        except Refused as refusal:
            raise NoSolution(str(refusal)) from refusal

    @final
    def scene(self, p: Array) -> Any:
        """What solutions at these values (k,) share; the last few are kept."""
        key = p.tobytes()
        for known, scene in self._known:
            if known == key:
                return scene
        scene = self._scene(p)
        self._known = [(key, scene), *self._known[:7]]
        return scene

    @abstractmethod
    def _scene(self, p: Array) -> Any:
        """What solutions at these values (k,) share."""

    @final
    def at(self, x: Array, p: Array) -> Any:
        """The motion that unknowns stand for; the last one is kept."""
        key = x.tobytes() + p.tobytes()
        if self._last is None or self._last[0] != key:
            x = x.copy()
            x.setflags(write=False)
            self._last = key, self._solution(x, self.scene(p))
        return self._last[1]

    @abstractmethod
    def _solution(self, x: Array, scene: Any) -> Any:
        """The motion of unknowns (m,), read-only."""

    @final
    def parameter_derivative(self, x: Array, p: Array) -> Array:
        columns = [self._by(x, p, k) for k in range(len(self._names))]
        return np.array(columns).T if columns else np.empty((self.size, 0))

    @abstractmethod
    def _by(self, x: Array, p: Array, k: int) -> Array:
        """Derivative (m,) of the equations by the free parameter number `k`."""

    # --- orbits -----------------------------------------------------------------------------------

    def orbit(self, x: Array, p: Array, history: Sequence[float] = ()) -> ImpactOrbit:
        fixed = self.remade(oscillator=self.system(p), names=())
        return ImpactOrbit(fixed, x, tuple(history), Cost(0.0))

    def observed(self, x: Array, p: Array, name: str) -> Array:
        solution = self.at(x, p)
        found = observables_of(solution) if len(solution.impulses) else {}
        return found[name] if name in found else super().observed(x, p, name)

    @property
    @abstractmethod
    def sticks(self) -> bool:
        """Whether orbits are P(inf,m)."""

    @property
    @abstractmethod
    def parts(self) -> int:
        """Number of parts of the orbit that may come again."""

    @abstractmethod
    def state_error(self, x: Array, p: Array, residual: float) -> float:
        """Estimate of the largest error of a section coordinate: see `ImpactOrbit.error`."""

    @final
    def states_moved(self, x: Array, p: Array, moved: Array) -> float:
        """Largest change of a section coordinate, where unknowns are off by as much, (m,)."""
        states, scale, worst = self.at(x, p).section_states, self.scale(x), 0.0
        if not np.isfinite(moved).all():
            return math.inf
        for k in np.flatnonzero(moved):
            h = 1e-6 * scale[k]
            there = x.copy()
            there[k] += h
            change = self.oscillator.difference(self.at(there, p).section_states, states)
            worst += float(abs(change).max() / h * moved[k])
        return worst

    @final
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

    def repeats(self, x: Array, within: float) -> bool:
        """Whether it is an orbit of a part of its period, run through several times."""
        return any(abs(changes).max() < within for _, _, changes in self._repetitions(x))

    def repetition(self, x: Array) -> float:
        parts = [changes for _, _, changes in self._repetitions(x)]
        return min((float(np.sqrt(np.mean(part**2))) for part in parts), default=np.inf)

    def _repetitions(self, x: Array) -> Iterator[tuple[int, int, Array]]:
        """Items of the itinerary, and periods, after which it may come again; changes until then.

        Those of the phases, and in their units those of what else is known of each item.
        """
        count, m = self.parts, self.periods
        for k in proper_divisors(count):
            if m % (count // k) == 0 and self._may_repeat(k):
                phases, others = self._marked(x)
                periods = m // (count // k)
                later = np.append(phases[k:], phases[:k] + TWO_PI * m) - TWO_PI * periods
                changes = (np.roll(others, -k, axis=0) - others).ravel()
                yield k, periods, np.concatenate([later - phases, changes])

    @abstractmethod
    def _may_repeat(self, k: int) -> bool:
        """Whether the itinerary may come again after `k` of its items."""

    @abstractmethod
    def _marked(self, x: Array) -> tuple[Array, Array]:
        """Phases (count,) of the items of the itinerary, and other marks of theirs (count, j)."""

    def _shorter(self, k: int, periods: int) -> Self:
        """The equations of the first `k` items of the itinerary."""
        return self.remade(periods=periods, itinerary=self.itinerary[:k])

    @abstractmethod
    def _part(self, x: Array, k: int) -> Array:
        """Unknowns of the first `k` items of the itinerary."""

    @abstractmethod
    def in_turn(self, x: Array) -> tuple[Self, Array]:
        """The same solution in the form in which searches return it."""

    @abstractmethod
    def proper(self, x: Array) -> bool:
        """Whether a solution is an orbit of its kind, no impact too slow to count as one."""

    # --- what is watched --------------------------------------------------------------------------

    @final
    def events(self, x: Array, p: Array) -> list[Event]:
        solution = self.at(x, p)
        if self._watched is None or self._watched[0] is not solution:
            both = [(border, border.value(solution)) for border in self.borders(solution)]
            found = [Event(border.kind, border.part, value, border.ends) for border, value in both]
            self._watched = solution, found
        return list(self._watched[1])

    @final
    def condition(self, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
        border = self.border(event, x, p)
        return border, border.begin(self.at(x, p))

    @final
    def border(self, event: int, x: Array, p: Array) -> Border:
        """What event number `event` watches."""
        return self.borders(self.at(x, p))[event]

    @abstractmethod
    def borders(self, solution: Any) -> list[Border]:
        """All that is watched."""

    def touching(self, event: int, x: Array, own: Array, p: Array) -> Mapping[str, float]:
        """Return phase in [0, 2 pi), time from the first state, and side."""
        solution = self.at(x, p)
        at, side = self.border(event, x, p).place(solution, own)
        turns = (at - float(solution.phases[0])) % (TWO_PI * self.periods)
        return {"phase": at % TWO_PI, "time": turns / solution.frequency, "side": float(side)}

    @final
    def neighbours(self, event: int, x: Array, p: Array) -> list[tuple[Problem, Array, Array]]:
        """Return the same motion as an orbit of one impact more or fewer.

        Where the gap touches, an impact without impulse is added; where an impulse vanishes it is
        left out. Both are solutions, to rounding.
        """
        found = self.border(event, x, p).neighbour(x, p)
        return [] if found is None else [(*found, p)]

    @abstractmethod
    def units(self, solution: Any) -> tuple[float, float, float]:
        """What gaps, their rates and their accelerations are measured in."""

    @abstractmethod
    def without_impact(self, x: Array, p: Array, i: int) -> tuple[Self, Array] | None:
        """The same motion without impact number `i`; None where it cannot be left out."""
