"""Exponents of motions that rounding moves, repeats or seems to settle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynkit.analysis import LyapunovSpectrum
from dynkit.analysis.regimes import regime_change
from dynkit.core.validation import Array
from dynkit.dynamics.map import Map
from dynkit.systems import Logistic

RATE = 3.9296875
"""A number of ten bits: products with it and with numbers of 20 bits are exact."""


@dataclass(frozen=True)
class Rounded(Map):
    """The logistic map, with states of 20 binary places: its motions soon repeat themselves."""

    dimension = 1

    def __call__(self, state: Array) -> Array:
        return np.asarray(np.rint(2.0**20 * RATE * state * (1.0 - state)) / 2.0**20)

    def jacobian(self, state: Array) -> Array:
        return np.array([[RATE * (1.0 - 2.0 * state[0])]])


@dataclass(frozen=True)
class Away(Map):
    """x -> 1 - a x^2, where x is measured from a distant origin."""

    a: float
    origin: float
    dimension = 1

    def __call__(self, state: Array) -> Array:
        return np.asarray(self.origin + 1.0 - self.a * (state - self.origin) ** 2)

    def jacobian(self, state: Array) -> Array:
        return np.array([[-2.0 * self.a * (state[0] - self.origin)]])


@dataclass(frozen=True)
class SkewTent(Map):
    """A tent with its peak at 1/100, whose motion grows slowly for hundreds of iterates."""

    dimension = 1

    def __call__(self, state: Array) -> Array:
        return np.where(state < 0.01, state / 0.01, (1.0 - state) / 0.99)

    def jacobian(self, state: Array) -> Array:
        return np.array([[100.0 if state[0] < 0.01 else -1.0 / 0.99]])


def test_chaos_that_rounding_repeats_is_averaged_over_different_states() -> None:
    exact = LyapunovSpectrum.of_map(Logistic(rate=RATE), [0.3], iterations=200_000)
    for start in np.random.default_rng(0).uniform(0.1, 0.9, 5):
        found = LyapunovSpectrum.of_map(Rounded(), [start], iterations=20_000)
        error = np.hypot(exact.error, found.error)
        assert (abs(found.exponents - exact.exponents) < 3.0 * error).all()
        assert found.error[0] > 1e-3


def test_an_unstable_orbit_of_few_states_has_its_own_exponent() -> None:
    found = LyapunovSpectrum.of_map(Logistic(rate=4.0), [0.75], iterations=1000)
    assert abs(found.exponents[0] - np.log(2.0)) <= found.error[0] < 1e-13


def test_the_error_of_a_periodic_motion_covers_the_rounding_of_its_states() -> None:
    random = np.random.default_rng(0)
    exceeded = 0
    for _ in range(100):
        a, origin = random.uniform(0.8, 1.2), 10.0 ** random.uniform(-1.0, 5.0)
        found = LyapunovSpectrum.of_map(Away(a, origin), [origin + 0.1], iterations=1000)
        exact = 0.5 * np.log(abs(4.0 - 4.0 * a))  # of P(2)
        exceeded += abs(found.exponents[0] - exact) > found.error[0]
    assert exceeded <= 1


def test_a_laminar_phase_at_the_end_is_no_settled_motion() -> None:
    for start in np.random.default_rng(0).uniform(0.1, 0.9, 20):
        found = LyapunovSpectrum.of_map(SkewTent(), [start], iterations=2000)
        assert found.change is None or not found.change.periodic


def test_a_periodic_end_with_growth_is_not_called_periodic() -> None:
    noise = np.random.default_rng(0).normal(size=(2000, 2))
    noise[-200:] = 0.1, -3.0
    grows, settles = regime_change(noise, growths=2), regime_change(noise)
    assert grows is not None
    assert not grows.periodic
    assert settles is not None
    assert settles.periodic
