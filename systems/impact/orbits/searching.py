"""`ImpactOscillator.find_orbits`: periodic orbits near close returns of simulated motions."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.continuation.initial_orbits import describe_counts
from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.labels.recurrence import Recurrences
from dynkit.orbits.newton import NoConvergence
from dynkit.orbits.search import OrbitSearch
from dynkit.systems.impact.orbits.finding import Found
from dynkit.systems.impact.orbits.itineraries.equations import APART, ItineraryEquations
from dynkit.systems.impact.orbits.itineraries.finding import anchored, guess_of
from dynkit.systems.impact.orbits.itineraries.guesses import (
    STARTS,
    ascend,
    make_problem,
    one_impact,
    random_guesses,
    solvable,
    with_impulses,
)
from dynkit.systems.impact.orbits.itineraries.itinerary import events_seen, has_law, of_period
from dynkit.systems.impact.orbits.itineraries.motions import FEW, MANY, simulated_motions
from dynkit.systems.impact.orbits.itineraries.one_mode.terms import drives_of
from dynkit.systems.impact.orbits.itineraries.simulated import simulated
from dynkit.systems.impact.orbits.orbit import NONE, ImpactOrbit
from dynkit.systems.impact.simulation.state import TWO_PI
from dynkit.systems.impact.simulation.trajectory import Ending

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.records.record import ImpactRecord

Guess = tuple[ItineraryEquations, Array, Array | None]
"""Equations, unknowns, and states before all events for `anchored`."""

Guessed = Callable[["ImpactRecord", int, Array, int, int], Guess | None]
"""What makes a guess of a record, a place in it, the state there, and impacts and periods."""

GUESSED = 3
"""Largest number of impacts of the orbits that are searched from random phases, too."""

# Number of closest returns tried for each part of a motion and each P(n,m). The second one serves
# where the map is too curved at the closest one for Newton's method.
_RETURNS = 2

_SETTLED, _LATE = 40.0, 38.5
"""Periods of simulation of a motion without further impacts, and end of the period that is used."""


def search(oscillator: ImpactMap, impacts: int, periods: int) -> OrbitSearch[ImpactOrbit]:
    """Return the orbits up to P(n,m) and the extent of the search.

    See `ImpactOscillator.find_orbits`.

    Raises
    ------
    ValueError
        When nothing drives the oscillator.
    """
    if not oscillator._excitation.turns:
        raise ValueError("system must be driven: amplitude and harmonic_forces are zero")
    began, found, alone = time.perf_counter(), Found(), oscillator._table_alone
    counts = {"guesses": 0, "starts": 0, "impacts": 0, "returns": 0} if alone else {}
    parts: list[ImpactRecord] = []
    first, effort = (2, MANY) if alone else (1, FEW)  # P(1,m) of a table has a closed form
    with found.bar:
        if alone:
            counts["guesses"] = _from_phases(found, oscillator, impacts, periods)
        if impacts >= first:
            parts = list(found.counted(simulated_motions(oscillator, effort)))
            sizes = None if oscillator._progression.shift.size else _sizes(parts)
            guessed = _near if alone else partial(_near_return, sizes=sizes)
            some = range(first, impacts + 1)
            tried = [_add_returns(found, p, n, periods, guessed) for n in some for p in parts]
            counts |= {"starts": 1 + effort.starts}
            counts |= {"impacts": sum(map(len, parts)), "returns": sum(tried)}
            if not alone and oscillator._motion is None:
                _add_beside_others(found, oscillator, periods, sizes)
        for part in () if alone else parts:
            if part.ending is not Ending.COUNT_REACHED and oscillator._stops:
                _add_quiet(found, part, sizes)
    states = np.concatenate([np.empty((0, oscillator.dimension)), *(p.states for p in parts)])
    region = np.full((oscillator.dimension, 2), np.nan)
    if len(states):
        region = np.stack([states.min(axis=0), states.max(axis=0)], axis=1)
    orbits = sorted(found.orbits(began), key=lambda orbit: (orbit.impacts, orbit.periods))
    cost = Cost(time.perf_counter() - began, counts)
    message = f"P(1,1) to P({impacts},{periods}): {describe_counts(impacts, counts)}"
    return OrbitSearch(oscillator, impacts, 0, region, message, orbits, cost)


def _from_phases(found: Found, oscillator: ImpactMap, impacts: int, periods: int) -> int:
    """Try the closed form of P(1,m), then random phases; return the number of random guesses."""
    solvable("impacts", impacts)
    guesses = 0
    for m in range(1, periods + 1):
        for problem, guess in one_impact(oscillator, m):
            found.add(problem, guess)
    for n in range(2, min(impacts, GUESSED) + 1):
        for m in range(1, periods + 1):
            guesses += STARTS
            for problem, guess in random_guesses(oscillator, n, m):
                found.add(problem, guess)
    return guesses


def _add_beside_others(
    found: Found, oscillator: ImpactMap, periods: int, sizes: list[float] | None
) -> None:
    """Try motions near the P(1,m) of each stop alone, which have a closed form."""
    for stop in oscillator._stops:
        alone = oscillator.replace(elements=[stop])
        try:
            driven = not has_law(alone) and bool(drives_of(alone)[0])
        except NoMotion:
            continue
        for m in range(1, periods + 1) if driven else ():
            for problem, x in one_impact(alone, m):
                _add_motion(found, oscillator, problem.orbit(x, NONE), sizes)


def _add_motion(
    found: Found, oscillator: ImpactMap, near: ImpactOrbit, sizes: list[float] | None
) -> None:
    """Try one period of the motion that starts half a period after the impact of an orbit."""
    half = 0.5 * near.period
    (x,), (v,) = near.sample([half])
    phase = float(near.phases[0]) + oscillator.frequency * half
    with suppress(NoMotion, NoConvergence, NotImplementedError):
        start = oscillator.state(x, v, phase % TWO_PI)
        seen = simulated(oscillator, start, near.period)
        hits = [event for event in seen.events if event.kicked]
        if hits and not any(event.chatters for event in hits):
            guess = guess_of(oscillator, start, seen, near.periods, near.period, sizes)
            _add_new(found, guess, APART)


def _sizes(parts: list[ImpactRecord]) -> list[float]:
    """Largest absolute position and velocity of some motions; 1 in place of zero."""
    own = [[abs(x).max(initial=0.0) for x in (p.position, p.velocity)] for p in parts if len(p)]
    ends = [[abs(p.final.position).max(), abs(p.final.velocity).max()] for p in parts]
    return [float(size) or 1.0 for size in np.max([*own, *ends, [0.0, 0.0]], axis=0)]


def _add_returns(
    found: Found, record: ImpactRecord, impacts: int, periods: int, guessed: Guessed
) -> int:
    """Try the closest returns after some impacts and at most some periods; return their number.

    A return is skipped if an orbit found before is at most as far from it as its own distance.
    """
    n, system = impacts, record.system
    if len(record) <= n:
        return 0
    times = record.time * (system.frequency / TWO_PI)
    after = np.rint(times[n:] - times[:-n]).astype(np.intp)
    section = record.states
    own = system.without_shift(section)
    parts = [
        own[:, kind] / (abs(own[:, kind]).max(initial=0.0) or 1.0) for kind in system._measured
    ]
    states = Recurrences(np.concatenate(parts, axis=1), times, np.subtract)
    distances = states.distances(slice(n, None), slice(None, -n))
    tried: Counter[int] = Counter()
    for place in np.argsort(distances, kind="stable").tolist():
        # a distance of one is the size of the largest state: no close return remains
        m, distance = int(after[place]), float(distances[place])
        if not distance < 1.0:
            break
        beside = slice(max(place - 1, 0), place + 2)
        best = distances[beside][after[beside] == m].min()
        if m > periods or tried[m] == _RETURNS or distance > best:
            continue
        try:
            near = guessed(record, place, section[place], n, m)
        except (NoMotion, NoConvergence):
            continue
        if near is not None:
            tried[m] += _add_new(found, near, distance)
    return tried.total()


def _add_new(found: Found, guess: Guess, within: float) -> bool:
    """Try a guess that is not so near an orbit that was found; whether it was tried.

    A guess without a linearization is not tried.
    """
    problem, x, states = guess
    if found.holds(problem, x, within):
        return False
    try:
        problem, x = anchored(problem, x, states)
    except (NoMotion, NoConvergence):
        return False
    found.add(problem, x)
    return True


def _near(
    record: ImpactRecord, place: int, state: Array, impacts: int, periods: int
) -> Guess | None:
    """Return a guess of P(n,m) for some impacts; None where they take longer."""
    part = slice(place, place + impacts)
    phases = state[-1] + record.system.frequency * (record.time[part] - record.time[place])
    if not ascend(phases, periods):
        return None
    problem = make_problem(record.system, periods, record._run.element[part])
    return problem, with_impulses(problem, phases), None


def _add_quiet(found: Found, record: ImpactRecord, sizes: list[float] | None) -> None:
    """Try the orbit without impacts, of one period, near the end of a motion without impacts."""
    system, length = record.system, TWO_PI / record.system.frequency
    with suppress(NoMotion, NoConvergence, NotImplementedError):
        seen = of_period(simulated(system, record.final, _SETTLED * length), _LATE * length, length)
        guess = guess_of(system, record.final, seen, 1, length, sizes)
        if not guess[0].course.hits:
            _add_new(found, guess, APART)


def _near_return(
    record: ImpactRecord,
    _: int,
    state: Array,
    impacts: int,
    periods: int,
    sizes: list[float] | None,
) -> Guess | None:
    """Return a guess of P(n,m) for some impacts; None where the motion sticks.

    `sizes` are those of positions and velocities: see `guess_of`.

    Raises
    ------
    NoMotion
        When the motion ends.
    NoConvergence
        When it has an event that equations by itinerary do not cover.
    """
    system: Any = record.system
    start = system.without_shift(state)
    run = system._run(system.impact_state(start), impacts, store=True)
    seen = events_seen(system, run)
    if any(event.chatters for event in seen.events) or run.impacts != impacts:
        return None
    length = periods * TWO_PI / system.frequency
    return guess_of(system, run.start, seen, periods, length, sizes)
