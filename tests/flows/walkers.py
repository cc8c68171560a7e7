"""Walkers from first principles, and flows with resets that tests share."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import numpy as np
import sympy as sp
from flint import arb, ctx

from dynkit import HybridFlow
from dynkit.core.validation import Array, finite_array
from dynkit.systems import CompassGait, IntegratedFlow, SimplestWalker, SymbolicHybridFlow
from tests.flows.cases import BITS, Many, VelocityOf, followed_in_many_digits

Turn: TypeAlias = Callable[[Many], Many]
"""Sine or cosine of a number of any kind."""


class Wheel(SymbolicHybridFlow):
    """A rimless wheel on a slope: the angle of a spoke from the vertical, and its rate."""

    slope: float = 0.08
    spoke: float = math.pi / 6

    def velocity(self, angle: Any, rate: Any) -> Any:
        return rate, sp.sin(angle)

    def guard(self, angle: Any, rate: Any) -> Any:
        return self.slope + self.spoke / 2 - angle

    def reset(self, angle: Any, rate: Any) -> Any:
        return angle - self.spoke, sp.cos(self.spoke) * rate


class Fire(SymbolicHybridFlow):
    """A leaky neuron, which fires at a threshold."""

    current: float = 1.5
    threshold: float = 1.0

    def velocity(self, potential: Any) -> Any:
        return (self.current - potential,)

    def guard(self, potential: Any) -> Any:
        return self.threshold - potential

    def reset(self, potential: Any) -> Any:
        return (0,)


class DrivenFire(SymbolicHybridFlow):
    """A leaky neuron, which is driven: the states just after it fires are phases."""

    current: float = 1.5
    force: float = 0.3
    frequency: float = 5.7

    def velocity(self, potential: Any, phase: Any) -> Any:
        return self.current - potential + self.force * sp.cos(phase), self.frequency

    def guard(self, potential: Any, phase: Any) -> Any:
        return 1 - potential

    def reset(self, potential: Any, phase: Any) -> Any:
        return 0, phase


class ByHeight(SimplestWalker):
    """The simplest walker, with the height of its foot as the guard: it scuffs in every step."""

    def guard(self, stance: Any, swing: Any, u: Any, v: Any) -> Any:
        return sp.cos(stance) - sp.cos(swing - stance)


@dataclass(frozen=True, kw_only=True)
class PlainWheel(HybridFlow, IntegratedFlow):
    """The rimless wheel in plain Python, guard and reset by differences."""

    slope: float = 0.08
    spoke: float = math.pi / 6
    dimension = 2

    def velocity(self, state: Array) -> Array:
        angle, rate = finite_array("state", state, (2,))
        return np.array([rate, np.sin(angle)])

    def velocity_jacobian(self, state: Array) -> Array:
        return np.array([[0.0, 1.0], [np.cos(finite_array("state", state, (2,))[0]), 0.0]])

    def guard(self, state: Array) -> float:
        return float(self.slope + self.spoke / 2 - finite_array("state", state, (2,))[0])

    def reset(self, state: Array) -> Array:
        angle, rate = finite_array("state", state, (2,))
        return np.array([angle - self.spoke, np.cos(self.spoke) * rate])


# --- first principles -----------------------------------------------------------------------------


def masses_of(
    walker: CompassGait, swing: Many, stance: Many, sin: Turn, cos: Turn
) -> list[tuple[float, tuple[Many, Many]]]:
    """Masses and places of the stance leg, the hip and the swing leg; the foot is at the origin."""
    a, b = walker.foot_to_mass, walker.mass_to_hip
    up = -sin(stance), cos(stance)
    hip = (a + b) * up[0], (a + b) * up[1]
    leg = hip[0] + b * sin(swing), hip[1] - b * cos(swing)
    return [
        (walker.leg_mass, (a * up[0], a * up[1])),
        (walker.hip_mass, hip),
        (walker.leg_mass, leg),
    ]


@cache
def compass_accelerations(walker: CompassGait) -> Any:
    """Function of swing, stance and their rates: by Lagrange's equations of three point masses."""
    q, w = sp.symbols("swing stance"), sp.symbols("u v")
    kinetic, potential = sp.Integer(0), sp.Integer(0)
    for mass, place in masses_of(walker, q[0], q[1], sp.sin, sp.cos):
        rates = [sum(sp.diff(x, k) * r for k, r in zip(q, w, strict=True)) for x in place]
        kinetic += sp.Rational(mass) * sum(rate**2 for rate in rates) / 2
        potential += sp.Rational(mass) * sp.Float(walker.gravity, 60) * place[1]
    matrix = sp.hessian(kinetic, w)
    momenta = [sp.diff(kinetic, rate) for rate in w]
    force = [
        sp.diff(kinetic - potential, k)
        - sum(sp.diff(p, other) * r for other, r in zip(q, w, strict=True))
        for k, p in zip(q, momenta, strict=True)
    ]
    (first, second), (_, last) = matrix.tolist()
    size = first * last - second**2
    found = (last * force[0] - second * force[1], first * force[1] - second * force[0])
    values = [sp.nsimplify(value) / size for value in found]
    turns = {"sin": lambda x: x.sin(), "cos": lambda x: x.cos()}
    return sp.lambdify((*q, *w), values, modules=[turns], cse=True)


def compass_reset(walker: CompassGait, state: list[Many], sin: Turn, cos: Turn) -> list[Many]:
    """Exchange of the legs: two angular momenta of three point masses are kept."""
    swing, stance, u, v = state
    before = masses_of(walker, swing, stance, sin, cos)
    hip, length = before[1][1], walker.foot_to_mass + walker.mass_to_hip
    strike = hip[0] + length * sin(swing), hip[1] - length * cos(swing)

    def moments(shift: tuple[Many, Many], legs: tuple[Many, Many], rates: Any) -> list[Many]:
        """Of all about the strike, and of the leg that leaves about the hip."""
        found = masses_of(walker, legs[0], legs[1], sin, cos)
        small = _rates(walker, legs, rates, sin, cos)
        places = [(x[0] + shift[0], x[1] + shift[1]) for _, x in found]
        whole = sum(
            m * ((x[0] - strike[0]) * r[1] - (x[1] - strike[1]) * r[0])
            for (m, _), x, r in zip(found, places, small, strict=True)
        )
        leaving = 0 if legs == (swing, stance) else 2
        x, r, m = places[leaving], small[leaving], walker.leg_mass
        return [whole, m * ((x[0] - hip[0]) * r[1] - (x[1] - hip[1]) * r[0])]

    kept = moments((0, 0), (swing, stance), (u, v))
    columns = [moments(strike, (stance, swing), rates) for rates in ((1, 0), (0, 1))]
    (p, r), (q, s) = columns
    size = p * s - q * r
    return [
        stance,
        swing,
        (s * kept[0] - q * kept[1]) / size,
        (p * kept[1] - r * kept[0]) / size,
    ]


def _rates(
    walker: CompassGait, legs: tuple[Many, Many], rates: tuple[Many, Many], sin: Turn, cos: Turn
) -> list[tuple[Many, Many]]:
    """Velocities of the stance leg, the hip and the swing leg."""
    (swing, stance), (u, v) = legs, rates
    a, b = walker.foot_to_mass, walker.mass_to_hip
    across = -cos(stance) * v, -sin(stance) * v
    hip = (a + b) * across[0], (a + b) * across[1]
    leg = hip[0] + b * cos(swing) * u, hip[1] + b * sin(swing) * u
    return [(a * across[0], a * across[1]), hip, leg]


# --- sixty digits ---------------------------------------------------------------------------------


def _simplest(walker: SimplestWalker) -> tuple[VelocityOf, Any, Any]:
    slope = arb(walker.slope)

    def velocity(s: list[Many]) -> list[Many]:
        fall, lean = (s[0] - slope).sin(), (s[0] - slope).cos()
        return [s[2], s[3], fall, fall + (s[2] * s[2] - lean) * s[1].sin()]

    def reset(s: list[Many]) -> list[Many]:
        kept = (2 * s[0]).cos()
        return [-s[0], -2 * s[0], kept * s[2], kept * (1 - kept) * s[2]]

    return velocity, lambda s: (2 * s[0] - s[1], 2 * s[2] - s[3]), reset


def _compass(walker: CompassGait) -> tuple[VelocityOf, Any, Any]:
    accelerations = compass_accelerations(walker)

    def velocity(s: list[Many]) -> list[Many]:
        return [s[2], s[3], *accelerations(*s)]

    def reset(s: list[Many]) -> list[Many]:
        return compass_reset(walker, s, lambda x: x.sin(), lambda x: x.cos())

    guard = lambda s: (s[0] + s[1] + 2 * arb(walker.slope), s[2] + s[3])  # noqa: E731
    return velocity, guard, reset


def step_in_many_digits(walker: Any, state: list[Any], time: float) -> tuple[Any, list[Any]]:
    """Time and state after one step, where the time is known to 1e-10."""
    with ctx.workprec(BITS):
        kind = _simplest if isinstance(walker, SimplestWalker) else _compass
        velocity, guard, reset = kind(walker)
        before = arb(time) - arb(2.0**-20)
        near = followed_in_many_digits(velocity, state, before)
        left = arb(2.0**-20)
        for _ in range(3):
            value, rate = guard(followed_in_many_digits(velocity, near, left))
            left = (left - value / rate).mid()
        return before + left, reset(followed_in_many_digits(velocity, near, left))
