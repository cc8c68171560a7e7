"""Periodic orbits of maps, found by Newton's method."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.smooth_map import SmoothMap, checked_map, proper_divisors
from dynkit.core.validation import Array, finite_array, positive_integer, within_memory
from dynkit.orbits.map_orbit import MapOrbit
from dynkit.orbits.map_problem import MapProblem, sizes
from dynkit.orbits.newton import NoConvergence
from dynkit.orbits.solving import solve

# States of an orbit that differ by less than this, relative to their size, are tried as one state.
# After a period doubling they are so close only if the parameter is within the square of this
# number, 1e-14, of the bifurcation.
_SAME = 1e-7
# States of different orbits far from the origin may also differ by less than _SAME. Equal orbits
# differ by at most this many times the sum of their errors, different ones by more.
_APART = 10.0
# An orbit is solved for again, in its own units, where it is smaller than this times the guess.
_COARSE = 0.1
_ROUNDING = 2.0**-52
# Newton's method ends at residuals below this.
_LEVEL = 16.0 * _ROUNDING
_NONE = np.empty(0)
_FAMILY = "no isolated periodic orbit found from the guess: it is one of a family, "


def periodic_orbit(system: SmoothMap, guess: Any, *, period: int | None = None) -> MapOrbit:
    """Find a periodic orbit of a map, stable or unstable, by Newton's method from a guess.

    All states of the orbit are unknowns (multiple shooting), so that unstable orbits of long
    periods are found as well. Where the orbit has a smaller period than n, it is returned with its
    least period; its `label` shows it.

    Parameters
    ----------
    system : Map
    guess : (d,) or (n, d) array_like
        One state near the orbit, from which the map is iterated; or all n states, in order.
    period : int, optional
        The period n; by default one, or the number of states.

    Returns
    -------
    MapOrbit

    Raises
    ------
    ValueError
        When the guess is not finite or has another shape; when the period is not a positive integer
        or not the number of states.
    NoMotion
        When a guess of one state has fewer than n - 1 iterates.
    NoConvergence
        When Newton's method does not converge to an orbit. For a flow or a machine, also when it
        converges to an orbit of a continuous family, as where an energy is conserved or friction
        never slips.

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
    problem = MapProblem(system, x.reshape(-1, system.dimension))
    if system._families and problem.is_of_a_family(x):
        raise NoConvergence(_FAMILY + system._families)
    cost = Cost(time.perf_counter() - began, {"newton steps": len(history) - 1})
    return MapOrbit(problem, x, history, cost)


def _guessed(system: SmoothMap, guess: Any, period: int | None) -> Array:
    checked_map(system)
    d = system.dimension
    if _is_one_state(guess):
        n = 1 if period is None else positive_integer("period", period)
        # two square matrices, of n d equations for as many unknowns
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


def _solved(system: SmoothMap, states: Array) -> tuple[Array, tuple[float, ...]]:
    x, guessed = states.ravel(), np.inf
    history: tuple[float, ...] = ()
    # the units of a far guess are too coarse for the orbit that is found from it
    while abs(x).max() < _COARSE * guessed:
        problem, guessed = MapProblem(system, x.reshape(states.shape)), abs(x).max()
        try:
            x, residuals = solve(problem, x, _NONE)
        except NoConvergence as failure:
            raise NoConvergence(
                f"{failure}; for period {len(states)} from {states[0].tolist()} of {system!r}"
            ) from failure
        history += residuals[min(len(history), 1) :]
        if abs(x).max() < _LEVEL * abs(states).max() and _is_solution(problem, 0.0 * x):
            x = 0.0 * x  # Newton's method approaches zero, which has no unit of its own
    # set coordinates below rounding to zero: otherwise rounding errors would become scales
    cleared = np.where(abs(x) < _ROUNDING * problem.scale(x), 0.0, x)
    if abs(problem.residual(cleared, _NONE)).max() <= history[-1]:
        x = cleared
    return x, history


def _is_solution(problem: MapProblem, x: Array) -> bool:
    """Whether the residual is exactly zero."""
    try:
        return not problem.residual(x, _NONE).any()
    except NoMotion:
        return False


def _shorter(system: SmoothMap, states: Array) -> tuple[Array, tuple[float, ...]] | None:
    """Return the solution of the orbit's least period, if that is smaller than n."""
    n = len(states)
    near = _SAME * sizes(states)
    for k in proper_divisors(n):
        if (abs(system.difference(np.roll(states, -k, axis=0), states)) > near).any():
            continue
        try:
            x, history = _solved(system, states[:k])
        except NoConvergence:
            continue
        gap = abs(system.difference(x.reshape(k, -1), states[:k]))
        if (gap <= near).all() and gap.max() <= _APART * (
            _error(system, states, history) + _error(system, x.reshape(k, -1), history)
        ):
            return x, history
    return None


def _error(system: SmoothMap, states: Array, history: tuple[float, ...]) -> float:
    """Return the error of a solution (n, d); infinity where it has none."""
    try:
        return MapOrbit(MapProblem(system, states), states.ravel(), history, Cost(0.0, {})).error
    except NoMotion:
        return np.inf
