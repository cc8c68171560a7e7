"""The certified first root against interval arithmetic, on many random and near-grazing states."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

from dynkit.exponential.sums import ExponentialSum, RootKind
from tests.effort import some
from tests.exponential.cases import Found, Group, chain_like, find, random_group
from tests.reference.verify import Verification, verify_first_root

Array = NDArray[np.float64]

HORIZON = 40.0
"""Claims are checked up to this time, or up to where the search went if that is less."""

ROUNDING, LAST_PLACES = 8.0, 1.0
"""Largest error of a root: in units of the rounding of f over its slope, or in ulp of the time."""


def verify(group: Group, found: Found, slopes: Array | None = None) -> tuple[Array, Verification]:
    # Beyond a claimed root, so that a root found an ulp late still counts.
    searched = np.where(np.isfinite(found.time), HORIZON, found.searched)
    horizon = np.minimum(searched, HORIZON)
    claim = np.where(found.time <= horizon, found.time, np.inf)
    leading = None if slopes is None else np.stack([np.zeros_like(slopes), slopes], axis=1)
    verdict = verify_first_root(
        claim,
        group.offset,
        group.value,
        group.rate,
        group.frequency,
        group.decay,
        horizon=horizon,
        leading=leading,
    )
    return claim, verdict


def lowest_minimum(group: Group) -> Array:
    """Smallest local minimum of every case on (0, HORIZON / 2], by fine sampling and parabolas."""
    s = np.linspace(0.0, HORIZON, 801)
    w, sigma = group.frequency, group.decay
    damped = np.sqrt(w**2 - sigma**2)
    decay = np.exp(-sigma * s[:, None])
    cosine, sine = decay * np.cos(damped * s[:, None]), decay * np.sin(damped * s[:, None]) / damped
    b = group.rate + sigma * group.value
    f = group.value @ cosine.T + b @ sine.T
    slope = group.value @ (-sigma * cosine - damped**2 * sine).T + b @ (cosine - sigma * sine).T
    lowest = np.empty(len(f))
    for i in range(len(f)):
        dips = np.flatnonzero((slope[i, :-1] < 0.0) & (slope[i, 1:] >= 0.0))
        k = int(dips[np.argmin(np.minimum(f[i, dips], f[i, dips + 1]))]) if dips.size else 0
        at = s[k] + (s[1] - s[0]) * slope[i, k] / (slope[i, k] - slope[i, k + 1])
        for _ in range(6):  # Newton on the slope
            e = np.exp(-sigma * at)
            c, n = e * np.cos(damped * at), e * np.sin(damped * at) / damped
            y = group.value[i] * c + b[i] * n
            v = group.value[i] * (-sigma * c - damped**2 * n) + b[i] * (c - sigma * n)
            at -= v.sum() / (-(w**2) * y - 2.0 * sigma * v).sum()
        e = np.exp(-sigma * at)
        y = group.value[i] * e * np.cos(damped * at) + b[i] * e * np.sin(damped * at) / damped
        lowest[i] = y.sum()
    return lowest


@pytest.mark.parametrize("seed", some(range(20), 5))
def test_no_root_of_random_states_is_missed_or_invented(seed: int) -> None:
    """5000 states: the kind is right, nothing lies before the root."""
    rng = np.random.default_rng(seed)
    for modes in (10, 10, 10, 5, 2):
        group = random_group(rng, *chain_like(rng, modes), 1000)
        found = find(group, limit=2000)
        _, verdict = verify(group, found)
        assert verdict.right.all(), verdict.counterexamples
        error = np.fmin(abs(verdict.error_scaled) / ROUNDING, abs(verdict.error_ulp) / LAST_PLACES)
        assert np.nanmax(error) <= 1.0


@pytest.mark.parametrize("seed", range(8))
def test_first_root_after_a_start_from_zero(seed: int) -> None:
    """The root at the start is divided out, for slopes down to 1e-12."""
    rng = np.random.default_rng(100 + seed)
    frequency, decay = chain_like(rng, 10)
    group = random_group(rng, frequency, decay, 500)
    # Consistent with f(0) = 0 and f'(0) = slope to rounding: the slowest term takes the rest.
    slopes = 10.0 ** rng.uniform(-12.0, -1.0, 500)
    value, rate = group.value.copy(), group.rate.copy()
    value[:, 0] -= value.sum(axis=1)
    rate[:, 0] += slopes - rate.sum(axis=1)
    group = Group(frequency, decay, value, rate, np.zeros(500))
    found = find(group, slopes=slopes, limit=2000)
    _, verdict = verify(group, found, slopes)
    assert verdict.right.all(), verdict.counterexamples


@pytest.mark.parametrize("seed", some(range(10), 5))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_grazing_states_are_decided_outside_the_rounding_band(seed: int, sign: float) -> None:
    """500 states whose lowest minimum is 1e-3 to 1e-15 above zero, or below."""
    rng = np.random.default_rng(1000 + seed)
    frequency, decay = chain_like(rng, 10)
    group = random_group(rng, frequency, decay, 500)
    depth = sign * 10.0 ** rng.uniform(-15.0, -3.0, 500)
    offset = depth - lowest_minimum(group)
    group = Group(frequency, decay, group.value, group.rate, offset)
    starts = group.value.sum(axis=1) + offset > 1e-9
    group = Group(frequency, decay, group.value[starts], group.rate[starts], group.offset[starts])
    found = find(group, limit=2000)
    claim, verdict = verify(group, found)
    assert np.isfinite(claim).mean() > (0.9 if sign < 0.0 else 0.0)
    for i in np.flatnonzero(~verdict.right):
        proved = verdict.counterexamples[int(i)]
        # A touch within the band may be called a root, a crossing within the band may be passed:
        # `minimum` is the lowest point before the proved root, `depth` the one after it.
        lowest = [float(y.mid()) for y in (proved.minimum, proved.depth) if y is not None]
        shallow = min(map(abs, lowest))
        assert shallow <= 2.0 * found.band[i], (i, claim[i], found.band[i], proved)


@pytest.mark.plain
def test_a_touch_is_reported_as_such() -> None:
    root = ExponentialSum([1.0], [0.0], [1.0], [0.0], offset=1.0).first_root()
    assert root.kind is RootKind.TOUCH
    assert root.time == pytest.approx(math.pi, rel=1e-7)


@pytest.mark.parametrize("damping", [0.5, 0.999999999, 1.0, 1.000000001, 1.09, 1.11, 3.0, 1e4, 1e8])
@pytest.mark.plain
def test_any_damping_keeps_the_digits(damping: float) -> None:
    """One mode released at rest above a stop: against the closed form at 50 digits."""
    import mpmath as mp

    with mp.workdps(60):
        stop, sigma = mp.mpf(0.25), mp.mpf(damping)
        kappa = mp.sqrt(sigma * sigma - 1)

        def f(s: mp.mpf) -> mp.mpf:
            if kappa == 0:
                return mp.exp(-s) * (1 + s) - stop
            # exp((kappa - sigma) s), the slow exponential, without overflow.
            slow, fast = mp.exp(-s / (sigma + kappa)), mp.exp(-(sigma + kappa) * s)
            return mp.re((slow + fast) / 2 + sigma * (slow - fast) / (2 * kappa)) - stop

        found = ExponentialSum([1.0], [0.0], [1.0], [damping], offset=-0.25).first_root()
        guess = mp.mpf(found.time)
        exact = mp.findroot(f, (guess, guess * (1 + mp.mpf(10) ** -8)))
        error = abs(exact - guess) / exact
    assert float(error) < 4e-16


def fallen(amplitude: float, slow: float, rate: float, swing: float, offset: float, s: Any) -> Any:
    """The sum of a slow term and a sine, with mpmath."""
    w, fast = mpmath.mpf(slow), mpmath.mpf(1.1)
    own = amplitude * mpmath.cos(w * s) + rate / w * mpmath.sin(w * s)
    return own + swing / fast * mpmath.sin(fast * s) + offset


# Of 1e14 the cells are too many, in the thousands, for kernels that are not compiled.
@pytest.mark.parametrize(
    "amplitude",
    [*(pytest.param(a, marks=pytest.mark.plain) for a in (1e9, 1e12, 3e13, 3e14)), 1e14],
)
def test_a_fall_through_a_wide_band_is_found_where_rounding_allows(amplitude: float) -> None:
    """A slow term so large that rounding hides the others for several cells: to 50 digits."""
    random = np.random.default_rng(5)
    for _ in range(40):
        gap, gravity = random.uniform(0.3, 2.0), random.uniform(0.05, 0.5)
        slow, rate = math.sqrt(gravity / amplitude), -random.uniform(0.3, 0.6)
        swing = random.uniform(0.0, 0.1)
        total = ExponentialSum(
            [amplitude, 0.0], [rate, swing], [slow, 1.1], [0.0, 0.0], offset=gap - amplitude
        )
        found = total.first_root()
        f = partial(fallen, amplitude, slow, rate, swing, total.offset)
        with mpmath.workdps(50):  # it falls all the way: there is one root
            exact = mpmath.findroot(f, (found.time, found.time + 0.01))
        assert found.kind is RootKind.ROOT
        assert abs(found.time - float(exact)) <= found.error, (amplitude, found, exact)


@pytest.mark.plain
def test_a_stiff_mode_costs_few_cells() -> None:
    """A mode a hundred million times as fast dies out: its time constant does not set the cells."""
    slow = ExponentialSum([1.0], [0.0], [1.0], [0.01], offset=-0.2).first_root()
    stiff = ExponentialSum([1.0, 1e-3], [0.0, 0.0], [1.0, 1e4], [0.01, 1e8], offset=-0.2)
    cells = [root.cost.counts["cells"] for root in (stiff.first_root(), slow)]
    assert cells[0] < 4 * cells[1] + 120


@pytest.mark.plain
def test_what_can_never_happen_is_known() -> None:
    root = ExponentialSum([1.0], [0.0], [1.0], [0.1], offset=1e-3).first_root()
    assert root.kind is RootKind.ROOT
    high = ExponentialSum([1.0], [0.0], [1.0], [0.1], offset=0.9).first_root()
    assert high.kind is RootKind.NEVER
    assert high.searched == math.inf
    missed = ExponentialSum([1.0], [0.0], [1.0], [0.0], offset=1.0 + 1e-12).first_root()
    assert missed.kind is RootKind.NEVER


@pytest.mark.plain
def test_the_limit_is_kept_and_says_how_far_it_came() -> None:
    # Both at their lowest at once is far away.
    frequency = [1.0, math.sqrt(2.0)]
    beat = ExponentialSum([1.0, 1.0], [0.0, 0.0], frequency, [0.0, 0.0], offset=2.0 - 1e-9)
    root = beat.first_root(limit=100)
    assert root.kind is RootKind.LIMIT
    assert root.cost.counts["cells"] <= 101
    assert 10.0 < root.searched < math.inf


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0], [0.0], [0.0], [0.0]), r"frequency\[0\] must be positive; got 0.0"),
        (([1.0], [0.0], [1.0], [-0.1]), r"decay\[0\] must not be negative; got -0.1"),
        (([1.0], [0.0, 1.0], [1.0], [0.1]), r"rate must have shape \(1,\)"),
        (([math.nan], [0.0], [1.0], [0.1]), r"value\[0\] must be a finite number"),
    ],
)
def test_bad_terms_are_refused(
    arguments: tuple[list[float], list[float], list[float], list[float]], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        ExponentialSum(*arguments)


def test_a_start_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match=r"f\(0\) must be positive; got -0.5"):
        ExponentialSum([1.0], [0.0], [1.0], [0.0], offset=-1.5).first_root()


@pytest.mark.parametrize("cell_end", [2.0**k for k in range(-4, 5)])
@pytest.mark.parametrize("offset", [0.0, 1.0, -1.0])
@pytest.mark.plain
def test_a_root_at_the_end_of_a_cell_is_a_root(cell_end: float, offset: float) -> None:
    """Cells end at powers of two: there, and an ulp either side, a crossing is no touch."""
    end = cell_end * (1.0 + offset * 2.0**-52)
    frequency = math.pi / (2.0 * end)
    root = ExponentialSum([1.0], [0.0], [frequency], [0.0]).first_root()
    assert root.kind is RootKind.ROOT
    assert root.time == pytest.approx(end, rel=4e-16)
    assert root.rate == pytest.approx(-frequency, rel=1e-15)


@pytest.mark.parametrize(("touch", "root", "back"), [(0.02, 0.1, 0.2), (0.1, 0.15, 0.24)])
@pytest.mark.plain
def test_a_root_just_after_a_touch_that_does_not_count_is_found(
    touch: float, root: float, back: float
) -> None:
    """f touches zero, falls below it and is positive again, all in the first cell, of 0.25."""
    zeros = [(touch, 0), (touch, 1), (root, 0), (back, 0)]
    with mpmath.workdps(40):
        rows = mpmath.matrix(
            [
                [
                    *(w**d * mpmath.cos(w * s + d * mpmath.pi / 2) for w in (1, 2)),
                    *(
                        mpmath.mpf(w) ** (d - 1) * mpmath.sin(w * s + d * mpmath.pi / 2)
                        for w in (1, 2)
                    ),
                    1 - d,
                ]
                for s, d in zeros
            ]
        )
        value, *rates, offset = map(float, mpmath.lu_solve(rows[:, 1:], rows[:, 0]))
    given = ExponentialSum([-1.0, value], rates, [1.0, 2.0], [0.0, 0.0], offset)
    assert given.first_root().kind is RootKind.TOUCH
    assert given.first_root(touches=False).time == pytest.approx(root, abs=1e-10)
