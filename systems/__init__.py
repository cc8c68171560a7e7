"""The systems that dynkit ships: structures, impact oscillators, textbook maps and flows."""

from typing import TYPE_CHECKING

from dynkit._lazy import lazy_names

if TYPE_CHECKING:
    from dynkit.systems.flows.duffing import Duffing
    from dynkit.systems.flows.integrated import IntegratedFlow
    from dynkit.systems.flows.lorenz import Lorenz
    from dynkit.systems.flows.rossler import Rossler
    from dynkit.systems.impact.ball import BouncingBall
    from dynkit.systems.impact.chain import ImpactChain
    from dynkit.systems.impact.matrices import MatrixOscillator
    from dynkit.systems.impact.oscillator import ImpactOscillator
    from dynkit.systems.impact.play import PlayOscillator
    from dynkit.systems.impact.single import SingleImpactOscillator
    from dynkit.systems.maps.henon import Henon
    from dynkit.systems.maps.high_bounce import HighBounce
    from dynkit.systems.maps.logistic import Logistic
    from dynkit.systems.structure.lagrangian import LagrangianStructure

__all__ = [
    "BouncingBall",
    "Duffing",
    "Henon",
    "HighBounce",
    "ImpactChain",
    "ImpactOscillator",
    "IntegratedFlow",
    "LagrangianStructure",
    "Logistic",
    "Lorenz",
    "MatrixOscillator",
    "PlayOscillator",
    "Rossler",
    "SingleImpactOscillator",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "BouncingBall": "dynkit.systems.impact.ball",
        "Duffing": "dynkit.systems.flows.duffing",
        "Henon": "dynkit.systems.maps.henon",
        "HighBounce": "dynkit.systems.maps.high_bounce",
        "ImpactChain": "dynkit.systems.impact.chain",
        "ImpactOscillator": "dynkit.systems.impact.oscillator",
        "IntegratedFlow": "dynkit.systems.flows.integrated",
        "LagrangianStructure": "dynkit.systems.structure.lagrangian",
        "Logistic": "dynkit.systems.maps.logistic",
        "Lorenz": "dynkit.systems.flows.lorenz",
        "MatrixOscillator": "dynkit.systems.impact.matrices",
        "PlayOscillator": "dynkit.systems.impact.play",
        "Rossler": "dynkit.systems.flows.rossler",
        "SingleImpactOscillator": "dynkit.systems.impact.single",
    },
)
