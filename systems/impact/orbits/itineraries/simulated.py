"""Whether the solution of an itinerary is a motion: simulation finds the same events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import LAIN
from dynkit.systems.impact.orbits.itineraries.flying import laid
from dynkit.systems.impact.orbits.itineraries.happening import Happening
from dynkit.systems.impact.orbits.itineraries.itinerary import Seen, events_seen
from dynkit.systems.impact.orbits.itineraries.motion import SAME
from dynkit.systems.impact.simulation.state import TWO_PI, Motion, beside, placed, state_at
from dynkit.systems.impact.simulation.trajectory import Trajectory

_MOST = 4096
"""Limit of the number of impacts in a simulation of given duration."""

_OPENS = 1e-3
"""Fraction of a period after which an opening gap is larger than rounding."""

_BETWEEN = 64
"""Largest number of switches per impact in such a simulation."""


def simulated(
    system: Any,
    start: Any,
    length: float,
    named: bool = True,
    count: int = 4,
    most: int = _MOST,
    machine: Any = None,
) -> Seen:
    """Return the events of the motion from a state for some time; `count` guesses the impacts."""
    run = run_for(system, start, length, count, most)
    seen = events_seen(system, run, named, length, machine)
    return seen.part(0, int(np.searchsorted(seen.times, length)))


def run_for(
    system: Any, start: Any, length: float, count: int = 4, most: int = _MOST
) -> Trajectory:
    """Simulate a motion for a time at least, unless it ends before or has too many events."""
    while True:
        switches = _BETWEEN * count
        run: Trajectory = system._run(start, count, store=True, most_switches=switches)
        ended = run.impacts < count and len(run.switches.guard) <= switches
        if run.duration > length or ended or count > most:
            return run
        count *= 4


def is_motion(s: Any) -> bool:
    """Whether simulation finds the same events as a `ShootingSolution` has."""
    if (s.impulses < 0.0).any() or (s.durations < -SAME * s.period).any():
        return False
    try:
        if not s.course.sticks:
            return _comes_again(s)
        complete = all(chatter.complete for chatter in s.chatters.values())
        return complete and all(_is_released(s, k) for k in range(len(s.course.nodes)))
    except (NoMotion, NotImplementedError):
        return False


def _comes_again(s: Any) -> bool:
    """Whether simulation from the middle of the longest mode finds the events of a period."""
    i = int(np.argmax(s.durations))
    times = np.asarray((s.event_phases - s.event_phases[0]) / s.clock)
    since = float(times[i] + 0.5 * s.durations[i])
    start = _amid(s, i, since)
    due = (times - since) % s.period
    turned = [(i + 1 + k) % s.events for k in range(s.events)]
    order = [k for k in turned if s.itinerary[k].element >= 0]
    seen = simulated(s.oscillator, start, s.period, most=len(order), machine=s.machine)
    within, stops = SAME * s.period, len(s.oscillator._stops)
    found = _without_order(s, seen.times, seen.events)
    wanted = _without_order(s, due[order], [s.itinerary[k] for k in order])
    return len(found) == len(wanted) and all(
        abs(seen.times[i] - due[order[k]]) <= within and _same(event, other, stops)
        for (i, event), (k, other) in zip(found, wanted, strict=True)
    )


def _amid(s: Any, i: int, since: float) -> Any:
    """The state at a time since the first event, in the mode after event `i`."""
    n = s.machine.size
    (z,) = s.passed(np.array([since]))
    phase = float(s.event_phases[0]) + s.clock * since if s.driven else 0.0
    closed = [k for k in s.following[i].mode.held if k < len(s.oscillator._stops)]
    whole = np.append(z, [np.sin(phase), np.cos(phase), 1.0])
    z = laid(s.flights(s.following[i].mode), closed, whole)[0][:-3]  # exactly on closed stops
    sliders = placed(s.oscillator, z[:n], z[2 * n :])[n:]  # within the range of their springs
    return s.oscillator.state(z[:n], z[n : 2 * n], phase % TWO_PI, sliders)


def _without_order(
    s: Any, times: Array, events: Sequence[Happening]
) -> list[tuple[int, Happening]]:
    """Numbers of events, and events; simultaneous ones by elements and in the mode before them.

    The order of simultaneous events is decided by rounding. So is whether a slider yields and
    sticks again at once, as it may when an impact left it at its limit: such events are left out.
    """
    groups: list[list[int]] = []
    for k, late in enumerate((np.diff(times, prepend=-np.inf) > SAME * s.period).tolist()):
        groups += [[]] if late else []
        groups[-1].append(k)
    modes = [events[group[0]].mode for group in groups]
    found = []
    for group, mode, after in zip(groups, modes, [*modes[1:], *modes[:1]], strict=True):
        undone = [k for k in s.machine.sliders if mode.numbers[k] == after.numbers[k]]
        kept = [k for k in group if events[k].kicked or events[k].element not in undone]
        kept.sort(key=lambda k: events[k].element)
        found += [(k, events[k]._replace(mode=mode)) for k in kept]
    return found


def _is_released(s: Any, node: int) -> bool:
    """Whether simulation from a release finds the same events until the next node.

    All bounces of a simulated chatter are accepted, whatever number of them are events. If several
    stops open simultaneously, simulation begins a little later: their gaps are so small at first
    that rounding may cause impacts.
    """
    begin = s.course.nodes[node]
    end = (*s.course.nodes, s.events)[node + 1]
    due, within = np.cumsum(s.durations[begin:end]), SAME * s.period
    z, n, held = s.after[begin], s.machine.size, s.following[begin].mode.held
    own = 0.0, s.itinerary[begin].element, Motion.RELEASE, held
    x, v = np.append(z[:n], z[2 * n : -3]), beside(s.oscillator, z[n : 2 * n])
    start = state_at(s.oscillator, x, v, z[-3:-1], *own)
    if begin and begin - 1 in s.course.nodes and s.durations[begin - 1] <= within:
        late = min(_OPENS * s.period, 0.5 * float(due[0]))
        since = (s.event_phases[begin] - s.event_phases[0]) / s.clock
        start, due = _amid(s, begin, float(since) + late), due - late
    count = 4 + len(due) + sum(chatter.run.impacts for chatter in s.chatters.values())
    until = float(due[-1]) + within
    seen = simulated(s.oscillator, start, until, False, count, count, s.machine)
    # rounding decides which slider slips at a release
    opens = within if s.machine.sliders else 0.0
    begun = int(np.searchsorted(seen.times, min(opens, float(due[0]) - within)))
    seen = seen.part(begun, len(seen.times))
    found = iter(_without_order(s, seen.times, seen.events))
    events = [s.itinerary[i % s.events] for i in range(begin + 1, end + 1)]
    for k, wanted in _without_order(s, due, events):
        i = begin + 1 + k
        if due[k] <= within and i in s.course.nodes:
            return True  # another stop is released at the same time
        j, event = next(found, (-1, wanted))
        on_time = j >= 0 and abs(seen.times[j] - due[k]) <= within
        if not (on_time and _same(event, wanted, len(s.oscillator._stops))):
            return False
        bounces = wanted.chatters and s.chatters[i % s.events].rebounds
        while bounces and event.guard >= 0:  # until contact
            _, event = next(found, (-1, Happening(wanted.mode, -1, 0)))
            if event.element != wanted.element or not (event.kicked or event.guard < 0):
                return False
    return True


def _same(a: Happening, b: Happening, stops: int) -> bool:
    """Whether two events are the same, in the same mode.

    Of events that are no impacts only the modes are compared: sliders of one row halt
    simultaneously, and any of them may be the one found. A hard stop may be open in one mode and
    `LAIN` in the other, since a start does not contain this difference.
    """
    modes = zip(a.mode.numbers, b.mode.numbers, strict=True)
    for k, (one, other) in enumerate(modes):
        if one != other and (k >= stops or {one, other} != {0, LAIN}):
            return False
    if bool(a.kicked) != bool(b.kicked):
        return False
    own = [(e.element, e.guard, e.piece, e.rubs) for e in (a, b)]
    return not a.kicked or own[0] == own[1]
