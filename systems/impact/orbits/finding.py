"""Search for periodic orbits of impact oscillators."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.progress import late_bar
from dynkit.core.validation import Array, finite_array, positive_integer
from dynkit.orbits.newton import NoConvergence, correct
from dynkit.orbits.solving import FixedParameters, solve
from dynkit.systems.impact.orbits.itineraries.equations import APART, LEAST, ItineraryEquations
from dynkit.systems.impact.orbits.itineraries.guesses import (
    ascend,
    make_problem,
    one_impact,
    random_guesses,
    solvable,
    with_impulses,
)
from dynkit.systems.impact.orbits.itineraries.sticking import sticking_guess, sticking_guesses
from dynkit.systems.impact.orbits.orbit import NONE, ImpactOrbit
from dynkit.systems.impact.simulation.state import ImpactState

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.records.record import ImpactRecord


def find_orbits(
    oscillator: ImpactMap, impacts: object, periods: object, *, sticking: bool = False
) -> list[ImpactOrbit]:
    """Return all orbits that are found, the admissible ones first.

    Orbits P(n,m) are in the order of falling impulses. All P(1,m) are found, from the closed form.
    Those of more impacts are found from 200 guesses at random phases, the same in each call. Orbits
    P(inf,m) are in the order of rising phases; they are found from the releases of some motions.
    Where energies are not quadratic, only P(inf,m) are sought.

    Raises
    ------
    ValueError
        When nothing drives the oscillator.
    """
    m, began = positive_integer("periods", periods), time.perf_counter()
    guesses: Iterator[tuple[ItineraryEquations, Array]]
    if sticking:
        guesses = sticking_guesses(oscillator, m)
    else:
        n = positive_integer("impacts", impacts)
        solvable("impacts", n)
        guesses = one_impact(oscillator, m) if n == 1 else random_guesses(oscillator, n, m)
    found = Found()
    with found.bar:
        for problem, guess in guesses:
            if not found.holds(problem, guess, APART):
                found.add(problem, guess)
    return found.orbits(began)


@final
class Found:
    """Orbits that Newton's method found, without duplicates; `bar` counts guesses and motions."""

    def __init__(self) -> None:
        self.bar = late_bar("search", "step")
        self._solutions: list[tuple[ItineraryEquations, Array, tuple[float, ...]]] = []
        self._marks: dict[tuple[int, int], list[Array]] = {}

    def counted(self, motions: Iterator[ImpactRecord]) -> Iterator[ImpactRecord]:
        """Yield motions, and count each as a step of the progress bar."""
        for motion in motions:
            self.bar.update()
            yield motion

    def add(self, problem: ItineraryEquations, guess: Array) -> None:
        """Add the orbit that Newton's method finds from a guess, (m,), if it is new."""
        self.bar.update()
        result = correct(FixedParameters(problem, NONE), guess, problem.scale(guess), steps=30)
        if not result.converged:
            return
        periods = problem.periods
        problem, x = problem.in_turn(result.y)
        if problem.periods < periods or problem.repeats(x, APART):
            return
        mark = problem.canonical(x)
        marks = self._marks.setdefault((problem.parts, problem.periods), [])
        if all(_apart(mark, other) > APART for other in marks) and problem.proper(x):
            marks.append(mark)
            self._solutions.append((problem, x, result.history))

    def holds(self, problem: ItineraryEquations, x: Array, within: float) -> bool:
        """Whether an orbit found before is near unknowns (m,), perhaps run through repeatedly."""
        mark, n, m = problem.canonical(x), problem.parts, problem.periods
        return any(
            _apart(mark, other) <= within
            for k in range(1, math.gcd(n, m) + 1)
            if n % k == 0 and m % k == 0
            for other in self._marks.get((n // k, m // k), ())
        )

    def orbits(self, began: float) -> list[ImpactOrbit]:
        """Return the admissible ones first, then those of larger impulses or smaller phases."""
        cost = Cost(time.perf_counter() - began, {"orbits": len(self._solutions)})
        orbits = [ImpactOrbit(problem, x, history, cost) for problem, x, history in self._solutions]
        return sorted(orbits, key=_order)


def _apart(mark: Array, other: Array) -> float:
    """Largest difference of two orbits' marks; infinite if their numbers of marks differ."""
    return float(abs(mark - other).max()) if len(mark) == len(other) else math.inf


def _order(orbit: ImpactOrbit) -> tuple[bool, float]:
    last = orbit.phases[0] if orbit.sticks else -orbit.impulses.sum()
    return not orbit.admissible, float(last)


def _solved(problem: ItineraryEquations, guess: Array, began: float) -> ImpactOrbit:
    """Return the orbit that Newton's method finds from a guess, (m,)."""
    x, history = solve(problem, guess, NONE)
    cost = Cost(time.perf_counter() - began, {"steps": len(history) - 1})
    return ImpactOrbit(*problem.in_turn(x), history, cost)


def _has_table_alone(oscillator: ImpactMap) -> None:
    """Raise NotImplementedError unless a table is the only element and energies are quadratic."""
    if oscillator._table_alone:
        return
    other = oscillator._own or oscillator.elements
    got = repr(other[0]) if other else f"engine {oscillator.engine}"
    raise NotImplementedError(
        "orbits from phases are those of quadratic energies and a table of one coordinate, alone; "
        f"got {got}: find_orbits() searches, and periodic_orbit(start=...) and "
        "attractor.periodic_orbit() find those near a motion"
    )


def orbit_at(
    oscillator: ImpactMap,
    periods: object,
    phases: object,
    sides: object = None,
    impacts: object = None,
) -> ImpactOrbit:
    """Return the orbit that Newton's method finds from phases (n,) and sides (n,) of the impacts.

    Raises
    ------
    ValueError
        When the phases do not ascend within the periods, their number is not that of the impacts,
        or a side is not the number of a stop.
    NoConvergence
    """
    _has_table_alone(oscillator)
    m = positive_integer("periods", periods)
    given = finite_array("phases", phases, (None,))
    if impacts is not None and positive_integer("impacts", impacts) != len(given):
        raise ValueError(f"impacts must be the number of phases, {len(given)}; got {impacts}")
    solvable("phases", len(given))
    if not ascend(given, m):
        raise ValueError(
            f"phases must ascend and span less than {m} periods of 2 pi; got {given.tolist()}"
        )
    stops = len(oscillator._stops)
    at = finite_array("sides", np.zeros(len(given)) if sides is None else sides, (len(given),))
    if not np.isin(at, range(stops)).all():
        raise ValueError(f"sides must lie in [0, {stops - 1}]; got {at.tolist()}")
    began = time.perf_counter()
    problem = make_problem(oscillator, m, at)
    orbit = _solved(problem, with_impulses(problem, given), began)
    if (abs(orbit.impulses) <= LEAST * problem.sizes[1]).all():
        raise NoConvergence("no periodic orbit found from the guess, but one without impulses")
    return orbit


def orbit_of_motion(record: ImpactRecord, impacts: int, periods: int) -> ImpactOrbit:
    """Return the orbit near the first n impacts of a motion.

    Raises
    ------
    NoConvergence
        When the motion is too far from the orbit.
    ValueError
        When nothing drives the oscillator.
    """
    clock = record.system.frequency * (record.time - record.time[0])
    phases = record.phase[0] + clock[:impacts]
    if not ascend(phases, periods):
        raise NoConvergence(
            f"the motion is still too far from P({impacts},{periods}): its impacts are at phases "
            f"{phases.tolist()}"
        )
    return orbit_at(record.system, periods, phases, record._run.element[:impacts])


def sticking_orbit_of(system: ImpactMap, state: ImpactState, periods: int) -> ImpactOrbit:
    """Return the orbit P(inf,m) near the motion from a state.

    Raises
    ------
    NoConvergence
        When the motion is too far from the orbit.
    ValueError
        When no stop releases the motion, or no stop releases it again m periods later.
    """
    began = time.perf_counter()
    return _solved(*sticking_guess(system, state, periods), began)
