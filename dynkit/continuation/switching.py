"""Orbits on the branches that leave a bifurcation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynkit.continuation.arclength import OrbitEquations
from dynkit.continuation.initial_tangents import crossing_directions, null_vectors
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoConvergence, NoSolution, correct, solve
from dynkit.orbits.problem import Problem

if TYPE_CHECKING:
    from dynkit.continuation.bifurcations import Bifurcation
    from dynkit.orbits.problem import PeriodicOrbit

# How far to go along the new branch, in scaled unknowns: the first distance at which the branch is
# still near its start. Below the last one an orbit and its half are one.
_DISTANCES = 10.0 ** np.arange(-2.0, -6.6, -0.5)
# The distance from the tangent is a square and a cube, or fourth power, of the way along it. Where
# it is a square but for this part, the branch is not yet a third off its parabola.
_OFF = 0.25
# The critical multiplier is 1 at the start of the new branch, and -1 where it doubles its period:
# this is an eighth of the way.
_FROM_ONE = 0.25


def branches_at(bifurcation: Bifurcation) -> list[PeriodicOrbit]:
    """Return one orbit near by on every branch that leaves a bifurcation."""
    problem, x = bifurcation.problem, bifurcation.unknowns
    p = np.array([bifurcation.value])
    if bifurcation.kind == "PD" and len(bifurcation.direction):
        doubled, start, direction = problem.doubled(x, bifurcation.direction)
        error = np.append(np.tile(bifurcation.unknowns_error, 2), bifurcation.error)
        found = _stepped(doubled, np.append(start, p), np.append(direction, 0.0), error)
        # the orbit that doubles is a solution, too
        return [orbit for orbit in found if orbit.unknowns.size == len(start)]
    if bifurcation.kind == "BP":
        error = np.append(bifurcation.unknowns_error, bifurcation.error)
        return _crossing(problem, np.append(x, p), bifurcation.tangent, error)
    if bifurcation.event >= 0:
        return _neighbours(problem, bifurcation.event, x, p)
    return []


def _crossing(problem: Problem, y: Array, old: Array, error: Array) -> list[PeriodicOrbit]:
    equations = OrbitEquations(problem, _width(y))
    scale = equations.scale(y)
    directions = crossing_directions(equations, y, scale)
    if not directions:
        # no transversal crossing: what is orthogonal to the old branch
        basis = null_vectors(equations, y, scale, 2)
        old = old / scale / np.linalg.norm(old / scale)
        along = basis @ old
        directions = [np.array([-along[1], along[0]]) @ basis]
    else:
        old = old / scale / np.linalg.norm(old / scale)
        directions = [min(directions, key=lambda direction: abs(float(direction @ old)))]
    return _stepped(problem, y, directions[0] * scale, error)


def _stepped(problem: Problem, y: Array, direction: Array, error: Array) -> list[PeriodicOrbit]:
    """Return an orbit a little further on along a direction, or none.

    It is so near that the branch's own expansion y + e q + e^2 c + ... holds: of half the way e
    along the direction q the distance from the tangent is a fourth. How near that is depends on the
    branch: the orbits of a cascade of doublings differ by less and less.
    """
    equations = OrbitEquations(problem, _width(y))
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
            # both gaps are wrong by as much as the bifurcation is
            if size < distance and np.linalg.norm(gap - 4.0 * of_half) <= _OFF * size + 5.0 * off:
                shortest, x = problem.shortest(found.y[:-1])
                orbit = shortest.orbit(x, found.y[-1:], found.history)
                if abs(problem.multipliers(found.y[:-1], found.y[-1:]) - 1.0).min() <= _FROM_ONE:
                    return [orbit]
    return []


def _neighbours(problem: Problem, event: int, x: Array, p: Array) -> list[PeriodicOrbit]:
    found = []
    for other, guess, values in problem.neighbours(event, x, p):
        try:
            solution, history = solve(other, guess, values)
            found.append(other.orbit(solution, values, history))
        except (NoConvergence, NoSolution):
            continue
    return found


def _width(y: Array) -> float:
    return max(1.0, abs(float(y[-1])))
