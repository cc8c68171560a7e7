"""Maps of expressions for the tests; a store finds their classes here."""

from dataclasses import dataclass
from typing import Any

import numba
import sympy as sp

from dynkit.systems import CompiledMap, SymbolicMap


class Everything(SymbolicMap):
    """Every function that can be compiled, where it is smooth."""

    a: float = 0.7
    b: float = 0.3

    def next_state(self, x: Any, y: Any) -> tuple[Any, ...]:
        u, v = self.a * x + sp.Rational(1, 3) * y, sp.sqrt(1 + self.b * y**2)
        trigonometry = sp.sin(u) + sp.cos(v) - sp.tan(u / 3) + sp.atan(u * v) + sp.atan2(v, u)
        inverses = sp.asin(u / 9) - sp.acos(v / 9) + sp.asinh(u) + sp.acosh(1 + v) + sp.atanh(u / 9)
        growth = sp.exp(-(u**2)) + sp.log(v) + sp.sinh(u) / sp.cosh(v) + sp.tanh(u) + sp.erf(u)
        powers = u**3 / v**2 + (1 + u**2) ** self.a + 2**u + v ** sp.Rational(-3, 2) + u**-1
        return trigonometry + powers - sp.pi, inverses + growth - 0.1 * sp.erfc(v)


class Pieces(SymbolicMap):
    """Functions with corners and steps."""

    a: float = 1.5

    def next_state(self, x: Any, y: Any, z: Any) -> tuple[Any, ...]:
        bent = sp.Piecewise((self.a * x, x < 0), (x**2, (x < 1) & (y > 0)), (2 - x, True))
        steps = sp.floor(2 * x) + sp.ceiling(y) * z + sp.sign(z) * y + sp.Heaviside(x) * x
        wrapped = sp.Mod(x, sp.pi) * sp.Mod(-y, 2) + sp.frac(z)
        chosen = sp.Max(x, y, z) - sp.Min(x, y**2) + sp.Abs(z) + sp.Abs(sp.Abs(z) ** self.a - 1)
        either = sp.Piecewise((x, sp.Or(x > 2, y < -1)), (y, ~(z > 0)), (z, True))
        return bent + steps, wrapped + either, chosen


@dataclass(frozen=True)
class Ring(SymbolicMap):
    """Coupled logistic maps: how the second feels the first is a word, and no parameter."""

    coupling: str = "linear"
    rate: float = 3.7
    strength: float = 0.1

    def next_state(self, x: Any, y: Any) -> tuple[Any, ...]:
        power = {"linear": 1, "square": 2}[self.coupling]
        return self.rate * x * (1 - x), self.rate * y * (1 - y) + self.strength * (x**power - y)


class Growing(Ring):
    """What it inherits is an expression."""

    growth: float = 0.0

    def next_state(self, x: Any, y: Any) -> tuple[Any, ...]:
        first, second = super().next_state(x, y)
        return first + self.growth, second


class Projected(SymbolicMap):
    """A direction is lost in every iterate."""

    def next_state(self, x: Any, y: Any, z: Any) -> tuple[Any, ...]:
        return 1 - sp.Rational(7, 5) * x**2 + y, sp.Rational(3, 10) * x, 0 * z


class UserCompiled(CompiledMap):
    """Henon's map by a user's own compiler."""

    a: float = 1.4
    b: float = 0.3

    @staticmethod
    @numba.njit
    def next_state(x: float, y: float, a: float, b: float) -> tuple[float, ...]:
        return 1.0 - a * x * x + y, b * x
