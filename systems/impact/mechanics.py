"""From a structure and the parameters of its impacts to the arrays that the kernels take."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.exponential.propagators import Propagators, ladder
from dynkit.systems.impact.bases import Basis, basis_of
from dynkit.systems.impact.forced import HIDDEN, Forced, Load
from dynkit.systems.structure.modes import Modes

if TYPE_CHECKING:
    from dynkit.systems.impact.driven import DrivenStructure


@final
class Structure:
    """What follows from mass, damping, stiffness and contact: shared by all other parameters."""

    def __init__(
        self, modes: Modes, mass: Array, damping: Array, stiffness: Array, contact: int
    ) -> None:
        self.mass = mass
        self.damping = damping
        self.stiffness = stiffness
        self.contact = contact
        self.free = basis_of(modes, mass, damping, stiffness)
        self.size = len(mass)
        self.others = np.delete(np.arange(self.size), contact)

    @cached_property
    def kick_velocity(self) -> Array:
        """Velocity changes (N,) of an impulse that changes the contact velocity by one."""
        response = np.linalg.solve(self.mass, np.eye(self.size)[self.contact])
        return np.asarray(response / response[self.contact])

    @cached_property
    def kick(self) -> Array:
        """(4, N) change of the coordinates by `kick_velocity`, then its low parts."""
        return self.free.kick(self.kick_velocity, self.contact)

    @cached_property
    def stuck(self) -> Basis | None:
        """Basis of the structure whose contact coordinate is held; None when nothing is left."""
        if self.size == 1:
            return None
        place = np.ix_(self.others, self.others)
        mass, damping, stiffness = (
            np.ascontiguousarray(m[place]) for m in (self.mass, self.damping, self.stiffness)
        )
        return basis_of(Modes.from_matrices(mass, damping, stiffness), mass, damping, stiffness)

    @cached_property
    def caught(self) -> Array:
        """(2 N - 2, 2 N) stuck coordinates of free ones, whose contact velocity is lost."""
        if self.stuck is None:
            return np.zeros((0, 2))
        x, v = self.free.units()
        v = v - np.outer(v[:, self.contact], self.kick_velocity)
        return _flat(self.stuck.coordinates(x[:, self.others], v[:, self.others]))

    @cached_property
    def released(self) -> Array:
        """(2 N, 2 N - 2) free coordinates of stuck ones, the contact coordinate at zero."""
        if self.stuck is None:
            return np.zeros((2, 0))
        x, v = np.zeros((2, 2 * len(self.others), self.size))
        x[:, self.others], v[:, self.others] = self.stuck.units()
        return _flat(self.free.coordinates(x, v))

    @cached_property
    def excursion(self) -> Array:
        """Changes (2, N) of positions and velocities by brief excursions of the contact coordinate.

        To leading order, where its time integral is one: the positions of the others jump by m^-1 f
        and their velocities by m^-1 (g - c m^-1 f), with f = -C k, g = -K k and k `kick_velocity`;
        m and c are the others' parts of M and C.
        """
        place = np.ix_(self.others, self.others)
        out = np.zeros((2, self.size))
        out[0, self.others] = x = self._answer(self.damping)
        out[1, self.others] = self._answer(self.stiffness) - np.linalg.solve(
            self.mass[place], self.damping[place] @ x
        )
        return out

    @cached_property
    def coupling(self) -> float:
        """Largest change by an `excursion`.

        Springs and dashpots may cancel, which leaves terms that are smaller by a power of the
        duration; what the springs do counts by itself, too.
        """
        largest = abs(self.excursion).max()
        if self.size > 1:
            largest = max(largest, abs(self._answer(self.stiffness)).max())
        # no other, or none that is tied to it: then the contact coordinate itself
        return float(largest) or 1.0

    def _answer(self, part: Array) -> Array:
        """Accelerations (N - 1,) of the others by their part of K k or C k, k `kick_velocity`."""
        place = np.ix_(self.others, self.others)
        forces = part[self.others] @ self.kick_velocity
        return np.asarray(-np.linalg.solve(self.mass[place], forces))


def _flat(units: Array) -> Array:
    """Matrix (2 n, k) of the coordinates (k, 2, n) of k units."""
    return np.ascontiguousarray(units.reshape(len(units), -1).T)


_structures: WeakKeyDictionary[Any, dict[int, Structure]] = WeakKeyDictionary()


def structure_of(driven: DrivenStructure) -> Structure:
    """The shared part, computed once for all oscillators of equal structure and contact."""
    known = _structures.setdefault(driven._derivation, {})
    contact = driven.contact % driven.degrees_of_freedom
    if contact not in known:
        known[contact] = Structure(
            driven.modes,
            driven.mass,
            driven.damping_matrix,
            driven.stiffness,
            contact,
        )
    return known[contact]


@final
@dataclass(frozen=True, eq=False)
class Drive:
    """What acts from outside: forces on all coordinates (N,), and the table, at one frequency.

    The table is at amplitude sin(phase) + offset, phase' = frequency.
    """

    frequency: float
    amplitude: float
    harmonic: Any
    constant: Array

    @property
    def turns(self) -> bool:
        """Whether anything depends on the phase."""
        return self.amplitude > 0.0 or bool(self.harmonic.any())


@final
@dataclass(frozen=True)
class Stand:
    """One place of the table: its middle, and on which side of it the structure stays (1 or -1)."""

    offset: float
    sign: int


@final
class Regime:
    """A regime of the motion in the slots of the kernels: free flight, or contact with the table.

    Attributes
    ----------
    forced : Forced
    layout : Layout
    pairs : Pairs
    """

    def __init__(self, forced: Forced, drive: Drive, seen: NDArray[np.bool_]) -> None:
        self.forced = forced
        self.layout, self.pairs = forced.arranged(~seen, turns=drive.turns)

    @cached_property
    def propagators(self) -> Propagators:
        """The steps of all slots."""
        return Propagators.of(self.pairs)

    def row(self, coefficients: Array) -> Array:
        """Row (2, slots) of a sum (N,) of positions, without their rest."""
        out = np.zeros((2, self.layout.slots))
        if self.forced.basis is not None:
            coefficients_of_modes = coefficients[self.forced.free]
            out[:, self.layout.modes] = self.forced.basis.position_row(coefficients_of_modes)
        if self.layout.table >= 0:
            turn = coefficients @ self.forced.shape
            out[:, self.layout.table] = turn.real, turn.imag
        return out

    def states(self, q: Array, sine: Any, cosine: Any) -> Array:
        """States (..., 2, slots) of coordinates (..., 2, m) and the phase."""
        out = np.zeros((*q.shape[:-1], self.layout.slots))
        out[..., self.layout.modes] = q
        if self.layout.table >= 0:
            out[..., 0, self.layout.table], out[..., 1, self.layout.table] = sine, cosine
        if self.layout.constant >= 0:
            out[..., 0, self.layout.constant] = 1.0
        return out

    def parts(self, states: Array) -> tuple[Array, Array, Array]:
        """Coordinates (..., 2, m), sine and cosine (...) of states (..., 2, slots)."""
        q = states[..., self.layout.modes]
        if self.layout.table < 0:
            none = np.zeros(q.shape[:-2])
            return q, none, none
        return q, states[..., 0, self.layout.table], states[..., 1, self.layout.table]

    def units(self) -> tuple[Array, Array]:
        """Positions and velocities (2 slots, N) of unit states, less those at rest."""
        forced, layout = self.forced, self.layout
        x, v = np.zeros((2, 2, layout.slots, len(forced.rest)))
        if forced.basis is not None:
            for part, own in zip((x, v), forced.basis.units(), strict=True):
                place = layout.modes[:, None], forced.free
                part[:, *place] = own.reshape(2, len(layout.modes), -1)
        if layout.table >= 0:
            x[:, layout.table] = forced.shape.real, forced.shape.imag
            v[:, layout.table] = forced.turning.real, forced.turning.imag
        shape = 2 * layout.slots, len(forced.rest)
        return x.reshape(shape), v.reshape(shape)

    def sum(self, row: Array, offset: float) -> Any:
        """The exponential sum ``offset + row . y`` as the kernels take it."""
        row = row[:, : self.layout.seen]
        return ladder(self.pairs, row, offset, self.propagators, self.layout.table)


def _visible(rows: Array) -> NDArray[np.bool_]:
    """Modes (m,) with a share in any of the rows (k, m)."""
    share = abs(rows)
    return np.asarray((share > HIDDEN * share.max(axis=1, keepdims=True, initial=0.0)).any(axis=0))


def free_regime(structure: Structure, drive: Drive) -> Regime:
    """Free flight."""
    n = structure.size
    load = Load(drive.frequency, drive.harmonic, drive.constant, np.zeros(n, complex), np.zeros(n))
    forced = Forced(structure.free, np.arange(n), load)
    row = structure.free.position_row(np.eye(n)[structure.contact])
    return Regime(forced, drive, _visible(np.concatenate([row, structure.kick[:2]])))


def gap_of(regime: Regime, structure: Structure, drive: Drive, stand: Stand) -> Any:
    """The gap between contact coordinate and table as an exponential sum."""
    c = structure.contact
    row = regime.row(np.eye(structure.size)[c])
    if regime.layout.table >= 0:
        row[0, regime.layout.table] -= drive.amplitude
    return regime.sum(stand.sign * row, stand.sign * (regime.forced.rest[c] - stand.offset))


@final
class Contact:
    """The stuck structure driven by the table: its contact force and the changes of basis."""

    def __init__(self, structure: Structure, drive: Drive, free: Regime, stand: Stand) -> None:
        self._structure = structure
        self._drive = drive
        self._free = free
        self._stand = stand
        s, w, c, others = structure, drive.frequency, structure.contact, structure.others
        told = (s.stiffness + 1j * w * s.damping - w * w * s.mass)[others, c] * drive.amplitude
        shape, rest = np.zeros(s.size, complex), np.zeros(s.size)
        shape[c], rest[c] = drive.amplitude, stand.offset
        load = Load(
            w,
            drive.harmonic[others] - told,
            drive.constant[others] - s.stiffness[others, c] * stand.offset,
            shape,
            rest,
        )
        self.forced = Forced(s.stuck, others, load)

    @cached_property
    def regime(self) -> Regime:
        """The motion on the table."""
        s, c = self._structure, self._structure.contact
        seen = np.ones(0, dtype=bool)
        if s.stuck is not None:
            pulls = (s.stiffness, s.damping, s.mass)
            seen = _visible(np.concatenate([s.stuck.position_row(m[c, s.others]) for m in pulls]))
        return Regime(self.forced, self._drive, seen)

    @cached_property
    def force(self) -> Any:
        """The force of the table on the contact mass, towards the structure's side."""
        s, c, regime = self._structure, self._structure.contact, self.regime
        row = regime.row(s.stiffness[c])
        row = row + regime.pairs.derivative_rows(regime.row(s.damping[c]), 1)
        row = row + regime.pairs.derivative_rows(regime.row(s.mass[c]), 2)
        if regime.layout.table >= 0:
            own = self._drive.harmonic[c]
            row[:, regime.layout.table] -= own.real, own.imag
        offset = s.stiffness[c] @ self.forced.rest - self._drive.constant[c]
        if regime.layout.constant >= 0:
            # Accelerations of what nothing holds.
            offset += row[0, regime.layout.constant]
            row[0, regime.layout.constant] = 0.0
        return regime.sum(self._stand.sign * row, self._stand.sign * float(offset))

    @cached_property
    def to_stuck(self) -> Array:
        """(2 stuck slots, 2 slots + 1) matrix of the kernels' `Stop`."""
        s = self._structure
        x, v = _driven(self._free.forced)
        # The impacts left out take the relative velocity, and what it gives masses coupled by
        # inertia.
        told = 1j * self._drive.frequency * self._drive.amplitude
        lost = v[:, s.contact] - (told.real, told.imag, 0.0)
        v -= np.outer(lost, s.kick_velocity)
        return _matrix(self._free, self.regime, s.caught, x, v)

    @cached_property
    def to_free(self) -> Array:
        """(2 slots, 2 stuck slots + 1) matrix of the kernels' `Stop`."""
        return _matrix(self.regime, self._free, self._structure.released, *_driven(self.forced))


def _driven(forced: Forced) -> tuple[Array, Array]:
    """Positions and velocities (3, N) of the sine, of the cosine, and at rest."""
    x = np.stack([forced.shape.real, forced.shape.imag, forced.rest])
    v = np.stack([forced.turning.real, forced.turning.imag, forced.drift])
    return x, v


def _matrix(one: Regime, other: Regime, modes: Array, x: Array, v: Array) -> Array:
    """Affine change of basis (2 slots of the other, 2 slots of the one + 1).

    From that of the modes alone, and the positions and velocities that the one has of the sine, of
    the cosine, and at rest, (3, N) each.
    """
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
