"""The equations of periodic orbits of maps."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import partial, reduce
from typing import TYPE_CHECKING, Any, Self, final

import numpy as np

from dynkit.continuation.problem import NoSolution, Problem, fractions
from dynkit.maps import Map
from dynkit.multipliers import product_eigenvalues
from dynkit.no_motion import NoMotion, Refused, replaced
from dynkit.results import Cost
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.map_orbits import MapOrbit

TURN = 2.0 * np.pi
# Errors of calls are no larger than this in the equations: Newton's method ends in them.
_NOISE = 1e-13

ROUNDINGS = 4.0
"""What is left in the equations, and in derivatives, in units of the accuracy of a call."""

# States that agree so well, in units of their size, are one.
_REPEATED = 1e-7


class StatesProblem(Problem):
    """Equations of a periodic orbit whose unknowns are its n states: n d numbers, state by state.

    The equations of a state contain this state and the one after it.

    Parameters
    ----------
    system : Map
    states : (n, d) array
        Near the solutions; the equations are in units of their largest coordinates, enlarged for
        a map whose calls are wrong by more than 1e-13, so that this is what remains of them.
    names : sequence of str
        The free parameters.

    Raises
    ------
    ValueError
        When the system has no such parameter.
    """

    def __init__(self, system: Map, states: Array, names: Sequence[str] = ()) -> None:
        self._system = system
        self._like = states
        self._names = tuple(names)
        self._values = np.array([system.value_of(name) for name in names])
        self._sizes = sizes(states)
        self.units = self._sizes * max(1.0, system.accuracy / _NOISE)
        """Units (d,) of the equations: sizes of the states, larger where calls are not exact."""
        self._at: tuple[bytes, Map] = (self._values.tobytes(), system)

    @property
    @abstractmethod
    def label(self) -> str:
        """Label of the orbits."""

    @abstractmethod
    def made_of(self, system: Map, states: Array, which: Any, names: Sequence[str]) -> Self:
        """Return the problem of another system near these states (k, d).

        `which`, (k,) of int, are the numbers of the states here that the new ones are near to.
        """

    @abstractmethod
    def blocks(self, x: Array, p: Array) -> tuple[Array, Array]:
        """Return derivatives of the equations of each state, (n, d, d), by it and by the next."""

    @abstractmethod
    def factors(self, x: Array, p: Array) -> tuple[Array, Array]:
        """Return the derivatives along the orbit, (k, d, d) in all, and errors of entries, (k,)."""

    @abstractmethod
    def states(self, x: Array) -> Array:
        """Return the states (n, d) of a solution; angles are where the map has them."""

    @property
    def system(self) -> Map:
        """The map at whose parameters the others than the free ones stay."""
        return self._system

    @property
    def names(self) -> tuple[str, ...]:
        return self._names

    def free(self, *names: str) -> Self:
        return self.made_of(self._system, self._like, np.arange(len(self._like)), names)

    @property
    def values(self) -> Array:
        return self._values

    @property
    def size(self) -> int:
        return self._like.size

    def scale(self, x: Array) -> Array:
        # a branch through zero, too, goes on in steps of the size that it had
        return np.tile(np.maximum(sizes(self._rows(x)), self._sizes), len(self._like))

    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        n, d = self._like.shape
        by_state, by_next = self.blocks(x, p)
        complex_needed = isinstance(multiplier, complex | np.complexfloating)
        matrix = np.zeros((n, d, n, d), dtype=complex if complex_needed else float)
        each = np.arange(n)
        matrix[each, :, each] = by_state
        returned = np.ones((n, 1, 1), dtype=matrix.dtype)
        returned[-1] = multiplier
        matrix[each, :, _next(each)] += returned * by_next
        return matrix.reshape(n * d, n * d)

    def multipliers(self, x: Array, p: Array) -> Any:
        return product_eigenvalues(self.factors(x, p)[0])

    def orbit(self, x: Array, p: Array, history: Sequence[float] = ()) -> MapOrbit:
        from dynkit.map_orbits import MapOrbit

        past = history or (float(abs(self.residual(x, p)).max()),)
        fixed = self.made_of(self.at(p), self._rows(x).copy(), np.arange(len(self._like)), ())
        return MapOrbit(fixed, x, past, Cost(0.0, {"newton steps": len(past) - 1}))

    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        twice = np.tile(np.arange(len(self._like)), 2)
        problem = self.made_of(self._system, self._like[twice], twice, self._names)
        return problem, np.concatenate([x, x]), np.concatenate([disturbance, -disturbance])

    def shortest(self, x: Array) -> tuple[Problem, Array]:
        for k in fractions(len(self._like)):
            if (abs(self._changes_over(k, x)) <= _REPEATED * self.units).all():
                problem = self.made_of(self._system, self._like[:k], np.arange(k), self._names)
                return problem, self._rows(x)[:k].ravel()
        return self, x

    def repetition(self, x: Array) -> float:
        sizes = self.scale(x).reshape(self._like.shape)
        parts = [self._changes_over(k, x) / sizes for k in fractions(len(self._like))]
        return min((float(np.sqrt(np.mean(part**2))) for part in parts), default=np.inf)

    def _changes_over(self, k: int, x: Array) -> Array:
        """How the states (n, d) change over k iterates."""
        states = self._rows(x)
        return self._system.difference(np.roll(states, -k, axis=0), states)

    def apart(self, x: Array, other: Array) -> Array:
        """Return differences (n d,) of the states, from the one on that makes them smallest."""
        n = len(self._like)
        turned = (np.arange(n)[:, None] + np.arange(n)) % n
        gaps = self._system.difference(self._rows(x)[turned], self._rows(other)) / self._sizes
        return np.asarray(gaps[np.argmin((gaps**2).sum(axis=(1, 2)))].ravel())

    def at(self, p: Array) -> Map:
        """Return the map with the free parameters set.

        Raises
        ------
        NoSolution
            When it refuses them.
        """
        key = np.asarray(p, dtype=np.float64).tobytes()
        if key != self._at[0]:
            values = dict(zip(self._names, np.asarray(p).tolist(), strict=True))
            try:
                self._at = (key, replaced(self._system, **values))
            except Refused as refusal:
                raise NoSolution(str(refusal)) from refusal
        return self._at[1]

    def _rows(self, x: Array) -> Array:
        return np.asarray(x).reshape(self._like.shape)


@final
class MapProblem(StatesProblem):
    """x_{i+1} = f(x_i), i modulo n: n d equations for the n states of a periodic orbit.

    See `StatesProblem`.
    """

    def __init__(self, system: Map, states: Array, names: Sequence[str] = ()) -> None:
        super().__init__(system, states, names)
        self._derivatives: tuple[bytes, Array, tuple[Array, Array]]
        self._derivatives = b"", np.empty(0), (np.empty(0), np.empty(0))

    @property
    def label(self) -> str:
        return f"P({len(self._like)})"

    def made_of(self, system: Map, states: Array, which: Any, names: Sequence[str]) -> Self:  # noqa: ARG002
        return type(self)(system, states, names)

    def residual(self, x: Array, p: Array) -> Array:
        system, states = self.at(p), self._rows(x)
        gap = system.difference(_defined(system, states), _next(states))
        return np.asarray((gap / self.units).ravel())

    def rounding(self, x: Array, p: Array) -> Array:
        """Four times what a call may be wrong by, for states of the size of the largest."""
        wrong = ROUNDINGS * self.at(p).accuracy * float(abs(x).max()) / self.units
        return np.tile(wrong, len(self._like))

    def blocks(self, x: Array, p: Array) -> tuple[Array, Array]:
        by_state = self.jacobians(x, p) / self.units[:, None]
        return by_state, np.broadcast_to(-np.diag(1.0 / self.units), by_state.shape)

    def parameter_derivative(self, x: Array, p: Array) -> Array:
        system, columns = self.at(p), []
        for name in self._names:
            by_name = partial(system.parameter_derivative, name=name)
            columns.append((_defined(by_name, self._rows(x)) / self.units).ravel())
        return np.stack(columns, axis=1) if columns else np.empty((self.size, 0))

    def factors(self, x: Array, p: Array) -> tuple[Array, Array]:
        self.jacobians(x, p)
        return self._derivatives[2]

    def states(self, x: Array) -> Array:
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
        NoSolution
            Where there is none.
        """
        key = np.asarray(x).tobytes() + np.asarray(p, dtype=np.float64).tobytes()
        if key != self._derivatives[0]:
            system, factors, errors = self.at(p), list[Array](), list[Array]()

            def jacobian(state: Array) -> Array:
                matrices, off = system.jacobian_factors(state)
                factors.append(matrices)
                errors.append(ROUNDINGS * off)
                return reduce(lambda product, factor: np.asarray(factor @ product), matrices)

            found = _defined(jacobian, self._rows(x))
            found.setflags(write=False)
            self._derivatives = key, found, (np.concatenate(factors), np.concatenate(errors))
        return self._derivatives[1]


def _defined(function: Callable[[Array], Array], states: Array) -> Array:
    """What a function gives at each of the states (n, d), as an array."""
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = np.array([function(state) for state in states])
    except NoMotion as end:
        raise NoSolution(str(end)) from end
    finite = np.isfinite(found)
    if not finite.all():
        where = int(np.argmin(finite.reshape(len(states), -1).all(axis=1)))
        raise NoSolution(f"the map is not finite at {states[where].tolist()}")
    return found


def _next(rows: Any) -> Any:
    """The rows that follow, the first one after the last."""
    return np.concatenate([rows[1:], rows[:1]])


def sizes(states: Array) -> Array:
    """Sizes (d,) of the coordinates; those that are small beside others count as a tenth."""
    largest = abs(states).max(axis=0)
    overall = float(largest.max())
    return np.maximum(largest, 0.1 * overall) if overall > 0.0 else np.ones(len(largest))


def angles(system: Map) -> Any:
    """Which coordinates, (d,) of bool, are angles: those in which a turn is no difference."""
    d = system.dimension
    turned = system.difference(TURN * np.eye(d), np.zeros(d))
    return abs(np.diag(turned)) < 1e-9
