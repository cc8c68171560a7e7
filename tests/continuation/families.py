"""Small families of orbits with known bifurcations, to be continued."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.validation import Array
from dynkit.dynamics.map import Map
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import Condition, Event, WatchedProblem
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.newton import NoSolution
from dynkit.orbits.problem import PeriodicOrbit, PeriodicProblem


class LinearMap(Map):
    """x' = A x."""

    def __call__(self, state: Array) -> Array:
        return self.jacobian(state) @ state


@dataclass(frozen=True)
class Rotation(LinearMap):
    """x' = y, y' = -d x + t y: NS of the origin at d = 1, with t = 2 cos(theta)."""

    d: float = 0.9
    t: float = 0.5
    dimension = 2

    def jacobian(self, state: Array) -> Array:
        return np.array([[0.0, 1.0], [-self.d, self.t]])

    def parameter_derivative(self, state: Array, name: str) -> Array:
        return np.array([0.0, -state[0] if name == "d" else state[1]])


@dataclass(frozen=True)
class Edge(LinearMap):
    """x' = y, y' = -(d + 1 - e) x + y / 2: NS of the origin at d = e; e is at most 1."""

    d: float = 0.9
    e: float = 1.0
    dimension = 2

    def jacobian(self, state: Array) -> Array:
        if self.e > 1.0:
            raise NoSolution("e must be at most 1")
        return np.array([[0.0, 1.0], [-(self.d + 1.0 - self.e), 0.5]])

    def parameter_derivative(self, state: Array, name: str) -> Array:
        return np.array([0.0, -state[0] if name == "d" else state[0]])


@dataclass(frozen=True)
class Exchange(LinearMap):
    """A `Rotation` and z' = (d - 2 - e) z: while the pair leaves, -1 is passed inwards at 1 + e."""

    d: float = 0.9
    e: float = 0.001
    dimension = 3

    def jacobian(self, state: Array) -> Array:
        last = self.d - 2.0 - self.e
        return np.array([[0.0, 1.0, 0.0], [-self.d, 0.5, 0.0], [0.0, 0.0, last]])

    def parameter_derivative(self, state: Array, name: str) -> Array:
        x, _, z = state
        return np.array([0.0, -x, z] if name == "d" else [0.0, 0.0, -z])


@dataclass(frozen=True)
class Flat(Map):
    """x' = x + f(x, p, q): fixed points are the zeros of f, a curve in the plane of x and p.

    ``circle``: f = -(x^2 + p^2 - q), closed, folds at p = ±sqrt(q). ``pitchfork``: f = (p - q) x -
    x^3. ``transcritical``: f = (p - q) x - x^2. ``cusp``: f = p + q x - x^3, folds at
    p^2 = 4 q^3 / 27. ``root``: f = p - sqrt(q - x), no solution for x > q. ``kink``: f = p - |x|.
    """

    shape: str = "circle"
    p: float = 0.0
    q: float = 1.0
    dimension = 1

    def parts(self, x: float) -> tuple[float, float, float, float]:
        """Return f and its derivatives by x, p and q."""
        p, q = self.p, self.q
        if self.shape == "circle":
            return -(x * x + p * p - q), -2.0 * x, -2.0 * p, 1.0
        if self.shape == "pitchfork":
            return (p - q) * x - x**3, p - q - 3.0 * x * x, x, -x
        if self.shape == "transcritical":
            return (p - q) * x - x * x, p - q - 2.0 * x, x, -x
        if self.shape == "cusp":
            return p + q * x - x**3, q - 3.0 * x * x, 1.0, x
        if self.shape == "root":
            if x > q:
                raise NoSolution("the square root is not defined")
            root = float(np.sqrt(q - x))
            return p - root, 0.5 / max(root, 1e-300), 1.0, -0.5 / max(root, 1e-300)
        return p - abs(x), -float(np.sign(x)), 1.0, 0.0

    def __call__(self, state: Array) -> Array:
        return state + self.parts(float(state[0]))[0]

    def jacobian(self, state: Array) -> Array:
        return np.array([[1.0 + self.parts(float(state[0]))[1]]])

    def parameter_derivative(self, state: Array, name: str) -> Array:
        return np.array([self.parts(float(state[0]))[2 if name == "p" else 3]])


@dataclass(frozen=True, eq=False)
class Cycle(PeriodicOrbit):
    """An orbit of a toy map; it grazes where its first coordinate comes down to the border."""

    map: Map
    x: Array
    past: tuple[float, ...] = ()
    border: float | None = None

    @property
    def system(self) -> Map:
        return self.map

    @property
    def label(self) -> str:
        return f"P({len(self.x) // self.map.dimension})"

    @property
    def states(self) -> Array:
        return self.x.reshape(-1, self.map.dimension)

    @property
    def multipliers(self) -> Any:
        product = np.eye(self.map.dimension)
        for state in self.states:
            product = self.map.jacobian(state) @ product
        values = np.linalg.eigvals(product).astype(complex)
        return values[np.argsort(-abs(values), kind="stable")]

    @property
    def admissible(self) -> bool:
        return self.border is None or bool(self.x[0] >= self.border)

    @property
    def history(self) -> tuple[float, ...]:
        return self.past

    @property
    def error(self) -> float:
        return 1e-12

    @property
    def cost(self) -> Cost:
        return Cost(0.0)

    def problem(self, *names: str) -> CycleProblem:
        return CycleProblem(self.map, len(self.x) // self.map.dimension, names, self.border)

    @property
    def unknowns(self) -> Array:
        return self.x

    def observable(self, name: str) -> Array:
        return self.states[:, int(name[6:-1])]


SIGHT = 0.01
"""From how far a border is seen."""


class AtBorder(Condition):
    """The first coordinate is at a border; the number of its own is twice the last one."""

    unknowns = 1

    def __init__(self, border: float) -> None:
        self._border = border

    def residual(self, x: Array, own: Array, p: Array) -> Array:
        return np.array([x[0] - self._border, own[0] - 2.0 * x[-1]])


@dataclass(frozen=True)
class CycleProblem(PeriodicProblem, WatchedProblem):
    """Orbits of a toy map of one period: all states are unknowns."""

    map: Map
    period: int
    free_names: tuple[str, ...]
    border: float | None = None

    @property
    def names(self) -> tuple[str, ...]:
        return self.free_names

    def free(self, *names: str) -> Self:
        return replace(self, free_names=names)

    @property
    def values(self) -> Array:
        return np.array([self.map.parameters[name] for name in self.free_names])

    @property
    def size(self) -> int:
        return self.period * self.map.dimension

    def scale(self, x: Array) -> Array:
        return np.ones(len(x))

    def _at(self, p: Array) -> Any:
        return self.map.replace(**dict(zip(self.free_names, map(float, p), strict=True)))

    def residual(self, x: Array, p: Array) -> Array:
        f = self._at(p)
        states = x.reshape(self.period, -1)
        after = np.array([f(state) for state in states])
        return np.asarray((after - np.roll(states, -1, axis=0)).ravel())

    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        f, d, n = self._at(p), self.map.dimension, self.period
        kind = float if np.imag(multiplier) == 0.0 else complex
        matrix = np.zeros((n * d, n * d), dtype=kind)
        for i, state in enumerate(x.reshape(n, d)):
            j = (i + 1) % n
            here, after = slice(i * d, i * d + d), slice(j * d, j * d + d)
            matrix[here, here] += f.jacobian(state)
            factor = multiplier if j == 0 else 1.0
            matrix[here, after] -= np.eye(d) * (factor if kind is complex else np.real(factor))
        return matrix

    def parameter_derivative(self, x: Array, p: Array) -> Array:
        f = self._at(p)
        states = x.reshape(self.period, -1)
        columns = [
            np.concatenate([f.parameter_derivative(s, name) for s in states])
            for name in self.free_names
        ]
        return np.column_stack(columns)

    def multipliers(self, x: Array, p: Array) -> Any:
        return Cycle(self._at(p), x).multipliers

    def orbit(self, x: Array, p: Array, history: Sequence[float] = ()) -> PeriodicOrbit:
        return Cycle(self._at(p), np.array(x), tuple(history), self.border)

    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        twice = replace(self, period=2 * self.period)
        return twice, np.tile(x, 2), np.concatenate([disturbance, -disturbance])

    def events(self, x: Array, p: Array) -> list[Event]:
        if self.border is None:
            return []
        value = float(x[0]) - self.border
        # from further off than that there is nothing to see
        return [Event(BifurcationKind.GR, 0, value if value < SIGHT else np.inf)]

    def condition(self, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
        assert self.border is not None
        return AtBorder(self.border), np.array([0.0])

    def admissible(self, x: Array, p: Array) -> bool:
        return self.border is None or bool(x[0] >= self.border)

    def touching(self, event: int, x: Array, own: Array, p: Array) -> dict[str, float]:
        return {"twice": float(own[0])}

    def neighbours(self, event: int, x: Array, p: Array) -> list[tuple[Problem, Array, Array]]:
        # the mirror image, if the family has one, from a guess that is a little off
        return [(self, -1.001 * x, -p)]

    def canonical(self, x: Array) -> Array:
        states = x.reshape(self.period, -1)
        return np.asarray(np.roll(states, -int(np.argmin(states[:, 0])), axis=0).ravel())


class PoleProblem(CycleProblem):
    """(1 - p) x = 0: a disturbance that returns multiplied by mu leaves (1 - mu p) x.

    The multiplier 1 / p changes its sign through infinity.
    """

    def residual(self, x: Array, p: Array) -> Array:
        return np.asarray((1.0 - p) * x)

    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        return np.array([[1.0 - np.real(multiplier) * p[0]]])

    def parameter_derivative(self, x: Array, p: Array) -> Array:
        return -x[:, None]

    def multipliers(self, x: Array, p: Array) -> Any:
        return np.array([1.0 / (p[0] or 1e-300)], dtype=complex)


class PoleOrbit(Cycle):
    """An orbit of `PoleProblem`."""

    def problem(self, *names: str) -> PoleProblem:
        return PoleProblem(self.map, 1, names)


VEIL, BEHIND = 0.3, 0.29


class VeiledProblem(CycleProblem):
    """A border at x = `BEHIND`, seen from x = `VEIL` down."""

    def events(self, x: Array, p: Array) -> list[Event]:
        return [Event(BifurcationKind.GR, 0, float(x[0]) - BEHIND if x[0] < VEIL else np.nan)]

    def condition(self, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
        return AtBorder(BEHIND), np.array([0.0])


class VeiledOrbit(Cycle):
    """An orbit of `VeiledProblem`."""

    def problem(self, *names: str) -> VeiledProblem:
        return VeiledProblem(self.map, 1, names)
