"""Contact with a stop: the held structure, and the changes of basis to it and back."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.elements import Element
from dynkit.systems.impact.forced import Forced, Load
from dynkit.systems.impact.mode import Mode, visible
from dynkit.systems.impact.structure import Drive


@final
class Contact:
    """The stuck structure driven by the table: its contact force and the changes of basis.

    Rows (N,) of coordinates that elements elsewhere watch are seen, too.
    """

    def __init__(self, drive: Drive, free: Mode, stop: Element, watched: Sequence[Array]) -> None:
        self._structure = s = free.structure
        self._drive = drive
        self.free = free
        self.stop = stop
        self._watched = watched
        w, c, others = drive.frequency, s.contact, s.others
        told = (s.stiffness + 1j * w * s.damping - w * w * s.mass)[others, c] * stop.phasor
        shape, rest = np.zeros(s.size, complex), np.zeros(s.size)
        shape[c], rest[c] = stop.phasor, stop.offset
        load = Load(
            w,
            drive.harmonic[others] - told,
            drive.constant[others] - s.stiffness[others, c] * stop.offset,
            shape,
            rest,
        )
        self.forced = Forced(s.stuck, others, load)

    @cached_property
    def mode(self) -> Mode:
        """The motion on the table."""
        s, c = self._structure, self._structure.contact
        seen = np.ones(0, dtype=bool)
        if s.stuck is not None:
            pulls = [part[c] for part in (s.stiffness, s.damping, s.mass)]
            rows = [s.stuck.position_row(row[s.others]) for row in (*pulls, *self._watched)]
            seen = visible(np.concatenate(rows))
        return Mode(s, self.forced, self._drive, seen)

    @cached_property
    def force(self) -> Any:
        """The force of the table on the contact mass, towards the structure's side."""
        s, c, mode = self._structure, self._structure.contact, self.mode
        row = mode.row(s.stiffness[c])
        row = row + mode.pairs.derivative_rows(mode.row(s.damping[c]), 1)
        row = row + mode.pairs.derivative_rows(mode.row(s.mass[c]), 2)
        if mode.layout.table >= 0:
            own = self._drive.harmonic[c]
            row[:, mode.layout.table] -= own.real, own.imag
        offset = s.stiffness[c] @ self.forced.rest - self._drive.constant[c]
        if mode.layout.constant >= 0:
            # Accelerations of what nothing holds.
            offset += row[0, mode.layout.constant]
            row[0, mode.layout.constant] = 0.0
        return mode.sum(self.stop.sign * row, self.stop.sign * float(offset))

    @cached_property
    def to_stuck(self) -> Array:
        """(2 stuck slots, 2 slots + 1) `change_of_basis`."""
        s = self._structure
        x, v = self.free.driven()
        # The impacts left out take the relative velocity, and what it gives masses coupled by
        # inertia.
        told = 1j * self._drive.frequency * self.stop.phasor
        lost = v[:, s.contact] - (told.real, told.imag, 0.0)
        v -= np.outer(lost, s.kick_velocity)
        return self.mode.change_of_basis(self.free, s.caught, x, v)

    @cached_property
    def to_free(self) -> Array:
        """(2 slots, 2 stuck slots + 1) `change_of_basis`."""
        return self.free.change_of_basis(self.mode, self._structure.released)
