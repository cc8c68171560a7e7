"""Impact oscillators as matrices, table and forces, for other programs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.methods import Unsuited
from dynkit.core.kept import cached_property
from dynkit.core.validation import Array

_NEEDED = (
    "mass", "damping_matrix", "stiffness", "frequency", "restitution", "amplitude", "offset",
    "contact", "side", "play", "harmonic_forces", "constant_forces",
)  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class ImpactModel:
    """The numbers of an impact oscillator, and a start.

    The equations are M x'' + C x' + K x = g + Im(F exp(i phase)), phase' = frequency. The
    coordinate ``contact`` remains on its side of a table at amplitude sin(phase) + offset.

    Parameters
    ----------
    mass, damping, stiffness : (N, N)
    harmonic : (N,) of complex
    constant : (N,)
    contact : int
        Not negative.
    sign : int
        1 above the table, -1 below.
    frequency, restitution, amplitude, offset, phase : float
    position, velocity : (N,)
    until : float
    """

    mass: Array
    damping: Array
    stiffness: Array
    harmonic: NDArray[np.complex128]
    constant: Array
    contact: int
    sign: int
    frequency: float
    restitution: float
    amplitude: float
    offset: float
    phase: float
    position: Array
    velocity: Array
    until: float

    @classmethod
    def of(cls, exact: ExactImpacts) -> ImpactModel:
        """Return the model of a system and a start.

        Raises
        ------
        Unsuited
            When the system is not an impact oscillator, or has energies that are not quadratic, a
            second stop, other elements or an impact law.
        """
        system = exact.system
        for name in _NEEDED:
            if not hasattr(system, name):
                raise Unsuited(f"not made for it: no impact oscillator, as it has no {name}")
        if getattr(system, "engine", "") == "Taylor":
            raise Unsuited("not made for it: energies that are not quadratic")
        if system.play != math.inf:
            raise Unsuited("not made for it: a second stop")
        if len(getattr(system, "elements", ())) > 1:
            raise Unsuited("not made for it: other elements than the table")
        if not isinstance(system.restitution, float):
            raise Unsuited("not made for it: an impact law")
        n, shared = len(exact.position), ("frequency", "restitution", "amplitude", "offset")
        return cls(
            mass=np.array(system.mass, dtype=np.float64),
            damping=np.array(system.damping_matrix, dtype=np.float64),
            stiffness=np.array(system.stiffness, dtype=np.float64),
            harmonic=np.array(system.harmonic_forces or (0j,) * n, dtype=np.complex128),
            constant=np.array(system.constant_forces or (0.0,) * n, dtype=np.float64),
            contact=system.contact % n,
            sign=1 if system.side == "above" else -1,
            **{name: getattr(system, name) for name in shared},
            **{name: getattr(exact, name) for name in ("phase", "position", "velocity", "until")},
        )

    @property
    def size(self) -> int:
        """The number N of coordinates."""
        return len(self.mass)

    @property
    def others(self) -> NDArray[np.intp]:
        """Indices of the coordinates without contact, (N - 1,)."""
        return np.delete(np.arange(self.size), self.contact)

    @property
    def kick(self) -> Array:
        """Velocity changes (N,) by an impulse that changes the contact velocity by one."""
        return np.asarray(self.response / self.response[self.contact])

    @cached_property
    def response(self) -> Array:
        """Velocity changes (N,) by a unit impulse on the contact coordinate."""
        return np.asarray(np.linalg.solve(self.mass, np.eye(self.size)[self.contact]))

    def table(self, time: float) -> tuple[float, float, float]:
        """Return position, velocity and acceleration of the table."""
        angle = self.frequency * time + self.phase
        sine, cosine = self.amplitude * math.sin(angle), self.amplitude * math.cos(angle)
        w = self.frequency
        return sine + self.offset, w * cosine, -w * w * sine

    def forces(self, time: float) -> Array:
        """Return the external forces (N,)."""
        turn = np.exp(1j * (self.frequency * time + self.phase))
        return np.asarray(self.constant + (self.harmonic * turn).imag)

    @cached_property
    def forced(self) -> bool:
        """Whether there are external forces."""
        return bool(self.harmonic.any() or self.constant.any())


def first_order(mass: Array, damping: Array, stiffness: Array) -> tuple[Array, Array]:
    """Return the inverse of the mass matrix, and the first-order matrix (2N, 2N) of (x, x')."""
    n, inverse = len(mass), np.asarray(np.linalg.inv(mass), dtype=np.float64)
    matrix = np.zeros((2 * n, 2 * n))
    matrix[:n, n:] = np.eye(n)
    matrix[n:, :n], matrix[n:, n:] = -inverse @ stiffness, -inverse @ damping
    return inverse, np.asarray(matrix)
