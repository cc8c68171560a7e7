"""A sum of damped oscillators in interval arithmetic (Arb), with proved bounds on every cell.

    f(s) = sum_j p_j s^j / j! + sum_k y_k(s),      y_k'' + 2 sigma_k y_k' + w_k^2 y_k = 0

The bound on a cell rests on one fact: every derivative z of y_k solves the same equation, and for
sigma_k >= 0 its energy (z'^2 + w^2 z^2) / 2 never grows. So the value at the left end bounds the
Taylor remainder on the whole cell, whatever the damping ratio.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import comb
from typing import Final, final

from flint import arb, arb_mat, ctx, fmpq

ORDER: Final = 16
"""Number of Taylor terms on a cell; the remainder is of this order."""

PRECISION: Final = 256
"""Working precision in bits; about 77 digits."""

Number = float | int | arb


@lru_cache(maxsize=64)
def _bernstein(degree: int, precision: int) -> arb_mat:
    """Weights that turn power coefficients on [0, 1] into Bernstein coefficients."""
    with ctx.workprec(precision):
        return arb_mat(
            degree + 1,
            degree + 1,
            [
                arb(fmpq(comb(k, i), comb(degree, i)))
                for k in range(degree + 1)
                for i in range(degree + 1)
            ],
        )


def _discriminant_sign(w: arb, sigma: arb) -> int:
    """Sign of w^2 - sigma^2; comparisons of exact balls are exact."""
    if w > sigma:
        return 1
    if w < sigma:
        return -1
    if not (w.is_exact() and sigma.is_exact()):
        raise ValueError(f"cannot tell w = {w} from sigma = {sigma} at {ctx.prec} bits")
    return 0


@final
class Oscillators:
    """What follows from frequencies and decays alone."""

    def __init__(self, w: Sequence[arb], sigma: Sequence[arb]) -> None:
        self.w, self.sigma = w, sigma
        self.w2 = [x * x for x in self.w]
        self.sign = [_discriminant_sign(a, b) for a, b in zip(self.w, self.sigma, strict=True)]
        self.root_discriminant = [
            ((a - b) * (a + b) * s).sqrt() if s else arb(0)
            for a, b, s in zip(self.w, self.sigma, self.sign, strict=True)
        ]
        self._weights: dict[int, tuple[arb_mat, list[tuple[arb, ...]]]] = {}

    def flow(self, s: arb) -> list[tuple[arb, arb, arb, arb]]:
        """Value and rate at s by those at 0, of each oscillator: y = a v + b r, y' = c v + d r."""
        rows = []
        for w2, sigma, root, sign in zip(
            self.w2, self.sigma, self.root_discriminant, self.sign, strict=True
        ):
            if sign > 0:
                sine, cosine = (root * s).sin_cos()
                sine /= root
            elif sign < 0:
                sine, cosine = (root * s).sinh_cosh()
                sine /= root
            else:
                sine, cosine = s, arb(1)
            if sigma == 0:
                rows.append((cosine, sine, -w2 * sine, cosine))
                continue
            decay = (-sigma * s).exp()
            sine, cosine = sine * decay, cosine * decay
            part = sigma * sine
            rows.append((cosine + part, sine, -w2 * sine, cosine - part))
        return rows

    def weights(self, count: int) -> tuple[arb_mat, list[tuple[arb, ...]]]:
        """Weights of values and rates in derivatives of the sum, and in further ones of each term.

        The matrix (2n, count) is that of the first ``count`` derivatives; values come first. Each
        term has four numbers for its derivatives of order count and count + 1.
        """
        if count not in self._weights:
            table, tail = [], []
            for starts in ((1, 0), (0, 1)):
                for w2, sigma in zip(self.w2, self.sigma, strict=True):
                    z, dz = (arb(x) for x in starts)
                    for _ in range(count):
                        table.append(z)
                        z, dz = dz, -(2 * sigma * dz + w2 * z)
                    tail.append((z, dz))
            n = len(self.w)
            matrix = arb_mat(2 * n, count, table)
            self._weights[count] = matrix, [tail[k] + tail[n + k] for k in range(n)]
        return self._weights[count]


@lru_cache(maxsize=64)
def _shared_oscillators(
    w: tuple[Number, ...], sigma: tuple[Number, ...], precision: int
) -> Oscillators:
    with ctx.workprec(precision):
        return Oscillators([arb(x) for x in w], [arb(x) for x in sigma])


def oscillators(w: Sequence[Number], sigma: Sequence[Number]) -> Oscillators:
    """Those of these frequencies and decays, made once for each precision."""
    # Only exact numbers can be told to be the same again.
    if any(isinstance(x, arb) and not x.is_exact() for part in (w, sigma) for x in part):
        return Oscillators([arb(x) for x in w], [arb(x) for x in sigma])
    return _shared_oscillators(tuple(w), tuple(sigma), ctx.prec)


@final
class OscillatorSum:
    """The sum, with ``leading`` derivatives at s = 0 that are known exactly.

    Parameters
    ----------
    offset, value, rate, w, sigma
        Constant term, and for each oscillator its value and rate at s = 0, natural frequency
        w >= 0 and decay sigma >= 0. Doubles are taken as the exact binary numbers they are.
    leading
        Exact values of f(0), f'(0), ...: a polynomial of degree ``len(leading) - 1`` is added so
        that f has them. Its leading zeros are the order of the root at s = 0.
    """

    def __init__(
        self,
        offset: Number,
        value: Sequence[Number],
        rate: Sequence[Number],
        w: Sequence[Number],
        sigma: Sequence[Number],
        leading: Sequence[Number] = (),
    ) -> None:
        self.value = [arb(x) for x in value]
        self.rate = [arb(x) for x in rate]
        self._oscillators = oscillators(w, sigma)
        self.w, self.sigma = self._oscillators.w, self._oscillators.sigma
        self.w2 = self._oscillators.w2
        self.polynomial = [arb(offset)]
        self.leading = [arb(x) for x in leading]
        self._known: dict[arb, tuple[list[arb], list[arb]]] = {}
        if self.leading:
            plain = self.derivatives(arb(0), len(self.leading), override=False)
            correction = [want - have for want, have in zip(self.leading, plain, strict=True)]
            correction[0] += arb(offset)
            self.polynomial = correction
        self.zero_order = 0
        while self.zero_order < len(self.leading) and self.leading[self.zero_order] == 0:
            self.zero_order += 1

    def states(self, s: arb) -> tuple[list[arb], list[arb]]:
        """Value and rate of every oscillator at s."""
        if s == 0:
            return list(self.value), list(self.rate)
        if s.is_exact() and s in self._known:
            return self._known[s]
        rows = zip(self._oscillators.flow(s), self.value, self.rate, strict=True)
        values, rates = [], []
        for (a, b, c, d), v, r in rows:
            values.append(a * v + b * r)
            rates.append(c * v + d * r)
        if s.is_exact():
            self._known[s] = values, rates
        return values, rates

    def derivatives(self, s: arb, count: int, *, override: bool = True) -> list[arb]:
        """f, f', ..., the first ``count`` derivatives at s."""
        values, rates = self.states(s)
        if count <= 2:
            totals = [sum(part, arb(0)) for part in (values, rates)[:count]]
        else:
            matrix, _ = self._oscillators.weights(count)
            totals = (arb_mat(1, 2 * len(values), values + rates) * matrix).entries()
        for j, x in enumerate(taylor_shift(self.polynomial, s)[:count]):
            totals[j] += x
        if override and s == 0:
            totals[: len(self.leading)] = self.leading[:count]
        return totals

    def evaluate(self, s: arb) -> arb:
        """f(s) as an enclosing ball."""
        values, _ = self.states(s)
        return sum(values, taylor_shift(self.polynomial, s)[0])

    def cell(self, left: float, right: float) -> Cell:
        """Proved bounds of f on [left, right]."""
        start = arb(left)
        width = arb(right) - start
        jet = self.derivatives(start, ORDER)
        bound = arb(0)
        _, weights = self._oscillators.weights(ORDER)
        for v, r, w2, (a, b, c, d) in zip(*self.states(start), self.w2, weights, strict=True):
            z, dz = (a * v + c * r).abs_upper(), (b * v + d * r).abs_upper()
            energy = dz * dz + w2 * z * z
            growth = z + width * energy.sqrt()
            bound += growth if w2 == 0 else (energy / w2).sqrt().min(growth).abs_upper()
        return Cell(left, right, jet, bound, self.zero_order if left == 0 else 0)

    def derivative_from(self, s: arb, factor: int = 1) -> OscillatorSum:
        """The function t -> factor * f'(s + t)."""
        values, rates = self.states(s)
        second = [
            -(2 * sigma * dz + w2 * z)
            for z, dz, sigma, w2 in zip(values, rates, self.sigma, self.w2, strict=True)
        ]
        shifted = OscillatorSum(
            0, [factor * x for x in rates], [factor * x for x in second], self.w, self.sigma
        )
        polynomial = [factor * x for x in taylor_shift(self.polynomial, s)[1:]]
        shifted.polynomial = polynomial or [arb(0)]
        return shifted

    def scale(self) -> float:
        """Sum of the amplitudes at s = 0: the size that rounding errors are measured with."""
        total = sum(abs(float(x)) for x in self.polynomial[:1])
        for k in range(len(self.w)):
            v, r, w = float(self.value[k]), float(self.rate[k]), float(self.w[k])
            total += (v * v + (r / w) ** 2) ** 0.5 if w else abs(v) + abs(r)
        return total

    def fastest(self) -> float:
        """Largest rate of change of any oscillator, 0.0 where there is none."""
        return max((float(abs(x)) for x in self.w), default=0.0)


def taylor_shift(derivatives: Sequence[arb], s: arb) -> list[arb]:
    """Derivatives at s of the polynomial that has these derivatives at 0."""
    if len(derivatives) == 1 or s == 0:
        return list(derivatives)
    result = list(derivatives)
    for j in range(len(result) - 1):
        term = arb(1)
        for i in range(j + 1, len(derivatives)):
            term = term * s / (i - j)
            result[j] += derivatives[i] * term
    return result


@final
class Cell:
    """f on [left, right] as a Taylor polynomial and a bound on its remainder."""

    def __init__(
        self, left: float, right: float, jet: list[arb], bound: arb, zero_order: int
    ) -> None:
        self.left, self.right = left, right
        self.jet = jet
        self.zero_order = zero_order
        width = arb(right) - arb(left)
        self._powers = [arb(1)]
        for i in range(ORDER):
            self._powers.append(self._powers[-1] * width / (i + 1))
        self._bound = bound

    def _coefficients(self, order: int) -> tuple[list[arb], arb]:
        """Bernstein-ready power coefficients of f^(order), the root at 0 divided out."""
        terms = [a * b for a, b in zip(self.jet[order:], self._powers, strict=False)]
        remainder = self._bound * self._powers[ORDER - order]
        return terms[max(self.zero_order - order, 0) :], remainder.upper()

    def sign(self, order: int = 0) -> int:
        """+1 or -1 where f^(order), its root at 0 divided out, is proved to keep it; else 0."""
        terms, remainder = self._coefficients(order)
        first = terms[0]
        if first > remainder:
            return int(all(x > remainder for x in _bernstein_coefficients(terms)))
        if first < -remainder:
            return -int(all(x < -remainder for x in _bernstein_coefficients(terms)))
        return 0

    def lower_bound(self) -> arb:
        """A number that f does not fall below on the cell."""
        zero_order, self.zero_order = self.zero_order, 0
        terms, remainder = self._coefficients(0)
        self.zero_order = zero_order
        lowest, *others = _bernstein_coefficients(terms)
        for other in others:
            lowest = lowest.min(other)
        return (lowest - remainder).lower()


def _bernstein_coefficients(terms: list[arb]) -> list[arb]:
    """Of the polynomial with these power coefficients on [0, 1]."""
    count = len(terms)
    found: list[arb] = (_bernstein(count - 1, ctx.prec) * arb_mat(count, 1, terms)).entries()
    return found
