"""Multipliers of limit cycles of flows against closed forms and forty digits, relative."""

from __future__ import annotations

import cmath
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from flint import arb, ctx
from scipy.optimize import linear_sum_assignment

from dynkit import Hyperplane, MapOrbit, PoincareMap, periodic_orbit
from dynkit.core.validation import Array, finite_array
from dynkit.systems import IntegratedFlow

CYCLES, DIGITS, ORDER = 600, 50, 60
TOLERANCES = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)

VAN_DER_POL = {
    0.1: 0.5330692592096738,
    0.3: 0.14865048922567051,
    0.5: 0.039176920259273294,
    1.0: 8.5969506360380512e-4,
    1.5: 6.4667565710265864e-6,
    2.0: 1.2738493044394083e-8,
    2.5: 6.0884921559736723e-12,
    3.0: 6.9894756260797857e-16,
    4.0: 1.2754740527826613e-25,
    5.0: 7.7385550868593590e-38,
}
"""Multipliers of the cycle by `exact_multiplier`."""


@dataclass(frozen=True, kw_only=True)
class VanDerPol(IntegratedFlow):
    """x'' = mu (1 - x^2) x' - x."""

    mu: float = 1.0
    dimension = 2

    def velocity(self, state: Array) -> Array:
        x, v = finite_array("state", state, (2,)).tolist()
        return np.array([v, self.mu * (1.0 - x * x) * v - x])

    def velocity_jacobian(self, state: Array) -> Array:
        x, v = finite_array("state", state, (2,)).tolist()
        return np.array([[0.0, 1.0], [-2.0 * self.mu * x * v - 1.0, self.mu * (1.0 - x * x)]])


@cache
def van_der_pol(mu: float, tolerance: float) -> MapOrbit:
    """The cycle, on the section x' = 0 at the largest x."""
    plane = Hyperplane(np.array([0.0, 1.0]), direction=-1)
    flow = VanDerPol(mu=mu, tolerance=tolerance)
    return periodic_orbit(PoincareMap(flow, plane, time_limit=100.0), [2.0])


def of_van_der_pol(
    every: int, tolerances: Sequence[float] = TOLERANCES
) -> Iterator[tuple[float, float]]:
    """Of ten cycles at some tolerances."""
    cases = [(mu, tolerance) for mu in VAN_DER_POL for tolerance in tolerances]
    for mu, tolerance in cases[::every]:
        orbit = van_der_pol(mu, tolerance)
        yield from relative(orbit, np.array([VAN_DER_POL[mu]]))


def relative(orbit: MapOrbit, exact: Any) -> Iterator[tuple[float, float]]:
    """True and claimed error of each multiplier, as parts of it; claims above 0.1 are lost."""
    # by the logarithms: of two small ones either may be paired with either by their distances
    apart = abs(np.subtract.outer(np.log(abs(orbit.multipliers)), np.log(abs(exact))))
    apart += abs(np.subtract.outer(np.angle(orbit.multipliers), np.angle(exact)))
    rows, columns = linear_sum_assignment(apart)
    true = abs(orbit.multipliers[rows] - exact[columns]) / abs(exact[columns])
    # the exact ones are rounded to doubles
    claims = orbit.multipliers_error[rows] / abs(exact[columns]) + 2.0**-53
    yield from zip(true.tolist(), claims.tolist(), strict=True)


# --- van der Pol's cycle in many digits -----------------------------------------------------------


def exact_multiplier(mu: float) -> float:
    """By Liouville's formula: exp of the integral of mu (1 - x^2) over the cycle.

    Half of it, as it is symmetric, by Taylor series of order 60; the largest x by Newton's method.
    """
    with ctx.workdps(DIGITS):
        rate, x, step = arb(mu), arb(2), arb(1)
        while abs(step) > arb(10) ** -38:
            end, total = _half_a_turn(x, rate)
            # in the plane the derivative follows from Liouville's formula, too
            step = ((x - end) / (1 - total.exp() * x / end)).mid()
            x = (x - step).mid()
        return float((2 * _half_a_turn(x, rate)[1]).exp().mid())


def _half_a_turn(x: Any, mu: Any) -> tuple[Any, Any]:
    """-x when x' is zero next, and the integral of mu (1 - x^2) until then."""
    v = total = arb(0)
    small = float(arb(10) ** -42) ** (1.0 / ORDER)
    while True:
        terms = _series(x, v, total, mu)
        growth = max(abs(float(t[ORDER])) ** (1.0 / ORDER) for t in terms)
        h = arb(small / max(growth, 0.1))
        if v < 0 < _value(terms[1], h):
            slopes = [k * c for k, c in enumerate(terms[1])][1:]
            h = (h * v / (v - _value(terms[1], h))).mid()
            for _ in range(12):
                h = (h - _value(terms[1], h) / _value(slopes, h)).mid()
            return -_value(terms[0], h), _value(terms[2], h)
        x, v, total = (_value(t, h) for t in terms)


def _series(x: Any, v: Any, total: Any, mu: Any) -> tuple[list[Any], list[Any], list[Any]]:
    xs, vs, totals, factors = [x], [v], [total], list[Any]()
    for k in range(ORDER):
        square = sum((xs[i] * xs[k - i] for i in range(k + 1)), arb(0))
        factors.append((1 if k == 0 else 0) - square)
        product = sum((factors[i] * vs[k - i] for i in range(k + 1)), arb(0))
        xs.append((vs[k] / (k + 1)).mid())
        vs.append(((mu * product - xs[k]) / (k + 1)).mid())
        totals.append((mu * factors[k] / (k + 1)).mid())
    return xs, vs, totals


def _value(terms: list[Any], h: Any) -> Any:
    value = arb(0)
    for term in reversed(terms):
        value = (value * h + term).mid()
    return value


# --- random cycles with multipliers in closed form ------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Bent(IntegratedFlow):
    """A circle that attracts, in bent coordinates and at a speed that changes on the way.

    With r^2 = a^2 + b^2 and the phase of a + i b:

        r' = rate (1 + 2 uneven a) r (1 - r^2),   phase' = 1 + twist (1 - r^2),
        w' = (spiral - decay (1 + uneven b)) w + kick (1 - r^2),

    where w is a complex number, real in three dimensions. On the circle r = 1 the multipliers are
    exp(-4 pi rate), exp(-2 pi decay) and, with the angles +-2 pi |spiral|, its partner. Neither a
    factor of all rates nor other coordinates change them. With an uneven rate disturbances grow on
    a part of the way.
    """

    coordinates: int
    rate: float
    uneven: float
    twist: float
    decay: float
    spiral: float
    kick: float
    speed: float
    bends: tuple[float, float, float]
    mixing: Any

    @property
    def dimension(self) -> int:
        return self.coordinates

    @cached_property
    def _unmixing(self) -> Any:
        return np.linalg.inv(self.mixing)

    def bent(self, *w: complex) -> list[complex]:
        """Coordinates of the plane, and the others: quadratic shears, one after the other."""
        a, b, *others = w
        a = a + self.bends[0] * b * b
        b = b + self.bends[1] * a * a
        return [a, b, *(z + self.bends[2] * a * b for z in others)]

    def straight(self, y: Any) -> list[complex]:
        a, b, *others = (self._unmixing @ y).tolist()
        others = [z - self.bends[2] * a * b for z in others]
        b = b - self.bends[1] * a * a
        return [a - self.bends[0] * b * b, b, *others]

    def _rates(self, y: Any) -> Any:
        a, b, *others = self.straight(y)
        off = 1.0 - a * a - b * b
        radial, angular = self.rate * (1.0 + 2.0 * self.uneven * a) * off, 1.0 + self.twist * off
        rates = [radial * a - angular * b, radial * b + angular * a]
        decay = self.decay * (1.0 + self.uneven * b)
        if len(others) == 1:
            rates.append(-decay * others[0] + self.kick * off)
        elif others:
            u, v = others
            rates += [-decay * u - self.spiral * v + self.kick * off, self.spiral * u - decay * v]
        # by the chain rule: a' + 2 bends b b', and so on
        p, q, r = self.bends
        da = rates[0] + 2.0 * p * b * rates[1]
        bent_a = a + p * b * b
        db = rates[1] + 2.0 * q * bent_a * da
        bent_b = b + q * bent_a * bent_a
        bent = [da, db, *(z + r * (da * bent_b + bent_a * db) for z in rates[2:])]
        return self.mixing @ np.array(bent) * (1.0 + self.speed * a)

    def velocity(self, state: Array) -> Array:
        return np.asarray(self._rates(finite_array("state", state, (self.dimension,))))

    def velocity_jacobian(self, state: Array) -> Array:
        # rates are polynomials: a step in the imaginary direction is exact to rounding
        state, step = finite_array("state", state, (self.dimension,)), 1e-30
        ahead = state + 1j * step * np.eye(self.dimension)
        return np.array([self._rates(y).imag / step for y in ahead]).T

    @property
    def exact(self) -> Any:
        """Multipliers."""
        radial = cmath.exp(-4.0 * np.pi * self.rate)
        pair = cmath.exp(2.0 * np.pi * (1j * self.spiral - self.decay))
        return np.array([radial, pair, pair.conjugate()][: self.dimension - 1])


def bent_cycle(number: int) -> tuple[MapOrbit, Any]:
    """A random cycle on a random plane across it, and its exact multipliers."""
    random = np.random.default_rng(number)
    d = 2 + number % 3
    flow = Bent(
        coordinates=d,
        rate=float(10.0 ** random.uniform(-1.5, 0.5)),
        uneven=float(random.uniform(0.0, 1.0)),
        twist=float(random.uniform(-1.0, 1.0)),
        decay=float(10.0 ** random.uniform(-1.5, 0.5)),
        spiral=float(random.uniform(0.1, 0.4)) if d == 4 else 0.0,
        kick=float(random.uniform(-1.0, 1.0)),
        speed=float(random.uniform(-0.5, 0.5)),
        bends=tuple(random.uniform(-0.3, 0.3, 3).tolist()),
        mixing=np.eye(d) + 0.3 * random.uniform(-1.0, 1.0, (d, d)),
        tolerance=float(10.0 ** random.uniform(-12.0, -6.0)),
    )
    begin = flow.mixing @ np.array(flow.bent(1.0, *np.zeros(d - 1)))
    along = flow.velocity(begin)
    normal = along / np.linalg.norm(along) + random.uniform(-0.4, 0.4, d)
    plane = Hyperplane(normal, float(normal @ begin))
    section = PoincareMap(flow, plane, time_limit=100.0)
    states = [plane.reduce(begin)]
    # the plane may cut the cycle more than once
    while len(states) < 4:
        after = section(states[-1])
        if np.linalg.norm(after - states[0]) < 1e-3:
            break
        states.append(after)
    return periodic_orbit(section, np.array(states)), flow.exact


def of_bent_cycles(every: int) -> Iterator[tuple[float, float]]:
    for number in range(0, CYCLES, every):
        yield from relative(*bent_cycle(number))
