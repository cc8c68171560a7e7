"""From a structure and the parameters of its impacts to the arrays that the kernels take."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, final
from weakref import WeakKeyDictionary

import numpy as np

from dynkit.exponential.ladders import Pairs, ladder, padded, rung_sizes, steps
from dynkit.systems.impact.bases import Basis, NormalModes, basis_of
from dynkit.systems.structure.modes import Modes
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.oscillator import ImpactOscillator


@final
class Structure:
    """What follows from mass, damping and stiffness alone: shared by all parameters of the impacts.

    The last coordinate is the one that meets the table.
    """

    def __init__(self, modes: Modes, mass: Array, damping: Array, stiffness: Array) -> None:
        if not modes.frequencies[0] > 0.0:
            raise ValueError(
                "springs must tie the structure to the wall; got one that can move as a rigid body"
            )
        self.mass = mass
        self.damping = damping
        self.stiffness = stiffness
        self.free = basis_of(modes, mass, damping, stiffness)
        self.size = len(mass)
        self._steps: dict[tuple[int, float, int], Array] = {}

    @cached_property
    def kick_velocity(self) -> Array:
        """Velocity changes (N,) of an impulse that changes the contact velocity by one."""
        response = np.linalg.solve(self.mass, np.eye(self.size)[-1])
        return np.asarray(response / response[-1])

    @cached_property
    def kick(self) -> Array:
        """(4, N) change of the coordinates by `kick_velocity`, then its low parts."""
        return self.free.kick(self.kick_velocity, len(self.kick_velocity) - 1)

    @cached_property
    def contact_row(self) -> Array:
        """(2, N) row that gives the contact position from the free coordinates."""
        basis = np.eye(2 * self.size).reshape(2 * self.size, 2, self.size)
        return np.asarray(self.free.positions(basis)[:, -1].reshape(2, self.size))

    @cached_property
    def stuck(self) -> Basis | None:
        """Basis of the structure whose contact coordinate is held; None when nothing is left."""
        n = self.size - 1
        if n == 0:
            return None
        mass, damping, stiffness = (
            np.ascontiguousarray(m[:n, :n]) for m in (self.mass, self.damping, self.stiffness)
        )
        return basis_of(Modes.from_matrices(mass, damping, stiffness), mass, damping, stiffness)

    @cached_property
    def coupling(self) -> float:
        """Largest effect of a unit displacement of the contact coordinate on another."""
        n = self.size - 1
        if n == 0:
            return 1.0  # no other: then the contact coordinate itself
        inverse = np.linalg.inv(self.mass[:n, :n])
        pull = [inverse @ m[:n] @ self.kick_velocity for m in (self.stiffness, self.damping)]
        return float(np.abs(pull).max())

    def steps(self, basis: Basis | None, table: Pairs, smallest: float, rungs: int) -> Array:
        """Propagators of the basis and the table; the basis' own are computed once."""
        count = 0 if basis is None else basis.pairs.count
        out = np.zeros((rungs, 8, padded(count + 1)))
        if basis is not None:
            key = (id(basis), smallest, rungs)
            if key not in self._steps:
                self._steps[key] = steps(basis.pairs, smallest, rungs)[:, :, :count]
            out[:, :, :count] = self._steps[key]
        out[:, :, count] = steps(table, smallest, rungs)[:, :, 0]
        return out


_structures: WeakKeyDictionary[Any, Structure] = WeakKeyDictionary()


def structure_of(oscillator: ImpactOscillator) -> Structure:
    """The shared part, computed once for all oscillators of equal structure."""
    derivation = oscillator._derivation
    if derivation not in _structures:
        _structures[derivation] = Structure(
            oscillator.modes, oscillator.mass, oscillator.damping_matrix, oscillator.stiffness
        )
    return _structures[derivation]


@final
@dataclass(frozen=True)
class Table:
    """The moving table, x_T = amplitude sin(phase) + offset, phase' = frequency."""

    amplitude: float
    offset: float
    frequency: float

    @property
    def pairs(self) -> Pairs:
        """Evolution of the sine and cosine of the table's phase."""
        return Pairs.rotation(self.frequency)


def gap_ladder(structure: Structure, table: Table) -> Any:
    """The gap x_N - x_T as an exponential sum."""
    pairs = Pairs.join(structure.free.pairs, table.pairs)
    smallest, rungs = rung_sizes(pairs)
    n = structure.size
    row = np.zeros((2, n + 1))
    row[:, :n] = structure.contact_row
    row[0, n] = -table.amplitude
    step = structure.steps(structure.free, table.pairs, smallest, rungs)
    return ladder(pairs, row, -table.offset, smallest, step, n, table.amplitude)


@final
class Contact:
    """The stuck structure driven by the table: its contact force and the changes of basis.

    While stuck, positions are Im(shape exp(i phase)) + rest + those of the stuck basis.
    """

    def __init__(self, structure: Structure, table: Table) -> None:
        self.structure = structure
        self.table = table
        self.shape, self.rest = _driven_motion(structure, table)

    @cached_property
    def force(self) -> Any:
        """The force of the table on the contact mass as an exponential sum."""
        s, w = self.structure, self.table.frequency
        n = s.size - 1
        basis = s.stuck
        pairs = self.table.pairs if basis is None else Pairs.join(basis.pairs, self.table.pairs)
        smallest, rungs = rung_sizes(pairs)
        row = np.zeros((2, n + 1))
        if basis is not None:
            unit = np.eye(2 * n).reshape(2 * n, 2, n)
            x, v = basis.positions(unit), basis.velocities(unit)
            row[:, :n] = (x @ s.stiffness[n, :n] + v @ s.damping[n, :n]).reshape(2, n)
            if s.mass[n, :n].any():
                inertia = (x @ s.mass[n, :n]).reshape(2, n)
                row[:, :n] += basis.pairs.derivative_rows(inertia, 2)
        drive = (s.stiffness[n] + 1j * w * s.damping[n] - w * w * s.mass[n]) @ self.shape
        row[:, n] = drive.real, drive.imag
        offset = float(s.stiffness[n] @ self.rest)
        step = s.steps(basis, self.table.pairs, smallest, rungs)
        return ladder(pairs, row, offset, smallest, step, n, abs(drive))

    @cached_property
    def to_stuck(self) -> Array:
        """(2 stuck slots, 2 slots + 1) matrix of the kernels' `Mechanics`."""
        s = self.structure
        n = s.size - 1
        free, stuck = padded(s.size + 1), padded(n + 1)
        inputs = np.zeros((2 * free + 1, 2, free))
        inputs[np.arange(2 * free), np.arange(2 * free) // free, np.arange(2 * free) % free] = 1.0
        x, v = s.free.positions(inputs[..., : s.size]), s.free.velocities(inputs[..., : s.size])
        sine, cosine = inputs[:, 0, s.size], inputs[:, 1, s.size]
        driven_x, driven_v = self._driven(sine, cosine)
        x, v = x - driven_x, v - driven_v
        x[-1] -= self.rest
        # The impacts left out take the relative velocity, and what it gives masses coupled by
        # inertia.
        v -= np.outer(v[:, n], s.kick_velocity)
        out = np.zeros((2 * free + 1, 2, stuck))
        if s.stuck is not None:
            out[..., :n] = s.stuck.coordinates(x[:, :n], v[:, :n])
        out[:, 0, n], out[:, 1, n] = sine, cosine
        return np.ascontiguousarray(out.reshape(2 * free + 1, -1).T)

    @cached_property
    def to_free(self) -> Array:
        """(2 slots, 2 stuck slots + 1) matrix of the kernels' `Mechanics`."""
        s = self.structure
        n = s.size - 1
        free, stuck = padded(s.size + 1), padded(n + 1)
        inputs = np.zeros((2 * stuck + 1, 2, stuck))
        inputs[
            np.arange(2 * stuck), np.arange(2 * stuck) // stuck, np.arange(2 * stuck) % stuck
        ] = 1.0
        sine, cosine = inputs[:, 0, n], inputs[:, 1, n]
        x, v = self._driven(sine, cosine)
        x[-1] += self.rest
        if s.stuck is not None:
            x[:, :n] += s.stuck.positions(inputs[..., :n])
            v[:, :n] += s.stuck.velocities(inputs[..., :n])
        out = np.zeros((2 * stuck + 1, 2, free))
        out[..., : s.size] = s.free.coordinates(x, v)
        out[:, 0, s.size], out[:, 1, s.size] = sine, cosine
        return np.ascontiguousarray(out.reshape(2 * stuck + 1, -1).T)

    def _driven(self, sine: Array, cosine: Array) -> tuple[Array, Array]:
        rate = 1j * self.table.frequency * self.shape
        return (
            np.outer(sine, self.shape.real) + np.outer(cosine, self.shape.imag),
            np.outer(sine, rate.real) + np.outer(cosine, rate.imag),
        )


def _driven_motion(structure: Structure, table: Table) -> tuple[Any, Array]:
    """Complex shape (N,) of the harmonic motion on the table, and the rest position (N,)."""
    n = structure.size - 1
    shape = np.zeros(n + 1, dtype=complex)
    rest = np.zeros(n + 1)
    shape[n], rest[n] = table.amplitude, table.offset
    basis, w = structure.stuck, table.frequency
    if basis is None:
        return shape, rest
    m, c, k = structure.mass, structure.damping, structure.stiffness
    load = -(k[:n, n] + 1j * w * c[:n, n] - w * w * m[:n, n]) * table.amplitude
    if isinstance(basis, NormalModes) and basis.mixing is None:
        decay = -0.5 * basis.pairs.generator[3]
        response = basis.stiffness - w * w + 2j * w * decay
        pushed = basis.matrix.T @ load
        if np.any(pushed[response == 0.0]):
            raise ValueError(
                "frequency must not equal an undamped natural frequency of the structure held at "
                f"the contact; got {w}"
            )
        shape[:n] = basis.matrix @ (pushed / np.where(response == 0.0, 1.0, response))
        rest[:n] = -basis.matrix @ ((basis.matrix.T @ k[:n, n]) / basis.stiffness) * table.offset
    else:
        shape[:n] = np.linalg.solve(k[:n, :n] + 1j * w * c[:n, :n] - w * w * m[:n, :n], load)
        rest[:n] = -np.linalg.solve(k[:n, :n], k[:n, n]) * table.offset
    return shape, rest
