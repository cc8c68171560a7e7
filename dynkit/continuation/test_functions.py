"""What happens between two successive points of a branch."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynkit.continuation.arclength import Point
from dynkit.continuation.crossings import Crossing, Seen
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.problem import Problem

# Squares of moduli, and products, up to here count as inside the unit circle: more is rounding.
_INSIDE = 1.0 + 1e-9
# What stands for infinite multipliers in products.
_HUGE = 1e150


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


def crossings(before: Point, after: Point) -> tuple[Crossing, ...]:
    """Return what happens between two points of which everything is seen."""
    a, b = before.seen, after.seen
    found = []
    fold = (before.tangent[-1] < 0.0) != (after.tangent[-1] < 0.0)
    branch_point = before.turn != after.turn
    if fold:
        found.append(Crossing(BifurcationKind.SN))
    if branch_point:
        found.append(Crossing(BifurcationKind.BP))
    if a.flip != b.flip:
        found.append(Crossing(BifurcationKind.PD))
    found += [Crossing(BifurcationKind.NS)] * _tori(a, b)
    for i, (here, there) in enumerate(zip(a.events, b.events, strict=True)):
        u, v = here.value, there.value
        if (u < 0.0) != (v < 0.0) and u == u and v == v:  # not where one of them tells nothing
            found.append(Crossing(here.kind, i, here.ends))
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
    real = seen.multipliers[are_real(seen.multipliers)].real
    real = np.clip(real, -_HUGE, _HUGE)  # infinite where an orbit grazes
    products = np.outer(real, real)[np.triu_indices(len(real), 1)]
    return bool((np.count_nonzero(products <= _INSIDE) + seen.inside) % 2)
