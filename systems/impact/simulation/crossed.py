"""Sections of machines without a hard stop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.impact.modes.structure import Contact


@final
@dataclass(frozen=True)
class Crossed:
    """A section of positions and velocities: all of them, or those that it does not fix.

    Attributes
    ----------
    element : Element
        Element whose events are the section of an undriven machine.
    contact : Contact
        Contact of this element.
    halts : bool
        Whether the slip velocity is zero on the section; else the gap is.
    cycled : bool
        Whether the machine is undriven. Otherwise the section fixes nothing.
    size : int
        Number of coordinates without sliders.
    """

    element: Element
    contact: Contact
    halts: bool
    cycled: bool
    size: int

    @property
    def kept(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Numbers of the positions and of the velocities that are section coordinates."""
        everything = np.arange(self.size)
        others = self.contact.others[: self.size - 1] if self.cycled else everything
        return (everything, others) if self.halts else (others, everything)

    def put(self, x: Array, v: Array, *, moving: bool = True) -> None:
        """Put positions and velocities (..., N), or their changes, onto the section."""
        if self.cycled and self.halts:
            self.contact.put(v, self.element.drift * moving)
        elif self.cycled:
            self.contact.put(x, self.element.offset * moving)
