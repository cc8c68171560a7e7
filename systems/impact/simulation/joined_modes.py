"""Modes that motions have entered, and guards, which lead from one mode to another."""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from operator import attrgetter
from threading import RLock
from typing import Any, final

from dynkit.systems.impact.elements.element import JAM, Element
from dynkit.systems.impact.simulation.regimes import Parts


@final
@dataclass(eq=False)
class Guard:
    """A guard of a mode, and the event at its zero.

    Attributes
    ----------
    mode, element : int
        Numbers of its mode and of its element.
    watch : Watch
    sum : the exponential sum that is positive before the event
    target, partner : int
        Next mode (for an impact, the mode of contact), and the first guard of the same element
        there; -1 if that mode has not been entered.
    change : (2 slots, 2 slots + 1), of both modes, or None
        Affine change of the state from one mode to the other.
    opens : int
        Number of the closed stop that an impact opens, or of the sticking element that it moves; -1
        for none.
    ambiguous : bool
        Whether an impact pushes against a closed stop, or friction leaves its outcome open.
    scrapes : tuple of Scrape, or of Rub
        Friction at an impact.
    rubbed : sequence of bool
        See `Parts.rubbed`; set for Taylor's method only.
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
    scrapes: Any = ()
    rubbed: Any = ()


class JoinedModes(ABC):
    """The modes that motions of one oscillator have entered; in the first one all regimes are 0.

    A subclass must implement `_build`.

    Attributes
    ----------
    modes : list of Mode, or of TaylorMode
    regimes : list of tuple
        Regimes of all elements in each mode.
    parts : Parts
        Rules for the regimes of elements.
    guards : list of Guard
        Guards in the order of their modes.
    """

    parts: Parts
    _elements: tuple[Element, ...]
    _cycled: int | None

    @final
    def _forget(self) -> None:
        """Remove all modes and guards."""
        self._lock = RLock()
        vars(self).pop("_kept", None)
        self.modes: list[Any] = []
        self.regimes: list[tuple[int, ...]] = []
        self.guards: list[Guard] = []

    @final
    def mode(self, regimes: tuple[int, ...]) -> Any:
        """The mode of given regimes; it is built if no motion has entered it."""
        return self.modes[self._number(regimes)]

    @final
    def checked_mode(self, regimes: tuple[int, ...]) -> Any:
        """The mode of given regimes; ValueError if the elements do not have these regimes."""
        counts = [len(element.regimes) for element in self._elements]
        if len(regimes) != len(counts) or not all(
            map(range.__contains__, map(range, counts), regimes)
        ):
            raise ValueError(f"regimes must be below {counts}; got {regimes}")
        return self.mode(regimes)

    @final
    def guard(self, mode: int, element: int) -> int:
        """Number of the first guard of an element in a mode; the mode's first if it has none."""
        first = bisect_left(self.guards, mode, key=attrgetter("mode"))
        own = takewhile(lambda k: self.guards[k].mode == mode, range(first, len(self.guards)))
        return next((k for k in own if self.guards[k].element == element), first)

    @final
    def marks(self, guard: Guard) -> bool:
        """Whether the zero of this guard is the section of an undriven machine."""
        if guard.element != self._cycled:
            return False
        if halts(self._elements[guard.element]):
            return bool(guard.watch.halts)
        return not self.regimes[guard.mode][guard.element]

    @final
    def _number(self, regimes: tuple[int, ...]) -> int:
        with self._lock:
            if regimes not in self.regimes:
                modes, guards = len(self.modes), len(self.guards)
                try:
                    self._build(regimes)
                except BaseException:  # an interrupt leaves no part of a mode
                    del self.modes[modes:], self.regimes[modes:], self.guards[guards:]
                    raise
            return self.regimes.index(regimes)

    @abstractmethod
    def _build(self, regimes: tuple[int, ...]) -> None:
        """Add a mode of these regimes, and its guards."""

    @final
    def _decide(
        self, guard: Guard, rides: bool | None, rubs: Callable[[], tuple[Any, bool]]
    ) -> None:
        """Set the effects of an impact that are the same in all states: what it opens, friction.

        `rides` is that of `Parts.riding` for the stop, and `rubs` gives the friction. If others
        move the stop's row (None), an impact that opens nothing jams the machine.
        """
        guard.opens, guard.ambiguous = self.parts.pushed(self.regimes[guard.mode], guard.element)
        if rides is not None:
            guard.scrapes, open_ = rubs()
            guard.ambiguous = guard.ambiguous or open_
        elif guard.opens < 0:
            guard.watch = replace(guard.watch, event=JAM)


def cycled_by(elements: Sequence[Element]) -> int | None:
    """Number of the element whose events define the section of an undriven machine; None for none.

    It is the first friction element, with the section where slip halts, or else the first soft stop
    whose force is continuous, with the section where its gap closes. At the edge of a stop with a
    preload a motion may cross infinitely often.
    """
    friction = (k for k, element in enumerate(elements) if halts(element))
    others = (k for k, e in enumerate(elements) if not (e.slider or _pushes_at_once(e)))
    return next(friction, next(others, None))


def _pushes_at_once(element: Element) -> bool:
    """Whether the element's force jumps where its gap closes."""
    met = element.regimes[element.regimes[0].guards[0].to]
    return bool(met.push)


def halts(element: Element) -> bool:
    """Whether the element has a regime in which slip may come to a halt."""
    return any(regime.halts for regime in element.regimes)
