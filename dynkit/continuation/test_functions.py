"""Test functions: what happens between two successive points of a branch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from dynkit.continuation.crossings import Crossing, Seen
from dynkit.continuation.points import Point
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.problem import Problem

# Squares of moduli, and products, up to here count as inside the unit circle: more is rounding.
_INSIDE = 1.0 + 1e-9
# What stands for infinite multipliers in products.
_HUGE = 1e150


@final
@dataclass(frozen=True)
class TestFunction:
    """Notices bifurcations of one kind.

    Parameters
    ----------
    kind : BifurcationKind
    count : callable
        (point before, point) -> how many of them are between the two; of each its `Seen` is known.
    """

    __test__ = False
    kind: BifurcationKind
    count: Callable[[Point, Point], int]


def examine(problem: Problem, point: Point) -> Seen:
    """Return what is to be known of a point's orbit."""
    x, p = point.y[:-1], point.y[-1:]
    multipliers = np.asarray(problem.multipliers(x, p))
    events = tuple(problem.events(x, p))
    # not from the multipliers, which may change their sign through infinity
    flip = bool(np.linalg.slogdet(problem.linearization(x, p, -1.0))[0] < 0.0)
    upper = multipliers[(multipliers.imag > 0.0) & ~are_real(multipliers)]
    inside = int(np.count_nonzero(abs(upper) ** 2 <= _INSIDE))
    return Seen(multipliers, problem.admissible(x, p), events, flip, len(upper), inside)


def are_real(multipliers: Any) -> Any:
    """Return which multipliers are real."""
    return abs(multipliers.imag) <= 1e-10 * abs(multipliers)


def crossings(before: Point, after: Point, tests: tuple[TestFunction, ...]) -> tuple[Crossing, ...]:
    """Return what happens between two points of which everything is seen."""
    found = []
    for test in tests:
        found += [Crossing(test.kind)] * test.count(before, after)
    events = zip(before.seen.events, after.seen.events, strict=True)
    for i, (here, there) in enumerate(events):
        u, v = here.value, there.value
        if (u < 0.0) != (v < 0.0) and u == u and v == v:  # not where one of them tells nothing
            found.append(Crossing(here.kind, i, here.ends))
    return tuple(found)


def _folds(before: Point, after: Point) -> int:
    return int((before.tangent[-1] < 0.0) != (after.tangent[-1] < 0.0))


def _branch_points(before: Point, after: Point) -> int:
    return int(before.turn != after.turn)


def _period_doublings(before: Point, after: Point) -> int:
    return int(before.seen.flip != after.seen.flip)


def _tori(before: Point, after: Point) -> int:
    """Return how many complex pairs enter or leave the unit circle within a step.

    Where pairs become real, or real ones a pair, the product over i < j of mu_i mu_j - 1 tells: it
    changes its sign there only when a pair is on the circle, or, real, has the product one.
    """
    a, b = before.seen, after.seen
    if a.pairs == b.pairs:
        return abs(int(b.inside) - int(a.inside))
    return int(_sign(a) != _sign(b))


def _sign(seen: Seen) -> bool:
    real = seen.multipliers[are_real(seen.multipliers)].real
    real = np.clip(real, -_HUGE, _HUGE)  # infinite where an orbit grazes
    products = np.outer(real, real)[np.triu_indices(len(real), 1)]
    return bool((np.count_nonzero(products <= _INSIDE) + seen.inside) % 2)


TESTS = (
    TestFunction(BifurcationKind.SN, _folds),
    TestFunction(BifurcationKind.BP, _branch_points),
    TestFunction(BifurcationKind.PD, _period_doublings),
    TestFunction(BifurcationKind.NS, _tori),
)
"""The test functions of periodic orbits."""
