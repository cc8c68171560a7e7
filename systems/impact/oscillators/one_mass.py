"""Base class of oscillators with one mass of 1."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from dynkit.systems.impact.elements.element import Element
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, kw_only=True)
class OneMass(ImpactOscillator):
    """A mass of 1 whose stops and forces follow from parameters of its own."""

    offset: float = field(init=False, repr=False, default=0.0)
    contact: int = field(init=False, repr=False, default=0)
    side: str = field(init=False, repr=False, default="above")
    harmonic_forces: tuple[complex, ...] = field(init=False, repr=False, default=())
    constant_forces: tuple[float, ...] = field(init=False, repr=False, default=())
    elements: tuple[Element, ...] = field(init=False, repr=False, default=())

    degrees_of_freedom = 1

    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return v[0] ** 2 / 2
