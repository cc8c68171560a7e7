"""The systems that dynkit ships: structures from their energies, and impact oscillators."""

from typing import TYPE_CHECKING

from dynkit._lazy import lazy_names

if TYPE_CHECKING:
    from dynkit.systems.impact.chain import ImpactChain
    from dynkit.systems.impact.oscillator import ImpactOscillator
    from dynkit.systems.structure.lagrangian import LagrangianStructure

__all__ = ["ImpactChain", "ImpactOscillator", "LagrangianStructure"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "ImpactChain": "dynkit.systems.impact.chain",
        "ImpactOscillator": "dynkit.systems.impact.oscillator",
        "LagrangianStructure": "dynkit.systems.structure.lagrangian",
    },
)
