"""Attractors and orbits of textbook maps against many digits and rational numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from random import Random
from typing import Any

import mpmath
import numpy as np
from mpmath import mp, mpf

from dynkit import MapAttractor, NoConvergence, periodic_orbit
from dynkit.core.no_motion import Diverged
from dynkit.core.validation import Array
from dynkit.orbits.map_orbit import MapOrbit
from dynkit.systems import Henon, HighBounce, Logistic

CASES, DIGITS = 3600, 70


def states_of_attractors(every: int) -> Iterator[tuple[float, float]]:
    """Largest distance of a kept state from the exact iterate of the same start."""
    for number in range(0, CASES, every):
        random = Random(number)
        system, start = _drawn(random)
        transient, count = random.choice((0, 1, 10, 60)), random.choice((1, 2, 10, 60))
        try:
            attractor = MapAttractor(system, np.array(start), transient, count)
        except Diverged:
            continue
        yield _largest_distance(attractor, start), attractor.error


def _drawn(random: Random) -> tuple[Any, list[float]]:
    kind = random.random()
    if kind < 0.4:
        return Logistic(rate=random.uniform(0.5, 4.0)), [random.random()]
    if kind < 0.8:
        system = Henon(a=random.uniform(0.1, 1.4), b=random.uniform(-0.3, 0.3))
        return system, [random.uniform(-0.3, 0.3), random.uniform(-0.1, 0.1)]
    ball = HighBounce(restitution=random.random(), gamma=random.uniform(0.0, 6.0))
    return ball, [random.uniform(0.0, 6.28), random.uniform(0.0, 10.0)]


def _largest_distance(attractor: MapAttractor, start: list[float]) -> float:
    with mp.workdps(DIGITS):
        step = _exact_step(attractor.system)
        state = [mpf(x) for x in start]
        for _ in range(attractor.transient):
            state = step(state)
        worst = 0.0
        for found in attractor.states.tolist():
            off = [mpf(x) - y for x, y in zip(found, state, strict=True)]
            if isinstance(attractor.system, HighBounce):
                off[0] -= 2 * mp.pi * mpmath.nint(off[0] / (2 * mp.pi))
            worst = max(worst, float(mpmath.norm(off)))
            state = step(state)
        return worst


def _exact_step(system: Any) -> Callable[[list[Any]], list[Any]]:
    if isinstance(system, Logistic):
        rate = mpf(system.rate)
        return lambda s: [rate * s[0] * (1 - s[0])]
    if isinstance(system, Henon):
        a, b = mpf(system.a), mpf(system.b)
        return lambda s: [1 - a * s[0] ** 2 + s[1], b * s[0]]
    r, gamma = mpf(system.restitution), mpf(system.gamma)

    def bounce(s: list[Any]) -> list[Any]:
        phase = (s[0] + s[1]) % (2 * mp.pi)
        return [phase, r * s[1] - gamma * mpmath.cos(phase)]

    return bounce


def states_of_orbits(every: int) -> Iterator[tuple[float, float]]:
    """Distance from the exact orbit: a step of Newton's method from exact residuals.

    What it leaves out is the square of the error.
    """
    for orbit in orbits_of_maps(every):
        system = orbit.system
        left = exact_residual(system, orbit.states)
        n, d = orbit.states.shape
        matrix = -np.roll(np.eye(n * d), d, axis=1)
        for i, state in enumerate(orbit.states):
            part = slice(i * d, i * d + d)
            matrix[part, part] += system.jacobian(state)
        yield float(abs(np.linalg.solve(matrix, left)).max()), orbit.error


def orbits_of_maps(every: int) -> Iterator[MapOrbit]:
    """Of the logistic map and of Henon's, of periods 1 to 8."""
    for number in range(0, CASES, every):
        random = Random(number)
        if random.random() < 0.5:
            system: Any = Logistic(rate=random.uniform(1.1, 4.0))
            guess = [random.random()]
        else:
            system = Henon(a=random.uniform(0.1, 1.4), b=random.uniform(-0.3, 0.3))
            guess = [random.uniform(-0.5, 1.0), random.uniform(-0.2, 0.2)]
        try:
            yield periodic_orbit(system, guess, period=random.choice((1, 1, 2, 3, 4, 5, 6, 8)))
        except (ValueError, NoConvergence):
            continue


def exact_residual(system: Any, states: Array) -> Array:
    """Images of states (n, d) less the next ones, (n d,), from rational numbers."""
    rows = [[Fraction(x) for x in state] for state in states.tolist()]
    out: list[Fraction] = []
    for now, later in zip(rows, [*rows[1:], rows[0]], strict=True):
        if isinstance(system, Logistic):
            image = [Fraction(system.rate) * now[0] * (1 - now[0])]
        else:
            image = [1 - Fraction(system.a) * now[0] ** 2 + now[1], Fraction(system.b) * now[0]]
        out += [a - b for a, b in zip(image, later, strict=True)]
    return np.array([float(x) for x in out])
