"""Divided differences of guards that are zero at an earlier event for any motion.

A soft stop is left when its gap is zero; the same gap was zero when the stop was touched. If the
stop is soon touched again, the gap was zero when it was left. A slip ends when the slip velocity is
zero, as it was when the slip began or changed its sign. A slider that has halted yields again in
the same direction when its spring has the force that it had before. So the guard of the second
event is zero at the first event for any motion, and the equation has a trivial solution with both
events at one time. The guard divided by the time between the two events, or by its square, has
no trivial solution. This equation is regular where the two events merge and the branch ends.
Motions are those of a `ShootingSolution`.
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
    """The earlier event at which a guard was zero, and the order of this zero."""

    first: int
    order: int


def pairs(oscillator: ImpactMap, itinerary: Itinerary, free: Iterable[str]) -> list[Pair | None]:
    """For each event, (n,), the earlier event at which its guard is zero for any motion, or None.

    Slip begins with zero acceleration if the static force equals the kinetic force, and if no free
    parameter changes one of them alone.
    """
    owners = {name.rpartition(".")[0] for name in free if name.rpartition(".")[2] in _FORCES}
    parted = {k for k, name in enumerate(element_names(oscillator)) if name in owners}
    found = [_pair(oscillator, itinerary, i, parted) for i in range(len(itinerary))]
    again = [
        i for i in range(len(itinerary)) if not found[i] and _returns(oscillator, itinerary, i)
    ]
    more = found.copy()
    for i in again:
        more[i] = Pair((i - 1) % len(itinerary), 1)
    # differences alone determine none of the guards of which each is zero at another event
    return [found[i] if i in again and _closes(more, i) else pair for i, pair in enumerate(more)]


def _returns(oscillator: ImpactMap, itinerary: Itinerary, i: int) -> bool:
    """Whether an event is the return of a guard to zero, where it was at the event before."""
    event, other = itinerary[i], itinerary[i - 1]
    if event.element != other.element or event.element < 0 or event.kicked or other.kicked:
        return False
    own, before = watch_of(oscillator, event), watch_of(oscillator, other)
    if own.force or before.force or own.normal or before.normal:
        return False  # forces of constraints may jump
    one, two = (np.array([w.gap, w.rate, w.stretch, w.level]) for w in (own, before))
    opposite = float(one @ two) < 0.0
    return opposite and bool((abs(one * abs(two).max() + two * abs(one).max()) == 0.0).all())


def _closes(found: list[Pair | None], i: int) -> bool:
    """Whether the pairs lead on from an event without end."""
    for _ in found:
        if (pair := found[i]) is None:
            return False
        i = pair.first
    return True


_FORCES = "force", "static", "coefficient"
"""Parameters of friction that may make static and kinetic force differ."""


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
    """The pair for a slider that yields again in the direction before its halt, without impact."""
    n, k = len(itinerary), itinerary[i].element
    for back in range(1, n):
        halt = itinerary[(i - back) % n]
        if number := halt.mode.numbers[k]:
            slid = number == to and not halt.kicked and watch_of(oscillator, halt).rate
            return Pair((i - back) % n, 2 if back == 1 else 1) if slid else None
    return None


def watch_of(oscillator: ImpactMap, event: Happening) -> Any:
    """The guard that is zero at an event."""
    regimes = oscillator._elements[event.element].regimes
    return regimes[event.mode.numbers[event.element]].guards[event.guard]


def _between(s: Any, i: int, pair: Pair) -> list[int]:
    """Numbers of the events whose following flights lie between the two events of a pair."""
    n = s.events
    return [k % n for k in range(pair.first, i if pair.first < i else i + n)]


def value(s: Any, i: int, pair: Pair) -> Any:
    """The guard of event `i` over the time since the first event, to the power of the order."""
    among = _between(s, i, pair)
    if (whole := _whole(s, among)) is None:
        return s.quotient(among[0], i, pair.order)
    return sum(s.rise(j, i) for j in among) / whole


def derivatives(s: Any, i: int, pair: Pair) -> Iterator[tuple[int, Array, float]]:
    """Yield, for each flight between: its number, and derivatives of `value`.

    They are the derivatives by the state (D,) at the begin of the flight, and by its duration.
    """
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
    """Bound of the rounding error of `value`, to first order."""
    found = max(s.quotient_rounding(j, i, pair.order) for j in _between(s, i, pair))
    return float(found + sum(abs(by) * s.late[j] for j, _, by in derivatives(s, i, pair)))


def _whole(s: Any, among: list[int]) -> Any:
    """The time between the two events; None if it is one flight, or if it is zero.

    If several flights of duration zero lie between, the quotient of the first one serves: a gap
    that is touched with zero force has the same acceleration in all modes that merge there.
    """
    whole = sum(s.durations[j] for j in among)
    return None if len(among) == 1 or whole == 0.0 else whole
