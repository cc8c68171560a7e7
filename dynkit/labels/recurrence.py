"""Recurrence of section states: distances between states a period apart, and their decay."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import cached_property, kept
from dynkit.core.no_motion import Diverged
from dynkit.core.smooth_map import proper_divisors
from dynkit.core.validation import Array

_Indices: TypeAlias = NDArray[np.intp]
_Attraction: TypeAlias = Callable[[int, int | None], tuple[float, bool]]

REPETITIONS = 3
"""A period is accepted when the window holds it this many times: two full repetitions."""

# Below the relative recurrence _SPLIT no multiple is tried as the period. Distances below _ROUNDING
# are rounding errors, and not used for a decay.
_SPLIT, _ROUNDING = 1e-10, 1e-13
# A decay oscillates if the logarithms of its distances cross their straight fit at least _TURNS
# times; a curve that bends one way crosses it twice. They exceed the fit by at most _ABOVE, unlike
# the logarithms of a burst of chaos.
_TURNS, _ABOVE = 4, 2.0
# States drift if their distance over the window exceeds that over one period by more than this
# factor.
_DRIFT = 3.0
# Least number of recurrences for the fit of a decay: three in each half, for the standard errors.
_FIT = 6
# Least number of recurrences of a decay that is extrapolated, and its least fall: a factor 3.
_DECAY_RECURRENCES, _DECAY_DEPTH = 10, np.log(3.0)
# Least fall, over the window, of the logarithm of a decay that may settle: a slower one needs 46
# more windows for a factor 100. On closed curves near a resonance, too, distances may decrease
# geometrically for a while. They fall less, or the extrapolated orbit is farther away than the
# largest distance times 1 / _FALL.
_FALL = 0.1
# Largest ratio of the last distance of a decay to the extrapolated distance of its orbit, which is
# exp(rate) - 1. For ten or more distances between 1e4 and rounding, the largest possible rate of a
# straight fit is 5.9.
_STEEPEST = 400.0
# Where states n apart differ by less than this, relative, an orbit of period kn may still settle
# on one of period n.
_CLOSE = 0.03


@final
class Recurrences:
    """Distances between the states of one window, relative to the norm of the largest state.

    Parameters
    ----------
    states : (k, d) array
    times : (k,) array or None
        Their times, in periods of the forcing.
    difference : callable
        Function (a, b) that returns a - b for states (..., d).

    Attributes
    ----------
    from_last : (k - 1,) array
        Distance of the last state to the one n before it, at index n - 1.

    Raises
    ------
    Diverged
        When the square of a distance would not be finite.
    """

    def __init__(
        self, states: Array, times: Array | None, difference: Callable[[Array, Array], Array]
    ) -> None:
        self.states = states
        self.times = times
        self.difference = difference
        self.count = len(states)
        largest = float(np.sqrt(np.einsum("ij,ij->i", states, states).max(initial=0.0)))
        if largest == np.inf:
            raise Diverged(
                "the motion runs away: states exceed 1e154, the root of the largest number"
            )
        self.scale = largest if largest > 0.0 else 1.0
        self.from_last = self.distances(slice(-1, None), slice(None, -1))[::-1]

    def distances(self, later: slice | _Indices, earlier: slice | _Indices) -> Array:
        """Return distances of states to earlier ones; elapsed time enters modulo one period."""
        gap = self.difference(self.states[later], self.states[earlier])
        distance: Array = np.sqrt(np.einsum("ij,ij->i", gap, gap)) / self.scale
        if self.times is None:
            return distance
        elapsed = self.times[later] - self.times[earlier]
        whole = np.rint(elapsed)
        distance = np.hypot(distance, elapsed - whole)
        # bounces of one chatter within the same period of the forcing are not recurrences
        distance[whole == 0.0] = np.inf
        return distance

    def gaps(self, later: _Indices, earlier: _Indices) -> Array:
        """Return relative differences (k, d) of states to earlier ones; (k, d + 1) with times."""
        gap = self.difference(self.states[later], self.states[earlier]) / self.scale
        if self.times is None:
            return gap
        elapsed = self.times[later] - self.times[earlier]
        return np.column_stack([gap, elapsed - np.rint(elapsed)])

    def periods(self, n: int) -> int | None:
        """Return the periods of the forcing in the last n states; None without forcing."""
        return None if self.times is None else round(self.times[-1] - self.times[-1 - n])

    @kept
    def spread(self, n: int) -> float:
        """Return the largest distance of a state to its counterpart in the last n states."""
        if n == 1:
            return float(self.from_last.max())
        early = np.arange(self.count - n)
        return float(self.distances(self._counterparts(early, n), early).max())

    def _counterparts(self, i: int | _Indices, n: int | _Indices) -> _Indices:
        return np.asarray(self.count - n + (i - self.count) % n)

    @kept
    def steps(self, n: int) -> Array:
        """Return, for each period of n states but the first, the largest distance over n states."""
        begin = self.count % n
        distance = self.distances(slice(begin + n, None), slice(begin, -n))
        return np.asarray(distance.reshape(-1, n).max(axis=1))

    def recurrent(self, tolerance: float) -> int | None:
        """Return the period n that recurs throughout the window; None when it is not certain."""
        likely = np.flatnonzero(self.from_last[: self.count // REPETITIONS] <= tolerance) + 1
        if not len(likely):
            return None
        n = int(likely[0])
        if self.spread(n) > tolerance:
            # compare the first state first: while a motion settles it has the largest distance
            first = self.distances(self._counterparts(0, likely), np.zeros_like(likely))
            near = likely[first <= tolerance].tolist()
            n = next((n for n in near if self.spread(n) <= tolerance), 0)
        return self._resolved(n, tolerance) if n else None

    def _resolved(self, n: int, tolerance: float) -> int | None:
        """Return the period among n and its multiples; None where it is not certain."""
        size = self.spread(n)
        far = size > _SPLIT and size > _DRIFT * float(self.steps(n).max())
        if far and not self._decay(n).falls(_DECAY_DEPTH):
            return None  # states drift from period to period, without a decay to an orbit
        factor: int | None = 0
        while factor != 1 and self.spread(n) > _SPLIT:
            factor = None if self._decay(n).leaves else self._split(n)
            if factor is None:
                return None
            n *= factor
        # far from the origin the motion itself is smaller than the tolerance
        near = max(_SPLIT, tolerance * size)
        if size > self.spread(n) > near and not self._decay(n).falls(_DECAY_DEPTH):
            return None
        rest = self.rest(n)
        for divisor in proper_divisors(n):
            clear = _CLOSE if rest == np.inf else 3.0 * rest
            if self.steps(divisor)[-1] <= clear or self._decay(divisor).falls(_DECAY_DEPTH):
                return None
        return n

    def _split(self, n: int) -> int | None:
        """Return the factor of a multiple of n that recurs much better; None if not certain."""
        reach = self.from_last[: self.count // REPETITIONS]
        if reach[n - 1] <= _SPLIT:  # the motion has settled during the window
            return 1
        for factor in range(2, len(reach) // n + 1):
            if reach[factor * n - 1] < 0.1 * reach[n - 1]:
                rest = self.rest(factor * n)
                if rest == np.inf:
                    return None
                if 3.0 * rest < self.steps(n)[-1]:
                    return factor
        return 1

    @kept
    def _decay(self, n: int) -> "_Decay":
        return _Decay.of(self.steps(n))

    def rest(self, n: int) -> float:
        """Return a bound of the last states' distance to the periodic orbit, or infinity."""
        spread = self.spread(n)
        if spread <= _SPLIT:
            return spread
        decay = self._decay(n)
        if decay.count < _FIT or decay.leaves:
            return np.inf
        return decay.rest if decay.rate > 3.0 * decay.error else spread

    @property
    def decays(self) -> bool:
        """Whether the best recurrence of the last state decreases towards a periodic orbit."""
        decay = self._decay(self._best) if self._best else _Decay(0)
        return decay.falls(_FALL) and _FALL * decay.rest <= self.from_last.max()

    def settling(self, near: float, attraction: _Attraction | None) -> int | None:
        """Return the period of the orbit on which the motion settles; None if that is not certain.

        The distance of the last state from this orbit must be at most `near`. It is extrapolated by
        the fit of the decay, and by the derivative over the period where its `attraction` is known:
        the fit follows the largest disturbances, and a small one may decay more slowly.
        """
        best = self._best
        if not best or self.from_last[best - 1] > _STEEPEST * near:
            return None
        for n in [*proper_divisors(best), best]:
            decay = self._decay(n)
            # the smallest period with a decay is the period: its multiples seem to decay faster
            if decay.falls(_DECAY_DEPTH):
                if decay.count < _DECAY_RECURRENCES or decay.rest > near:
                    return None
                factor = attraction(n, self.periods(n))[0] if attraction else 0.0
                rest = max(decay.rest, float(self.steps(n)[-1]) * factor, _ROUNDING)
                apart = all(self.steps(k)[-1] > 3.0 * rest for k in proper_divisors(n))
                return n if rest <= near and apart else None
        return None

    def attracted(self, near: float, attraction: _Attraction) -> int | None:
        """Return the period of an orbit that attracts the motion; None if that is not certain.

        Its distance from the last state, by the derivative over the period, must be at most `near`.
        Distances over parts of the period must be larger, and those over multiples not much
        smaller, as where the period has just doubled.
        """
        reach = self.from_last[: self.count // REPETITIONS]
        n = int(np.argmax(reach <= near)) + 1 if (reach <= near).any() else 0
        if not n or (reach[n - 1] > _SPLIT and (reach[n - 1 :: n] < 0.1 * reach[n - 1]).any()):
            return None
        factor, attracts = attraction(n, self.periods(n))
        rest = float(self.steps(n)[-1]) * factor
        apart = all(self.steps(k)[-1] > 3.0 * rest for k in proper_divisors(n))
        return n if attracts and rest <= near and apart else None

    @cached_property
    def _best(self) -> int:
        """The period with the best recurrence among those repeated often enough, or zero."""
        reach = self.from_last[: self.count // (_DECAY_RECURRENCES + 1)]
        return int(np.argmin(reach)) + 1 if len(reach) else 0


@dataclass(frozen=True)
class _Decay:
    """Recurrence distances d_j fitted by d_0 exp(-rate j)."""

    count: int
    rate: float = 0.0
    error: float = np.inf
    rest: float = np.inf  # sum of the geometric series after the last distance
    logs: Any = ()

    @classmethod
    def of(cls, steps: Array) -> "_Decay":
        last = float(steps[-1])
        below = np.flatnonzero(~((steps > _ROUNDING) & np.isfinite(steps)))
        if len(below):  # fit the decrease to the rounding level, or the increase from it
            steps = steps[: below[0]] if below[-1] == len(steps) - 1 else steps[below[-1] + 1 :]
        logs = np.log(steps)
        if len(logs) < _FIT:
            return cls(len(logs))
        rate, error = _rate(logs)
        rest = float(last / np.expm1(rate)) if rate > 0.0 else np.inf
        return cls(len(logs), rate, error, rest, logs)

    @cached_property
    def geometric(self) -> bool:
        """Whether the ratio is below 1 by five standard errors, and the decay does not slow down.

        A decay like a power of time slows down: beside a fold a motion passes slowly where no orbit
        exists any more. Around an orbit with complex multipliers a decay oscillates. The rates of
        its two halves may then differ by three standard errors.
        """
        if not self.rate > 5.0 * self.error:
            return False
        (early, its_error), (late, last_error) = (
            _rate(half) for half in np.split(self.logs, [self.count // 2])
        )
        off = self.logs - self.logs.mean() + self.rate * _places(self.count)
        if (np.diff(np.sign(off)) != 0.0).sum() >= _TURNS and off.max() <= _ABOVE:
            bend = abs(early - late) - 3.0 * math.hypot(its_error, last_error)
        else:
            last = _rate(self.logs[-max(self.count // 4, 3) :])[0]
            bend = max(early, self.rate) - min(late, last)
        return bool(early > 0.0 and bend <= 0.2 * self.rate)

    def falls(self, least: float) -> bool:
        """Whether the decay is geometric, and the logarithm falls by `least` or more."""
        return self.rate * (self.count - 1) >= least and self.geometric

    @property
    def leaves(self) -> bool:
        return self.rate < -5.0 * self.error and self.rate * (self.count - 1) <= -1.0


def _places(count: int) -> Array:
    """Return the indices (count,) of equidistant values minus their mean."""
    return np.asarray(np.arange(count) - 0.5 * (count - 1))


def _rate(logs: Array) -> tuple[float, float]:
    """Return the rate of decrease of a straight fit of equidistant values, and its error."""
    place = _places(len(logs))
    weight = float(place @ place)
    slope = float(place @ logs) / weight
    residual = logs - logs.sum() / len(logs) - slope * place
    return -slope, float(np.sqrt(residual @ residual / (len(logs) - 2) / weight))
