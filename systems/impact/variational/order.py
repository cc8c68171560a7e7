"""Simultaneous events: whether their order matters.

Motions in the neighbourhood of two simultaneous events have either of them first. If the tangent
maps of both orders differ, the motion has no derivative.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from itertools import combinations, islice, takewhile
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np

from dynkit.core.no_motion import NoDerivative
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import IMPACT, EventKind
from dynkit.systems.impact.elements.laws import rebound
from dynkit.systems.impact.simulation.runs import trajectory_of
from dynkit.systems.impact.simulation.state import TWO_PI
from dynkit.systems.impact.variational.saltation import along, falls, slowed, struck
from dynkit.systems.impact.variational.taylor_derivative import hit, rubbed

_NEAR = 2.0**-40
"""Time, in periods of the forcing, within which events count as simultaneous."""

_LIKE = 1e-9
"""Largest difference of results that count as equal, relative to one plus the size of a result."""

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure
    from dynkit.systems.impact.simulation.trajectory import Trajectory


def check_order(oscillator: DrivenStructure, run: Trajectory) -> None:
    """Raise NoDerivative if events of a run are simultaneous and their order matters."""
    if len(oscillator._elements) < 2:
        return
    kind = _Linear if oscillator._motion is None else _Curved
    kind(oscillator, run).check()


class _Step(NamedTuple):
    """An event: its guard, whether it is an impact, and whether no simultaneous event causes it."""

    guard: Any
    hits: bool
    comes: bool


class _Orders(ABC):
    """Comparison of both orders of the simultaneous events of a run."""

    def __init__(self, oscillator: DrivenStructure, run: Trajectory) -> None:
        self.oscillator, self.run, self.s = oscillator, run, run.segments
        self.automaton: Any = oscillator._automaton
        self.modes, self.guards = self.automaton.modes, self.automaton.guards
        self.hit, self.brief = not oscillator._strobed, _NEAR * TWO_PI / oscillator.frequency

    def check(self) -> None:
        """Raise NoDerivative if two simultaneous events do not commute.

        Events at the start are not compared: the derivative assumes that neighbouring starts have
        the same ones.
        """
        s, first = self.s, 0
        near = (np.diff(s.begin) <= self.brief).tolist()
        elements = s.element.tolist()
        for q, at_once in enumerate([*near[1:], False], 1):
            if not near[q - 1]:
                first = q
            last = self.hit and q == len(near)
            several = q > first and not at_once and len({*elements[first : q + 1]}) > 1
            if first and (last or several):
                self._compare(first - 1, range(first, q + 1))

    def _compare(self, k: int, events: range) -> None:
        """Compare both orders of all pairs of simultaneous events at the end of segment k.

        Events whose guards are zero there, and fall, are independent. Each other recorded event is
        a consequence of the independent event before it.
        """
        number, y = self._end(k)
        begin = self.automaton.guard(number, -1)
        own = takewhile(lambda g: g.mode == number, islice(self.guards, begin, None))
        loose = [g for g in own if not g.watch.at_once]
        comes = {g.element: g for g in loose if self._comes(g, y)}
        if len(comes) < 2:
            return
        groups = {
            element: [_Step(g, g.watch.event == IMPACT, True)] for element, g in comes.items()
        }
        s, now, end = self.s, -1, events.stop
        if end == len(s.begin):  # add events simultaneous with the last impact
            run = self.run
            s = trajectory_of(self.oscillator, run.start, run.impacts + 1, store=True).segments
            end = int((s.begin <= s.begin[end - 1] + self.brief).sum())
        for q in range(events.start, end):
            guard, hits = self.guards[int(s.guard[q])], s.kind[q] == EventKind.IMPACT
            if guard.element in comes and hits == groups[guard.element][0].hits:
                now = guard.element
                comes.pop(now)
            elif now >= 0 and (self.hit or not hits):  # the end of a forcing period is no event
                groups[now].append(_Step(guard, bool(hits), False))
        for one, other in combinations(groups, 2):
            if not self._commute(k, groups[one], groups[other]):
                names = (self.oscillator._elements[n] for n in (one, other))
                raise NoDerivative(
                    "events of two elements happen at once, and their order counts: "
                    "{} and {}".format(*names)
                )

    def _commute(self, k: int, one: list[_Step], other: list[_Step]) -> bool:
        found = [self._after(k, order) for order in ([*one, *other], [*other, *one])]
        if found[0] is None or found[1] is None or found[0][0] != found[1][0]:
            return False
        for a, b in zip(found[0][1:], found[1][1:], strict=True):
            if abs(a - b).max() > _LIKE * (1.0 + abs(a).max()):
                return False
        return True

    def _after(self, k: int, order: list[_Step]) -> tuple[int, Array, Array] | None:
        """Mode, state and disturbances after events in this order, all at the end of segment k.

        None if the events do not happen in this order.
        """
        number, y = self._end(k)
        disturbances = np.eye(len(self._rate(number, y)))
        late = 0.0 * disturbances[0]
        for step in order:
            own = step.guard
            same = (
                n
                for n, g in enumerate(self.guards)
                if (g.mode, g.element, g.watch.event, g.watch.to)
                == (number, own.element, own.watch.event, own.watch.to)
            )
            if (n := next(same, None)) is None:
                return None
            guard = self.guards[n]
            if step.comes:
                row, rate = self._row_and_rate(guard, y)
                if (speed := float(row @ rate)) >= 0.0:
                    return None
                later = -(row @ disturbances) / speed
                disturbances, late = disturbances + np.outer(rate, later), late + later
            if step.hits:
                y, disturbances = self._struck(guard, y, disturbances)
            else:
                self.automaton.enter(n)
                y, disturbances = self._changed(guard, y, disturbances)
                number = guard.target
        return number, y, disturbances - np.outer(self._rate(number, y), late)

    def _comes(self, guard: Any, y: Array) -> bool:
        """Whether a guard is zero, and falls at a speed beyond rounding."""
        row, rate = self._row_and_rate(guard, y)
        return falls(self._value(guard, y), row * rate, self.oscillator.frequency)

    @abstractmethod
    def _value(self, guard: Any, y: Array) -> float:
        """Value of a guard."""

    @abstractmethod
    def _end(self, k: int) -> tuple[int, Array]:
        """Mode and state at the end of segment k."""

    @abstractmethod
    def _rate(self, number: int, y: Array) -> Array:
        """Rate of the state in a mode."""

    @abstractmethod
    def _row_and_rate(self, guard: Any, y: Array) -> tuple[Array, Array]:
        """Gradient of a guard by the disturbances, and the rate of the state."""

    @abstractmethod
    def _struck(self, guard: Any, y: Array, disturbances: Array) -> tuple[Array, Array]:
        """State and disturbances after an impact."""

    @abstractmethod
    def _changed(self, guard: Any, y: Array, disturbances: Array) -> tuple[Array, Array]:
        """State and disturbances in the mode that a guard leads to."""


@final
class _Linear(_Orders):
    """For linear modes; disturbances (2 slots, 2 slots) are those of the state of a mode."""

    def _value(self, guard: Any, y: Array) -> float:
        return float(along(guard.sum, 0) @ y.ravel()) + float(guard.sum.offset)

    def _end(self, k: int) -> tuple[int, Array]:
        number = int(self.s.mode[k])
        mode, lasts = self.modes[number], self.s.begin[[k + 1]] - self.s.begin[k]
        return number, mode.after(self.s.of(mode, [k]), np.zeros(1, dtype=np.intp), lasts)[0]

    def _rate(self, number: int, y: Array) -> Array:
        return np.asarray(self.modes[number].rate(y).ravel())

    def _row_and_rate(self, guard: Any, y: Array) -> tuple[Array, Array]:
        return along(guard.sum, 0), self._rate(guard.mode, y)

    def _struck(self, guard: Any, y: Array, disturbances: Array) -> tuple[Array, Array]:
        oscillator, mode = self.oscillator, self.modes[guard.mode]
        stop = oscillator._stops[guard.element]
        rate = float(along(guard.sum, 2) @ y.ravel())
        r, slope = (float(np.ravel(a)[0]) for a in rebound(stop.restitution, np.array([rate])))
        kick = mode.placed(stop.sign * mode.contact(stop.row(oscillator._size)).kick[:2])
        moved = -(1.0 + r) * rate * kick
        moved -= sum(slowed(part, (1.0 + r) * rate, y) for part in guard.scrapes)
        given = np.array([slope]), y[None], disturbances[None]
        return y + moved, disturbances + struck(oscillator, guard, *given)[0]

    def _changed(self, guard: Any, y: Array, disturbances: Array) -> tuple[Array, Array]:
        change = guard.change
        after = change[:, :-1] @ y.ravel() + change[:, -1]
        return after.reshape(2, -1), change[:, :-1] @ disturbances


@final
class _Curved(_Orders):
    """For modes by Taylor's method; disturbances are (2 N + J + 1, 2 N + J + 1)."""

    def _number(self, guard: Any) -> int:
        """Number of a guard within its mode."""
        return int(self.guards.index(guard) - self.automaton.guard(guard.mode, -1))

    def _value(self, guard: Any, y: Array) -> float:
        return float(self.modes[guard.mode].watched(self._number(guard), y)[0])

    def _end(self, k: int) -> tuple[int, Array]:
        number, y = int(self.s.mode[k]), self.s.states[k]
        lasts = float(self.s.begin[k + 1] - self.s.begin[k])
        if lasts > 0.0:
            y, _ = self.modes[number].flow(y, lasts, int(self.s.element[k]))
        return number, y

    def _rate(self, number: int, y: Array) -> Array:
        n, (moving,) = self.modes[number].bodies, self.modes[number].rate(y[None])
        return np.array(
            [*moving[0, :n], *moving[1, :n], *moving[0, n:-1], self.oscillator.frequency]
        )

    def _row_and_rate(self, guard: Any, y: Array) -> tuple[Array, Array]:
        row = self.modes[guard.mode].gradient(self._number(guard), y)
        return row, self._rate(guard.mode, y)

    def _struck(self, guard: Any, y: Array, disturbances: Array) -> tuple[Array, Array]:
        mode, k = self.modes[guard.mode], guard.element
        rate = mode.gap_at(k, y)[1]
        law = self.oscillator._stops[k].restitution
        r, slope = (float(np.ravel(a)[0]) for a in rebound(law, np.array([rate])))
        rubs = rubbed(self.oscillator, guard, y, disturbances, slope, r, rate)
        after = hit(mode, k, y, disturbances, slope, r)[0] + rubs
        x, phase = mode.motion(y)[0], float(np.arctan2(*y[:, -1]))
        moved = self._moved(mode, k, y, -(1.0 + r) * rate)
        for j, ratio in self.automaton.scrapes(guard, x, phase):
            w, most = mode.gap_at(j, y)[1], -(1.0 + r) * ratio * rate
            moved = moved + self._moved(mode, j, y, -float(np.clip(w, -most, most)))
        return y + moved, after

    def _changed(self, guard: Any, y: Array, disturbances: Array) -> tuple[Array, Array]:
        mode, k = self.modes[guard.mode], guard.element
        if guard.watch.event == IMPACT or mode.scene.elements[k].regimes[guard.watch.to].sticks:
            moved = self._moved(mode, k, y, -mode.gap_at(k, y)[1])
            return y + moved, hit(mode, k, y, disturbances, 0.0, 0.0)[0]
        return y, disturbances

    def _moved(self, mode: Any, k: int, y: Array, jump: float) -> Array:
        """Change of the state by an impulse that changes the rate of an element's gap."""
        moved = np.zeros_like(y)
        kick = mode.kick(k, mode.motion(y)[0], float(np.arctan2(*y[:, -1])))
        moved[1, : mode.bodies] = jump * kick
        return moved
