"""Families of one-humped maps whose orbits double their periods without end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from random import Random

import numpy as np

from dynkit import Bifurcation, Branch, Map, continue_orbit, periodic_orbit
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.map import Map as MapBase
from dynkit.orbits.problem import PeriodicOrbit


@dataclass(frozen=True)
class Hump(MapBase):
    """x' = p w(x) (1 + c t + d t^2), w = x (1 - x), t = 2 x - 1: one hump on [0, 1].

    For c = d = 0 it is the logistic map.
    """

    p: float
    c: float = 0.0
    d: float = 0.0

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        t = 2.0 * x - 1.0
        return np.asarray(self.p * x * (1.0 - x) * (1.0 + self.c * t + self.d * t * t))

    def jacobian(self, state: Array) -> Array:
        (x,) = finite_array("state", state, (1,))
        t = 2.0 * x - 1.0
        shape, slope = 1.0 + self.c * t + self.d * t * t, 2.0 * self.c + 4.0 * self.d * t
        return np.array([[self.p * ((1.0 - 2.0 * x) * shape + x * (1.0 - x) * slope)]])


@dataclass(frozen=True)
class Sine(MapBase):
    """x' = p sin(pi x)."""

    p: float

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        return np.asarray(self.p * np.sin(np.pi * finite_array("state", state, (1,))))

    def jacobian(self, state: Array) -> Array:
        (x,) = finite_array("state", state, (1,))
        return np.array([[np.pi * self.p * np.cos(np.pi * x)]])


def random_hump(number: int) -> Hump:
    """A hump so near to the logistic one that its Schwarzian derivative stays negative."""
    random = Random(number)
    return Hump(2.0, random.uniform(-0.2, 0.2), random.uniform(-0.1, 0.1))


def cascade(
    system: Map, guess: list[float], parameter: str, bounds: tuple[float, float], doublings: int
) -> Iterator[tuple[Branch, Bifurcation]]:
    """Branches of P(1), P(2), P(4), ..., each with its only PD."""
    orbit: PeriodicOrbit = periodic_orbit(system, guess)
    for _ in range(doublings):
        branch = continue_orbit(orbit, parameter, bounds=bounds)
        (doubling,) = (b for b in branch.bifurcations if b.kind == "PD")
        yield branch, doubling
        (orbit,) = doubling.switch()
