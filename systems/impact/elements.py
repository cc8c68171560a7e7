"""What acts on a structure: in each of its regimes, what it does and what ends it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import IntEnum
from typing import final

IMPACT, SWITCH = range(2)
"""What happens where a guard is zero: the law of impacts in the same regime, or another regime."""


@final
@dataclass(frozen=True)
class Watch:
    """A guard: ``gap * g + rate * g'`` of the element's gap g is positive in a regime.

    With both zero it is the force that holds the gap at zero.

    Attributes
    ----------
    event : IMPACT or SWITCH
    to : int
        The regime that follows; of an impact, where its chatter comes to an end.
    order : int
        How many leading Taylor coefficients of the guard of that regime vanish after a switch.
    """

    event: int
    to: int
    gap: float = 0.0
    rate: float = 0.0
    order: int = 0


@final
@dataclass(frozen=True)
class Regime:
    """What an element does to its coordinate: it holds the gap at zero, or pushes by -k g - c g'.

    Attributes
    ----------
    guards : tuple of Watch
        The first is where the element's own search goes on after an event.
    """

    guards: tuple[Watch, ...]
    holds: bool = False
    stiffness: float = 0.0
    damping: float = 0.0


class EventKind(IntEnum):
    """What happened: an impact, the begin of contact, its end, or another regime of an element."""

    IMPACT = 0
    CONTACT = 1
    RELEASE = 2
    SWITCH = 3


class Element(ABC):
    """What acts on one coordinate of a structure, and moves with the table.

    Its gap is g = sign (x - offset - amplitude sin(phase)).

    Attributes
    ----------
    coordinate : int
    offset : float
    sign : 1 or -1
    """

    coordinate: int
    offset: float
    sign: int

    @property
    @abstractmethod
    def regimes(self) -> tuple[Regime, ...]:
        """What it does; motions begin in the first one."""


@final
@dataclass(frozen=True)
class HardStop(Element):
    """A stop that is hit: open, or closed."""

    coordinate: int
    offset: float
    sign: int

    @property
    def regimes(self) -> tuple[Regime, ...]:
        return _OPEN, _CLOSED


_OPEN = Regime((Watch(IMPACT, to=1, gap=1.0),))
# after a release the gap, its rate and its acceleration are zero
_CLOSED = Regime((Watch(SWITCH, to=0, order=3),), holds=True)
