"""Periodic orbits of maps, and their equations: the unknowns are all states."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.reprs import told
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array, finite_array, one_of
from dynkit.orbits.equations import NOISE
from dynkit.orbits.events import is_admissible
from dynkit.orbits.families import FamilyProblem
from dynkit.orbits.multipliers import product_eigenvalues
from dynkit.orbits.newton import orbit_bound
from dynkit.orbits.problem import PeriodicOrbit, PeriodicProblem, fractions

_NONE = np.empty(0)
# States that agree so well, in units of their size, are one.
_REPEATED = 1e-7


class StatesProblem(PeriodicProblem, FamilyProblem):
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

    def __init__(self, system: SmoothMap, states: Array, names: Sequence[str] = ()) -> None:
        super().__init__(system, names)
        self._like = states
        self._sizes = sizes(states)
        self.units = self._sizes * max(1.0, system.accuracy / NOISE)
        """Units (d,) of the equations: sizes of the states, larger where calls are not exact."""

    @abstractmethod
    def made_of(self, system: SmoothMap, states: Array, which: Any, names: Sequence[str]) -> Self:
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

    def free(self, *names: str) -> Self:
        return self.made_of(self._system, self._like, np.arange(len(self._like)), names)

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
        matrix[each, :, following(each)] += returned * by_next
        return matrix.reshape(n * d, n * d)

    def multipliers(self, x: Array, p: Array) -> Any:
        return product_eigenvalues(self.factors(x, p)[0])

    def orbit(self, x: Array, p: Array, history: Sequence[float] = ()) -> MapOrbit:
        past = history or (float(abs(self.residual(x, p)).max()),)
        fixed = self.made_of(self.at(p), self._rows(x).copy(), np.arange(len(self._like)), ())
        return MapOrbit(fixed, x, past, Cost(0.0, {"newton steps": len(past) - 1}))

    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        twice = np.tile(np.arange(len(self._like)), 2)
        problem = self.made_of(self._system, self._like[twice], twice, self._names)
        return problem, np.concatenate([x, x]), np.concatenate([disturbance, -disturbance])

    def shortest(self, x: Array) -> tuple[PeriodicProblem, Array]:
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
        return np.asarray(self._system.difference(np.roll(states, -k, axis=0), states))

    def apart(self, x: Array, other: Array) -> Array:
        """Return differences (n d,) of the states, from the one on that makes them smallest."""
        n = len(self._like)
        turned = (np.arange(n)[:, None] + np.arange(n)) % n
        gaps = self._system.difference(self._rows(x)[turned], self._rows(other)) / self._sizes
        return np.asarray(gaps[np.argmin((gaps**2).sum(axis=(1, 2)))].ravel())

    def _rows(self, x: Array) -> Array:
        return np.asarray(x).reshape(self._like.shape)


@final
class MapOrbit(PeriodicOrbit):
    """P(n): n states that a map takes one into the next, and the last into the first.

    From `periodic_orbit`, from an attractor or from a branch. It is a motion of the map wherever
    the map is defined: always admissible. Only of a `BouncingBall` there are orbits P(n,m), of n
    impacts in m periods of the table, that are not admissible: flights pass through the table.
    """

    def __init__(
        self, problem: StatesProblem, x: Array, history: Sequence[float], cost: Cost
    ) -> None:
        self._problem = problem
        self._x = x.copy()
        self._x.setflags(write=False)
        self._history = tuple(history)
        self._cost = cost

    def __reduce__(self) -> tuple[type[MapOrbit], tuple[Any, ...]]:
        # copies are read-only too
        return MapOrbit, (self._problem, self._x, self._history, self._cost)

    def __repr__(self) -> str:
        hidden = int((~self.multipliers_resolved).sum())
        doubt = f"; {hidden} of {len(self.multipliers)} multipliers not resolved" if hidden else ""
        kind = "stable" if self.stable else "unstable"
        if not self.admissible:
            kind = f"inadmissible, {kind}"
        return f"<{self.label} of {told(self.system, 6)}: {kind}{doubt}>"

    @property
    def system(self) -> SmoothMap:
        system: SmoothMap = self._problem.system
        return system

    @property
    def period(self) -> int:
        """The number n of states."""
        return self._x.size // self.system.dimension

    @property
    def label(self) -> str:
        """``P(n)``; ``P(n,m)`` of a `BouncingBall`."""
        return self._problem.label

    @cached_property
    def states(self) -> Array:
        """Its states, (n, d), one after the other, read-only; angles are where the map has them."""
        states = self._problem.states(self._x)
        states.setflags(write=False)
        return states

    @cached_property
    def multipliers(self) -> Any:
        """Floquet multipliers, (d,) complex, the largest modulus first.

        They are the `product_eigenvalues` of the map's `jacobian_factors` at all states: small ones
        are right too, relative to themselves, to the errors of these factors and of the states. See
        `multipliers_error`, and `multipliers_resolved` for those of which nothing is known.

        Raises
        ------
        NoSolution
            When the map has no derivative there.
        """
        return self.problem().multipliers(self._x, _NONE)

    @cached_property
    def admissible(self) -> bool:
        return is_admissible(self._problem, self._x, _NONE)

    @property
    def history(self) -> tuple[float, ...]:
        return self._history

    @cached_property
    def error(self) -> float:
        """Bound of the largest error of a coordinate, to first order in the map's `accuracy`.

        Twice the sum, over the inverse derivative, of the residual that is left and four times the
        accuracy of a call, for states of the size of the largest. Infinite where the derivative is
        singular, or may be within the error of differences.
        """
        return float(orbit_bound(self.problem(), self._x, _NONE).max())

    @property
    def cost(self) -> Cost:
        return self._cost

    def problem(self, *names: str) -> StatesProblem:
        """Return the equations that it solves, with the named parameters free.

        Raises
        ------
        ValueError
            When the system has no such parameter.
        """
        return self._problem.free(*names)

    @property
    def unknowns(self) -> Array:
        """All states in one, (n d,); angles are not wrapped."""
        return self._x

    def observable(self, name: str) -> Array:
        """Return one coordinate of its states, (n,): ``state[0]`` and so on.

        Raises
        ------
        ValueError
            When there is no such coordinate.
        """
        names = [f"state[{i}]" for i in range(self.system.dimension)]
        return self.states[:, names.index(one_of("name", name, names))]

    def sample(self, iterates: object) -> Array:
        """Return the states, (k, d), so many iterates after the first one.

        Parameters
        ----------
        iterates : (k,) array_like
            Integers of any size and sign: the motion repeats itself.

        Raises
        ------
        ValueError
            When one is no integer.
        """
        asked = finite_array("iterates", iterates, (None,))
        for i in np.flatnonzero(asked != np.rint(asked))[:1].tolist():
            raise ValueError(f"iterates[{i}] must be an integer; got {float(asked[i])!r}")
        return np.asarray(self.states[np.asarray(asked % self.period, dtype=np.intp)])


def sizes(states: Array) -> Array:
    """Sizes (d,) of the coordinates; those that are small beside others count as a tenth."""
    largest = abs(states).max(axis=0)
    overall = float(largest.max())
    return np.maximum(largest, 0.1 * overall) if overall > 0.0 else np.ones(len(largest))


def following(rows: Any) -> Any:
    """Return the rows that follow, the first one after the last."""
    return np.concatenate([rows[1:], rows[:1]])
