"""The equations of periodic orbits of maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoMotion
from dynkit.core.smooth_map import SmoothMap, product_with_error, proper_divisors
from dynkit.core.validation import Array, returned
from dynkit.orbits.equations import NOISE
from dynkit.orbits.families import FamilyProblem
from dynkit.orbits.map_orbit import MapOrbit
from dynkit.orbits.multipliers import product_eigenvalues
from dynkit.orbits.newton import NoSolution
from dynkit.orbits.problem import PeriodicProblem
from dynkit.orbits.spectrum import Spectrum

TURN = 2.0 * np.pi

# States that differ by at most this, in the units of the equations, are equal.
_REPEATED = 1e-7

# For the test of a family: a derivative whose singular values have a ratio up to _SINGULAR may be
# singular; another solution is sought at the distance _BESIDE, in scaled unknowns, by at most
# _STEPS steps, and has a residual of at most _SOLVED.
_SINGULAR, _BESIDE, _STEPS, _SOLVED = 1e-6, 1e-3, 6, 1e-10

ROUNDINGS = 4.0
"""Error of the equations, and of derivatives, in units of the accuracy of a call."""


@final
class MapProblem(PeriodicProblem, FamilyProblem):
    """x_{i+1} = f(x_i), i modulo n: n d equations for the n states of a periodic orbit.

    The unknowns are the states, n d numbers, state by state.

    Parameters
    ----------
    system : Map
    states : (n, d) array
        States near the solutions. The units of the equations are their largest coordinates, and
        larger for a map with an accuracy above 1e-13, so that errors of calls remain at 1e-13.
    names : sequence of str
        The free parameters.

    Raises
    ------
    ValueError
        When the system has no such parameter.
    """

    _stored: ClassVar = ("_like",)
    _given: ClassVar = "_system"
    _system: SmoothMap
    _like: Array

    def __init__(self, system: SmoothMap, states: Array, names: Sequence[str] = ()) -> None:
        super().__init__(system, names)
        if system.conservative:
            self.stability = Spectrum.CONSERVATIVE
        self._like = states
        self._derivatives: tuple[bytes, Array, Array, tuple[Array, Array]]
        self._derivatives = b"", np.empty(0), np.empty(0), (np.empty(0), np.empty(0))

    def _restored(self) -> Self:
        if self._like.shape[1:] != (self._system.dimension,) or not len(self._like):
            raise ValueError(f"states of {self._system.dimension} numbers are {self._like.shape}")
        return type(self)(self._system, self._like)

    @cached_property
    def _sizes(self) -> Array:
        try:
            reach = self._system._reach(self._like)
        except NoMotion:
            reach = 0.0
        return np.asarray(np.maximum(sizes(self._like), 0.1 * reach))

    @cached_property
    def units(self) -> Array:
        """Units (d,) of the equations: sizes of the states, larger where calls are not exact."""
        return np.asarray(self._sizes * max(1.0, self._system.accuracy / NOISE))

    @property
    def label(self) -> str:
        return f"P({len(self._like)})"

    def free(self, *names: str) -> Self:
        return type(self)(self._system, self._like, names)

    @property
    def size(self) -> int:
        return self._like.size

    def scale(self, x: Array) -> Array:
        # at least the sizes of given states: a branch through the state zero keeps its step size
        return np.tile(np.maximum(sizes(self._rows(x)), self._sizes), len(self._like))

    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        n, d = self._like.shape
        by_state = self.jacobians(x, p) / self.units[:, None]
        by_next = np.broadcast_to(-np.diag(1.0 / self.units), by_state.shape)
        complex_needed = isinstance(multiplier, complex | np.complexfloating)
        matrix = np.zeros((n, d, n, d), dtype=complex if complex_needed else float)
        each = np.arange(n)
        matrix[each, :, each] = by_state
        returned = np.ones((n, 1, 1), dtype=matrix.dtype)
        returned[-1] = multiplier
        matrix[each, :, following(each)] += returned * by_next
        return matrix.reshape(n * d, n * d)

    def multipliers(self, x: Array, p: Array) -> Any:
        matrices = self.factors(x, p)[0]
        # a flow in the plane on a level of an integral has no multiplier: the level is one orbit
        return product_eigenvalues(matrices) if matrices.size else np.empty(0, dtype=complex)

    def orbit(self, x: Array, p: Array, history: Sequence[float] = ()) -> MapOrbit:
        past = history or (float(abs(self.residual(x, p)).max()),)
        fixed = type(self)(self.at(p), self._rows(x).copy())
        return MapOrbit(fixed, x, past, Cost(0.0, {"newton steps": len(past) - 1}))

    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        problem = type(self)(self._system, np.tile(self._like, (2, 1)), self._names)
        return problem, np.concatenate([x, x]), np.concatenate([disturbance, -disturbance])

    def shortest(self, x: Array) -> tuple[PeriodicProblem, Array]:
        for k in proper_divisors(len(self._like)):
            if (abs(self._changes_over(k, x)) <= _REPEATED * self.units).all():
                problem = type(self)(self._system, self._like[:k], self._names)
                return problem, self._rows(x)[:k].ravel()
        return self, x

    def repetition(self, x: Array) -> float:
        sizes = self.scale(x).reshape(self._like.shape)
        parts = [self._changes_over(k, x) / sizes for k in proper_divisors(len(self._like))]
        return min((float(np.sqrt(np.mean(part**2))) for part in parts), default=np.inf)

    def _changes_over(self, k: int, x: Array) -> Array:
        """Return the changes (n, d) of the states over k iterates."""
        states = self._rows(x)
        return np.asarray(self._system.difference(np.roll(states, -k, axis=0), states))

    def apart(self, x: Array, other: Array) -> Array:
        """Return differences (n d,) of the states, for the cyclic shift with the smallest ones."""
        n = len(self._like)
        turned = (np.arange(n)[:, None] + np.arange(n)) % n
        gaps = self._system.difference(self._rows(x)[turned], self._rows(other)) / self._sizes
        return np.asarray(gaps[np.argmin((gaps**2).sum(axis=(1, 2)))].ravel())

    def _rows(self, x: Array) -> Array:
        return np.asarray(x).reshape(self._like.shape)

    def residual(self, x: Array, p: Array) -> Array:
        system, states = self.at(p), self._rows(x)
        d = system.dimension
        found = _defined(lambda state: returned(system, system(state), d), states)
        gap = system.difference(found, following(states))
        return np.asarray((gap / self.units).ravel())

    def rounding(self, x: Array, p: Array) -> Array:
        """Return four times the errors of the calls, (n d,)."""
        wrong = ROUNDINGS * self.at(p).call_errors(self._rows(x))
        return np.asarray((wrong[:, None] / self.units).ravel())

    def linearization_error(self, x: Array, p: Array) -> Any:
        system = self.at(p)
        if not system._by_differences:
            return 0.0
        self.jacobians(x, p)
        n, d = self._like.shape
        matrix = np.zeros((n, d, n, d))
        each = np.arange(n)
        matrix[each, :, each] = self._derivatives[2][:, None, None] / self.units[:, None]
        return matrix.reshape(n * d, n * d)

    def parameter_derivative(self, x: Array, p: Array) -> Array:
        system, columns = self.at(p), []
        for name in self._names:
            by_name = partial(system.parameter_derivative, name=name)
            columns.append((_defined(by_name, self._rows(x)) / self.units).ravel())
        return np.stack(columns, axis=1) if columns else np.empty((self.size, 0))

    def factors(self, x: Array, p: Array) -> tuple[Array, Array]:
        system = self.at(p)
        if not system._framed:
            self.jacobians(x, p)
            return self._derivatives[3]
        rows = self._rows(x)
        known = [system.orbit_factors(*pair) for pair in zip(rows, following(rows), strict=True)]
        matrices, off = (np.concatenate(each) for each in zip(*known, strict=True))
        return matrices, ROUNDINGS * off

    def is_of_a_family(self, x: Array) -> bool:
        """Whether a solution without free parameters belongs to a curve of solutions.

        The derivative is then singular, and another solution lies beside it along the null vector.
        It is sought by the Gauss-Newton method. At a bifurcation there is no such solution. Where
        the map has no derivative the result is False.
        """
        none, scale = np.empty(0), self.scale(x)
        identity = float((scale / np.tile(self.units, len(self._like))).max())
        try:
            _, sizes, rows = np.linalg.svd(self.linearization(x, none) * scale)
            if sizes[-1] > _SINGULAR * max(float(sizes[0]), identity):
                return False
            y, row = x + _BESIDE * scale * rows[-1], identity * rows[-1]
            for _ in range(_STEPS):
                gap = self.residual(y, none)
                if abs(gap).max() <= _SOLVED:
                    return True
                matrix = np.vstack([self.linearization(y, none) * scale, row])
                y = y - scale * np.linalg.lstsq(matrix, np.append(gap, 0.0), rcond=None)[0]
        except (NoMotion, np.linalg.LinAlgError):
            pass
        return False

    def states(self, x: Array) -> Array:
        """Return the orbit's states (n, d); angles are those that the map returns."""
        states = self._rows(x).copy()
        turning = angles(self._system)
        if turning.any():
            arrived = np.array([self._system(state) for state in np.roll(states, 1, axis=0)])
            turns = np.rint((states - arrived) / TURN)
            states[:, turning] -= TURN * turns[:, turning]
        return states

    def jacobians(self, x: Array, p: Array) -> Array:
        """Return the map's derivatives, (n, d, d), at all states; read-only.

        Raises
        ------
        NoMotion
            Where a derivative does not exist.
        """
        key = np.asarray(x).tobytes() + np.asarray(p, dtype=np.float64).tobytes()
        if key != self._derivatives[0]:
            system, factors, errors = self.at(p), list[Array](), list[Array]()
            wrong = list[float]()

            def jacobian(state: Array) -> Array:
                matrices, off = system.jacobian_factors(state)
                factors.append(matrices)
                errors.append(ROUNDINGS * off)
                product, error = product_with_error(matrices, off)
                wrong.append(error)
                return product

            found = _defined(jacobian, self._rows(x))
            found.setflags(write=False)
            known = np.concatenate(factors), np.concatenate(errors)
            self._derivatives = key, found, np.array(wrong), known
        return self._derivatives[1]


def _defined(function: Callable[[Array], Array], states: Array) -> Array:
    """Return the values of a function at states (n, d) as an array.

    Raises
    ------
    NoMotion
        When the motion ends, or a value is not finite.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        found = np.array([function(state) for state in states])
    finite = np.isfinite(found)
    if not finite.all():
        where = int(np.argmin(finite.reshape(len(states), -1).all(axis=1)))
        raise NoSolution(f"the map is not finite at {states[where].tolist()}")
    return found


def angles(system: SmoothMap) -> Any:
    """Return whether each coordinate is an angle, (d,) of bool: a turn makes no difference."""
    d = system.dimension
    turned = system.difference(TURN * np.eye(d), np.zeros(d))
    return abs(np.diag(turned)) < 1e-9


def sizes(states: Array) -> Array:
    """Return sizes (d,) of the coordinates of states (n, d): at least a tenth of the largest."""
    largest = abs(states).max(axis=0)
    overall = float(largest.max())
    return np.maximum(largest, 0.1 * overall) if overall > 0.0 else np.ones(len(largest))


def following(rows: Any) -> Any:
    """Return the rows shifted by one: each is replaced by the next, the last by the first."""
    return np.concatenate([rows[1:], rows[:1]])
