"""Runs that change their regime, and runs that do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pytest

from dynkit import MapAttractor
from dynkit.analysis import POD, CorrelationDimension, LyapunovSpectrum, PowerSpectrum
from dynkit.analysis.regimes import regime_change
from dynkit.attractors import Attractor
from dynkit.labels import OrbitKind, OrbitLabel
from dynkit.maps import Map
from dynkit.results import Cost
from dynkit.systems import Henon, ImpactChain
from dynkit.validation import Array
from tests.analysis.test_averages import henon, impacts, logistic, lorenz

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


@pytest.mark.parametrize("make", [henon, logistic, lorenz, impacts])
def test_stationary_chaos_is_hardly_ever_said_to_change(make: Callable[[int], Array]) -> None:
    runs = make(300)
    alarms = sum(regime_change(run[:, None]) is not None for run in runs.T)
    assert alarms <= 0.01 * runs.shape[1]


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
