"""How often two errors of a correlation dimension cover the dimension of a known set.

Exact: 1 for the logistic map at 4 in any coordinates, d for products of d arcsines, whose densities
have square-root singularities; Cantor sets of similarity 1/3 with weights p and q have
-ln(p^2 + q^2) / ln 3. Of the Henon, Ikeda and Lorenz attractors published values are taken.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from dynkit.analysis import CorrelationDimension
from dynkit.analysis.dimension.scaling import Outcome
from dynkit.core.validation import Array
from dynkit.systems import Henon

CANTOR = float(np.log(2.0) / np.log(3.0))
UNEVEN = float(-np.log(0.7**2 + 0.3**2) / np.log(3.0))


def logistic(seed: int, n: int) -> Array:
    # x = sin^2(angle) doubles the angle; its binary digits come by chance, so none is lost
    digits = np.random.default_rng(seed).integers(0, 2, size=n + 52)
    turns = np.convolve(digits, 2.0 ** -np.arange(52.0, 0.0, -1.0), "valid")[:n]
    return np.sin(np.pi * turns[:, None]) ** 2


def sheared(seed: int, n: int) -> Array:
    orbit = logistic(seed, n + 1)[:, 0]
    return np.stack([orbit[1:] + 0.7 * orbit[:-1], orbit[:-1] + 0.4 * orbit[1:]], axis=1)


def broken(seed: int, n: int) -> Array:
    """The logistic map at 3.9, whose density has singularities at many points."""
    x, orbit = float(np.random.default_rng(seed).uniform(0.1, 0.9)), []
    for _ in range(n + 200):
        x = 3.9 * x * (1.0 - x)
        orbit.append(x)
    return np.array(orbit[200:])[:, None]


def delays(seed: int, n: int) -> Array:
    orbit = logistic(seed, n + 2)[:, 0]
    return np.stack([orbit[:-2], orbit[1:-1], orbit[2:]], axis=1)


def arcsines(seed: int, n: int) -> Array:
    return np.sin(2.0 * np.pi * np.random.default_rng(seed).uniform(size=(n, 2)))


def cusp(seed: int, n: int) -> Array:
    """A density |x|^-0.5 on both sides of zero."""
    chance = np.random.default_rng(seed).uniform(-1.0, 1.0, size=(n, 1))
    return np.asarray(np.sign(chance) * chance**2)


def henon(seed: int, n: int) -> Array:
    start = np.random.default_rng(seed).uniform(-0.1, 0.1, size=2)
    return Henon().iterate(start, n + 99)[100:]


def ikeda(seed: int, n: int) -> Array:
    z, states = complex(*np.random.default_rng(seed).uniform(-0.1, 0.1, size=2)), []
    for _ in range(n + 200):
        z = 1.0 + 0.9 * z * np.exp(1j * (0.4 - 6.0 / (1.0 + abs(z) ** 2)))
        states.append((z.real, z.imag))
    return np.array(states[200:])


def lorenz(seed: int, n: int) -> Array:
    """At times 0.2 apart, 100 states of each orbit."""
    orbits, kept = -(-n // 100), []
    states, step = np.random.default_rng(seed).normal(size=(3, orbits)), 0.02
    states[2] += 25.0

    def velocity(u: Array) -> Array:
        x, y, z = u
        return np.array([10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z])

    for i in range(10 * (100 + 100)):
        a = velocity(states)
        b = velocity(states + 0.5 * step * a)
        c = velocity(states + 0.5 * step * b)
        d = velocity(states + step * c)
        states = states + step / 6.0 * (a + 2.0 * (b + c) + d)
        if i >= 1000 and i % 10 == 0:
            kept.append(states)
    return np.array(kept).transpose(2, 0, 1).reshape(-1, 3)[:n].copy()


def cantor(seed: int, n: int) -> Array:
    return _cantor(seed, n, 1, 0.5)


def cantor_square(seed: int, n: int) -> Array:
    return _cantor(seed, n, 2, 0.5)


def cantor_by_arcsine(seed: int, n: int) -> Array:
    return np.hstack([cantor(seed, n), arcsines(seed + 1000, n)[:, :1]])


def uneven_cantor(seed: int, n: int) -> Array:
    return _cantor(seed, n, 1, 0.7)


def _cantor(seed: int, n: int, coordinates: int, chance: float) -> Array:
    digits = np.random.default_rng(seed).random((n, coordinates, 36)) > chance
    return np.asarray(digits @ (2.0 * 3.0 ** -np.arange(1.0, 37.0)))


def ring(seed: int, n: int) -> Array:
    return _torus(seed, n, 1)


def torus(seed: int, n: int) -> Array:
    return _torus(seed, n, 2)


def _torus(seed: int, n: int, turns: int) -> Array:
    angles = 2.0 * np.pi * np.random.default_rng(seed).uniform(size=(n, turns))
    return np.concatenate([np.cos(angles), np.sin(angles)], axis=1)


def uniform(coordinates: int) -> Callable[[int, int], Array]:
    return lambda seed, n: np.random.default_rng(seed).uniform(size=(n, coordinates))


def normal(coordinates: int) -> Callable[[int, int], Array]:
    return lambda seed, n: np.random.default_rng(seed).normal(size=(n, coordinates))


class Known(NamedTuple):
    """States of a set from a seed, so many that a region is found, and its dimension's range."""

    states: Callable[[int, int], Array]
    size: int
    least: float
    most: float


DRIFTING = {
    "logistic map at 4": Known(logistic, 1000, 1.0, 1.0),
    "logistic map at 4, sheared": Known(sheared, 1000, 1.0, 1.0),
    "logistic map at 4, three delays": Known(delays, 1000, 1.0, 1.0),
    "logistic map at 3.9": Known(broken, 1000, 1.0, 1.0),
    "Cantor set times an arcsine": Known(cantor_by_arcsine, 1000, 1.0 + CANTOR, 1.0 + CANTOR),
    "cusp": Known(cusp, 1000, 1.0, 1.0),
    "two arcsines": Known(arcsines, 1000, 2.0, 2.0),
}
"""Sets whose local slopes approach the dimension like 1 / ln(1/r)."""

WITH_PLATEAU = {
    # J. C. Sprott, G. Rowlands, Int. J. Bifurcation Chaos 11 (2001) 1865-1880: the Henon and the
    # Ikeda map; P. Grassberger, I. Procaccia, Phys. Rev. Lett. 50 (1983) 346-349: the Henon map
    "Henon map": Known(henon, 1000, 1.21, 1.22),
    # P. Grassberger, I. Procaccia, Physica D 9 (1983) 189-208: 2.05 +- 0.01
    "Lorenz attractor": Known(lorenz, 1000, 2.04, 2.07),
    "Ikeda map": Known(ikeda, 1000, 1.68, 1.72),
    "Cantor set": Known(cantor, 1000, CANTOR, CANTOR),
    "square of a Cantor set": Known(cantor_square, 4000, 2.0 * CANTOR, 2.0 * CANTOR),
    "uneven Cantor set": Known(uneven_cantor, 1000, UNEVEN, UNEVEN),
    "circle": Known(ring, 1000, 1.0, 1.0),
    "torus": Known(torus, 1000, 2.0, 2.0),
    "uniform line": Known(uniform(1), 1000, 1.0, 1.0),
    "uniform square": Known(uniform(2), 1000, 2.0, 2.0),
    "uniform cube": Known(uniform(3), 1000, 3.0, 3.0),
    "uniform noise, 4 coordinates": Known(uniform(4), 4000, 4.0, 4.0),
    "normal noise, 1 coordinate": Known(normal(1), 1000, 1.0, 1.0),
    "normal noise, 2 coordinates": Known(normal(2), 1000, 2.0, 2.0),
    "normal noise, 3 coordinates": Known(normal(3), 1000, 3.0, 3.0),
    "normal noise, 4 coordinates": Known(normal(4), 4000, 4.0, 4.0),
}


class Coverage(NamedTuple):
    """Runs, those that two errors cover, those without a plateau, and those without a region."""

    runs: int
    covered: int
    drifts: int
    none: int

    def __str__(self) -> str:
        return f"{self.runs} | {self.covered} | {self.drifts} | {self.none}"


@cache
def coverage(name: str, runs: int) -> Coverage:
    """Of seeds 0, 1, ..."""
    states, size, least, most = (DRIFTING | WITH_PLATEAU)[name]
    found = [CorrelationDimension(states(seed, size)) for seed in range(runs)]
    known = [each for each in found if each.region is not None]
    off = [max(least - each.value, each.value - most) - 2.0 * each.error for each in known]
    drifts = [each.outcome for each in found].count(Outcome.DRIFT)
    return Coverage(runs, int((np.array(off) <= 0.0).sum()), drifts, runs - len(known))
