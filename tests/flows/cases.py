"""Flows, sections and references that the tests of flows share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import mpmath
import numpy as np
from flint import arb, arb_poly, arb_series, ctx

from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.section import PoincareSection
from dynkit.systems import IntegratedFlow
from tests.flows.integrated_flows import Duffing, Lorenz, Rossler

ROUNDING = 2.0**-52

FLOWS: dict[str, IntegratedFlow] = {
    "duffing": Duffing(),
    "lorenz": Lorenz(),
    "rossler": Rossler(),
}
STATES: dict[str, Array] = {
    "duffing": np.array([[0.5, 0.2, 0.1], [-1.1, 0.4, 2.0], [1.3, -0.6, 7.0]]),
    "lorenz": np.array([[1.0, 2.0, 20.0], [-8.0, -9.0, 25.0], [12.0, 17.0, 27.0]]),
    "rossler": np.array([[1.0, -5.0, 0.1], [-6.0, 3.0, 0.02], [7.0, -2.0, 1.5]]),
}


@dataclass(frozen=True, kw_only=True)
class Rotation(IntegratedFlow):
    """x + i y turns at the frequency, z dies out: all in closed form."""

    frequency: float = 1.0
    decay: float = 0.3

    @property
    def dimension(self) -> int:
        return 3

    def velocity(self, state: Array) -> Array:
        x, y, z = finite_array("state", state, (3,))
        return np.array([-self.frequency * y, self.frequency * x, -self.decay * z])

    def velocity_jacobian(self, state: Array) -> Array:
        finite_array("state", state, (3,))
        w = self.frequency
        return np.array([[0.0, -w, 0.0], [w, 0.0, 0.0], [0.0, 0.0, -self.decay]])


class Parabola(PoincareSection):
    """The surface on which one coordinate is a quadratic function of the first."""

    def __init__(self, place: int, height: float, bend: float, direction: int = 1) -> None:
        self.place, self.height, self.bend = place, height, bend
        self._direction = direction

    @property
    def dimension(self) -> int:
        return 3

    @property
    def direction(self) -> int:
        return self._direction

    def value(self, state: Array) -> float:
        state = finite_array("state", state, (3,))
        return float(state[self.place] - self.height - 0.5 * self.bend * state[0] ** 2)

    def gradient(self, state: Array) -> Array:
        state = finite_array("state", state, (3,))
        gradient = np.zeros(3)
        gradient[self.place] = 1.0
        gradient[0] = -self.bend * state[0]
        return gradient

    def reduce(self, state: Array) -> Array:
        return np.delete(finite_array("state", state, (3,)), self.place)

    def lift(self, reduced: Array) -> Array:
        reduced = finite_array("reduced", reduced, (2,))
        height = self.height + 0.5 * self.bend * reduced[0] ** 2
        return np.insert(reduced, self.place, height)

    def reduce_derivative(self, state: Array) -> Array:
        finite_array("state", state, (3,))
        return np.delete(np.eye(3), self.place, axis=0)

    def lift_derivative(self, reduced: Array) -> Array:
        reduced = finite_array("reduced", reduced, (2,))
        derivative = np.delete(np.eye(3), self.place, axis=1)
        derivative[self.place, 0] = self.bend * reduced[0]
        return derivative


# --- thirty digits --------------------------------------------------------------------------------

Many: TypeAlias = Any
"""A number, or a power series in time, of flint's ball arithmetic; or a number of mpmath."""

VelocityOf: TypeAlias = Callable[[list[Many]], list[Many]]

BITS, ORDER, TRUNCATION = 200, 40, 1e-32


def lorenz_in_many_digits(flow: Lorenz, number: Callable[[float], Many]) -> VelocityOf:
    sigma, rho, beta = map(number, (flow.sigma, flow.rho, flow.beta))
    return lambda s: [
        sigma * (s[1] - s[0]),
        s[0] * (rho - s[2]) - s[1],
        s[0] * s[1] - beta * s[2],
    ]


def rossler_in_many_digits(flow: Rossler, number: Callable[[float], Many]) -> VelocityOf:
    a, b, c = map(number, (flow.a, flow.b, flow.c))
    return lambda s: [-s[1] - s[2], s[0] + a * s[1], b + s[2] * (s[0] - c)]


def duffing_in_many_digits(flow: Duffing, number: Callable[[float], Many]) -> VelocityOf:
    names = ("damping", "stiffness", "cubic", "force", "frequency")
    damping, stiffness, cubic, force, frequency = (number(getattr(flow, n)) for n in names)
    return lambda s: [
        s[1],
        force * _cos(s[2]) - damping * s[1] - stiffness * s[0] - cubic * (s[0] * s[0] * s[0]),
        0 * s[2] + frequency,
    ]


def _cos(x: Many) -> Many:
    return x.cos() if isinstance(x, arb_series) else mpmath.cos(x)


def in_many_digits(flow: IntegratedFlow, number: Callable[[float], Many]) -> VelocityOf:
    """The velocity, written out a second time, in whatever numbers."""
    if isinstance(flow, Lorenz):
        return lorenz_in_many_digits(flow, number)
    if isinstance(flow, Rossler):
        return rossler_in_many_digits(flow, number)
    assert isinstance(flow, Duffing)
    return duffing_in_many_digits(flow, number)


def advanced_in_many_digits(flow: IntegratedFlow, state: list[Many], duration: Many) -> list[Many]:
    """By Taylor series of order 40, in steps whose last term is 1e-32, at sixty digits."""
    with ctx.workprec(BITS):
        return followed_in_many_digits(in_many_digits(flow, arb), state, duration)


def followed_in_many_digits(velocity: VelocityOf, state: list[Many], duration: Many) -> list[Many]:
    """The same of a velocity in flint's numbers."""
    with ctx.workprec(BITS):
        left, here = arb(duration), [arb(x) for x in state]
        while left > 0:
            paths = taylor(velocity, here)
            last = max(float(abs(path[ORDER])) for path in paths)
            step = arb((TRUNCATION / max(last, TRUNCATION)) ** (1.0 / ORDER))
            step = step if step < left else left
            # radii of balls grow in every step, also where the motion is stable
            here = [arb_poly(path.coeffs())(step).mid() for path in paths]
            left = left - step
        return here


def taylor(velocity: VelocityOf, start: list[Many]) -> list[Many]:
    """Taylor series of the motion, two coefficients at a time.

    If a path is known to order n, its velocity is right to order n, which gives coefficient n + 1.
    The Jacobian at the start, times that coefficient, corrects order n + 1 of the velocity.
    """
    size, cap = len(start), ctx.cap
    paths = [[x] for x in start]
    try:
        ctx.cap = 2
        ways = [[arb_series([x, i == j]) for j, x in enumerate(start)] for i in range(size)]
        slopes = [[rate[1] for rate in velocity(way)] for way in ways]
        for order in range(0, ORDER, 2):
            ctx.cap = order + 2
            rates = velocity([arb_series(path) for path in paths])
            first = [rate[order] / (order + 1) for rate in rates]
            for i, path in enumerate(paths):
                more = sum((slopes[j][i] * first[j] for j in range(size)), rates[i][order + 1])
                path += [first[i], more / (order + 2)]
        ctx.cap = ORDER + 1
        return [arb_series(path) for path in paths]
    finally:
        ctx.cap = cap


def advanced_by_mpmath(flow: IntegratedFlow, state: list[float], duration: float) -> list[float]:
    """The same by mpmath's own integrator, to a tolerance of 1e-25: sure, and dear."""
    with mpmath.workdps(30):
        velocity, start = in_many_digits(flow, mpmath.mpf), list(map(mpmath.mpf, state))
        path = mpmath.odefun(lambda _, s: velocity(s), 0, start, tol=mpmath.mpf(10) ** -25)
        return [float(x) for x in path(mpmath.mpf(duration))]
