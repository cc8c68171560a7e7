"""The impact chain as a user of SciPy would write it: ``solve_ivp`` with a terminal event.

A peer for benchmarks, not a reference: an event function that is sampled once per step misses
grazing impacts. `missed_impacts` counts them against the impacts of a reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from time import perf_counter
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tests.reference.brute_force import chain_matrices

Array = NDArray[np.float64]
Method = Literal["RK45", "DOP853", "Radau", "LSODA"]


@dataclass(frozen=True)
class PeerRun:
    """What ``solve_ivp`` found.

    time, phase, relative_velocity : (k,)
    position, velocity : (k, N)
        Just after each impact found.
    seconds, evaluations
        Wall time of the whole run and calls of the right-hand side.
    completed
        Whether the asked number of impacts was reached within the time limit of each flight.
    """

    time: Array
    phase: Array
    relative_velocity: Array
    position: Array
    velocity: Array
    seconds: float
    evaluations: int
    completed: bool


def simulate(
    masses: Array,
    springs: Array,
    *,
    damping: float,
    restitution: float,
    amplitude: float,
    offset: float,
    frequency: float,
    position: Array,
    velocity: Array,
    impacts: int,
    method: Method = "DOP853",
    rtol: float = 1e-10,
    atol: float = 1e-12,
    flight_limit: float = 200.0,
) -> PeerRun:
    """Simulate from time and phase 0 until ``impacts`` impacts, one ``solve_ivp`` per flight."""
    mass, damper, stiffness = chain_matrices(masses, springs, damping)
    n = masses.size
    inverse = np.linalg.inv(mass)
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damper]])

    def right_hand_side(t: float, y: Array) -> Array:
        return matrix @ y

    def gap(t: float, y: Array) -> float:
        return float(y[n - 1]) - amplitude * sin(frequency * t) - offset

    event = _Event(gap)
    state, time = np.concatenate((position, velocity)), 0.0
    rows: list[tuple[float, float, Array]] = []
    evaluations = 0
    started = perf_counter()
    while len(rows) < impacts:
        solution = solve_ivp(
            right_hand_side,
            (time, time + flight_limit),
            state,
            method=method,
            events=event,
            rtol=rtol,
            atol=atol,
        )
        evaluations += solution.nfev
        if solution.status != 1:
            break
        time, state = float(solution.t[-1]), solution.y[:, -1].copy()
        table_velocity = amplitude * frequency * cos(frequency * time)
        u = -restitution * (float(state[-1]) - table_velocity)
        state[n - 1] = amplitude * sin(frequency * time) + offset
        state[-1] = table_velocity + u
        rows.append((time, u, state))
    seconds = perf_counter() - started
    times = np.array([row[0] for row in rows])
    states = np.array([row[2] for row in rows]).reshape(-1, 2 * n)
    return PeerRun(
        times,
        np.mod(frequency * times, 2.0 * pi),
        np.array([row[1] for row in rows]),
        states[:, :n],
        states[:, n:],
        seconds,
        evaluations,
        len(rows) == impacts,
    )


class _Gap(Protocol):
    def __call__(self, t: float, y: Array) -> float: ...


class _Event:
    """The gap, with the attributes ``solve_ivp`` looks for: a fall through zero ends it."""

    terminal = True
    direction = -1.0

    def __init__(self, gap: _Gap) -> None:
        self._gap = gap

    def __call__(self, t: float, y: Array) -> float:
        return self._gap(t, y)


def missed_impacts(found: Array, reference: Array, *, tolerance: float = 1e-4) -> int:
    """Number of reference times (k,) that have no found time within ``tolerance``."""
    if found.size == 0:
        return int(reference.size)
    nearest = np.abs(reference[:, None] - found[None, :]).min(axis=1)
    return int((nearest > tolerance).sum())
