"""Roots of exponential sums against 50 digits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mpmath
import numpy as np
from mpmath import mp, mpf

from dynkit import ExponentialSum
from dynkit.exponential.sums import RootKind

CASES, DIGITS = 4000, 50


def times_of_roots(every: int) -> Iterator[tuple[float, float]]:
    """Distance of a root, or of a minimum that touches, from the exact one nearby.

    Half of the sums are lifted so that their lowest minimum is near zero.
    """
    for number in range(0, CASES, every):
        random = np.random.default_rng(number)
        n = int(random.integers(1, 7))
        value, rate = random.normal(size=(2, n))
        frequency = 10.0 ** random.uniform(-1.0, 1.5, n)
        decay = frequency * random.choice([0.0, 1e-3, 0.1, 0.99, 1.0, 3.0], n)
        offset = 0.1 + float(abs(value).sum()) * float(random.uniform(-1.0, 1.0))
        if value.sum() + offset <= 0.0:
            offset = 0.1 - float(value.sum())
        whole = ExponentialSum(value, rate, frequency, decay, offset)
        if number % 2:
            offset = _lifted(whole, float(10.0 ** random.uniform(-16.0, -2.0)))
            if value.sum() + offset <= 0.0:
                continue
            whole = ExponentialSum(value, rate, frequency, decay, offset)
        found = whole.first_root(limit=20_000)
        if found.kind in (RootKind.ROOT, RootKind.TOUCH):
            yield _distance(whole, found.time, touches=found.kind is RootKind.TOUCH), found.error


def _lifted(whole: ExponentialSum, depth: float) -> float:
    """The offset with which the lowest sampled minimum is so deep, but for the sampling."""
    s = np.linspace(0.0, 20.0, 4001)
    at = s[int(np.argmin(_sampled(whole, s)))]
    with mp.workdps(DIGITS):
        for _ in range(8):
            _, slope, second = _jets(whole, mpf(at))
            if not second > 0 or abs(slope / second) > 0.1:
                break
            at -= float(slope / second)
        lowest = _jets(whole, mpf(max(at, 0.0)))[0] - mpf(whole.offset)
        return float(-lowest - mpf(depth))


def _sampled(whole: ExponentialSum, s: Any) -> Any:
    total = np.full(len(s), whole.offset)
    for y, v, w, d in zip(whole.value, whole.rate, whole.frequency, whole.decay, strict=True):
        root = np.sqrt(complex(w * w - d * d))
        one, other = (np.exp((sign * 1j * root - d) * s) for sign in (1.0, -1.0))
        sine = (one - other) / (2j * root) if root else s * one
        total += (0.5 * y * (one + other) + (v + d * y) * sine).real
    return total


def _jets(whole: ExponentialSum, s: Any) -> tuple[Any, Any, Any]:
    """f, f' and f''."""
    total = [mpf(whole.offset), mpf(0), mpf(0)]
    terms = (whole.value, whole.rate, whole.frequency, whole.decay)
    for numbers in zip(*(part.tolist() for part in terms), strict=True):
        y, v, w, d = map(mpf, numbers)
        square = w * w - d * d
        root = mpmath.sqrt(square)
        cosine = mpmath.cos(root * s)
        sine = mpmath.sin(root * s) / root if square != 0 else s
        fall = mpmath.exp(-d * s)
        b = v + d * y
        x = (fall * (y * cosine + b * sine)).real
        dx = (fall * (b * cosine - square * y * sine)).real - d * x
        total = [total[0] + x, total[1] + dx, total[2] - 2 * d * dx - w * w * x]
    return total[0], total[1], total[2]


def _distance(whole: ExponentialSum, time: float, *, touches: bool) -> float:
    with mp.workdps(DIGITS):
        at = mpf(time)
        for _ in range(60):
            f, slope, second = _jets(whole, at)
            step = slope / second if touches else f / slope
            at -= step
            if abs(step) < mpf(10) ** -30:
                break
        return abs(float(at - mpf(time)))
