"""Measures that accumulate over the blocks of a stream, in bounded memory."""

from __future__ import annotations

import inspect
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, ClassVar, Literal, final, get_args

import numpy as np
from numpy.typing import NDArray

from dynkit.analysis.averages import LEAST, batch_errors
from dynkit.analysis.batches import Batches, Edges
from dynkit.analysis.dimension.coordinates import angles_of
from dynkit.analysis.dimension.counting import BLOCKS
from dynkit.analysis.dimension.dimension import CorrelationDimension
from dynkit.analysis.dimension.sums import Norm
from dynkit.analysis.histogram import Histogram
from dynkit.analysis.lyapunov import LyapunovSpectrum
from dynkit.analysis.motions import Motion, attractor_of
from dynkit.analysis.pod import POD
from dynkit.analysis.pod_averages import Averages, averages_over, with_squares
from dynkit.analysis.regimes import regime_change
from dynkit.analysis.spectrum import Axis, PowerSpectrum, axis_of
from dynkit.core.cost import Cost
from dynkit.core.overriding import Extensible
from dynkit.core.validation import (
    Array,
    finite_array,
    finite_scalar,
    non_negative_integer,
    of_type,
    one_of,
    positive,
    positive_integer,
    read_only,
    with_squares_in_range,
)
from dynkit.dynamics.attractor import Attractor

_BATCHES, _WATCHED, _ITERATES = 64, 4096, 2048
"""Largest numbers of batches: for errors, for tests of a change of regime, and for logarithms of
iterates."""

_FAR = 2.0**256
"""Values farther from zero than this, in units of a histogram's edges, count as this far in tests
of a change of regime."""

_CHUNK = 1 << 18
"""Number of samples in time that are computed together."""


class Running(Extensible, ABC):
    """A measure that accumulates over successive blocks of a motion, in bounded memory.

    A subclass must implement:

    1. ``accumulate(block)``, which adds an `Attractor` that has states.
    2. ``result()``, the measure of all blocks so far.
    3. Attributes with the names of the arguments of ``__init__``, for the repr.

    Blocks must follow one another, as those of a `Stream`. The result depends on how the states
    were divided into blocks by rounding alone.

    Attributes
    ----------
    states : int
        Number of states in all blocks.
    cost : Cost
        Seconds and work of the measure, without those of the motion.
    """

    _stored: ClassVar[tuple[str, ...]]
    states: int = 0
    cost: Cost = Cost(0.0)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        # all annotated attributes are stored
        cls._stored = ("states", "cost", *inspect.get_annotations(cls))

    @final
    def add(self, block: Attractor) -> None:
        """Add the next block.

        Raises
        ------
        ValueError
            When the block is not an attractor with states, does not have the measured quantity, or
            squares of its numbers overflow or vanish.
        NoMotion
            When the motion ends.
        """
        began = time.perf_counter()
        attractor = attractor_of(block)
        self.accumulate(attractor)
        count = len(attractor.states)
        self.states += count
        self.cost += Cost(time.perf_counter() - began, {"states": count})

    @abstractmethod
    def accumulate(self, block: Attractor) -> None:
        """Add the next block: the part of `add` that depends on the measure."""

    @abstractmethod
    def result(self) -> Any:
        """Return the measure of all blocks so far.

        Raises
        ------
        ValueError
            When there are too few states.
        """

    def __repr__(self) -> str:
        names = inspect.signature(type(self)).parameters
        options = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        return f"{type(self).__name__}({options})"

    def _at_least(self, least: int, what: str, count: int) -> None:
        if count < least:
            raise ValueError(f"{self!r} must have {least} {what} or more; got {count}")


def _largest(before: float, values: Array) -> float:
    """Return the largest size of all numbers so far; ValueError where squares are out of range."""
    largest = max(before, float(abs(values).max(initial=0.0)))
    with_squares_in_range("block", np.array(largest))
    return largest


@final
class RunningHistogram(Running):
    """The histogram of an observable of the states; its result is a `Histogram`.

    Parameters
    ----------
    observable : str
        One of the map's `observables`.
    low, high : float
        First and last edge.
    bins : int
        Number of bins of equal width.

    Raises
    ------
    ValueError
        When high does not exceed low, or a number is refused.

    Examples
    --------
    See `Histogram`.
    """

    observable: str
    low: float
    high: float
    bins: int
    _counts: Batches
    _watched: Batches

    def __init__(self, observable: str, *, low: float, high: float, bins: int = 100) -> None:
        of_type("observable", observable, str, "a name")
        self.observable = observable
        self.low, self.high = finite_scalar("low", low), finite_scalar("high", high)
        if not self.low < self.high:
            raise ValueError(f"high must exceed low = {self.low}; got {self.high}")
        if not math.isfinite(self.high - self.low):
            raise ValueError(
                f"high must exceed low = {self.low} by a finite number; got {self.high}"
            )
        self.bins = positive_integer("bins", bins)
        if not (np.diff(self._edges) > 0.0).all():
            width = (self.high - self.low) / self.bins
            raise ValueError(
                f"bins must be wider than rounding; got {self.bins} of width {width:.3g}"
            )
        self._counts, self._watched = Batches(_BATCHES), Batches(_WATCHED)

    @property
    def _edges(self) -> Array:
        return np.linspace(self.low, self.high, self.bins + 1)

    def accumulate(self, block: Attractor) -> None:
        values = finite_array("observable", block.observable(self.observable), (None,))
        places = np.searchsorted(self._edges, values, side="right")
        places[values == self.high] = self.bins

        def counts(edges: Edges) -> Array:
            parts = (places[a:b] for a, b in pairwise(edges.tolist()))
            found = [np.bincount(part, minlength=self.bins + 2) for part in parts]
            return np.array(found, dtype=np.float64)

        self._counts.add(len(values), counts)
        unit = max(abs(self.low), abs(self.high))
        # squares of values far beyond the edges do not overflow, those of far smaller ones vanish
        scaled = np.clip(values / 2.0 ** math.floor(math.log2(unit)), -_FAR, _FAR)
        self._watched.add_rows(with_squares(scaled[:, None]))

    def result(self) -> Histogram:
        self._at_least(1, "states", self.states)
        each, change = self._counts.sums, self._watched.change
        counts, weights = each.sum(axis=0), each.sum(axis=1) / self.states
        deviations = each / self.states - weights[:, None] * (counts / self.states)
        errors = np.maximum(batch_errors(deviations, weights, change), 1.0 / self.states)[1:-1]
        below, *inside, above = counts.astype(np.int64).tolist()
        edges = self._edges
        return Histogram(
            self.observable,
            edges,
            np.array(inside, dtype=np.int64),
            (below, above),
            errors / np.diff(edges),
            change,
            self.cost,
        )


@final
class RunningPOD(Running):
    """Proper orthogonal decomposition; its result is a `POD`.

    For impact oscillators averages over time are exact, in closed form; for other maps they are
    those of the states.

    Parameters
    ----------
    about : {"origin", "mean"}

    Examples
    --------
    >>> from dynkit.systems import ImpactChain
    >>> running = RunningPOD()
    >>> for block in ImpactChain(frequency=0.87).stream(keep=3000, block=1000):
    ...     running.add(block)
    >>> running.result().rank(0.99)
    5
    """

    about: Literal["origin", "mean"]
    _moments: Batches
    _watched: Batches
    _off: tuple[float, float] = (0.0, 0.0)
    _modes: Array | None = None
    _blocks: int = 0
    _largest: float = 0.0

    def __init__(self, *, about: Literal["origin", "mean"] = "origin") -> None:
        one_of("about", about, ("origin", "mean"))
        self.about = about
        self._moments, self._watched = Batches(_BATCHES), Batches(_WATCHED)

    def accumulate(self, block: Attractor) -> None:
        def moments(edges: Edges) -> Array:
            found = averages_over(block, edges)
            lasted = float(found.durations.sum())
            more = lasted * found.error, lasted * found.mean_error
            self._off = self._off[0] + more[0], self._off[1] + more[1]
            flat = found.products.reshape(len(found.sums), -1)
            return np.column_stack([flat, found.sums, found.durations])

        self._largest = _largest(self._largest, block.states)
        self._moments.add(len(block.states), moments)
        self._watched.add_rows(with_squares(block.states))
        self._modes = getattr(block.system, "modal_matrix", None)
        self._blocks += 1

    def result(self) -> POD:
        self._at_least(2, "states", self.states)
        each = self._moments.sums
        n, durations = math.isqrt(each.shape[1]), each[:, -1]
        products, sums = each[:, : n * n].reshape(-1, n, n), each[:, n * n : -1]
        size = float(np.trace(products.sum(axis=0)) / durations.sum())
        rounding = 2.0**-52 * self._blocks  # of the sums over blocks
        error, mean_error = (off / float(durations.sum()) for off in self._off)
        errors = error + rounding * size, mean_error + rounding * math.sqrt(size)
        found = POD._of(
            about=self.about,
            _normal_modes=self._modes,
            _averages=Averages(products, sums, durations, *errors, self.cost),
            change=self._watched.change,
        )
        found.matrix  # noqa: B018  # raises ValueError for a motion at rest
        return found


@final
class RunningExponents(Running):
    """Lyapunov exponents; the result is a `LyapunovSpectrum`.

    The frame of directions, and the state to which it belongs, continue from block to block. They
    follow a separate motion from the first state on, for as many iterates as there are states. In
    chaos rounding may separate this motion from the motion of the blocks.

    Parameters
    ----------
    settling : int
        Number of first iterates that are left out, in which the frame aligns itself.

    Examples
    --------
    >>> from dynkit.systems import Logistic
    >>> running = RunningExponents()
    >>> for block in Logistic(rate=4.0).stream(start=[0.3], keep=30_000):
    ...     running.add(block)
    >>> spectrum = running.result()
    >>> bool(abs(spectrum.exponents[0] - np.log(2.0)) < 3.0 * spectrum.error[0])
    True
    """

    settling: int
    _name: str = ""
    _last: Array | None = None
    _frame: Array | None = None
    _logs: Batches

    def __init__(self, *, settling: int = 1000) -> None:
        self.settling = non_negative_integer("settling", settling)
        self._logs = Batches(_ITERATES)

    def accumulate(self, block: Attractor) -> None:
        system: Any = block.system
        start = block.states[0] if self._last is None else system.unpack_state(self._last)
        count = len(block.states)
        found = system.stretching(start, count, self._frame)
        times = np.full(count, np.nan) if found.times is None else found.times
        rows = np.column_stack([found.logs, found.errors, times])
        self._logs.add_rows(rows[max(self.settling - self.states, 0) :])
        self._last, self._frame = system.pack_state(found.final), np.array(found.frame)
        self._name = type(system).__name__

    def result(self) -> LyapunovSpectrum:
        means = self._logs.means
        self._at_least(LEAST, f"states after the first {self.settling}", len(means))
        d = means.shape[1] // 2
        times = None if np.isnan(means[:, -1]).any() else means[:, -1]
        run = means[:, :d], means[:, d : 2 * d], times, self.cost
        length = self._logs.length
        return LyapunovSpectrum._of(_name=self._name, _is_flow=False, _length=length, _run=run)


@final
class RunningSpectrum(Running):
    """Power spectral density of a coordinate by Welch's method; its result is a `PowerSpectrum`.

    The motion is sampled at equal intervals; segments extend over the borders of blocks.

    Parameters
    ----------
    interval, coordinate : optional
        As for `PowerSpectrum`.
    length : int
        Number of intervals in a segment, at least 8. With the default interval the segment is
        shortened to a whole number of table periods.

    Examples
    --------
    >>> from dynkit.systems import ImpactChain
    >>> running = RunningSpectrum(length=1024)
    >>> for block in ImpactChain(frequency=0.87).stream(keep=500, block=100):
    ...     running.add(block)
    >>> running.result()
    <PowerSpectrum: 15000 samples 0.722205 apart in 28 segments, resolution 0.0128>
    """

    interval: float | None
    coordinate: int | None
    length: int
    _axis: Axis | None = None
    _next: float = 0.0
    _shift: float = 0.0
    _segments: int = 0
    _largest: float = 0.0
    _rest: Array
    _sum: Array
    _watched: Batches

    def __init__(
        self, *, interval: float | None = None, coordinate: int | None = None, length: int = 4096
    ) -> None:
        self.interval = None if interval is None else positive("interval", interval)
        self.coordinate, self.length = coordinate, positive_integer("length", length)
        if length < 8:
            raise ValueError(f"length must be at least 8; got {length}")
        self._rest, self._sum, self._watched = np.empty(0), np.zeros(1), Batches(_WATCHED)

    def accumulate(self, block: Attractor) -> None:
        axis = axis_of(Motion(block), self.coordinate, self.interval)
        step, lasted = axis.interval / axis.finer, block.duration
        count = max(math.ceil((lasted - self._next) / step), 0)
        while count and self._next + step * (count - 1) >= lasted:
            count -= 1  # because of rounding one sample may lie beyond the block
        for low in range(0, count, _CHUNK):
            numbers = np.arange(low, min(low + _CHUNK, count), dtype=np.float64)
            values = block.time_series(self._next + step * numbers)[:, axis.coordinate]
            self._largest = _largest(self._largest, values)
            if self._axis is None:
                self._axis, self._shift = axis, float(values[0])
            self._watched.add_rows(with_squares(values[:, None] - self._shift))
            self._add_segments(np.concatenate([self._rest, values]))
        self._next += step * count - lasted

    def _add_segments(self, values: Array) -> None:
        found = self._spectrum()
        hop = found._length - found._length // 2
        count = max((len(values) - found._length) // hop + 1, 0)
        if count:
            self._sum = self._sum + count * found._density(values)[: len(found._axis)]
        self._segments, self._rest = self._segments + count, values[count * hop :].copy()

    def _spectrum(self, **known: Any) -> PowerSpectrum:
        assert self._axis is not None
        _, name, frequency, finer, interval, multiple = self._axis
        length = max(self.length - self.length % multiple, min(self.length, multiple))
        return PowerSpectrum._of(
            interval=interval,
            segments=self._segments,
            name=name,
            table_frequency=frequency,
            _count=self._watched.count // finer,
            _finer=finer,
            _length=finer * length,
            _step=interval / finer,
            lines=None,
            **known,
        )

    def result(self) -> PowerSpectrum:
        self._at_least(1, "segments", self._segments)
        mean, square = self._watched.sums.sum(axis=0) / self._watched.count
        found = self._spectrum(
            variance=max(square - mean**2, 0.0), change=self._watched.change, cost=self.cost
        )
        vars(found)["_estimate"] = found._axis, read_only(self._sum / self._segments), 0.0
        if found.change is not None:
            vars(found)["error"] = math.inf
        return found


@final
class RunningSample(Running):
    """A random sample of the states, for their correlation dimension.

    The sums over all pairs of a long motion cannot be computed. This sample has a given size; each
    state is in it with the same probability. The result is the `CorrelationDimension` of the
    sample, whose correlation sums are estimates of those of all states. Their errors are those of
    a set of this size, and so include the sampling.

    Parameters
    ----------
    size : int
        Number of states in the sample; at least 64.
    norm : {"maximum", "euclidean"}

    References
    ----------
    P. S. Efraimidis, P. G. Spirakis, Information Processing Letters 97 (2006) 181-185, with equal
    weights: the states with the least of independent random numbers are a uniform sample.

    Examples
    --------
    >>> from dynkit.systems import Henon
    >>> running = RunningSample(2000)
    >>> for block in Henon().stream(start=[0.1, 0.1], keep=30_000):
    ...     running.add(block)
    >>> found = running.result()
    >>> bool(abs(found.value - 1.22) < 3.0 * found.error)
    True
    """

    size: int
    norm: Norm
    sample: Array
    _numbers: Array
    _angles: Mapping[int, float]

    def __init__(self, size: int = 20_000, *, norm: Norm = "maximum") -> None:
        self.size = positive_integer("size", size)
        if size < BLOCKS:
            raise ValueError(f"size must be at least {BLOCKS}; got {size}")
        one_of("norm", norm, get_args(Norm))
        self.norm, self._angles = norm, {}
        self.sample, self._numbers = np.empty((0, 0)), np.empty(0)

    def accumulate(self, block: Attractor) -> None:
        states = block.states
        # the numbers of a state do not depend on the blocks
        numbers = np.random.Generator(np.random.PCG64(0).advance(self.states)).random(len(states))
        if not self.states:
            self._angles, self.sample = dict(angles_of(block.system, states)), states[:0]
        both = np.concatenate([self._numbers, numbers])
        kept: NDArray[np.intp] = np.arange(len(both))
        if len(both) > self.size:
            kept = np.sort(np.argpartition(both, self.size)[: self.size])
        self._numbers = both[kept]
        self.sample = np.concatenate([self.sample, states])[kept]

    def result(self) -> CorrelationDimension:
        self._at_least(BLOCKS, "states", self.states)
        found = CorrelationDimension(self.sample, norm=self.norm, angles=self._angles)
        vars(found)["change"] = regime_change(self.sample)
        return found
