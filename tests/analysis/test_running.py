"""Measures that accumulate: as on the whole, whatever the blocks; closed forms; bounded memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from dynkit import Map, Stream
from dynkit.analysis import (
    POD,
    CorrelationDimension,
    LyapunovSpectrum,
    PowerSpectrum,
    Running,
    RunningExponents,
    RunningHistogram,
    RunningPOD,
    RunningSample,
    RunningSpectrum,
)
from dynkit.analysis.batches import Batches
from dynkit.core.validation import Array
from dynkit.systems import Henon, ImpactChain, Logistic


class SkewTent(Map):
    """x / a below a, (1 - x) / (1 - a) above: uniform density, exponent -a ln a - (1-a) ln(1-a)."""

    dimension = 1

    def __call__(self, state: Array) -> Array:
        return np.where(state < 0.3, state / 0.3, (1.0 - state) / 0.7)

    def jacobian(self, state: Array) -> Array:
        return np.where(state < 0.3, 1.0 / 0.3, -1.0 / 0.7)[None]


class LogisticOf(Map):
    """The logistic map at rate 4, in any unit."""

    dimension = 1

    def __init__(self, size: float) -> None:
        self.size = size

    def __call__(self, state: Array) -> Array:
        return 4.0 * state * (1.0 - state / self.size)


class Drifting(Map):
    """The logistic map, whose rate is 4 in the first iterates, and 3.7 from then on."""

    dimension = 2

    def __call__(self, state: Array) -> Array:
        x, y = state
        return np.array([self.rate(y) * x * (1.0 - x), 0.999 * y])

    def jacobian(self, state: Array) -> Array:
        x, y = state
        return np.diag([self.rate(y) * (1.0 - 2.0 * x), 0.999])

    def rate(self, y: float) -> float:
        return 4.0 if y > 0.999**3000 else 3.7


def after(running: Any, blocks: Iterable[Any]) -> Any:
    for block in blocks:
        running.add(block)
    return running.result()


CHAIN = ImpactChain(masses=3, frequency=1.346)
MEASURES: dict[str, tuple[Any, Callable[[], Running], Callable[[Any], Any]]] = {
    "histogram": (
        CHAIN,
        lambda: RunningHistogram("relative_velocity", low=0.05, high=0.3, bins=9),
        lambda found: [*found.counts, *found.outside, *found.error],
    ),
    "pod": (
        CHAIN,
        RunningPOD,
        lambda found: [*found.power, *found.standard_errors, *found.mean, found.batches],
    ),
    "pod about the mean": (
        CHAIN,
        lambda: RunningPOD(about="mean"),
        lambda found: [*found.power, *found.cumulative_errors],
    ),
    "pod of a map": (Henon(), RunningPOD, lambda found: [*found.power, *found.standard_errors]),
    "exponents": (
        CHAIN,
        lambda: RunningExponents(settling=50),
        lambda found: [*found.per_time, *found.error],
    ),
    "exponents of a map": (
        SkewTent(),
        lambda: RunningExponents(settling=50),
        lambda found: [*found.exponents, *found.error],
    ),
    "spectrum": (
        CHAIN,
        lambda: RunningSpectrum(length=64),
        lambda found: [*found.density, found.variance, found.error, found.segments],
    ),
    "spectrum of a map": (
        Henon(),
        lambda: RunningSpectrum(interval=2.0, coordinate=1, length=33),
        lambda found: [*found.density, found.variance, found.error, found.segments],
    ),
    "sample": (
        CHAIN,
        lambda: RunningSample(200),
        lambda found: [*found.states.ravel(), found.value],
    ),
}


def stream_of(system: Any, keep: int, block: int) -> Stream:
    start = None if system is CHAIN else [0.1] * system.dimension
    found: Stream = system.stream(start=start, transient=100, keep=keep, block=block)
    return found


@pytest.mark.parametrize("name", MEASURES)
@pytest.mark.parametrize("block", [1, 37, 256])
def test_results_depend_on_the_blocks_by_rounding_alone(name: str, block: int) -> None:
    system, make, numbers = MEASURES[name]
    keep = 180 if block == 1 else 700
    whole = after(make(), stream_of(system, keep, keep))
    found = after(make(), stream_of(system, keep, block))
    assert numbers(found) == pytest.approx(numbers(whole), rel=1e-8, abs=1e-11)


# --- as on arrays ---------------------------------------------------------------------------------


def test_a_histogram_is_that_of_numpy() -> None:
    running = RunningHistogram("state[1]", low=-0.3, high=0.2, bins=7)
    found = after(running, stream_of(Henon(), 500, 90))
    (whole,) = stream_of(Henon(), 500, 500)
    counts, edges = np.histogram(whole.states[:, 1], bins=7, range=(-0.3, 0.2))
    assert found.counts.tolist() == counts.tolist()
    assert found.edges == pytest.approx(edges, abs=1e-15)
    below = int((whole.states[:, 1] < -0.3).sum())
    assert found.outside == (below, 500 - below - counts.sum())
    assert found.density.sum() * 0.5 / 7.0 == pytest.approx(counts.sum() / 500.0)


def test_the_upper_edge_belongs_to_the_last_bin() -> None:
    running = RunningHistogram("state[0]", low=0.0, high=0.75, bins=2)
    found = after(running, Logistic(rate=4.0).stream(start=[0.25], transient=0, keep=3))
    assert (found.counts.tolist(), found.outside) == ([1, 2], (0, 0))  # 1/4, 3/4, 3/4


@pytest.mark.parametrize("size", [2.0**-600, 2.0**600])
def test_a_histogram_is_the_same_in_all_units(size: float) -> None:
    """Squares of the values themselves would overflow or vanish."""

    def found(size: float) -> Any:
        running = RunningHistogram("state[0]", low=0.0, high=0.75 * size, bins=20)
        return after(running, LogisticOf(size).stream(start=[0.3 * size], keep=2000, block=500))

    known, scaled = found(1.0), found(size)
    assert scaled.counts.tolist() == known.counts.tolist()
    np.testing.assert_allclose(scaled.error * size, known.error, rtol=1e-12)
    assert scaled.change == known.change


@pytest.mark.parametrize("size", [2.0**-600, 2.0**600])
def test_a_histogram_counts_values_far_from_its_edges(size: float) -> None:
    running = RunningHistogram("state[0]", low=-1.0, high=1.0, bins=2)
    found = after(running, LogisticOf(size).stream(start=[0.3 * size], keep=500, block=500))
    inside, above = found.counts.tolist(), found.outside[1]
    assert (inside, above) == (([0, 500], 0) if size < 1.0 else ([0, 0], 500))


@pytest.mark.parametrize("about", ["origin", "mean"])
def test_pod_is_that_of_the_attractor(about: Any) -> None:
    found = after(RunningPOD(about=about), stream_of(CHAIN, 600, 70))
    whole = POD(CHAIN.attractor(transient=100, impacts=600), about=about)
    assert abs(found.power - whole.power).max() <= found.error + whole.error
    assert found.error < 1e-10
    assert found.modal_assurance().shape == (3, 3)


def test_exponents_are_those_of_one_run() -> None:
    attractor = Henon().attractor(start=[0.1, 0.1], keep=1)
    whole = LyapunovSpectrum(attractor, iterations=1600)
    stream = Henon().stream(start=[0.1, 0.1], keep=2000, block=333)
    found = after(RunningExponents(settling=400), stream)
    assert found.exponents.tobytes() == whole.exponents.tobytes()
    assert found.error.tobytes() == whole.error.tobytes()


@pytest.mark.parametrize("length", [32, 61])
def test_a_spectrum_is_that_of_an_array(length: int) -> None:
    (block,) = stream_of(Henon(), 31 * length, 31 * length)
    whole = PowerSpectrum(block.states[:, 0], interval=1.0, segments=61)
    running = RunningSpectrum(interval=1.0, coordinate=0, length=whole._length)
    found = after(running, stream_of(Henon(), 31 * length, 50))
    assert found.segments == whole.segments
    assert found.density == pytest.approx(whole.density, rel=1e-9)
    assert (found.variance, found.error) == pytest.approx((whole.variance, whole.error), rel=1e-12)
    assert (found.frequencies == whole.frequencies).all()


def test_a_spectrum_of_an_oscillator_has_its_default_axis() -> None:
    attractor = CHAIN.attractor(transient=100, impacts=300)
    whole = PowerSpectrum(attractor, samples=1024, segments=7)
    found = after(RunningSpectrum(length=256), stream_of(CHAIN, 300, 70))
    assert (found.interval, found.name, found.table_frequency) == (
        whole.interval,
        whole.name,
        whole.table_frequency,
    )
    assert (found.frequencies == whole.frequencies).all()
    assert found.lines is None


def test_a_sample_of_all_states_is_the_set() -> None:
    found = after(RunningSample(1000), stream_of(Henon(), 800, 90))
    (block,) = stream_of(Henon(), 800, 800)
    whole = CorrelationDimension(block.states)
    assert found.states.tobytes() == block.states.tobytes()
    assert (found.value, found.error) == (whole.value, whole.error)


def test_each_state_is_in_the_sample_with_the_same_probability() -> None:
    """The sample's quarters hold a quarter of it each: binomial, to five standard deviations."""
    running = RunningSample(1000)
    after(running, stream_of(Henon(), 9000, 700))
    (block,) = stream_of(Henon(), 9000, 9000)
    places = {state.tobytes(): i for i, state in enumerate(block.states)}
    at = np.array([places[state.tobytes()] for state in running.sample])
    assert (np.diff(at) > 0).all()
    quarters = np.bincount(at // 2250, minlength=4)
    assert abs(quarters - 250).max() < 5.0 * np.sqrt(1000 * 0.25 * 0.75)


# --- closed forms ---------------------------------------------------------------------------------


def spread(ratios: list[float]) -> None:
    """Actual errors in units of reported ones: none far out, and most within two."""
    assert np.max(np.abs(ratios)) < 6.0
    assert np.mean(np.abs(ratios) < 2.0) > 0.8


STARTS = [0.1234 + 0.02 * i for i in range(40)]


def test_errors_of_histograms_cover_the_density_of_the_logistic_map() -> None:
    """1 / (pi sqrt(x (1 - x))): S. M. Ulam, J. von Neumann, Bull. AMS 53 (1947) 1120."""
    ratios = []
    for x in STARTS:
        running = RunningHistogram("state[0]", low=0.0, high=1.0, bins=10)
        found = after(running, Logistic(rate=4.0).stream(start=[x], keep=20_000, block=5000))
        exact = np.diff(2.0 / np.pi * np.arcsin(np.sqrt(found.edges))) * 10.0
        ratios += ((found.density - exact) / found.error).tolist()
    spread(ratios)


def test_errors_of_powers_cover_those_of_the_logistic_map() -> None:
    """The mean of x^2 is 3/8, that of (x - 1/2)^2 is 1/8."""
    ratios = []
    for x in STARTS:
        for about, power in (("origin", 0.375), ("mean", 0.125)):
            running = RunningPOD(about=about)  # type: ignore[arg-type]
            found = after(running, Logistic(rate=4.0).stream(start=[x], keep=20_000, block=5000))
            ratios.append(float((found.power[0] - power) / found.standard_errors[0]))
    spread(ratios)


def test_errors_of_exponents_cover_ln_2_of_the_logistic_map() -> None:
    ratios = []
    for x in STARTS:
        found = after(
            RunningExponents(), Logistic(rate=4.0).stream(start=[x], keep=20_000, block=5000)
        )
        ratios.append(float((found.exponents[0] - np.log(2.0)) / found.error[0]))
    spread(ratios)


def test_errors_of_exponents_cover_that_of_the_skew_tent() -> None:
    exact, ratios = -0.3 * np.log(0.3) - 0.7 * np.log(0.7), []
    for x in STARTS[::4]:
        found = after(
            RunningExponents(settling=0), SkewTent().stream(start=[x], keep=5000, block=1000)
        )
        ratios.append(float((found.exponents[0] - exact) / found.error[0]))
    assert np.max(np.abs(ratios)) < 6.0


def test_the_spectrum_of_the_logistic_map_is_white() -> None:
    """Successive states are not correlated, with variance 1/8: the density is 1 / (8 pi)."""
    running = RunningSpectrum(interval=1.0, length=32)
    found = after(running, Logistic(rate=4.0).stream(start=[0.3], keep=200_000))
    exact = 1.0 / (8.0 * np.pi)
    # without both ends, where subtraction of means and one-sidedness change densities
    assert abs(found.density[2:-1] - exact).max() < 5.0 * found.error * exact
    assert found.variance == pytest.approx(0.125, rel=0.02)


def test_a_sample_has_the_dimension_of_the_attractor() -> None:
    """1.22 +- 0.01: P. Grassberger, I. Procaccia, Physica D 9 (1983) 189-208, table 1."""
    found = after(RunningSample(5000), Henon().stream(start=[0.1, 0.1], keep=100_000))
    assert abs(found.value - 1.22) < 0.01 + 4.0 * found.error


# --- changes of regime ----------------------------------------------------------------------------


def test_a_change_of_regime_is_noticed_and_covered() -> None:
    stream = Drifting().stream(start=[0.3, 1.0], transient=0, keep=9000, block=1000)
    histogram = RunningHistogram("state[0]", low=0.0, high=1.0, bins=5)
    exponents, spectrum = RunningExponents(settling=0), RunningSpectrum(interval=1.0, length=64)
    for block in stream:
        for each in (histogram, exponents, spectrum):
            each.add(block)
    found, late = histogram.result(), Logistic(rate=3.7).attractor(start=[0.4], keep=9000)
    assert found.change is not None
    assert abs(found.change.at - 3000) < 600
    after_it, _ = np.histogram(late.states, bins=5, range=(0.0, 1.0), density=True)
    assert (abs(found.density - after_it) < 3.0 * found.error).all()
    change = exponents.result().change
    assert change is not None
    assert abs(change.at - 3000) < 600
    assert spectrum.result().error == np.inf


def test_a_change_counts_states_where_batches_hold_several() -> None:
    batches = Batches(1024)
    rng = np.random.default_rng(0)
    for low in range(0, 40_000, 1000):
        batches.add_rows(rng.normal(size=(1000, 1)) + (low >= 24_000))
    assert batches.change is not None
    assert abs(batches.change.at - 24_000) <= 40_000 // 64
    assert batches.change.states == 40_000 // batches.length * batches.length


# --- batches and memory ---------------------------------------------------------------------------


@pytest.mark.parametrize("sizes", [[1] * 100, [100], [3, 5, 92], [64, 1, 35], [7] * 14 + [2]])
def test_batches_do_not_depend_on_blocks(sizes: list[int]) -> None:
    batches, values = Batches(8), np.arange(200.0).reshape(100, 2)
    for begin, size in zip(np.cumsum([0, *sizes]), sizes, strict=False):
        batches.add_rows(values[begin : begin + size])
    assert (batches.length, batches.count) == (16, 100)
    expected = [values[i : i + 16].sum(axis=0) for i in range(0, 100, 16)]
    assert batches.sums.tolist() == np.array(expected).tolist()
    assert batches.means.tolist() == (np.array(expected[:6]) / 16.0).tolist()


def every() -> list[Running]:
    return [
        RunningHistogram("state[0]", low=-1.5, high=1.5),
        RunningPOD(),
        RunningExponents(),
        RunningSpectrum(interval=1.0, length=256),
        RunningSample(1000),
    ]


def peak(keep: int) -> int:
    running = every()
    tracemalloc.start()
    try:
        for block in Henon().stream(start=[0.1, 0.1], keep=keep, block=2000):
            for each in running:
                each.add(block)
        _, found = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return found


def test_memory_does_not_grow_with_the_number_of_blocks() -> None:
    peak(20_000)
    assert peak(400_000) < 1.2 * peak(20_000)


# --- wrong input ----------------------------------------------------------------------------------


class Scaled(Map):
    """The logistic map at rate 4 in another unit."""

    dimension = 1

    def __init__(self, unit: float) -> None:
        self.unit = unit

    def __call__(self, state: Array) -> Array:
        return 4.0 * state * (1.0 - state / self.unit)


@pytest.mark.parametrize(
    "make", [RunningPOD, lambda: RunningSpectrum(interval=1.0, length=8)], ids=["pod", "spectrum"]
)
@pytest.mark.parametrize(
    ("unit", "message"),
    [
        (1e200, r"block must not exceed 1e\+145 in size; got 9\.\d+e\+199"),
        (1e-200, r"block must be zero, or at least 1e-145 in size; got 9\.\d+e-201"),
    ],
)
def test_states_whose_squares_are_out_of_range_are_refused(
    make: Any, unit: float, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        after(make(), Scaled(unit).stream(start=[0.3 * unit], keep=100, block=100))


@pytest.mark.parametrize(
    "make", [RunningPOD, lambda: RunningSpectrum(interval=1.0, length=8)], ids=["pod", "spectrum"]
)
def test_a_motion_may_decay_until_its_squares_vanish(make: Any) -> None:
    blocks = Logistic(rate=1e-3).stream(start=[0.5], transient=0, keep=80, block=20)
    found = after(make(), blocks)
    assert np.isfinite(found.error).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RunningHistogram("x", low=1.0, high=1.0), "high must exceed low = 1.0; got 1.0"),
        (lambda: RunningHistogram("x", low=0, high=1, bins=0), "bins must be a positive integer"),
        (
            lambda: RunningHistogram("x", low=1.0, high=1.0 + 2.0**-50, bins=10),
            r"bins must be wider than rounding; got 10 of width 8\.88e-17",
        ),
        (
            lambda: RunningHistogram("x", low=-1e308, high=1e308, bins=10),
            r"high must exceed low = -1e\+308 by a finite number; got 1e\+308",
        ),
        (lambda: RunningHistogram("x", low=np.nan, high=1), "low must be a finite number"),
        (
            lambda: RunningPOD(about="zero"),  # type: ignore[arg-type]
            "about must be one of: origin, mean; got 'zero'",
        ),
        (lambda: RunningExponents(settling=-1), "settling must be zero or a positive integer"),
        (lambda: RunningSpectrum(interval=0.0), "interval must be positive; got 0.0"),
        (lambda: RunningSpectrum(length=7), "length must be at least 8; got 7"),
        (lambda: RunningSample(63), "size must be at least 64; got 63"),
        (
            lambda: RunningSample(norm="other"),  # type: ignore[arg-type]
            "norm must be one of: maximum, euclidean",
        ),
    ],
)
def test_wrong_options_are_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("running", every(), ids=repr)
def test_results_of_too_few_states_are_refused(running: Running) -> None:
    with pytest.raises(ValueError, match=r"must (have|hold) \d+ .* got "):
        running.result()
    with pytest.raises(ValueError, match="attractor must be an Attractor; got 3"):
        running.add(3)  # type: ignore[arg-type]


def test_an_observable_must_exist_and_be_finite() -> None:
    block = Henon().attractor(start=[0.1, 0.1])
    with pytest.raises(ValueError, match=r"name must be one of: state\[0\], state\[1\]; got 'u'"):
        RunningHistogram("u", low=0.0, high=1.0).add(block)


def test_a_map_needs_an_interval() -> None:
    with pytest.raises(ValueError, match="interval must be given"):
        RunningSpectrum().add(Henon().attractor(start=[0.1, 0.1]))
