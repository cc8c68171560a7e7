"""Whether a solution P(n,m) is a motion: no impact is missing in its flights."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dynkit.systems.impact.orbits.flights import Curve, Flight
from dynkit.systems.impact.orbits.impulses.solution import ImpulseSolution
from dynkit.systems.impact.orbits.solution import SAME, follows

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap


def flights_are_open(oscillator: Callable[[], ImpactMap], solution: ImpulseSolution) -> bool:
    """Whether no impact is missing.

    Proved, but where a gap only nearly closes: there simulation from just after each impact tells.
    """
    if any(_surely_closed(flight.gap) for flight in solution.flights):
        return False
    if all(_surely_open(solution, flight) for flight in solution.flights):
        return True
    system, within = oscillator(), SAME * solution.period
    for flight, state in zip(
        solution.flights[:: solution.stops], solution.section_states, strict=True
    ):
        run = system._run(system.impact_state(state), 1, store=True)
        end = int(solution.sides[flight.end])
        if not follows(run, np.array([flight.gap.lasts]), [end], within):
            return False
    return True


def _surely_closed(gap: Curve) -> bool:
    """Whether the gap is negative somewhere between the impacts, by more than rounding."""
    return min(gap.smallest[0], float(gap.nodes[1][0, 1:-1].min())) < -gap.rounding


def _surely_open(solution: ImpulseSolution, flight: Flight) -> bool:
    """Whether the gap is proved to be positive between the impacts.

    On each cell the quintic Hermite polynomial is wrong by at most h^6/46080 sup |f^(6)|, or by
    2 sup |f| + 2/5 h sup |f'| + h^2/20 sup |f''|, term by term; its Bernstein coefficients have
    to exceed this. At the ends it is wrong in third order only, where the gap is zero in first.
    """
    times, (gap, rate, bend) = flight.gap.nodes
    h = float(times[1])
    sizes, t = solution.sizes(flight.start), solution.terms
    caps = 2.0 * sizes[0] + 0.4 * h * sizes[1] + 0.05 * h * h * sizes[2]
    error = float(np.minimum(sizes[3] * h**6 / 46080.0, caps).sum())
    error += abs(t.drive) * t.frequency**6 * h**6 / 46080.0
    error += flight.gap.rounding
    left = np.array([gap, gap + 0.2 * h * rate, gap + h * (0.4 * rate + 0.05 * h * bend)])
    right = np.array([gap, gap - 0.2 * h * rate, gap - h * (0.4 * rate - 0.05 * h * bend)])
    left, right = left[:, :-1], right[:, 1:]
    # The gap itself is zero at impacts with this stop.
    own = solution.sides == flight.side
    if own[flight.start]:
        left[0, 0] = math.inf
    if own[flight.end]:
        right[0, -1] = math.inf
    return bool(min(left.min(), right.min()) > 1.1 * error)
