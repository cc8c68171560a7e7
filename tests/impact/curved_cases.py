"""Structures with stops along functions of the coordinates, and their motions in sixty digits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import sympy as sp
from flint import arb, arb_poly, ctx

from dynkit.systems import HardStop, ImpactOscillator
from tests.flows.cases import BITS, Many, VelocityOf, followed_in_many_digits, taylor


@dataclass(frozen=True, kw_only=True)
class Bob(ImpactOscillator):
    """A pendulum whose bob meets a horizontal floor."""

    drag: float = 0.05
    length: float = 1.0
    degrees_of_freedom = 1

    def kinetic(self, v: Any) -> Any:
        return self.length**2 * v[0] ** 2 / 2

    def potential(self, x: Any) -> Any:
        return self.height(x)

    def dissipation(self, v: Any) -> Any:
        return self.drag * v[0] ** 2 / 2

    def height(self, x: Any) -> Any:
        """Return the height of the bob."""
        return self.length * (1 - sp.cos(x[0]))


@dataclass(frozen=True, kw_only=True)
class Bowl(ImpactOscillator):
    """A ball in a parabolic bowl."""

    curvature: float = 0.8
    drag: float = 0.0
    degrees_of_freedom = 2

    def kinetic(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 2

    def potential(self, x: Any) -> Any:
        return sp.Integer(0)

    def dissipation(self, v: Any) -> Any:
        return self.drag * (v[0] ** 2 + v[1] ** 2) / 2

    def height(self, x: Any) -> Any:
        """Return the height of the ball above the bowl."""
        return x[1] - self.curvature * x[0] ** 2 / 2


@dataclass(frozen=True, kw_only=True)
class Arm(ImpactOscillator):
    """A double pendulum whose tip meets a wall: the mass matrix depends on the angles, too."""

    drag: float = 0.1
    degrees_of_freedom = 2

    def kinetic(self, x: Any, v: Any) -> Any:  # type: ignore[override]
        return v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * sp.cos(x[0] - x[1])

    def potential(self, x: Any) -> Any:
        return 2 * (1 - sp.cos(x[0])) + 1 - sp.cos(x[1])

    def dissipation(self, v: Any) -> Any:
        return self.drag * (v[0] ** 2 + (v[1] - v[0]) ** 2) / 2

    def reach(self, x: Any) -> Any:
        """Return the distance of the tip from below the pivot."""
        return sp.sin(x[0]) + sp.sin(x[1])


@dataclass(frozen=True, kw_only=True)
class Pair(ImpactOscillator):
    """Two masses on springs; the second one is met by a stop, by name."""

    degrees_of_freedom = 2

    def kinetic(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 2

    def potential(self, x: Any) -> Any:
        return (x[0] ** 2 + (x[1] - x[0]) ** 2) / 2

    def dissipation(self, v: Any) -> Any:
        return (v[0] ** 2 + (v[1] - v[0]) ** 2) / 20

    def second(self, x: Any) -> Any:
        """Return the second displacement."""
        return x[1]


def floor(name: str = "height", **own: Any) -> list[HardStop]:
    return [HardStop(name, name="floor", **own)]


BOB = Bob(frequency=2.0, elements=floor(amplitude=0.05, offset=0.3, restitution=0.7))
STICKING_BOB = Bob(frequency=2.7, elements=floor(amplitude=0.1, offset=0.3, restitution=0.3))
BOWL = Bowl(
    frequency=2.0, drag=0.1, constant_forces=(0.0, -1.0), elements=floor(amplitude=0.6, phase=0.4)
)
SLIDING = Bowl(
    frequency=3.0,
    drag=0.1,
    constant_forces=(0.0, -1.0),
    harmonic_forces=(0.0, 1.5),
    elements=floor(amplitude=0.02, restitution=0.3),
)
ARM = Arm(
    frequency=1.7,
    harmonic_forces=(0.8, 0.0),
    elements=floor("reach", side="below", amplitude=0.1, offset=0.2, restitution=0.6),
)


class Exact:
    """Motions in sixty digits, from the energies by Lagrange's equations and a multiplier."""

    def __init__(self, system: ImpactOscillator) -> None:
        self.system, self.n = system, system.degrees_of_freedom
        (self.stop,) = system.elements
        self.w = arb(system.frequency)

    @cached_property
    def _functions(self) -> Any:
        """Of x, v, phase: accelerations, the force of contact, gap, rate, and a unit impulse."""
        s, n, w = self.system, self.n, sp.Float(self.system.frequency, 60)
        x, v = (sp.symbols(f"{name}:{n}") for name in ("x", "v"))
        phase = sp.Symbol("phase")
        kinetic = s.kinetic(x, v) if isinstance(s, Arm) else s.kinetic(v)
        height = getattr(s, self.stop.coordinate)(x)
        mass, row = sp.hessian(kinetic, v), sp.Matrix([height]).jacobian(x)
        pushes = []
        for i in range(n):
            momentum = sp.diff(kinetic, v[i])
            force = sp.diff(kinetic - s.potential(x), x[i]) - sp.diff(s.dissipation(v), v[i])
            force -= sum(sp.diff(momentum, y) * u for y, u in zip(x, v, strict=True))
            if s.harmonic_forces:
                force += sp.Float(s.harmonic_forces[i].real, 60) * sp.sin(phase)
            if s.constant_forces:
                force += sp.Float(s.constant_forces[i], 60)
            pushes.append(force)
        inverse = mass.adjugate() / mass.det()
        free, response = inverse * sp.Matrix(pushes), inverse * row.T
        bend = sum(sp.diff(height, x[i], x[j]) * v[i] * v[j] for i in range(n) for j in range(n))
        a, lag = sp.Float(self.stop.amplitude, 60), sp.Float(self.stop.phase, 60)
        swing = a * sp.sin(phase - lag)
        force = (-(w**2) * swing - bend - (row * free)[0]) / (row * response)[0]
        gap = height - sp.Float(self.stop.offset, 60) - swing
        rate = (row * sp.Matrix(v))[0] - w * a * sp.cos(phase - lag)
        held = free + response * force
        gap = height - sp.Float(self.stop.offset, 60) - swing
        rate = (row * sp.Matrix(v))[0] - w * a * sp.cos(phase - lag)
        turns = {"sin": lambda y: y.sin(), "cos": lambda y: y.cos()}

        def function(*values: Any) -> Any:
            exact = [sp.nsimplify(value) for value in values]
            return sp.lambdify((*x, *v, phase), exact, modules=[turns], cse=True)

        return {
            "free": function(*free),
            "held": function(*held),
            "force": function(force),
            "gap": function(gap),
            "rate": function(rate),
            "kick": function(*(response / (row * response)[0])),
        }

    def _value(self, name: str, s: list[Many]) -> Any:
        return self._functions[name](*s)[0]

    def fly(self, s: list[Many], time: Any, *, held: bool = False) -> list[Many]:
        """The state (x, v, phase) after a time."""
        return followed_in_many_digits(self._velocity(held=held), s, time)

    def _velocity(self, *, held: bool) -> VelocityOf:
        n, accelerations = self.n, self._functions["held" if held else "free"]
        return lambda z: [*z[n : 2 * n], *accelerations(*z), 0 * z[-1] + self.w]

    def until(self, s: list[Many], time: float, *, held: bool = False) -> tuple[Any, list[Many]]:
        """Time and state where the gap, or in contact the force, is zero, near a time."""
        zero, back = "force" if held else "gap", 2.0**-20
        before = arb(time) - arb(back)
        paths = taylor(self._velocity(held=held), self.fly(s, before, held=held))

        def at(t: Any) -> list[Many]:
            return [arb_poly(path.coeffs())(t).mid() for path in paths]

        times = [arb(back), arb(back) + arb(2.0**-30)]
        values = [self._value(zero, at(t)).mid() for t in times]
        for _ in range(5):
            slope = (values[1] - values[0]) / (times[1] - times[0])
            times = [times[1], (times[1] - values[1] / slope).mid()]
            values = [values[1], self._value(zero, at(times[1])).mid()]
            if abs(values[1]) < 1e-50 or values[0] == values[1]:
                break
        return before + times[1], at(times[1])

    def hit(self, s: list[Many]) -> list[Many]:
        """The state after an impact by Newton's law."""
        n, rate, kick = self.n, self._value("rate", s), self._functions["kick"](*s)
        r = 1 + arb(self.stop.restitution)
        v = [u - r * rate * k for u, k in zip(s[n : 2 * n], kick, strict=True)]
        return [*s[:n], *v, s[-1]]

    def after(self, s: list[Many], times: Any) -> list[list[Many]]:
        """Times and states (time, x, v, phase) after impacts near given times."""
        found, clock = [], arb(0)
        with ctx.workprec(BITS):
            for time in times:
                length, s = self.until(s, float(arb(float(time)) - clock))
                clock, s = clock + length, self.hit(s)
                found.append([clock, *s])
        return found

    def rate(self, s: list[Many]) -> Any:
        """Rate of the gap, towards its side."""
        return self.stop.sign * self._value("rate", s)
