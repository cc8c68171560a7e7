"""The systems that dynkit ships: structures, impact oscillators, textbook maps."""

from typing import TYPE_CHECKING

from dynkit._lazy import lazy_names

if TYPE_CHECKING:
    from dynkit.systems.impact.chain import ImpactChain
    from dynkit.systems.impact.oscillator import ImpactOscillator
    from dynkit.systems.maps.henon import Henon
    from dynkit.systems.maps.high_bounce import HighBounce
    from dynkit.systems.maps.logistic import Logistic
    from dynkit.systems.structure.lagrangian import LagrangianStructure

__all__ = [
    "Henon",
    "HighBounce",
    "ImpactChain",
    "ImpactOscillator",
    "LagrangianStructure",
    "Logistic",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "Henon": "dynkit.systems.maps.henon",
        "HighBounce": "dynkit.systems.maps.high_bounce",
        "ImpactChain": "dynkit.systems.impact.chain",
        "ImpactOscillator": "dynkit.systems.impact.oscillator",
        "LagrangianStructure": "dynkit.systems.structure.lagrangian",
        "Logistic": "dynkit.systems.maps.logistic",
    },
)
