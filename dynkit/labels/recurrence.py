"""Recurrence of section states: how well a motion repeats itself, and whether it still settles."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, wraps
from typing import Any, TypeAlias, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array

_Indices: TypeAlias = NDArray[np.intp]
_Found = TypeVar("_Found")

REPETITIONS = 3
"""A period is believed when the window holds it this many times: two full repetitions."""

# No orbit is split in two when it recurs this well, relative; below the second, distances are
# rounding and say nothing about a decay.
_SPLIT, _ROUNDING = 1e-10, 1e-13
# A decay is fitted to so many recurrences at least: three in each half, for their errors.
_FIT = 6
# A decay is extrapolated when it was seen over so many recurrences, and fell by a factor 3.
_DECAY_RECURRENCES, _DECAY_DEPTH = 10, np.log(3.0)
# Two candidate periods n and kn that differ by less than this, relative, may be one still settling.
_CLOSE = 0.03


def _once(method: Callable[["Recurrences", int], _Found]) -> Callable[["Recurrences", int], _Found]:
    """Work out what a method says of a period when it is first asked for."""

    @wraps(method)
    def known(self: "Recurrences", n: int) -> _Found:
        key = method.__name__, n
        if key not in self._known:
            self._known[key] = method(self, n)
        found: _Found = self._known[key]
        return found

    return known


@final
class Recurrences:
    """Distances between the states of one window, relative to the largest of them.

    Parameters
    ----------
    states : (k, d) array
    times : (k,) array or None
        When they occur, in periods of the forcing.
    difference : callable
        a - b of states (..., d).
    """

    def __init__(
        self, states: Array, times: Array | None, difference: Callable[[Array, Array], Array]
    ) -> None:
        self.states = states
        self.times = times
        self.difference = difference
        self.count = len(states)
        largest = float(np.sqrt(np.einsum("ij,ij->i", states, states).max(initial=0.0)))
        self.scale = largest if largest > 0.0 else 1.0
        self._known: dict[tuple[str, int], Any] = {}

    def distances(self, later: slice | _Indices, earlier: slice | _Indices) -> Array:
        """Distances of states to earlier ones; the time between counts by what it is not whole."""
        gap = self.difference(self.states[later], self.states[earlier])
        distance: Array = np.sqrt(np.einsum("ij,ij->i", gap, gap)) / self.scale
        if self.times is None:
            return distance
        elapsed = self.times[later] - self.times[earlier]
        whole = np.rint(elapsed)
        distance = np.hypot(distance, elapsed - whole)
        # the bounces of a chatter are alike, but no period of the forcing passes between them
        distance[whole == 0.0] = np.inf
        return distance

    def gaps(self, later: _Indices, earlier: _Indices) -> Array:
        """Differences (k, d) of states to earlier ones, relative; with times, (k, d + 1)."""
        gap = self.difference(self.states[later], self.states[earlier]) / self.scale
        if self.times is None:
            return gap
        elapsed = self.times[later] - self.times[earlier]
        return np.column_stack([gap, elapsed - np.rint(elapsed)])

    @cached_property
    def from_last(self) -> Array:
        """Distance of the last state to the one n before it, at index n - 1."""
        return self.distances(slice(-1, None), slice(None, -1))[::-1]

    def periods(self, n: int) -> int | None:
        """Periods of the forcing in the last n states; None where there is none."""
        return None if self.times is None else round(self.times[-1] - self.times[-1 - n])

    @_once
    def spread(self, n: int) -> float:
        """The largest distance of a state to its counterpart in the window's last n states."""
        early = np.arange(self.count - n)
        return float(self.distances(self._counterparts(early, n), early).max())

    def _counterparts(self, i: int | _Indices, n: int | _Indices) -> _Indices:
        return np.asarray(self.count - n + (i - self.count) % n)

    @_once
    def steps(self, n: int) -> Array:
        """The largest distance over n, for each period of n states but the first, in time order."""
        begin = self.count % n
        distance = self.distances(slice(begin + n, None), slice(begin, -n))
        return np.asarray(distance.reshape(-1, n).max(axis=1))

    def recurrent(self, tolerance: float) -> int | None:
        """The period n that recurs throughout the window, or None when it is not certain."""
        likely = np.flatnonzero(self.from_last[: self.count // REPETITIONS] <= tolerance) + 1
        # the first state is the worst of a motion that settles: it rules most of the others out
        first = self.distances(self._counterparts(0, likely), np.zeros_like(likely))
        for n in likely[first <= tolerance].tolist():
            if self.spread(n) <= tolerance:
                return self._resolved(n)
        return None

    def _resolved(self, n: int) -> int | None:
        """Tell a period n from its multiples, and from its divisors."""
        if self.spread(n) > _SPLIT:
            factor = None if self._decay(n).leaves else self._split(n)
            if factor is None:
                return None
            n *= factor
        rest = self.rest(n)
        for divisor in _proper_divisors(n):
            clear = _CLOSE if rest == np.inf else 3.0 * rest
            if self.steps(divisor)[-1] <= clear or self._decay(divisor).settles:
                return None
        return n

    def _split(self, n: int) -> int | None:
        """The factor of a multiple of n that recurs better by far; None when it is not certain."""
        reach = self.from_last[: self.count // REPETITIONS]
        for factor in range(2, len(reach) // n + 1):
            if reach[factor * n - 1] < 0.1 * reach[n - 1]:
                rest = self.rest(factor * n)
                if rest == np.inf:
                    return None
                if 3.0 * rest < self.steps(n)[-1]:
                    return factor
        return 1

    @_once
    def _decay(self, n: int) -> "_Decay":
        return _Decay.of(self.steps(n))

    def rest(self, n: int) -> float:
        """How far the last states may be from the periodic orbit; infinite when it is not known."""
        spread = self.spread(n)
        if spread <= _SPLIT:
            return spread
        decay = self._decay(n)
        if decay.count < _FIT or decay.leaves:
            return np.inf
        return decay.rest if decay.rate > 3.0 * decay.error else spread

    @property
    def decays(self) -> bool:
        """Whether the last state's best recurrence gets better, geometrically."""
        return self._best > 0 and self._decay(self._best).geometric

    def settling(self, near: float) -> int | None:
        """The period of the orbit that the motion settles on and has come near to."""
        for n in [*_proper_divisors(self._best), self._best] if self._best else []:
            decay = self._decay(n)
            # the smallest period that settles is the one: its multiples only look better
            if decay.settles:
                certain = decay.count >= _DECAY_RECURRENCES and decay.rest <= near
                apart = all(self.steps(k)[-1] > 3.0 * decay.rest for k in _proper_divisors(n))
                return n if certain and apart else None
        return None

    @cached_property
    def _best(self) -> int:
        """The period, seen often enough for a decay, that recurs best; zero for none."""
        reach = self.from_last[: self.count // (_DECAY_RECURRENCES + 1)]
        return int(np.argmin(reach)) + 1 if len(reach) else 0


@dataclass(frozen=True)
class _Decay:
    """Recurrence distances d_j fitted by d_0 exp(-rate j)."""

    count: int
    rate: float = 0.0
    error: float = np.inf
    bend: float = np.inf  # difference of the rates of both halves, beyond three standard errors
    rest: float = np.inf  # sum of the geometric series after the last distance

    @classmethod
    def of(cls, steps: Array) -> "_Decay":
        last = float(steps[-1])
        below = np.flatnonzero(~((steps > _ROUNDING) & np.isfinite(steps)))
        if len(below):  # fit the fall to the rounding level, or the rise from it
            steps = steps[: below[0]] if below[-1] == len(steps) - 1 else steps[below[-1] + 1 :]
        logs = np.log(steps)
        if len(logs) < _FIT:
            return cls(len(logs))
        rate, error = _rate(logs)
        half = len(logs) // 2
        early, early_error = _rate(logs[:half])
        late, late_error = _rate(logs[half:])
        bend = abs(early - late) - 3.0 * float(np.hypot(early_error, late_error))
        rest = float(last / np.expm1(rate)) if rate > 0.0 else np.inf
        return cls(len(logs), rate, error, bend, rest)

    @property
    def geometric(self) -> bool:
        """Whether the ratio is below 1 by five standard errors, and the same early and late."""
        return self.rate > 5.0 * self.error and self.bend <= 0.2 * self.rate

    @property
    def settles(self) -> bool:
        return self.geometric and self.rate * (self.count - 1) >= _DECAY_DEPTH

    @property
    def leaves(self) -> bool:
        return self.rate < -5.0 * self.error and self.rate * (self.count - 1) <= -1.0


def _rate(logs: Array) -> tuple[float, float]:
    """Rate of decrease, and its standard error, of a straight line through equidistant values."""
    place = np.arange(len(logs)) - 0.5 * (len(logs) - 1)
    weight = float(place @ place)
    slope = float(place @ logs) / weight
    residual = logs - logs.mean() - slope * place
    return -slope, float(np.sqrt(residual @ residual / (len(logs) - 2) / weight))


def _proper_divisors(n: int) -> list[int]:
    return [k for k in range(1, n // 2 + 1) if n % k == 0]
