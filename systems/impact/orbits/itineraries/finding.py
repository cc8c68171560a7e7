"""Orbits by itinerary, from motions near them."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoConvergence, solve
from dynkit.systems.impact.orbits.itineraries.equations import ItineraryEquations, simulated
from dynkit.systems.impact.orbits.itineraries.itinerary import (
    Happening,
    Seen,
    check_elements,
    events_seen,
    of_cycle,
    of_period,
    regimes_of,
)
from dynkit.systems.impact.orbits.orbit import NONE, ImpactOrbit
from dynkit.systems.impact.state import TWO_PI, ImpactState

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

_CYCLE = 256
"""Periods of the forcing, or impacts, within which a cycle that nothing drives comes again."""


def orbit_near(system: ImpactMap, state: ImpactState, periods: int) -> ImpactOrbit:
    """The orbit near the motion from a state, of so many periods of the forcing.

    Of a machine that nothing drives it is the cycle that the motion makes, whatever the periods.

    Raises
    ------
    NotImplementedError
        Where it chatters until it sticks, or what an element does is not known.
    NoConvergence
        When the motion is too far from an orbit, or the orbit is one of a family.
    """
    began = time.perf_counter()
    check_elements(system)
    driven = system._drive.turns
    if driven:
        length = periods * TWO_PI / system.frequency
        seen = of_period(simulated(system, state, 3.0 * length), 2.5 * length, length)
        begins = state.phase
    else:
        run = system._run(state, _CYCLE, store=True)
        seen, length = of_cycle(events_seen(system, run))
        periods, begins = 1, 0.0
    if not len(seen.events):
        seen, begins = _quiet(system, state), 0.0
    problem, guess = _guess(system, seen, periods, length, begins, driven)
    x, history = _solved(problem, guess)
    cost = Cost(time.perf_counter() - began, {"steps": len(history) - 1})
    return ImpactOrbit(*problem.in_turn(x), history, cost)


def _quiet(system: ImpactMap, state: ImpactState) -> Seen:
    """A motion in which nothing happens, where a period begins."""
    run = system._run(state, 2, store=True)
    numbers = run.regimes[run.segments.mode[-1]]
    final = run.final
    marked = Happening(regimes_of(system, numbers), -1, 0)
    states = np.concatenate([final.position, final.velocity])[None]
    return Seen(np.zeros(1), (marked,), states)


def _guess(
    system: ImpactMap, seen: Seen, periods: int, length: float, begins: float, driven: bool
) -> tuple[ItineraryEquations, Array]:
    """Equations with the itinerary of a motion, and its unknowns."""
    n = system.degrees_of_freedom
    sizes = [float(abs(part).max()) for part in np.split(seen.states, [n], axis=1)]
    sizes = [size or 1.0 for size in sizes]
    clock = system.frequency if driven else TWO_PI / length
    phases = begins + clock * seen.times
    if not driven:
        phases = phases - phases[0]
        phases[0] = length
    problem = ItineraryEquations(system, (), periods, seen.events, sizes, driven)
    impulses = _impulses(problem, seen)
    return problem, np.concatenate([phases, impulses, seen.states.ravel()])


def _impulses(problem: ItineraryEquations, seen: Seen) -> Array:
    """Those that the law gives."""
    k = problem.layout.impacts
    n = len(seen.events)
    x = np.concatenate([np.ones(n), np.zeros(k), seen.states.ravel()])
    phases = problem.oscillator.frequency * seen.times
    x[:n] = phases if problem.driven else np.append(1.0, phases[1:])
    s = problem.at(x, NONE)
    return -(s.rates * s.before[s.hits]).sum(axis=1) / (1.0 - s.returned)


def _solved(problem: ItineraryEquations, guess: Array) -> tuple[Array, tuple[float, ...]]:
    x, history = solve(problem, guess, NONE)
    s = problem.at(x, NONE)
    if s.events > 1 and not (abs(s.durations) > 0.0).all():
        raise NoConvergence("no periodic orbit found from the guess, but one whose events merge")
    return x, history
