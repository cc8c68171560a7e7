"""Structures for Taylor's method: linear ones in disguise, and others with integrals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import sympy as sp

from dynkit.systems import ImpactChain, ImpactOscillator


class Disguised(ImpactChain):
    """An `ImpactChain` that is not known to be linear, as its potential may depend on the phase."""

    def potential(self, x: Any, phase: Any) -> Any:  # type: ignore[override]
        del phase
        return super().potential(x)


@dataclass(frozen=True, kw_only=True)
class UnitMasses(ImpactOscillator):
    """Unit masses, whose potential a subclass gives."""

    masses: int = 1

    @property
    def degrees_of_freedom(self) -> int:
        return self.masses

    def kinetic(self, v: Any) -> Any:
        return sum(u**2 for u in v) / 2


@dataclass(frozen=True, kw_only=True)
class TodaRing(UnitMasses):
    """Unit masses on a ring of Toda's springs, which is longer by `twist` than at rest."""

    masses: int = 4
    twist: float = 0.0

    def potential(self, x: Any) -> Any:
        around = (*x[1:], x[0] + sp.Float(self.twist))
        return sum(sp.exp(b - a) - 1 - (b - a) for a, b in zip(x, around, strict=True))


@dataclass(frozen=True, kw_only=True)
class Bead(ImpactOscillator):
    """A bead of mass one on the parabola y = x^2 / 2 under weight one, beside a stop."""

    degrees_of_freedom = 1

    def kinetic(self, x: Any, v: Any) -> Any:  # type: ignore[override]
        return (1 + x[0] ** 2) * v[0] ** 2 / 2

    def potential(self, x: Any) -> Any:
        return x[0] ** 2 / 2


@dataclass(frozen=True, kw_only=True)
class DoublePendulumAtAStop(ImpactOscillator):
    """Two rods with masses at their ends; the angle of the second one has a stop."""

    damping: float = 0.1

    degrees_of_freedom = 2

    def kinetic(self, x: Any, v: Any) -> Any:  # type: ignore[override]
        return v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * sp.cos(x[0] - x[1])

    def potential(self, x: Any) -> Any:
        return 3 - 2 * sp.cos(x[0]) - sp.cos(x[1])

    def dissipation(self, v: Any) -> Any:
        return self.damping * (v[0] ** 2 + (v[1] - v[0]) ** 2) / 2


@dataclass(frozen=True, kw_only=True)
class DrivenPivot(ImpactOscillator):
    """A pendulum whose pivot moves up and down, beside a stop."""

    lift: float = 0.3

    degrees_of_freedom = 1

    def kinetic(self, v: Any) -> Any:
        return v[0] ** 2 / 2

    def potential(self, x: Any, phase: Any) -> Any:  # type: ignore[override]
        return (1 + self.lift * sp.cos(phase)) * (1 - sp.cos(x[0]))

    def dissipation(self, v: Any) -> Any:
        return v[0] ** 2 / 20


@dataclass(frozen=True, kw_only=True)
class Turntable(ImpactOscillator):
    """A mass on springs in a frame that turns: gyroscopic terms; and drag that is not linear."""

    rate: float = 0.3

    degrees_of_freedom = 2

    def kinetic(self, x: Any, v: Any) -> Any:  # type: ignore[override]
        return ((v[0] - self.rate * x[1]) ** 2 + (v[1] + self.rate * x[0]) ** 2) / 2

    def potential(self, x: Any) -> Any:
        return (x[0] ** 2 + x[1] ** 2) / 2 + x[1] ** 4 / 4

    def dissipation(self, v: Any) -> Any:
        return v[0] ** 2 / 10 + v[1] ** 2 / 10 + v[1] ** 4 / 40
