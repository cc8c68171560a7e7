"""Quasi-periodic motion: states on closed curves, along which they advance by a constant turn."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.labels.recurrence import Recurrences

# The fewest states on a curve: half of them must do for a curve of their own.
_FEWEST = 256
# A state is predicted by the polynomial, of degree five, through three neighbours on either side.
_NEIGHBOURS = (-3, -2, -1, 1, 2, 3)
# Twice the states must lie nearer to the curve by this factor, where a smooth curve gives 64, or
# to this part of the tolerance. Half of them leave no gap wider than this, in turns.
_GAIN, _FLOOR, _WIDEST = 4.0, 1e-3, 1.0 / 16.0
# Steps of Gauss and Newton, and differences for them, in parts of the interval that is possible.
_STEPS, _DIFFERENCE = 6, 1e-4
# Halves may agree by chance, and misfits of neighbours are no independent errors: what they say
# counts so many times.
_MARGIN = 8.0
# A state is wrong by as many roundings.
_ROUNDING = 16.0 * 2.0**-52


@final
@dataclass(frozen=True)
class Rotation:
    """How states advance along closed curves.

    Parameters
    ----------
    number, error : float
        Rotation number, in turns of all curves once, 0 < number < 1/2, and an estimate of its
        distance to the exact one.
    curves : int
        Closed curves, which the states visit in turn.
    distance : float
        The largest distance of a state to the curve through its neighbours, relative to the size of
        the curve: the root mean square of distances to its centre.
    """

    number: float
    error: float
    curves: int
    distance: float


def rotation_of(orbit: Recurrences, tolerance: float, accuracy: float) -> Rotation | None:
    """Return how the states advance along smooth closed curves; None where that is not certain.

    On a closed curve on which states advance by the turn w, the neighbours of the last of n states
    are, on either side, those q and r earlier, where w is between the fractions p/q and s/r with
    q s - r p = 1 and q + r >= n (the theorem of three gaps): so the distances alone, whose best
    are q and r, give w, but for its sign. Where the greatest common divisor of q and r is k, there
    are k curves, and w is the turn of the k-th iterate. Sorted by multiples of w, states that are
    neighbours on the circle must be neighbours on a smooth curve: each is predicted by the
    polynomial of the angle through six neighbours, and w is what predicts them best.

    It is certain when the turns of half of the states leave no gap wider than 1/16, every state is
    within the tolerance of its prediction, and all states are predicted better by a factor 4, or
    to a thousandth of the tolerance, than those of one half from themselves. That is neither chaos,
    nor a torus of more dimensions, nor a spiral, nor a Cantor set.

    Parameters
    ----------
    orbit : Recurrences
        At least 256 states on each curve.
    tolerance : float
        The largest `Rotation.distance`.
    accuracy : float
        How wrong a step of the motion may be, relative to the largest state. The error is what it
        contributes, and 8 times the standard error of the best prediction or the largest difference
        to the rotation numbers of three halves of the states, whichever is more.

    References
    ----------
    N. B. Slater, Gaps and steps for the sequence n theta mod 1, Proc. Camb. Phil. Soc. 63 (1967)
    1115-1123.
    """
    interval = _interval(orbit)
    if interval is None:
        return None
    curves, guess, low, high = interval
    loop = _Loop.of(orbit, curves, guess)
    count, half = len(loop.states), len(loop.states) // 2
    begins = (0, count // 4, count - half)
    halves = [loop.between(begin, begin + half) for begin in begins]
    fits = [part.fitted(guess, low, high) for part in (loop, *halves)]
    if not np.isfinite(fits).all():
        return None
    (number, standard, distance), *others = fits
    size = float(np.sqrt(np.sum(np.var(loop.states, axis=0))))
    widest = np.diff(np.sort(np.arange(half) * number % 1.0), append=1.0).max()
    gained = distance <= max(min(d for *_, d in others) / _GAIN, _FLOOR * tolerance * size)
    if not (gained and distance <= tolerance * size and widest <= _WIDEST):
        return None
    slip = max(accuracy, _ROUNDING) * curves / (2.0 * np.pi * size)
    error = _MARGIN * max(standard, *(abs(other - number) for other, *_ in others)) + slip
    return Rotation(min(number, 1.0 - number), error, curves, distance / size)


def _interval(orbit: Recurrences) -> tuple[int, float, float, float] | None:
    """How many curves there are, a guess of the turn, and bounds that keep the order of states."""
    if orbit.count < _FEWEST:
        return None
    last = orbit.count - 1
    gaps = orbit.gaps(np.full(last, last), np.arange(last - 1, -1, -1))
    lengths = np.linalg.norm(gaps, axis=1)
    nearest = int(np.argmin(lengths))
    behind = gaps @ gaps[nearest] < 0.0
    if not behind.any():
        return None
    opposite = int(np.argmin(np.where(behind, lengths, np.inf)))
    curves = math.gcd(nearest + 1, opposite + 1)
    q, r = (nearest + 1) // curves, (opposite + 1) // curves
    count = orbit.count // curves
    if count < _FEWEST or q + r < count:
        return None
    p = -pow(r, -1, q) % q
    s = (1 + p * r) // q
    ratio = float(lengths[nearest] / lengths[opposite])
    return curves, (p + ratio * s) / (q + ratio * r), p / q, s / r


@final
@dataclass(frozen=True, eq=False)
class _Loop:
    """States in the order of their angles: those of all curves beside one another are one.

    The angle of a state (d,) is its multiple (n,) of the turn; once around, the states (n, d) have
    grown by as much as angles among their coordinates do.
    """

    multiples: NDArray[np.intp]
    states: Array
    around: Array

    @classmethod
    def of(cls, orbit: Recurrences, curves: int, turn: float) -> "_Loop":
        count = orbit.count // curves
        order = np.argsort(np.arange(count) * turn % 1.0)
        ring = orbit.count - count * curves + order[:, None] * curves + np.arange(curves)
        gaps = orbit.gaps(np.roll(ring, -1, axis=0).ravel(), ring.ravel())
        steps = gaps.reshape(count, -1)
        return cls(order, np.cumsum(steps, axis=0) - steps, steps.sum(axis=0))

    def between(self, begin: int, end: int) -> "_Loop":
        """Those of the states that come at these places in time."""
        where = (self.multiples >= begin) & (self.multiples < end)
        return _Loop(self.multiples[where], self.states[where], self.around)

    def misfit(self, number: float) -> Array:
        """Predictions of the states from their neighbours, less the states, (n, d)."""
        n, reach = len(self.states), max(_NEIGHBOURS)
        angles = self.multiples * number % 1.0
        x = np.concatenate([angles[-reach:] - 1.0, angles, angles[:reach] + 1.0])
        before, after = self.states[-reach:] - self.around, self.states[:reach] + self.around
        y = np.concatenate([before, self.states, after])
        nodes = [slice(reach + j, reach + j + n) for j in _NEIGHBOURS]
        misfit = -self.states
        for node in nodes:
            others = [x[other] for other in nodes if other is not node]
            weight = np.prod([(angles - other) / (x[node] - other) for other in others], axis=0)
            misfit = misfit + weight[:, None] * y[node]
        return misfit

    def fitted(self, guess: float, low: float, high: float) -> tuple[float, float, float]:
        """The turn between bounds that predicts best, its standard error, and the largest misfit.

        NaN where it is not between the bounds.
        """
        number, step, standard = guess, _DIFFERENCE * (high - low), np.nan
        for _ in range(_STEPS):
            misfit = self.misfit(number)
            slope = (self.misfit(number + step) - misfit) / step
            shares = np.sum(slope * misfit, axis=1) / np.sum(slope * slope)
            number, standard = number - float(shares.sum()), float(np.linalg.norm(shares))
            if not low < number < high - step:
                return np.nan, np.nan, np.nan
        return number, standard, float(np.linalg.norm(self.misfit(number), axis=1).max())
