"""Periodic orbits of any impact oscillator to 60 digits, and their multipliers.

State: positions, velocities, sine and cosine of the phase, and 1, which exp(A t) moves. The impact
map is evaluated near given flight times, through stops if need be, so that orbits need not be
admissible. Derivatives are central differences of it with a step of 2^-200: no formula of a
derivative is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias, final

import numpy as np
from flint import acb, acb_mat, arb, arb_mat, ctx
from scipy.optimize import linear_sum_assignment

from dynkit.core.validation import Array
from dynkit.systems.impact.impact_map import ImpactMap as System
from dynkit.systems.impact.orbits.orbit import ImpactOrbit

BITS = 600
STEP = (1, -200)

Ball: TypeAlias = Any
"""A number or matrix of balls."""


def rounded(matrix: Ball) -> Array:
    return np.array([[float(x.mid()) for x in row] for row in matrix.table()])


def size(numbers: list[Ball]) -> float:
    return max(float(abs(x).mid()) for x in numbers)


def rates_of(rigidity: Ball, drag: Ball, forcing: Ball, frequency: Ball) -> Ball:
    """Rates of change of positions, velocities, sine, cosine and 1, all per unit of mass."""
    n = rigidity.nrows()
    rates = arb_mat(2 * n + 3, 2 * n + 3)
    for i in range(n):
        rates[i, n + i] = 1
        for j in range(n):
            rates[n + i, j], rates[n + i, n + j] = -rigidity[i, j], -drag[i, j]
        for j in range(3):
            rates[n + i, 2 * n + j] = forcing[i, j]
    rates[2 * n, 2 * n + 1], rates[2 * n + 1, 2 * n] = frequency, -frequency
    return rates.mid()


@final
class ImpactMap:
    """The oscillator in balls."""

    def __init__(self, system: System) -> None:
        n = self.size = system.degrees_of_freedom
        self.contact = system.contact % n
        self.others = [i for i in range(n) if i != self.contact]
        self.frequency, self.amplitude = arb(system.frequency), arb(system.amplitude)
        self.restitution = arb(system.restitution)
        sign = 1 if system.side == "above" else -1
        self.signs = [sign]
        self.places = [arb(system.offset)]
        if np.isfinite(system.play):
            self.signs.append(-sign)
            self.places.append(arb(system.offset) + sign * arb(system.play))
        mass, damping, stiffness = (
            arb_mat(m.tolist()) for m in (system.mass, system.damping_matrix, system.stiffness)
        )
        inverse = mass.inv()
        harmonic = np.asarray(system.harmonic_forces or (0j,) * n)
        constant = np.asarray(system.constant_forces or (0.0,) * n)
        forces = [harmonic.real, harmonic.imag, constant]
        forcing = inverse * arb_mat(np.transpose(forces).tolist())
        rigidity, drag = inverse * stiffness, inverse * damping
        self.rates = rates_of(rigidity, drag, forcing, self.frequency)
        self._fastest = max(sum(float(abs(x).mid()) for x in row) for row in self.rates.table())
        self.kick = [
            (inverse[i, self.contact] / inverse[self.contact, self.contact]).mid() for i in range(n)
        ]
        self.gaps = []
        for s, place in zip(self.signs, self.places, strict=True):
            row = arb_mat(1, 2 * n + 3)
            row[0, self.contact], row[0, 2 * n], row[0, 2 * n + 2] = (
                s,
                -s * self.amplitude,
                -s * place,
            )
            self.gaps.append((row, (row * self.rates).mid()))

    def lift(self, y: list[Ball], side: int) -> Ball:
        """All coordinates (2N + 3, 1) of section coordinates (2N,)."""
        n, c = self.size, self.contact
        sine, cosine = y[-1].sin_cos()
        x, v = [arb(0)] * n, [arb(0)] * n
        for i, k in enumerate(self.others):
            x[k], v[k] = y[i], y[n - 1 + i]
        x[c] = self.amplitude * sine + self.places[side]
        v[c] = self.amplitude * self.frequency * cosine + self.signs[0] * y[-2]
        return arb_mat([[z] for z in [*x, *v, sine, cosine, arb(1)]]).mid()

    def moved(self, z: Ball, time: Ball) -> Ball:
        """exp(A time) z of a short time, by its series."""
        step = self.rates * time
        norm = self._fastest * abs(float(time))
        total, term, least = z, z, 1.0
        for k in range(1, 400):
            term = step * term / k
            total += term
            least *= norm / k
            if least <= 2.0 ** -(BITS + 40) and k > norm:
                return total.mid()
        raise ArithmeticError("the time is too long")

    def next(self, y: list[Ball], side: int, flow: Ball, time: Ball, to: int) -> list[Ball]:
        """Section coordinates after the impact with stop `to` near a time with exp(A time)."""
        n, (gap, gap_rate) = self.size, self.gaps[to]
        z = (flow * self.lift(y, side)).mid()
        for _ in range(60):
            rate = (gap_rate * z)[0, 0]
            later = -((gap * z)[0, 0] / rate).mid()
            if abs(later) < arb((1, 40 - BITS)):
                break
            z, time = self.moved(z, later), (time + later).mid()
        else:
            raise ArithmeticError("no impact near the time that was given")
        rebound = -self.restitution * rate
        velocity = [
            z[n + i, 0] + k * self.signs[to] * (rebound - rate) for i, k in enumerate(self.kick)
        ]
        u = rebound if to == 0 else -rebound
        others = self.others
        parts = [z[i, 0] for i in others] + [velocity[i] for i in others]
        return [p.mid() for p in [*parts, u, y[-1] + self.frequency * time]]


@dataclass(frozen=True)
class ExactOrbit:
    """Section coordinates after each impact, and the derivative of the map around, rounded."""

    states: list[list[Ball]]
    derivative: Ball

    @property
    def multipliers(self) -> Array:
        """(2N,), in any order."""
        with ctx.workprec(BITS):
            found = acb_mat(self.derivative).eig(algorithm="approx")
            return np.array([complex(float(z.real.mid()), float(z.imag.mid())) for z in found])

    def error_of(self, states: Array) -> float:
        """Largest error of section coordinates (n, 2N)."""
        worst = 0.0
        with ctx.workprec(BITS):
            for exact, found in zip(self.states, states.tolist(), strict=True):
                parts = [abs(a - arb(b)) for a, b in zip(exact[:-1], found[:-1], strict=True)]
                turns = (exact[-1] - arb(found[-1])) / (2 * arb.pi())
                around = 2 * arb.pi() * (turns - (turns + 0.5).floor())
                worst = max(worst, size([*parts, around]))
        return worst


def exact_orbit(orbit: ImpactOrbit) -> ExactOrbit:
    """What Newton's method on the impact map makes of the states of an orbit."""
    with ctx.workprec(BITS):
        impacts = ImpactMap(orbit.system)
        sides = orbit.problem().sides.tolist()
        ends = np.append(orbit.phases, orbit.phases[0] + 2.0 * np.pi * orbit.periods)
        times = [arb(x) for x in (np.diff(ends) / orbit.system.frequency).tolist()]
        flows = [(impacts.rates * t).exp().mid() for t in times]

        def around(y: list[Ball]) -> list[list[Ball]]:
            out = [y]
            for i, (flow, time) in enumerate(zip(flows, times, strict=True)):
                to = sides[(i + 1) % len(sides)]
                out.append(impacts.next(out[-1], sides[i], flow, time, to))
            return out

        def derivative(y: list[Ball]) -> Ball:
            h, columns = arb(STEP), []
            for k in range(len(y)):
                ends = [around([*y[:k], y[k] + s * h, *y[k + 1 :]])[-1] for s in (1, -1)]
                columns.append([(b - a) / (-2 * h) for a, b in zip(*ends, strict=True)])
            return arb_mat(columns).transpose().mid()

        y = [arb(x) for x in orbit.states[0].tolist()]
        turn = 2 * arb.pi() * orbit.periods
        around_once = derivative(y)
        newton = (arb_mat(around_once) - arb_mat(np.eye(len(y)).tolist())).inv().mid()
        for _ in range(60):
            left = [b - a for a, b in zip(y, around(y)[-1], strict=True)]
            left[-1] -= turn
            if size(left) < 1e-60:
                return ExactOrbit(around(y)[:-1], derivative(y))
            step = (newton * arb_mat([[x] for x in left])).entries()
            y = [(a - b).mid() for a, b in zip(y, step, strict=True)]
    raise ArithmeticError("there is no orbit near")


def distance(a: Any, b: Any) -> float:
    """Largest distance of numbers paired with each other so that the sum is smallest."""
    apart = abs(np.subtract.outer(np.asarray(a), np.asarray(b)))
    return float(apart[linear_sum_assignment(apart)].max())


@dataclass(frozen=True)
class OneImpact:
    """P(1,m) in closed form: impulse, phase and section coordinates."""

    side: int
    impulse: float
    state: Array


def answers(impacts: ImpactMap, periods: int) -> tuple[arb_mat, arb_mat, acb_mat, arb_mat]:
    """The free structure A, and what it does, (2N, 1): to the forces, and to unit impulses.

    The latter are once in so many periods: just after one the state is (1 - exp(A T))^-1 b. Under
    the forces it is the imaginary part of the complex answer times exp(i phase), about a rest.
    """
    n, w = impacts.size, impacts.frequency
    free = arb_mat([[impacts.rates[i, j] for j in range(2 * n)] for i in range(2 * n)])
    one = arb_mat(np.eye(2 * n).tolist())
    kick = arb_mat([[arb(0)]] * n + [[k] for k in impacts.kick])
    flow = (free * (2 * arb.pi() * periods / w)).exp()
    kicked = ((one - flow).inv() * kick).mid()
    forcing = [[impacts.rates[i, 2 * n + j] for j in range(3)] for i in range(2 * n)]
    force = acb_mat([[acb(row[0], row[1])] for row in forcing])
    steady = (acb_mat(one) * acb(0, w) - acb_mat(free)).inv() * force
    return free, kicked, steady, -free.inv() * arb_mat([[row[2]] for row in forcing])


def one_impact_orbits(system: System, periods: int) -> list[OneImpact]:
    """All P(1,m) with a positive impulse.

    With E = exp(A T) of the free structure the state just after a unit impulse once a period is
    (1 - E)^-1 b. Together with the steady response, gap 0 and rate r/(1 + r) J are one complex
    equation a exp(i phase) + c + d J = 0; its absolute values are a quadratic equation for J.
    """
    with ctx.workprec(BITS):
        impacts = ImpactMap(system)
        n, c, w, r = impacts.size, impacts.contact, impacts.frequency, impacts.restitution
        _, kicked, steady, rest = answers(impacts, periods)
        drive = steady[c, 0] - impacts.amplitude
        out = []
        for side, (s, place) in enumerate(zip(impacts.signs, impacts.places, strict=True)):
            # Gap + i rate / w would mix drive and its conjugate: rate / w + i gap does not.
            middle = acb(0, s * (rest[c, 0] - place))
            slope = acb((kicked[n + c, 0] - r / (1 + r)) / w, kicked[c, 0])
            a = (slope * slope.conjugate()).real
            b = (middle * slope.conjugate()).real
            e = (middle * middle.conjugate() - drive * drive.conjugate()).real
            root = b * b - a * e
            if root < 0:
                continue
            for sign in (1, -1):
                impulse = ((-b + sign * root.sqrt()) / a).mid()
                if not impulse > 0:
                    continue
                turned = -(middle + slope * impulse) / (s * drive)
                turned = acb(turned.real.mid(), turned.imag.mid())
                x = [
                    (steady[i, 0] * turned).imag + rest[i, 0] + s * impulse * kicked[i, 0]
                    for i in range(2 * n)
                ]
                u = impulse * r / (1 + r) * (1 if side == 0 else -1)
                phase = float(turned.arg().mid()) % (2.0 * np.pi)
                others = [x[i] for i in impacts.others] + [x[n + i] for i in impacts.others]
                state = np.array([float(z.mid()) for z in [*others, u]] + [phase])
                out.append(OneImpact(side, float(impulse), state))
        return out
