"""Verify many claimed first roots at once: doubles with proved margins, Arb where they fail.

For each case f > 0 is proved on (0, claim - d] by Bernstein bounds of Taylor cells, and one
crossing in [claim - d, claim + d] by a bound on f''. All rounding is covered by margins several
times larger than a forward analysis gives; cells they do not settle go to `first_root`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, factorial
from typing import Final, NamedTuple

import numpy as np
from flint import arb, arb_mat, ctx
from numpy.typing import ArrayLike, NDArray

from tests.reference.first_root import FirstRoot, cells, find_root, first_root
from tests.reference.oscillators import OscillatorSum, oscillators

Array = NDArray[np.float64]

TERMS: Final = 14
EPSILON: Final = 2.0**-52
CHUNK: Final = 1_000
ROUNDS: Final = 14
CLOSE: Final = 1e-6
"""A claim within this relative distance of the true first root claims that root."""

_FACTORIALS: Final = np.array([float(factorial(i)) for i in range(TERMS + 1)])


def _bernstein_matrix(degree: int) -> Array:
    rows = range(degree + 1)
    return np.array([[comb(k, i) / comb(degree, i) if i <= k else 0.0 for k in rows] for i in rows])


_BERNSTEIN: Final = {degree: _bernstein_matrix(degree) for degree in range(TERMS)}


@dataclass(frozen=True)
class Verification:
    """Verdict on every claim.

    right : (m,)
        The claim is the first root (or there is none, as claimed): same kind, nothing before it.
    error_ulp : (m,)
        (claim - true root) in units in the last place of the claim; NaN without a root.
    error_scaled : (m,)
        (claim - true root) |f'| / (2^-52 sum of amplitudes): the error in units of the rounding
        of f. At a grazing impact this stays of order one where ``error_ulp`` cannot.
    counterexamples
        What is proved instead, by index, for the claims that are not right.
    by_intervals
        Number of cases that needed interval arithmetic.
    """

    right: NDArray[np.bool_]
    error_ulp: Array
    error_scaled: Array
    counterexamples: dict[int, FirstRoot]
    by_intervals: int


class _Cases(NamedTuple):
    """Checked input: m cases of n oscillators; w and sigma (1, n) where all have the same."""

    offset: Array
    value: Array
    rate: Array
    w: Array
    sigma: Array
    leading: Array
    zero_order: int

    def take(self, rows: NDArray[np.intp]) -> _Cases:
        return _Cases(
            self.offset[rows],
            self.value[rows],
            self.rate[rows],
            self.w if len(self.w) == 1 else self.w[rows],
            self.sigma if len(self.sigma) == 1 else self.sigma[rows],
            self.leading[rows],
            self.zero_order,
        )

    def own(self, i: int) -> list[list[float]]:
        """Values, rates, frequencies and decays of a case."""
        return [x[min(i, len(x) - 1)].tolist() for x in self[1:5]]

    def single(self, i: int) -> OscillatorSum:
        value, rate, w, sigma = self.own(i)
        leading = self.leading[i].tolist()
        return OscillatorSum(float(self.offset[i]), value, rate, w, sigma, leading)

    def height_and_slope(self, i: int, at: arb) -> list[arb]:
        """f and f' of a case at a time."""
        if self.leading.size:
            return self.single(i).derivatives(at, 2)
        value, rate, w, sigma = self.own(i)
        rows = oscillators(w, sigma).flow(at)
        n = len(rows)
        columns = [x for a, _, c, _ in rows for x in (a, c)]
        columns += [x for _, b, _, d in rows for x in (b, d)]
        start = arb_mat(1, 2 * n, value + rate)
        height, slope = (start * arb_mat(2 * n, 2, columns)).entries()
        return [height + float(self.offset[i]), slope]

    def scale(self, i: int) -> float:
        """As `OscillatorSum.scale`."""
        if self.leading.size:
            return self.single(i).scale()
        v, r, w, _ = map(np.array, self.own(i))
        own = np.where(w > 0.0, np.hypot(v, r / np.where(w > 0.0, w, 1.0)), abs(v) + abs(r))
        return float(abs(self.offset[i]) + own.sum())


def verify_first_root(
    claim: ArrayLike,
    offset: ArrayLike,
    value: ArrayLike,
    rate: ArrayLike,
    w: ArrayLike,
    sigma: ArrayLike,
    *,
    horizon: ArrayLike,
    leading: ArrayLike | None = None,
) -> Verification:
    """Prove or refute m claimed first roots; terms as in `first_root`.

    Parameters
    ----------
    claim, offset, horizon : (m,)
        Claimed first root in (0, horizon], or inf for "none up to the horizon".
    value, rate, w, sigma : (m, n) or (n,)
        The oscillators of each case.
    leading : (m, p), optional
        Exact f(0), f'(0), ... of each case. The number of leading zeros is the same in all.
    """
    times = np.atleast_1d(np.asarray(claim, dtype=float))
    cases = _checked(times.size, offset, value, rate, w, sigma, leading)
    limit = np.broadcast_to(np.asarray(horizon, dtype=float), times.shape)
    has_root = np.isfinite(times)
    settled = np.zeros(times.size, dtype=bool)
    usable = has_root & (times > 0)
    short = usable & (cases.zero_order > 0) & (times * _speed(cases) < 0.5)
    brief, long = np.flatnonzero(short), np.flatnonzero(usable & ~short)
    settled[brief] = _short_flight_proved(cases.take(brief), times[brief])
    reach, window = _window(cases.take(long), times[long])
    alone = ~has_root
    alone[long] = window
    free = limit.copy()
    free[long] = np.where(window, times[long] - reach, limit[long])

    candidates = np.flatnonzero(~settled & (free > 0))
    unproved = check_no_root_before(cases.take(candidates), free[candidates])
    settled[candidates] = alone[candidates] & np.array([not x for x in unproved], dtype=bool)
    known = zip(candidates.tolist(), unproved, free[candidates].tolist(), strict=True)
    rest = {i: (cells, end) for i, cells, end in known}
    return _verdict(cases, times, limit, settled, rest)


def check_no_root_before(cases: _Cases, end: Array) -> list[list[tuple[float, float]]]:
    """The cells of (0, end], in order, on which f > 0 is not proved here, case by case."""
    proved = np.ones(end.size, dtype=bool)
    unproved: list[list[tuple[float, float]]] = [[] for _ in range(end.size)]

    def give_up(case: NDArray[np.intp], left: Array, right: Array) -> None:
        for i, low, high in zip(case.tolist(), left.tolist(), right.tolist(), strict=True):
            unproved[i].append((low, high))

    count = np.clip(np.ceil(end * _speed(cases) / 1.2), 1, 400).astype(np.intp)
    case = np.repeat(np.arange(end.size), count)
    place = np.arange(case.size) - np.repeat(np.cumsum(count) - count, count)
    left = end[case] * (place / count[case])
    right = np.where(place + 1 == count[case], end[case], end[case] * ((place + 1) / count[case]))
    for _ in range(ROUNDS):
        positive, hopeless = np.empty(case.size, dtype=bool), np.empty(case.size, dtype=bool)
        for i in range(0, case.size, CHUNK):
            part = slice(i, i + CHUNK)
            positive[part], hopeless[part] = _positive(
                cases.take(case[part]), left[part], right[part]
            )
        proved[case[hopeless]] = False
        lost, keep = ~positive & ~proved[case], ~positive & proved[case]
        give_up(case[lost], left[lost], right[lost])
        case, left, right = case[keep], left[keep], right[keep]
        if case.size == 0:
            break
        middle = left + 0.4871 * (right - left)
        case = np.concatenate((case, case))
        left, right = np.concatenate((left, middle)), np.concatenate((middle, right))
    give_up(case, left, right)
    return [_merged(cells) for cells in unproved]


def _merged(cells: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The same cells in order, neighbours as one."""
    found: list[tuple[float, float]] = []
    for left, right in sorted(cells):
        if found and found[-1][1] == left:
            left, _ = found.pop()
        found.append((left, right))
    return found


def _checked(
    count: int,
    offset: ArrayLike,
    value: ArrayLike,
    rate: ArrayLike,
    w: ArrayLike,
    sigma: ArrayLike,
    leading: ArrayLike | None,
) -> _Cases:
    def table(x: ArrayLike) -> Array:
        array = np.asarray(x, dtype=float)
        return np.broadcast_to(array, (count, array.shape[-1]))

    exact = np.empty((count, 0)) if leading is None else table(leading)
    zero = (exact == 0).all(axis=0)
    zero_order = int(zero.size if zero.all() else np.argmin(zero))
    if zero_order < exact.shape[1] and not (exact[:, zero_order] > 0).all():
        raise ValueError("the first non-zero leading derivative must be positive in every case")
    offsets = np.broadcast_to(np.asarray(offset, dtype=float), (count,))
    natural, decay = (np.atleast_2d(np.asarray(x, dtype=float)) for x in (w, sigma))
    return _Cases(offsets, table(value), table(rate), natural, decay, exact, zero_order)


def _speed(cases: _Cases) -> Array:
    """Rate of change of the fastest oscillator of each case; decayed stiff parts are split for."""
    return np.asarray(cases.w.max(axis=1), dtype=float)


class _Local(NamedTuple):
    """Value and rate of each oscillator at a time, with bounds on their rounding errors."""

    value: Array
    rate: Array
    value_error: Array
    rate_error: Array


def _states(cases: _Cases, s: Array) -> _Local:
    t = s[:, None]
    v, r, w, sigma = cases.value, cases.rate, cases.w, cases.sigma
    discriminant = (w - sigma) * (w + sigma)
    root = np.sqrt(np.abs(discriminant))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        decay = np.exp(-sigma * t)
        cosine, sine = decay * np.cos(root * t), decay * np.sin(root * t) / root
        top_cosine, top_sine = decay, decay * np.minimum(t, 1.0 / root)
        if (discriminant <= 0).any():
            slow = np.exp(-np.where(w > 0, w * w / (sigma + root), 0.0) * t)
            fast = np.exp(-(sigma + root) * t)
            over = discriminant < 0
            cosh = 0.5 * (slow + fast)
            sinh = -slow * np.expm1(-2.0 * root * t) / (2.0 * root)
            level = discriminant == 0
            cosine = np.where(over, cosh, np.where(level, decay, cosine))
            sine = np.where(over, sinh, np.where(level, decay * t, sine))
            top_cosine = np.where(over, cosh, top_cosine)
            top_sine = np.where(over, sinh, np.where(level, decay * t, top_sine))
    mixed, pull = r + sigma * v, sigma * r + w * w * v
    slack = EPSILON * (64.0 + 32.0 * (root + sigma) * t)
    heavy = np.abs(r) + sigma * np.abs(v), sigma * np.abs(r) + w * w * np.abs(v)
    return _Local(
        v * cosine + mixed * sine,
        r * cosine - pull * sine,
        slack * (np.abs(v) * top_cosine + heavy[0] * top_sine),
        slack * (np.abs(r) * top_cosine + heavy[1] * top_sine),
    )


def _positive(
    cases: _Cases, left: Array, right: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether f > 0 is proved on [left, right], a root at 0 divided out; where it cannot be."""
    terms, margin = _taylor(cases, left, right - left)
    order = cases.zero_order
    result = np.zeros(left.size, dtype=bool)
    for at_zero in (False, True) if order else (False,):
        rows = (left == 0) == at_zero if order else np.ones(left.size, dtype=bool)
        if rows.any():
            used = terms[rows][:, order if at_zero else 0 :]
            lowest = (used @ _BERNSTEIN[used.shape[1] - 1]).min(axis=1)
            result[rows] = lowest > margin[rows]
    return result, (terms[:, 0] <= 0) & (left > 0)


def _taylor(cases: _Cases, left: Array, width: Array) -> tuple[Array, Array]:
    """Taylor terms of f in (s - left) / width, and a bound on remainder and rounding."""
    local = _states(cases, left)
    w, damping = cases.w, 2.0 * cases.sigma
    w2, h = w * w, width[:, None]
    terms = np.empty((left.size, TERMS))
    z, dz = local.value, local.rate
    with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
        for j in range(TERMS):
            terms[:, j] = z.sum(axis=1) * (width**j / _FACTORIALS[j])
            z, dz = dz, -(damping * dz + w2 * z)
        steepest = np.sqrt(dz * dz + w2 * z * z)
        amplitude = np.minimum(np.where(w > 0, steepest / w, np.inf), np.abs(z) + h * steepest).sum(
            axis=1
        )
        remainder = amplitude * (width**TERMS / _FACTORIALS[TERMS])

        at_zero = (left == 0.0) & (cases.zero_order > 0)
        pace = np.maximum(w, damping)
        pace = np.where(at_zero[:, None], pace, np.maximum(pace, 1.0 / h))
        growth = 1.7 * pace * h
        error = (local.value_error + local.rate_error / np.maximum(pace, 1e-300)) * np.exp(growth)
        error *= np.where(at_zero[:, None], growth ** (cases.zero_order + 1), 1.0)
        terms[:, 0] += cases.offset
        rounding = error.sum(axis=1) + EPSILON * (4.0 * np.abs(cases.offset)) * ~at_zero
        correction = _correction(cases)
        for j in range(cases.leading.shape[1]):
            terms[at_zero, j] = cases.leading[at_zero, j] * width[at_zero] ** j / _FACTORIALS[j]
            rounding += np.where(
                at_zero, 0.0, correction[:, j] * (left + width) ** j / _FACTORIALS[j]
            )
        rounding += 64.0 * EPSILON * np.abs(terms).sum(axis=1)
        margin = 1.001 * remainder + rounding
    return terms, np.where(np.isfinite(margin), margin, np.inf)


def _correction(cases: _Cases) -> Array:
    """Bounds on the coefficients of the polynomial that makes the leading derivatives exact."""
    z, dz = cases.value, cases.rate
    top, dtop = np.abs(z), np.abs(dz)
    w2, damping = cases.w**2, 2.0 * cases.sigma
    result = np.empty_like(cases.leading)
    for j in range(cases.leading.shape[1]):
        constant = cases.offset if j == 0 else np.zeros_like(cases.offset)
        size = top.sum(axis=1) + np.abs(constant) + np.abs(cases.leading[:, j])
        result[:, j] = np.abs(z.sum(axis=1) + constant - cases.leading[:, j])
        result[:, j] += 64.0 * EPSILON * size
        z, dz = dz, -(damping * dz + w2 * z)
        top, dtop = dtop, damping * dtop + w2 * top
    return result


def _window(cases: _Cases, claim: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Half width around the claim on which f' < 0, and whether f crosses once in there."""
    if claim.size == 0:
        return claim, np.zeros(0, dtype=bool)
    before = 0.75 * claim
    local = _states(cases, before)
    w2 = cases.w**2
    second = -(2.0 * cases.sigma * local.rate + w2 * local.value)
    third = -(2.0 * cases.sigma * second + w2 * local.rate)
    with np.errstate(divide="ignore", invalid="ignore"):
        level = np.where(cases.w > 0, np.hypot(second, third / cases.w), np.abs(second))
    correction = _correction(cases)
    extra = np.zeros_like(claim)
    for j in range(1, correction.shape[1]):
        extra += correction[:, j] * claim ** (j - 1) / _FACTORIALS[j - 1]
    bend = 1.001 * level.sum(axis=1) + 1e-9 + correction[:, 2:].sum(axis=1)
    here = _states(cases, claim)
    sure = (
        -here.rate.sum(axis=1)
        - here.rate_error.sum(axis=1)
        - 64.0 * EPSILON * np.abs(here.rate).sum(axis=1)
    )
    sure -= extra
    reach = np.minimum(sure / (2.0 * bend), 0.2 * claim)
    usable = sure > 0
    reach = np.where(usable, reach, 0.0)
    for side, factor in ((claim - reach, 1.0), (claim + reach, -1.0)):
        terms, margin = _taylor(cases, np.maximum(side, 1e-300), 1e-9 * claim)
        usable &= factor * terms[:, 0] > margin + np.abs(terms[:, 1:]).sum(axis=1)
    return reach, usable


def _short_flight_proved(cases: _Cases, claim: Array) -> NDArray[np.bool_]:
    """Whether f / s^p falls on all of (0, 1.01 claim] and changes sign within 1% of the claim."""
    if claim.size == 0:
        return np.zeros(0, dtype=bool)
    order, zero = cases.zero_order, np.zeros_like(claim)
    terms, margin = _taylor(cases, zero, 1.01 * claim)
    used = terms[:, order:]
    slopes = used[:, 1:] * np.arange(1, used.shape[1])
    falling = (slopes @ _BERNSTEIN[slopes.shape[1] - 1]).max(axis=1) < -TERMS * margin
    negative = used.sum(axis=1) < -margin
    terms, margin = _taylor(cases, zero, 0.99 * claim)
    positive = terms[:, order:].sum(axis=1) > margin
    return np.asarray(falling & negative & positive, dtype=bool)


def _verdict(
    cases: _Cases,
    claim: Array,
    horizon: Array,
    settled: NDArray[np.bool_],
    rest: dict[int, tuple[list[tuple[float, float]], float]],
) -> Verification:
    """Measure the settled claims exactly and decide the others in interval arithmetic.

    Of some cases it is known on which cells up to where f is not proved positive: `rest`.
    """
    right = settled.copy()
    truth = np.full(claim.size, np.nan)
    error = np.full(claim.size, np.nan)
    scaled = np.full(claim.size, np.nan)
    counterexamples: dict[int, FirstRoot] = {}
    with ctx.workprec(160):
        for i in map(int, np.flatnonzero(settled & np.isfinite(claim))):
            height, slope = cases.height_and_slope(i, arb(float(claim[i])))
            error[i] = float((height / slope).mid())
            scaled[i] = error[i] * abs(float(slope.mid())) / (EPSILON * cases.scale(i))
            settled[i] = abs(error[i]) <= CLOSE * claim[i]
    with ctx.workprec(256):
        for i in map(int, np.flatnonzero(~settled)):
            total, end = cases.single(i), float(horizon[i])
            unproved, free = rest.get(i, ([], 0.0))
            beyond = cells(total, free, end) if free < end else []
            found = find_root(total, end, unproved + beyond)
            if found is None or not found.crosses:
                right[i] = found is None and not np.isfinite(claim[i])
            else:
                truth[i] = float(found.at.mid())
                right[i] = bool(abs(claim[i] - truth[i]) <= CLOSE * truth[i])
            if right[i] and found is not None:
                error[i] = float((arb(float(claim[i])) - found.at).mid())
                slope = total.derivatives(found.at, 2)[1]
                scaled[i] = error[i] * abs(float(slope.mid())) / (EPSILON * total.scale())
            if not right[i]:
                counterexamples[i] = first_root(
                    float(cases.offset[i]),
                    *cases.own(i),
                    horizon=float(horizon[i]),
                    leading=cases.leading[i].tolist(),
                )
    ulp = np.spacing(np.where(np.isfinite(claim), np.abs(claim), 1.0))
    return Verification(right, error / ulp, scaled, counterexamples, int((~settled).sum()))
