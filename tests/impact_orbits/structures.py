"""Structures that the tests of orbits are run on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from dynkit.systems.impact.oscillators.ball import BouncingBall
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.oscillators.play import PlayOscillator
from dynkit.systems.impact.oscillators.single import SingleImpactOscillator
from dynkit.systems.structure.chain import chain_kinetic, chain_links
from tests.impact.test_blocks import CRITICAL, DOUBLE, FOURFOLD, TRIPLE, Matrices, graded

if TYPE_CHECKING:
    import sympy


def matrices(structure: Matrices, **parameters: Any) -> MatrixOscillator:
    mass, damping, stiffness = structure
    return MatrixOscillator(M=mass, C=damping, K=stiffness, **parameters)


@dataclass(frozen=True, kw_only=True)
class GroundedChain(ImpactOscillator):
    """Two unit masses; the outer one's spring to the ground hardens like the square of `grip`."""

    grip: float = 1.2
    drag: float = 0.15

    degrees_of_freedom = 2
    structure_independent: ClassVar[frozenset[str]] = ImpactOscillator.structure_independent

    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return chain_kinetic((1.0, 1.0), v)

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return chain_links((1.0, 1.0), x) + self.grip**2 * x[1] ** 2 / 2

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return chain_links((0.1, 0.1), v) + self.drag * v[0] ** 2 / 2


ONE = np.eye(2)
TIED = np.array([[1.0, -1.0], [-1.0, 1.0]])
"""Masses, and springs or dashpots between them, of two that nothing else holds."""

BOTH_FORCES: dict[str, Any] = {
    "harmonic_forces": (0.3, -0.2 + 0.4j, 0.1j),
    "constant_forces": (0.05, 0.0, -0.1),
}

SYSTEMS: dict[str, ImpactOscillator] = {
    "chain": ImpactChain(frequency=0.87),
    "chain, offset": ImpactChain(frequency=1.2, offset=-0.05),
    "chain, undamped": ImpactChain(masses=3, frequency=0.87, damping=0.0, restitution=0.5),
    "chain, elastic": ImpactChain(masses=3, frequency=0.9, restitution=1.0, offset=-0.01),
    "chain, dead": ImpactChain(masses=3, frequency=0.9, restitution=0.0),
    "chain, overdamped": ImpactChain(masses=3, frequency=0.9, damping=5.0, restitution=0.4),
    "chain, unequal": ImpactChain(
        masses=(1.0, 0.3, 2.5), springs=(2.0, 1.0, 0.5), damping=(0.02, 1.7, 0.3), frequency=1.1
    ),
    "chain, contact inside": ImpactChain(masses=3, contact=1, frequency=1.3, offset=-0.02),
    "chain, below": ImpactChain(masses=2, side="below", frequency=1.3, offset=0.02),
    "chain, forces": ImpactChain(masses=3, frequency=0.7, offset=-0.4, **BOTH_FORCES),
    "chain, forces only": ImpactChain(masses=3, frequency=0.7, amplitude=0.0, **BOTH_FORCES),
    "chain, play": ImpactChain(masses=2, frequency=0.8, play=0.25, offset=-0.05),
    "chain, below with play": ImpactChain(
        masses=2, frequency=0.8, play=0.25, offset=0.05, side="below"
    ),
    "chain, graded": ImpactChain(
        masses=10, damping=tuple(np.linspace(0.01, 0.2, 10).tolist()), frequency=0.87
    ),
    "critical": matrices(CRITICAL, frequency=1.3),
    "double": matrices(DOUBLE, frequency=1.3, offset=-0.02),
    "double, contact inside": matrices(DOUBLE, frequency=1.3, contact=0),
    "fourfold": matrices(FOURFOLD, frequency=1.3, side="below"),
    "triple": matrices(TRIPLE, frequency=1.3, offset=-0.02),
    "triple, contact inside": matrices(TRIPLE, frequency=1.3, contact=1),
    "graded": matrices(graded(10), frequency=0.87, offset=-0.01),
    "grounded": GroundedChain(frequency=1.3, offset=-0.02),
    "single": SingleImpactOscillator(frequency=4.0, restitution=0.8),
    "single, stop": SingleImpactOscillator(frequency=2.3, restitution=0.8, stop=0.1),
    "play": PlayOscillator(
        amplitude=0.0, force=1.0, spring=1.0, damping=0.1, frequency=2.1, restitution=0.6
    ),
}

UNHELD: dict[str, ImpactOscillator] = {
    "ball": BouncingBall(amplitude=1.5, frequency=1.0, restitution=0.5),
    "ball, two bounces": BouncingBall(amplitude=0.2, frequency=3.0, restitution=0.5),
    "free chain": matrices(
        (ONE, 0.05 * TIED, TIED), constant_forces=(-1.0, -1.0), amplitude=1.5, frequency=2.0
    ),
    "free chain, dragged": matrices(
        (ONE, 0.05 * TIED + np.diag([0.1, 0.0]), TIED),
        constant_forces=(-1.0, -0.7),
        harmonic_forces=(0.1, 0.0),
        amplitude=1.5,
        frequency=2.0,
    ),
    "free mass": PlayOscillator(play=1.0, amplitude=0.2, frequency=1.0, restitution=0.5),
    "free mass, dragged": PlayOscillator(
        play=1.0, amplitude=0.2, damping=0.1, force=0.05, frequency=1.0, restitution=0.5
    ),
}
"""Some motion of these has no restoring force."""

ALL = SYSTEMS | UNHELD
