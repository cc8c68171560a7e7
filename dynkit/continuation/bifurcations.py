"""What happens between two successive points of a branch, and where exactly."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np

from dynkit.continuation.arclength import Follower, Point, interpolated
from dynkit.continuation.extended import BifurcationEquations, CriticalMultiplier, condition_of
from dynkit.continuation.newton import correct, error_bound
from dynkit.continuation.problem import NoSolution, Problem
from dynkit.results import Cost
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.orbits import PeriodicOrbit

# Squares of moduli, and products, up to here count as inside the unit circle: more is rounding.
_INSIDE = 1.0 + 1e-9
# Steps shorter than this, in scaled unknowns, are not halved to tell bifurcations apart.
_SHORTEST = 1e-4
_HALVINGS = 45
# From one branch to another that comes so near it may step.
_JUMP = 1e-6
# A torus with multipliers so nearly real is none; what unfolds a branch point is zero but for
# rounding.
_FLAT, _UNFOLDED = 1e-3, 1e-9
# A place that may be wrong by more, in the range of the parameter, is not solved for.
_UNSURE = 1e-6
# What was not solved for counts when a multiplier is so near.
_NEAR = 0.01
_CRITICAL = {"SN": 1.0, "BP": 1.0, "PD": -1.0}


class Crossing(NamedTuple):
    """What happens within a step: the kind, and which event for GR and CB."""

    kind: str
    event: int = -1


@final
@dataclass(slots=True)
class Seen:
    """What is known of the orbit of a point; `crossings` are those since the point before."""

    multipliers: Any
    admissible: bool
    events: tuple[float, ...]
    kinds: tuple[str, ...]
    flip: bool
    pairs: int
    inside: int
    crossings: tuple[Crossing, ...] = ()
    branch_point: Located | None = None


def examine(problem: Problem, point: Point) -> Seen:
    """Return what is to be known of a point's orbit."""
    x, p = point.y[:-1], point.y[-1:]
    multipliers = np.asarray(problem.multipliers(x, p))
    events = problem.events(x, p)
    # not from the multipliers, which may change their sign through infinity
    flip = bool(np.linalg.slogdet(problem.linearization(x, p, -1.0))[0] < 0.0)
    upper = multipliers[(multipliers.imag > 0.0) & ~_real(multipliers)]
    inside = int(np.count_nonzero(abs(upper) ** 2 <= _INSIDE))
    values = tuple(event.value for event in events)
    kinds = tuple(event.kind for event in events)
    return Seen(multipliers, problem.admissible(x, p), values, kinds, flip, len(upper), inside)


def _real(multipliers: Any) -> Any:
    return abs(multipliers.imag) <= 1e-10 * abs(multipliers)


@final
class Watch:
    """Fills in what is seen at each point, and refuses steps within which too much happens."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem

    def __call__(self, before: Point, after: Point) -> bool:
        try:
            after.seen = examine(self._problem, after)
        except NoSolution:
            return False
        way = (after.y - before.y) / before.scale
        length = float(np.sqrt(way @ way))
        if length > _SHORTEST and _appears(before.seen, after.seen):
            return False
        after.seen.crossings = crossings(before, after)
        if Crossing("BP") in after.seen.crossings:
            # with no branch point between them the two are on different branches
            located = _solved(self._problem, before, after, Crossing("BP"))
            if located is None and length > _JUMP:
                return False
            after.seen.branch_point = located
        return len(after.seen.crossings) <= 1 or length <= _SHORTEST


def _appears(before: Seen, after: Seen) -> bool:
    """Whether an event is beyond its border right where there is something to watch."""
    for a, b in zip(before.events, after.events, strict=True):
        if (a == np.inf and b < 0.0) or (b == np.inf and a < 0.0):
            return True
    return False


def crossings(before: Point, after: Point) -> tuple[Crossing, ...]:
    """Return what happens between two points of which everything is seen."""
    a, b = before.seen, after.seen
    found = []
    fold = (before.tangent[-1] < 0.0) != (after.tangent[-1] < 0.0)
    branch_point = before.turn != after.turn
    if fold:
        found.append(Crossing("SN"))
    if branch_point:
        found.append(Crossing("BP"))
    if a.flip != b.flip:
        found.append(Crossing("PD"))
    found += [Crossing("NS")] * _tori(a, b)
    for i, (kind, u, v) in enumerate(zip(a.kinds, a.events, b.events, strict=True)):
        if (u < 0.0) != (v < 0.0) and u == u and v == v:  # not where one of them tells nothing
            found.append(Crossing(kind, i))
    return tuple(found)


def _tori(before: Seen, after: Seen) -> int:
    """Return how many complex pairs enter or leave the unit circle within a step.

    Where pairs become real, or real ones a pair, the product over i < j of mu_i mu_j - 1 tells: it
    changes its sign there only when a pair is on the circle, or, real, has the product one.
    """
    if before.pairs == after.pairs:
        return abs(after.inside - before.inside)
    return int(_sign(before) != _sign(after))


def _sign(seen: Seen) -> bool:
    real = seen.multipliers[_real(seen.multipliers)].real
    products = np.outer(real, real)[np.triu_indices(len(real), 1)]
    return bool((np.count_nonzero(products <= _INSIDE) + seen.inside) % 2)


@final
class Located(NamedTuple):
    """A bifurcation that was solved for: all unknowns, and how wrong they may be."""

    crossing: Crossing
    x: Array
    own: Array
    p: Array
    error: float
    multiplier: complex | None
    direction: Any
    history: tuple[float, ...]
    seconds: float
    steps: int


def locate(
    problem: Problem, follower: Follower, before: Point, after: Point, crossing: Crossing
) -> Located | None:
    """Return a bifurcation that happens between two points; None when there is none after all.

    Newton's method is applied to its extended system. As long as it does not converge to a place
    between the points, the step is halved. When all of that fails the last step is the answer, as
    narrow as rounding allows, but for NS.
    """
    began = time.perf_counter()
    steps = 0
    for halving in range(_HALVINGS):
        if halving < 8 or halving % 8 == 0:
            known = after.seen.branch_point if crossing.kind == "BP" else None
            found = known or _solved(problem, before, after, crossing)
            if found is not None:
                seconds = time.perf_counter() - began
                return found._replace(seconds=seconds, steps=steps + len(found.history) - 1)
        way = (after.y - before.y) / before.scale
        middle = follower.at(before, 0.5 * float(np.sqrt(way @ way)))
        if middle is None:
            break
        middle.seen = examine(problem, middle)
        if crossing.kind == "NS" and halving > 8 and _far(before, after):
            return None
        steps += middle.iterations
        if crossing in crossings(before, middle):
            after = middle
        else:
            before = middle
    critical = _CRITICAL.get(crossing.kind)
    if crossing.kind == "NS" or (critical and _distance(after, crossing.kind) > _NEAR):
        return None
    error = abs(float(after.y[-1] - before.y[-1])) + 1e-15
    return Located(
        crossing,
        x=after.y[:-1],
        own=np.empty(0),
        p=after.y[-1:],
        error=error,
        multiplier=critical,
        direction=np.empty(0),
        history=(after.residual,),
        seconds=time.perf_counter() - began,
        steps=steps,
    )


def _far(before: Point, after: Point) -> bool:
    """Whether no complex pair is near the unit circle."""
    return min(_distance(before, "NS"), _distance(after, "NS")) > _NEAR


def _solved(problem: Problem, before: Point, after: Point, crossing: Crossing) -> Located | None:
    kind, event = crossing
    guess = interpolated(before, after, _part(before, after, crossing))
    own = np.empty(0)
    if kind == "NS":
        own = _angle(before, after)
        if not len(own):
            return None
    try:
        condition, own = condition_of(kind, event, problem, guess[:-1], own, guess[-1:])
        equations = BifurcationEquations(problem, condition, before.scale[-1:])
        y = np.concatenate([guess[:-1], own, guess[-1:]])
        found = correct(equations, y, equations.scale(y), steps=15)
        if not found.converged or not _within(before, after, found.y, problem.size):
            return None
        scale, jacobian = equations.scale(found.y), equations.full_jacobian(found.y)
        residual = equations.residual(found.y)
    except (NoSolution, np.linalg.LinAlgError):
        return None
    bound = error_bound(jacobian, residual, scale, None, equations.rounding)
    x, own, p = equations.split(found.y)
    if kind == "NS" and abs(np.sin(own[0])) < _FLAT:
        return None
    if kind == "BP" and abs(own[0]) > _UNFOLDED:
        return None
    error = float(bound[-1])
    if not error < _UNSURE * before.scale[-1]:
        return None
    multiplier, direction = None, np.empty(0)
    if isinstance(condition, CriticalMultiplier):
        multiplier, direction = condition.multiplier(own), condition.direction(x, own, p)
    return Located(crossing, x, own, p, error, multiplier, direction, found.history, 0.0, 0)


def _part(before: Point, after: Point, crossing: Crossing) -> float:
    """Return about where within the step it happens, from 0 to 1."""
    if crossing.kind == "SN":
        a, b = float(before.tangent[-1]), float(after.tangent[-1])
    elif crossing.event >= 0:
        a, b = before.seen.events[crossing.event], after.seen.events[crossing.event]
    else:
        a, b = _distance(before, crossing.kind), -_distance(after, crossing.kind)
    if not np.isfinite(a) or not np.isfinite(b) or a == b:
        return 0.5
    return float(min(max(a / (a - b), 0.05), 0.95))


def _distance(point: Point, kind: str) -> float:
    """Return how far the multipliers are from critical."""
    multipliers = point.seen.multipliers
    if kind == "NS":
        there = abs(abs(multipliers[~_real(multipliers)]) - 1.0)
    else:
        there = abs(multipliers - (-1.0 if kind == "PD" else 1.0))
    return float(there.min()) if len(there) else np.inf


def _angle(before: Point, after: Point) -> Array:
    """Return the angle, (1,), of the complex pair nearest to the unit circle, if there is one."""
    both = np.append(before.seen.multipliers, after.seen.multipliers)
    upper = both[(both.imag > 0.0) & ~_real(both)]
    nearest = upper[np.argsort(abs(abs(upper) - 1.0))][:1]
    return np.asarray(np.angle(nearest))


def _within(before: Point, after: Point, y: Array, m: int) -> bool:
    """Whether a place is between two points, and near the line between them."""
    place = np.append(y[:m], y[-1])
    way = (after.y - before.y) / before.scale
    gap = (place - before.y) / before.scale
    length = float(way @ way)
    along = float(gap @ way)
    slack = 1e-6 * length + 1e-9 * length**0.5
    return -slack <= along <= length + slack and float(gap @ gap) <= 2.0 * length


@final
@dataclass(frozen=True, eq=False, repr=False)
class Bifurcation:
    """A bifurcation on a branch, solved for to rounding.

    Parameters
    ----------
    kind : {"SN", "PD", "NS", "BP", "GR", "CB"}
        Saddle-node (fold), period doubling, Neimark-Sacker, branch point, grazing, chatter border.
    parameter : str
        Name of the parameter that was followed.
    value : float
        Its value there.
    error : float
        To first order a bound on the error of `value`.
    multiplier : complex or None
        The critical multiplier: 1, -1, or exp(i theta); None at GR and CB.
    direction : (m,) array
        Null vector of D(multiplier), in the unknowns of the orbit's problem; empty at GR and CB.
    place : float
        Between which points of its branch: 3.5 is between points 3 and 4.
    touching : mapping of str to float
        At GR where and when it touches, in the problem's own words.
    history : tuple of float
        Largest residual of the extended system before the first and after each Newton step.
    cost : Cost
    unknowns : (m,) array
        The solution of the equations of the orbit's problem.
    own : (e,) array
        Unknowns of the condition's own: at NS theta, at GR those of the problem's condition.
    tangent : (m + 1,) array
        Direction of the branch, the parameter last.
    event : int
        Which of the problem's events it is; -1 at SN, PD, NS and BP.
    """

    kind: str
    parameter: str
    value: float
    error: float
    multiplier: complex | None
    direction: Any
    place: float
    touching: Mapping[str, float]
    history: tuple[float, ...]
    cost: Cost
    unknowns: Array
    own: Array
    tangent: Array
    event: int
    _problem: Problem | None

    @cached_property
    def orbit(self) -> PeriodicOrbit:
        """The periodic orbit there."""
        return self.problem.orbit(self.unknowns, np.array([self.value]), self.history[-1:])

    @property
    def problem(self) -> Problem:
        """The equations of the branch.

        Raises
        ------
        ValueError
            When the branch was loaded without an orbit.
        """
        if self._problem is None:
            raise ValueError("orbit must be given to Branch.load to get orbits back; got None")
        return self._problem

    @property
    def parameters(self) -> Mapping[str, float]:
        """All parameters of the system there, by name."""
        return self.orbit.system.parameters

    def switch(self) -> list[PeriodicOrbit]:
        """Return an orbit on each branch that leaves here, near by; `continue_orbit` goes on.

        At PD it is the branch of twice the period, at BP the one that crosses, at GR those of the
        orbits with one impact more or less. SN, NS and CB have none.
        """
        from dynkit.continuation.switching import branches_at

        return branches_at(self)

    def __repr__(self) -> str:
        return f"<{self.kind} at {self.parameter} {self.value:.12g}>"
