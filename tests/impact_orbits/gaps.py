"""Gaps of an orbit by dense samples of its motion: slow and obvious."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.orbit import ImpactOrbit

SAMPLES = 4000
"""Of a flight."""


def gap(orbit: ImpactOrbit, side: int, times: Array) -> Array:
    """Gap (k,) of a stop at times (k,) from the first impact."""
    system = orbit.system
    sign = 1.0 if system.side == "above" else -1.0
    phase = orbit.phases[0] + system.frequency * times
    stop = system.amplitude * np.sin(phase) + system.offset
    position = orbit.sample(times)[0][:, system.contact]
    if side == 0:
        return np.asarray(sign * (position - stop))
    return np.asarray(sign * (stop + sign * system.play - position))


@dataclass(frozen=True)
class Dip:
    """Smallest of the minima of a gap inside a flight, infinite without any, and its time."""

    value: float
    time: float


def stops(orbit: ImpactOrbit) -> int:
    return 2 if np.isfinite(orbit.system.play) else 1


def dip(orbit: ImpactOrbit, flight: int, side: int) -> Dip:
    """What dense samples tell of the gap of a stop after an impact."""
    begin, end = np.append(orbit.time, orbit.period)[flight : flight + 2].tolist()
    times = np.linspace(begin, end, SAMPLES + 1)[:-1]
    values = gap(orbit, side, times)
    inner = np.flatnonzero((values[1:-1] < values[:-2]) & (values[1:-1] <= values[2:])) + 1
    if not len(inner):
        return Dip(np.inf, np.nan)
    found = []
    for k in inner[np.argsort(values[inner])][:3]:
        best = minimize_scalar(
            lambda t: float(gap(orbit, side, np.array([t]))[0]),
            bounds=(times[k - 1], times[k + 1]),
            method="bounded",
            options={"xatol": 1e-9},
        )
        found.append((float(best.fun), float(best.x)))
    return Dip(*min(found))


def lowest(orbit: ImpactOrbit) -> float:
    """Smallest gap of all stops in all flights; 0 where it is smallest at the impacts."""
    dips = [dip(orbit, i, side).value for i in range(orbit.impacts) for side in range(stops(orbit))]
    return min(0.0, *dips) if min(dips) < 0.0 else 0.0
