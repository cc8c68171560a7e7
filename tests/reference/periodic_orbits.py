"""Orbits with one impact in some table periods, of chains of unit masses, in closed form.

The flight of m periods leads from z = (x, v), just after the impact, to z - (1 + 1/r) u e, where e
is the velocity of the contact mass: z = u Z, with (flow - 1) Z = -(1 + 1/r) e. What is left are
x = A sin phase and v = A w cos phase + u of the contact mass: two equations, linear in sine and
cosine, which give u and the phase. No impact between the two is proved by `first_root`.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import mpmath
from mpmath import mp, mpf

from tests.reference.exponential import expm
from tests.reference.extremes import ExtremeCase
from tests.reference.general_oscillator import BITS, History, Impact
from tests.reference.mode_bounds import Real

SAME: Final = "1e-50"
SETTLED: Final = "1e-40"


class PeriodicOrbit(NamedTuple):
    """Time between two impacts, phase and state just after each."""

    period: Real
    phase: Real
    relative_velocity: Real
    position: tuple[Real, ...]
    velocity: tuple[Real, ...]

    def impact(self, time: Real) -> Impact:
        """The impact, if it happens at this time."""
        return Impact(
            time, self.phase, self.relative_velocity, self.position, self.velocity, "near"
        )


def periodic_orbit(case: ExtremeCase, turns: int) -> PeriodicOrbit:
    """The orbit of one impact in so many turns; the case has unit masses and offset 0."""
    assert set(case.masses) == {1.0}
    assert case.offset == 0.0
    assert isinstance(case.damping, float)
    n = len(case.masses)
    with mp.workprec(BITS):
        c, r = mpf(case.damping), mpf(case.restitution)
        a, w = mpf(case.amplitude), mpf(case.frequency)
        period = turns * 2 * mp.pi / w
        rate = mpmath.zeros(2 * n)
        for i, k in enumerate(case.springs):
            rate[i, n + i] = 1
            for row in {i, max(i - 1, 0)}:
                for column in {i, max(i - 1, 0)}:
                    sign = 1 if row == column else -1
                    rate[n + row, column] -= sign * mpf(k)
                    rate[n + row, n + column] -= sign * c * mpf(k)
        kick = mpmath.zeros(2 * n, 1)
        kick[2 * n - 1] = -1 - 1 / r
        z = mpmath.lu_solve(expm(rate * period) - mpmath.eye(2 * n), kick)
        x, v = z[n - 1], z[2 * n - 1]
        u = a / mpmath.sqrt(x * x + ((v - 1) / w) ** 2)
        phase = mpmath.atan2(x * u, (v - 1) * u / w) % (2 * mp.pi)
        numbers = [u * y for y in z]
        orbit = PeriodicOrbit(period, phase, u, tuple(numbers[:n]), tuple(numbers[n:]))
        (found,) = (
            case.oscillator()
            .simulate(orbit.position, orbit.velocity, phase, 1, relative_velocity=u)
            .impacts
        )
        assert abs(found.time - period) < mpf(SAME) * period
        assert abs(found.relative_velocity - u) < mpf(SAME)
    return orbit


def settling(case: ExtremeCase, turns: int, impacts: int) -> History:
    """The first impacts of a case that comes to its periodic orbit, and those of the orbit after.

    Raises
    ------
    ArithmeticError
        When the case's own number of impacts does not lead to the orbit.
    """
    orbit, history = periodic_orbit(case, turns), case.simulate()
    with mp.workprec(BITS):
        last = history.impacts[-1]
        found = (*last.position, *last.velocity, last.phase)
        exact = (*orbit.position, *orbit.velocity, orbit.phase)
        off = max(abs(a - b) for a, b in zip(found, exact, strict=True))
        if not off < mpf(SETTLED):
            raise ArithmeticError(f"{case.name}: {mpmath.nstr(off, 3)} off its orbit")
        more = range(1, impacts - len(history.impacts) + 1)
        history.impacts += [orbit.impact(last.time + i * orbit.period) for i in more]
    return history
