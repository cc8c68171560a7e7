"""Forced linear structures to hundreds of bits, by the exponential of one augmented matrix.

    M y'' + C y' + K y = B (sine, cosine, 1),   phase' = w
    z' = A z,   z = (y, y', sine, cosine, 1)

Rigid modes, resonance, over- and critical damping and defective matrices are nothing special to
exp(A t). Modes are used in bounds only, and a bound holds whichever modes it is written in.

What is proved: the bounds, in interval arithmetic, for the state that they are given. What is not:
that state is a midpoint; the radius of each step, about 2^-bits of the largest entry, is dropped.
Repeating a motion with more bits shows what that did to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Final, final

from flint import acb, acb_mat, arb, arb_mat, ctx

from tests.reference.mode_bounds import INFINITE, Bound, Floor, Modes, root, upper

JETS: Final = 24
"""Derivatives of a row that are kept."""


@final
class Row:
    """A quantity r z of a motion, with its derivatives r A^j z."""

    def __init__(self, motion: LinearMotion, row: arb_mat) -> None:
        n, self._motion = motion.size, motion
        rows = [row]
        for _ in range(JETS):
            rows.append((rows[-1] * motion.matrix).mid())
        self.jets = arb_mat([r.entries() for r in rows])
        self._two = arb_mat([r.entries() for r in rows[:2]])
        self.entries = row.entries()
        self.sine, self.cosine, self.constant = self.entries[2 * n :]
        self.harmonic = root(self.sine**2 + self.cosine**2)
        self.on_position = arb_mat(1, n, self.entries[:n])
        self.on_velocity = arb_mat(1, n, self.entries[n : 2 * n])
        self.has_velocity = any(x != 0 for x in self.on_velocity.entries())

    def derivatives(self, z: arb_mat) -> list[arb]:
        """f, f', f'', ..."""
        entries: list[arb] = (self.jets * z).mid().entries()
        return entries

    def value_and_rate(self, z: arb_mat) -> list[arb]:
        """f and f'."""
        entries: list[arb] = (self._two * z).mid().entries()
        return entries

    @cached_property
    def in_modes(self) -> list[list[arb]]:
        """The row on positions and on velocities, in the coordinates that bounds are written in."""
        shape = self._motion.modes.shape
        with ctx.workprec(self._motion.bits):
            return [(part * shape).entries() for part in (self.on_position, self.on_velocity)]

    @cached_property
    def weights(self) -> list[list[arb]]:
        """Upper bounds of the absolute values of `in_modes`."""
        return [[upper(x) for x in part] for part in self.in_modes]

    def structural(self, motion: LinearMotion, z: arb_mat, jets: Sequence[arb]) -> tuple[arb, arb]:
        """f and f' without the row's own sine and cosine."""
        sine, cosine = z[2 * motion.size, 0], z[2 * motion.size + 1, 0]
        harmonic = self.sine * sine + self.cosine * cosine
        rate = motion.frequency * (self.sine * cosine - self.cosine * sine)
        return jets[0] - harmonic, jets[1] - rate

    @staticmethod
    def size(row: Sequence[arb], z: arb_mat) -> arb:
        """Sum of the absolute terms of r z: what rounding is measured with."""
        return sum((upper(a * b) for a, b in zip(row, z.entries(), strict=True)), arb(0))


@final
class LinearMotion:
    """The motion, its exponentials, and bounds on rows of it.

    Parameters
    ----------
    mass, damping, stiffness : (n, n)
        Symmetric; positive definite, positive semi-definite, positive semi-definite. n may be 0.
    forcing : (n, 3)
        B, on sine, cosine and 1.
    frequency
        Of the phase.
    """

    def __init__(
        self, mass: arb_mat, damping: arb_mat, stiffness: arb_mat, forcing: arb_mat, frequency: arb
    ) -> None:
        n = mass.nrows()
        self.size, self.frequency, self.bits = n, frequency, ctx.prec
        self.mass, self.damping, self.stiffness, self.forcing = mass, damping, stiffness, forcing
        matrix = arb_mat(2 * n + 3, 2 * n + 3)
        if n:
            self.inverse_mass = mass.inv()
            parts = (stiffness, damping, forcing)
            rates = [(self.inverse_mass * part).mid() for part in parts]
            for i in range(n):
                matrix[i, n + i] = 1
                for j in range(n):
                    matrix[n + i, j], matrix[n + i, n + j] = -rates[0][i, j], -rates[1][i, j]
                for j in range(3):
                    matrix[n + i, 2 * n + j] = rates[2][i, j]
        matrix[2 * n, 2 * n + 1], matrix[2 * n + 1, 2 * n] = frequency, -frequency
        self.matrix = matrix
        self.forced = any(forcing[i, j] != 0 for i in range(n) for j in range(2))
        self._powers: list[arb_mat] = []
        self.fastest = self._fastest()
        # Below 2^lowest the Taylor series is short. Of large matrices powers are dearer than terms.
        self.lowest = -(20 if n <= 10 else 4) - _ceil_log2(self.fastest)

    def _fastest(self) -> arb:
        """About the spectral radius of A, whatever the units: a 64th root of a norm of A^64."""
        power = self.matrix
        for _ in range(6):
            power = (power * power).mid()
        norm = max(sum((upper(x) for x in row), arb(0)) for row in power.table())
        return upper(norm.root(64)) + self.frequency

    # --- motion -----------------------------------------------------------------------------------

    def move(self, z: arb_mat, duration: arb) -> arb_mat:
        """exp(A duration) z for an exact duration >= 0."""
        mantissa, exponent = (int(x) for x in duration.man_exp())
        shift = exponent - self.lowest
        steps = mantissa << shift if shift >= 0 else mantissa >> -shift
        rest = duration - arb((steps, self.lowest))
        k = 0
        while steps >> k:
            if steps >> k & 1:
                z = (self._power(k) * z).mid()
            k += 1
        return z if rest == 0 else self._series(z, rest)

    def short(self, duration: arb) -> arb:
        """The duration, rounded down to a few bits where many bits would be dear."""
        duration = duration.lower().mid()
        mantissa, exponent = (int(x) for x in duration.man_exp())
        bits = mantissa.bit_length()
        if bits + exponent <= self.lowest or bits <= 4:
            return duration
        return arb((mantissa >> (bits - 4), exponent + bits - 4))

    def _power(self, k: int) -> arb_mat:
        """exp(A 2^(lowest + k))."""
        if not self._powers:
            self._powers.append((self.matrix * arb((1, self.lowest))).exp().mid())
        while len(self._powers) <= k:
            last = self._powers[-1]
            self._powers.append((last * last).mid())
        return self._powers[k]

    def _series(self, z: arb_mat, duration: arb) -> arb_mat:
        total, term, small = z, z, 0
        step = self.matrix * duration
        # No term is that small before the powers of the fastest rate are.
        size, power, least = upper(self.fastest * duration), arb(1), arb((1, -ctx.prec - 8))
        for j in range(1, 10 * ctx.prec):
            term = step * term / j
            total += term
            power *= size / j
            if power > least:
                continue
            pairs = zip(term.entries(), total.entries(), strict=True)
            # Two in a row: a position moves by every other term.
            small = small + 1 if all(_negligible(a, b) for a, b in pairs) else 0
            if small == 4:
                return total.mid()
        raise ArithmeticError("Taylor series does not end")

    def rate(self, z: arb_mat) -> arb_mat:
        """A z."""
        return (self.matrix * z).mid()

    # --- bounds -----------------------------------------------------------------------------------

    @cached_property
    def modes(self) -> Modes:
        """What bounds are written in."""
        with ctx.workprec(self.bits):
            return Modes(self)

    def bounds(self, row: Row, z: arb_mat, order: int) -> list[Bound]:
        """Bounds (order >= 2) on derivative ``order`` of the structural part of r z."""
        if self.size == 0:
            return [Bound(arb(0), INFINITE)]
        return self.modes.bounds(row, self._derivatives(row, z, order)[order - 1 :])

    def floors(self, row: Row, z: arb_mat, value: arb, rate: arb) -> list[Floor]:
        """Floors of the structural part of r z, from its value and rate."""
        if self.size == 0:
            return [Floor(value, rate, arb(0), INFINITE, True)]
        return self.modes.floors(row, self._derivatives(row, z, 2), value, rate)

    def _derivatives(self, row: Row, z: arb_mat, order: int) -> list[tuple[arb_mat, int]]:
        """Derivatives of z with their orders, one more where the row takes velocities."""
        states = [(z, 0)]
        for i in range(1, order + row.has_velocity):
            z = self.rate(z)
            states.append((z, i))
        return states

    def lowest_ever(self, row: Row, z: arb_mat) -> arb:
        """A number below r z at all later times; minus infinity where none is known.

        It is lower by more than rounding can lift what it is the difference of. All times are 1e40
        units: couplings of the modes below 1e-40 of their rates count as none.
        """
        n, w = self.size, self.frequency
        harmonic = acb(row.sine, row.cosine)
        level = row.constant
        rounding = arb((1, -ctx.prec // 2))
        if n == 0:
            swing = abs(harmonic)
            return (level - swing - rounding * (upper(level) + swing)).lower()
        columns = [[self.forcing[i, j] for i in range(n)] for j in range(3)]
        response, rest = acb_mat(n, 1), arb_mat(n, 1)
        try:
            if self.forced:
                dynamic = acb_mat(self.stiffness) - acb_mat(self.mass) * (w * w)
                dynamic += acb_mat(self.damping) * acb(0, w)
                force = [acb(a, b) for a, b in zip(columns[0], columns[1], strict=True)]
                response = dynamic.solve(acb_mat(n, 1, force))
            if any(x != 0 for x in columns[2]):
                rest = self.stiffness.solve(arb_mat(n, 1, columns[2]))
        except ZeroDivisionError:
            return -INFINITE
        sine, cosine = z[2 * n, 0], z[2 * n + 1, 0]
        free = arb_mat(2 * n, 1)
        for i in range(n):
            x = response[i, 0]
            v = x * acb(0, w)
            free[i, 0] = z[i, 0] - rest[i, 0] - x.real * sine - x.imag * cosine
            free[n + i, 0] = z[n + i, 0] - v.real * sine - v.imag * cosine
            harmonic += row.on_position[0, i] * x + row.on_velocity[0, i] * v
            level += row.on_position[0, i] * rest[i, 0]
        parts = level, -abs(harmonic), self.modes.lowest_free(row, free)
        size = sum((upper(x) for x in parts), Row.size(row.entries, z))
        lowest = (sum(parts, arb(0)) - rounding * size).lower()
        return lowest if lowest.is_finite() else -INFINITE


def _negligible(term: arb, total: arb) -> bool:
    return bool(upper(term) <= upper(total) * arb((1, -ctx.prec - 8)))


def _ceil_log2(x: arb) -> int:
    mantissa, exponent = (int(y) for y in x.upper().man_exp())
    return mantissa.bit_length() + exponent
