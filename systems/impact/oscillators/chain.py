"""The chain of Cusumano & Bai: masses in a line, the last one free to hit a vibrating table."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from dynkit.core.validation import SCALARS, positive_integer, within_memory
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.structure import chain
from dynkit.systems.structure.chain import element_values

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, kw_only=True)
class ImpactChain(ImpactOscillator):
    """N masses in a line, the first tied to a wall, the last free to hit a vibrating table.

    For another structure, write a subclass that overrides `kinetic`, `potential` or `dissipation`.

    Parameters
    ----------
    masses : int or array_like, shape (N,)
        Number of unit masses; or the masses themselves, from the wall outwards, positive.
    springs : float or array_like, shape (N,)
        Spring constants, not negative. The first spring ties mass 1 to the wall; with 0 there the
        chain is free.
    damping : float or array_like, shape (N,)
        A number is the ratio of every dashpot constant to its spring constant; an array holds the
        dashpot constants. Not negative.
    frequency, restitution, amplitude, offset, play, chatter_tolerance : float
    contact : int
    side : str
    harmonic_forces, constant_forces : array_like, shape (N,)
    elements : sequence of Element
        As for `ImpactOscillator`. The elements (`HardStop`, `SoftStop`, `DryFriction`, `Jenkins`)
        replace the table.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    Examples
    --------
    >>> chain = ImpactChain(masses=10, frequency=0.87)
    >>> record = chain.simulate(impacts=100)
    >>> record.ending.name, float(record.relative_velocity[-1].round(3))
    ('COUNT_REACHED', 0.147)
    >>> print(chain.attractor(transient=700, impacts=100).label)
    P(1,3)
    """

    masses: int | tuple[float, ...] = 10
    springs: float | tuple[float, ...] = 1.0
    damping: float | tuple[float, ...] = 0.1

    def __post_init__(self) -> None:
        if isinstance(self.masses, SCALARS):
            count = positive_integer("masses", self.masses)
            # mass, damping, stiffness and modes
            self._set("masses", within_memory("masses", count, 4.0 * 8.0 * count * count))
        else:
            self._set("masses", element_values("masses", self.masses, None, zero=False))
        for name in ("springs", "damping"):
            values = element_values(name, getattr(self, name), self.degrees_of_freedom)
            alone = isinstance(getattr(self, name), SCALARS)
            self._set(name, values[0] if alone else values)
        super().__post_init__()

    @property
    def degrees_of_freedom(self) -> int:
        return self.masses if isinstance(self.masses, int) else len(self.masses)

    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return chain.chain_kinetic(self._masses, v)

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return chain.chain_links(self._springs, x)

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return chain.chain_links(self._dashpots, v)

    def _matrices(self) -> Any:
        if self._has_energies(*_OWN):
            with suppress(OverflowError):  # an energy tells which element it is
                return chain.chain_matrices(self._masses, self._dashpots, self._springs)
        return super()._matrices()

    @property
    def _masses(self) -> tuple[float, ...]:
        return self.masses if isinstance(self.masses, tuple) else (1.0,) * self.degrees_of_freedom

    @property
    def _dashpots(self) -> Any:
        if isinstance(self.damping, tuple):
            return self.damping
        # Exact products: the damping stays exactly proportional to the stiffness.
        return [Fraction(self.damping) * Fraction(k) for k in self._springs]

    @property
    def _springs(self) -> tuple[float, ...]:
        return element_values("springs", self.springs, self.degrees_of_freedom)


_OWN = ImpactChain.kinetic, ImpactChain.potential, ImpactChain.dissipation
