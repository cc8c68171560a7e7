"""Whether an orbit of one mode is a motion: no impact is missing in its flights."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynkit.systems.impact.orbits.flights import Curve
from dynkit.systems.impact.orbits.solution import SAME, follows

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.itineraries.responses import ResponseSolution


def flights_are_open(s: ResponseSolution) -> bool:
    """Whether no impact is missing.

    Proved, but where a gap only nearly closes: there simulation from just after each impact tells.
    """
    stops = range(len(s.terms.drives))
    flights = [(i, stop) for i in range(len(s.sides)) for stop in stops]
    if any(_surely_closed(s.curve(*flight)) for flight in flights):
        return False
    if all(_surely_open(s, *flight) for flight in flights):
        return True
    system, within = s.system(), SAME * s.period
    for i, state in enumerate(s.section_states):
        run = system._run(system.impact_state(state), 1, store=True)
        end = int(s.sides[s.ends(i)[1]])
        if not follows(run, s.lasts[i : i + 1], [end], within):
            return False
    return True


def _surely_closed(gap: Curve) -> bool:
    """Whether the gap is negative somewhere between the impacts, by more than rounding."""
    return min(gap.smallest[0], float(gap.nodes[1][0, 1:-1].min())) < -gap.rounding


def _surely_open(s: ResponseSolution, i: int, stop: int) -> bool:
    """Whether the gap of a stop is proved to be positive between an impact and the next.

    On each cell the quintic Hermite polynomial is wrong by at most h^6/46080 sup |f^(6)|, or by
    2 sup |f| + 2/5 h sup |f'| + h^2/20 sup |f''|, term by term; its Bernstein coefficients have
    to exceed this. At the ends it is wrong in third order only, where the gap is zero in first.
    """
    from dynkit.systems.impact.orbits.flight_kernels import least_coefficient

    curve = s.curve(i, stop)
    times, values = curve.nodes
    h = float(times[1])
    sizes = s.sizes(i, stop)
    caps = 2.0 * sizes[0] + 0.4 * h * sizes[1] + 0.05 * h * h * sizes[2]
    error = float(np.minimum(sizes[3] * h**6 / 46080.0, caps).sum())
    error += abs(s.terms.drives[stop]) * s.frequency**6 * h**6 / 46080.0
    error += curve.rounding
    # The gap itself is zero at impacts with this stop.
    first, last = (bool(s.sides[k] == stop) for k in s.ends(i))
    return bool(least_coefficient(values, h, first, last) > 1.1 * error)
