"""Derivatives by differences, of maps and of flows without a Jacobian, against many digits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import Any

import numpy as np
from flint import arb, ctx

from dynkit.core.stretching import Stretching
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.flow import Flow
from dynkit.systems import Henon, HighBounce, IntegratedFlow
from tests.maps.without_jacobian import without_jacobian
from tests.validation.flows import drawn, exact_states
from tests.validation.random_maps import BITS, derivative_of, image_of, random_polynomial

CASES = 3000
STEP, WEIGHTS = 1e-3, {1: 45.0 / 60.0, 2: -9.0 / 60.0, 3: 1.0 / 60.0}
"""Central differences of sixth order: they leave out about STEP^6, beside 19 digits of states."""


def of_maps(every: int) -> Iterator[tuple[float, float]]:
    """Largest error of an entry of the Jacobian over its largest entry, and the same claimed."""
    for number in range(0, CASES, every):
        system, state = _drawn_map(Random(number))
        (found,), (claimed,) = without_jacobian(system).jacobian_factors(state)
        with ctx.workprec(BITS):
            here = [arb(x) for x in state.tolist()]
            exact = derivative_of(partial(image_of, system, free={}), here).table()
            off = [
                [float(abs(arb(x) - y).mid()) for x, y in zip(*rows, strict=True)]
                for rows in zip(found.tolist(), exact, strict=True)
            ]
        size = float(abs(found).max())
        yield float(np.max(off)) / size, float(claimed) / size


def _drawn_map(random: Random) -> tuple[Any, Array]:
    kind = random.random()
    if kind < 0.2:
        system: Any = Henon(a=random.uniform(0.1, 1.4), b=random.uniform(-0.9, 0.9))
    elif kind < 0.4:
        system = HighBounce(restitution=random.random(), gamma=10.0 ** random.uniform(-2.0, 2.0))
    else:
        polynomial = random_polynomial(random)
        middle, size = polynomial.middle, polynomial.size
        return polynomial, middle + size * [random.gauss(0.0, 1.0) for _ in size]
    return system, np.array([random.gauss(0.0, 1.0) for _ in range(2)])


def of_velocities(every: int) -> Iterator[tuple[float, float]]:
    """Of logarithms of stretching along flows that give their velocity, and no derivative."""
    cases, found = [], []
    for number in range(0, CASES // 2, every):
        given = drawn(number)
        case, kind = given._replace(duration=0.25 * given.duration), type(given.flow)
        default = {"velocity_jacobian": IntegratedFlow.velocity_jacobian}
        plain: Any = type(kind.__name__, (kind,), default)(tolerance=given.flow.tolerance)
        cases.append(case)
        found.append(plain.stretching(case.start, case.duration, 1))
    around = [
        case._replace(start=case.start + np.longdouble(STEP * way * j) * column)
        for case in cases
        for column in np.eye(3)
        for j in WEIGHTS
        for way in (1.0, -1.0)
    ]
    moved = np.array(exact_states(around)).reshape(len(cases), 3, len(WEIGHTS), 2, 3)
    apart = (moved[:, :, :, 0] - moved[:, :, :, 1]).astype(float) / STEP
    exact = np.einsum("cktd,t->cdk", apart, list(WEIGHTS.values()))
    for claim, derivative in zip(found, exact, strict=True):
        yield from _logarithms(claim, derivative)


@dataclass(frozen=True)
class Swirl(Flow):
    """r' = r (1 - r^2), angle' = frequency + twist r^2; its states in closed form, and no more."""

    frequency: float
    twist: float
    dimension = 2
    accuracy = 2.0**-48
    """Roundings of an angle of ten."""

    def velocity(self, state: Array) -> Array:
        x, y = finite_array("state", state, (2,)).tolist()
        square = x * x + y * y
        turn = self.frequency + self.twist * square
        return np.array([x * (1.0 - square) - turn * y, y * (1.0 - square) + turn * x])

    def advance(self, state: Array, duration: float) -> Array:
        start = finite_array("state", state, (2,)).tolist()
        return np.array(self.end(start, duration, np))

    def end(self, start: list[Any], duration: Any, functions: Any) -> list[Any]:
        """The state a duration later, of numbers of any kind that have these functions."""
        x, y = start
        square = x * x + y * y
        shrunk = square + (1 - square) * functions.exp(-2 * duration)
        turn = (self.frequency + self.twist) * duration
        turn = turn + self.twist * functions.log(shrunk) / 2
        c, s = (wave(turn) / functions.sqrt(shrunk) for wave in (functions.cos, functions.sin))
        return [c * x - s * y, s * x + c * y]

    def next_crossing(self, state: Array, section: Any, time_limit: float) -> Any:
        raise NotImplementedError


def of_states(every: int) -> Iterator[tuple[float, float]]:
    """The same of flows that give their states alone."""
    for number in range(0, CASES // 2, every):
        random = Random(number)
        flow = Swirl(random.uniform(0.3, 3.0), random.uniform(-2.0, 2.0))
        start = [random.gauss(0.0, 1.0) for _ in range(2)]
        duration = random.uniform(0.05, 1.5)
        with ctx.workprec(BITS):
            end = partial(flow.end, duration=arb(duration), functions=arb)
            exact = derivative_of(end, [arb(x) for x in start]).table()
        claim = flow.stretching(np.array(start), duration, 1)
        yield from _logarithms(claim, np.array([[float(x.mid()) for x in row] for row in exact]))


def _logarithms(claim: Stretching, derivative: Array) -> Iterator[tuple[float, float]]:
    """Error of each logarithm that is resolved, and the same claimed."""
    lengths = abs(np.linalg.qr(derivative)[1].diagonal())
    off, known = abs(claim.logs[0] - np.log(lengths)), np.isfinite(claim.logs[0])
    yield from zip(off[known].tolist(), claim.errors[0, known].tolist(), strict=True)
