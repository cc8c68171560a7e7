"""What acts on a structure: in each of its regimes, what it does and what ends it."""

from __future__ import annotations

import cmath
import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from enum import IntEnum
from numbers import Integral
from typing import Any, ClassVar, final

import numpy as np

from dynkit.core.validation import (
    Array,
    finite_array,
    finite_scalar,
    index_in,
    non_negative,
    one_of,
)
from dynkit.systems.impact.elements.laws import ImpactLaw, Restitution, checked_restitution

IMPACT, SWITCH, JAM, HALT, JUMP = range(5)
"""What happens where a guard is zero: the law of impacts in the same regime, another regime, or the
end of the motion. Another regime, too, where a rate has become zero; or only where the guard is
negative at once, after an event."""

RELEASED = 3
"""Order of the gap after contact: it, its rate and its acceleration are zero."""

LAIN = 2
"""Regime of a hard stop that is open, and at which friction holds what it stops."""


@final
@dataclass(frozen=True)
class Watch:
    """A guard: ``gap * g + rate * g' + force * f + stretch * e + level`` is positive in a regime.

    Of the element's gap g, the force f along its row where it holds or sticks, and how far e the
    spring to its slider is stretched.

    Attributes
    ----------
    to : int
        The regime that follows; of an impact, where its chatter comes to an end.
    order : int
        How many leading Taylor coefficients of the guard of that regime vanish after a switch.
    event : SWITCH, IMPACT, JAM, HALT or JUMP
        IMPACT and JAM are for hard stops, ``Watch.HALT`` and ``Watch.JUMP`` for friction.
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

    @property
    def hits(self) -> bool:
        """Whether an impact happens where it is zero."""
        return self.event in (IMPACT, JAM)

    @property
    def halts(self) -> bool:
        """Whether it is a rate that becomes zero there."""
        return self.event == HALT

    @property
    def at_once(self) -> bool:
        """Whether it matters only just after an event, where it is negative."""
        return self.event == JUMP


@final
@dataclass(frozen=True)
class Regime:
    """What an element does to its coordinate: it pushes by p - k g - c g', or by what it takes.

    By what it takes to hold the gap at zero, or to stick: to hold its rate at zero.

    Attributes
    ----------
    guards : tuple of Watch
        The first is where the element's own search goes on after an event.
    anchored : bool
        Its spring ends at its slider, which sticks to its surface.
    stretch : float
        Of the spring to its slider, where that slides.
    """

    guards: tuple[Watch, ...]
    holds: bool = False
    sticks: bool = False
    push: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    anchored: bool = False
    stretch: float = 0.0

    @property
    def acts(self) -> bool:
        """Whether it pushes."""
        return bool(self.push or self.stiffness or self.damping)

    @property
    def halts(self) -> bool:
        """Whether it slips, and may come to a halt."""
        return self.guards[0].halts


class EventKind(IntEnum):
    """What happened: an impact, the begin of contact, its end, or another regime of an element."""

    IMPACT = 0
    CONTACT = 1
    RELEASE = 2
    SWITCH = 3


@dataclass(frozen=True)
class Element(ABC):
    """What acts along one row J of a structure's coordinates, and may move: a `HardStop`, for one.

    Its gap is J x - offset - amplitude sin(phase of the oscillator - phase), or minus that.

    Parameters
    ----------
    coordinate : int or (int, int) or (N,) sequence of float
        Of J x: a coordinate x_j, a difference x_j - x_i of two, given as (i, j), or any row.
    offset : float
        Middle of its motion.
    amplitude : float
        Of its motion, not negative.
    phase : float
        By which its motion lags.
    side : {"above", "below"}
        On which side of it the gap is positive.
    name : str
        Its parameters are ``name.offset`` and so on; by default ``elements[k].offset``.

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
        for name, check in (
            ("offset", finite_scalar),
            ("amplitude", non_negative),
            ("phase", finite_scalar),
        ):
            self._set(name, check(name, getattr(self, name)))
        one_of("side", self.side, ("above", "below"))
        if self.name and not str(self.name).isidentifier():
            raise ValueError(f"name must be a name like 'table'; got {self.name!r}")
        given = self.coordinate
        if isinstance(given, tuple | list) and len(given) == 2 and all(map(_is_index, given)):
            self._set("coordinate", (int(given[0]), int(given[1])))
        elif not _is_index(given):
            self._set("coordinate", tuple(finite_array("coordinate", given, (None,)).tolist()))

    @final
    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    @property
    def sign(self) -> int:
        """1 above it, -1 below."""
        return 1 if self.side == "above" else -1

    @property
    def phasor(self) -> complex:
        """Complex amplitude of its motion: that is Im(phasor exp(i phase of the oscillator))."""
        return self.amplitude * cmath.exp(-1j * self.phase) if self.phase else self.amplitude

    @property
    def drift(self) -> float:
        """Velocity with which it moves besides."""
        return 0.0

    @final
    def swing(self, sine: Any, cosine: Any) -> Any:
        """Where it is, from the middle of its motion, by the phase of the oscillator."""
        return self.phasor.real * sine + self.phasor.imag * cosine

    @final
    def swing_rate(self, frequency: float, sine: Any, cosine: Any) -> Any:
        """Rate of change of where it is."""
        turned = self.phasor.imag * frequency * sine
        return self.phasor.real * frequency * cosine - turned

    @property
    @abstractmethod
    def regimes(self) -> tuple[Regime, ...]:
        """What it does; in flight it is in the first one."""

    @final
    @property
    def slider(self) -> bool:
        """Whether it has a slider, whose place is a number of the state."""
        return self.spring > 0.0

    @final
    @property
    def spring(self) -> float:
        """Stiffness of the spring to its slider; 0 where it has none."""
        return max(regime.stiffness if regime.anchored else 0.0 for regime in self.regimes)

    @final
    @property
    def reach(self) -> float:
        """How far its slider is behind where it slides."""
        return max(abs(regime.stretch) for regime in self.regimes)

    @final
    @property
    def doing(self) -> list[str]:
        """What it does in each regime, in a word: it contacts, sticks, presses, or nothing."""
        first, apart = self.regimes[0], not any(regime.sticks for regime in self.regimes)
        return [
            "contacts"
            if regime.holds
            else "sticks"
            if regime.sticks or regime.anchored
            else "presses"
            if regime.acts and apart and not first.acts
            else ""
            for regime in self.regimes
        ]

    @final
    def row(self, size: int) -> Array:
        """The row J, (N,), and zeros where there are more coordinates."""
        row, places = np.zeros(size), np.atleast_1d(self.coordinate)
        if places.dtype != int:
            row[: len(places)] = places
            return row
        row[places] = [1.0] if len(places) == 1 else [-1.0, 1.0]
        return row

    @final
    def of(self, size: int, where: str) -> Element:
        """The same with indices of coordinates in [0, N); ValueError where there is none."""
        name, given = f"{where}.coordinate", self.coordinate
        if isinstance(given, Integral):
            return replace(self, coordinate=index_in(name, given, -size, size - 1) % size)
        if len(given) == 2 and all(map(_is_index, given)):
            pair = tuple(index_in(name, k, -size, size - 1) % size for k in given)
            if pair[0] == pair[1]:
                raise ValueError(f"{name} must be a pair of two coordinates; got {given}")
            return replace(self, coordinate=pair)
        if not finite_array(name, given, (size,)).any():
            raise ValueError(f"{name} must be a row that is not zero; got {given}")
        return self


@final
@dataclass(frozen=True)
class HardStop(Element):
    """A stop that is hit: an impact turns the rate -u of its gap into restitution u.

    Between two masses, given as (i, j), they hit each other where x_j - x_i falls to its place.

    Parameters
    ----------
    coordinate, offset, amplitude, phase, side, name
        As for every `Element`; its gap is never negative.
    restitution : float or ImpactLaw
        Coefficient of restitution in [0, 1], or a law by which it depends on u, such as
        `ViscoelasticSpheres`, `PlasticBelow`, or one's own.

    Examples
    --------
    Two masses that may come no closer than 0.2 less than at rest:

    >>> from dynkit.systems import HardStop, ImpactChain
    >>> pair = ImpactChain(masses=2, frequency=1.5, harmonic_forces=[0.0, 0.8], elements=[
    ...     HardStop((0, 1), offset=-0.2, restitution=0.5),
    ... ])
    >>> print(pair.attractor().label)
    P(1,1)
    """

    _: KW_ONLY
    restitution: Restitution = 0.85

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("restitution", checked_restitution("restitution", self.restitution))

    @property
    def regimes(self) -> tuple[Regime, ...]:
        return _OPEN, _CLOSED, _OPEN


_OPEN = Regime((Watch(to=1, gap=1.0, event=IMPACT),))
_CLOSED = Regime((Watch(to=0, force=1.0, order=RELEASED),), holds=True)


@final
@dataclass(frozen=True)
class SoftStop(Element):
    """A stop with a spring and a dashpot: where its gap g < 0 its force is max(0, p - k g - c g').

    It never pulls: where the dashpot would, what it stops has left it before the gap has closed.

    Parameters
    ----------
    coordinate, offset, amplitude, phase, side, name
        As for every `Element`.
    stiffness, damping : float
        k and c, not negative.
    preload : float
        p, not negative: the spring is compressed when it is met, and the force jumps to p there. A
        mass that is pressed against it by less than p crosses the place g = 0 more and more often,
        and a motion that does so without end stops with a name (`record.ending`). One of k, c and p
        is positive; with p alone the force is constant.

    Examples
    --------
    Two masses whose first one runs into a cushion, the second one above a vibrating table:

    >>> from dynkit.systems import HardStop, ImpactChain, SoftStop
    >>> machine = ImpactChain(masses=2, frequency=0.9, elements=[
    ...     HardStop(1, amplitude=0.1, restitution=0.85),
    ...     SoftStop(0, offset=0.02, stiffness=50.0, damping=0.2),
    ... ])
    >>> machine.simulate(impacts=50).events
    <Events: 50 impacts, 0 contacts, 0 releases, 283 other switches>
    """

    _: KW_ONLY
    stiffness: float
    damping: float = 0.0
    preload: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("stiffness", "damping", "preload"):
            self._set(name, non_negative(name, getattr(self, name)))
        if self.stiffness == self.damping == self.preload == 0.0:
            raise ValueError("stiffness must be positive where damping and preload are 0; got 0.0")

    @property
    def regimes(self) -> tuple[Regime, ...]:
        """Outside, pressing, lifted; with a preload pressing again, entered by the force."""
        k, c, p = self.stiffness, self.damping, self.preload
        # The gap is what vanishes where pressing begins, but for a force of the dashpot alone.
        touched = Watch(to=1, gap=1.0, order=0 if c and not p else 1)
        left = Watch(to=0, gap=-1.0 if c else -(k or 1.0), order=1)
        if c == 0.0:
            return Regime((touched,)), Regime((left,), push=p, stiffness=k)
        lifted = Watch(to=2, gap=-k, rate=-c, level=p, order=1)
        pressed = Watch(to=3 if p else 1, gap=k, rate=c, level=-p, order=1)
        guards = [(left, lifted), (lifted, left)] if p else [(lifted,)]
        pressing = [Regime(own, push=p, stiffness=k, damping=c) for own in guards]
        return Regime((touched,)), pressing[0], Regime((pressed, left)), *pressing[1:]


def _is_index(given: object) -> bool:
    return isinstance(given, Integral) and not isinstance(given, bool)


def checked_elements(given: Any, size: int) -> tuple[Element, ...]:
    """Elements on a structure of N coordinates; ValueError for what is none."""
    if isinstance(given, Element) or not isinstance(given, Iterable):
        raise ValueError(f"elements must be a sequence of elements; got {given!r}")
    elements = tuple(given)
    if not elements:
        raise ValueError("elements must hold one element at least; got none")
    for k, element in enumerate(elements):
        if not isinstance(element, Element):
            raise ValueError(f"elements[{k}] must be an element like HardStop; got {element!r}")
        hits = any(watch.event == IMPACT for regime in element.regimes for watch in regime.guards)
        if (hits or any(r.holds for r in element.regimes)) and not isinstance(element, HardStop):
            raise ValueError(
                f"elements[{k}] must not be hit, nor hold, which is for HardStop; got {element!r}"
            )
        if element.slider and not element.regimes[0].anchored:
            raise ValueError(
                f"elements[{k}] must stick in its first regime, as it does in one; got {element!r}"
            )
    names = [element.name for element in elements if element.name]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"elements must have different names; got {name!r} twice")
    return tuple(element.of(size, f"elements[{k}]") for k, element in enumerate(elements))


def names_of(elements: tuple[Element, ...]) -> list[str]:
    """Their names, or ``elements[k]``."""
    return [element.name or f"elements[{k}]" for k, element in enumerate(elements)]


def numbers_of(elements: tuple[Element, ...]) -> dict[str, float]:
    """The parameters of elements by their names."""
    found: dict[str, float] = {}
    for name, element in zip(names_of(elements), elements, strict=True):
        for entry in dataclasses.fields(element):
            found |= numbers_in(f"{name}.{entry.name}", getattr(element, entry.name))
    return found


def numbers_in(name: str, value: object) -> dict[str, float]:
    """The parameters that a field of this name has: itself, or those of a law, or none."""
    if isinstance(value, ImpactLaw):
        return {f"{name}.{own}": number for own, number in value.numbers.items()}
    return {name: value} if isinstance(value, float) else {}


def with_law(name: str, law: object, given: Mapping[str, Any]) -> dict[str, Any]:
    """The given fields, with those that are numbers of a law, ``name.number``, made that law."""
    start = f"{name}."
    own = {n.removeprefix(start): v for n, v in given.items() if n.startswith(start)}
    if not own:
        return dict(given)
    others = {n: v for n, v in given.items() if not n.startswith(start)}
    return others | {name: replace(given.get(name, law), **own)}


def with_numbers(elements: tuple[Element, ...], given: Mapping[str, Any]) -> tuple[Element, ...]:
    """The elements with other values of some of the parameters that `numbers_of` names."""
    found = list(elements)
    for k, name in enumerate(names_of(elements)):
        start = f"{name}."
        own = {n.removeprefix(start): v for n, v in given.items() if n.startswith(start)}
        law = getattr(elements[k], "restitution", None)
        found[k] = replace(elements[k], **with_law("restitution", law, own))
    return tuple(found)
