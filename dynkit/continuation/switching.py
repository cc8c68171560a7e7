"""Orbits on the branches that leave a bifurcation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynkit.continuation.arclength import OrbitEquations
from dynkit.continuation.newton import NoConvergence, correct, solve
from dynkit.continuation.problem import NoSolution, Problem
from dynkit.continuation.starting import crossing_directions, null_vectors
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.continuation.bifurcations import Bifurcation
    from dynkit.orbits import PeriodicOrbit

# How far to go along the new branch, in scaled unknowns: the first distance that works.
_DISTANCES = (1e-2, 3e-3, 1e-3, 3e-4, 3e-2, 1e-4)


def branches_at(bifurcation: Bifurcation) -> list[PeriodicOrbit]:
    """Return one orbit near by on every branch that leaves a bifurcation."""
    problem, x = bifurcation.problem, bifurcation.unknowns
    p = np.array([bifurcation.value])
    if bifurcation.kind == "PD" and len(bifurcation.direction):
        doubled, start, direction = problem.doubled(x, bifurcation.direction)
        return _stepped(doubled, np.append(start, p), np.append(direction, 0.0))
    if bifurcation.kind == "BP":
        return _crossing(problem, np.append(x, p), bifurcation.tangent)
    if bifurcation.event >= 0:
        return _neighbours(problem, bifurcation.event, x, p)
    return []


def _crossing(problem: Problem, y: Array, old: Array) -> list[PeriodicOrbit]:
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
    return _stepped(problem, y, directions[0] * scale)


def _stepped(problem: Problem, y: Array, direction: Array) -> list[PeriodicOrbit]:
    """Return an orbit a little further on along a direction, or none."""
    equations = OrbitEquations(problem, _width(y))
    scale = equations.scale(y)
    row = direction / scale
    row /= np.linalg.norm(row)
    for distance in _DISTANCES:
        for sign in (1.0, -1.0):
            guess = y + sign * distance * row * scale
            found = correct(equations, guess, scale, row, steps=20)
            gap = (found.y - guess) / scale
            if found.converged and np.linalg.norm(gap) < distance:
                shortest, x = problem.shortest(found.y[:-1])
                return [shortest.orbit(x, found.y[-1:], found.history)]
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
