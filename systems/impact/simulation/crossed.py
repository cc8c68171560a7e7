"""Sections of machines without hard stops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.impact.modes.curves import CurvedContact
from dynkit.systems.impact.modes.structure import Contact


@final
@dataclass(frozen=True)
class Crossed:
    """A section whose coordinates are positions and velocities.

    They are all positions and velocities if the machine is driven, or if the element acts along a
    function of the coordinates. Otherwise the position or velocity that the section fixes is left
    out.

    Attributes
    ----------
    element : Element
        Element whose events define the section of an undriven machine.
    contact : Contact or CurvedContact
        Contact of this element.
    halts : bool
        Whether the slip velocity is zero on the section; otherwise the gap is zero.
    cycled : bool
        Whether the machine is undriven. The section of a driven machine is stroboscopic and fixes
        no coordinate.
    size : int
        Number of coordinates without sliders.
    """

    element: Element
    contact: Contact | CurvedContact
    halts: bool
    cycled: bool
    size: int

    @property
    def kept(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Indices of the positions, and of the velocities, that are section coordinates."""
        everything = np.arange(self.size)
        fixed = self.cycled and not self.element.curved
        others = self.contact.others[: self.size - 1] if fixed else everything
        return (everything, others) if self.halts else (others, everything)

    def put(self, x: Array, v: Array) -> None:
        """Put positions and velocities (N + J,) onto the section."""
        if not self.cycled:
            return
        if isinstance(self.contact, Contact):
            own = (v, self.element.drift) if self.halts else (x, self.element.offset)
            self.contact.put(*own)
        elif self.halts:
            self.contact.push(x[: self.size], v[: self.size], self.element.drift)
        else:
            self.contact.put(x[: self.size], self.element.offset)

    def put_changes(self, x: Array, v: Array, place: Array, moving: Array) -> None:
        """Project changes (d, N + J) of positions and velocities onto the section, in place.

        The section is linearised at positions `place` and velocities `moving`.
        """
        if not self.cycled:
            return
        if isinstance(self.contact, Contact):
            self.contact.put(v if self.halts else x, 0.0)
            return
        own = x[:, : self.size], v[:, : self.size]
        along = own[0] @ self.contact.function.gradient(place) * self.halts
        own[self.halts][:] = self.contact.lifted(place, moving, (*own, along, 0.0))[self.halts]
