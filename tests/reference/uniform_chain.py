"""Long chains of equal masses and springs to 50 digits: their modes are sines in closed form.

With w_k = 2 sqrt(k/m) sin(angle_k / 2) the free chain of N masses has the shapes sin(i angle_k),
angle_k = (2k - 1) pi / (2N + 1), and the chain of n = N - 1 masses held at both ends has
angle_k = k pi / (n + 1).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import mpmath
from mpmath import mp, mpf

from tests.reference.impact_chain import (
    DIGITS,
    GUARD,
    Matrix,
    Real,
    ReferenceChain,
    _Modes,
)


@final
class _Sines:
    """The matrix factor sin(pi i odd(k) / half), or its transpose, without its entries."""

    def __init__(
        self, n: int, half: int, step: Callable[[int], int], factor: Real, *, turned: bool = False
    ) -> None:
        self.n, self.step, self.factor, self.turned = n, step, factor, turned
        self.period = 2 * half
        self.table = [factor * mpmath.sinpi(mpf(j) / half) for j in range(self.period)]

    def __getitem__(self, place: tuple[int, int]) -> Real:
        i, k = reversed(place) if self.turned else place
        return self.table[(i + 1) * self.step(k + 1) % self.period]

    def __mul__(self, vector: Matrix) -> Matrix:
        entries = list(vector)
        return mpmath.matrix(
            [mp.fdot((self[i, k], entries[k]) for k in range(self.n)) for i in range(self.n)]
        )


class UniformChain(ReferenceChain):
    """A chain of ``count`` equal masses and springs; parameters as for `ReferenceChain`."""

    def __init__(
        self,
        count: int,
        *,
        mass: float = 1.0,
        spring: float = 1.0,
        damping: float = 0.1,
        restitution: float = 0.85,
        amplitude: float = 0.1,
        offset: float = 0.0,
        frequency: float = 0.87,
        stick_below: float = 1e-23,
    ) -> None:
        with mp.workdps(DIGITS + GUARD):
            self.masses, self.springs = [mpf(mass)] * count, [mpf(spring)] * count
            self.damping, self.restitution = mpf(damping), mpf(restitution)
            self.amplitude, self.offset = mpf(amplitude), mpf(offset)
            self.frequency, self.stick_below = mpf(frequency), mpf(stick_below)
            self.free = self._sines(count, 2 * count + 1, lambda k: 2 * k - 1)
            self.held = self._sines(count - 1, count, lambda k: k)

    def _sines(self, n: int, half: int, step: Callable[[int], int]) -> _Modes:
        """Modes sin(i step(k) pi / half), whose squares sum up to half / 4 or, held, half / 2."""
        m, k = self.masses[0], self.springs[0]
        squares = [4 * k / m * mpmath.sinpi(mpf(step(j + 1)) / (2 * half)) ** 2 for j in range(n)]
        norm = mpmath.sqrt((mpf(4) if half == 2 * n + 1 else mpf(2)) / half / m)
        return _Modes(
            [mpmath.sqrt(x) for x in squares],
            [self.damping * x / 2 for x in squares],
            _Sines(n, half, step, norm),
            _Sines(n, half, step, norm * m, turned=True),
        )
