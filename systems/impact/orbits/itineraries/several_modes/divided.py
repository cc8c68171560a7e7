"""Divided differences of guards that are zero by nature at an earlier event.

A soft stop is left where the gap is zero that was zero where it was touched; what begins to slip is
halted where the rate of slip is zero that was zero before; a slider that was halted yields again in
the same direction where its spring bears what it bore before. With the second event at the time of
the first one the guard is zero whatever the motion: a trivial solution, which the equation divided
by the time between the two, or by its square, has not. So it is regular where the two events merge,
and the branch ends. Motions are those of a `ShootingSolution`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.itineraries.happening import Happening, Itinerary
from dynkit.systems.impact.records.event_counts import element_names

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap


class Pair(NamedTuple):
    """The event at which a guard was zero, and how many of its derivatives were, with itself."""

    first: int
    order: int


def pairs(oscillator: ImpactMap, itinerary: Itinerary, free: Iterable[str]) -> list[Pair | None]:
    """Of each event, (n,), the one before it at which its guard was zero by nature.

    Slip begins without acceleration where the static force is the kinetic one, unless a parameter
    that is free makes them differ.
    """
    owners = {name.rpartition(".")[0] for name in free if name.rpartition(".")[2] in _FORCES}
    parted = {k for k, name in enumerate(element_names(oscillator)) if name in owners}
    return [_pair(oscillator, itinerary, i, parted) for i in range(len(itinerary))]


_FORCES = "force", "static", "coefficient"


def _pair(oscillator: ImpactMap, itinerary: Itinerary, i: int, parted: set[int]) -> Pair | None:
    event, n = itinerary[i], len(itinerary)
    if event.element < 0 or event.kicked:
        return None
    own = watch_of(oscillator, event)
    if own.stretch:
        return _slipped(oscillator, itinerary, i, own.to)
    for back in range(1, n):
        first = (i - back) % n
        other = itinerary[first]
        if other.element != event.element or other.kicked:
            continue
        before = watch_of(oscillator, other)
        sticks = other.element in other.mode.held
        if sticks and back == 1 and own.rate and not (own.gap or own.force):
            curved = oscillator._elements[event.element].curved
            straight = not curved and event.element not in parted
            return Pair(first, max(before.order * straight, 1))
        gaps = own.gap < 0.0 < before.gap and not any(
            watch.rate or watch.force for watch in (own, before)
        )
        if gaps and math.isclose(own.level * before.gap, before.level * own.gap, abs_tol=0.0):
            return Pair(first, 1)
    return None


def _slipped(oscillator: ImpactMap, itinerary: Itinerary, i: int, to: int) -> Pair | None:
    """The halt of a slider that then yields again in the same direction, where nothing is hit."""
    n, k = len(itinerary), itinerary[i].element
    for back in range(1, n):
        halt = itinerary[(i - back) % n]
        if number := halt.mode.numbers[k]:
            slid = number == to and not halt.kicked and watch_of(oscillator, halt).rate
            return Pair((i - back) % n, 2 if back == 1 else 1) if slid else None
    return None


def watch_of(oscillator: ImpactMap, event: Happening) -> Any:
    """What is zero at an event."""
    regimes = oscillator._elements[event.element].regimes
    return regimes[event.mode.numbers[event.element]].guards[event.guard]


def _between(s: Any, i: int, pair: Pair) -> list[int]:
    """Numbers of the events after which there is a part of the time between."""
    n = s.events
    return [k % n for k in range(pair.first, i if pair.first < i else i + n)]


def value(s: Any, i: int, pair: Pair) -> Any:
    """The guard of event `i`, over the time since the first one, to the power of the order."""
    among = _between(s, i, pair)
    if (whole := _whole(s, among)) is None:
        return s.quotient(among[0], i, pair.order)
    return sum(s.rise(j, i) for j in among) / whole


def derivatives(s: Any, i: int, pair: Pair) -> Iterator[tuple[int, Array, float]]:
    """Derivatives of it by each state (D,) just after an event, and by the time to the next."""
    among = _between(s, i, pair)
    if (whole := _whole(s, among)) is None:
        by_state, by_time = s.quotient_change(among[0], i, pair.order)
        yield among[0], by_state, by_time
        yield from ((j, np.zeros_like(by_state), by_time) for j in among[1:])
        return
    ratio = value(s, i, pair)
    for j in among:
        by_time = s.guard_at(i, s.reached[j])[1] @ s.moving[j]
        yield j, s.rise_change(j, i) / whole, float((by_time - ratio) / whole)


def rounding(s: Any, i: int, pair: Pair) -> float:
    """What rounding may make of the value, to first order."""
    found = max(s.quotient_rounding(j, i, pair.order) for j in _between(s, i, pair))
    return float(found + sum(abs(by) * s.late[j] for j, _, by in derivatives(s, i, pair)))


def _whole(s: Any, among: list[int]) -> Any:
    """The time between; None where one flow passes it, or where none does, as where all merge.

    A gap that is touched with the force zero has one acceleration in all modes that merge there.
    """
    whole = sum(s.durations[j] for j in among)
    return None if len(among) == 1 or whole == 0.0 else whole
