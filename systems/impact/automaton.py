"""Modes of an oscillator and the guards that join them, as the kernels take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import repeat
from threading import RLock
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.exponential.stacks import stacked
from dynkit.systems.impact.contact import Contact
from dynkit.systems.impact.elements import IMPACT, Element, EventKind
from dynkit.systems.impact.mode import Mode, free_mode, sum_of, transformed
from dynkit.systems.impact.structure import Drive, Structure

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
    """

    mode: int
    element: int
    watch: Any
    sum: Any
    target: int = -1
    partner: int = -1
    change: Any = None


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
        restitution: float,
        tolerance: float,
    ) -> None:
        self._structure, self._drive, self._elements = structure, drive, tuple(elements)
        self._restitution, self._tolerance = restitution, tolerance
        self._lock = RLock()
        self._tables: Any = None
        self.table: NDArray[np.intp] = np.empty((0, 4), dtype=np.intp)
        self.modes: list[Mode] = []
        self.regimes: list[tuple[int, ...]] = []
        self.guards: list[Guard] = []
        self._contacts: dict[int, Contact] = {}
        self._number((0,) * len(self._elements))

    def mode(self, regimes: tuple[int, ...]) -> Mode:
        """The mode of some regimes, built where no motion has entered it."""
        return self.modes[self._number(regimes)]

    def gap(self, regimes: tuple[int, ...], element: int) -> Any:
        """The sum that the first guard of an element watches in a mode."""
        mode = self._number(regimes)
        return next(g.sum for g in self.guards if g.mode == mode and g.element == element)

    def held(self, element: int) -> Contact:
        """Contact with one element, the others in their first regime."""
        regimes = tuple(int(k == element) for k in range(len(self._elements)))
        return self._contacts[self._number(regimes)]

    def freed(self, number: int, state: Array) -> tuple[Array, int | None]:
        """A state (2, slots) of a mode as one of the first mode, and the element that held it."""
        mode, contact, held = self.modes[number], self._contacts.get(number), None
        states = state[None, :, : mode.layout.slots]
        if contact is not None:
            states, mode = transformed(contact.to_free, states), contact.free
            held = self._elements.index(contact.stop)
        return transformed(self.modes[0].seen_from(mode), states)[0], held

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
        force = abs(s.stiffness[s.contact]) @ own
        rows = [abs(element.row(s.size)) @ own for element in self._elements]
        watched = [(g.watch, rows[g.element]) for g in self.guards]
        return np.array([abs(w.gap) * gap if w.gap or w.rate else force for w, gap in watched])

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

    def _build(self, regimes: tuple[int, ...]) -> None:
        now = [e.regimes[k] for e, k in zip(self._elements, regimes, strict=True)]
        structure, drive = self._structure, self._drive
        rows = [element.row(structure.size) for element in self._elements]
        for row, element, regime in zip(rows, self._elements, now, strict=True):
            structure = structure.stiffened(row, regime.stiffness, regime.damping)
            drive = drive.pulled(element, regime)
        number, mode = len(self.modes), free_mode(structure, drive, rows)
        held = next(
            (e for e, regime in zip(self._elements, now, strict=True) if regime.holds), None
        )
        moving = [e for e in self._elements if held is None or not e.goes_with(held)]
        if held:
            watched = [element.row(structure.size) for element in moving]
            self._contacts[number] = contact = Contact(drive, mode, held, watched)
            mode = contact.mode
        self.modes.append(mode)
        self.regimes.append(regimes)
        for k, (element, regime) in enumerate(zip(self._elements, now, strict=True)):
            if element is held:
                self.guards.append(Guard(number, k, regime.guards[0], contact.force))
            elif element in moving:
                own = [sum_of(mode, element, watch) for watch in regime.guards]
                self.guards += map(Guard, repeat(number), repeat(k), regime.guards, own)

    def _join(self, guard: Guard) -> None:
        """Find what becomes of the state where a guard is zero."""
        one, guard.target = self.modes[guard.mode], self._number(self._after(guard))
        other = self.modes[guard.target]
        guard.partner = next(
            k
            for k, g in enumerate(self.guards)
            if g.mode == guard.target and g.element == guard.element
        )
        before, after = map(self._contacts.get, (guard.mode, guard.target))
        if after and not before:
            guard.change = after.to_stuck
        elif before and not after:
            guard.change = before.to_free
        else:
            guard.change = other.seen_from(one)

    def _kind(self, guard: Guard) -> EventKind:
        """What it is to be led to another mode."""
        if guard.watch.event == IMPACT:
            return EventKind.CONTACT
        regime = self._elements[guard.element].regimes[self.regimes[guard.mode][guard.element]]
        return EventKind.RELEASE if regime.holds else EventKind.SWITCH

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
        for k, guard in enumerate(guards):
            mode = modes[guard.mode]
            if guard.watch.event == IMPACT:
                own = self._elements[guard.element].sign * mode.placed(mode.structure.kick)
                kick[k, :, : mode.layout.seen] = own[:, : mode.layout.seen]
                excursion[k, :, : mode.layout.slots] = mode.placed(mode.structure.brief)
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
            coupling=np.array([self._structure.coupling] * len(guards)),
            restitution=np.array([self._restitution] * len(guards)),
            tolerance=self._tolerance,
            clock_rate=self._drive.frequency if modes[0].layout.table < 0 else 0.0,
        )


def _padded(change: Array, slots: int) -> Array:
    """A change of basis (2 b, 2 a + 1) as (2 slots, 2 slots + 1)."""
    b, a = len(change) // 2, change.shape[1] // 2
    out = np.zeros((2, slots, 2 * slots + 1))
    both = change.reshape(2, b, change.shape[1])
    out[:, :b, :a] = both[..., :a]
    out[:, :b, slots : slots + a] = both[..., a:-1]
    out[:, :b, -1] = both[..., -1]
    return out.reshape(2 * slots, -1)
