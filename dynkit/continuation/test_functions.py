"""Test functions: detection of bifurcations between two successive points of a branch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from dynkit.continuation.crossings import Crossing, Seen
from dynkit.continuation.defining_systems import RESONANCES
from dynkit.continuation.points import Point
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import events_of, is_admissible
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.spectrum import Spectrum

# Largest relative difference from one of the product of two multipliers of a conservative orbit.
_AREA = 1e-6


@final
@dataclass(frozen=True)
class TestFunction:
    """Detects bifurcations of one kind.

    Parameters
    ----------
    kind : BifurcationKind
    count : callable
        (point before, point) -> number of them between the two examined points.
    """

    __test__ = False
    kind: BifurcationKind
    count: Callable[[Point, Point], int]


def examine(problem: Problem, point: Point) -> Seen:
    """Return the properties of a point's orbit that test functions need."""
    x, p = point.y[:-1], point.y[-1:]
    kind, values = problem.stability, np.asarray(problem.spectrum(x, p))
    flip = False
    if kind.periodic:
        # the sign of a determinant: the sign of a multiplier may change through infinity
        flip = bool(np.linalg.slogdet(problem.pencil(x, p, -1.0))[0] < 0.0)
    upper = values[(values.imag > 0.0) & ~are_real(values)]
    inside = int(np.count_nonzero(kind.inside(upper)))
    admissible, events = is_admissible(problem, x, p), events_of(problem, x, p)
    return Seen(kind, values, admissible, events, flip, len(upper), inside)


def are_real(multipliers: Any) -> Any:
    """Return whether each multiplier or eigenvalue is real."""
    return abs(multipliers.imag) <= 1e-10 * abs(multipliers)


def crossings(before: Point, after: Point, tests: tuple[TestFunction, ...]) -> tuple[Crossing, ...]:
    """Return the bifurcations between two examined points."""
    found = []
    for test in tests:
        if count := test.count(before, after):
            found += [Crossing(test.kind)] * count
    events = zip(before.seen.events, after.seen.events, strict=True)
    for i, (here, there) in enumerate(events):
        u, v = here.value, there.value
        if (u < 0.0) != (v < 0.0) and u == u and v == v:  # a NaN has no sign
            found.append(Crossing(here.kind, i, here.ends))
    return tuple(found)


def turns(seen: Seen) -> float:
    """Return the angle of the multipliers of a conservative orbit, in turns from 0 to 1/2.

    It is 0 for positive multipliers and 1/2 for negative ones. It is NaN unless there are exactly
    two multipliers, and their product is one.
    """
    values = seen.spectrum
    if seen.kind is not Spectrum.CONSERVATIVE or len(values) != 2:
        return np.nan
    if not abs(values.prod() - 1.0) <= _AREA * max(1.0, float(abs(values[0]))):
        return np.nan
    return float(np.arccos(np.clip(0.5 * values.sum().real, -1.0, 1.0)) / (2.0 * np.pi))


def resonances(before: Seen, after: Seen) -> list[float]:
    """Return the angles of `RESONANCES` that the angle of the multipliers passes."""
    low, high = sorted((turns(before), turns(after)))
    return [each for each in RESONANCES if low <= each < high]


def _folds(before: Point, after: Point) -> int:
    return int((before.tangent[-1] < 0.0) != (after.tangent[-1] < 0.0))


def _branch_points(before: Point, after: Point) -> int:
    passed = _passed(before, after, 1.0) - _folds(before, after)
    return _several(passed, before.turn != after.turn)


def _period_doublings(before: Point, after: Point) -> int:
    return _several(_passed(before, after, -1.0), before.seen.flip != after.seen.flip)


def _several(passed: int, odd: bool) -> int:
    """Return the number of bifurcations: the count `passed` of multipliers, or 0 or 1.

    `odd` is the parity from the sign of a determinant. The count is used only if it is above one
    and has this parity, because multipliers may also change through infinity.
    """
    return passed if passed > 1 and passed % 2 == odd else int(odd)


def _passed(before: Point, after: Point, side: float) -> int:
    """Return how many real multipliers of one sign cross the border together within a step.

    The double multipliers of a symmetric system do. The count is 0 unless it equals the change of
    the number of all multipliers beyond the border. For an equilibrium these are eigenvalues.
    """
    a, b = before.seen, after.seen
    values = [seen.spectrum[~seen.kind.inside(seen.spectrum)] for seen in (a, b)]
    here, there = (int(np.count_nonzero(are_real(out) & (side * out.real > 0.0))) for out in values)
    count, more = abs(here - there), abs(len(values[0]) - len(values[1]))
    return count if count == more and a.pairs == b.pairs else 0


def _tori(before: Point, after: Point) -> int:
    return _pairs(before, after) if before.seen.kind.periodic else 0


def _oscillations(before: Point, after: Point) -> int:
    return 0 if before.seen.kind.periodic else _pairs(before, after)


def _resonances(before: Point, after: Point) -> int:
    return len(resonances(before.seen, after.seen))


def _pairs(before: Point, after: Point) -> int:
    """Return the number of complex pairs that cross the border of stability within a step.

    Where pairs become real, or real multipliers become a pair, the sign of the product over i < j
    of mu_i mu_j - 1 decides. It changes only when a pair is on the unit circle, or when two real
    multipliers have the product one. For eigenvalues the factors are the sums of two of them.
    """
    a, b = before.seen, after.seen
    if a.pairs == b.pairs:
        return abs(int(b.inside) - int(a.inside))
    return int(_sign(a) != _sign(b))


def _sign(seen: Seen) -> bool:
    real = seen.spectrum[are_real(seen.spectrum)].real
    return bool((seen.kind.pairs_inside(real) + seen.inside) % 2)


TESTS = (
    TestFunction(BifurcationKind.SN, _folds),
    TestFunction(BifurcationKind.BP, _branch_points),
    TestFunction(BifurcationKind.PD, _period_doublings),
    TestFunction(BifurcationKind.NS, _tori),
    TestFunction(BifurcationKind.HB, _oscillations),
    TestFunction(BifurcationKind.RS, _resonances),
)
"""The test functions of all kinds that are not events."""
