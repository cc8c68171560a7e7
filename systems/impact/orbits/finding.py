"""Search for periodic orbits of impact oscillators."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.validation import Array, finite_array, positive_integer, within_memory
from dynkit.orbits.newton import FixedParameters, NoConvergence, NoSolution, correct, solve
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.orbits.problem import ImpactProblem
from dynkit.systems.impact.orbits.responses import forced_motion
from dynkit.systems.impact.orbits.terms import Terms
from dynkit.systems.impact.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.record import ImpactRecord

STARTS = 200
"""Guesses of a search."""

APART = 1e-6
"""Two solutions that differ by less, scaled, are the same orbit."""

LEAST = 1e-13
"""Smaller impulses are rounding: at resonance those of all orbits are zero."""

_NONE = np.empty(0)


def find_orbits(oscillator: ImpactMap, impacts: object, periods: object) -> list[ImpactOrbit]:
    """All orbits that are found, the admissible ones first, then those of larger impulses.

    One impact: all there are, from the closed form. More: from `STARTS` guesses at random phases,
    always the same.
    """
    n, m = positive_integer("impacts", impacts), positive_integer("periods", periods)
    solvable("impacts", n)
    began = time.perf_counter()
    guesses = one_impact(oscillator, m) if n == 1 else random_guesses(oscillator, n, m)
    found = Found()
    for problem, guess in guesses:
        found.add(problem, guess)
    return found.orbits(began)


@final
class Found:
    """Orbits that Newton's method found, each once."""

    def __init__(self) -> None:
        self._solutions: list[tuple[ImpactProblem, Array, tuple[float, ...]]] = []
        self._marks: dict[tuple[int, int], list[Array]] = {}

    def add(self, problem: ImpactProblem, guess: Array) -> None:
        """Take the orbit that Newton's method finds from a guess, (2n,), if it is new."""
        result = correct(FixedParameters(problem, _NONE), guess, problem.scale(guess), steps=30)
        n = len(problem.sides)
        if not result.converged or (result.y[n : 2 * n] <= LEAST * problem.speed).any():
            return
        problem, x = ordered(problem, result.y)
        if coincide(problem, x) or repeats(problem, x):
            return
        mark = problem.canonical(x)
        marks = self._marks.setdefault((n, problem.periods), [])
        if all(abs(mark - other).max() > APART for other in marks):
            marks.append(mark)
            self._solutions.append((problem, x, result.history))

    def holds(self, problem: ImpactProblem, x: Array, within: float) -> bool:
        """Whether unknowns, (2n,), are so near those of an orbit, run through once or more."""
        mark, n, m = problem.canonical(x), len(problem.sides), problem.periods
        return any(
            abs(mark - other).max() <= within
            for k in range(1, math.gcd(n, m) + 1)
            if n % k == 0 and m % k == 0
            for other in self._marks.get((n // k, m // k), ())
        )

    def orbits(self, began: float) -> list[ImpactOrbit]:
        """Return the admissible ones first, then those of larger impulses."""
        cost = Cost(time.perf_counter() - began, {"orbits": len(self._solutions)})
        orbits = [ImpactOrbit(problem, x, history, cost) for problem, x, history in self._solutions]
        return sorted(orbits, key=lambda o: (not o.admissible, -float(o.impulses.sum())))


def orbit_at(
    oscillator: ImpactMap,
    periods: object,
    phases: object,
    sides: object = None,
    impacts: object = None,
) -> ImpactOrbit:
    """The orbit that Newton's method finds from phases (n,) and sides (n,) of the impacts.

    Raises
    ------
    ValueError
        When the phases are not ascending within the periods, or not as many as the impacts; or the
        sides not 0 or 1.
    NoConvergence
    """
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
    x, history = solve(problem, with_impulses(problem, given), _NONE)
    if (abs(x[len(given) : 2 * len(given)]) <= LEAST * problem.speed).all():
        raise NoConvergence("no periodic orbit found from the guess, but one without impulses")
    cost = Cost(time.perf_counter() - began, {"steps": len(history) - 1})
    return ImpactOrbit(*ordered(problem, x), history, cost)


def ascend(phases: Array, periods: int) -> bool:
    """Whether there are phases, (n,), that ascend and span less than so many periods."""
    late = np.ptp(phases) >= TWO_PI * periods if len(phases) else True
    return not late and bool((np.diff(phases) > 0.0).all())


def solvable(name: str, impacts: int) -> None:
    """Refuse more impacts than Newton's method has memory for: 2n equations, solved in place."""
    within_memory(name, impacts, 2.0 * 8.0 * (2.0 * impacts) ** 2)


def make_problem(oscillator: ImpactMap, periods: int, sides: Any) -> ImpactProblem:
    """The equations of P(n,m), n the number of sides.

    Raises
    ------
    ValueError
        When nothing drives the oscillator.
    """
    motion = forced_motion(oscillator._structure, oscillator._drive)
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
    return ImpactProblem(oscillator, (), periods, sides, speed)


def with_impulses(problem: ImpactProblem, phases: Array) -> Array:
    """The impulses that serve best at given phases: all equations are linear in them."""
    n = len(phases)
    start = np.append(phases, np.zeros(problem.size - n))
    matrix = problem.linearization(start, _NONE)[:, n:]
    impulses, *_ = np.linalg.lstsq(matrix, -problem.residual(start, _NONE), rcond=None)
    return np.concatenate([phases, impulses])


def ordered(problem: ImpactProblem, x: Array) -> tuple[ImpactProblem, Array]:
    """The same solution with its impacts in turn, from its first one in [0, 2 pi) on."""
    n, turn = len(problem.sides), TWO_PI * problem.periods
    late = turn * np.floor((x[:n] - x[0]) / turn)
    phases = x[:n] - late - TWO_PI * np.floor(x[0] / TWO_PI)
    order = np.argsort(phases)
    if (np.diff(order) < 0).any():
        problem = make_problem(problem.oscillator, problem.periods, problem.sides[order])
    return problem, np.concatenate([phases[order], x[n : 2 * n][order], x[2 * n :]])


def coincide(problem: ImpactProblem, x: Array) -> bool:
    """Whether two impacts are one, as without rebound an impulse of zero follows any impact."""
    n = len(problem.sides)
    ends = np.append(x[:n], x[0] + TWO_PI * problem.periods)
    return bool(np.diff(ends).min() < APART)


def repeats(problem: ImpactProblem, x: Array) -> bool:
    """Whether it is an orbit of fewer impacts, run through several times."""
    n, m = len(problem.sides), problem.periods
    for parts in range(2, n + 1):
        if n % parts or m % parts:
            continue
        step = n // parts
        phases = np.append(x[:n], x[:step] + TWO_PI * m)
        shifted = phases[step:] - x[:n] - TWO_PI * (m // parts)
        again = np.roll(x[n : 2 * n], -step) - x[n : 2 * n]
        same_sides = (np.roll(problem.sides, -step) == problem.sides).all()
        if same_sides and max(abs(shifted).max(), abs(again).max() / problem.speed) < APART:
            return True
    return False


def one_impact(oscillator: ImpactMap, periods: int) -> Iterator[tuple[ImpactProblem, Array]]:
    """Equations and solutions of all P(1,m), from their closed form."""
    for side, stop in enumerate(oscillator._stops):
        problem = make_problem(oscillator, periods, [side])
        found = _held if problem.size == 2 else _not_held
        for x in found(problem, float(stop.sign)):
            yield problem, x


def _held(problem: ImpactProblem, sign: float) -> Iterator[Array]:
    """Gap and its rate at the impact are one complex equation, quadratic in the impulse.

    With the steady gap Im(C exp(i phase)) + c and the periodic response G, G' just after a unit
    impulse, C exp(i phase) = J s / w - i (c + J G), where s = r / (1 + r) - G'.
    """
    s = problem.at(np.zeros(2), _NONE)
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


def _not_held(problem: ImpactProblem, sign: float) -> Iterator[Array]:
    """Where no spring holds one motion, and the structure returns wherever it is.

    The impulse is what the constant forces give in a period; the rate of the gap at the impact
    tells the phase, C exp(i phase) = v / w + i ..., and the gap where the structure is.
    """
    none = np.zeros(problem.size)
    matrix, left = problem.linearization(none, _NONE)[:, 1:], problem.residual(none, _NONE)
    others, *_ = np.linalg.lstsq(matrix[2:], -left[2:], rcond=None)
    _, sizes, directions = np.linalg.svd(matrix[2:])
    way, t = directions[-1], problem.at(none, _NONE).terms
    returns = abs(matrix[2:] @ others + left[2:]).max() < APART
    if not returns or sizes[-1] < APART * sizes[0] or abs(matrix[1] @ way) > APART:
        return
    cosine = -float(matrix[1] @ others) * problem.speed / (sign * t.frequency * abs(t.drive))
    if abs(cosine) > 1.0:
        return
    for angle in (math.acos(cosine), -math.acos(cosine)):
        phase = angle - float(np.angle(t.drive))
        x = np.append(phase, others)
        gap = float(problem.residual(x, _NONE)[0])
        yield np.append(phase, others - gap / float(matrix[0] @ way) * way)


def random_guesses(
    oscillator: ImpactMap, impacts: int, periods: int
) -> Iterator[tuple[ImpactProblem, Array]]:
    """Return equations and guesses (2n,) of P(n,m) from `STARTS` sets of random phases."""
    random = np.random.default_rng(0)
    stops = len(oscillator._stops)
    problems: dict[bytes, ImpactProblem] = {}
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


def orbit_of_motion(record: ImpactRecord, impacts: int, periods: int) -> ImpactOrbit:
    """The orbit near the first n impacts of a motion.

    Raises
    ------
    NoConvergence
        When the motion is too far from it.
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
