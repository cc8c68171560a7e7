"""Random machines with elements of any kind against 60 digits: their events and states."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from flint import arb, ctx

from dynkit.core.validation import Array
from dynkit.systems.impact.simulation.joined_modes import cycled_by
from dynkit.systems.impact.simulation.state import SHEET
from tests.reference.machine_parts import Cushion, Joint, Rub, Table
from tests.reference.machines import BITS, Event, Machine
from tests.reference.random_machines import MACHINES, random_machine

IMPACTS, PERIODS = 8, 10
LOST = 1e-3
"""Where this error is claimed, events may be others."""


@dataclass
class Comparison:
    """A machine's actual and claimed errors of states and times, and what does not agree.

    Attributes
    ----------
    ended : why the comparison ended before the motion did
    wrong : the first event that is another one
    events : how many changes of regimes were compared
    """

    states: list[tuple[float, float]] = field(default_factory=list)
    times: list[tuple[float, float]] = field(default_factory=list)
    ended: str = ""
    wrong: str = ""
    events: int = 0


SMALL = 1e-9
"""Where more is claimed at the last impact, later events may be others."""

SHORT, ROUND = 1e-6, 1e-9
"""Regimes that last shorter are none; and what times are compared to, besides their errors."""

LEAST, SLOW = 1e-30, 1e-10
"""Rebounds between these belong to the end of a chatter."""


@cache
def compared_machine(number: int) -> Comparison:
    """Compare the motion of a random machine with that in many digits, as far as both go."""
    return compared(*random_machine(number))


def compared(system: Any, start: Any, truth: Any = None, impacts: int = IMPACTS) -> Comparison:
    """Compare a motion with that in many digits, of the same machine or of another one."""
    out = Comparison()
    try:
        record = system.simulate(impacts=impacts, start=start)
        error = record.error
    except NotImplementedError:
        out.ended = "refused"
        return out
    with ctx.workprec(BITS):
        machine = Machine(truth or system)
        sine, cosine = start._turn.tolist()
        z = machine.start(start.position, start.velocity, start.sliders, sine, cosine)
        end = _end(record, impacts)
        marks = cycled_by(system._elements) if system._cycled else None
        events, out.ended = machine.motion(
            z,
            end + SHORT,
            periods=system._strobed and not system._cycled,
            marks=-1 if marks is None else marks,
        )
        if out.ended:
            end = float(events[-1].time) if events else 0.0
        undecided = [float(event.time) for event in events if event.ambiguous]
        if undecided and undecided[0] < end:
            out.ended, end = "not unique", undecided[0]
        if not events:
            return out
        _Pair(out, system, record, error, machine, events, end, impacts).compare()
    return out


def _end(record: Any, impacts: int) -> float:
    """Until when both are followed: where impacts are missing, for some periods.

    Errors are claimed at impacts: after the last one little may be lost.
    """
    last = float(record.time[-1]) if len(record) else 0.0
    if len(record) == impacts:
        return last
    if len(record) and not record.error[-1] < SMALL:
        return last + 4.0 * min(float(record.error[-1]), LOST) / float(record.system.frequency)
    later: float = last + PERIODS * 2.0 * np.pi / record.system.frequency
    return min(float(record._run.duration), later)


@dataclass
class _Pair:
    """A record and its motion in many digits, until a time."""

    out: Comparison
    system: Any
    record: Any
    error: Array
    machine: Machine
    events: list[Event]
    end: float
    impacts: int

    def compare(self) -> None:
        out, record, w = self.out, self.record, self.system.frequency
        lost = np.flatnonzero(~(self.error < LOST))
        if len(lost):
            out.ended = "lost"
            last = lost[0] - 1
            later = float(record.time[last] + 4.0 * self.error[last] / w) if lost[0] else 0.0
            self.end = min(self.end, later)
        own, exact = self._impacts(), self._exact_impacts()
        if len(lost):
            own = [at for at in own if at < lost[0]]
            exact = exact[: len(own)]
        own = self._struck(own, exact)
        for at, (event, stop) in zip(own, exact, strict=False):
            claimed = float(self.error[at])
            late = abs(float(record.time[at] - event.time))
            if stop != int(record.element[at]) or late > max(4.0 * claimed / w, ROUND):
                own_one = f"impact {at} of {record.element[at]} at {record.time[at]}"
                out.wrong = f"{own_one}, in truth of {stop} at {float(event.time)}"
                return
            rounding = 2.0**-53 * float(abs(record.states[at]).max())
            off = self.system.difference(record.states[at], self._section(event, stop))
            out.states.append((float(abs(off).max()), claimed + rounding))
            out.times.append((late, claimed / w + 2.0**-51 * float(record.time[at])))
        missing = len(own) < len(exact) and len(record) < self.impacts and not out.ended
        if len(own) > len(exact) or missing:
            out.wrong = f"{len(own)} impacts, in truth {len(exact)}"
        else:
            self._regimes(self.end - ROUND)

    def _rests(self) -> list[tuple[float, float, int]]:
        """Intervals of chatter that dynkit leaves out, and their stops."""
        parts = self.record._run.segments
        some = np.flatnonzero(parts.rest > 0.0)
        return [
            (float(parts.begin[k]), float(parts.begin[k] + parts.rest[k]), int(parts.element[k]))
            for k in some
        ]

    def _impacts(self) -> list[int]:
        speed = abs(self.record._run.log.speed)
        soon = self.record.time < self.end + ROUND
        return [i for i, u in enumerate(speed.tolist()) if soon[i] and not LEAST < u < SLOW]

    def _struck(self, own: list[int], exact: list[tuple[Event, int]]) -> list[int]:
        """Impacts without those that only touch, by the law as in truth: these change nothing.

        A law without rebound gives both the same speed, none.
        """
        record, times = self.record, np.array([float(event.time) for event, _ in exact])
        out = []
        for at in own:
            time, stop = float(record.time[at]), int(record.element[at])
            near = times.size and abs(times - time).min() < 1e-6
            if near or record._run.log.speed[at] != 0.0 or self.system._strobed:
                out.append(at)
                continue
            before = max((e for e in self.events if float(e.time) <= time), key=lambda e: e.time)
            flow, part = self.machine.flow(before.regimes), self.machine.parts[stop]
            assert flow is not None
            z = ((flow.matrix * (arb(time) - before.time)).exp() * before.state).mid()
            off = abs(float(part.gap_at(z))), abs(float(part.rate_at(z)))
            if max(off) > float(self.error[at]):
                out.append(at)
        return out

    def _exact_impacts(self) -> list[tuple[Event, int]]:
        if self.system._strobed:
            return [(e, -1) for e in self.events if e.marked and float(e.time) < self.end + ROUND]
        out = []
        for event in self.events:
            time = float(event.time)
            if time > self.end + ROUND:
                break
            for stop in event.hit:
                u = self.machine.parts[stop].rate_at(event.state)
                left_out = any(
                    stop == k and low + ROUND < time < high + ROUND
                    for low, high, k in self._rests()
                )
                if not (left_out or LEAST < u < SLOW):
                    out.append((event, stop))
        return out

    def _section(self, event: Event, stop: int) -> Array:
        """Section coordinates of a state, rounded."""
        system, n = self.system, self.system.degrees_of_freedom
        z = event.state
        numbers = np.array([float(x) for x in z.entries()])
        x, v = numbers[:n], numbers[n : 2 * n]
        sliders = [float(p.slider(z)) for p in self.machine.parts if isinstance(p, Joint)]
        if system._strobed:
            positions, velocities = system._crossed.kept
            return np.concatenate([x[positions], v[velocities], sliders])
        kept = system._others[stop if system._several else 0]
        u = float(self.machine.parts[stop].rate_at(z))
        phase = np.arctan2(numbers[-3], numbers[-2]) % (2.0 * np.pi)
        u = -u if stop == 1 and system._faces else u
        return np.concatenate(
            [x[kept], v[kept], sliders, [u, phase + SHEET * stop * system._several]]
        )

    def _regimes(self, end: float) -> None:
        """Compare which regimes follow which."""
        run = self.record._run
        parts = run.segments
        own = [
            (float(t), self._named(run.regimes[mode]))
            for t, mode in zip(parts.begin + parts.rest, parts.mode.tolist(), strict=True)
        ]
        exact = [(float(e.time), self._named(e.regimes, exactly=True)) for e in self.events]
        rests = self._rests()
        mine, truth = (_lasting(given, rests, end) for given in (own, exact))
        self.out.events = len(truth)
        for k, ((t, a), (s, b)) in enumerate(zip(mine, truth, strict=False)):
            i = min(int(np.searchsorted(self.record.time, t)), len(self.error) - 1)
            claimed = float(self.error[i]) if i >= 0 else 1e-12
            if a != b or abs(t - s) > max(4.0 * claimed / self.system.frequency, SHORT):
                self.out.wrong = f"regimes {k}: {a} from {t}, in truth {b} from {s}"
                return
        if len(mine) != len(truth):
            self.out.wrong = f"{len(mine)} regimes, in truth {len(truth)}: {mine[-1]}, {truth[-1]}"

    def _named(self, regimes: tuple[int, ...], *, exactly: bool = False) -> str:
        """One letter for each element, but for friction that goes with other friction."""
        out = ""
        for part, now in zip(self.machine.parts, regimes, strict=True):
            if isinstance(part, Rub) and not part.leads:
                continue
            stop = isinstance(part, Table)
            of_stop = ("-c" if exactly else "-c-") if stop else "-pl" if exactly else "-plp"
            out += (of_stop if stop or isinstance(part, Cushion) else "sfbs")[now]
        return out


def _lasting(
    given: list[tuple[float, str]], rests: list[tuple[float, float, int]], end: float
) -> list[tuple[float, str]]:
    """What lasts, each beside when it began: without what is left out, and merged."""
    ends = [t for t, _ in given[1:]] + [np.inf]
    out: list[tuple[float, str]] = []
    for (t, name), until in zip(given, ends, strict=True):
        hidden = any(low + ROUND < t and until < high + SHORT for low, high, _ in rests)
        if t < end - SHORT and until - t > SHORT and not hidden and (not out or out[-1][1] != name):
            out.append((t, name))
    return out


# --- the campaign ---------------------------------------------------------------------------------


def states_of_machines(every: int) -> Iterator[tuple[float, float]]:
    """Largest error of section coordinates at an impact, or at the end of a period or cycle."""
    for number in range(0, MACHINES, every):
        yield from compared_machine(number).states


def times_of_machines(every: int) -> Iterator[tuple[float, float]]:
    """Errors of times of these."""
    for number in range(0, MACHINES, every):
        yield from compared_machine(number).times


def different(every: int) -> dict[int, str]:
    """The machines with other events than in truth, and which."""
    numbers = range(0, MACHINES, every)
    return {number: wrong for number in numbers if (wrong := compared_machine(number).wrong)}


def summary(every: int) -> str:
    """Machines, those with other events, and why comparisons ended before the motion did."""
    numbers = range(0, MACHINES, every)
    ended = Counter(compared_machine(number).ended for number in numbers)
    lost, refused = (ended.pop(reason, 0) for reason in ("lost", "refused"))
    whole = ended.pop("", 0)
    found = [compared_machine(number) for number in numbers]
    wrong = sum(bool(each.wrong) for each in found)
    events = sum(each.events + len(each.states) for each in found)
    return f"{whole} | {lost} | {refused} | {ended.total()} | {events} | {wrong}"
