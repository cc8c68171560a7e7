"""Harmonics of periodic motions: Fourier coefficients, and the number of relevant harmonics."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.validation import (
    Array,
    finite_array,
    finite_scalar,
    positive,
    with_squares_in_range,
)
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved

TWO_PI = 2.0 * math.pi

SHARE = 0.99
"""Share of the power that the harmonics counted by `OrbitLabel.harmonics` hold."""

# Least number of sampling intervals of a period: fewer determine no harmonic.
_FEWEST = 4
# With fewer intervals, samples do not show the bends of a motion whose harmonics fall slowly.
_BENT = 16
# Changes by aliasing per second difference of n samples and per jump, times n.
_OF_BENDS, _OF_JUMPS = (math.pi**2 - 4.0) / TWO_PI**2, math.sqrt(0.25 + 1.0 / math.pi**2)
# Largest number of intervals for counting harmonics.
_MOST = 1 << 17


@final
@dataclass(frozen=True, eq=False, repr=False)
class Harmonics(Saved):
    """The Fourier series of a periodic motion, made by `harmonics_of`.

    x(t) = mean + sum_k 2 Re(c_k exp(i k frequency t)), k = 1, 2, ..., where t = 0 is the first
    sample.

    Parameters
    ----------
    frequency : float
        Angular frequency of the first harmonic: 2 pi over the period.
    coefficients : (h,) complex array
        c_1, c_2, ..., c_h.
    error : float
        Estimate of the largest error of a coefficient: see `harmonics_of`.
    cost : Cost
        Seconds and number of samples, without the cost of computing the samples.
    """

    _stored: ClassVar = ("frequency", "coefficients", "error", "cost")
    frequency: float
    coefficients: NDArray[np.complex128]
    error: float
    cost: Cost

    def __repr__(self) -> str:
        count, first = len(self.coefficients), self.frequency
        return f"<Harmonics: {count} of frequency {first:.6g}, error {self.error:.1e}>"

    def dataset(self) -> Dataset:
        """Return frequencies, coefficients and powers as a dataset over ``harmonic``, from 1."""
        each = "harmonic"
        return Dataset(
            {each: (each, np.arange(1, len(self.coefficients) + 1))},
            {
                "frequency": (each, self.frequencies),
                "coefficient": (each, self.coefficients),
                "power": (each, self.power),
                "error": ((), self.error),
            },
            described(
                "Harmonics of a periodic motion",
                cost=self.cost,
                error="estimate of the largest error of a coefficient",
            ),
        )

    @property
    def frequencies(self) -> Array:
        """Angular frequencies, (h,)."""
        return self.frequency * np.arange(1.0, len(self.coefficients) + 1.0)

    @cached_property
    def power(self) -> Array:
        """Mean square of each harmonic, (h,).

        Raises
        ------
        ValueError
            When squares of the coefficients overflow or vanish.
        """
        sizes = with_squares_in_range("coefficients", np.abs(self.coefficients))
        return np.asarray(2.0 * sizes**2)

    @property
    def variance(self) -> float:
        """Mean square of all harmonics together."""
        return float(self.power.sum())

    @cached_property
    def shares(self) -> Array:
        """Share of the variance, (h,), that the strongest 1, 2, ..., h harmonics hold together."""
        sizes = abs(self.coefficients)
        relative = sizes / (float(sizes.max()) or 1.0)  # squares of small ones would vanish
        held = np.cumsum(np.sort(relative**2)[::-1])
        return np.asarray(held / held[-1] if held[-1] > 0.0 else np.ones_like(held))

    def count(self, share: float = SHARE) -> int:
        """Return the smallest number of harmonics that together hold a share of the variance.

        A motion at rest has none.

        Raises
        ------
        ValueError
            When the share does not lie in (0, 1).
        """
        part = finite_scalar("share", share)
        if not 0.0 < part < 1.0:
            raise ValueError(f"share must lie in (0, 1); got {part}")
        return int(np.searchsorted(self.shares, part)) + 1 if self.coefficients.any() else 0


def harmonics_of(values: object, frequency: float) -> Harmonics:
    """Return the harmonics of a periodic motion from samples over one period.

    The discrete Fourier transform of n samples adds the coefficients c_{k + jn}, for all integers
    j, to c_k (aliasing). A continuous x whose velocity has the total variation V over the period T
    satisfies, with or without kinks (impacts),

        |c_k| <= V T / (2 pi k)^2.

    Hence aliasing changes the coefficients below n/2 by at most (pi^2 - 4) V T / (2 pi n)^2. This
    is the error estimate, with V from the samples: the sum of their second differences is V, or
    less where the velocity reverses between two samples. The rounding of the samples, and the
    difference of the last and the first sample, are added.

    Fewer than 16 intervals may miss bends: then the largest value of the harmonics above n/8 at a
    sample is added. Harmonics above n/2 that the samples do not show at all remain unnoticed.

    A jump of x by J, as of velocities at impacts, changes them by at most (1/4 + 1/pi^2)^(1/2) J /
    n. It has two successive second differences of opposite sign: the smaller one of each such pair
    counts as a jump.

    Parameters
    ----------
    values : (n + 1,) array_like
        Samples at equal intervals, the last one period after the first; n >= 4.
    frequency : float
        2 pi over the period; positive.

    Returns
    -------
    Harmonics
        The first (n - 1) // 2 harmonics.

    Raises
    ------
    ValueError
        When values are too few or not finite, or the frequency is not positive.

    References
    ----------
    Y. Katznelson, An Introduction to Harmonic Analysis, 3rd edition (2004), section I.4
    (coefficients of functions of bounded variation).

    Examples
    --------
    >>> t = np.linspace(0.0, 2.0 * np.pi, 65)
    >>> found = harmonics_of(3.0 + 2.0 * np.cos(t) + 0.1 * np.sin(5.0 * t), 1.0)
    >>> found.power[:5].round(12).tolist()
    [2.0, 0.0, 0.0, 0.0, 0.005]
    >>> found.count(), found.count(0.999)
    (1, 2)
    """
    began = time.perf_counter()
    samples = finite_array("values", values, (None,))
    fundamental = positive("frequency", frequency)
    n = len(samples) - 1
    if n < _FEWEST:
        raise ValueError(f"values must be {_FEWEST + 1} or more; got {n + 1}")
    period = samples[:-1]
    # without the mean: the transform of a large constant would add rounding to all coefficients
    moving = period - period.mean()
    transform = np.fft.rfft(moving)
    coefficients = np.asarray(transform[1 : (n - 1) // 2 + 1] / n)
    # jumps of the slope, times the interval T / n
    bends = np.diff(period, 2, prepend=period[-1], append=period[0])
    after = np.roll(bends, -1)
    jumps = np.where(np.sign(bends) * np.sign(after) < 0.0, np.minimum(abs(bends), abs(after)), 0.0)
    folded = (_OF_BENDS * abs(bends).sum() + (_OF_JUMPS - 2.0 * _OF_BENDS) * jumps.sum()) / n
    gap = abs(float(samples[-1] - samples[0]))
    rounding = 2.0**-52 * math.log2(2 * n) * float(abs(samples).max())
    transform[: n // 8 + 1] = 0.0
    missed = float(abs(np.fft.irfft(transform, n)).max()) if n < _BENT else 0.0
    return Harmonics(
        fundamental,
        coefficients,
        float(folded) + missed + gap + rounding,
        Cost(time.perf_counter() - began, {"samples": n + 1}),
    )


def harmonics_needed(motion: Callable[[Array], Array], period: float, samples: int) -> int:
    """Return the number of harmonics that hold 99 % of a motion's power, the strongest first.

    The number of samples is doubled until the change of the shares no longer affects the result.

    Parameters
    ----------
    motion : callable
        Function from times (k,) to the motion (k,).
    period : float
    samples : int
        Initial number of samples of the period; even, eight or more.

    Examples
    --------
    >>> def falling(t):  # a ball that bounces without loss: powers fall as 1 / k^4
    ...     return t * (1.0 - t)
    >>> harmonics_needed(falling, 1.0, 64)
    3
    """
    while True:
        # linspace ends at the period without rounding
        values = motion(np.linspace(0.0, period, samples + 1))
        fine, coarse = (harmonics_of(part, TWO_PI / period) for part in (values, values[::2]))
        doubt = float(abs(fine.shares[: len(coarse.shares)] - coarse.shares).max())
        within = SHARE - doubt, SHARE + doubt
        certain = within[0] > 0.0 and within[1] < 1.0 and len({fine.count(s) for s in within}) == 1
        if certain or samples >= _MOST:
            return fine.count()
        samples *= 2
