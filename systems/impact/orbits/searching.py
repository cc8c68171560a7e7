"""`ImpactOscillator.find_orbits`: periodic orbits that motions come near to."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from dynkit.continuation.initial_orbits import describe_counts
from dynkit.core.cost import Cost
from dynkit.core.validation import Array, positive_integer
from dynkit.labels.recurrence import Recurrences
from dynkit.orbits.newton import NoSolution
from dynkit.orbits.search import OrbitSearch
from dynkit.systems.impact.orbits.finding import Found
from dynkit.systems.impact.orbits.itineraries.equations import ItineraryEquations
from dynkit.systems.impact.orbits.itineraries.guesses import (
    STARTS,
    ascend,
    make_problem,
    one_impact,
    random_guesses,
    solvable,
    with_impulses,
)
from dynkit.systems.impact.orbits.itineraries.terms import drives_of
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.simulation.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.records.record import ImpactRecord

Guessed = Callable[["ImpactRecord", int, int, int], "tuple[ItineraryEquations, Array] | None"]
"""What makes equations and unknowns of a record, a place in it, and the impacts and periods."""

GUESSED = 3
"""Orbits of at most so many impacts are sought from random phases, too."""

# Random starts, as many as those of `find_orbits` for maps of many dimensions; the closest returns
# of each part and P(n,m): a second one, as the closest may be too bent a piece of the map.
RANDOM, RETURNS = 20, 2
# Impacts of a part of a motion of which the closest returns are tried, and parts of the motion from
# the default start: as it may be chaotic, it comes near to other orbits in each.
PART, PARTS = 300, 10


def search(oscillator: ImpactMap, impacts: object, periods: object) -> OrbitSearch[ImpactOrbit]:
    """Return orbits up to P(n,m), and what was searched: see `ImpactOscillator.find_orbits`."""
    began = time.perf_counter()
    n, m = positive_integer("impacts", impacts), positive_integer("periods", periods)
    solvable("impacts", n)
    found = Found()
    counts = {"guesses": 0, "starts": 0, "impacts": 0, "returns": 0}
    parts: list[ImpactRecord] = []
    with found.bar:
        for periods_of in range(1, m + 1):
            for problem, guess in one_impact(oscillator, periods_of):
                found.add(problem, guess)
        for impacts_of in range(2, min(n, GUESSED) + 1):
            for periods_of in range(1, m + 1):
                counts["guesses"] += STARTS
                for problem, guess in random_guesses(oscillator, impacts_of, periods_of):
                    found.add(problem, guess)
        if n > 1:
            parts = list(found.counted(_simulated(oscillator)))
            counts |= from_returns(found, parts, range(2, n + 1), m, _near) | {"starts": 1 + RANDOM}
    return result_of(oscillator, found, parts, (n, m), counts, began)


def result_of(
    oscillator: ImpactMap,
    found: Found,
    parts: list[ImpactRecord],
    most: tuple[int, int],
    counts: dict[str, int],
    began: float,
) -> OrbitSearch[ImpactOrbit]:
    """What a search up to P(n,m) has found, and in which region, that of some motions."""
    states = np.concatenate([np.empty((0, oscillator.dimension)), *(p.states for p in parts)])
    region = np.full((oscillator.dimension, 2), np.nan)
    if len(states):
        region = np.stack([states.min(axis=0), states.max(axis=0)], axis=1)
    orbits = sorted(found.orbits(began), key=lambda orbit: (orbit.impacts, orbit.periods))
    (n, m), cost = most, Cost(time.perf_counter() - began, counts)
    message = f"P(1,1) to P({n},{m}): {describe_counts(n, counts)}"
    return OrbitSearch(oscillator, n, 0, region, message, orbits, cost)


def _simulated(oscillator: ImpactMap) -> Iterator[ImpactRecord]:
    """Return the motion from the default start in parts, then those from random starts.

    These are just after an impact, with coordinates up to twice as large as the largest of the
    former motion and of the table's.
    """
    size = np.zeros(oscillator.dimension)
    state = oscillator.state()
    for _ in range(PARTS):
        record = oscillator.simulate(impacts=PART, start=state)
        state = record.final
        size = np.maximum(size, abs(record.states).max(axis=0, initial=0.0))
        yield record
    drive, places = float(abs(drives_of(oscillator)[0])), oscillator.degrees_of_freedom - 1
    size[:places] = np.maximum(size[:places], drive)
    size[places:-1] = np.maximum(size[places:-1], drive * oscillator.frequency)
    random = np.random.default_rng(0)
    for _ in range(RANDOM):
        start = 2.0 * size * random.uniform(-1.0, 1.0, len(size))
        start[-1] = random.uniform(0.0, TWO_PI)
        if len(oscillator._stops) == 1:
            start[-2] = abs(start[-2])
        yield oscillator.simulate(impacts=PART, start=oscillator.impact_state(start))


def from_returns(
    found: Found, parts: list[ImpactRecord], impacts: range, periods: int, guessed: Guessed
) -> dict[str, int]:
    """Try returns after each number of impacts; how many impacts and returns there were."""
    tried = [_add_returns(found, part, n, periods, guessed) for n in impacts for part in parts]
    return {"impacts": sum(map(len, parts)), "returns": sum(tried)}


def _add_returns(
    found: Found, record: ImpactRecord, impacts: int, periods: int, guessed: Guessed
) -> int:
    """Try the closest returns after so many impacts and up to so many periods; return how many.

    A return is not tried where an orbit that was found is nearer to it than it comes to itself.
    """
    n, system = impacts, record.system
    if len(record) <= n:
        return 0
    times = record.time * (system.frequency / TWO_PI)
    after = np.rint(times[n:] - times[:-n]).astype(np.intp)
    states = Recurrences(system.without_shift(record.states)[:, :-1], times, np.subtract)
    distances = states.distances(slice(n, None), slice(None, -n))
    tried: Counter[int] = Counter()
    for place in np.argsort(distances, kind="stable").tolist():
        # states that differ by more than the largest of them are not near
        m, distance = int(after[place]), float(distances[place])
        if not distance < 1.0:
            break
        beside = slice(max(place - 1, 0), place + 2)
        best = distances[beside][after[beside] == m].min()
        if m > periods or tried[m] == RETURNS or distance > best:
            continue
        try:
            near = guessed(record, place, n, m)
        except NoSolution:
            continue
        if near is not None and not found.holds(*near, distance):
            tried[m] += 1
            found.add(*near)
    return tried.total()


def _near(
    record: ImpactRecord, place: int, impacts: int, periods: int
) -> tuple[ItineraryEquations, Array] | None:
    """Return equations and unknowns of P(n,m) for some impacts; None where they take longer."""
    part = slice(place, place + impacts)
    phases = record.phase[place] + record.system.frequency * (
        record.time[part] - record.time[place]
    )
    if not ascend(phases, periods):
        return None
    problem = make_problem(record.system, periods, record._run.element[part])
    return problem, with_impulses(problem, phases)
