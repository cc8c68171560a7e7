"""A linear structure, what drives it and what it hits: as numbers, and as kernels take them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from dynkit.core.validation import (
    Array,
    finite_array,
    finite_scalar,
    in_interval,
    index_in,
    non_negative,
    positive,
    positive_integer,
    unmasked,
)
from dynkit.systems.impact.contact import Contact
from dynkit.systems.impact.mode import Mode, free_mode, gap_of
from dynkit.systems.impact.structure import Drive, Stand, Structure, structure_of
from dynkit.systems.structure.lagrangian import LagrangianStructure

_CACHES = frozenset({"_structure", "_drive", "_free", "_gaps", "_contacts", "_flying", "_touching"})


@dataclass(frozen=True, kw_only=True)
class DrivenStructure(LagrangianStructure):
    """A structure, its forces and its table: the parameters that `ImpactOscillator` describes.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.
    """

    frequency: float
    restitution: float = 0.85
    amplitude: float = 0.1
    offset: float = 0.0
    contact: int = -1
    side: str = "above"
    play: float = math.inf
    harmonic_forces: Any = ()  # kept as tuples
    constant_forces: Any = ()
    chatter_tolerance: float = 1e-16

    structure_independent: ClassVar[frozenset[str]] = _CACHES | {
        "frequency",
        "restitution",
        "amplitude",
        "offset",
        "contact",
        "side",
        "play",
        "harmonic_forces",
        "constant_forces",
        "chatter_tolerance",
    }

    def __post_init__(self) -> None:
        self._set("frequency", positive("frequency", self.frequency))
        self._set("restitution", in_interval("restitution", self.restitution, 0, 1))
        self._set("amplitude", non_negative("amplitude", self.amplitude))
        self._set("offset", finite_scalar("offset", self.offset))
        if self.play != math.inf:
            self._set("play", positive("play", self.play))
        if self.side not in ("above", "below"):
            raise ValueError(f"side must be 'above' or 'below'; got {self.side!r}")
        self._set("chatter_tolerance", non_negative("chatter_tolerance", self.chatter_tolerance))
        n = positive_integer("degrees_of_freedom", self.degrees_of_freedom)
        self._set("contact", index_in("contact", self.contact, -n, n - 1))
        for name, kind in (("harmonic_forces", complex), ("constant_forces", float)):
            self._set(name, _forces(name, getattr(self, name), n, kind))

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def __getstate__(self) -> dict[str, object]:
        return {k: v for k, v in super().__getstate__().items() if k not in _CACHES}

    @property
    def dimension(self) -> int:
        """Number of section coordinates, 2N."""
        return 2 * self.degrees_of_freedom

    @property
    def natural_frequencies(self) -> Array:
        """Natural frequencies of the structure in free flight, undamped, ascending, (N,)."""
        return self.modes.frequencies

    @property
    def modal_matrix(self) -> Array:
        """Mass-normalised modal matrix, (N, N), one mode per column, its last row not negative."""
        return self.modes.matrix

    @cached_property
    def _structure(self) -> Structure:
        return structure_of(self, self.contact)

    @cached_property
    def _drive(self) -> Drive:
        n = self.degrees_of_freedom
        return Drive(
            self.frequency,
            self.amplitude,
            np.array(self.harmonic_forces or (0j,) * n),
            np.array(self.constant_forces or (0.0,) * n),
        )

    @property
    def _stands(self) -> tuple[Stand, ...]:
        sign = 1 if self.side == "above" else -1
        near = Stand(self.offset, sign)
        if self.play == math.inf:
            return (near,)
        return near, Stand(self.offset + sign * self.play, -sign)

    @cached_property
    def _free(self) -> Mode:
        return free_mode(self._structure, self._drive)

    @cached_property
    def _gaps(self) -> tuple[Any, ...]:
        return tuple(
            gap_of(self._free, self._structure, self._drive, stand) for stand in self._stands
        )

    @cached_property
    def _contacts(self) -> tuple[Contact, ...]:
        return tuple(
            Contact(self._structure, self._drive, self._free, stand) for stand in self._stands
        )

    @cached_property
    def _flying(self) -> tuple[Any, int]:
        """What the kernels take until contact begins, and the slots of contact."""
        return _kernel_arguments(self, with_contact=False)

    @cached_property
    def _touching(self) -> tuple[Any, int]:
        """What the kernels take from the first contact on, and the slots of contact."""
        return _kernel_arguments(self, with_contact=True)


def _kernel_arguments(driven: DrivenStructure, *, with_contact: bool) -> tuple[Any, int]:
    """What the kernels take, and the slots of contact; empty arrays where there is none."""
    from dynkit.systems.impact.contact_kernels import Mechanics, Stop

    structure, free = driven._structure, driven._free
    kick = free.placed(structure.kick)
    kick[:, free.layout.seen :] = 0.0
    excursion = free.placed(structure.free.coordinates(*structure.excursion))
    stops = []
    slots = 1
    for side, (stand, gap) in enumerate(zip(driven._stands, driven._gaps, strict=True)):
        force, to_stuck, to_free = gap, np.empty((0, 0)), np.empty((0, 0))
        if with_contact:
            held = driven._contacts[side]
            force, to_stuck, to_free = held.force, held.to_stuck, held.to_free
            slots = held.mode.layout.slots
        stops.append(Stop(gap, force, stand.sign * kick, to_stuck, to_free))
    mechanics = Mechanics(
        tuple(stops),
        free.layout.modes,
        driven.restitution,
        excursion,
        structure.coupling,
        driven.chatter_tolerance,
        driven.frequency if free.layout.table < 0 else 0.0,
    )
    return mechanics, slots


def _forces(name: str, given: Any, size: int, kind: type[Any]) -> tuple[Any, ...]:
    """Forces on all coordinates as a tuple, empty for none."""
    if isinstance(given, tuple) and not given:
        return given
    unmasked(name, given)
    array = np.asarray(given)
    parts = [array.real, array.imag] if kind is complex and np.iscomplexobj(array) else [array]
    for part in parts:
        finite_array(name, part, (size,))
    return tuple(array.astype(kind).tolist())
