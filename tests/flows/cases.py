"""Flows, sections and references that the tests of flows share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np

from dynkit.sections import PoincareSection
from dynkit.systems import Duffing, IntegratedFlow, Lorenz, Rossler
from dynkit.validation import Array, finite_array

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


def lorenz_in_many_digits(flow: Lorenz) -> Callable[[Any, Any], list[Any]]:
    sigma, rho, beta = map(mpmath.mpf, (flow.sigma, flow.rho, flow.beta))
    return lambda _, s: [
        sigma * (s[1] - s[0]),
        s[0] * (rho - s[2]) - s[1],
        s[0] * s[1] - beta * s[2],
    ]


def rossler_in_many_digits(flow: Rossler) -> Callable[[Any, Any], list[Any]]:
    a, b, c = map(mpmath.mpf, (flow.a, flow.b, flow.c))
    return lambda _, s: [-s[1] - s[2], s[0] + a * s[1], b + s[2] * (s[0] - c)]


def duffing_in_many_digits(flow: Duffing) -> Callable[[Any, Any], list[Any]]:
    names = ("damping", "stiffness", "cubic", "force", "frequency")
    damping, stiffness, cubic, force, frequency = (mpmath.mpf(getattr(flow, n)) for n in names)
    return lambda _, s: [
        s[1],
        force * mpmath.cos(s[2]) - damping * s[1] - stiffness * s[0] - cubic * s[0] ** 3,
        frequency,
    ]


def in_many_digits(flow: IntegratedFlow) -> Callable[[Any, Any], list[Any]]:
    """The velocity, written out a second time, in mpmath's numbers."""
    if isinstance(flow, Lorenz):
        return lorenz_in_many_digits(flow)
    if isinstance(flow, Rossler):
        return rossler_in_many_digits(flow)
    assert isinstance(flow, Duffing)
    return duffing_in_many_digits(flow)


def path_in_many_digits(flow: IntegratedFlow, state: list[Any]) -> Callable[[Any], list[Any]]:
    """By mpmath's Taylor series, to a tolerance of 1e-25; to be used at 30 digits."""
    start = [mpmath.mpf(x) for x in state]
    path = mpmath.odefun(in_many_digits(flow), 0, start, tol=mpmath.mpf(10) ** -25)
    return lambda time: list(path(mpmath.mpf(time)))


def advanced_in_many_digits(flow: IntegratedFlow, state: list[Any], duration: Any) -> list[Any]:
    """By mpmath's Taylor series, at 30 digits."""
    with mpmath.workdps(30):
        return path_in_many_digits(flow, state)(duration)
