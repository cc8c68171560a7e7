"""What acts on a structure: in each of its regimes, what it does and what ends it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, final

import numpy as np

from dynkit.core.validation import Array

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
    """What acts along one row J of a structure's coordinates, and may move.

    Its gap is g = sign (J x - offset - Im(phasor exp(i phase))).

    Attributes
    ----------
    coordinate : int or (int, int) or (N,) tuple of float
        Of J x: a coordinate x_j, a difference x_j - x_i of those named (i, j), or any row.
    offset : float
    sign : 1 or -1
    phasor : complex
        The amplitude of its motion; real where it is in phase with sin(phase).
    """

    coordinate: Any
    offset: float
    sign: int
    phasor: complex

    @final
    def row(self, size: int) -> Array:
        """The row J, (N,)."""
        row, places = np.zeros(size), np.atleast_1d(self.coordinate)
        if places.dtype != int:
            return np.asarray(places, dtype=float)
        row[places] = [1.0] if len(places) == 1 else [-1.0, 1.0]
        return row

    @final
    def goes_with(self, other: Element) -> bool:
        """Whether its gap stays as it is while another one holds what it holds."""
        return bool(self.coordinate == other.coordinate and self.phasor == other.phasor)

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
    phasor: complex = 0j

    @property
    def regimes(self) -> tuple[Regime, ...]:
        return _OPEN, _CLOSED


_OPEN = Regime((Watch(IMPACT, to=1, gap=1.0),))
# after a release the gap, its rate and its acceleration are zero
_CLOSED = Regime((Watch(SWITCH, to=0, order=3),), holds=True)
