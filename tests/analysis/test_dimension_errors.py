"""Error bars of correlation sums and dimensions: as wide as claimed, over many seeds."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import signal

from dynkit.analysis import CorrelationDimension
from dynkit.analysis.dimension.errors import standard_errors
from dynkit.analysis.dimension.scaling import takens
from dynkit.analysis.dimension.sums import CorrelationSums, correlation_sums
from dynkit.core.validation import Array
from dynkit.systems import Henon

# 1.21 to 1.22: P. Grassberger, I. Procaccia, Phys. Rev. Lett. 50 (1983) 346-349; J. C. Sprott, G.
# Rowlands, Int. J. Bifurcation Chaos 11 (2001) 1865-1880
HENON = 1.22

SEEDS = 200
# three standard errors of a part that is found over so many seeds
SLACK = 3.0 * np.sqrt(0.68 * 0.32 / SEEDS)


def walk(seed: int, n: int, d: int, step: float) -> Array:
    """A walk on a torus of unit angles: every place is as likely, and C(r) is (2 r)^d."""
    steps = step * np.random.default_rng(seed).normal(size=(n, d))
    return np.asarray(np.cumsum(steps, axis=0) % 1.0, dtype=np.float64)


def drifting(seed: int, n: int = 1280) -> Array:
    """A motion on the line whose states remember some ten states before."""
    noise = np.random.default_rng(seed).normal(size=n)
    return np.asarray(signal.lfilter([1.0], [1.0, -0.9], noise))[:, None]


# --- of the dimension ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("n", "d", "step"), [(1000, 1, 10.0), (1000, 1, 0.05), (1500, 2, 10.0)],
    ids=["ring", "ring with memory", "torus"],
)  # fmt: skip
def test_known_dimension_is_within_the_error_bar_as_often_as_claimed(
    n: int, d: int, step: float
) -> None:
    angles = dict.fromkeys(range(d), 1.0)
    found = [CorrelationDimension(walk(k, n, d, step), angles=angles) for k in range(SEEDS)]
    drifts = np.array([each.region.drift for each in found if each.region is not None])
    assert len(drifts) == SEEDS
    for estimates in (
        [(each.value, each.error) for each in found],
        [(each.takens.value, each.takens.error) for each in found],
    ):
        values, errors = np.array(estimates).T
        # 68% and 95%; an error half as large again as it should be would cover 87%. A drift that
        # the data do not exclude, which errors contain besides, covers more.
        off, scatter = abs(values - d), np.sqrt(errors**2 - drifts**2)
        assert 0.68 - SLACK <= (off < scatter).mean() <= 0.87
        assert (off < 2.0 * scatter).mean() >= 0.95 - SLACK
        assert (off < errors).mean() >= 0.68 - SLACK


@pytest.mark.parametrize(("n", "seeds"), [(1000, 60), (3000, 20)])
def test_dimension_of_quasi_periodic_motion_is_within_two_errors(n: int, seeds: int) -> None:
    # a rotation by a random turn, on a circle where it is not uniform
    for seed in range(seeds):
        random = np.random.default_rng(seed)
        angle = 2.0 * np.pi * (np.arange(n) * random.uniform(0.02, 0.48) % 1.0)
        states = (angle + 0.5 * np.sin(angle))[:, None]
        found = CorrelationDimension(states, angles={0: 2.0 * np.pi})
        assert found.region is None or abs(found.value - 1.0) < 2.0 * found.error


# --- of sums ------------------------------------------------------------------------------------


def test_error_is_that_of_resampled_blocks() -> None:
    # all pairs between blocks, resampled as a whole: what the error is the limit of
    states, radii, number = drifting(0, 2560), np.array([0.5, 1.0, 2.0]), 64
    near = abs(states - states[:, 0]) <= radii[:, None, None]
    between = near.reshape(3, number, 40, number, 40).sum(axis=(2, 4)).astype(np.float64)
    weights = np.random.default_rng(1).multinomial(number, np.full(number, 1.0 / number), 4000)
    curves = np.log(np.einsum("sa,rab,sb->sr", weights, between, weights))
    slopes = (curves[:, 2] - curves[:, 0]) / np.log(4.0)
    sums = correlation_sums(states, radii)
    (error,) = standard_errors(sums.pairs, sums.shares, np.array([[-1.0, 0.0, 1.0]]) / np.log(4.0))
    # terms of second order in the weights, a 64th part, and the scatter of 4000 resamples
    assert error == pytest.approx(slopes.std(), rel=0.1)


@pytest.mark.parametrize("memory", [False, True], ids=["independent", "with memory"])
def test_error_is_the_scatter_over_seeds(memory: bool) -> None:
    radii = np.array([0.02, 0.2])
    sums = [
        correlation_sums(drifting(k) if memory else drifting(k)[::40], radii * (1 if memory else 5))
        for k in range(SEEDS)
    ]
    logs = np.log([each.values for each in sums])
    claimed = np.sqrt(np.mean([each.error**2 for each in sums], axis=0))
    # the scatter itself is known to 5%; a variance over 16 to 64 blocks to 18% to 35%
    assert claimed == pytest.approx(logs.std(axis=0, ddof=1), rel=0.25)


def test_error_of_independent_pairs_is_that_of_counting() -> None:
    # on a ring no state has more neighbours than another: the pairs scatter like counts
    sums = [
        correlation_sums(walk(k, 640, 1, 10.0), np.array([1e-3, 1e-2]), angles={0: 1.0})
        for k in range(SEEDS)
    ]
    claimed = np.mean([each.error * np.sqrt(each.pairs) for each in sums], axis=0)
    assert (claimed >= 1.0).all()
    assert (claimed < 1.2).all()


def test_error_is_unknown_without_blocks() -> None:
    assert np.isinf(correlation_sums(np.arange(10.0)[:, None], np.array([2.0])).error).all()


def test_error_is_infinite_where_there_is_no_pair() -> None:
    sums = correlation_sums(np.arange(100.0)[:, None], np.array([0.5, 1.5]))
    assert np.isinf(sums.error).tolist() == [True, False]


# --- Takens' estimate ---------------------------------------------------------------------------

CURVES = 20
"""Seeds of sets whose curves bend or wave, so that the largest radii mislead the estimate."""


def cantor(seed: int) -> Array:
    digits = np.random.default_rng(seed).integers(0, 2, size=(2000, 32))
    return np.asarray((digits @ (2.0 * 3.0 ** -np.arange(1.0, 33.0)))[:, None])


def normal(seed: int) -> Array:
    return np.random.default_rng(seed).normal(size=(2000, 2))


def henon(seed: int) -> Array:
    start = np.random.default_rng(seed).uniform(-0.1, 0.1, size=2)
    return Henon().iterate(start, 3000)[100:]


@pytest.mark.parametrize(
    ("states", "known"),
    [(cantor, np.log(2.0) / np.log(3.0)), (normal, 2.0), (henon, HENON)],
    ids=["Cantor set", "noise", "Henon"],
)
def test_takens_estimate_allows_for_curves_that_bend(
    states: Callable[[int], Array], known: float
) -> None:
    found = [CorrelationDimension(states(k)).takens for k in range(CURVES)]
    off = np.array([abs(each.value - known) / each.error for each in found])
    # less three standard errors of a part of so many seeds
    assert (off < 2.0).mean() >= 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / CURVES)
    assert (off < 3.0).mean() >= 0.99 - 3.0 * np.sqrt(0.99 * 0.01 / CURVES)
    assert np.mean([each.error for each in found]) < 0.15 * known


def region_and_sums(seed: int) -> tuple[CorrelationDimension, CorrelationSums]:
    found = CorrelationDimension(walk(seed, 3000, 1, 10.0), angles={0: 1.0})
    return found, found.sums


def test_takens_estimate_is_the_most_likely_exponent() -> None:
    found, sums = region_and_sums(0)
    assert found.region is not None
    inside = (sums.radii >= found.region.low) & (sums.radii <= found.region.high)
    counts = np.diff(sums.pairs[inside], prepend=0)
    parts = sums.radii[inside] / found.region.high
    exponents = found.takens.value + np.array([-1e-3, 0.0, 1e-3])
    likelihoods = [counts @ np.log(np.diff(parts**e, prepend=0.0)) for e in exponents]
    assert np.argmax(likelihoods) == 1


def test_takens_estimate_is_near_the_one_from_single_distances() -> None:
    found, _ = region_and_sums(1)
    assert found.region is not None
    states, high = found.states[:, 0], found.region.high
    later, earlier = np.tril_indices(len(states), -found.window - 1)
    gap = abs(states[later] - states[earlier])
    distances = np.minimum(gap, 1.0 - gap)
    distances = distances[(distances <= high) & (distances > 0.0)]
    single = -1.0 / np.log(distances / high).mean()
    assert abs(takens(found.sums, found.region).value - single) < found.takens.error
