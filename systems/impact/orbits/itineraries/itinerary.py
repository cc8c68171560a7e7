"""Itineraries: the modes of a periodic motion in their order, and the events that join them."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynkit.core.kept import cached_property, kept
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoConvergence
from dynkit.systems.impact.elements.element import HALT, JUMP, EventKind
from dynkit.systems.impact.elements.laws import ImpactLaw
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.orbits.itineraries.flying import Flights, flights_of, number_of, same
from dynkit.systems.impact.orbits.itineraries.happening import Happening, Itinerary
from dynkit.systems.impact.orbits.machine import Machine, Regimes, machine_of
from dynkit.systems.impact.records.event_counts import element_names
from dynkit.systems.impact.simulation.joined_modes import cycled_by, halts
from dynkit.systems.impact.simulation.state import turning, whole_states
from dynkit.systems.impact.simulation.trajectory import Ending, Trajectory

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

_AT_ONCE = 2.0**-40
"""Events within this fraction of the run (at least of 1/frequency) are simultaneous."""

_ZERO = 1e-6
"""Relative size below which a guard is zero: |guard| <= _ZERO * (sum of its largest terms)."""

_SLOW = 1e-9
"""Velocity at which the rebound of slow impacts is decided."""

_STILL = 1e-9
"""Coordinates below this fraction of the largest one are zero up to rounding."""

_SAME = 1e-2
"""Largest relative difference of states one period apart for which a motion is a cycle."""


class Course:
    """An itinerary with numbers of its events that are often used.

    Attributes
    ----------
    itinerary : tuple of Happening
    following : tuple of Happening
        The event after each event, cyclically.
    hits : list of int
        Numbers of the events that are impacts.
    impulse_of : dict
        The number of the impulse, by the number of the event.
    sides : (k,)
        Number of the stop that each impact hits.
    kinds : (n,)
        Numbers that are different for different kinds of events.
    signs : (n,)
        Weights of impulses that are different for different stops.
    nodes : tuple of int
        Numbers of the events before which the state is unknown; the releases of P(inf,m).
    sticks : bool
        Whether contact with a stop begins with an impact.
    """

    def __init__(self, itinerary: Itinerary, nodes: tuple[int, ...]) -> None:
        self.itinerary, self.nodes = itinerary, nodes
        self.following: Itinerary = *itinerary[1:], itinerary[0]
        self.hits = [i for i, event in enumerate(itinerary) if event.kicked]
        self.impulse_of = dict(zip(self.hits, range(len(self.hits)), strict=True))
        self.sides: Any = np.array([itinerary[i].element for i in self.hits], dtype=np.intp)
        self.kinds = np.array([_kind(event) for event in itinerary])
        self.signs = np.array([1.0 - 2.0 * event.element for event in itinerary])
        self.sticks = any(event.chatters for event in itinerary)

    @cached_property
    def releases(self) -> tuple[int, ...]:
        """Numbers of the events that end contact with a stop."""
        return tuple(releases_in(self.itinerary, self.following))

    def node_before(self, i: int) -> int:
        """Number of the last node up to event `i`."""
        return bisect_right(self.nodes, i) - 1


def _kind(event: Happening) -> float:
    regimes = sum(k * number for k, number in enumerate(event.mode.numbers, 1))
    return event.element + 0.37 * event.guard + 0.11 * regimes


class Seen(NamedTuple):
    """Events of a simulated motion: times (k,), the events, states (k, 2N + J) just before."""

    times: Array
    events: Itinerary
    states: Array

    @property
    def releases(self) -> list[int]:
        """Numbers of the events that end contact with a stop."""
        return releases_in(self.events, self.events[1:])

    def part(self, low: int, high: int) -> Seen:
        """The events from number `low` to before number `high`."""
        return Seen(self.times[low:high], self.events[low:high], self.states[low:high])


def has_law(oscillator: ImpactMap) -> bool:
    """Whether a stop has an impact law."""
    return any(isinstance(stop.restitution, ImpactLaw) for stop in oscillator._stops)


def regimes_of(oscillator: ImpactMap, numbers: Sequence[int]) -> Regimes:
    """A mode of an oscillator: what holds in it, and what is watched."""
    return _regimes(oscillator._automaton, tuple(numbers))


def with_regime(oscillator: ImpactMap, mode: Regimes, element: int, number: int) -> Regimes:
    """The mode in which an element has another regime."""
    numbers = [number if k == element else own for k, own in enumerate(mode.numbers)]
    return regimes_of(oscillator, oscillator._parts.settled(numbers))


@kept
def _regimes(automaton: Any, numbers: tuple[int, ...]) -> Regimes:
    mode, parts = automaton.mode(numbers), automaton.parts
    now, watched = parts.now(numbers), []
    for guard in automaton.guards:
        k = guard.element
        rests = now[k].halts and numbers[k] == 0
        if automaton.modes[guard.mode] is mode and guard.watch.event != JUMP and not rests:
            watched.append((k, number_of(now[k].guards, guard.watch)))
    return Regimes(numbers, tuple(sorted(sum(parts.grips(numbers), ()))), tuple(watched))


def events_seen(
    oscillator: ImpactMap,
    run: Trajectory,
    named: bool = True,
    until: float = math.inf,
    machine: Machine | None = None,
) -> Seen:
    """Return the events of a motion that end modes, up to a time.

    Changes of regime that an event causes at the same time are no events. Sliders that yield
    simultaneously, as equal ones do, are one event: that of the first slider.

    If `named`, only the first impacts of a chatter are events, between which the motion is not
    smooth: see `Happening.chatters`. Otherwise all its impacts are events, and contact is another
    one.
    """
    automaton, machine = oscillator._automaton, machine or machine_of(oscillator)
    contact, strobed, parts = EventKind.CONTACT, oscillator._strobed, run.segments
    soft = oscillator._elements[len(oscillator._stops) :]
    for mode in np.unique(parts.mode).tolist():
        own = automaton.parts.now(run.regimes[mode])[len(oscillator._stops) :]
        if any(regime.holds for regime in own):
            raise NotImplementedError(
                f"orbits by itinerary must not rest on a preloaded stop; got {soft!r}: "
                "dynkit.periodic_orbit finds orbits of the map"
            )

    @cache
    def mode_of(number: int) -> Regimes:
        return regimes_of(oscillator, run.regimes[number])

    @cache
    def watched(before: int, guard: Any) -> tuple[Regimes, int, Flights]:
        mode = mode_of(before)
        guards = automaton.parts.now(run.regimes[before])[guard.element].guards
        return mode, _lasting(guards, guard.watch), flights_of(oscillator, machine, mode)

    times: list[float] = []
    events: list[Happening] = []
    states: list[Array] = []
    at_once = _AT_ONCE * max(run.duration, 1.0 / oscillator.frequency)
    last, lasting, now = -np.inf, parts.mode[0], set[int]()
    reached, amid = _reached(run)
    # a coordinate may be zero at all events: half-way states give its size as well
    sizes = np.maximum(abs(reached), abs(amid)).max(axis=0, initial=0.0)
    own = zip(parts.kind.tolist(), parts.begin.tolist(), parts.guard.tolist(), strict=True)
    modes = parts.mode.tolist()
    for k, (kind, begin, at) in enumerate(own):
        hit = kind == EventKind.IMPACT
        if k == 0 or (hit and strobed) or begin <= at_once:
            continue  # begin of a period, or a change of regime at the start of the motion
        before = modes[k - 1]
        if begin > until:
            break
        guard = automaton.guards[at]
        if kind == contact and parts.speed[k] > 0.0:
            if named:
                _name(machine, guard.element, (times, events, states), run)
            else:
                times.append(begin)
                events.append(Happening(mode_of(before), guard.element, -1, chatters=True))
                states.append(reached[k - 1][:-3])
            last, now = begin, {guard.element}
            continue
        hits = events[-1].element if events and events[-1].kicked else -1
        if kind == contact and hits == guard.element and hits in now:
            events[-1] = events[-1]._replace(chatters=True)
        if begin - last > at_once:
            lasting, now = before, set()
        elif not now:
            before = lasting
        last = begin
        (mode, number, moving), z = watched(before, guard), reached[k - 1]
        if not hit:
            if number < 0:
                continue
            value, row = moving.observed(guard.element, number, z)
            if (
                guard.element in now
                or (guard.element in machine.sliders and now.intersection(machine.sliders))
                or abs(value) > _ZERO * (abs(row) @ sizes)
            ):
                continue
        kicked = mode_of(modes[k - 1]) if hit else None
        if now and hit:
            mode = kicked or mode
        now.add(guard.element)
        times.append(begin)
        found = Happening(mode, guard.element, number, kicked)
        events.append(_outcome(machine, moving, found, guard, z) if kicked else found)
        states.append(z[:-3])
    shape = len(times), machine.size + oscillator._size
    return Seen(np.array(times), tuple(events), np.array(states).reshape(shape))


def _lasting(guards: Sequence[Any], watch: Any) -> int:
    """Number of the guard of a regime that is zero at an event; -1 if there is none.

    A guard of kind JUMP is replaced by the guard of another kind with the same weights: a slip that
    ends during another event may be found reversed rather than at its zero.
    """
    if watch.event != JUMP:
        return number_of(guards, watch)
    lasting = (
        k
        for k, own in enumerate(guards)
        if own.event != JUMP and same(replace(own, to=watch.to), watch)
    )
    return next(lasting, -1)


def _outcome(
    machine: Machine, flights: Flights, event: Happening, guard: Any, z: Array
) -> Happening:
    """Return an impact with the piece of its law, and its friction, from the state just before.

    Raises
    ------
    NoConvergence
        When the masses do not determine the effect of friction.
    """
    stop, mode = guard.element, event.kicked
    law: Any = machine.elements[stop].restitution
    if isinstance(law, ImpactLaw):
        return event._replace(piece=law.piece(-float(flights.rate_of(stop, z)[0])))
    if mode is None or stop not in machine.normal.values():
        return event
    found = flights.rubs(guard, z)
    if found is None:
        raise NoConvergence(
            "no periodic orbit found: masses leave open what friction does at an impact; got "
            f"{machine.elements[stop]!r}"
        )
    jump = -(1.0 + machine.restitution(stop)) * float(flights.rate_of(stop, z)[0])
    slips = [(k, float(flights.rate_of(k, z)[0])) for k in found]
    return event._replace(rubs=tuple((k, way(w, flights.takes(k, z) * jump)) for k, w in slips))


def way(slip: float, taken: float) -> int:
    """Sign of a slip velocity; 0 if an impact can take all of it, that is `taken` or less."""
    return 0 if abs(slip) <= taken else int(math.copysign(1.0, slip))


def _name(
    machine: Machine,
    k: int,
    seen: tuple[list[float], list[Happening], list[Array]],
    run: Trajectory,
) -> None:
    """Remove, in place, the last impacts of a chatter, between which the motion is smooth.

    Between these impacts the gap's acceleration is negative and changes by less than half of its
    size, and each flight is shorter than the one before.
    """
    times, events, states = seen
    if not events or events[-1].element != k:
        raise NoConvergence("no periodic orbit found: a chatter begins with another stop's impact")
    last, n = events[-1], len(events)
    begin = n - 1
    while begin and events[begin - 1] == last:
        begin -= 1
    phases = run.start.phase + run.start._system.frequency * np.array(times[begin:])
    z = np.concatenate([np.array(states[begin:]), turning(phases)], axis=1)
    moving = flights_of(run.start._system, machine, last.mode)
    rates = np.array([moving.rate_of(k, state)[0] for state in z])
    jumps = -(1.0 + machine.rebounds(k, rates)[0]) * rates
    kicks = [moving.kick(k, state, last.rubs) for state in z]
    z = z + jumps[:, None] * np.array(kicks)
    z = np.array([moving.stopped(last.rubs, state)[0] for state in z])
    bends = np.array([moving.rate_of(k, state)[1] for state in z])
    pressing = -(moving.rates(z) * bends).sum(axis=1)
    flights, change = np.diff(times[begin:]), abs(np.diff(pressing))
    smooth = np.minimum(pressing[:-1], pressing[1:]) > 2.0 * change
    smooth[1:] &= flights[1:] < flights[:-1]
    rough = np.flatnonzero(~smooth)
    keep = begin + (int(rough[-1]) + 2 if len(rough) else 1)
    for part in seen:
        del part[keep:]
    events[-1] = last._replace(chatters=True)


def _reached(run: Trajectory) -> Array:
    """States (2, k, D) just before all events, and half-way between events."""
    parts, system, between = run.segments, run.start._system, np.diff(run.segments.begin)
    lasts = np.stack([between, 0.5 * between])
    phases = run.start.phase + system.frequency * (parts.begin[1:] - (between - lasts))
    out = np.empty((*lasts.shape, system.degrees_of_freedom + system._size + 3))
    for mode, here in run.modes(parts.mode[:-1]):
        some = np.flatnonzero(here)
        which = np.tile(np.arange(len(some)), 2)
        states = mode.after(parts.of(mode, some), which, lasts[:, here].ravel())
        found = whole_states(mode, states, phases[:, here].ravel())
        out[:, here] = found.reshape(2, len(some), -1)
    return out


def of_period(seen: Seen, end: float, length: float) -> Seen:
    """Return the events of one period.

    This period ends in the middle of the longest interval without events. The interval is sought in
    the last period before `end`.
    """
    border = np.append(end - length, seen.times[(seen.times > end - length) & (seen.times < end)])
    border = np.append(border, end)
    longest = int(np.argmax(np.diff(border)))
    middle = 0.5 * (border[longest] + border[longest + 1])
    low, high = np.searchsorted(seen.times, [middle - length, middle]).tolist()
    return seen.part(low, high)


def releases_in(events: Sequence[Happening], following: Sequence[Happening]) -> list[int]:
    """Numbers of the events that end contact with a stop that is hit; `following` are the next."""
    hit = {event.element for event in events if event.kicked}
    return [
        i
        for i, (event, after) in enumerate(zip(events, following, strict=False))
        if event.kicked is None
        and event.element in hit.intersection(event.mode.held)
        and event.element not in after.mode.held
    ]


def from_release(seen: Seen, first: int, end: float, within: float) -> Seen | None:
    """Return the events from release number `first` to before the same release near time `end`."""
    own = [k for k in seen.releases if seen.events[k].element == seen.events[first].element]
    late = {k: abs(seen.times[k] - end) for k in own if k > first}
    last = min(late, key=late.__getitem__, default=first)
    return seen.part(first, last) if late and late[last] < within else None


def of_cycle(seen: Seen, run: Trajectory, placed: Callable[[Array], Array]) -> tuple[Seen, float]:
    """Return the events of one cycle of a run that nothing drives, and the period.

    Raises
    ------
    NoConvergence
        When the motion does not repeat.
    """
    count = len(seen.times)
    states = placed(seen.states)
    size = abs(states).max(axis=0, initial=0.0)
    size = np.maximum(size, _STILL * size.max(initial=0.0))
    for k in range(1, count // 2 + 1):
        if seen.events[-k:] == seen.events[-2 * k : -k]:
            changes = abs(states[-k:] - states[-2 * k : -k])
            if (changes <= _SAME * size).all():
                length, low = seen.times[-1] - seen.times[-1 - k], count - k - 1
                low = max((j for j in seen.releases if j <= low), default=low)
                return seen.part(low, low + k), float(length)
    if run.ending is not Ending.COUNT_REACHED:
        raise NoConvergence(f"the motion does not come again, but ends: {run.ending.value}")
    raise NoConvergence(
        f"the motion does not come again within {count} events and a time of {run.duration:.3g}"
    )


def counts_of(oscillator: ImpactMap, itinerary: Itinerary, lasting: Array) -> dict[str, float]:
    """Numbers of events in a period, by element: see `OrbitLabel.counts`.

    `lasting` (n,) says whether the mode before each event lasts longer than rounding. Other modes
    are not counted beside an impact: rounding decides whether a slider that an impact left at its
    limit yields for a moment at the next impact.
    """
    found: dict[str, float] = {}
    pairs = zip(itinerary[-1:] + itinerary[:-1], itinerary, lasting, strict=True)
    modes = [event.mode for one, event, lasts in pairs if lasts or not (one.kicked or event.kicked)]
    for k, (name, element) in enumerate(
        zip(element_names(oscillator), oscillator._elements, strict=True)
    ):
        if isinstance(element, HardStop):
            hits = [e for e in itinerary if e.kicked is not None and e.element == k]
            chatters = any(e.chatters and _rebounds(element.restitution, e.piece) for e in hits)
            found[f"{name}.impacts"] = math.inf if chatters else len(hits)
        doing = [element.doing[mode.numbers[k]] for mode in modes]
        for what in sorted(filter(None, set(element.doing))):
            begun = zip(doing, [doing[-1], *doing[:-1]], strict=True)
            found[f"{name}.{what}"] = sum(now == what != before for now, before in begun)
    return found


def _rebounds(law: Any, piece: int) -> bool:
    """Whether slow impacts rebound, by the restitution or one piece of an impact law."""
    if not isinstance(law, ImpactLaw):
        return bool(law)
    return bool(law.continued(piece, np.array([_SLOW]))[0] > 0.0)


def returns_of(oscillator: ImpactMap, itinerary: Itinerary) -> int:
    """Number of returns to the section of an undriven machine: impacts, or events of an element."""
    if hits := sum(event.kicked is not None for event in itinerary):
        return hits
    k = cycled_by(oscillator._elements)
    if k is None:
        return 1
    element, found = oscillator._elements[k], 0
    for event in itinerary:
        if event.element == k:
            number = event.mode.numbers[k]
            watch = element.regimes[number].guards[event.guard]
            found += watch.event == HALT if halts(element) else number == 0
    return found
