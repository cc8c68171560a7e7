"""Borders of a branch: gaps that touch, impulses that vanish, contact that begins."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, final

import numpy as np

from dynkit.continuation.problem import Condition, Event
from dynkit.systems.impact.state import TWO_PI
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.problem import ImpactProblem
    from dynkit.systems.impact.orbits.solution import Solution
    from dynkit.systems.impact.oscillator import ImpactOscillator

LEAST, MOST = 24, 4096
"""Samples of the gap in a flight."""

SAME = 1e-6
"""In units of the period: how far a simulated impact may be from that of the orbit."""

_REFINEMENTS = 4


def watched(solution: Solution) -> list[Event]:
    """Impulses, smallest gaps of the flights to each stop, then accelerations without rebound."""
    n = len(solution.sides)
    events = [Event("GR", i, float(solution.impulses[i])) for i in range(n)]
    events += [
        Event("GR", i, smallest_gap(solution, i, side)[0])
        for i in range(n)
        for side in range(len(solution.terms.signs))
    ]
    if solution.terms.restitution == 0.0:
        events += [Event("CB", i, float(a)) for i, a in enumerate(solution.gaps(2))]
    return events


def flight(solution: Solution, i: int) -> float:
    """Time from an impact to the next."""
    ahead = (solution.phases - solution.phases[i]) % solution.turn
    ahead[i] = solution.turn
    return float(ahead.min()) / solution.terms.frequency


def gap_after(solution: Solution, i: int, side: int, times: Array, orders: int = 1) -> Array:
    """Gap (orders, k) of a stop at times (k,) after an impact, and its derivatives."""
    motion, t = solution.motion, solution.terms
    states = motion.after(solution.states()[i : i + 1], np.zeros(len(times), dtype=np.intp), times)
    free = motion.rows[:orders] @ states.reshape(len(times), -1).T
    sides = np.full(len(times), side)
    phases = solution.phases[i] + t.frequency * times
    steady = [t.frequency**k * t.gap(sides, phases, k) for k in range(orders)]
    return np.asarray(t.signs[side] * free + np.stack(steady))


def smallest_gap(solution: Solution, i: int, side: int) -> tuple[float, float]:
    """Smallest of the minima of the gap of a stop in the flight after an impact, and its time.

    Infinite where there is none but those at the impacts.
    """
    lasts = flight(solution, i)
    state = solution.states()[i].ravel()
    size = abs(solution.motion.rows[0] * state).sum() + abs(solution.terms.drive)
    bend = abs(solution.motion.rows[2] * state).sum()
    bend += solution.terms.frequency**2 * abs(solution.terms.drive)
    count = 2.0 * lasts * math.sqrt(bend / size) if size > 0.0 else 0.0
    times = np.linspace(0.0, lasts, int(min(max(count, LEAST), MOST)) + 1)
    gap = gap_after(solution, i, side, times)[0]
    inner = np.flatnonzero((gap[1:-1] < gap[:-2]) & (gap[1:-1] <= gap[2:])) + 1
    if not len(inner):
        return math.inf, math.nan
    at, step = times[inner], times[1]
    for _ in range(_REFINEMENTS):
        _, rate, bending = gap_after(solution, i, side, at, 3)
        move = np.where(bending > 0.0, -rate / np.where(bending > 0.0, bending, 1.0), 0.0)
        at = np.clip(at + np.clip(move, -step, step), times[inner - 1], times[inner + 1])
    values = gap_after(solution, i, side, at)[0]
    k = int(np.argmin(values))
    return float(values[k]), float(at[k])


def flights_are_open(oscillator: ImpactOscillator, solution: Solution) -> bool:
    """Whether simulation, from just after each impact, finds the next one in its place."""
    for i, state in enumerate(section_states(oscillator, solution)):
        run = oscillator._run(oscillator.impact_state(state), 1, store=True)
        if run.impacts < 1 or len(run.contacts):
            return False
        if abs(float(run.states[0, -1]) - flight(solution, i)) > SAME * solution.period:
            return False
    return True


def section_states(oscillator: ImpactOscillator, solution: Solution) -> Array:
    """Section coordinates (n, 2N) just after the impacts; impulses that pull count as zero."""
    structure, t = oscillator._structure, solution.terms
    q = solution.states()[..., solution.motion.regime.layout.modes]
    turn = np.exp(1j * solution.phases)[:, None]
    position = structure.free.positions(q) + (t.shape * turn).imag + t.still
    velocity = structure.free.velocities(q) + t.frequency * (t.shape * turn).real
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

    def residual(self, x: Array, own: Array, p: Array) -> Array:  # noqa: ARG002
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
        gap, rate = gap_after(s, self.i, self.side, since, 2)[:, 0]
        return np.array([gap * w, rate]) / self.problem.speed


@final
class Pressing(Condition):
    """The acceleration of the gap is zero just after an impact without rebound."""

    unknowns = 0

    def __init__(self, problem: ImpactProblem, i: int) -> None:
        self.problem, self.i = problem, i

    def residual(self, x: Array, own: Array, p: Array) -> Array:  # noqa: ARG002
        s = self.problem.at(x, p)
        return s.gaps(2)[self.i : self.i + 1] / (self.problem.speed * s.terms.frequency)


def condition_of(problem: ImpactProblem, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
    """What holds where an event of `watched` is zero, and a guess of its own unknowns."""
    s = problem.at(x, p)
    n, sides = len(s.sides), len(s.terms.signs)
    if event < n:
        return Vanishing(problem, event), np.empty(0)
    if event >= n + n * sides:
        return Pressing(problem, event - n - n * sides), np.empty(0)
    i, side = divmod(event - n, sides)
    _, since = smallest_gap(s, i, side)
    return Touching(problem, i, side), np.array([s.phases[i] + s.terms.frequency * since])
