"""Periodic orbits of maps."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cached_property
from typing import Any, final

import numpy as np

from dynkit.map_problems import MapProblem, StatesProblem, sizes
from dynkit.maps import Map
from dynkit.no_motion import NoMotion
from dynkit.orbits import PeriodicOrbit
from dynkit.results import Cost
from dynkit.showing import told
from dynkit.validation import Array, finite_array, positive_integer, within_memory

# States of an orbit that agree so well, relative, are tried as one: a doubling leaves them so near
# only within rounding, which is the square, of the parameter where it happens.
_SAME = 1e-7
_NONE = np.empty(0)


def periodic_orbit(system: Map, guess: Any, *, period: int | None = None) -> MapOrbit:
    """Find a periodic orbit of a map, stable or not, by Newton's method from a guess.

    All states of the orbit are unknowns at once, so that unstable orbits of long periods are found
    too. An orbit is one of every multiple of its period: where what is found has a smaller period
    than what was asked for, it is returned as what it is, and its `label` says so.

    Parameters
    ----------
    system : Map
    guess : (d,) or (n, d) array_like
        One state near the orbit, from which the map is iterated; or all n of them, in order.
    period : int, optional
        n. By default one, or as many as there are states.

    Returns
    -------
    MapOrbit

    Raises
    ------
    ValueError
        When the guess is not finite or of another shape; when the period is no positive integer or
        not the number of states.
    NoMotion
        When a guess of one state has not as many iterates.
    NoConvergence
        From `dynkit.continuation.newton`: when Newton's method does not get to an orbit.

    Examples
    --------
    >>> from dynkit.systems import Logistic
    >>> orbit = periodic_orbit(Logistic(rate=3.9), [0.1], period=3)
    >>> print(orbit.label, orbit.stable)
    P(3) False
    """
    began = time.perf_counter()
    states = _guessed(system, guess, period)
    x, history = _solved(system, states)
    shorter = _shorter(system, x.reshape(states.shape))
    if shorter is not None:
        x, more = shorter
        history += more[1:]
    cost = Cost(time.perf_counter() - began, {"newton steps": len(history) - 1})
    states = x.reshape(-1, system.dimension)
    return MapOrbit(system._orbit_problem(states) or MapProblem(system, states), x, history, cost)


def _guessed(system: Map, guess: Any, period: int | None) -> Array:
    if not isinstance(system, Map):
        raise ValueError(f"system must be a Map; got {system!r}")
    d = system.dimension
    if _is_one_state(guess):
        n = 1 if period is None else positive_integer("period", period)
        # n d equations for as many unknowns, solved in a copy
        within_memory("period", n, 2.0 * 8.0 * (float(n) * d) ** 2)
        start = finite_array("guess", guess, (d,))
        try:
            return system.iterate(start, n - 1)
        except NoMotion as end:
            end.add_note(f"guess must have {n - 1} iterates; got {start.tolist()}")
            raise
    states = finite_array("guess", guess, (None, d))
    if not len(states):
        raise ValueError("guess must have one state at least; got none")
    if period is not None and positive_integer("period", period) != len(states):
        raise ValueError(f"period must be the number of states, {len(states)}; got {period}")
    return states


def _is_one_state(guess: Any) -> bool:
    try:
        return np.ndim(guess) == 1
    except ValueError:  # rows of different lengths
        return False


def _solved(system: Map, states: Array) -> tuple[Array, tuple[float, ...]]:
    from dynkit.continuation.newton import NoConvergence, solve

    problem = MapProblem(system, states)
    try:
        x, history = solve(problem, states.ravel(), _NONE)
    except NoConvergence as failure:
        raise NoConvergence(
            f"{failure}; for period {len(states)} from {states[0].tolist()} of {system!r}"
        ) from failure
    # What is zero has no size of its own: nothing may be measured in what rounding leaves of it.
    cleared = np.where(abs(x) < 2.0**-52 * problem.scale(x), 0.0, x)
    if abs(problem.residual(cleared, _NONE)).max() <= history[-1]:
        x = cleared
    return x, history


def _shorter(system: Map, states: Array) -> tuple[Array, tuple[float, ...]] | None:
    """The solution of the smallest period that the orbit has, if that is not its length."""
    from dynkit.continuation.newton import NoConvergence

    n = len(states)
    near = _SAME * sizes(states)
    for k in (k for k in range(1, n // 2 + 1) if n % k == 0):
        if (abs(system.difference(np.roll(states, -k, axis=0), states)) > near).any():
            continue
        try:
            x, history = _solved(system, states[:k])
        except NoConvergence:
            continue
        if (abs(system.difference(x.reshape(k, -1), states[:k])) <= near).all():
            return x, history
    return None


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
    def system(self) -> Map:
        return self._problem.system

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
        return self._problem.admissible(self._x, _NONE)

    @property
    def history(self) -> tuple[float, ...]:
        return self._history

    @cached_property
    def error(self) -> float:
        """Bound of the largest error of a coordinate, to first order in the map's `accuracy`.

        Twice the sum, over the inverse derivative, of the residual that is left and four times the
        accuracy of a call, for states of the size of the largest. Infinite where the derivative is
        singular.
        """
        from dynkit.continuation.newton import orbit_bound

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
        if name not in names:
            raise ValueError(f"name must be one of: {', '.join(names)}; got {name!r}")
        return self.states[:, names.index(name)]

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
