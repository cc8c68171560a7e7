"""Machines of matrices whose energies are not known to be quadratic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import sympy as sp

from dynkit.systems import ImpactOscillator, MatrixOscillator


@dataclass(frozen=True, kw_only=True)
class DisguisedMatrices(ImpactOscillator):
    """Energies by matrices, given as tuples; the potential may depend on the phase."""

    M: Any = ()
    C: Any = ()
    K: Any = ()

    @property
    def degrees_of_freedom(self) -> int:
        return len(self.M)

    def kinetic(self, v: Any) -> Any:
        return _half(self.M, v)

    def potential(self, x: Any, phase: Any) -> Any:  # type: ignore[override]
        del phase
        return _half(self.K, x)

    def dissipation(self, v: Any) -> Any:
        return _half(self.C, v)


def _half(matrix: Any, z: Any) -> Any:
    rows = zip(matrix, z, strict=True)
    pairs = ((a, b, c) for row, b in rows for a, c in zip(row, z, strict=True))
    return sum(sp.Float(a) * b * c for a, b, c in pairs) / 2


def disguised(machine: MatrixOscillator) -> DisguisedMatrices:
    """The same machine, followed by Taylor's method."""
    names = "M", "C", "K"
    matrices = {name: getattr(machine, name) for name in names}
    same = ("frequency", "harmonic_forces", "constant_forces", "elements", "chatter_tolerance")
    return DisguisedMatrices(**matrices, **{name: getattr(machine, name) for name in same})
