"""Search for orbits that have no closed form: from returns of simulated motions."""

from __future__ import annotations

import time
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoConvergence, NoSolution
from dynkit.systems.impact.orbits.finding import Found
from dynkit.systems.impact.orbits.itineraries.equations import APART, ItineraryEquations
from dynkit.systems.impact.orbits.itineraries.finding import guess_of
from dynkit.systems.impact.orbits.itineraries.itinerary import events_seen, of_period
from dynkit.systems.impact.orbits.itineraries.motions import STARTS, simulated_motions
from dynkit.systems.impact.orbits.itineraries.simulated import simulated
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.orbits.searching import from_returns, result_of
from dynkit.systems.impact.simulation.state import TWO_PI
from dynkit.systems.impact.simulation.trajectory import Ending

if TYPE_CHECKING:
    from dynkit.orbits.search import OrbitSearch
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.records.record import ImpactRecord

_SETTLED, _LATE = 40.0, 38.5
"""Periods for which a motion without further impacts is followed, and where one is taken."""


def search_returns(oscillator: ImpactMap, impacts: int, periods: int) -> OrbitSearch[ImpactOrbit]:
    """Orbits up to P(n,m), and what was searched: see `ImpactOscillator.find_orbits`.

    Raises
    ------
    ValueError
        When nothing drives the oscillator.
    """
    if not oscillator._excitation.turns:
        raise ValueError("system must be driven: amplitude and harmonic_forces are zero")
    began, found = time.perf_counter(), Found()
    with found.bar:
        parts = list(found.counted(simulated_motions(oscillator)))
        own = [[abs(x).max(initial=0.0) for x in (p.position, p.velocity)] for p in parts if len(p)]
        near = partial(near_return, sizes=np.max([*own, [0.0, 0.0]], axis=0).tolist())
        counts = {"starts": 1 + STARTS}
        counts |= from_returns(found, parts, range(1, impacts + 1), periods, near)
        for part in parts:
            if part.ending is not Ending.COUNT_REACHED and oscillator._stops:
                _add_quiet(found, part)
    return result_of(oscillator, found, parts, (impacts, periods), counts, began)


def _add_quiet(found: Found, record: ImpactRecord) -> None:
    """Try the orbit without impacts in one period that a motion without further ones comes near."""
    system, length = record.system, TWO_PI / record.system.frequency
    with suppress(NoMotion, NoConvergence, NoSolution, NotImplementedError):
        seen = of_period(simulated(system, record.final, _SETTLED * length), _LATE * length, length)
        problem, guess = guess_of(system, record.final, seen, 1, length)
        if not (problem.course.hits or found.holds(problem, guess, APART)):
            found.add(problem, guess)


def near_return(
    record: ImpactRecord, place: int, impacts: int, periods: int, sizes: list[float]
) -> tuple[ItineraryEquations, Array] | None:
    """Equations and unknowns of P(n,m) for some impacts; None where the motion sticks.

    Sizes are those of positions and velocities.

    Raises
    ------
    NoSolution
        When the motion is none that equations by itinerary know.
    """
    system: Any = record.system
    try:
        start = system.without_shift(record.states[place])
        run = system._run(system.impact_state(start), impacts, store=True)
        seen = events_seen(system, run)
        if any(event.chatters for event in seen.events) or run.impacts != impacts:
            return None
        length = periods * TWO_PI / system.frequency
        given = None if system._progression.shift.size else sizes
        return guess_of(system, run.start, seen, periods, length, given)
    except (NoMotion, NoConvergence) as refusal:
        raise NoSolution(str(refusal)) from refusal
