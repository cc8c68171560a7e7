"""Quasi-periodic motion: states on closed curves, along which they advance by a constant turn."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.labels.recurrence import Recurrences

# Least number of states on a curve: half of them must define the curve as well.
_FEWEST = 256
# Offsets of the neighbours from which a state is predicted, by a polynomial of degree five.
_NEIGHBOURS = (-3, -2, -1, 1, 2, 3)
# The predictions from all states must be better than those from half of the states by the factor
# _GAIN (a smooth curve gives 64), or good to _FLOOR times the tolerance. _WIDEST is the widest gap
# between half of the states, in turns.
_GAIN, _FLOOR, _WIDEST = 4.0, 1e-3, 1.0 / 16.0
# The widest gaps, one of every _ARC, must not cover more than half of the circle. Where states pass
# slowly by a periodic orbit, or settle on it, they lie on short arcs with such gaps between them.
_ARC = 64
# Number of Gauss-Newton steps, and step of their differences relative to the possible interval.
_STEPS, _DIFFERENCE = 6, 1e-4
# Safety factor of the error: halves may agree by chance, and errors of neighbours are correlated.
_MARGIN = 8.0
# Least relative error of a state.
_ROUNDING = 16.0 * 2.0**-52


@final
@dataclass(frozen=True)
class Rotation:
    """Rotation of states along closed curves.

    Parameters
    ----------
    number, error : float
        Rotation number, 0 < number < 1/2, and an estimate of its distance to the exact one. It is
        the turn from a state to the next one on the same curve, `curves` iterates later.
    curves : int
        Number of closed curves that the states visit in turn.
    distance : float
        The largest distance of a state to the curve through its neighbours, relative to the size of
        the curve, which is the root mean square of the distances to its centre.
    """

    number: float
    error: float
    curves: int
    distance: float


def rotation_of(orbit: Recurrences, tolerance: float, accuracy: float) -> Rotation | None:
    """Return the rotation of the states along smooth closed curves; None where it is not certain.

    Let states advance by the turn w on a closed curve. The neighbours of the last of n states, one
    on either side, are the states q and r earlier, where w lies between the fractions p/q and s/r
    with q s - r p = 1 and q + r >= n (three gap theorem). So the distances of the states determine
    q and r and thereby w, up to its sign. Where q and r have the greatest common divisor k, there
    are k curves, and w is the turn of the k-th iterate. In the order of the multiples of w,
    neighbours on the circle must be neighbours on a smooth curve: each state is predicted by the
    polynomial in the angle through six neighbours, and w minimises the errors of the predictions.

    The result is certain under four conditions: the angles of half of the states leave no gap
    wider than 1/16 turn; the widest of all gaps, one of 64, cover no more than half of the circle;
    every state is within the tolerance of its prediction; and predictions from all states are
    better than those from one half of the states by a factor 4, or good to a thousandth of the
    tolerance. They exclude chaos, tori of more dimensions, spirals, Cantor sets, and slow drifts
    near a periodic orbit.

    Parameters
    ----------
    orbit : Recurrences
        At least 256 states on each curve.
    tolerance : float
        The largest `Rotation.distance`.
    accuracy : float
        Error of an iterate, relative to the largest state. The error of the rotation number adds
        its contribution and 8 times the larger of two numbers: the standard error of the best fit,
        and the largest difference to the rotation numbers of three halves of the states.

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
    widest = _gaps(half, number)[-1]
    covered = _gaps(count, number)[-(count // _ARC) :].sum() <= 0.5
    gained = distance <= max(min(d for *_, d in others) / _GAIN, _FLOOR * tolerance * size)
    if not (gained and distance <= tolerance * size and widest <= _WIDEST and covered):
        return None
    slip = max(accuracy, _ROUNDING) * curves / (2.0 * np.pi * size)
    error = _MARGIN * max(standard, *(abs(other - number) for other, *_ in others)) + slip
    return Rotation(min(number, 1.0 - number), error, curves, distance / size)


def _gaps(count: int, number: float) -> Array:
    """Return the gaps between multiples of a turn, ascending, in turns."""
    return np.sort(np.diff(np.sort(np.arange(count) * number % 1.0), append=1.0))


def _interval(orbit: Recurrences) -> tuple[int, float, float, float] | None:
    """Return the number of curves, a guess of the turn, and its lower and upper bounds.

    Within the bounds the order of the states on the circle does not change.
    """
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
    """States in the order of their angles; states on several curves are joined to one.

    The angle of state i is ``multiples[i]`` times the turn, modulo 1. After one turn the states
    (n, d) change by `around` (d,), which is not zero where coordinates are angles.
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
        """Return the loop of the states with begin <= time index < end."""
        where = (self.multiples >= begin) & (self.multiples < end)
        return _Loop(self.multiples[where], self.states[where], self.around)

    def misfit(self, number: float) -> Array:
        """Return the predictions of the states from their neighbours minus the states, (n, d)."""
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
        """Return the turn with the best predictions, its standard error, and the largest misfit.

        They are NaN where the turn leaves the bounds.
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
