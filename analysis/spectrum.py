"""Power spectra of motions."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, ClassVar, NamedTuple, final

import numpy as np

from dynkit.analysis.motions import Motion
from dynkit.analysis.regimes import RegimeChange, regime_change
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.validation import (
    Array,
    finite_array,
    non_negative,
    positive,
    positive_integer,
    read_only,
    with_squares_in_range,
)
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.orbits.harmonics import Harmonics, harmonics_of
from dynkit.plotting.figures import DOTS, ink, print_style, shown_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# End of the default frequency axis, relative to the highest natural frequency: positions have kinks
# at impacts, so that their spectra fall only with the fourth power of the frequency.
_REACH = 2.0

# Default number of intervals of an attractor.
_SAMPLES = 16384

# When the table's period is a multiple of the interval, aliased lines coincide with other lines.
# Their amplitudes, which fall only with the square of the frequency, are then added. Therefore
# motions are sampled _FINER times as finely as the axis requires, _CHUNK samples at a time.
_FINER, _CHUNK = 16, 1 << 15

# Number of values in a gigabyte.
_MOST = 1 << 27

# Smallest drawn density relative to the largest.
_FAINTEST = 1e-12


@final
class PowerSpectrum(Saved):
    """Power spectral density of one coordinate: mean square about the mean per angular frequency.

    The estimate is Welch's: the mean of the periodograms of half-overlapping segments, each after
    subtraction of its mean and with a Hann window. Densities are one-sided: their integral over all
    positive frequencies is the variance.

    Parameters
    ----------
    source : Attractor, ImpactRecord or (k,) array_like
        An attractor is sampled exactly; an array contains values at equal intervals.
    interval : float, optional
        Time between samples; required for an array. For an attractor the default is the largest
        fraction 1/p of the table's period for which the axis reaches twice the highest natural
        frequency. So it is half of the chain's Nyquist interval, and the table's harmonics are on
        the grid of frequencies. Impact attractors are sampled 16 times as finely to reduce
        aliasing.
    coordinate : int, optional
        As for `TimeSeries`.
    samples : int, optional
        Number of intervals of an attractor, from the last skipped state on; by default 16384.
    segments : int
        Number of segments; 1 gives the periodogram. With the default interval each segment lasts a
        whole number of table periods.

    Attributes
    ----------
    interval : float
        Time between samples.
    segments : int
    table_frequency : float or None
    name : str
        Axis title of the coordinate.

    Raises
    ------
    ValueError
        When a number is not finite or not positive, or there are fewer than 8 samples per segment.
        For an attractor, also when the samples do not fit into a gigabyte, or there is no default
        interval.

    References
    ----------
    P. D. Welch, IEEE Transactions on Audio and Electroacoustics 15 (1967) 70-73, equations 5 and
    16.

    Examples
    --------
    >>> t = 0.1 * np.arange(4000)
    >>> spectrum = PowerSpectrum(3.0 * np.cos(2.0 * t), interval=0.1)
    >>> round(spectrum.power(1.5, 2.5), 2)  # half the square of the amplitude
    4.5
    """

    _stored: ClassVar = (
        *("interval", "segments", "name", "table_frequency", "_count", "_finer", "_length"),
        *("_step", "change", "error", "_estimate", "variance", "cost", "lines"),
    )
    interval: float
    segments: int
    name: str
    table_frequency: float | None
    _count: int
    _finer: int
    _length: int
    _step: float

    def __init__(
        self,
        source: object,
        interval: float | None = None,
        *,
        coordinate: int | None = None,
        samples: int | None = None,
        segments: int = 8,
    ) -> None:
        motion = self._motion = Motion.of(source)
        self.name, self.table_frequency, self._finer, multiple = "values", None, 1, 1
        step = None if interval is None else positive("interval", interval)
        if motion is not None:
            axis = axis_of(motion, coordinate, step)
            self._coordinate, self.name, self.table_frequency = axis[:3]
            self._finer, step, multiple = axis[3:]
            self._count = positive_integer("samples", _SAMPLES if samples is None else samples)
            if self._count > (most := _MOST // self._finer):
                raise ValueError(f"samples must not exceed {most}; got {self._count}")
        else:
            if step is None:
                raise ValueError("interval must be given with an array")
            for name, value in (("coordinate", coordinate), ("samples", samples)):
                if value is not None:
                    raise ValueError(f"{name} must be left out with an array; got {value!r}")
            given = finite_array("source", source, (None,)).copy()
            self._given = with_squares_in_range("source", given)
            self._count = len(self._given)
        self.interval = step
        length, self.segments = _divided(
            self._count, positive_integer("segments", segments), multiple
        )
        self._length, self._step = self._finer * length, step / self._finer

    def __repr__(self) -> str:
        samples = f"{self._count} samples {self.interval:.6g} apart in {self.segments} segments"
        known = {"_samples", "change"} & vars(self).keys()
        doubt = f"; {self.change}" if known and self.change is not None else ""
        return f"<PowerSpectrum: {samples}, resolution {self.resolution:.3g}{doubt}>"

    @cached_property
    def change(self) -> RegimeChange | None:
        """The change of regime of the samples or their squares; None where none is detected.

        The spectrum then belongs to no regime, and `error` covers those before and after. A
        transient longer than the run looks like sustained chaos: see
        `dynkit.analysis.regimes.regime_change`.
        """
        values = self._samples[0][:: self._finer]
        return regime_change(np.column_stack([values, values**2]))

    @cached_property
    def _window(self) -> Array:
        turn = np.linspace(-math.pi, math.pi, self._length, endpoint=False)
        return np.asarray(0.5 + 0.5 * np.cos(turn))

    @cached_property
    def resolution(self) -> float:
        """Width of a line, in angular frequency: the noise bandwidth of the window."""
        w = self._window
        return math.tau * float(w @ w) / (float(w.sum()) ** 2 * self._step)

    @cached_property
    def error(self) -> float:
        """Relative standard error of a density of a motion without lines.

        One standard error covers about 68 %, and is not a bound. It follows from the number of
        segments and their overlap, and is near 1 for a periodogram. The power of a line of a
        periodic motion has no such error. It does not cover that a density is an average over a
        `resolution`. Nor does it hold at both ends: of a level spectrum the density at frequency
        zero is one sixth, the next one five sixths, and a last one at `nyquist` of an array one
        half, because means are subtracted, and intervals at the ends are half as wide. Aliasing is
        not included: for an array it comes from frequencies above `nyquist`, for an impact
        attractor from those above 16 times that. It changes the lines of the chain's P(1,3) at
        frequency 0.87 by 0.04 % (the lowest) to 0.4 % (near twice the highest natural frequency).

        Where the samples change their regime (`change`), the error is increased by the largest
        relative difference to the densities before and after. It is infinite when one of these
        regimes is shorter than a segment, and for a stream.
        """
        w, k, half = self._window, self.segments, self._length // 2
        overlap = (float(w[half:] @ w[: self._length - half]) / float(w @ w)) ** 2
        scatter = math.sqrt((1.0 + 2.0 * overlap * (k - 1) / k) / k)
        if self.change is None:
            return scatter
        values, at = self._samples[0], self._finer * self.change.at
        if min(at, len(values) - at) < self._length:
            return math.inf
        # leave out the density at frequency zero, which subtraction of means removes
        whole = self.density[1:]
        regimes = [self._density(part)[1 : len(whole) + 1] for part in (values[:at], values[at:])]
        apart = [abs(regime - whole)[whole > 0.0] / whole[whole > 0.0] for regime in regimes]
        return scatter + float(np.max(apart, initial=0.0))

    @cached_property
    def _samples(self) -> tuple[Array, float]:
        """Values, (k,), and the seconds of their computation."""
        if self._motion is None:
            return self._given, 0.0
        began = time.perf_counter()
        values = np.empty(self._finer * self._count)
        for low in range(0, len(values), _CHUNK):  # all samples of all coordinates might not fit
            part = values[low : low + _CHUNK]
            times = self._step * np.arange(low, low + len(part), dtype=np.float64)
            part[:] = self._motion.attractor.time_series(times)[:, self._coordinate]
        return with_squares_in_range("source", values), time.perf_counter() - began

    @cached_property
    def _estimate(self) -> tuple[Array, Array, float]:
        """Angular frequencies, densities, and the seconds of their computation."""
        values, _ = self._samples
        began = time.perf_counter()
        frequencies = self._axis
        used = values[: self._length] if self.segments == 1 else values
        density = self._density(used)[: len(frequencies)]
        return frequencies, read_only(density), time.perf_counter() - began

    @property
    def _axis(self) -> Array:
        every = np.asarray(math.tau * np.fft.rfftfreq(self._length, self._step), np.float64)
        return read_only(every[every <= self.nyquist * (1.0 + 2.0**-40)])

    def _density(self, values: Array) -> Array:
        """Return Welch's densities, also at frequencies beyond the axis."""
        n, w = self._length, self._window
        parts = np.lib.stride_tricks.sliding_window_view(values, n)[:: n - n // 2]
        lines = np.fft.rfft(w * (parts - parts.mean(axis=1, keepdims=True)))
        density = (abs(lines) ** 2).mean(axis=0) * (self._step / (math.pi * float(w @ w)))
        density[[0, -1] if n % 2 == 0 else 0] /= 2.0  # all others include the negative frequency
        return np.asarray(density)

    @property
    def frequencies(self) -> Array:
        """Angular frequencies, (m,), from 0 to `nyquist` at most."""
        return self._estimate[0]

    @property
    def density(self) -> Array:
        """Power spectral density, (m,), per unit of angular frequency."""
        return self._estimate[1]

    @cached_property
    def variance(self) -> float:
        """Variance of the samples."""
        return float(np.var(self._samples[0]))

    @cached_property
    def cost(self) -> Cost:
        """Seconds and samples."""
        seconds = self._samples[1] + self._estimate[2]
        return Cost(seconds, {"samples": self._finer * self._count})

    @property
    def nyquist(self) -> float:
        """End of the axis: the Nyquist frequency of samples an `interval` apart."""
        return math.pi / self.interval

    @property
    def harmonics(self) -> Array:
        """Harmonics of the table up to `nyquist`; none for an array."""
        if self.table_frequency is None:
            return np.empty(0)
        count = math.floor(self.nyquist / self.table_frequency * (1.0 + 2.0**-40))
        return self.table_frequency * np.arange(1.0, count + 1.0)

    @cached_property
    def lines(self) -> Harmonics | None:
        """Lines of a periodic motion: the harmonics of 1/m of the table's frequency.

        They are computed from one period after the last skipped state, with the samples of the
        density. None where the attractor's label is not that of a periodic motion of m table
        periods, and for an array.
        """
        if self._motion is None or self.table_frequency is None:
            return None
        periods = self._motion.attractor.label.periods
        if periods is None:
            return None
        frequency = self.table_frequency / periods
        samples = math.ceil(math.tau / (frequency * self._step))
        times = np.linspace(0.0, math.tau / frequency, samples + 1)
        states = self._motion.attractor.time_series(times)
        return harmonics_of(states[:, self._coordinate], frequency)

    def dataset(self) -> Dataset:
        """Return the density as a dataset over the angular frequency."""
        return Dataset(
            {"frequency": ("frequency", self.frequencies)},
            {"density": ("frequency", self.density)},
            described(
                f"Power spectral density of {self.name}",
                cost=self.cost,
                error="relative standard error of a density of a motion without lines",
                relative_error=self.error,
                resolution=self.resolution,
                variance=self.variance,
            ),
        )

    def power(self, low: float, high: float) -> float:
        """Return the part of the variance between two angular frequencies.

        A density holds for the interval to the middles between its frequency and the neighbouring
        ones. A band contains a line, to 0.02 % of its power, when both limits are two `resolution`
        away or more.

        Parameters
        ----------
        low, high : float
            High must exceed low.

        Raises
        ------
        ValueError
            When a frequency is negative, or high does not exceed low.
        """
        first, last = non_negative("low", low), non_negative("high", high)
        if not first < last:
            raise ValueError(f"high must exceed low = {first}; got {last}")
        step = float(self.frequencies[1])
        edges = np.minimum(np.append(0.0, self.frequencies + 0.5 * step), self.nyquist)
        below = np.append(0.0, np.cumsum(self.density)) * step
        return float(np.diff(np.interp([first, last], edges, below))[0])

    @print_style()
    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the density, logarithmic, against the angular frequency, with the table's harmonics.

        The density of constant samples is zero, and its axis linear. Harmonics are grey lines, the
        table's frequency is a darker one. Dots are the `lines` of a periodic motion, at the height
        that a line of this power has in the density. The axis shows at most twelve decades.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.

        Returns
        -------
        Axes
        """
        axes = shown_axes(ax, height=1.8)
        for k, harmonic in enumerate(self.harmonics.tolist()):
            axes.axvline(harmonic, color=ink(0.8 if k else 0.5), linewidth=0.6, zorder=0)
        axes.plot(self.frequencies[1:], self.density[1:], color=ink(), linewidth=0.5)
        lines = self.lines
        if lines is not None:
            on = lines.frequencies <= self.nyquist
            heights = lines.power[on] / self.resolution
            axes.plot(lines.frequencies[on], heights, markersize=2.2, color=ink(), **DOTS)
        highest = float(self.density.max())
        if highest > 0.0:
            axes.set_yscale("log")
            axes.set_ylim(bottom=max(axes.get_ylim()[0], highest * _FAINTEST))
        axes.set_xlim(0.0, self.nyquist)
        axes.set(xlabel=r"angular frequency $\omega$", ylabel=f"power density of\n{self.name}")
        return axes


def _divided(count: int, asked: int, multiple: int) -> tuple[int, int]:
    """Return the number of samples per segment, if possible a multiple, and of segments."""
    length = count if asked == 1 else 2 * count // (asked + 1)
    if length >= multiple:
        length -= length % multiple
    if length < 8:
        raise ValueError(f"segments must have 8 samples or more each; got {length}")
    step = length - length // 2
    return length, 1 if asked == 1 else 1 + (count - length) // step


class Axis(NamedTuple):
    """Sampling of a motion.

    Parameters
    ----------
    coordinate : int
    name : str
    table_frequency : float or None
    finer : int
        Number of samples in an interval.
    interval : float
    multiple : int
        Number of intervals in a period of the table for the default interval; otherwise 1.
    """

    coordinate: int
    name: str
    table_frequency: float | None
    finer: int
    interval: float
    multiple: int


def axis_of(motion: Motion, coordinate: int | None, interval: float | None) -> Axis:
    """Return the sampling of a motion, with defaults for arguments that are None."""
    index, multiple = motion.coordinate(coordinate, motion.system.dimension), 1
    if interval is None:
        multiple = _samples_in_a_period(motion)
        interval = math.tau / (motion.forcing_frequency * multiple)
    finer = _FINER if hasattr(motion.attractor, "record") else 1
    return Axis(index, motion.name_of(index), motion.frequency, finer, interval, multiple)


def _samples_in_a_period(motion: Motion) -> int:
    """Return the number of samples per table period for the default end of the axis."""
    natural = getattr(motion.system, "natural_frequencies", None)
    if natural is None:
        raise ValueError("interval must be given: the source has no natural frequencies")
    w = motion.forcing_frequency
    return max(4, math.ceil(2.0 * _REACH * max(float(np.max(natural)), w) / w))
