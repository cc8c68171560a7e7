"""Bounds on what a forced linear structure can do, in interval arithmetic, for any damping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeAlias, final

import mpmath
from flint import arb, arb_mat
from mpmath import mp, mpf

if TYPE_CHECKING:
    from tests.reference.linear_motion import LinearMotion, Row

MODE_DIGITS: Final = 80
FOR_EVER: Final = arb("1e40")
UNCOUPLED: Final = arb("1e-40")
INFINITE: Final = arb.pos_inf()

Real: TypeAlias = Any
"""An mpf: mpmath makes its number class at run time, which no type checker can name."""


def to_mpf(x: arb) -> Real:
    """The midpoint, exactly."""
    mantissa, exponent = x.mid().man_exp()
    with mp.workprec(max(64, int(mantissa).bit_length())):
        return mpmath.ldexp(mpf(int(mantissa)), int(exponent))


def upper(x: arb) -> arb:
    """An upper bound of |x|, exactly representable."""
    return x.abs_upper()


@dataclass(frozen=True)
class Bound:
    """``value`` bounds a derivative of the structural part of a row for the next ``window``."""

    value: arb
    window: arb


@final
class Modes:
    """Coordinates y = T q in which every bound is written; any invertible T is right.

    In them q'' + C^ q' + K^ q = F^, and w_k^2 = K^_kk (a small positive number for rigid modes).
    For n_k = hypot(w_k q_k, q_k')

        n_k' <= sum_j G_kj n_j + |F^_k|,   G_kj = |K^_kj| / w_j + |C^_kj|,
        G_kk = |K^_kk - w_k^2| / w_k + max(0, -C^_kk),

    and the same for every derivative of q, which obeys the same equation. Besides, the energy of
    the whole grows by the work of the forces at most. A damping that couples the modes makes the
    first bound short-lived, stiff modes make the second one weak.
    """

    def __init__(self, motion: LinearMotion) -> None:
        self.motion, n = motion, motion.size
        shape = _shapes(motion)
        self.shape = shape
        inverse = shape.inv()
        self.to_modal = arb_mat(2 * n, 2 * n + 3)
        for i in range(n):
            for j in range(n):
                self.to_modal[i, j] = self.to_modal[n + i, n + j] = inverse[i, j]
        parts = (motion.stiffness, motion.damping, motion.forcing)
        back = inverse * motion.inverse_mass
        stiff, damp = (back * part * shape for part in parts[:2])
        force = back * parts[2]
        squares = [stiff[k, k] for k in range(n)]
        top = max([upper(x) for x in squares])
        self.rigid = [bool(upper(x) <= top * UNCOUPLED) for x in squares]
        floor = (top * UNCOUPLED).sqrt() if top > 0 else arb("1e-20")
        self.w = [
            floor if rigid else upper(x).sqrt().lower()
            for x, rigid in zip(squares, self.rigid, strict=True)
        ]
        self.decay = [damp[k, k] for k in range(n)]
        growth = arb(0)
        self.coupled = False
        for k in range(n):
            total = upper(stiff[k, k] - self.w[k] ** 2) / self.w[k]
            total += (-damp[k, k]).max(arb(0)).upper()
            for j in range(n):
                if j != k:
                    entry = upper(stiff[k, j]) / self.w[j] + upper(damp[k, j])
                    scale = self.w[k] + self.w[j] + upper(damp[k, k]) + upper(damp[j, j])
                    self.coupled |= not entry < scale * UNCOUPLED
                    total += entry
            growth = growth.max(total.upper())
        self.growth = growth
        self.drive = [upper((force[k, 0] ** 2 + force[k, 1] ** 2).sqrt()) for k in range(n)]
        # Of the energy, and of the forces in the norm that goes with it.
        self.sound = all(x > -top * UNCOUPLED for x in squares)
        columns = [arb_mat(n, 1, [motion.forcing[i, j] for i in range(n)]) for j in range(2)]
        works = [(c.transpose() * motion.inverse_mass * c)[0, 0] for c in columns]
        self.work = upper(upper(works[0]).sqrt() + upper(works[1]).sqrt())

    def norms(self, z: arb_mat) -> list[arb]:
        """n_k of a state (2n + 3) or (2n)."""
        n = self.motion.size
        q = (self.to_modal * z).entries()
        return [upper(((self.w[k] * q[k]) ** 2 + q[n + k] ** 2).sqrt()) for k in range(n)]

    def energy_norm(self, z: arb_mat) -> arb:
        """Square root of twice the energy."""
        n = self.motion.size
        x, v = (arb_mat(n, 1, z.entries()[i : i + n]) for i in (0, n))
        twice = x.transpose() * self.motion.stiffness * x + v.transpose() * self.motion.mass * v
        return upper(upper(twice[0, 0]).sqrt())

    def bounds(self, row: Row, states: Sequence[tuple[arb_mat, int]]) -> list[Bound]:
        """From the derivatives (state, order) of the motion that follow a row's order.

        Growth by coupling counts with the fastest of the modes, so that short windows, in which
        there is next to none, are offered besides long ones.
        """
        motion, w = self.motion, self.motion.frequency
        later = (1 / w).lower() if motion.forced else INFINITE
        windows = [INFINITE]
        if self.growth > 0:
            windows = [(arb((1, -k)) / self.growth).lower() for k in (2, 20, 60)]
        windows = [x.min(later) for x in windows]
        grown = [(self.growth * x).expm1().upper() if self.growth > 0 else arb(0) for x in windows]
        totals, whole = [arb(0) for _ in windows], arb(0)
        for part, (z, order) in zip((row.on_position, row.on_velocity), states, strict=False):
            weights = [upper(x) for x in (part * self.shape).entries()]
            norms, speed = self.norms(z), w**order
            for i, window in enumerate(windows):
                now = norms
                if motion.forced:
                    share = window * speed
                    now = [upper(a + share * b) for a, b in zip(norms, self.drive, strict=True)]
                spread = grown[i] * max(now)
                totals[i] += sum((a * (b + spread) for a, b in zip(weights, now, strict=True)))
            if self.sound and self.coupled:
                dual = (part * motion.inverse_mass * part.transpose())[0, 0]
                energy = self.energy_norm(z)
                if motion.forced:
                    energy += later * speed * self.work
                whole += upper(upper(dual).sqrt()) * energy
        found = [Bound(x.upper(), y) for x, y in zip(totals, windows, strict=True)]
        if self.sound and self.coupled:
            found.append(Bound(whole.upper(), later))
        return found

    def lowest_free(self, row: Row, free: arb_mat) -> arb:
        """A number below r z for ever, where nothing forces the motion (x, v) (2n, 1)."""
        n = self.motion.size
        on_position = (row.on_position * self.shape).entries()
        on_velocity = (row.on_velocity * self.shape).entries()
        if self.coupled:
            return self._lowest_by_energy(row, free)
        norms = self.norms(_pad(free))
        q = (self.to_modal * _pad(free)).entries()
        total = arb(0)
        for k in range(n):
            a, b, rate, c = on_position[k], on_velocity[k], q[n + k], self.decay[k]
            if not self.rigid[k]:
                total -= ((a / self.w[k]) ** 2 + b**2).sqrt() * norms[k]
                continue
            total += a * q[k] - upper(b * rate)
            if c > 0:
                total += (a * rate / c).min(arb(0))
            elif not a * rate >= 0:
                total += a * rate * FOR_EVER
        return total

    def _lowest_by_energy(self, row: Row, free: arb_mat) -> arb:
        if not self.sound or any(self.rigid):
            return -INFINITE
        part = row.on_position
        square = (part * self.motion.stiffness.solve(part.transpose()))[0, 0]
        part = row.on_velocity
        square += (part * self.motion.inverse_mass * part.transpose())[0, 0]
        return -upper(upper(square).sqrt()) * self.energy_norm(_pad(free))


def _pad(free: arb_mat) -> arb_mat:
    return arb_mat(free.nrows() + 3, 1, free.entries() + [arb(0)] * 3)


def _shapes(motion: LinearMotion) -> arb_mat:
    """Modes of mass and stiffness to MODE_DIGITS."""
    n = motion.size
    with mp.workdps(MODE_DIGITS):
        mass, stiffness = (
            mpmath.matrix([[to_mpf(x) for x in row] for row in part.table()])
            for part in (motion.mass, motion.stiffness)
        )
        root = mpmath.cholesky(mass) ** -1
        _, vectors = mpmath.eigsy(root * stiffness * root.T)
        shape = root.T * vectors
        return arb_mat([[arb(shape[i, j]) for j in range(n)] for i in range(n)])
