"""Guesses of orbits P(n,m): from phases, from the closed form of one impact, at random."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array, within_memory
from dynkit.systems.impact.modes.free_motion import free_motion
from dynkit.systems.impact.orbits.itineraries.equations import APART, ItineraryEquations
from dynkit.systems.impact.orbits.itineraries.happening import Happening
from dynkit.systems.impact.orbits.itineraries.itinerary import regimes_of
from dynkit.systems.impact.orbits.itineraries.one_mode.terms import drives_of
from dynkit.systems.impact.orbits.orbit import NONE
from dynkit.systems.impact.simulation.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

STARTS = 200
"""Number of random guesses of a search."""


def ascend(phases: Array, periods: int) -> bool:
    """Whether there are phases, (n,), and they ascend and span less than some periods."""
    late = np.ptp(phases) >= TWO_PI * periods if len(phases) else True
    return not late and bool((np.diff(phases) > 0.0).all())


def solvable(name: str, impacts: int) -> None:
    """Raise an error if the 2n equations of n impacts need more memory than there is."""
    within_memory(name, impacts, 2.0 * 8.0 * (2.0 * impacts) ** 2)


def make_problem(oscillator: ImpactMap, periods: int, sides: Any) -> ItineraryEquations:
    """Return the equations of P(n,m) whose impacts, in the free mode, are with stops `sides`, (n,).

    Raises
    ------
    ValueError
        When nothing drives the oscillator.
    """
    try:
        drives = drives_of(oscillator)
    except NoMotion as refusal:
        raise ValueError(f"system must have a steady response: {refusal}") from None
    w = oscillator.frequency
    speed = float(abs(drives[0])) * w
    if speed == 0.0:
        raise ValueError("system must be driven: amplitude and harmonic_forces are zero")
    lasts = 1.0 / w
    if len(free_motion(oscillator._contact).neutral):
        # impulses balance the momentum that constant forces give in the periods
        lasts = TWO_PI * periods / w
        constant = oscillator._excitation.constant
        pull = oscillator._contact.row @ np.linalg.solve(oscillator.mass, constant)
        speed += abs(float(pull)) * lasts
    free = regimes_of(oscillator, (0,) * len(oscillator._elements))
    itinerary = tuple(Happening(free, int(side), 0, free) for side in sides)
    return ItineraryEquations(oscillator, (), periods, itinerary, (speed * lasts, speed), True)


def with_impulses(problem: ItineraryEquations, phases: Array) -> Array:
    """Return unknowns with given phases; the others solve linear equations by least squares."""
    n = len(phases)
    start = np.append(phases, np.zeros(problem.size - n))
    matrix = problem.linearization(start, NONE)[:, n:]
    others, *_ = np.linalg.lstsq(matrix, -problem.residual(start, NONE), rcond=None)
    return np.concatenate([phases, others])


def one_impact(oscillator: ImpactMap, periods: int) -> Iterator[tuple[ItineraryEquations, Array]]:
    """Yield equations and solutions of all P(1,m), from their closed form.

    The equations are linear in all unknowns except the phase, and contain its sine and cosine. One
    combination of the equations contains the phase alone: a + b cos + c sin = 0. The others give
    the impulse and, where a motion has no restoring force, the state. If the equations leave one of
    these unknowns free, no orbit is isolated.
    """
    for side in range(len(oscillator._stops)):
        problem = make_problem(oscillator, periods, [side])
        none = np.zeros(problem.size - 1)
        matrix = problem.linearization(np.append(0.0, none), NONE)[:, 1:]
        left, sizes, _ = np.linalg.svd(matrix)
        if sizes[-1] < APART * sizes[0]:
            continue
        phases = np.array([0.0, math.pi, 0.5 * math.pi])
        rest = [problem.residual(np.append(phase, none), NONE) for phase in phases]
        zero, half, quarter = rest @ left[:, -1]
        mean, cosine = 0.5 * (zero + half), 0.5 * (zero - half)
        size, begin = math.hypot(cosine, quarter - mean), math.atan2(quarter - mean, cosine)
        for way in (1.0, -1.0) if 0.0 < size >= abs(mean) else ():
            x = np.append(begin + way * math.acos(-mean / size), none)
            x[1:], *_ = np.linalg.lstsq(matrix, -problem.residual(x, NONE), rcond=None)
            yield problem, x


def random_guesses(
    oscillator: ImpactMap, impacts: int, periods: int
) -> Iterator[tuple[ItineraryEquations, Array]]:
    """Yield equations and guesses (2n,) of P(n,m) from `STARTS` sets of random phases."""
    random = np.random.default_rng(0)
    stops = len(oscillator._stops)
    problems: dict[bytes, ItineraryEquations] = {}
    for _ in range(STARTS):
        phases = np.sort(random.uniform(0.0, TWO_PI * periods, impacts))
        sides = random.integers(0, stops, impacts)
        key = sides.tobytes()
        if key not in problems:
            problems[key] = make_problem(oscillator, periods, sides)
        try:
            yield problems[key], with_impulses(problems[key], phases)
        except NoMotion:
            continue
