"""Periodic orbits of one mass in closed form, and derivatives of its impact map.

In terms of the gap D of the (near) stop, x'' + c x' + k x = g + Im(F exp(i phase)) is

    D'' + c D' + k D = k d + Im(G exp(i phase)),    G = +-(F - (k + i c w - w^2) A)

with the equilibrium d, so that D = d + Im(R exp(i phase)) + y, R = G / (k + i c w - w^2), and y
decays freely but for the impulses J = (1 + 1/r) u of the impacts. Impulses a time T apart, all
alike, or of alternating sign at two stops, make y periodic when

    (y, y')+ = (1 -+ exp(A T))^-1 (0, J) = (p, q) J.

D = 0 and D' = u at an impact are then the real and imaginary part of one complex equation, whose
absolute value is quadratic in J, whatever the number of forcing periods in T.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import mpmath
import numpy as np
from flint import arb, arb_mat, ctx
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.systems.impact.impact_map import ImpactMap
from tests.reference.impact_chain import to_mpf

DIGITS = 40

Real: TypeAlias = Any
"""An mpf, an mpc or a matrix of them, which no type checker can name."""


@dataclass(frozen=True)
class Orbit:
    """Relative velocity u and phase after an impact; the matrix is the derivative of the next."""

    u: Real
    phase: Real
    derivative: Real

    @property
    def state(self) -> Array:
        return np.array([float(self.u), float(self.phase) % (2.0 * np.pi)])

    @property
    def multipliers(self) -> Array:
        """Of one flight, by trace and determinant, the smaller one first."""
        with mp.workdps(DIGITS):
            half = (self.derivative[0, 0] + self.derivative[1, 1]) / 2
            root = mpmath.sqrt(half * half - mpmath.det(self.derivative))
            found = [complex(half + root), complex(half - root)]
        return np.array(sorted(found, key=lambda z: (abs(z), z.imag)))

    @property
    def stable(self) -> bool:
        return bool(abs(self.multipliers).max() < 1.0)


def flight_matrix(c: Real, k: Real, time: Real) -> Real:
    """(x, x') of x'' + c x' + k x = 0 after a time, by (x, x') before."""
    with ctx.workprec(mp.prec + 20):
        flow = (arb_mat([[0, 1], [-arb(k), -arb(c)]]) * arb(time)).exp()
        return mpmath.matrix([[to_mpf(x) for x in row] for row in flow.table()])


def next_impact_derivative(
    flight: Real, after: tuple[Real, Real], before: tuple[Real, Real], r: Real, w: Real
) -> Real:
    """Derivative of (u, phase) at the next impact by (u, phase) at this one.

    `after` and `before` are rate and second derivative of the gap at the start and at the end of
    the flight. A later start is a change of the gap at the same time.
    """
    (u, start), (rate, end) = after, before
    moved = flight * mpmath.matrix([[0, -u / w], [1, -start / w]])
    later = [-moved[0, i] / rate for i in range(2)]
    speed = [-r * (moved[1, i] + end * later[i]) for i in range(2)]
    return mpmath.matrix([speed, [w * later[0], w * later[1]]])


def periodic_orbits(system: ImpactMap, periods: int) -> list[Orbit]:
    """Orbits of one impact in so many periods; of two at two stops, half of the periods apart.

    In the latter case the periods are odd, and the derivative is that of half the orbit, with the
    far stop's velocity counted positive.
    """
    two = bool(np.isfinite(system.play))
    turn = -1 if two else 1
    with mp.workdps(DIGITS):
        c, k = mpf(float(system.damping_matrix[0, 0])), mpf(float(system.stiffness[0, 0]))
        w, r, amplitude = mpf(system.frequency), mpf(system.restitution), mpf(system.amplitude)
        sign = 1 if system.side == "above" else -1
        middle = mpf(system.play) / 2 if two else -sign * mpf(system.offset)
        rigidity = k - w * w + mpmath.mpc(0, 1) * c * w
        drive = sign * (mpmath.mpmathify(system.harmonic_forces[0]) - rigidity * amplitude)
        response = drive / rigidity
        time = periods * mp.pi / w * (1 if two else 2)
        flight = flight_matrix(c, k, time)
        p, q = (mpmath.eye(2) - turn * flight) ** -1 * mpmath.matrix([0, 1])
        s = r / (1 + r) - q
        square, linear = p * p + (s / w) ** 2, middle * p
        rest = middle * middle - abs(response) ** 2
        discriminant = linear * linear - square * rest
        orbits = []
        for root in (1, -1):
            impulse = (root * mpmath.sqrt(discriminant) - linear) / square
            if discriminant < 0 or impulse <= 0:
                continue
            place = mpmath.mpc(s * impulse / w, -middle - p * impulse)
            phase = mpmath.arg(place / response)
            u = r * impulse / (1 + r)
            force = k * middle + mpmath.im(drive * mpmath.expj(phase))
            # The gap is zero, that of the other stop when the flight ends there.
            after, before = (u, force - c * u), (-u / r, force + c * u / r)
            orbits.append(
                Orbit(u, phase, next_impact_derivative(turn * flight, after, before, r, w))
            )
        return orbits
