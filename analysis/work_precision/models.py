"""Impact oscillators as other programs take them: matrices, table, forces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.methods import Unsuited
from dynkit.core.validation import Array

_NEEDED = (
    "mass", "damping_matrix", "stiffness", "frequency", "restitution", "amplitude", "offset",
    "contact", "side", "play", "harmonic_forces", "constant_forces",
)  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class ImpactModel:
    """An impact oscillator in numbers, and a start.

    M x'' + C x' + K x = g + Im(F exp(i phase)), phase' = frequency; coordinate ``contact`` stays on
    its side of a table at amplitude sin(phase) + offset.

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
        """Return the numbers of a system.

        Raises
        ------
        Unsuited
            When it is no impact oscillator, or has a second stop.
        """
        system = exact.system
        for name in _NEEDED:
            if not hasattr(system, name):
                raise Unsuited(f"not made for it: no impact oscillator, as it has no {name}")
        if system.play != math.inf:
            raise Unsuited("not made for it: a second stop")
        n = len(exact.position)
        return cls(
            np.array(system.mass, dtype=np.float64),
            np.array(system.damping_matrix, dtype=np.float64),
            np.array(system.stiffness, dtype=np.float64),
            np.array(system.harmonic_forces or (0j,) * n, dtype=np.complex128),
            np.array(system.constant_forces or (0.0,) * n, dtype=np.float64),
            system.contact % n,
            1 if system.side == "above" else -1,
            system.frequency,
            system.restitution,
            system.amplitude,
            system.offset,
            exact.phase,
            exact.position,
            exact.velocity,
            exact.until,
        )

    @property
    def size(self) -> int:
        """N."""
        return len(self.mass)

    @property
    def others(self) -> NDArray[np.intp]:
        """The coordinates that do not meet the table, (N - 1,)."""
        return np.delete(np.arange(self.size), self.contact)

    @property
    def kick(self) -> Array:
        """Velocity changes (N,) of an impulse that changes the contact velocity by one."""
        response = np.linalg.solve(self.mass, np.eye(self.size)[self.contact])
        return np.asarray(response / response[self.contact])

    def table(self, time: float) -> tuple[float, float, float]:
        """Position, velocity and acceleration of the table."""
        angle = self.frequency * time + self.phase
        sine, cosine = self.amplitude * math.sin(angle), self.amplitude * math.cos(angle)
        w = self.frequency
        return sine + self.offset, w * cosine, -w * w * sine

    def forces(self, time: float) -> Array:
        """Forces (N,) from outside."""
        turn = np.exp(1j * (self.frequency * time + self.phase))
        return np.asarray(self.constant + (self.harmonic * turn).imag)

    @cached_property
    def forced(self) -> bool:
        """Whether there are forces from outside."""
        return bool(self.harmonic.any() or self.constant.any())
