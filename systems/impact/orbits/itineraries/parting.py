"""Simultaneous events: which of them a parameter separates, and their order afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import JUMP
from dynkit.systems.impact.orbits.itineraries.happening import Happening
from dynkit.systems.impact.orbits.itineraries.itinerary import regimes_of
from dynkit.systems.impact.orbits.itineraries.motion import SAME
from dynkit.systems.impact.orbits.machine import Regimes

_PARTS = 1e-6
"""Events whose phases separate by less, along a tangent of length one, stay simultaneous."""


_NO_VALUES = np.empty(0)

_LIKE = 1e-9
"""Largest residual, and relative difference of monodromy matrices, of orbits that are the same."""


def at_once(system: Any, event: Happening, after: Regimes) -> list[Happening]:
    """Return a slider's event and those of other sliders that yield or halt with it, in order."""
    k, now, found = event.element, event.mode, [event]
    if event.kicked or k not in system._parts.sliders:
        return found
    changed = {j for j in system._parts.sliders if now.numbers[j] != after.numbers[j]}
    done = [k]
    for j in sorted(changed - {k}):
        watches = enumerate(system._elements[j].regimes[now.numbers[j]].guards)
        own = [g for g, w in watches if w.to == after.numbers[j] and w.event != JUMP]
        if own:
            found.append(Happening(_moved(system, now, after, done), j, own[0]))
            done.append(j)
    return found


def _moved(system: Any, mode: Regimes, after: Regimes, done: Sequence[int]) -> Regimes:
    """Return a mode in which some elements already have their regimes of a later mode."""
    numbers = list(mode.numbers)
    for j in done:
        numbers[j] = after.numbers[j]
    return regimes_of(system, numbers)


def parted(problem: Any, x: Array, way: float) -> tuple[Any, Array]:
    """Return equations and unknowns with simultaneous slider events in their order beyond a point.

    Events whose phases separate as the parameter changes become separate events.

    Parameters
    ----------
    problem : ItineraryEquations
        With one free parameter.
    x : (m,)
        A solution.
    way : float
        Positive for the order at larger values of the parameter, negative for smaller ones.
    """
    s, system = problem.at(x, problem.values), problem.oscillator
    pairs = zip(problem.itinerary, s.following, strict=True)
    groups = [at_once(system, event, after.mode) for event, after in pairs]
    if all(len(group) == 1 for group in groups):
        return problem, x
    stations = problem._stations(s)

    def of(orders: list[list[list[Happening]]]) -> tuple[Any, Array]:
        """Return the equations in which each group of events is split into successive parts."""
        found = []
        for station, order, after in zip(stations, orders, s.following, strict=True):
            first = station.event
            done: list[int] = []
            for part in order:
                mode = _moved(system, first.mode, after.mode, done) if done else first.mode
                event = part[0]._replace(mode=mode)
                node = station.node and not done
                found.append(station._replace(event=event, node=node))
                done += [event.element for event in part]
        there: tuple[Any, Array] = problem._of(x, found)
        return there

    whole, y = of([[[event] for event in group] for group in groups])
    speeds = iter(_speeds(whole, y, way))
    return of([_in_parts(group, [next(speeds) for _ in group]) for group in groups])


def _speeds(problem: Any, x: Array, way: float) -> list[float]:
    """Changes (n,) of the phases of events along the unit tangent of a branch."""
    p, scale = problem.values, problem.scale(x)
    matrix = problem.linearization(x, p) * scale
    by = problem.parameter_derivative(x, p) * np.maximum(abs(p), 1.0)
    tangent = np.linalg.svd(np.hstack([matrix, by]))[2][-1]
    tangent *= way * (np.sign(tangent[-1]) or 1.0)
    speeds = (tangent[:-1] * scale)[: problem.layout.events]
    if not problem.driven:
        speeds[0] = 0.0
    return list(speeds.tolist())


def _in_parts(group: list[Happening], speeds: list[float]) -> list[list[Happening]]:
    """Sort a group of events by the changes of their phases; simultaneous ones form one part."""
    parts: list[list[Happening]] = []
    last = -np.inf
    for speed, event in sorted(zip(speeds, group, strict=True), key=lambda own: own[0]):
        if speed - last > _PARTS:
            parts.append([])
        parts[-1].append(event)
        last = speed
    return parts


def reversed_order(problem: Any, x: Array, p: Array, i: int) -> tuple[Any, Array] | None:
    """Return the same motion with all simultaneous events in reverse order.

    In a symmetric machine several pairs may be simultaneous. None if event `i` and the next cannot
    be exchanged, because one begins a contact, or ends one that began with impacts.
    """
    s = problem.at(x, p)
    stations, moved = _in_order(problem, s, [run[::-1] for run in _runs(s)])
    return problem._of(x, stations) if i in moved else None


def commute(problem: Any, x: Array, i: int) -> bool:
    """Whether event `i` and the next, which are simultaneous, may be in either order.

    Then the orbit and its monodromy matrix are the same in both orders, as in a symmetric machine.
    """
    turned = reversed_order(problem, x, _NO_VALUES, i)
    if turned is None:
        return False
    left = [abs(one.residual(z, _NO_VALUES)).max() for one, z in ((problem, x), turned)]
    found = [one.monodromy(z, _NO_VALUES) for one, z in ((problem, x), turned)]
    sizes = 1.0 + abs(np.array(found)).max()
    return bool(max(left) < _LIKE and abs(np.subtract(*found)).max() < _LIKE * sizes)


def ordered(problem: Any, x: Array, way: float) -> tuple[Any, Array]:
    """Return the same motion with simultaneous events in their order beyond: see `parted`.

    It is unchanged if its order already is the order on one of the two sides.
    """
    s = problem.at(x, problem.values)
    if not (runs := _runs(s)):
        return problem, x
    speeds = _speeds(problem, x, way)
    orders, other = (
        [sorted(run, key=lambda k: round(way * speeds[k] / _PARTS)) for run in runs]
        for way in (1.0, -1.0)
    )
    if runs in (orders, other):
        return problem, x
    found: tuple[Any, Array] = problem._of(x, _in_order(problem, s, orders)[0])
    return found


def _in_order(problem: Any, s: Any, orders: list[list[int]]) -> tuple[list[Any], set[int]]:
    """Return the stations of an itinerary with its runs in given orders, and the places changed.

    A run of events that cannot have the given order stays as it is.
    """
    own, moved = problem._stations(s), set[int]()
    stations = own.copy()
    for run, order in zip(_runs(s), orders, strict=True):
        events = _events_in(problem, s, run, order) if order != run else []
        for n, k, event in zip(run, order, events, strict=False):
            stations[n] = own[n]._replace(event=event, impulse=own[k].impulse)
            moved.add(n)
    return stations, moved


def _runs(s: Any) -> list[list[int]]:
    """Numbers of simultaneous events, as a list of runs."""
    n, near = s.events, abs(s.durations) <= SAME * s.period
    first = next((k + 1 for k in range(n) if not near[k]), 0)
    runs: list[list[int]] = []
    for k in range(first, first + n):
        if k == first or not near[(k - 1) % n]:
            runs.append([])
        runs[-1].append(k % n)
    return [run for run in runs if len(run) > 1]


def _events_in(problem: Any, s: Any, run: list[int], order: list[int]) -> list[Happening]:
    """Return the events of a run in another order; empty if this order is not possible."""
    events, mode = [s.itinerary[k] for k in run], s.itinerary[run[0]].mode
    own = [event.element for event in events]
    regimes = zip(events, own, strict=True)
    apart = len(set(own)) == len(own) and min(own) >= 0
    same = all(e.mode.numbers[k] == mode.numbers[k] for e, k in regimes)
    begins = any(event.chatters for event in events)
    if begins or not (apart and same) or (problem.sticks and set(run) & set(problem.nodes)):
        return []
    found, numbers = [], mode.numbers

    def changed(event: Happening, to: Regimes) -> tuple[int, ...]:
        """The current regimes, changed as an event changes its own."""
        pairs = zip(numbers, event.mode.numbers, to.numbers, strict=True)
        return tuple(after if after != before else now for now, before, after in pairs)

    for k in order:
        event = s.itinerary[k]
        kicked = event.kicked and regimes_of(problem.oscillator, changed(event, event.kicked))
        now = regimes_of(problem.oscillator, numbers)
        found.append(event._replace(mode=now, kicked=kicked))
        numbers = changed(event, s.following[k].mode)
    return found
