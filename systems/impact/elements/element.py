"""Elements: forces on a structure in several regimes, and the guards that end a regime."""

from __future__ import annotations

import cmath
from abc import ABC, abstractmethod
from dataclasses import KW_ONLY, dataclass, replace
from enum import IntEnum
from numbers import Integral
from typing import Any, ClassVar, final

import numpy as np

from dynkit.core.overriding import Extensible
from dynkit.core.validation import (
    Array,
    check_fields,
    finite_array,
    finite_scalar,
    index_in,
    non_negative,
    one_of,
    regular_array,
)

IMPACT, SWITCH, JAM, HALT, JUMP, REST = range(6)
"""Kinds of events where a guard becomes zero.

IMPACT: an impact, without a change of regime. SWITCH: another regime. JAM: the end of the motion.
HALT: another regime, because a rate has become zero. JUMP: another regime, only if the guard is
negative at a start or just after an event. REST: another regime, only where a motion begins at rest
with this guard at zero."""

RELEASED = 3
"""Order of the gap's zero at a release: the gap, its rate and its acceleration are zero."""

RIDES = 2
"""Code of a slider that sticks while the coordinate it follows cannot move over its surface."""

LAIN = 2
"""Regime of a hard stop that is open while friction holds the mass at a gap of zero."""


@final
@dataclass(frozen=True)
class Watch:
    """A guard of a regime: a linear function of the motion, positive while the regime lasts.

    The guard is ``gap * g + rate * g' + force * f + normal * n + stretch * e + level``. Here g is
    the element's gap, and f is the force along its row while it holds or sticks. For friction at a
    contact, n is the normal force, and e is the stretch of the spring to the element's slider.

    Attributes
    ----------
    to : int
        Regime that follows; for an impact, the regime after a complete chatter.
    order : int
        Number of leading Taylor coefficients of the next guard that are zero after a switch.
    event : SWITCH, IMPACT, JAM, HALT, JUMP or REST
        IMPACT and JAM are for hard stops, ``Watch.HALT`` and ``Watch.JUMP`` for friction, REST for
        soft stops with a preload.
    """

    HALT: ClassVar = HALT
    JUMP: ClassVar = JUMP
    to: int
    gap: float = 0.0
    rate: float = 0.0
    force: float = 0.0
    stretch: float = 0.0
    level: float = 0.0
    order: int = 0
    event: int = SWITCH
    normal: float = 0.0

    @property
    def hits(self) -> bool:
        """Whether a stop is hit where the guard becomes zero."""
        return self.event in (IMPACT, JAM)

    @property
    def halts(self) -> bool:
        """Whether the guard is a rate that becomes zero, and the element may then stick."""
        return self.event == HALT

    @property
    def at_once(self) -> bool:
        """Whether the guard counts only at a start or just after an event (JUMP, REST)."""
        return self.event in (JUMP, REST)


@final
@dataclass(frozen=True)
class Regime:
    """A regime of an element: its force or constraint, and the guards that end it.

    The force is p - k g - c g' + t n, where n is the contact force of the element's normal stop. A
    constraint keeps the gap at zero (``holds``) or the rate of the gap at zero (``sticks``).

    Attributes
    ----------
    guards : tuple of Watch
        The search for the next event starts with the first guard. The first regime of an element
        with a normal stop has no guards: it lasts while that stop is open.
    push, stiffness, damping : float
        p, k and c.
    anchored : bool
        Whether the spring ends at a slider that sticks to its surface.
    stretch : float
        Stretch of the spring to the slider while that slides.
    traction : float
        t, for `DryFriction`.
    """

    guards: tuple[Watch, ...]
    holds: bool = False
    sticks: bool = False
    push: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    anchored: bool = False
    stretch: float = 0.0
    traction: float = 0.0

    @property
    def acts(self) -> bool:
        """Whether the regime has a force law: push, stiffness, damping or traction."""
        return bool(self.push or self.stiffness or self.damping or self.traction)

    @property
    def halts(self) -> bool:
        """Whether the first guard is a slip velocity at whose zero the element may stick."""
        return bool(self.guards) and self.guards[0].halts


class EventKind(IntEnum):
    """Kind of an event: an impact, the begin or end of contact, or another change of regime."""

    IMPACT = 0
    CONTACT = 1
    RELEASE = 2
    SWITCH = 3


@dataclass(frozen=True)
class Element(Extensible, ABC):
    """Base of all elements: forces or constraints along one row J of a structure's coordinates.

    The element may move. Its gap is y - offset - amplitude sin(phase of the oscillator - phase),
    with y = J x, or minus that for ``side="below"``.

    Parameters
    ----------
    coordinate : int or (int, int) or (N,) sequence of float or str
        Defines y: an index j for x_j, a pair (i, j) for x_j - x_i, the row J, or the name of a
        method of the oscillator. This method takes the coordinates, as ``potential`` does, and
        returns y as a smooth expression; J is then the gradient of y.
    offset : float
        Middle of the element's motion.
    amplitude : float
        Amplitude of the element's motion, not negative.
    phase : float
        Lag of the element's motion, in radians.
    side : {"above", "below"}
        Side of the element on which the gap is positive.
    name : str
        Name in parameters such as ``name.offset``; by default ``elements[k].offset``.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.
    """

    coordinate: Any
    _: KW_ONLY
    offset: float = 0.0
    amplitude: float = 0.0
    phase: float = 0.0
    side: str = "above"
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self, offset=finite_scalar, amplitude=non_negative, phase=finite_scalar)
        one_of("side", self.side, ("above", "below"))
        given: Any = self.name
        if not isinstance(given, str) or (given and not given.isidentifier()):
            raise ValueError(f"name must be a name like 'table'; got {given!r}")
        self._set("name", str(given))
        given = self.coordinate
        if isinstance(given, str):
            if not given.isidentifier():
                raise ValueError(f"coordinate must be a name like 'height'; got {given!r}")
        elif isinstance(given, tuple | list) and len(given) == 2 and all(map(_is_index, given)):
            self._set("coordinate", (int(given[0]), int(given[1])))
        elif not _is_index(given):
            if not regular_array("coordinate", given).ndim:
                raise ValueError(
                    "coordinate must be the number of a coordinate, a pair of numbers, N real "
                    f"numbers or a name; got {given!r}"
                )
            self._set("coordinate", tuple(finite_array("coordinate", given, (None,)).tolist()))

    @final
    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    @property
    def sign(self) -> int:
        """1 if the gap is positive above the element, -1 if it is positive below."""
        return 1 if self.side == "above" else -1

    @property
    def phasor(self) -> complex:
        """Complex amplitude of the motion Im(phasor exp(i phase of the oscillator))."""
        return self.amplitude * cmath.exp(-1j * self.phase) if self.phase else self.amplitude

    @property
    def drift(self) -> float:
        """Constant velocity, added to the harmonic motion."""
        return 0.0

    @property
    @final
    def moves(self) -> bool:
        """Whether the element moves, by its harmonic motion or its drift."""
        return bool(self.phasor or self.drift)

    @final
    def swing(self, sine: Any, cosine: Any) -> Any:
        """Displacement from the middle of the motion, from the sine and cosine of the phase."""
        return self.phasor.real * sine + self.phasor.imag * cosine

    @final
    def swing_rate(self, frequency: float, sine: Any, cosine: Any) -> Any:
        """Rate of change of `swing`."""
        turned = self.phasor.imag * frequency * sine
        return self.phasor.real * frequency * cosine - turned

    @property
    def leans_on(self) -> str:
        """Name of the hard stop whose contact force is its normal force; empty for none."""
        return ""

    @property
    @abstractmethod
    def regimes(self) -> tuple[Regime, ...]:
        """The regimes of the element; free flight is in the first one."""

    @property
    @final
    def slider(self) -> bool:
        """Whether the element has a slider, whose position is part of the state."""
        return self.spring > 0.0

    @property
    @final
    def spring(self) -> float:
        """Stiffness of the spring to the slider; 0 for an element without slider."""
        return max(regime.stiffness if regime.anchored else 0.0 for regime in self.regimes)

    @property
    @final
    def reach(self) -> float:
        """Stretch of the spring while the slider slides."""
        return max(abs(regime.stretch) for regime in self.regimes)

    @property
    @final
    def doing(self) -> list[str]:
        """One word for each regime: contacts, rests, sticks, presses, or an empty string."""
        first, apart = self.regimes[0], not any(regime.sticks for regime in self.regimes)
        hit = any(watch.hits for regime in self.regimes for watch in regime.guards)
        return [
            ("contacts" if hit else "rests")
            if regime.holds
            else "sticks"
            if regime.sticks or regime.anchored
            else "presses"
            if regime.acts and apart and not first.acts
            else ""
            for regime in self.regimes
        ]

    @property
    @final
    def curved(self) -> bool:
        """Whether y is a function of the coordinates; then the row depends on them."""
        return isinstance(self.coordinate, str)

    @final
    def row(self, size: int) -> Array:
        """The row J, (N,), padded with zeros to a given size; all zeros if `curved`."""
        row, given = np.zeros(size), self.coordinate
        if self.curved:
            return row
        if isinstance(given, Integral):
            row[given] = 1.0
        elif _is_index(given[0]):
            row[given[0]], row[given[1]] = -1.0, 1.0
        else:
            row[: len(given)] = given
        return row

    @final
    def of(self, size: int, where: str) -> Element:
        """The same element with its indices in [0, N); ValueError if they are out of range."""
        name, given = f"{where}.coordinate", self.coordinate
        if self.curved or (type(given) is int and 0 <= given < size):
            return self
        if isinstance(given, Integral):
            return replace(self, coordinate=index_in(name, given, -size, size - 1) % size)
        if len(given) == 2 and all(map(_is_index, given)):
            pair = tuple(index_in(name, k, -size, size - 1) % size for k in given)
            if pair[0] == pair[1]:
                raise ValueError(f"{name} must be a pair of two coordinates; got {given}")
            return self if pair == given else replace(self, coordinate=pair)
        if not finite_array(name, given, (size,)).any():
            raise ValueError(f"{name} must be a row that is not zero; got {given}")
        return self


def _is_index(given: object) -> bool:
    return isinstance(given, Integral) and not isinstance(given, bool)
