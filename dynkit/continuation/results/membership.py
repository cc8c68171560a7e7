"""Test whether an orbit lies on a known branch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, final

import numpy as np
from scipy.optimize import brentq

from dynkit.continuation.orbit_equations import OrbitEquations
from dynkit.continuation.points import SAME
from dynkit.continuation.results.lines import nodes_of
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoConvergence, correct
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.orbits.solving import FixedParameters

if TYPE_CHECKING:
    from dynkit.continuation.results.branch import Branch
    from dynkit.orbits.equations import ProblemSolution

# Values of the parameter that differ by less than _RESOLVED, relative to its range, are equal.
# Nodes that are closer than _SHORT, in scaled unknowns, are equal; it is also the tolerance of the
# position between two nodes, as a fraction of their distance.
_RESOLVED, _SHORT = 1e-13, 1e-12


@final
class Trail:
    """A branch as a polygon: its nodes are the points and the bifurcations.

    The parameter is monotone between two nodes, because folds are nodes.

    Parameters
    ----------
    branch : Branch
    """

    def __init__(self, branch: Branch) -> None:
        self._problem = branch.problem
        self._width = float(np.ptp(branch.parameter)) or 1.0
        self._equations = OrbitEquations(branch.problem, self._width)
        rows = []
        for place, b in nodes_of(len(branch), branch.bifurcations):
            x = branch.unknowns[int(place)] if b is None else b.unknowns
            rows.append(np.append(x, branch.parameter[int(place)] if b is None else b.value))
        self._nodes = np.array(rows)

    def holds(self, orbit: ProblemSolution, on_planes: bool = False) -> bool:
        """Whether an orbit belongs to the branch.

        All orbits of the branch at the same value of the parameter are computed, and their states
        are compared with those of the orbit. With `on_planes`, the states of the orbit are those at
        its crossings of the branch's plane.
        """
        value = orbit.system.parameters[self._problem.names[0]]
        p = np.array([value])
        if not isinstance(orbit, PeriodicOrbit):
            return any(self._is(orbit.unknowns, x) for x in self._near(value))
        found = (self._problem.solution(x, p) for x in self._near(value))
        return any(_same(orbit, other, on_planes) for other in found)

    def _is(self, x: Array, other: Array) -> bool:
        return len(x) == len(other) and bool(abs(self._problem.apart(x, other)).max() < SAME)

    def solutions(self, value: float) -> list[tuple[Array, tuple[float, ...]]]:
        """Return the solutions (m,) at a value of the parameter, each with its residuals."""
        found: list[tuple[Array, tuple[float, ...]]] = []
        for x, history in self._solved(value):
            # a solution at a node is found from both of its sides
            if all(abs(self._problem.apart(x, other)).max() >= SAME for other, _ in found):
                found.append((x, history))
        return found

    def _passing(self, value: float) -> Any:
        """Return whether the parameter takes a value between successive nodes, (k - 1,) of bool."""
        slack = _RESOLVED * self._width
        side = self._nodes[:, -1] - value
        low, high = np.minimum(side[:-1], side[1:]), np.maximum(side[:-1], side[1:])
        return (low <= slack) & (high >= -slack)

    def _near(self, value: float) -> Iterator[Array]:
        """Yield solutions (m,) whose parameter is the value to rounding."""
        for i in np.flatnonzero(self._passing(value)).tolist():
            x = self._solution(i, value)
            if x is not None:
                yield x

    def _solved(self, value: float) -> Iterator[tuple[Array, tuple[float, ...]]]:
        p = np.array([value])
        for x in self._near(value):
            # correct at exactly this value: Newton's method fails next to a fold or a branch point
            fixed = FixedParameters(self._problem, p)
            found = correct(fixed, x, self._problem.scale(x))
            moved = abs(found.y - x) / self._problem.scale(x)
            if found.converged and moved.max() < SAME:
                yield found.y, found.history
            else:
                yield x, (float(abs(self._problem.residual(x, p)).max()),)

    def _solution(self, i: int, value: float) -> Array | None:
        """Return the solution (m,) between nodes i and i + 1 at a value of the parameter."""
        a, b = self._nodes[i], self._nodes[i + 1]
        scale = self._equations.scale(a)
        row = (b - a) / scale
        length = float(np.linalg.norm(row))
        if length <= _SHORT:
            return np.asarray(a[:-1])
        points = {0.0: a, 1.0: b}

        def beyond(part: float) -> float:
            if part not in points:
                found = correct(self._equations, a + part * (b - a), scale, row / length)
                if not found.converged:
                    raise NoConvergence(found.message)
                points[part] = found.y
            gap = float(points[part][-1] - value)
            return gap if abs(gap) > _RESOLVED * self._width else 0.0

        try:
            return np.asarray(points[brentq(beyond, 0.0, 1.0, xtol=_SHORT)][:-1])
        except NoConvergence:
            return None


def _same(orbit: PeriodicOrbit, other: PeriodicOrbit, on_planes: bool) -> bool:
    """Whether two orbits of one system have the same states, in any order."""
    states, others = orbit.states, other.states
    if on_planes:
        states = other.system.seen_of(orbit.system, states)
    states, others = (other.system.without_shift(each) for each in (states, others))
    if states.shape != others.shape:
        return False
    sizes = np.maximum(abs(states).max(axis=0), 0.1 * abs(states).max())
    sizes[sizes == 0.0] = 1.0
    rows = [other.system.difference(others, state) for state in states]
    apart = (abs(np.array(rows)) / sizes).max(axis=2)
    return bool(max(apart.min(axis=0).max(), apart.min(axis=1).max()) < SAME)
