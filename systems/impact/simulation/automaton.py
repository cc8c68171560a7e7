"""The automaton of an oscillator: its modes and the guards that join them, as kernel tables."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import copied
from dynkit.core.validation import Array
from dynkit.exponential.propagators import turned
from dynkit.exponential.stacks import LadderStack, Stack, stacked
from dynkit.systems.impact.elements import law_programs
from dynkit.systems.impact.elements.element import (
    HALT,
    IMPACT,
    JAM,
    JUMP,
    RELEASED,
    REST,
    Element,
    Watch,
)
from dynkit.systems.impact.elements.laws import ImpactLaw
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.constrained import (
    Slider,
    Slip,
    force_of,
    mode_of,
    sum_of,
)
from dynkit.systems.impact.modes.mode import transformed
from dynkit.systems.impact.modes.structure import ROUNDING, Excitation, Structure
from dynkit.systems.impact.simulation.joined_modes import Guard, JoinedModes, cycled_by
from dynkit.systems.impact.simulation.regimes import Parts
from dynkit.systems.impact.simulation.scraping import packed, scrapes_of, stopping

MOST_NUMBERS = 1 << 25
"""Largest total size of the changes of basis between modes, in doubles: 256 MB."""


@final
class Automaton(JoinedModes):
    """The linear modes of an oscillator with quadratic energies, as kernel tables.

    Attributes
    ----------
    table : (guards, 4)
        For each guard: its mode, its element, the next mode, and the kind of the event.
    beside : int or None
        Number of elements besides the first one. None if the only element is a hard stop whose
        restitution is a number; then the kernels are smaller.
    start : tuple or None
        Numbers of the default start of the oscillators that share this automaton, once computed.
    """

    def __init__(
        self,
        structure: Structure,
        excitation: Excitation,
        elements: Sequence[Element],
        tolerance: float,
        parts: Parts,
    ) -> None:
        self._structure, self._excitation, self._elements = structure, excitation, tuple(elements)
        self._size, self.parts = structure.size, parts
        self._tolerance = tolerance
        hit = any(isinstance(element, HardStop) for element in self._elements)
        self._cycled = None if hit or excitation.turns else cycled_by(self._elements)
        strobed = not hit and self._cycled is None
        self._period = 2.0 * np.pi / excitation.frequency if strobed else 0.0
        stops = (e for e in self._elements if isinstance(e, HardStop))
        self._laws = [s.restitution for s in stops if isinstance(s.restitution, ImpactLaw)]
        alone = hit and len(self._elements) == 1 and not self._laws
        self.beside = None if alone else len(self._elements) - 1
        self._codes, self._numbers = law_programs.packed([law._program for law in self._laws])
        self._tails = np.array([law.tail for law in self._laws], dtype=float).reshape(-1, 5)
        self._begin()
        self._number((0,) * len(self._elements))

    def _begin(self) -> None:
        """Remove all modes, guards and tables."""
        self._unstack()
        self._changes: dict[tuple[int, int], list[Array]] = {}
        self._forget()
        self._tables: Any = None
        self._first: Any = None
        self.table: NDArray[np.intp] = np.empty((0, 4), dtype=np.intp)
        self.start: Any = None

    def _unstack(self) -> None:
        """Remove the arrays of which the tables are parts."""
        self._ladders, self._stacked_modes = LadderStack(), 0
        self._stack, self._of_guards = Stack(), Stack()
        self._slots = 0
        self._joined: dict[int, int] = {}
        self._rows: dict[int, int] = {}

    def turned(self, excitation: Excitation) -> Automaton:
        """The automaton, which has hard stops only, at another frequency.

        Only its first mode is built. If the structure has no steady response to the forcing, only
        the exponential sums in this mode's tables depend on the frequency; other tables are shared.
        """
        first, frequency = self._first, excitation.frequency
        if frequency == self._excitation.frequency:
            return self
        out = copied(self, _excitation=excitation)
        out._begin()
        mode = self.modes[0].turned(frequency)
        if first is None or mode is None:
            out._number(self.regimes[0])
            return out
        out.modes, out.regimes, out.table = [mode], self.regimes[:1], first[0]
        for g in self.guards[: len(first[0])]:
            sum_ = turned(g.sum, mode.propagators)
            out.guards.append(copied(g, sum=sum_, target=-1, partner=-1, change=None))
        rate = frequency if mode.layout.table < 0 else 0.0
        ladders = stacked([g.sum for g in out.guards])
        out._tables = first[1]._replace(ladders=ladders, clock_rate=rate)
        out._first = first[0], out._tables
        return out

    def freed(self, number: int, state: Array) -> tuple[Array, list[int]]:
        """A state (2, slots) of a mode in the basis of the first mode; `Parts.holding` elements."""
        mode = self.modes[number]
        states = state[None, :, : mode.layout.slots]
        return transformed(self.modes[0].seen_from(mode), states)[0], self.parts.holding(
            self.regimes[number]
        )

    def enter(self, number: int) -> None:
        """Build the next mode of a guard if no motion has entered it."""
        with self._lock:
            guard = self.guards[number]
            target = self._number(self._after(guard))
            for g in (guard, *(g for g in self.guards if g.mode == target)):
                # JAM has no next mode. Only a start enters the mode of a REST guard, or contact
                # with a stop on which an impact would first open another stop.
                ahead = g.opens < 0 and g.watch.event != REST
                loose = g.watch.event != JAM and (g is guard or ahead)
                if g.partner < 0 and loose and self._after(g) in self.regimes:
                    self._tables = None
                    self._join(g)

    @property
    def tables(self) -> Any:
        """The tables of the kernels."""
        with self._lock:
            if self._tables is None:
                try:
                    self._tables = self._stacked()
                except BaseException:  # an interrupt leaves no part of an array
                    self._unstack()
                    raise
                if len(self.modes) == 1:
                    self._first = self.table, self._tables
            return self._tables

    def rest_terms(self) -> Array:
        """Sum (guards,) of the absolute terms of the constant term of each guard."""
        own, s = self.modes[0].forced.rest_terms, self._structure
        along = [abs(element.row(s.size)) for element in self._elements]
        gaps, forces = [r @ own for r in along], [r @ abs(s.stiffness) @ own for r in along]
        watched = [(g.watch, gaps[g.element], forces[g.element]) for g in self.guards]
        return np.array(
            [
                (abs(w.gap) + abs(w.stretch)) * gap if w.gap or w.rate or w.stretch else force
                for w, gap, force in watched
            ]
        )

    # --- building ---------------------------------------------------------------------------------

    def _after(self, guard: Guard) -> tuple[int, ...]:
        return self.parts.after(self.regimes[guard.mode], guard)

    def _build(self, regimes: tuple[int, ...]) -> None:
        number, now = len(self.modes), self.parts.now(regimes)
        structure, excitation = self._structure, self._excitation
        sliders, springs = [], []
        for k, (element, regime) in enumerate(zip(self._elements, now, strict=True)):
            row = element.row(structure.size)
            if k in self.parts.sliders:
                behind = None if regime.anchored else element.sign * regime.stretch
                row[self.parts.sliders[k]] = -1.0 if regime.anchored else 0.0
                sliders.append(Slider(element, self.parts.sliders[k], behind))
            springs.append((row, regime.stiffness, regime.damping))
            excitation = excitation.pulled(element, regime)
        if self.parts.falls:
            self.parts.check_slopes([regime.damping for regime in now])
        structure = structure.stiffened(springs)
        grips = self.parts.grips(regimes)
        held, sticking = ([self._elements[k] for k in part] for part in grips)
        both, riding = grips[0] + grips[1], self.parts.riding(regimes)
        places = range(len(now))
        moving = [k for k in places if not riding[k] and not self.parts.follows(k)]
        watched = [self._elements[k].row(structure.size) for k in moving]
        watched += [np.eye(structure.size)[slider.place] for slider in sliders]
        hit = [
            self._elements[k].row(structure.size)
            for k in moving
            if isinstance(self._elements[k], HardStop) and riding[k] is False
        ]
        hit += [
            self._elements[k].row(structure.size)
            for k, stop in self.parts.normal.items()
            if stop in moving and k in moving
        ]
        given = self._elements
        slips = [Slip(given[k], given[n], t) for k, n, t in self.parts.tractions(regimes)]
        mode = mode_of(structure, excitation, held, sticking, watched, hit, sliders, slips)
        self.modes.append(mode)
        self.regimes.append(regimes)
        for k, watch in self.parts.watches(regimes, riding):
            element = given[k]
            if k in both:
                normal = given[self.parts.normal[k]] if k in self.parts.normal else None
                fixed = [*held, *sticking]
                sum_ = force_of(mode, structure, excitation, fixed, element, watch, slips, normal)
            else:
                sum_ = sum_of(mode, element, watch, self.parts.sliders.get(k, -1))
            guard = Guard(number, k, watch, sum_)
            if watch.event == IMPACT:
                own = self._structure, mode, given, self.parts, regimes, k
                self._decide(guard, riding[k], partial(scrapes_of, *own))
            self.guards.append(guard)

    def _join(self, guard: Guard) -> None:
        """Set the next mode of a guard, and the change of the state at the guard's zero."""
        one, target = self.modes[guard.mode], self._number(self._after(guard))
        rests = guard.watch.event in (IMPACT, REST)
        stop = self._elements[guard.element] if rests else None
        change = self.modes[target].seen_from(one, stop)
        lands = guard.watch.event == JUMP and guard.element in self.parts.normal
        if lands and self.parts.now(self.regimes[target])[guard.element].sticks:
            change = stopping(change, one, self._elements[guard.element])
        before, sticking = (self.parts.grips(self.regimes[k])[1] for k in (guard.mode, target))
        halts = guard.watch.event == HALT or guard.element in self.parts.sliders
        halts = halts or guard.element in self.parts.normal
        for k in (k for k in sticking if (rests if k in before else halts)):
            # The rate of a sticking element is exactly that of its surface.
            layout = self.modes[target].layout
            own = layout.modes[sticking.index(k) - len(sticking)]
            change[layout.slots + own] = 0.0
            change[layout.slots + own, -1] = self._elements[k].drift
        alike = self._changes.setdefault((guard.mode, target), [])
        known = next((given for given in alike if np.array_equal(given, change)), None)
        if known is None:
            alike.append(change)
        guard.change, guard.target = change if known is None else known, target
        guard.partner = self.guard(target, guard.element)  # last: the guard is now joined

    def _stacked(self) -> Any:
        from dynkit.systems.impact.simulation.contact_kernels import Tables

        modes, guards, stack = self.modes, self.guards, self._stack
        for number in range(self._stacked_modes, len(modes)):
            own = [k for k, guard in enumerate(guards) if guard.mode == number]
            self._ladders.add([guards[k].sum for k in own])
            slots = np.zeros(self._size, dtype=np.intp)
            slots[: len(modes[number].layout.modes)] = modes[number].layout.modes
            stack.put("slots", number, slots[None])
            stack.put("regimes", number, np.array([self.regimes[number]], dtype=np.intp))
            stack.put("slides", number, [self.parts.slides(self.regimes[number])])
            constants = [self._constants(guards[k]) for k in own]
            for name in constants[0]:
                self._of_guards.put(name, own[0], [each[name] for each in constants])
        self._stacked_modes = len(modes)
        ladders = self._ladders.ladders
        slots = ladders.step.shape[3]
        joined = [k for k, guard in enumerate(guards) if guard.change is not None]
        changes = [guards[k].change for k in joined]
        # Sliders along one row lead to the same mode by the same change, which is stored once.
        if len(set(map(id, changes))) * 2 * slots * (2 * slots + 1) > MOST_NUMBERS:
            raise MemoryError(
                f"elements must not lead to more modes than fit into 256 MB; got {len(modes)}, "
                "one for each set of what was pressed, closed or slipping: give fewer elements"
            )
        if slots != self._slots:
            stack.drop("change")
            self._joined, self._rows, self._slots = {}, {}, slots
            stack.put("change", 0, np.zeros((1, 2 * slots, 2 * slots + 1)))
        for k in joined:
            if k not in self._joined:
                row = self._joined[k] = self._rows.setdefault(id(guards[k].change), len(self._rows))
                stack.put("change", row, _padded(guards[k].change, slots)[None])
        self.table = self.parts.table(self.regimes, guards)
        return Tables(
            ladders=ladders,
            first=np.searchsorted([g.mode for g in guards], np.arange(len(modes) + 1)),
            slots=stack.take("slots", len(modes)),
            regimes=stack.take("regimes", len(modes)),
            slides=stack.take("slides", len(modes)),
            counts=np.array([len(mode.layout.modes) for mode in modes]),
            element=self.table[:, 1].copy(),
            target=self.table[:, 2].copy(),
            partner=np.array([g.partner for g in guards]),
            codes=self._codes,
            numbers=self._numbers,
            tails=self._tails,
            change=stack.take("change", len(self._rows)),
            row=np.array([self._joined.get(k, 0) for k in range(len(guards))]),
            tolerance=self._tolerance,
            period=self._period,
            clock_rate=self._excitation.frequency if modes[0].layout.table < 0 else 0.0,
            **self._of_guards.all(len(guards)),
        )

    def _constants(self, guard: Guard) -> dict[str, Any]:
        """Return the data of a guard, by their names in `Tables`."""
        mode, element, watch = self.modes[guard.mode], self._elements[guard.element], guard.watch
        slots = mode.layout.slots
        kick, excursion = np.zeros((4, slots)), np.zeros((2, slots))
        coupling = restitution = drop = hold = 0.0
        law = -1
        coupled = [False] * len(self._elements)
        rubbed = coupled
        scraped, scrape = packed(guard.scrapes, self.parts.most_rubs, slots)
        held, hits = self.parts.grips(self.regimes[guard.mode])[0], watch.event == IMPACT
        free = hits and self.parts.along(held, guard.element) is False
        if isinstance(element, HardStop) and free:
            contact = mode.contact(element.row(self._size))
            seen = mode.layout.seen
            kick[:, :seen] = element.sign * mode.placed(contact.kick)[:, :seen]
            excursion = mode.placed(contact.brief)
            coupling = contact.coupling
            for part in guard.scrapes:
                coupling += part.coupling
                excursion += mode.placed(part.excursion)
            if isinstance(element.restitution, ImpactLaw):
                law = self._laws.index(element.restitution)
            else:
                restitution = element.restitution
            coupled = self._coupled(guard)
            rubbed = self.parts.rubbed(self.regimes[guard.mode], guard.element)
            change = mode.forced.spread(contact.response)
            changes = np.array([e.row(self._size) @ change for e in self._elements])
            drop, hold = self.parts.turns(rubbed, changes)
        return {
            "event": watch.event,
            "order": watch.order,
            "torn": _torn(watch, self.parts.hard(guard.element)),
            "kick": kick,
            "excursion": excursion,
            "coupling": float(coupling),
            "restitution": restitution,
            "law": law,
            "drop": drop,
            "hold": hold,
            "opens": self.guard(guard.mode, guard.opens) if guard.opens >= 0 else -1,
            "ambiguous": guard.ambiguous,
            "coupled": coupled,
            "rubbed": rubbed,
            "marks": self.marks(guard),
            "yields": -int(np.sign(watch.stretch)),
            "scraped": scraped,
            "scrape": scrape,
        }

    def _coupled(self, guard: Guard) -> list[bool]:
        """For each element, whether an impact at a guard changes the rate of its gap."""
        size, out = self._structure.size, [False] * len(self._elements)
        stops = [k for k, e in enumerate(self._elements) if isinstance(e, HardStop)]
        if len(stops) > 1:
            for j in (guard.element, *(part.element for part in guard.scrapes)):
                change = self.modes[guard.mode].pushed(self._elements[j].row(size))
                for k in stops:
                    row = self._elements[k].row(size)
                    moved = abs(row @ change) > ROUNDING * (abs(row) @ abs(change))
                    out[k] = out[k] or bool(moved)
        return out


def _torn(watch: Watch, hard: bool) -> int:
    """The entry ``torn`` of a guard in `Tables`."""
    return 0 if not watch.force else (2 if hard else 3) if watch.order == RELEASED else 1


def _padded(change: Array, slots: int) -> Array:
    """A change of basis (2 b, 2 a + 1) as (2 slots, 2 slots + 1)."""
    b, a = len(change) // 2, change.shape[1] // 2
    out = np.zeros((2, slots, 2 * slots + 1))
    both = change.reshape(2, b, change.shape[1])
    out[:, :b, :a] = both[..., :a]
    out[:, :b, slots : slots + a] = both[..., a:-1]
    out[:, :b, -1] = both[..., -1]
    return out.reshape(2 * slots, -1)
