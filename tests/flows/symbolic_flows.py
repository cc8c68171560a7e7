"""Flows of expressions for the tests; a store finds their classes here."""

from typing import Any

import sympy as sp

from dynkit.systems import SymbolicFlow


class EveryFunction(SymbolicFlow):
    """Every function that Taylor's method takes."""

    a: float = 0.7

    def velocity(self, x: Any, y: Any) -> tuple[Any, ...]:
        u, v = sp.tanh(self.a * x + sp.Rational(1, 3) * y), sp.sqrt(2 + sp.sin(y))
        first = sp.sin(u) - sp.cos(v) + sp.tan(u / 3) + sp.atan(u * v) + sp.atan2(v, 2 + u)
        more = sp.asin(u / 9) + sp.acos(v / 9) + sp.asinh(u) + sp.acosh(1 + v) + sp.atanh(u / 9)
        powers = u**3 / v**2 + (1 + u**2) ** self.a + 2**u + v ** sp.Rational(-3, 2)
        growth = sp.exp(-(u**2)) + sp.log(v) + sp.sinh(u) / sp.cosh(v) + sp.erf(u)
        return first - powers - x, more - growth - y


class Kicked(SymbolicFlow):
    """A pendulum that is driven by time itself, and not by a phase."""

    force: float = 0.3
    frequency: float = 1.5

    def velocity(self, x: Any, v: Any, t: Any) -> tuple[Any, ...]:
        return v, -sp.sin(x) + self.force * sp.cos(self.frequency * t)


class Explosion(SymbolicFlow):
    """x' = x^2 is infinite at time 1 / x(0)."""

    def velocity(self, x: Any) -> tuple[Any, ...]:
        return (x**2,)


class Cycle(SymbolicFlow):
    """Van der Pol's oscillator, and the integral of its divergence."""

    mu: float = 1.0

    def velocity(self, x: Any, v: Any, w: Any) -> tuple[Any, ...]:
        return v, self.mu * (1 - x**2) * v - x, self.mu * (1 - x**2) + 0 * w


class TodaRing(SymbolicFlow):
    """Three masses on a ring of Toda's springs: so many equations that their code is compact."""

    k: float = 1.0

    def velocity(self, x: Any, y: Any, z: Any, u: Any, v: Any, w: Any) -> tuple[Any, ...]:
        pulls = [self.k * (sp.exp(b - a) - 1) for a, b in ((x, y), (y, z), (z, x))]
        return u, v, w, pulls[0] - pulls[2], pulls[1] - pulls[0], pulls[2] - pulls[1]


class Undamped(SymbolicFlow):
    """A pendulum without damping: in the plane, a level of the energy is one orbit."""

    integrals = ("energy",)
    pull: float = 1.0

    def velocity(self, angle: Any, rate: Any) -> tuple[Any, ...]:
        return rate, -self.pull * sp.sin(angle)

    def energy(self, angle: Any, rate: Any) -> Any:
        return rate**2 / 2 - self.pull * sp.cos(angle)


class TwoSprings(SymbolicFlow):
    """Two oscillators with a weak coupling, whose frequencies have no ratio of integers."""

    integrals = ("energy",)
    second: float = 2.0
    coupling: float = 0.3

    def velocity(self, x: Any, y: Any, u: Any, v: Any) -> tuple[Any, ...]:
        return u, v, -x - 2 * self.coupling * x * y, -self.second * y - self.coupling * x**2

    def energy(self, x: Any, y: Any, u: Any, v: Any) -> Any:
        return (u**2 + v**2 + x**2 + self.second * y**2) / 2 + self.coupling * x**2 * y


class RigidBody(SymbolicFlow):
    """Euler's equations of a free body with the moments of inertia 1, 2 and 3."""

    integrals = ("energy",)
    first: float = 1.0

    def velocity(self, x: Any, y: Any, z: Any) -> tuple[Any, ...]:
        return -y * z / self.first, (3 - self.first) * x * z / 2, (self.first - 2) * x * y / 3

    def energy(self, x: Any, y: Any, z: Any) -> Any:
        return (self.first * x**2 + 2 * y**2 + 3 * z**2) / 2
