"""Modes of an oscillator and the guards that join them, as the kernels take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from threading import RLock
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.exponential.stacks import stacked
from dynkit.systems.impact.contact import force_of, free_mode, held_mode, pushed, rides, sum_of
from dynkit.systems.impact.elements import IMPACT, JAM, Element, EventKind, HardStop, Regime
from dynkit.systems.impact.mode import Mode, transformed
from dynkit.systems.impact.structure import ROUNDING, Drive, Structure

MOST_NUMBERS = 1 << 25
"""Of the changes of bases between all modes: 256 MB."""


@final
@dataclass(eq=False)
class Guard:
    """What ends a flight in a mode, and what then happens.

    Attributes
    ----------
    mode, element : int
        Numbers of the mode that it is of, and of what it belongs to.
    watch : Watch
    sum : the exponential sum that is positive before
    target, partner : int
        The mode that it leads to, for an impact that of contact, and the first guard of the same
        element there; -1 where it has not been entered.
    change : (2 slots, 2 slots + 1), of both modes, or None
        What becomes of the state, and one.
    opens : int
        The closed stop from which an impact pulls away, -1 for none.
    ambiguous : bool
        Whether an impact pushes against a closed stop.
    """

    mode: int
    element: int
    watch: Any
    sum: Any
    target: int = -1
    partner: int = -1
    change: Any = None
    opens: int = -1
    ambiguous: bool = False


class Grip(NamedTuple):
    """Contact with one stop.

    Attributes
    ----------
    mode : Mode
    force : its force, as an exponential sum
    to_stuck, to_free : changes of basis from free flight, whose relative velocity is lost, and back
    """

    mode: Mode
    force: Any
    to_stuck: Array
    to_free: Array


@final
class Automaton:
    """The modes that motions of one oscillator entered so far; in the first all regimes are 0.

    Attributes
    ----------
    modes : list of Mode
    regimes : list of tuple
        Of each mode, those of all elements.
    guards : list of Guard
        In the order of their modes.
    table : (guards, 4)
        Of each guard its mode, its element, the mode that it leads to, and the kind of this switch.
    """

    def __init__(
        self,
        structure: Structure,
        drive: Drive,
        elements: Sequence[Element],
        tolerance: float,
    ) -> None:
        self._structure, self._drive, self._elements = structure, drive, tuple(elements)
        self._tolerance = tolerance
        self._hit = any(isinstance(element, HardStop) for element in self._elements)
        self._lock = RLock()
        self._tables: Any = None
        self.table: NDArray[np.intp] = np.empty((0, 4), dtype=np.intp)
        self.modes: list[Mode] = []
        self.regimes: list[tuple[int, ...]] = []
        self.guards: list[Guard] = []
        self._grips: dict[int, Grip] = {}
        self._number((0,) * len(self._elements))

    def mode(self, regimes: tuple[int, ...]) -> Mode:
        """The mode of some regimes, built where no motion has entered it."""
        return self.modes[self._number(regimes)]

    def gap(self, regimes: tuple[int, ...], element: int) -> Any:
        """The sum that the first guard of an element watches in a mode."""
        return self.guards[self.guard(self._number(regimes), element)].sum

    def guard(self, mode: int, element: int) -> int:
        """The first guard of an element in a mode; where it has none, that of the mode."""
        own = [k for k, g in enumerate(self.guards) if g.mode == mode]
        return next((k for k in own if self.guards[k].element == element), own[0])

    def held(self, element: int) -> Grip:
        """Contact with one element, the others in their first regime."""
        if element not in self._grips:
            regimes = tuple(int(k == element) for k in range(len(self._elements)))
            mode, free = self.mode(regimes), self.modes[0]
            force, stop = self.gap(regimes, element), self._elements[element]
            there, back = mode.seen_from(free, stop), free.seen_from(mode)
            self._grips[element] = Grip(mode, force, there, back)
        return self._grips[element]

    def freed(self, number: int, state: Array) -> tuple[Array, list[int]]:
        """A state (2, slots) of a mode as one of the first mode, and the elements that held it."""
        mode = self.modes[number]
        states = state[None, :, : mode.layout.slots]
        return transformed(self.modes[0].seen_from(mode), states)[0], self.holding(
            self.regimes[number]
        )

    def holding(self, regimes: tuple[int, ...]) -> list[int]:
        """The elements that hold in some regimes."""
        return [k for k, regime in enumerate(self._now(regimes)) if regime.holds]

    def enter(self, number: int) -> None:
        """Build the mode that a guard leads to, where no motion has done so."""
        with self._lock:
            guard = self.guards[number]
            target = self._number(self._after(guard))
            for g in (guard, *(g for g in self.guards if g.mode == target)):
                if g.partner < 0 and self._after(g) in self.regimes:
                    self._join(g)
                    self._tables = None

    @property
    def tables(self) -> Any:
        """What the kernels take."""
        with self._lock:
            if self._tables is None:
                self._tables = self._stacked()
            return self._tables

    def rest_terms(self) -> Array:
        """Of what each guard watches the sum of the absolute terms of its rest, (guards,)."""
        own, s = self.modes[0].forced.rest_terms, self._structure
        along = [abs(element.row(s.size)) for element in self._elements]
        gaps, forces = [r @ own for r in along], [r @ abs(s.stiffness) @ own for r in along]
        watched = [(g.watch, gaps[g.element], forces[g.element]) for g in self.guards]
        return np.array(
            [abs(w.gap) * gap if w.gap or w.rate else force for w, gap, force in watched]
        )

    # --- building ---------------------------------------------------------------------------------

    def _number(self, regimes: tuple[int, ...]) -> int:
        with self._lock:
            if regimes not in self.regimes:
                self._build(regimes)
            return self.regimes.index(regimes)

    def _after(self, guard: Guard) -> tuple[int, ...]:
        """The regimes that a guard leads to."""
        regimes = list(self.regimes[guard.mode])
        regimes[guard.element] = guard.watch.to
        return tuple(regimes)

    def _now(self, regimes: tuple[int, ...]) -> list[Regime]:
        """What all elements do in these regimes."""
        return [element.regimes[k] for element, k in zip(self._elements, regimes, strict=True)]

    def _build(self, regimes: tuple[int, ...]) -> None:
        number, now = len(self.modes), self._now(regimes)
        structure, drive = self._structure, self._drive
        for element, regime in zip(self._elements, now, strict=True):
            row = element.row(structure.size)
            structure = structure.stiffened(row, regime.stiffness, regime.damping)
            drive = drive.pulled(element, regime)
        held = [e for e, regime in zip(self._elements, now, strict=True) if regime.holds]
        riding = [rides(structure, held, element) for element in self._elements]
        moving = [e for e, along in zip(self._elements, riding, strict=True) if not along]
        watched = [element.row(structure.size) for element in moving]
        hit = [
            element.row(structure.size)
            for element, along in zip(self._elements, riding, strict=True)
            if isinstance(element, HardStop) and along is False
        ]
        if held:
            mode = held_mode(structure, drive, held, watched, hit)
        else:
            mode = free_mode(structure, drive, watched, hit)
        self.modes.append(mode)
        self.regimes.append(regimes)
        for k, (element, regime) in enumerate(zip(self._elements, now, strict=True)):
            if regime.holds:
                force = force_of(mode, structure, drive, held, held.index(element))
                self.guards.append(Guard(number, k, regime.guards[0], force))
            elif element in moving:
                for watch in regime.guards:
                    guard = Guard(number, k, watch, sum_of(mode, element, watch))
                    if watch.event == IMPACT and riding[k] is None:
                        guard.watch = replace(watch, event=JAM)
                    elif watch.event == IMPACT and held:
                        opened, guard.ambiguous = pushed(structure, held, element)
                        guard.opens = self.holding(regimes)[opened] if opened >= 0 else -1
                    self.guards.append(guard)

    def _join(self, guard: Guard) -> None:
        """Find what becomes of the state where a guard is zero."""
        one, guard.target = self.modes[guard.mode], self._number(self._after(guard))
        guard.partner = self.guard(guard.target, guard.element)
        stop = self._elements[guard.element] if guard.watch.event == IMPACT else None
        guard.change = self.modes[guard.target].seen_from(one, stop)

    def _kind(self, guard: Guard) -> EventKind:
        """What it is to be led to another mode."""
        if guard.watch.event == IMPACT:
            return EventKind.CONTACT
        holds = self._now(self.regimes[guard.mode])[guard.element].holds
        return EventKind.RELEASE if holds else EventKind.SWITCH

    def _stacked(self) -> Any:
        from dynkit.systems.impact.contact_kernels import Tables

        modes, guards = self.modes, self.guards
        ladders = stacked([[g.sum for g in guards if g.mode == m] for m in range(len(modes))])
        slots = ladders.step.shape[3]
        if len(modes) > 1 and len(guards) * 2 * slots * (2 * slots + 1) > MOST_NUMBERS:
            raise MemoryError(
                f"elements must not lead to more modes than fit into 256 MB; got {len(modes)}, "
                "one for each set of stops that were pressed at once: give fewer soft stops"
            )
        places = np.zeros((len(modes), self._structure.size), dtype=np.intp)
        for place, mode in zip(places, modes, strict=True):
            place[: len(mode.layout.modes)] = mode.layout.modes
        kick, excursion = np.zeros((len(guards), 4, slots)), np.zeros((len(guards), 2, slots))
        change = np.zeros((len(guards) if len(modes) > 1 else 0, 2 * slots, 2 * slots + 1))
        coupling, restitution = np.zeros((2, len(guards)))
        opens, coupled = np.full(len(guards), -1), np.zeros((len(guards), len(self._elements)))
        for k, guard in enumerate(guards):
            mode, element = modes[guard.mode], self._elements[guard.element]
            if isinstance(element, HardStop) and guard.watch.event == IMPACT:
                contact = mode.contact(element.row(self._structure.size))
                own = element.sign * mode.placed(contact.kick)
                kick[k, :, : mode.layout.seen] = own[:, : mode.layout.seen]
                excursion[k, :, : mode.layout.slots] = mode.placed(contact.brief)
                coupling[k], restitution[k] = contact.coupling, element.restitution
                coupled[k] = self._coupled(guard)
                if guard.opens >= 0:
                    opens[k] = self.guard(guard.mode, guard.opens)
            if guard.change is not None:
                change[k] = _padded(guard.change, slots)
        self.table = np.array([(g.mode, g.element, g.target, self._kind(g)) for g in guards])
        return Tables(
            ladders=ladders,
            first=np.searchsorted([g.mode for g in guards], np.arange(len(modes) + 1)),
            slots=places,
            counts=np.array([len(mode.layout.modes) for mode in modes]),
            element=np.array([g.element for g in guards]),
            event=np.array([g.watch.event for g in guards]),
            target=np.array([g.target for g in guards]),
            partner=np.array([g.partner for g in guards]),
            order=np.array([g.watch.order for g in guards]),
            change=change,
            kick=kick,
            excursion=excursion,
            coupling=coupling,
            restitution=restitution,
            opens=opens,
            ambiguous=np.array([g.ambiguous for g in guards]),
            coupled=coupled > 0.0,
            tolerance=self._tolerance,
            period=0.0 if self._hit else 2.0 * np.pi / self._drive.frequency,
            clock_rate=self._drive.frequency if modes[0].layout.table < 0 else 0.0,
        )

    def _coupled(self, guard: Guard) -> list[bool]:
        """Of all elements whether an impact at a guard changes the rate of their gaps."""
        size, out = self._structure.size, [False] * len(self._elements)
        stops = [k for k, e in enumerate(self._elements) if isinstance(e, HardStop)]
        if len(stops) > 1:
            change = self.modes[guard.mode].pushed(self._elements[guard.element].row(size))
            for k in stops:
                row = self._elements[k].row(size)
                out[k] = bool(abs(row @ change) > ROUNDING * (abs(row) @ abs(change)))
        return out


def _padded(change: Array, slots: int) -> Array:
    """A change of basis (2 b, 2 a + 1) as (2 slots, 2 slots + 1)."""
    b, a = len(change) // 2, change.shape[1] // 2
    out = np.zeros((2, slots, 2 * slots + 1))
    both = change.reshape(2, b, change.shape[1])
    out[:, :b, :a] = both[..., :a]
    out[:, :b, slots : slots + a] = both[..., a:-1]
    out[:, :b, -1] = both[..., -1]
    return out.reshape(2 * slots, -1)
