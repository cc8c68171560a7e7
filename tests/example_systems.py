"""Small systems with closed forms, for the tests of the toolkit; others are in `dynkit.systems`."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynkit.core.no_motion import NoCrossing
from dynkit.core.validation import Array, finite_array, non_negative
from dynkit.dynamics.flow import Crossing, Flow
from dynkit.dynamics.map import Map
from dynkit.dynamics.section import PoincareSection
from dynkit.systems import Element, Regime, Watch
from dynkit.systems.symbolic.maps import SymbolicMap


@dataclass(frozen=True)
class Ricker(Map):
    """x exp(growth (1 - x / capacity)): multiplier 1 - growth at x = capacity, P(2) from 2 on."""

    growth: float
    capacity: float = 1.0

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        return np.asarray(x * np.exp(self.growth * (1.0 - x / self.capacity)))

    def jacobian(self, state: Array) -> Array:
        x = finite_array("state", state, (1,)) / self.capacity
        return np.diag(np.exp(self.growth * (1.0 - x)) * (1.0 - self.growth * x))


@dataclass(frozen=True)
class Cubic(Map):
    """(a x - x^3 + b y, x): symmetric; a pitchfork at a = 1 - b, where zero becomes unstable."""

    a: float
    b: float

    @property
    def dimension(self) -> int:
        return 2

    def __call__(self, state: Array) -> Array:
        x, y = finite_array("state", state, (2,))
        return np.array([self.a * x - x**3 + self.b * y, x])

    def jacobian(self, state: Array) -> Array:
        x, _ = finite_array("state", state, (2,))
        return np.array([[self.a - 3.0 * x**2, self.b], [1.0, 0.0]])


@dataclass(frozen=True)
class CircleRotation(Map):
    """An angle that grows by the same turn each time, and a coordinate that dies out."""

    turn: float

    @property
    def dimension(self) -> int:
        return 2

    def __call__(self, state: Array) -> Array:
        angle, other = finite_array("state", state, (2,))
        return np.array([(angle + self.turn) % (2.0 * np.pi), 0.5 * other])

    def jacobian(self, state: Array) -> Array:
        finite_array("state", state, (2,))
        return np.diag([1.0, 0.5])

    def difference(self, a: Array, b: Array) -> Array:
        gap = np.array(np.asarray(a) - np.asarray(b))
        gap[..., 0] -= 2.0 * np.pi * np.rint(gap[..., 0] / (2.0 * np.pi))
        return gap


@dataclass(frozen=True)
class DampedRotation(Flow):
    """x + i y turns at the frequency and dies out at the rate, as z does at its own."""

    frequency: float = 2.0
    damping: float = 0.1
    decay: float = 0.3

    @property
    def dimension(self) -> int:
        return 3

    @property
    def generator(self) -> Array:
        return np.array(
            [
                [-self.damping, -self.frequency, 0.0],
                [self.frequency, -self.damping, 0.0],
                [0.0, 0.0, -self.decay],
            ]
        )

    def velocity(self, state: Array) -> Array:
        return np.asarray(self.generator @ finite_array("state", state, (3,)))

    def derivative(self, state: Array, duration: float) -> Array:
        finite_array("state", state, (3,))
        time = non_negative("duration", duration)
        c, s = np.cos(self.frequency * time), np.sin(self.frequency * time)
        plane, axis = np.exp(-self.damping * time), np.exp(-self.decay * time)
        return np.array(
            [[plane * c, -plane * s, 0.0], [plane * s, plane * c, 0.0], [0.0, 0.0, axis]]
        )

    def advance(self, state: Array, duration: float) -> Array:
        return np.asarray(self.derivative(state, duration) @ state)

    def next_crossing(self, state: Array, section: PoincareSection, time_limit: float) -> Crossing:
        """By samples, 64 a turn, and bisection: enough for planes that are not nearly tangent."""
        start = finite_array("state", state, (3,))
        step = 2.0 * np.pi / self.frequency / 64.0
        time, before = 0.0, np.inf  # a start on the section is no crossing
        while time < time_limit:
            ahead = min(time + step, time_limit)
            after = section.direction * section.value(self.advance(start, ahead))
            if before < 0.0 <= after:
                hit = self._bisected(start, section, time, ahead)
                return Crossing(hit, self.advance(start, hit))
            time, before = ahead, after
        raise NoCrossing(f"no crossing within {time_limit}")

    def _bisected(self, start: Array, section: PoincareSection, low: float, high: float) -> float:
        for _ in range(60):
            middle = 0.5 * (low + high)
            if section.direction * section.value(self.advance(start, middle)) < 0.0:
                low = middle
            else:
                high = middle
        return high


class Sphere(PoincareSection):
    """The sphere of a given radius in three dimensions, in angles, away from the poles."""

    def __init__(self, radius: float, direction: int = 1) -> None:
        self.radius = radius
        self._direction = direction

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.radius}, {self._direction})"

    @property
    def dimension(self) -> int:
        return 3

    @property
    def direction(self) -> int:
        return self._direction

    def value(self, state: Array) -> float:
        return float(np.linalg.norm(finite_array("state", state, (3,)))) - self.radius

    def gradient(self, state: Array) -> Array:
        state = finite_array("state", state, (3,))
        return np.asarray(state / np.linalg.norm(state))

    def reduce(self, state: Array) -> Array:
        x, y, z = finite_array("state", state, (3,))
        return np.array([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])

    def lift(self, reduced: Array) -> Array:
        a, b = finite_array("reduced", reduced, (2,))
        direction = [np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)]
        return self.radius * np.array(direction)

    def reduce_derivative(self, state: Array) -> Array:
        x, y, z = finite_array("state", state, (3,))
        flat, whole = x * x + y * y, x * x + y * y + z * z
        rho = np.sqrt(flat)
        return np.array(
            [
                [-y / flat, x / flat, 0.0],
                [-x * z / (rho * whole), -y * z / (rho * whole), rho / whole],
            ]
        )

    def lift_derivative(self, reduced: Array) -> Array:
        a, b = finite_array("reduced", reduced, (2,))
        return self.radius * np.array(
            [
                [-np.sin(a) * np.cos(b), -np.cos(a) * np.sin(b)],
                [np.cos(a) * np.cos(b), -np.sin(a) * np.sin(b)],
                [0.0, np.cos(b)],
            ]
        )


@dataclass(frozen=True)
class ShiftedLogistic(SymbolicMap):
    """The logistic map in y = (x - offset) / size."""

    rate: float
    offset: float
    size: float

    def next_state(self, x: Any) -> tuple[Any, ...]:
        y = (x - self.offset) / self.size
        return (self.offset + self.size * self.rate * y * (1 - y),)


@dataclass(frozen=True)
class Spring(Element):
    """What a user writes: a spring that is touched."""

    stiffness: float = 7.0

    @property
    def regimes(self) -> tuple[Regime, ...]:
        touched = Watch(to=1, gap=1.0, order=1)
        let_go = Watch(to=0, gap=-self.stiffness, order=1)
        return Regime((touched,)), Regime((let_go,), stiffness=self.stiffness)
