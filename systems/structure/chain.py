"""Chains of masses, each joined to the one before it by a spring and a dashpot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.validation import SCALARS, finite_array, positive_integer
from dynkit.systems.structure.lagrangian import LagrangianStructure
from dynkit.systems.structure.symmetric import SymmetricMatrix

if TYPE_CHECKING:
    import sympy


def chain_kinetic(masses: tuple[float, ...], v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
    """Kinetic energy of a chain, the sum of m_i v_i^2 / 2."""
    from sympy import Add, Float, Pow, Rational

    half = Rational(1, 2)
    return Add(*(half * Float(m) * Pow(speed, 2) for m, speed in zip(masses, v, strict=True)))


def chain_links(strengths: Sequence[float | Fraction], x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
    """The sum of k_i (x_i - x_{i-1})^2 / 2, where x_0 = 0 is the wall.

    With spring constants and coordinates it is the potential energy of a chain; with dashpot
    constants and velocities it is the dissipation function. Fractions stay exact.
    """
    from sympy import Add, Float, Integer, Pow, Rational

    def number(strength: float | Fraction) -> sympy.Expr:
        if isinstance(strength, Fraction):
            return Rational(strength.numerator, strength.denominator)
        return Float(strength)

    half = Rational(1, 2)
    before = (Integer(0), *x[:-1])
    return Add(
        *(
            half * number(strength) * Pow(after - behind, 2)
            for strength, after, behind in zip(strengths, x, before, strict=True)
        )
    )


def chain_matrices(
    masses: Sequence[float], *links: Sequence[float | Fraction]
) -> tuple[SymmetricMatrix, ...]:
    """The matrices of `chain_kinetic`, and of `chain_links` for each set of strengths.

    Each element is rounded once.

    Raises
    ------
    OverflowError
        When an element is no finite double.
    """
    n, found = len(masses), [{(i, i): Fraction(mass) for i, mass in enumerate(masses)}]
    for strengths in links:
        k = [*(Fraction(strength) for strength in strengths), Fraction(0)]
        found.append({(i, i): k[i] + k[i + 1] for i in range(n)})
        found[-1] |= {(i, i + 1): -k[i + 1] for i in range(n - 1)}
    return tuple(SymmetricMatrix.from_fractions(n, each) for each in found)


def extensions(x: tuple[sympy.Symbol, ...]) -> tuple[sympy.Expr, ...]:
    """The extensions (x_1, x_2 - x_1, ...) of the springs of a chain, from the wall outwards.

    Examples
    --------
    A chain with user-defined springs:

    >>> from dynkit.systems import ImpactChain
    >>> class Hardening(ImpactChain):
    ...     def potential(self, x):
    ...         return sum(e**2 / 2 + e**4 / 4 for e in extensions(x))
    >>> print(Hardening(masses=2, frequency=0.9).attractor().label)
    P(1,1)
    """
    from sympy import Integer

    return tuple(after - behind for after, behind in zip(x, (Integer(0), *x[:-1]), strict=True))


@dataclass(frozen=True, init=False)
class Chain(LagrangianStructure):
    """N masses in a line, the first joined to a wall, each to the next (Cusumano & Bai 1993).

    Parameters
    ----------
    masses : int or array_like, shape (N,)
        Number of unit masses, or the masses from the wall outwards, positive.
    springs : float or array_like, shape (N,)
        Spring constants, not negative; the first spring holds mass 1 to the wall.
    dashpots : float or array_like, shape (N,)
        Dashpot constants, not negative, in parallel to the springs.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    Examples
    --------
    >>> chain = Chain(10, dashpots=0.1)
    >>> chain.modes.frequencies[0] == 2 * np.sin(np.pi / 42)
    np.True_
    >>> Chain([1.0, 2.0], springs=[3.0, 4.0]).stiffness
    array([[ 7., -4.],
           [-4.,  4.]])
    """

    masses: tuple[float, ...]
    springs: tuple[float, ...]
    dashpots: tuple[float, ...]

    def __init__(self, masses: object, springs: object = 1.0, dashpots: object = 0.0) -> None:
        if isinstance(masses, SCALARS):
            mass = (1.0,) * positive_integer("masses", masses)
        else:
            mass = element_values("masses", masses, None, zero=False)
        object.__setattr__(self, "masses", mass)
        object.__setattr__(self, "springs", element_values("springs", springs, len(mass)))
        object.__setattr__(self, "dashpots", element_values("dashpots", dashpots, len(mass)))

    @property
    def degrees_of_freedom(self) -> int:
        return len(self.masses)

    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return chain_kinetic(self.masses, v)

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return chain_links(self.springs, x)

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return chain_links(self.dashpots, v)

    def _matrices(self) -> tuple[SymmetricMatrix, ...]:
        if self._has_energies(*_OWN):
            with suppress(OverflowError):  # an energy tells which element it is
                return chain_matrices(self.masses, self.dashpots, self.springs)
        return super()._matrices()


_OWN = Chain.kinetic, Chain.potential, Chain.dissipation


def element_values(
    name: str, value: object, count: int | None, *, zero: bool = True
) -> tuple[float, ...]:
    """Return one number per element of a chain, from one for all or one for each.

    Parameters
    ----------
    name : str
        The argument's name in error messages.
    value : float or array_like, shape (count,)
    count : int or None
        The number of elements; None takes it from the value.
    zero : bool
        Whether zero is allowed.

    Raises
    ------
    ValueError
        When a number is not finite, is negative, or is zero where that is not allowed.

    Examples
    --------
    >>> element_values("springs", 2.0, 3)
    (2.0, 2.0, 2.0)
    >>> element_values("springs", [1.0, -1.0], 2)
    Traceback (most recent call last):
    ...
    ValueError: springs[1] must not be negative; got -1.0
    """
    if type(value) is float and (0.0 < value < math.inf or (zero and value == 0.0)):
        return (value,) * (count or 1)
    alone = isinstance(value, SCALARS)
    array = finite_array(name, value, () if alone else (count,)).ravel()
    if not len(array):
        raise ValueError(f"{name} must hold at least one number; got none")
    wrong = array < 0.0 if zero else array <= 0.0
    if wrong.any():
        place = int(np.argmax(wrong))
        limit = "not be negative" if zero else "be positive"
        found = float(array[place])
        raise ValueError(f"{name if alone else f'{name}[{place}]'} must {limit}; got {found}")
    values = tuple(map(float, array.tolist()))
    return values * (count or 1) if alone else values
