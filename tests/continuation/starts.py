"""Orbits of the small families to start from."""

from __future__ import annotations

import numpy as np

from dynkit.dynamics.map import Map
from dynkit.systems import DelayedLogistic, Henon, Logistic
from tests.continuation.families import Cycle, Flat


def iterated(system: Map, state: list[float], period: int) -> Cycle:
    """Return the stable orbit that a state tends to."""
    start = system.iterate(np.array(state), 4000)[-1]
    return Cycle(system, system.iterate(start, period - 1).ravel())


def logistic(r: float = 2.5) -> Cycle:
    return Cycle(Logistic(r), np.array([1.0 - 1.0 / r]))


def henon(a: float = 0.1, b: float = 0.3) -> Cycle:
    x = (-(1.0 - b) + np.sqrt((1.0 - b) ** 2 + 4.0 * a)) / (2.0 * a)
    return Cycle(Henon(a, b), np.array([x, b * x]))


def delayed_logistic(r: float = 1.8) -> Cycle:
    return Cycle(DelayedLogistic(r), np.full(2, 1.0 - 1.0 / r))


def flat(shape: str, x: float, p: float, q: float = 0.0, border: float | None = None) -> Cycle:
    return Cycle(Flat(shape, p, q), np.array([x]), border=border)
