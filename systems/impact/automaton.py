"""Modes of an oscillator and the guards that join them, as the kernels take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from threading import RLock
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.no_motion import Refused
from dynkit.core.validation import Array
from dynkit.exponential.stacks import stacked
from dynkit.systems.impact.contact import Contact
from dynkit.systems.impact.elements import IMPACT, Element, EventKind
from dynkit.systems.impact.mode import Mode, free_mode, sum_of
from dynkit.systems.impact.structure import Drive, Structure


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
    change: Array | None = None


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
        self._acting = [guard for guard in self.guards if guard.watch.event != IMPACT]

    def mode(self, regimes: tuple[int, ...]) -> Mode:
        """The mode of some regimes, built where no motion has entered it."""
        return self.modes[self._number(regimes)]

    def held(self, element: int) -> Contact:
        """Contact with one element, the others in their first regime."""
        regimes = tuple(int(k == element) for k in range(len(self._elements)))
        return self._contacts[self._number(regimes)]

    def enter(self, number: int) -> None:
        """Build the mode that a guard leads to, where no motion has done so."""
        with self._lock:
            guard = self.guards[number]
            target = self._number(self._after(guard))
            for g in (guard, *(g for g in self.guards if g.mode == target)):
                if g.partner < 0 and self._after(g) in self.regimes:
                    self._join(g)
                    self._tables = None

    def check_start(self, state: Array) -> None:
        """Refuse a free state (2, slots) from which an element that is no stop acts at once."""
        for guard in self._acting:
            row, element = guard.sum.rows[:2], self._elements[guard.element]
            gap = float((row * state[:, : row.shape[1]]).sum()) + guard.sum.offset
            if gap < 0.0:
                raise Refused(f"a motion must not begin where {element!r} acts; got a gap of {gap}")

    @property
    def tables(self) -> Any:
        """What the kernels take."""
        with self._lock:
            if self._tables is None:
                self._tables = self._stacked()
            return self._tables

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
        for element, regime in zip(self._elements, now, strict=True):
            structure = structure.stiffened(element.coordinate, regime.stiffness, regime.damping)
            drive = drive.pulled(element, regime)
        watched = [element.coordinate for element in self._elements]
        number, mode = len(self.modes), free_mode(structure, drive, watched)
        holding = [e for e, regime in zip(self._elements, now, strict=True) if regime.holds]
        if holding and any(e.coordinate != holding[0].coordinate for e in self._elements):
            raise NotImplementedError(
                f"{holding[0]!r} must not hold a structure on which elements act elsewhere"
            )
        force = None
        if holding:
            self._contacts[number] = contact = Contact(drive, mode, holding[0])
            mode, force = contact.mode, contact.force
        self.modes.append(mode)
        self.regimes.append(regimes)
        for k, (element, regime) in enumerate(zip(self._elements, now, strict=True)):
            if regime.holds or not holding:
                for watch in regime.guards:
                    found = force or sum_of(mode, drive, element, watch)
                    self.guards.append(Guard(number, k, watch, found))

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
