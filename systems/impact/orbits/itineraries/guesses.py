"""Guesses of orbits P(n,m): from phases, from the closed form of one impact, at random."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array, within_memory
from dynkit.orbits.newton import NoSolution
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
    except NoSolution as refusal:
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
    """Yield equations and solutions of all P(1,m), from their closed form."""
    for side in range(len(oscillator._stops)):
        problem = make_problem(oscillator, periods, [side])
        for x in _held(problem, side) if problem.responds else _not_held(problem):
            yield problem, x


def _held(problem: ItineraryEquations, side: int) -> Iterator[Array]:
    """Solutions P(1,m) where all motions have a restoring force.

    Gap and gap rate at the impact form one complex equation, which is quadratic in the impulse.

    With the steady gap Im(C exp(i phase)) + c and the periodic response G, G' just after a unit
    impulse, C exp(i phase) = J s / w - i (c + J G), where s = r / (1 + r) - G'.
    """
    s: Any = problem.at(np.zeros(2), NONE)
    r, drive, rest = s.terms.restitutions[side], s.terms.drives[side], s.terms.rests[side]
    g, rate = s.assembled.responses[:2, 0, 0].tolist()
    slope = (r / (1.0 + r) - rate) / s.terms.frequency
    square, linear = g * g + slope * slope, rest * g
    discriminant = float(linear * linear - square * (rest * rest - abs(drive) ** 2))
    if discriminant < 0.0:
        return
    for root in (1.0, -1.0):
        impulse = (root * discriminant**0.5 - linear) / square
        place = complex(impulse * slope, -(rest + impulse * g)) / drive
        yield np.array([np.angle(place), impulse])


def _not_held(problem: ItineraryEquations) -> Iterator[Array]:
    """Solutions P(1,m) where one motion has no restoring force.

    Then the position along this motion is free in the equations of the return. These are linear in
    all unknowns except the phase, and give the impulse and the rest of the state. The rate of the
    gap at the impact is a + b cos + c sin of the phase: this equation gives the phase. The gap
    gives the free position. If the equations leave more unknowns free, or none, no orbit is
    isolated.
    """
    none = np.zeros(problem.size)
    matrix = problem.linearization(none, NONE)[:, 1:]
    _, sizes, directions = np.linalg.svd(matrix[2:])
    way = directions[-1]
    if sizes[-1] < APART * sizes[0] or abs(matrix[1] @ way) > APART:
        return

    def returned(phase: float) -> tuple[Array, Array]:
        start = np.append(phase, none[1:])
        left = problem.residual(start, NONE)
        start[1:], *_ = np.linalg.lstsq(matrix[2:], -left[2:], rcond=None)
        return start, left + matrix @ start[1:]

    left = np.array([returned(phase)[1] for phase in (0.0, math.pi, 0.5 * math.pi)])
    (zero, half, quarter), returns = left[:, 1], abs(left[:, 2:]).max() < APART
    mean, cosine = 0.5 * (zero + half), 0.5 * (zero - half)
    size, begin = math.hypot(cosine, quarter - mean), math.atan2(quarter - mean, cosine)
    if not returns or abs(mean) > size:
        return
    for angle in (math.acos(-mean / size), -math.acos(-mean / size)):
        x, (gap, *_) = returned(begin + angle)
        x[1:] -= gap / float(matrix[0] @ way) * way
        yield x


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
        except NoSolution:
            continue
