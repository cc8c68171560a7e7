"""Orbits on the branches that leave a bifurcation."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple, TypeAlias, final

import numpy as np

from dynkit.continuation.initial_tangents import crossing_directions
from dynkit.continuation.orbit_equations import OrbitEquations
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import WatchedProblem
from dynkit.orbits.newton import NoConvergence, correct
from dynkit.orbits.problem import PeriodicProblem
from dynkit.orbits.solving import solve

# Distances along the new branch to try, in scaled unknowns: the first one close enough to the
# bifurcation is taken. At smaller distances an orbit cannot be separated from its half.
_DISTANCES = 10.0 ** np.arange(-2.0, -6.6, -0.5)
# The distance of a branch from its tangent is quadratic in the distance along it, plus higher
# terms. This is the largest relative deviation from the quadratic law: the branch is then within a
# third of its parabola.
_OFF = 0.25
# Eigenvalues that agree so well are one eigenvalue, of a symmetry; relative to the modulus.
_SAME = 1e-6
# Least part of the square of a tangent's length that shows the unit of the parameter.
_FLAT = 1e-4
# Largest distance of the critical multiplier from 1. It is 1 at the start of the new branch, and -1
# at its period doubling: this is an eighth of the way.
_FROM_ONE = 0.25


@final
class Place(NamedTuple):
    """A bifurcation from which branches leave.

    Parameters
    ----------
    problem : Problem
        The equations of its branch.
    y, error : (m + 1,) arrays
        The unknowns and the parameter, and their errors.
    direction : (m,) array
        Null vector of D at the critical multiplier; empty at an event.
    tangent : (m + 1,) array
        Direction of the branch.
    event : int
        Index of the problem's event, if it is one.
    own : (e,) array
        Additional unknowns of the condition: at HB the frequency.
    """

    problem: Problem
    y: Array
    error: Array
    direction: Array
    tangent: Array
    event: int
    own: Array


Switch: TypeAlias = "Callable[[Place], list[Any]]"


def doubled(place: Place) -> list[Any]:
    """Return a near orbit on the branch of twice the period that leaves a PD."""
    problem, y, error, direction = place.problem, place.y, place.error, place.direction
    if not isinstance(problem, PeriodicProblem):
        return []
    twice, start, along = problem.doubled(y[:-1], direction)
    errors = np.append(abs(problem.doubled(y[:-1], error[:-1])[2]), error[-1])
    begin = np.append(start, y[-1:])
    orbit = _stepped(twice, begin, np.append(along, 0.0), errors, width_of(place))
    if orbit.unknowns.size < len(start):
        raise NoConvergence("Newton's method found only the repeated orbit, not a doubled one")
    return [orbit]


def crossing(place: Place) -> list[Any]:
    """Return a near orbit on the branch that crosses at a BP."""
    problem, y, error, old = place.problem, place.y, place.error, place.tangent
    width = width_of(place)
    equations = OrbitEquations(problem, width)
    scale = equations.scale(y)
    old = old / scale / np.linalg.norm(old / scale)
    directions = crossing_directions(equations, y, scale)
    if directions:
        direction = min(directions, key=lambda direction: abs(float(direction @ old)))
    else:
        # no transversal crossing: the direction orthogonal to the old branch
        basis = np.linalg.svd(equations.jacobian(y) * scale)[2][-2:]
        along = basis @ old
        direction = np.array([-along[1], along[0]]) @ basis
    return [_stepped(problem, y, direction * scale, error, width)]


def _stepped(problem: Problem, y: Array, direction: Array, error: Array, width: float) -> Any:
    """Return an orbit at a small distance along a direction; `width` is the parameter's unit.

    The distance is so small that the expansion y + e q + e^2 c + ... of the branch holds: at half
    the distance e along the direction q, the distance from the tangent is a fourth. The required
    distance depends on the branch: it decreases along a cascade of period doublings.

    Raises
    ------
    NoConvergence
        When there is none at any of the distances.
    """
    equations = OrbitEquations(problem, width)
    scale = equations.scale(y)
    row = direction / scale
    row /= np.linalg.norm(row)
    off = np.linalg.norm(np.where(np.isfinite(error), error, 0.0) / scale)
    for distance in _DISTANCES:
        for sign in (1.0, -1.0):
            ways = sign * distance * row * scale, 0.5 * sign * distance * row * scale
            found, half = (correct(equations, y + way, scale, row, steps=20) for way in ways)
            if not (found.converged and half.converged):
                continue
            gap, of_half = (
                (a.y - y - way) / scale for a, way in zip((found, half), ways, strict=True)
            )
            size = np.linalg.norm(gap)
            # the error of the bifurcation is an error of both gaps
            if size < distance and np.linalg.norm(gap - 4.0 * of_half) <= _OFF * size + 5.0 * off:
                once, x = problem.shortest(found.y[:-1])
                made = once.solution(x, found.y[-1:], found.history)
                if _is_near(problem, found.y):
                    return made
    raise NoConvergence(
        f"no orbit was found on the branch that leaves, at distances from {_DISTANCES[0]:.0e} down "
        f"to {_DISTANCES[-1]:.0e} relative to the size of the orbit: Newton's method does not "
        "converge there, or the branch bends within them"
    )


def _is_near(problem: Problem, y: Array) -> bool:
    """Whether a multiplier is near one; always true for eigenvalues, which have no unit."""
    if not problem.stability.periodic:
        return True
    return bool(abs(problem.spectrum(y[:-1], y[-1:]) - 1.0).min() <= _FROM_ONE)


def born(place: Place) -> list[Any]:
    """Return a near periodic orbit on the branch that is born at an HB."""
    y, m = place.y, len(place.direction)
    found = place.problem.oscillation(y[:m], y[-1:], float(place.own[0]), place.direction)
    if found is None:
        return []
    problem, at, direction = found
    error = np.append(np.full(len(at), abs(place.error[:m]).max()), place.error[-1])
    try:
        begin, along = np.append(at, y[-1:]), np.append(direction, 0.0)
        return [_stepped(problem, begin, along, error, width_of(place))]
    except NoConvergence as failure:
        away = abs(place.problem.spectrum(y[:m], y[-1:]) - 1j * place.own[0])
        if (away <= _SAME * abs(place.own[0])).sum() < 2:
            raise
        raise NoConvergence(
            "the critical pair is double, as by a symmetry: several branches leave, none in the "
            "direction that was tried"
        ) from failure


def neighbours(place: Place) -> list[Any]:
    """Return the near orbits of one impact more or fewer at a GR."""
    problem, y, found = place.problem, place.y, dict[int, Any]()
    if not isinstance(problem, WatchedProblem):
        return []
    try:
        guesses = problem.neighbours(place.event, y[:-1], y[-1:])
    except NoMotion:
        return []
    for other, guess, values in guesses:
        if id(other) in found:  # an orbit of this branch is known
            continue
        with suppress(NoConvergence, NoMotion):
            solution, history = solve(other, guess, values)
            once, x = other.shortest(solution)
            found[id(other)] = once.solution(x, values, history)
    return list(found.values())


def width_of(place: Place) -> float:
    """Return the unit of the parameter on the branch, in which its tangent has unit length.

    Where the tangent hardly contains the parameter, it is the parameter's size, or one.
    """
    *way, change = place.tangent / OrbitEquations(place.problem, 1.0).scale(place.y)
    rest = 1.0 - float(np.square(way).sum())
    if rest > _FLAT and change:
        return float(abs(change) / rest**0.5)
    return max(1.0, abs(float(place.y[-1])))
