"""Runs that change their regime, and runs that do not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy import signal
from scipy.stats import binom

from dynkit import MapAttractor
from dynkit.analysis import POD, CorrelationDimension, LyapunovSpectrum, PowerSpectrum
from dynkit.analysis.regimes import _periodic_from, _statistic, regime_change
from dynkit.core.cost import Cost
from dynkit.core.validation import Array
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Map
from dynkit.labels.label import OrbitKind, OrbitLabel
from dynkit.systems import Henon, ImpactChain
from tests.validation.regimes import CLAIM, FAILURE, SYSTEMS, FalseAlarms, false_alarms

ITERATES = 4000
LAST = {3.2: 0.5 * np.log(0.16), 3.7: 0.3549}
"""Exponents of the logistic map: of P(2), (4 + 2 r - r^2)^(1/2); at 3.7 the mean over 10^7
iterates, right to 2e-4."""


@dataclass(frozen=True)
class Switched(Map):
    """The logistic map of x at rate 4 until the clock y, which counts iterates, reaches `at`."""

    at: int
    rate: float
    dimension = 2

    def _rate(self, state: Array) -> float:
        return 4.0 if state[1] < self.at else self.rate

    def __call__(self, state: Array) -> Array:
        x, clock = state
        return np.array([self._rate(state) * x * (1.0 - x), clock + 1.0])

    def jacobian(self, state: Array) -> Array:
        return np.diag([self._rate(state) * (1.0 - 2.0 * state[0]), 1.0])


class Recorded(Attractor):
    """States that were recorded before."""

    def __init__(self, states: Array) -> None:
        self._states = states

    @property
    def system(self) -> Map:
        return Henon()

    @property
    def transient(self) -> int:
        return 0

    @property
    def states(self) -> Array:
        return self._states

    @property
    def label(self) -> OrbitLabel:
        return OrbitLabel(OrbitKind.UNSETTLED, None, None, 1e-6, np.inf, len(self._states))

    @property
    def cost(self) -> Cost:
        return Cost(0.0)

    @property
    def error(self) -> float:
        return 0.0

    def time_series(self, times: Array) -> Array:
        return self._states[times.astype(np.intp)]


def noise(n: int, columns: int) -> Array:
    """Independent normal values (n, columns)."""
    return np.random.default_rng(0).normal(size=(n, columns))


def switched(seed: int, rate: float) -> tuple[LyapunovSpectrum, int]:
    """A spectrum, and the iterate of those that count with which the last regime begins."""
    random = np.random.default_rng(seed)
    at = int(random.uniform(0.2, 0.8) * ITERATES)
    start = [random.uniform(0.1, 0.9), -float(ITERATES // 4)]
    return LyapunovSpectrum.of_map(Switched(at, rate), start, iterations=ITERATES), at


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("rate", LAST)
def test_errors_cover_the_attractor_after_a_transient(rate: float, seed: int) -> None:
    spectrum, at = switched(seed, rate)
    place = int(spectrum.error.argmax())  # the clock's exponent is zero, and has no error
    assert abs(spectrum.exponents[place] - LAST[rate]) <= 2.0 * spectrum.error[place]
    assert spectrum.change is not None
    assert spectrum.change.periodic == (rate == 3.2)
    assert abs(spectrum.change.at - at) <= ITERATES / 16
    assert str(spectrum.change) in repr(spectrum)


def test_a_picture_says_where_the_regime_changes() -> None:
    spectrum, _ = switched(0, 3.2)
    axes = spectrum.plot()
    assert axes.get_title() == str(spectrum.change)
    plt.close("all")


@pytest.mark.parametrize("name", SYSTEMS)
def test_stationary_chaos_is_said_to_change_no_more_often_than_claimed(name: str) -> None:
    # Chaotic runs differ between processors, so the number of alarms is a random number: of 400
    # runs 12 may be said to change, of 20,000 in the campaign 151.
    found = false_alarms(name, 400)
    assert found.alarms <= found.most


def test_campaigns_detect_twice_the_claimed_chance() -> None:
    campaign = FalseAlarms(20_000, 0)
    assert binom.sf(campaign.most, campaign.runs, CLAIM) <= FAILURE
    assert binom.cdf(campaign.most, campaign.runs, 2.0 * CLAIM) < 1e-3


@pytest.mark.parametrize("memory", [0.95, 0.98])
def test_what_remembers_for_longer_than_a_part_does_not_change(memory: float) -> None:
    # as it does in 2 and 6 % of such runs when neighbouring parts count as independent
    runs = signal.lfilter([1.0], [1.0, -memory], noise(1000, 1000), axis=0)[400:]
    alarms = sum(regime_change(run[:, None]) is not None for run in runs.T)
    assert alarms <= FalseAlarms(1000, 0).most


def test_a_laminar_phase_is_no_regime() -> None:
    run = noise(600, 1)
    run[:150] = 0.01 * run[:150] + 3.0
    assert regime_change(run) is None
    run = noise(600, 1)
    run[:250] += 3.0
    change = regime_change(run)
    assert change is not None
    assert abs(change.at - 250) <= 600 / 64


def test_the_statistic_is_that_of_equation_4() -> None:
    means = noise(16, 3)
    b, deviations = 16, means - means.mean(axis=0)
    values = []
    for k in range(1, b):
        first, last = means[:k], means[k:]
        before = np.cumsum(first - first.mean(axis=0), axis=0)
        after = np.cumsum((last - last.mean(axis=0))[::-1], axis=0)
        scale = ((before**2).sum(axis=0) + (after**2).sum(axis=0)) / b
        values.append(deviations[:k].sum(axis=0) ** 2 / scale)
    exact, places = np.max(values, axis=0), np.argmax(values, axis=0) + 1
    found, at = _statistic(means, np.ones(b, dtype=bool))
    assert (at == places).all()
    pairs = zip(places, means.T, strict=True)
    levels = [np.repeat([m[:k].mean(), m[k:].mean()], [k, b - k]) for k, m in pairs]
    rest = means - np.transpose(levels)  # what neighbouring parts have in common besides the change
    alike = np.maximum((rest[1:] * rest[:-1]).sum(axis=0) / (rest**2).sum(axis=0), 0.0)
    assert found == pytest.approx(exact * (1.0 - alike) / (1.0 + alike), rel=1e-10)


def test_chaos_of_impacts_that_lasts_does_not_change() -> None:
    attractor = ImpactChain(frequency=1.346).attractor(impacts=2000)
    assert regime_change(attractor.states) is None
    spectrum = LyapunovSpectrum(attractor, iterations=2000)
    assert spectrum.change is None
    assert POD(attractor).change is None


def test_periodic_motions_and_tori_do_not_change() -> None:
    angle = np.arange(3000) * (np.sqrt(5.0) - 1.0) * np.pi
    assert regime_change(np.column_stack([np.sin(angle), np.cos(angle)])) is None
    assert regime_change(np.tile([[1.0], [2.0], [4.0]], (400, 1))) is None
    assert regime_change(np.full((400, 2), 0.3)) is None


@pytest.mark.parametrize("period", [1, 2, 3])
def test_chaos_of_few_values_does_not_become_periodic(period: int) -> None:
    # between rare events such an observable is constant or periodic for 100 states and more
    random = np.random.default_rng(0)
    runs = (random.uniform(size=(1000, 2000)) < 0.01) + 0.1 * (np.arange(1000) % period)[:, None]
    alarms = sum(regime_change(run[:, None]) is not None for run in runs.T)
    assert alarms <= FalseAlarms(2000, 0).most


def test_a_burst_between_periodic_motions_hides_no_change() -> None:
    column = np.tile([1.0, 2.0, 4.0, 3.0], 375)
    column[450:650] = np.random.default_rng(0).uniform(1.0, 4.0, 200)
    change = regime_change(column[:, None])
    assert change is not None
    assert change.periodic
    assert abs(change.at - 650) <= 4


@pytest.mark.parametrize("lasting", [500, 1000, 3000, 6000])
def test_a_burst_between_rests_hides_no_change(lasting: int) -> None:
    column = np.full(2000 + lasting, 0.3)
    column[1000:2000] = noise(1000, 1)[:, 0]
    change = regime_change(column[:, None])
    assert change is not None
    assert change.periodic
    assert change.at == 2000


@pytest.mark.parametrize("lasting", [150, 299, 500])
def test_bursts_between_many_rests_are_no_change(lasting: int) -> None:
    parts = [part for k in range(10) for part in (np.full(300, 0.3), noise(300, 10)[:, k])]
    assert regime_change(np.concatenate([*parts, np.full(lasting, 0.3)])[:, None]) is None


class Compared(np.ndarray):
    """Numbers that count how many of them are subtracted."""

    count = 0

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        found = getattr(ufunc, method)(*map(np.asarray, inputs), **options)
        if ufunc is np.subtract:
            Compared.count += found.size
        return found.view(Compared) if isinstance(found, np.ndarray) else found


def test_chaos_of_two_values_compares_few_numbers_for_each_period(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # logarithms of a skew tent map: the last value recurs after half of all candidate periods
    monkeypatch.setattr(Compared, "count", 0)
    n = 6000
    column = np.where(np.random.default_rng(0).uniform(size=n) < 0.4, np.log(2.5), -np.log(0.6))
    assert _periodic_from(column.view(Compared)) is None
    assert Compared.count <= 100 * n


def test_a_column_that_is_periodic_throughout_hides_no_change() -> None:
    states = Switched(1500, 3.2).iterate(np.array([0.3, 0.0]), 3000)[:, 0]
    driver = np.arange(3001.0) % 3.0
    change = regime_change(np.column_stack([driver, states]))
    assert change == regime_change(states[:, None])
    assert change is not None
    assert change.periodic
    assert regime_change(driver[:, None]) is None


def test_few_states_show_no_change() -> None:
    assert regime_change(np.repeat([[0.0], [1.0]], 60, axis=0)) is None


def test_a_decomposition_covers_the_powers_before_and_after() -> None:
    random = np.random.default_rng(0)
    for seed in range(20):
        states = random.normal(size=(2000, 2)) * [2.0, 1.0]
        at = int(random.uniform(400, 1600))
        states[at:] *= random.uniform(0.2, 0.5)
        states[at:, 0] += random.uniform(4.0, 6.0)
        pod = POD(Recorded(states))
        after = np.linalg.eigvalsh(states[at:].T @ states[at:] / (2000 - at))[::-1]
        assert (abs(pod.power - after) <= 2.0 * pod.standard_errors).all(), seed
        assert pod.change is not None
        assert str(pod.change) in repr(pod)
    assert pod.plot().get_title() == str(pod.change)
    plt.close("all")


def test_the_powers_of_an_impact_motion_that_settles_are_covered() -> None:
    system = ImpactChain(frequency=0.87)
    start = system.state()
    whole = system.attractor(transient=0, impacts=600, start=start)
    pod, settled = POD(whole), POD(system.attractor(transient=2000, impacts=300))
    if pod.change is not None:
        assert (abs(pod.power - settled.power) <= 2.0 * pod.standard_errors).all()
    assert settled.change is None


def test_a_dimension_names_its_doubt() -> None:
    steady = CorrelationDimension(MapAttractor(Henon(), np.array([0.1, 0.1]), 100, 2000))
    assert steady.change is None
    assert "regime" not in repr(steady)
    switching = CorrelationDimension(
        MapAttractor(Switched(1000, 3.2), np.array([0.3, 0.0]), 0, 2000)
    )
    assert switching.change is not None
    assert switching.error > 0.1


def test_a_spectrum_names_its_doubt() -> None:
    noise = np.random.default_rng(0).normal(size=4096)
    steady = PowerSpectrum(noise, 1.0)
    assert steady.change is None
    switching = PowerSpectrum(np.where(np.arange(4096) < 2000, noise, 0.1 * noise), 1.0)
    assert switching.change is not None
    assert abs(switching.change.at - 2000) <= 4096 / 16
    assert str(switching.change) in repr(switching)


@pytest.mark.parametrize("seed", range(20))
def test_errors_of_a_spectrum_cover_the_densities_before_and_after(seed: int) -> None:
    random = np.random.default_rng(seed)
    at = int(random.uniform(0.3, 0.7) * 4096)
    powers = 10.0 ** random.uniform(-2.0, 2.0, size=2)
    if abs(np.log(powers[1] / powers[0])) < 1.0:
        powers[1] *= 10.0
    values = random.normal(size=4096) * np.repeat(np.sqrt(powers), [at, 4096 - at])
    spectrum = PowerSpectrum(values, 1.0)
    assert spectrum.change is not None
    # of independent values: the variance over the axis from 0 to pi; the ends have half as much
    before, after = powers / np.pi
    error = spectrum.error * (at * before + (4096 - at) * after) / 4096
    for density in (before, after):
        assert (abs(spectrum.density[2:-2] - density) <= 2.0 * error).mean() >= 0.95


def test_a_regime_shorter_than_a_segment_makes_the_error_infinite() -> None:
    values = noise(4096, 1)[:, 0] * np.repeat([0.1, 1.0], [500, 3596])
    spectrum = PowerSpectrum(values, 1.0)  # of segments of 910
    assert spectrum.change is not None
    assert spectrum.error == np.inf
