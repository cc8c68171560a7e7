"""Bounds on what a forced linear structure can do, in interval arithmetic, for any damping."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias, final

import mpmath
from flint import arb, arb_mat
from mpmath import mp, mpf

if TYPE_CHECKING:
    from tests.reference.linear_motion import LinearMotion, Row

MODE_DIGITS: Final = 100
APART: Final = 30
"""Ratio of natural frequencies from which the faster modes are bounded on their own."""

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


def root(x: arb) -> arb:
    """An upper bound of the square root of x >= 0, whose ball may reach below 0."""
    return upper(upper(x).sqrt())


class Bound(NamedTuple):
    """``value`` bounds a derivative of the structural part of a row for the next ``window``."""

    value: arb
    window: arb


class Floor(NamedTuple):
    """f(s) >= value + rate s - curvature s^2 / 2 for 0 <= s < window.

    Where it is ``whole`` nothing is left out: f(s) <= value + rate s + curvature s^2 / 2 too.
    """

    value: arb
    rate: arb
    curvature: arb
    window: arb
    whole: bool


@final
class Modes:
    """Coordinates y = T q in which every bound is written; any invertible T is right.

    In them q'' + C^ q' + K^ q = F^, and w_k^2 = K^_kk (a small positive number for rigid modes).
    For n_k = hypot(w_k q_k, q_k')

        n_k' <= sum_j G_kj n_j + |F^_k|,   G_kj = |K^_kj| / w_j + |C^_kj|,
        G_kk = |K^_kk - w_k^2| / w_k + max(0, -C^_kk),

    and the same for every derivative of q, which obeys the same equation. The rate of an overdamped
    mode is also bounded by its two exponentials. Besides, the energy of the whole grows by the work
    of the forces at most. A damping that couples the modes makes the first bound short-lived, stiff
    modes make the second one weak.
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
        self.exponents = [_exponents(stiff[k, k], damp[k, k]) for k in range(n)]
        ascending = sorted(self.w)
        self.cuts = [
            [k for k in range(n) if self.w[k] >= b] for a, b in pairwise(ascending) if b > APART * a
        ]
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
        # How far bounds reach that grow with the forces.
        self.later = (1 / motion.frequency).lower() if motion.forced else INFINITE
        self.windows = self._windows()
        self.static = [force[k, 2] / stiff[k, k] if not self.rigid[k] else arb(0) for k in range(n)]
        self.drive = [root(force[k, 0] ** 2 + force[k, 1] ** 2) for k in range(n)]
        # Of the energy, and of the forces in the norm that goes with it.
        self.sound = all(x > -top * UNCOUPLED for x in squares) and _dissipates(motion.damping)
        columns = [arb_mat(n, 1, [motion.forcing[i, j] for i in range(n)]) for j in range(2)]
        works = [(c.transpose() * motion.inverse_mass * c)[0, 0] for c in columns]
        self.work = upper(root(works[0]) + root(works[1]))

    def norms(self, q: Sequence[arb]) -> list[arb]:
        """n_k of q and q' (2n)."""
        n = self.motion.size
        return [root((self.w[k] * q[k]) ** 2 + q[n + k] ** 2) for k in range(n)]

    def sizes(self, z: arb_mat) -> tuple[list[arb], list[arb]]:
        """n_k of a state, and bounds on |q_k'| for ever, where nothing forces the modes."""
        n = self.motion.size
        q = (self.to_modal * z).entries()
        norms = self.norms(q)
        found = norms[:]
        for k, exponents in enumerate(self.exponents):
            if exponents is not None:
                slow, fast = exponents
                parts = (
                    upper((q[n + k] + fast * q[k]) * slow),
                    upper((q[n + k] + slow * q[k]) * fast),
                )
                found[k] = found[k].min((parts[0] + parts[1]) / (fast - slow)).upper()
        return norms, found

    def energy_norm(self, z: arb_mat) -> arb:
        """Square root of twice the energy."""
        n = self.motion.size
        x, v = (arb_mat(n, 1, z.entries()[i : i + n]) for i in (0, n))
        twice = x.transpose() * self.motion.stiffness * x + v.transpose() * self.motion.mass * v
        return root(twice[0, 0])

    def _windows(self) -> list[tuple[arb, arb]]:
        """Times, and by which part of the largest norm the coupling makes norms grow within them.

        Short windows, in which there is next to no growth, are offered besides long ones.
        """
        if self.growth == 0:
            return [(self.later, arb(0))]
        times = [(arb((1, -k)) / self.growth).min(self.later).lower() for k in (2, 20, 60)]
        return [(x, (self.growth * x).expm1().upper()) for x in times]

    def _grown(self, norms: list[arb], order: int, window: arb, growth: arb) -> list[arb]:
        """Bounds within a window, from those without coupling and forces."""
        if self.motion.forced:
            share = window * self.motion.frequency**order
            norms = [upper(a + share * b) for a, b in zip(norms, self.drive, strict=True)]
        spread = growth * max(norms)
        return [(a + spread).upper() for a in norms]

    def bounds(self, row: Row, states: Sequence[tuple[arb_mat, int]]) -> list[Bound]:
        """From the derivatives (state, order) of the motion that follow a row's order."""
        return self._all_bounds(row, states, self._speeds(states))

    def _all_bounds(
        self, row: Row, states: Sequence[tuple[arb_mat, int]], speeds: Sequence[list[list[arb]]]
    ) -> list[Bound]:
        found = self._bounds(row, speeds)
        if self.sound and self.coupled:
            parts = zip((row.on_position, row.on_velocity), states, strict=False)
            whole = sum((self._by_energy(part, *state) for part, state in parts), arb(0))
            found.append(Bound(whole.upper(), self.later))
        return found

    def _speeds(self, states: Sequence[tuple[arb_mat, int]]) -> list[list[list[arb]]]:
        """Bounds on |q_k'| of each state (state, order) within each window."""
        found = []
        for z, order in states:
            norms, rates = self.sizes(z)
            each = []
            for window, growth in self.windows:
                spread = max(self._grown(norms, order, window, growth)) * growth
                each.append([x + spread for x in self._grown(rates, order, window, arb(0))])
            found.append(each)
        return found

    def _bounds(
        self, row: Row, speeds: Sequence[list[list[arb]]], fast: Sequence[int] = ()
    ) -> list[Bound]:
        """Bounds by the modes, without the share of the ``fast`` ones."""
        slow = [k for k in range(self.motion.size) if k not in fast]
        found = []
        for i, (window, _) in enumerate(self.windows):
            total = arb(0)
            for weights, each in zip(row.weights, speeds, strict=False):
                total += sum((weights[k] * each[i][k] for k in slow), arb(0))
            found.append(Bound(total.upper(), window))
        return found

    def _by_energy(self, part: arb_mat, z: arb_mat, order: int) -> arb:
        dual = (part * self.motion.inverse_mass * part.transpose())[0, 0]
        energy = self.energy_norm(z)
        if self.motion.forced:
            energy += self.later * self.motion.frequency**order * self.work
        return root(dual) * energy

    def floors(
        self, row: Row, states: Sequence[tuple[arb_mat, int]], value: arb, rate: arb
    ) -> list[Floor]:
        """Floors of the structural part of a row, from the states (state, order) of orders 0, 1, 2.

        Where fast modes stand apart they are also taken at their worst, and left out of the
        curvature.
        """
        after = states[1:]
        speeds = self._speeds(after)
        bounds = self._all_bounds(row, after, speeds)
        found = [Floor(value, rate, *bound, True) for bound in bounds]
        if not self.cuts:
            return found
        n = self.motion.size
        q, dq = ((self.to_modal * z).entries() for z, _ in states[:2])
        offsets = q[:]
        for k in range(n):
            offsets[k] -= self.static[k]
        norms = [root((self.w[k] * offsets[k]) ** 2 + q[n + k] ** 2) for k in range(n)]
        for fast in self.cuts:
            apart, apart_rate, size = arb(0), arb(0), []
            for k in fast:
                a, b = row.in_modes[0][k], row.in_modes[1][k]
                apart += a * offsets[k] + b * q[n + k]
                apart_rate += a * dq[k] + b * dq[n + k]
                size.append(root((a / self.w[k]) ** 2 + b**2))
            bounds = self._bounds(row, speeds, fast)
            for bound, (window, growth) in zip(bounds, self.windows, strict=True):
                grown = self._grown(norms, 0, window, growth)
                worst = sum((a * grown[k] for a, k in zip(size, fast, strict=True)), arb(0))
                found.append(
                    Floor((value - apart - worst).lower(), rate - apart_rate, *bound, False)
                )
        return found

    def lowest_free(self, row: Row, free: arb_mat) -> arb:
        """A number below r z for ever, where nothing forces the motion (x, v) (2n, 1)."""
        n = self.motion.size
        if self.coupled:
            return self._lowest_by_energy(row, free)
        on_position, on_velocity = row.in_modes
        q = (self.to_modal * _pad(free)).entries()
        norms = self.norms(q)
        total = arb(0)
        for k in range(n):
            a, b, rate, c = on_position[k], on_velocity[k], q[n + k], self.decay[k]
            if not self.rigid[k]:
                total -= root((a / self.w[k]) ** 2 + b**2) * norms[k]
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
        return -root(square) * self.energy_norm(_pad(free))


def _exponents(square: arb, damping: arb) -> tuple[arb, arb] | None:
    """Decay rates, slow and fast, of an overdamped mode."""
    discriminant = damping**2 / 4 - square
    if not (discriminant > 0 and damping > 0):
        return None
    fast = damping / 2 + discriminant.sqrt()
    return square / fast, fast


def _pad(free: arb_mat) -> arb_mat:
    return arb_mat(free.nrows() + 3, 1, free.entries() + [arb(0)] * 3)


def _dissipates(damping: arb_mat) -> bool:
    """Whether no eigenvalue is negative, to 30 digits."""
    with mp.workdps(40):
        values = mpmath.eigsy(_to_matrix(damping), eigvals_only=True)
        return bool(min(values) >= -mpf("1e-30") * max(abs(x) for x in values))


def _to_matrix(part: arb_mat) -> Real:
    return mpmath.matrix([[to_mpf(x) for x in row] for row in part.table()])


def _shapes(motion: LinearMotion) -> arb_mat:
    """Modes of mass and stiffness to MODE_DIGITS."""
    n = motion.size
    with mp.workdps(MODE_DIGITS):
        mass, stiffness = _to_matrix(motion.mass), _to_matrix(motion.stiffness)
        root = mpmath.cholesky(mass) ** -1
        _, vectors = mpmath.eigsy(root * stiffness * root.T)
        shape = root.T * vectors
        return arb_mat([[arb(shape[i, j]) for j in range(n)] for i in range(n)])
