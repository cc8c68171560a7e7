"""Borders of a branch: gaps that touch, impulses that vanish, contact that begins."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.events import Condition, Event
from dynkit.orbits.kinds import BifurcationKind
from dynkit.systems.impact.orbits.flights import Flight
from dynkit.systems.impact.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.orbits.problem import ImpactProblem
    from dynkit.systems.impact.orbits.solution import Solution

SAME = 1e-6
"""In units of the period: how far a simulated impact may be from that of the orbit."""


def watched(solution: Solution) -> list[Event]:
    """Impulses, smallest gaps of the flights to each stop, then accelerations without rebound.

    Flights from or to an impact that pulls, and so begin or end beyond the stop, tell nothing. Nor
    do those that without rebound begin into the stop. With rebound accelerations do not matter.
    """
    dead = solution.terms.restitution == 0.0
    accelerations = solution.gaps(2) if dead else np.full(len(solution.sides), math.inf)
    pressed = accelerations < 0.0
    events = [
        Event(BifurcationKind.GR, i, float(impulse)) for i, impulse in enumerate(solution.impulses)
    ]
    for f in solution.flights:
        pulled = min(solution.impulses[f.start], solution.impulses[f.end]) < 0.0
        blind = pulled or pressed[f.start]
        events.append(Event(BifurcationKind.GR, f.start, math.nan if blind else f.smallest[0]))
    return events + [Event(BifurcationKind.CB, i, float(a)) for i, a in enumerate(accelerations)]


def flights_are_open(oscillator: Callable[[], ImpactMap], solution: Solution) -> bool:
    """Whether no impact is missing.

    Proved, but where a gap only nearly closes: there simulation from just after each impact tells.
    """
    if any(f.surely_closed for f in solution.flights):
        return False
    if all(f.surely_open for f in solution.flights):
        return True
    system = oscillator()
    for state, lasts in zip(section_states(system, solution), solution.lasts, strict=True):
        run = system._run(system.impact_state(state), 1, store=True)
        if run.impacts < 1 or len(run.contacts):
            return False
        if abs(float(run.time[0]) - lasts) > SAME * solution.period:
            return False
    return True


def section_states(oscillator: ImpactMap, solution: Solution) -> Array:
    """Section coordinates (n, 2N) just after the impacts; impulses that pull count as zero."""
    structure, t = oscillator._structure, solution.terms
    q = solution.states[..., solution.motion.mode.layout.modes]
    turn = np.exp(1j * solution.phases)[:, None]
    position = structure.free.positions(q) + (t.shape * turn).imag + t.still
    velocity = structure.free.velocities(q) + t.frequency * (t.shape * turn).real
    velocity += solution.motion.mode.forced.drift
    u = t.restitution / (1.0 + t.restitution) * np.maximum(solution.impulses, 0.0)
    u = np.where(solution.sides == 1, -u, u)
    others = structure.others
    parts = [position[:, others], velocity[:, others], u[:, None]]
    return np.concatenate([*parts, (solution.phases % TWO_PI)[:, None]], axis=1)


@final
class Vanishing(Condition):
    """An impulse is zero."""

    unknowns = 0

    def __init__(self, problem: ImpactProblem, i: int) -> None:
        self.problem, self.i = problem, i

    def residual(self, x: Array, own: Array, p: Array) -> Array:
        del own, p  # impulses are among the unknowns of the orbit
        place = len(self.problem.sides) + self.i
        return x[place : place + 1] / self.problem.speed


@final
class Touching(Condition):
    """The gap of a stop is zero and has its minimum, at a phase of its own."""

    unknowns = 1

    def __init__(self, problem: ImpactProblem, i: int, side: int) -> None:
        self.problem, self.i, self.side = problem, i, side

    def residual(self, x: Array, own: Array, p: Array) -> Array:
        s = self.problem.at(x, p)
        w = s.terms.frequency
        since = (own - s.phases[self.i]) / w
        gap, rate = Flight(s, self.i, self.side).gap(since, 2)[:, 0]
        return np.array([gap * w, rate]) / self.problem.speed


@final
class Pressing(Condition):
    """The acceleration of the gap is zero just after an impact without rebound.

    Rounding leaves in it what it leaves in the accelerations of the modes and of the table, which
    cancel; fast modes have the larger ones.
    """

    unknowns = 0

    def __init__(self, problem: ImpactProblem, i: int, solution: Solution) -> None:
        self.problem, self.i = problem, i
        self.rounding = float(solution.roundings(2)[i] / self._unit(solution))

    def residual(self, x: Array, own: Array, p: Array) -> Array:
        del own  # there are none
        s = self.problem.at(x, p)
        return s.gaps(2)[self.i : self.i + 1] / self._unit(s)

    def _unit(self, solution: Solution) -> float:
        return self.problem.speed * solution.terms.frequency


def condition_of(problem: ImpactProblem, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
    """What holds where an event of `watched` is zero, and a guess of its own unknowns."""
    s = problem.at(x, p)
    n, sides = len(s.sides), len(s.terms.signs)
    if event < n:
        return Vanishing(problem, event), np.empty(0)
    if event >= n + n * sides:
        return Pressing(problem, event - n - n * sides, s), np.empty(0)
    i, side = divmod(event - n, sides)
    _, since = s.flights[event - n].smallest
    return Touching(problem, i, side), np.array([s.phases[i] + s.terms.frequency * since])
