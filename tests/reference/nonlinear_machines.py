"""Random machines whose springs are not linear, and their motions in sixty digits.

The reference reads energies, functions and the numbers of elements. It takes the order of events
from a record, derives Lagrange's equations anew with multipliers for what holds or sticks, and
solves for the time of each event.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp
from flint import arb, arb_poly, ctx

from dynkit.systems import DryFriction, HardStop, ImpactOscillator, SoftStop, ViscoelasticSpheres
from dynkit.systems.impact.elements.element import IMPACT
from tests.flows.cases import BITS, Many, followed_in_many_digits, taylor


def _kinetic(kind: str, c: Any, x: Any, v: Any) -> Any:
    total = sum(m * u**2 for m, u in zip(c[:4], v, strict=False))
    if kind == "arm" and len(x) > 1:
        total += c[4] * v[0] * v[1] * sp.cos(x[0] - x[1])
    if kind == "bead":
        total += c[4] * x[0] ** 2 * v[0] ** 2
    return total / 2


def _potential(kind: str, c: Any, x: Any) -> Any:
    stretches = [b - a for a, b in zip([sp.Integer(0), *x], x, strict=False)]
    total = sum(k * s**2 / 2 for k, s in zip(c[5:9], stretches, strict=False))
    if kind in ("cubic", "bead"):
        return total + sum(c[9] * s**4 / 4 for s in stretches)
    if kind == "toda":
        return total + sum(c[9] * (sp.exp(s) - s - 1) for s in stretches)
    return total + sum(c[9] * (1 - sp.cos(y)) for y in x)


def _dissipation(c: Any, v: Any) -> Any:
    return c[10] * sum(u**2 for u in v) / 2


def _bump(c: Any, x: Any) -> Any:
    return x[-1] + c[11] * x[0] ** 2 + c[11] * sp.sin(x[-1]) / 2


def _tilt(c: Any, x: Any) -> Any:
    return x[-1] + c[11] * sp.sin(x[-1]) / 2


def _way(c: Any, x: Any) -> Any:
    return x[0] + c[11] * sp.sin(x[0])


FUNCTIONS = {"bump": _bump, "tilt": _tilt, "way": _way}


@dataclass(frozen=True, kw_only=True)
class Random(ImpactOscillator):
    """Masses on springs of a kind: cubic, of Toda, with gravity, or where masses vary."""

    kind: Any = "cubic"
    numbers: Any = ()
    masses: Any = 1

    @property
    def degrees_of_freedom(self) -> int:
        return int(self.masses)

    @property
    def _exact(self) -> list[Any]:
        return [sp.Float(c) for c in self.numbers]

    def kinetic(self, x: Any, v: Any) -> Any:  # type: ignore[override]
        return _kinetic(self.kind, self._exact, x, v)

    def potential(self, x: Any) -> Any:
        return _potential(self.kind, self._exact, x)

    def dissipation(self, v: Any) -> Any:
        return _dissipation(self._exact, v)

    def bump(self, x: Any) -> Any:
        """Return a function of the coordinates that increases with the last one."""
        return _bump(self._exact, x)

    def tilt(self, x: Any) -> Any:
        """Return a function of the last coordinate."""
        return _tilt(self._exact, x)

    def way(self, x: Any) -> Any:
        """Return a function of the first coordinate."""
        return _way(self._exact, x)


KINDS = "cubic", "toda", "gravity", "arm", "bead"


def random_nonlinear(seed: int) -> tuple[Random, Any]:
    """A random machine with none to three elements besides a stop, and a start in flight."""
    random = np.random.default_rng([seed, 77])
    n, kind = int(random.integers(1, 4)), str(random.choice(KINDS))
    numbers = random.uniform(0.3, 1.5, 12)
    numbers[4] = random.uniform(0.1, 0.25)
    numbers[10], numbers[11] = random.uniform(0.0, 0.15), random.uniform(0.05, 0.3)
    place: Any = "bump" if random.random() < 0.4 else n - 1
    law: Any = float(random.choice([0.0, 0.4, 0.8, 0.95]))
    if random.random() < 0.2:
        law = ViscoelasticSpheres(0.2)
    elements: list[Any] = [
        HardStop(
            place,
            offset=random.uniform(-0.4, -0.1),
            amplitude=random.choice([0.0, 0.1]),
            phase=random.uniform(-3.0, 3.0),
            restitution=law,
            name="stop",
        )
    ]
    if random.random() < 0.4:
        pad = {"stiffness": random.uniform(5.0, 40.0), "damping": random.choice([0.0, 0.2])}
        at = "bump" if place != "bump" and random.random() < 0.4 else n - 1
        elements.append(SoftStop(at, offset=random.uniform(0.2, 0.5), side="below", **pad))
    if n > 1 and random.random() < 0.5:
        force = random.uniform(0.02, 0.1)
        static = force * random.choice([1.0, 1.4])
        drift = random.choice([0.0, 0.2])
        elements.append(DryFriction(0, force=force, static=static, velocity=drift))
    if n == 3 and random.random() < 0.5:
        elements.append(HardStop(1, offset=-0.5, restitution=0.5))
    machine = Random(
        kind=kind,
        numbers=tuple(numbers.tolist()),
        masses=n,
        frequency=random.uniform(0.6, 2.0),
        harmonic_forces=random.uniform(0.1, 0.9, n).tolist(),
        constant_forces=random.uniform(-0.4, 0.1, n).tolist(),
        elements=elements,
    )
    x, v = random.uniform(0.0, 0.3, n), random.uniform(-0.3, 0.3, n)
    return machine, machine.state(x, v, float(random.uniform(0.0, 6.0)))


def random_rubbing(seed: int) -> tuple[Random, Any]:
    """The same with friction at the contact with the stop, both along functions.

    Masses do not couple the two: so impacts have unique outcomes.
    """
    machine, start = random_nonlinear(seed)
    random = np.random.default_rng([seed, 78])
    stop, *others = machine.elements
    restitution = float(random.choice([0.0, 0.3, 0.7]))
    others = [e for e in others if not isinstance(e, DryFriction)]
    coefficient = random.uniform(0.1, 0.8)
    rub = DryFriction(
        "way",
        coefficient=coefficient,
        static=coefficient * random.choice([1.0, 1.3]),
        velocity=random.choice([0.0, 0.3]),
        normal="stop",
    )
    n = max(machine.masses, 2)
    machine = machine.replace(
        kind="bead" if machine.kind == "arm" else machine.kind,
        masses=n,
        harmonic_forces=random.uniform(0.1, 0.9, n).tolist(),
        constant_forces=random.uniform(-0.9, -0.2, n).tolist(),
        elements=[replace(stop, coordinate="tilt", restitution=restitution), rub, *others],
    )
    x, v = random.uniform(0.0, 0.3, n), random.uniform(-0.3, 0.3, n)
    return machine, machine.state(x, v, start.phase)


class Truth:
    """The motion of a machine in sixty digits, with the events of a record."""

    def __init__(self, system: Random) -> None:
        self.system, self.n, self.w = system, system.degrees_of_freedom, arb(system.frequency)
        names = [e.name for e in system._elements]
        self.leans = {
            k: names.index(e.leans_on) for k, e in enumerate(system._elements) if e.leans_on
        }
        self.constants = [arb(c) for c in system.numbers]
        self.forces = [
            (arb(complex(f).real), arb(complex(f).imag), arb(g))
            for f, g in zip(system.harmonic_forces, system.constant_forces, strict=True)
        ]

    @cached_property
    def functions(self) -> Any:
        """Of x, v and numbers: masses and forces; and by names functions, gradients and bends."""
        n, kind = self.n, self.system.kind
        x, v = sp.symbols(f"x:{n}"), sp.symbols(f"v:{n}")
        c = sp.symbols("c:12")
        kinetic = _kinetic(kind, c, x, v)
        forces = []
        for i in range(n):
            momentum = sp.diff(kinetic, v[i])
            force = sp.diff(kinetic - _potential(kind, c, x), x[i])
            force -= sp.diff(_dissipation(c, v), v[i])
            forces.append(force - sum(sp.diff(momentum, y) * u for y, u in zip(x, v, strict=True)))
        parts = {"": [*list(sp.hessian(kinetic, v)), *forces]}
        for name, of in FUNCTIONS.items():
            row, second = [sp.diff(of(c, x), y) for y in x], sp.hessian(of(c, x), x)
            bend = sum(second[i, j] * v[i] * v[j] for i in range(n) for j in range(n))
            parts[name] = [of(c, x), *row, bend]
        turns = {"sin": lambda y: y.sin(), "cos": lambda y: y.cos(), "exp": lambda y: y.exp()}
        given = *x, *v, *c
        return {
            name: sp.lambdify(given, part, modules=[turns], cse=True)
            for name, part in parts.items()
        }

    def along(self, k: int, z: list[Many]) -> tuple[Many, list[Many], Many]:
        """Function of an element, its gradient, and what velocities add to its acceleration."""
        place = self.system._elements[k].coordinate
        if isinstance(place, str):
            value, *row, bend = self.functions[place](*z[: 2 * self.n], *self.constants)
            return value, row, bend
        row = [arb(int(i == place)) for i in range(self.n)]
        return z[place], row, arb(0)

    def gap(self, k: int, z: list[Many]) -> tuple[Many, Many]:
        """Gap of an element, and its rate."""
        e, n = self.system._elements[k], self.n
        value, row, _ = self.along(k, z)
        turn = z[2 * n] - arb(e.phase)
        a, w = arb(e.amplitude), self.w
        speed = sum((r * u for r, u in zip(row, z[n : 2 * n], strict=True)), arb(0))
        place = value - arb(e.offset) - a * turn.sin()
        return e.sign * place, e.sign * (speed - w * a * turn.cos() - arb(e.drift))

    def balance(self, regimes: Any, z: list[Many]) -> tuple[list[Many], dict[int, Many]]:
        """Accelerations, and forces of what holds or sticks."""
        n, elements = self.n, self.system._elements
        found = self.functions[""](*z[: 2 * n], *self.constants)
        mass, force = [found[n * i : n * i + n] for i in range(n)], list(found[n * n :])
        sine, cosine = z[2 * n].sin(), z[2 * n].cos()
        for i, (a, b, c) in enumerate(self.forces):
            force[i] = force[i] + a * sine + b * cosine + c
        own = [k for k, r in enumerate(regimes) if r.holds or r.sticks]
        rows = {}
        for k, regime in enumerate(regimes):
            if k in own or regime.acts:
                rows[k] = self.along(k, z)
            if regime.acts:
                gap, rate = self.gap(k, z)
                push = arb(regime.push) - arb(regime.stiffness) * gap - arb(regime.damping) * rate
                for i in range(n):
                    force[i] = force[i] + elements[k].sign * rows[k][1][i] * push
        push = {k: list(rows[k][1]) for k in own}
        for k, stop in self.leans.items():
            if regimes[k].traction and stop in own:
                over = arb(elements[k].sign * elements[stop].sign * regimes[k].traction)
                along = self.along(k, z)[1]
                push[stop] = [a + over * b for a, b in zip(push[stop], along, strict=True)]
        for i in range(n):
            mass[i] = [*mass[i], *(-push[k][i] for k in own)]
        for k in own:
            e, (_, row, bend) = elements[k], rows[k]
            turn = z[2 * n] - arb(e.phase)
            swing = -self.w * self.w * arb(e.amplitude) * turn.sin()
            mass.append([*row, *(arb(0) for _ in own)])
            force.append(swing - bend)
        solved = _solved(mass, force)
        return solved[:n], {k: elements[k].sign * f for k, f in zip(own, solved[n:], strict=True)}

    def rates(self, regimes: Any, z: list[Many]) -> list[Many]:
        return [*z[self.n : 2 * self.n], *self.balance(regimes, z)[0], 0 * z[-1] + self.w]

    def watched(self, regimes: Any, k: int, watch: Any, z: list[Many]) -> Many:
        """What a guard watches."""
        gap, rate = self.gap(k, z)
        value = arb(watch.level) + arb(watch.gap) * gap + arb(watch.rate) * rate
        if watch.force:
            forces = self.balance(regimes, z)[1]
            value = value + arb(watch.force) * forces[k]
            if watch.normal:
                value = value + arb(watch.normal) * forces[self.leans[k]]
        return value

    def hit(self, regimes: Any, k: int, z: list[Many]) -> list[Many]:
        """The state after an impact; what holds takes an impulse, too."""
        n, elements = self.n, list[Any](self.system._elements)
        found = self.functions[""](*z[: 2 * n], *self.constants)
        both = [k, *(j for j, r in enumerate(regimes) if r.holds or r.sticks)]
        rows = {j: self.along(j, z)[1] for j in both}
        rate = self.gap(k, z)[1]
        law: Any = elements[k].restitution
        r = arb(law) if isinstance(law, float) else self._law(law, -rate)
        matrix = [[*found[n * i : n * i + n], *(-rows[j][i] for j in both)] for i in range(n)]
        matrix += [[*rows[j], *(arb(0) for _ in both)] for j in both]
        jump = [arb(0)] * n + [elements[k].sign * -(1 + r) * rate] + [arb(0)] * (len(both) - 1)
        change = _solved(matrix, jump)
        v = [u + d for u, d in zip(z[n : 2 * n], change, strict=False)]
        for j in (j for j, stop in self.leans.items() if stop == k):  # masses do not couple these
            row, impulse = self.along(j, z)[1], abs(change[n])
            response = _solved([found[n * i : n * i + n] for i in range(n)], row)
            over = sum((a * b for a, b in zip(row, response, strict=True)), arb(0))
            slip = elements[j].sign * self.gap(j, [*z[:n], *v, z[-1]])[1]
            most = arb(elements[j].kinetic) * impulse * over
            lost = slip if abs(slip) <= most else most if slip > 0 else -most
            v = [u - lost / over * d for u, d in zip(v, response, strict=True)]
        return [*z[:n], *v, z[-1]]

    @staticmethod
    def _law(law: ViscoelasticSpheres, speed: Many) -> Many:
        root = (speed.log() / 5).exp()
        return 1 - arb(law.dissipation) * root + arb(law.second) * root * root

    def follow(self, regimes: Any, z: list[Many], lasts: Many) -> list[Many]:
        return followed_in_many_digits(lambda s: self.rates(regimes, s), z, lasts)

    def until(self, regimes: Any, k: int, watch: Any, z: list[Many], lasts: float) -> Any:
        """Time and state where a guard is zero, near a duration."""
        back = min(2.0**-12, 0.25 * lasts)
        begin = arb(lasts) - arb(back)
        near = self.follow(regimes, z, begin)
        paths = taylor(lambda s: self.rates(regimes, s), near)

        def at(t: Any) -> list[Many]:
            return [arb_poly(path.coeffs())(t).mid() for path in paths]

        times = [arb(back), arb(back) * (1 + arb(2) ** -20)]
        values = [self.watched(regimes, k, watch, at(t)).mid() for t in times]
        for _ in range(30):
            if values[0] == values[1] or abs(values[1]) < 1e-45:
                break
            slope = (values[1] - values[0]) / (times[1] - times[0])
            times = [times[1], (times[1] - values[1] / slope).mid()]
            values = [values[1], self.watched(regimes, k, watch, at(times[1])).mid()]
        return begin + times[1], at(times[1])

    def compared(self, record: Any) -> list[tuple[float, float, float]]:
        """Of impacts: actual error of the time and of the state, and the estimate of both.

        As far as no bounces are left out.
        """
        s, automaton, out = record._run.segments, record.system._automaton, []
        start = record._run.start
        phase = arb.atan2(arb(float(start._turn[0])), arb(float(start._turn[1])))
        with ctx.workprec(BITS):
            z = [arb(float(y)) for part in (start.position, start.velocity) for y in part]
            z, clock, number = [*z, phase.mid()], arb(0), 0
            for i in range(len(s.begin) - 1):
                if (s.rest[i + 1] > 0.0 < s.speed[i + 1]) or number >= len(record):
                    break
                mode = automaton.modes[int(s.mode[i])]
                guard = automaton.guards[int(s.guard[i + 1])]
                lasts = float((arb(float(s.begin[i + 1])) - clock).mid())
                if s.begin[i + 1] > s.begin[i]:
                    own = guard
                    if guard.watch.force:  # an impact may let go of what sticks
                        now = (automaton.guards[g] for g in s.guard[s.begin == s.begin[i + 1]])
                        own = next((g for g in now if g.watch.event == IMPACT), guard)
                    took, z = self.until(mode.regimes, own.element, own.watch, z, lasts)
                    clock = (clock + took).mid()
                if guard.watch.event == IMPACT and int(s.point[i + 1]) > number:
                    z = [y.mid() for y in self.hit(mode.regimes, guard.element, z)]
                    x = [float(y) for y in z]
                    own = np.concatenate([record.position[number], record.velocity[number]])
                    late = abs(float(clock - arb(float(record.time[number]))))
                    off = float(abs(own - x[: 2 * self.n]).max())
                    out.append((late, off, float(record.error[number])))
                    number += 1
        return out


def _solved(matrix: list[list[Many]], right: list[Many]) -> list[Many]:
    """Solution of linear equations of numbers or series, by elimination without pivots."""
    a, b = [list(row) for row in matrix], list(right)
    n = len(b)
    for k in range(n):
        for i in range(k + 1, n):
            factor = a[i][k] / a[k][k]
            a[i] = [p - factor * q for p, q in zip(a[i], a[k], strict=True)]
            b[i] = b[i] - factor * b[k]
    for k in reversed(range(n)):
        for j in range(k + 1, n):
            b[k] = b[k] - a[k][j] * b[j]
        b[k] = b[k] / a[k][k]
    return b
