"""Derivatives of the impacts of a chatter where rows and kicks depend on the state."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.differences import STEP
from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.itineraries.flying import TaylorFlights
from dynkit.systems.impact.orbits.machine import Machine

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.itineraries.chatter import Chatter


def varying_steps(
    chatter: Chatter, machine: Machine, flights: TaylorFlights
) -> tuple[Array, Array, Array, Array]:
    """What each flight, and the impact that ends it, make of changes (D,): see `Chatter._steps`.

    A row at the end of a flight differs from that at its begin, where the gap is zero as well. As
    late in a chatter that difference is far below rounding of rows, it is summed along the flight.
    So are the differences that changes of the numbers make of the gap.
    """
    k, r = chatter.element, machine.restitution(chatter.element)
    rates, lasts = -chatter.run.log.speed / float(r.real), np.diff(chatter.run.time, prepend=0.0)
    since = np.concatenate([chatter.start[None], chatter.after[:-1]])
    flown, added = flights.lifted(since, lasts)
    turned, moved = flights.rolled(k, since, lasts)
    n, unit = machine.size, np.eye(since.shape[1])
    gap_changed = machine.gap(k).imag / STEP
    found = []
    for i, rate in enumerate(rates.tolist()):
        push = (1.0 + r) * flights.kick(k, chatter.after[i])
        before = chatter.after[i] + rate * push.real
        (gap, row), (closing, by_rate) = flights.gap_of(k, before), flights.rate_of(k, before)
        shift, row = np.zeros(len(before)), row.real
        shift[:n] = row[:n] / (row[:n] @ row[:n])
        hit = unit - np.outer(push.real, by_rate.real)
        hit -= (1.0 + r.real) * rate * flights.turned(k, before)
        put = hit @ (unit - np.outer(shift, row))
        moving = put @ flights.rate(before)
        later = -(row @ flown[i] + turned[i]) / rate
        delay = -(row @ added[i] + flown[i] @ since[i] @ gap_changed + moved[i]) / rate
        more = put @ added[i] + moving * delay - rate * push.imag / STEP
        more -= (hit @ shift * gap.imag + push.real * closing.imag) / STEP
        found.append((put + put @ flown[i] + np.outer(moving, later), more, later, delay))
    steps, mores, laters, delays = map(np.array, zip(*found, strict=True))
    return steps, mores, laters, delays
