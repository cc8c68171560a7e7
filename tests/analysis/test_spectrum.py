"""Power spectra: Parseval, lines, statistical error, the table's harmonics."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy import signal

from dynkit.analysis import PowerSpectrum
from dynkit.core.validation import Array
from dynkit.dynamics.attractor import MapAttractor
from dynkit.plotting.figures import new_figure
from dynkit.systems import Henon, ImpactChain, Logistic
from dynkit.systems.impact.oscillators.attractor import ImpactAttractor


def attractor_of(frequency: float = 0.87) -> ImpactAttractor:
    return ImpactChain(frequency=frequency).attractor()


def noise(count: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(size=count)


# --- Parseval -------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1000, 1001])
def test_density_of_a_periodogram_sums_up_to_the_windowed_mean_square(count: int) -> None:
    x, window = noise(count), signal.get_window("hann", count)
    spectrum = PowerSpectrum(x, interval=0.3, segments=1)
    # Parseval's theorem for the windowed samples less their mean
    expected = ((window * (x - x.mean())) ** 2).sum() / (window**2).sum()
    total = spectrum.density.sum() * spectrum.frequencies[1]
    assert total == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("segments", [1, 3, 8])
@pytest.mark.parametrize("count", [1000, 1007, 1013])
def test_density_is_that_of_welch(count: int, segments: int) -> None:
    x = np.cumsum(noise(count))
    spectrum = PowerSpectrum(x, interval=0.3, segments=segments)
    length = round(2.0 * np.pi / (0.3 * spectrum.frequencies[1]))
    used = x[:length] if segments == 1 else x
    _, expected = signal.welch(used, 1.0 / 0.3, window="hann", nperseg=length)
    np.testing.assert_allclose(spectrum.density, expected / (2.0 * np.pi), rtol=1e-11)


def test_density_of_white_noise_sums_up_to_its_variance() -> None:
    x = noise(1 << 16)
    spectrum = PowerSpectrum(x, interval=0.3, segments=64)
    # Each of the 64 segments has 2^17 / 65 = 2016 samples: the mean of their windowed squares
    # scatters by less than sqrt(2 * 35 / 18 / 2^16), 35 / 18 the fourth moment of the window over
    # the square of the second; four times that.
    limit = 4.0 * np.sqrt(2.0 * 35.0 / 18.0 / len(x))
    assert spectrum.power(0.0, spectrum.nyquist) == pytest.approx(spectrum.variance, rel=limit)


def test_density_of_white_noise_is_level() -> None:
    spectrum = PowerSpectrum(noise(1 << 16), interval=0.3, segments=64)
    # variance 1 over the axis from 0 to pi / interval
    deviation = spectrum.density[2:-2] / (spectrum.interval / np.pi) - 1.0
    # a thousand densities, chi-square with 64 and more degrees of freedom: six standard errors
    assert abs(deviation).max() < 6.0 * spectrum.error


@pytest.mark.parametrize("segments", [1, 4, 16])
def test_error_is_the_scatter_of_densities_of_white_noise(segments: int) -> None:
    spectra = [PowerSpectrum(noise(1024, k), interval=1.0, segments=segments) for k in range(200)]
    inner = np.array([s.density[2:-2] for s in spectra])
    scatter = inner.std(axis=0) / inner.mean(axis=0)
    # The mean over dozens of frequencies of a scatter that 200 draws tell to 10% at most.
    assert np.mean(scatter) == pytest.approx(spectra[0].error, rel=0.1)


# --- lines ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("segments", [1, 8])
@pytest.mark.parametrize("frequency", [0.5, 1.0, 1.7])
def test_line_of_a_sine_is_where_it_should_be(frequency: float, segments: int) -> None:
    t = 0.5 * np.arange(8192)
    spectrum = PowerSpectrum(3.0 * np.sin(frequency * t + 0.3), interval=0.5, segments=segments)
    found = spectrum.frequencies[np.argmax(spectrum.density)]
    assert abs(found - frequency) <= 0.5 * spectrum.frequencies[1] * (1.0 + 1e-9)


@pytest.mark.parametrize("segments", [1, 8])
def test_line_of_a_sine_has_half_the_square_of_its_amplitude(segments: int) -> None:
    # periods that divide the segments: Hann's line has three densities and no more
    length = 8192 if segments == 1 else 2 * 8192 // 9
    frequency = 2.0 * np.pi * 40 / (0.5 * length)
    x = 3.0 * np.sin(frequency * 0.5 * np.arange(8192) + 0.3)
    spectrum = PowerSpectrum(x, interval=0.5, segments=segments)
    near = 2.5 * spectrum.frequencies[1]
    assert spectrum.power(frequency - near, frequency + near) == pytest.approx(4.5, rel=1e-12)


def test_resolution_is_the_width_of_a_line() -> None:
    # a line's power over its highest density
    x = np.sin(2.0 * np.pi * 100 / 4096 * np.arange(4096))
    spectrum = PowerSpectrum(x, interval=1.0, segments=1)
    assert 0.5 / spectrum.density.max() == pytest.approx(spectrum.resolution, rel=1e-12)


def test_mean_is_no_part_of_the_power() -> None:
    x = noise(4096)
    near, far = (PowerSpectrum(x + shift, interval=1.0) for shift in (0.0, 5.0))
    assert far.density == pytest.approx(near.density, rel=1e-9, abs=1e-12)


# --- attractors -----------------------------------------------------------------------------------


def test_periodic_motion_has_lines_at_parts_of_the_table_frequency_alone() -> None:
    spectrum = PowerSpectrum(attractor_of())  # P(1,3)
    lines = spectrum.frequencies / (0.87 / 3.0)
    away = abs(lines - np.rint(lines)) * (0.87 / 3.0) > 3.0 * spectrum.resolution
    # beyond the line of Hann's window sidelobes fall below a thousandth of its height
    assert spectrum.density[away].max() < 1e-3 * spectrum.density.max()


def test_default_axis_reaches_twice_the_highest_natural_frequency() -> None:
    spectrum = PowerSpectrum(attractor_of())
    highest = attractor_of().system.natural_frequencies[-1]
    assert 2.0 * highest <= spectrum.nyquist < 2.0 * highest + 0.87 / 2.0


def test_harmonics_are_on_the_axis() -> None:
    spectrum = PowerSpectrum(attractor_of())
    steps = spectrum.harmonics / spectrum.frequencies[1]
    assert steps == pytest.approx(np.rint(steps), rel=1e-12)


def test_harmonics_are_multiples_of_the_table_frequency_up_to_nyquist() -> None:
    spectrum = PowerSpectrum(attractor_of(), interval=1.0)
    assert spectrum.harmonics == pytest.approx([0.87, 1.74, 2.61], rel=1e-15)


def test_samples_are_those_of_the_coordinate() -> None:
    attractor = attractor_of(0.35)
    found = PowerSpectrum(attractor, 0.7, coordinate=2, samples=500, segments=1)
    # sixteen times as fine as the axis asks for
    values = attractor.time_series(0.7 / 16 * np.arange(8000, dtype=np.float64))[:, 2]
    finer = PowerSpectrum(values, 0.7 / 16, segments=1)
    m = len(found.density)
    assert found.density == pytest.approx(finer.density[:m], rel=1e-12, abs=0.0)
    assert found.frequencies[-1] <= np.pi / 0.7 * (1.0 + 1e-12) < finer.frequencies[m]


@pytest.mark.parametrize("k", [1, 2, 3, 7, 12])
def test_lines_of_a_periodic_motion_are_its_fourier_coefficients(k: int) -> None:
    attractor = ImpactChain(frequency=0.87).attractor(transient=5000)  # P(1,3)
    spectrum = PowerSpectrum(attractor)
    period = 3.0 * 2.0 * np.pi / 0.87
    x = attractor.time_series(period / 2**14 * np.arange(2**14, dtype=np.float64))[:, 9]
    amplitudes = abs(np.fft.rfft(x)) / len(x)
    # The samples of a period fold amplitudes back onto k, from k + j times their number.
    number = round(16.0 * period / spectrum.interval)
    folded = np.concatenate([amplitudes[k + number :: number], amplitudes[number - k :: number]])
    limit = 4.0 * amplitudes[k] * folded.sum() + 2.0 * folded.sum() ** 2
    w, near = 0.29 * k, 3.0 * spectrum.frequencies[1]
    assert abs(spectrum.power(w - near, w + near) - 2.0 * amplitudes[k] ** 2) < limit
    assert limit < 0.01 * 2.0 * amplitudes[k] ** 2


def test_chaos_is_broad_band_and_periodic_motion_is_not() -> None:
    # flatness: geometric over arithmetic mean
    flatness = [
        np.exp(np.log(s.density[1:]).mean()) / s.density[1:].mean()
        for s in (PowerSpectrum(attractor_of(w)) for w in (0.35, 0.87))
    ]
    assert flatness[0] > 100.0 * flatness[1]


def test_map_has_a_spectrum_over_iterates() -> None:
    attractor = MapAttractor(Henon(), np.zeros(2), transient=100, iterations=50)
    spectrum = PowerSpectrum(attractor, 1.0, samples=2048)
    assert spectrum.nyquist == np.pi
    assert len(spectrum.harmonics) == 0


def test_cost_counts_the_samples() -> None:
    assert PowerSpectrum(attractor_of(), samples=512).cost.counts == {"samples": 16 * 512}


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({}, "interval must be given with an array"),
        ({"interval": 0.0}, "interval must be positive; got 0.0"),
        ({"interval": 1.0, "segments": 0}, "segments must be a positive integer; got 0"),
        ({"interval": 1.0, "segments": 40}, "segments must have 8 samples or more each; got 4"),
        ({"interval": 1.0, "coordinate": 1}, "coordinate must be left out with an array; got 1"),
        ({"interval": 1.0, "samples": 9}, "samples must be left out with an array; got 9"),
    ],
)
def test_bad_choices_are_refused(choices: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        PowerSpectrum(noise(100), **choices)


def test_ends_of_a_level_spectrum_have_parts_of_its_density() -> None:
    spectrum = PowerSpectrum(noise(1 << 20), interval=0.3, segments=4095)
    parts = spectrum.density * np.pi / 0.3
    # one standard error of a density is 1.3 %, at both ends 1.9 % of the part
    assert parts[[0, 1, 2, -2, -1]] == pytest.approx([1 / 6, 5 / 6, 1.0, 1.0, 0.5], rel=0.06)


@pytest.mark.parametrize("count", [1000, 1001, 1007])
def test_powers_of_adjacent_bands_add_up(count: int) -> None:
    spectrum = PowerSpectrum(noise(count), interval=0.3)
    limits = np.append(0.0, np.sort(np.random.default_rng(0).uniform(0.0, np.pi / 0.3, 500)))
    limits = np.append(limits, spectrum.nyquist)
    powers = [spectrum.power(a, b) for a, b in pairwise(limits)]
    total = spectrum.density.sum() * spectrum.frequencies[1]
    assert sum(powers) == pytest.approx(total, rel=1e-12)
    step = float(spectrum.frequencies[1])
    narrow = spectrum.power(7.1 * step, 7.3 * step)
    assert narrow == pytest.approx(0.2 * step * spectrum.density[7], rel=1e-12)


def test_values_whose_squares_underflow_are_refused() -> None:
    message = "source must be zero, or at least 1e-145 in size; got 1e-200"
    with pytest.raises(ValueError, match=message):
        PowerSpectrum(1e-200 * np.sign(noise(100)), 1.0)


def test_values_whose_squares_overflow_are_refused() -> None:
    with pytest.raises(
        ValueError, match=re.escape("source must not exceed 1e+145 in size; got 1e")
    ):
        PowerSpectrum(1e200 * np.sign(noise(100)), 1.0)
    slow = MapAttractor(Logistic(rate=0.5), np.array([1e-170]), 0, 100)
    with pytest.raises(ValueError, match="source must be zero, or at least 1e-145 in size; got 1e"):
        _ = PowerSpectrum(slow, 1.0, samples=50).density


def test_unknown_coordinate_is_refused() -> None:
    with pytest.raises(ValueError, match=re.escape("coordinate must lie in [-20, 19]; got 20")):
        PowerSpectrum(attractor_of(), coordinate=20)


def test_map_needs_an_interval() -> None:
    attractor = MapAttractor(Henon(), np.zeros(2), transient=100, iterations=50)
    with pytest.raises(ValueError, match="interval must be given: the source has no natural"):
        PowerSpectrum(attractor)


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.0), (2.0, 1.0)])
def test_band_must_be_in_order(low: float, high: float) -> None:
    with pytest.raises(ValueError, match=f"high must exceed low = {low}; got {high}"):
        PowerSpectrum(noise(100), 1.0).power(low, high)


# --- figure ---------------------------------------------------------------------------------------


def test_density_and_harmonics_are_drawn() -> None:
    spectrum = PowerSpectrum(attractor_of())
    _, (axes,) = new_figure()
    assert spectrum.plot(axes) is axes
    *marks, density, lines = axes.lines
    assert [np.asarray(line.get_xdata())[0] for line in marks] == spectrum.harmonics.tolist()
    assert np.array_equal(density.get_ydata(), spectrum.density[1:])
    assert spectrum.lines is not None
    at = np.asarray(lines.get_xdata())
    assert np.array_equal(at, spectrum.lines.frequencies[: len(at)])
    assert axes.get_yscale() == "log"
    assert axes.get_xlabel() == r"angular frequency $\omega$"


def test_at_most_twelve_decades_are_drawn() -> None:
    _, (axes,) = new_figure()
    t = 0.1 * np.arange(4000)
    spectrum = PowerSpectrum(np.sin(2.0 * np.pi * t), interval=0.1, segments=1)
    spectrum.plot(axes)
    assert axes.get_ylim()[0] == pytest.approx(1e-12 * spectrum.density.max(), rel=1e-9)


# --- lines ----------------------------------------------------------------------------------------


def test_lines_are_harmonics_of_a_part_of_the_table_frequency() -> None:
    lines = PowerSpectrum(attractor_of(0.87)).lines  # P(1,3)
    assert lines is not None
    assert lines.frequency == pytest.approx(0.29, rel=1e-15)


def test_lines_hold_the_variance_of_a_periodic_motion() -> None:
    spectrum = PowerSpectrum(ImpactChain(frequency=0.87).attractor(transient=5000))
    assert spectrum.lines is not None
    assert spectrum.lines.variance == pytest.approx(spectrum.variance, rel=1e-3)


def test_lines_of_a_velocity_are_those_of_the_displacement_times_frequency() -> None:
    attractor = ImpactChain(frequency=0.40816).attractor(transient=8000)  # P(inf,2)
    moved, moves = (PowerSpectrum(attractor, coordinate=k).lines for k in (3, 13))
    assert moved is not None
    assert moves is not None
    few = slice(0, 12)
    exact = moved.frequencies[few] * abs(moved.coefficients[few])
    assert abs(moves.coefficients[few]) == pytest.approx(exact, rel=1e-3)


def test_chaos_has_no_lines() -> None:
    assert PowerSpectrum(attractor_of(1.346)).lines is None


def test_array_has_no_lines() -> None:
    assert PowerSpectrum(np.arange(100.0), interval=0.2).lines is None


def test_lines_stand_on_the_peaks_of_the_density() -> None:
    period = 3 * 16  # samples in a period of P(1,3)
    interval = 2.0 * np.pi / (0.87 * 16)
    attractor = ImpactChain(frequency=0.87).attractor(transient=5000)
    spectrum = PowerSpectrum(attractor, interval, samples=20 * period, segments=1)
    _, (axes,) = new_figure()
    spectrum.plot(axes)
    dots = next(line for line in axes.lines if line.get_marker() == "o")
    at, heights = np.asarray(dots.get_xydata()).T
    peaks = np.interp(at, spectrum.frequencies, spectrum.density)
    assert heights[:10] == pytest.approx(peaks[:10], rel=2e-2)


def test_a_spectrum_of_constant_samples_is_drawn() -> None:
    axes = PowerSpectrum(np.ones(100), 1.0).plot(new_figure()[1][0])
    assert axes.get_yscale() == "linear"
