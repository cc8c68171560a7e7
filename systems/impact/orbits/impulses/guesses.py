"""Guesses of orbits P(n,m): from phases, from the closed form of one impact, at random."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array, within_memory
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.modes.impulse_responses import forced_motion
from dynkit.systems.impact.orbits.impulses.equations import ImpulseEquations
from dynkit.systems.impact.orbits.impulses.terms import Terms
from dynkit.systems.impact.orbits.orbit import NONE
from dynkit.systems.impact.orbits.problem import APART
from dynkit.systems.impact.simulation.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

STARTS = 200
"""Guesses of a search."""


def ascend(phases: Array, periods: int) -> bool:
    """Whether there are phases, (n,), that ascend and span less than so many periods."""
    late = np.ptp(phases) >= TWO_PI * periods if len(phases) else True
    return not late and bool((np.diff(phases) > 0.0).all())


def solvable(name: str, impacts: int) -> None:
    """Refuse more impacts than Newton's method has memory for: 2n equations, solved in place."""
    within_memory(name, impacts, 2.0 * 8.0 * (2.0 * impacts) ** 2)


def make_problem(oscillator: ImpactMap, periods: int, sides: Any) -> ImpulseEquations:
    """The equations of P(n,m), n the number of sides.

    Raises
    ------
    ValueError
        When nothing drives the oscillator.
    """
    motion = forced_motion(oscillator._contact, oscillator._excitation)
    try:
        terms = Terms.of(oscillator, motion)
    except NoSolution as refusal:
        raise ValueError(f"system must have a steady response: {refusal}") from None
    speed = abs(terms.drive) * terms.frequency
    if speed == 0.0:
        raise ValueError("system must be driven: amplitude and harmonic_forces are zero")
    if len(motion.neutral):  # an impact takes what the constant forces have given in a period
        pull = float(abs(motion.rows[2] @ motion.start(np.zeros(2 * len(motion.neutral))).ravel()))
        speed += pull * TWO_PI * periods / terms.frequency
    return ImpulseEquations(oscillator, (), periods, sides, speed)


def with_impulses(problem: ImpulseEquations, phases: Array) -> Array:
    """The other unknowns that serve best at given phases: all equations are linear in them."""
    n = len(phases)
    start = np.append(phases, np.zeros(problem.size - n))
    matrix = problem.linearization(start, NONE)[:, n:]
    others, *_ = np.linalg.lstsq(matrix, -problem.residual(start, NONE), rcond=None)
    return np.concatenate([phases, others])


def one_impact(oscillator: ImpactMap, periods: int) -> Iterator[tuple[ImpulseEquations, Array]]:
    """Equations and solutions of all P(1,m), from their closed form."""
    for side, stop in enumerate(oscillator._stops):
        problem = make_problem(oscillator, periods, [side])
        found = _held if problem.size == 2 else _not_held
        for x in found(problem, float(stop.sign)):
            yield problem, x


def _held(problem: ImpulseEquations, sign: float) -> Iterator[Array]:
    """Gap and its rate at the impact are one complex equation, quadratic in the impulse.

    With the steady gap Im(C exp(i phase)) + c and the periodic response G, G' just after a unit
    impulse, C exp(i phase) = J s / w - i (c + J G), where s = r / (1 + r) - G'.
    """
    s = problem.at(np.zeros(2), NONE)
    t = s.terms
    g, rate = s.responses[:2, 0, 0].tolist()
    slope = (t.restitution / (1.0 + t.restitution) - rate) / t.frequency
    middle = sign * (t.rest - float(t.places[problem.sides[0]]))
    square, linear = g * g + slope * slope, middle * g
    discriminant = linear * linear - square * (middle * middle - abs(t.drive) ** 2)
    if discriminant < 0.0:
        return
    for root in (1.0, -1.0):
        impulse = (root * discriminant**0.5 - linear) / square
        place = complex(impulse * slope, -(middle + impulse * g)) / (sign * t.drive)
        yield np.array([np.angle(place), impulse])


def _not_held(problem: ImpulseEquations, sign: float) -> Iterator[Array]:
    """Where no spring holds one motion: wherever that begins, the structure returns to its place.

    The equations of the return are linear in all but the phase; they give the impulse, and leave
    the place open. The rate of the gap at the impact then tells the cosine of the phase, and the
    gap the place. Where they leave more open, or nothing, no orbit is isolated.
    """
    none = np.zeros(problem.size)
    matrix, left = problem.linearization(none, NONE)[:, 1:], problem.residual(none, NONE)
    others, *_ = np.linalg.lstsq(matrix[2:], -left[2:], rcond=None)
    _, sizes, directions = np.linalg.svd(matrix[2:])
    way, t = directions[-1], problem.at(none, NONE).terms
    returns = abs(matrix[2:] @ others + left[2:]).max() < APART
    if not returns or sizes[-1] < APART * sizes[0] or abs(matrix[1] @ way) > APART:
        return
    cosine = -float(matrix[1] @ others) * problem.speed / (sign * t.frequency * abs(t.drive))
    if abs(cosine) > 1.0:
        return
    for angle in (math.acos(cosine), -math.acos(cosine)):
        phase = angle - float(np.angle(t.drive))
        x = np.append(phase, others)
        gap = float(problem.residual(x, NONE)[0])
        yield np.append(phase, others - gap / float(matrix[0] @ way) * way)


def random_guesses(
    oscillator: ImpactMap, impacts: int, periods: int
) -> Iterator[tuple[ImpulseEquations, Array]]:
    """Return equations and guesses (2n,) of P(n,m) from `STARTS` sets of random phases."""
    random = np.random.default_rng(0)
    stops = len(oscillator._stops)
    problems: dict[bytes, ImpulseEquations] = {}
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
