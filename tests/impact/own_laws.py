"""Impact laws of a user's own, which processes can import."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems import ImpactLaw


@dataclass(frozen=True)
class Hardening(ImpactLaw):
    """Slow impacts rebound less: r = low + (1 - low) u / (u + scale)."""

    low: float = 0.5
    scale: float = 1.0

    def expression(self, velocity: Any) -> Any:
        return self.low + (1 - self.low) * velocity / (velocity + self.scale)


@dataclass(frozen=True)
class Constant(ImpactLaw):
    """A number, as a law."""

    value: float = 0.85

    def expression(self, velocity: Any) -> Any:
        return self.value


@dataclass(frozen=True)
class Rooted(ImpactLaw):
    """Slow impacts are elastic: r = exp(-c u^p)."""

    loss: float = 0.4
    power: float = 0.5

    def expression(self, velocity: Any) -> Any:
        import sympy

        return sympy.exp(-self.loss * velocity**self.power)
