"""Contact with a stop: the held structure, and the changes of basis to it and back."""

from __future__ import annotations

from functools import cached_property
from typing import Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.bases import row_by_row
from dynkit.systems.impact.elements import Element
from dynkit.systems.impact.forced import Forced, Load
from dynkit.systems.impact.mode import Mode, visible
from dynkit.systems.impact.structure import Drive, Structure


@final
class Contact:
    """The stuck structure driven by the table: its contact force and the changes of basis."""

    def __init__(self, structure: Structure, drive: Drive, free: Mode, stop: Element) -> None:
        self._structure = structure
        self._drive = drive
        self._free = free
        self._stand = stop
        s, w, c, others = structure, drive.frequency, structure.contact, structure.others
        told = (s.stiffness + 1j * w * s.damping - w * w * s.mass)[others, c] * drive.amplitude
        shape, rest = np.zeros(s.size, complex), np.zeros(s.size)
        shape[c], rest[c] = drive.amplitude, stop.offset
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
            pulls = (s.stiffness, s.damping, s.mass)
            seen = visible(np.concatenate([s.stuck.position_row(m[c, s.others]) for m in pulls]))
        return Mode(self.forced, self._drive, seen)

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
        return mode.sum(self._stand.sign * row, self._stand.sign * float(offset))

    @cached_property
    def to_stuck(self) -> Array:
        """(2 stuck slots, 2 slots + 1) `change_of_basis`."""
        s = self._structure
        x, v = _driven(self._free.forced)
        # The impacts left out take the relative velocity, and what it gives masses coupled by
        # inertia.
        told = 1j * self._drive.frequency * self._drive.amplitude
        lost = v[:, s.contact] - (told.real, told.imag, 0.0)
        v -= np.outer(lost, s.kick_velocity)
        return change_of_basis(self._free, self.mode, s.caught, x, v)

    @cached_property
    def to_free(self) -> Array:
        """(2 slots, 2 stuck slots + 1) `change_of_basis`."""
        return change_of_basis(self.mode, self._free, self._structure.released)


def _driven(forced: Forced) -> tuple[Array, Array]:
    """Positions and velocities (3, N) of the sine, of the cosine, and at rest."""
    x = np.stack([forced.shape.real, forced.shape.imag, forced.rest])
    v = np.stack([forced.turning.real, forced.turning.imag, forced.drift])
    return x, v


def change_of_basis(
    one: Mode, other: Mode, modes: Array, x: Array | None = None, v: Array | None = None
) -> Array:
    """Affine change of basis (2 slots of the other, 2 slots of the one + 1).

    From that of the modes alone, and the positions and velocities that the one has of the sine, of
    the cosine, and at rest, (3, N) each; by default its own, which do not jump.
    """
    if x is None or v is None:
        x, v = _driven(one.forced)
    (sine, cosine), forced = np.eye(2, 3), other.forced
    x[2] -= forced.rest
    v[2] -= forced.drift
    driven = other.states(forced.coordinates(x, v, sine, cosine), sine, cosine)
    a, b = one.layout, other.layout
    if b.constant >= 0:
        driven[:2, 0, b.constant] = 0.0
    out = np.zeros((2 * b.slots, 2 * a.slots + 1))
    places = (np.append(layout.modes, layout.slots + layout.modes) for layout in (b, a))
    out[np.ix_(*places)] = modes
    if a.table >= 0:
        out[:, a.table], out[:, a.slots + a.table] = driven[:2].reshape(2, -1)
    out[:, -1] = driven[2].ravel()
    return out


def transformed(matrix: Array, states: Array) -> Array:
    """States (k, 2, slots) in the other basis, by a `change_of_basis`."""
    flat = states.reshape(len(states), states.shape[1] * states.shape[2])
    out = np.broadcast_to(matrix[:, -1], (len(flat), len(matrix)))
    if flat.shape[1]:  # a single mass on a table at rest has no state
        out = row_by_row(flat, matrix[:, :-1]) + out
    return np.asarray(out.reshape(len(states), 2, len(matrix) // 2))
