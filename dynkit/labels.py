"""Orbit labels: P(n,m), P(inf,m), chaotic or unsettled, from the recurrence of section states."""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Protocol, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from dynkit.validation import Array, positive, positive_integer

_Indices: TypeAlias = NDArray[np.intp]

# A period is believed when the window holds it this many times: two full repetitions.
_REPETITIONS = 3
# No orbit is split in two when it recurs this well, relative; below the second, distances are
# rounding and say nothing about a decay.
_SPLIT, _ROUNDING = 1e-10, 1e-13
# A decay is fitted to so many recurrences at least: three in each half, for their errors.
_FIT = 6
# A decay is extrapolated when it was seen over so many recurrences, and fell by a factor 3,
_DECAY_RECURRENCES, _DECAY_DEPTH = 10, np.log(3.0)
# and when the orbit it leads to is this near: in tolerances; relative, when the budget ends.
_NEAR, _NEAR_AT_LAST = 100.0, 1e-2
# Two candidate periods n and kn that differ by less than this, relative, may be one still settling.
_CLOSE = 0.03
# Growth is asked for only when so many states did not decide; and is averaged over batches.
_CHAOS_AFTER, _BATCHES = 800, 16


class OrbitKind(Enum):
    """What kind of motion an orbit is; the value is what the user reads."""

    PERIODIC = "periodic"
    STICKING = "periodic with sticking"
    CHAOTIC = "chaotic"
    UNSETTLED = "unsettled"
    AT_REST = "at rest"


@final
@dataclass(frozen=True)
class OrbitLabel:
    """The label of an orbit, and what it was decided from.

    Parameters
    ----------
    kind : OrbitKind
    impacts : int or None
        n of P(n,m): impacts, or iterates of a map, in one period. None for P(inf,m) and whatever
        is not periodic.
    periods : int or None
        m of P(n,m): table periods in one period. None for a map that has no table.
    tolerance : float
        Recurrence that counts as periodic, relative to the largest state of the window.
    recurrence : float
        Recurrence that was found, in the same units. For a periodic orbit the largest distance
        between states a period apart; it may exceed the tolerance when the orbit was seen to settle
        geometrically. Otherwise the smallest distance of the last state to an earlier one, or
        infinity when there was none to compare.
    simulated : int
        States that were looked at, those of twin runs for the growth of disturbances included.

    Examples
    --------
    >>> str(OrbitLabel(OrbitKind.PERIODIC, 5, 2, 1e-6, 3e-14, 100))
    'P(5,2)'
    >>> str(OrbitLabel(OrbitKind.PERIODIC, 4, None, 1e-6, 0.0, 100))
    'P(4)'
    """

    kind: OrbitKind
    impacts: int | None
    periods: int | None
    tolerance: float
    recurrence: float
    simulated: int

    def __str__(self) -> str:
        if self.kind is OrbitKind.STICKING:
            return f"P(inf,{self.periods})"
        if self.kind is OrbitKind.PERIODIC:
            numbers = (self.impacts, self.periods)
            return f"P({','.join(str(n) for n in numbers if n is not None)})"
        return str(self.kind.value)


@final
@dataclass(frozen=True, eq=False)
class Window:
    """Consecutive section states of an orbit.

    Parameters
    ----------
    states : (k, d) array
        Section states, without the phase where times are given.
    times : (k,) array or None
        When they occur, in table periods, on a clock that runs through all windows of an orbit.
        None for a map that has no table.
    releases : (j, e) array or None
        States at which the motion left sticking contact, during the window; without the phase.
    release_times : (j,) array or None
        When it did, on the same clock.
    """

    states: Array
    times: Array | None = None
    releases: Array | None = None
    release_times: Array | None = None


class OrbitSource(Protocol):
    """An orbit that can be followed on, as `label_orbit` asks for it."""

    def more(self, count: int) -> Window:
        """Return the next count states; the first call begins with the first state of the orbit.

        Fewer states than asked for say that the motion came to rest, and no more will come.
        """
        ...

    def difference(self, a: Array, b: Array) -> Array:
        """Return a - b, (..., d), for states or releases; angles wrapped to the shortest way."""
        ...

    def growth(self, steps: int) -> Array:
        """Return how nearby states part over the next steps states: log growth, block by block.

        The blocks follow one another and are all of one length, in every call; 64 or more to a
        call. It does not change what `more` returns next.
        """
        ...


def label_orbit(
    source: OrbitSource, *, kept: int = 100, tolerance: float = 1e-6, budget: int = 20000
) -> OrbitLabel:
    """Label an orbit by the recurrence of its section states.

    The states are taken in windows: the kept ones, then as many again as were seen so far, and so
    on. In each window:

    - P(n,m) is the smallest n such that all states n apart agree within the tolerance throughout
      the window, at least three periods of it, and are m >= 1 table periods apart. When a multiple
      of n recurs better by far, and n does not get better (a period doubling smaller than the
      tolerance, down to 1e-10), the multiple is taken. When n is a multiple of a period that the
      orbit may still be settling on, more is looked at.
    - A window with releases from sticking contact is decided on the states at release: P(inf,m).
    - A motion that settles geometrically is taken for the orbit that it settles on, when the ratio
      of its decay is below 1 by five standard errors, is the same in both halves of the window, and
      the extrapolated orbit is within 100 tolerances (1e-2 when the budget ends).
    - From 800 states on, a motion that neither recurs nor settles is chaotic when nearby states
      part exponentially: when their mean growth less three standard errors is positive, and amounts
      to more than that of the square of time.

    `chaotic` speaks of the states looked at, not of later. Quasi-periodic motion is `unsettled`.

    Parameters
    ----------
    source : OrbitSource
    kept : int
        States in the first window.
    tolerance : float
        Recurrence that counts as periodic, relative to the largest state of the window.
    budget : int
        The most states to look at, twin runs included; the kept ones are always looked at.

    Raises
    ------
    ValueError
        When kept or budget are no counts, or the tolerance is not positive.
    """
    request = positive_integer("kept", kept)
    limit = positive_integer("budget", budget)
    tolerance = positive("tolerance", tolerance)
    seen = spent = 0
    growth: list[Array] = []
    while True:
        window = source.more(request)
        seen, spent = seen + len(window.states), spent + len(window.states)
        if len(window.states) < request:
            return OrbitLabel(OrbitKind.AT_REST, None, None, tolerance, np.inf, spent)
        orbit = _recurrences(window, source)
        nearest = float(orbit.from_last.min(initial=np.inf))
        period = orbit.recurrent(tolerance) or orbit.settling(_NEAR * tolerance)
        if period is None and seen >= _CHAOS_AFTER and not orbit.decays:
            steps = min(seen, (limit - spent) // 2)
            if steps >= _CHAOS_AFTER:
                spent += 2 * steps
                growth.append(source.growth(steps))
                if _parts_exponentially(growth, spent):
                    return OrbitLabel(OrbitKind.CHAOTIC, None, None, tolerance, nearest, spent)
        request = min(max(seen, _REPETITIONS), limit - spent)
        ends = 2 * request < seen
        if period is None and ends:
            period = orbit.settling(_NEAR_AT_LAST)
        if period is not None:
            return _periodic_label(orbit, period, window, tolerance, spent)
        if ends:
            return OrbitLabel(OrbitKind.UNSETTLED, None, None, tolerance, nearest, spent)


def _periodic_label(
    orbit: "_Recurrences", n: int, window: Window, tolerance: float, spent: int
) -> OrbitLabel:
    found = float(orbit.steps(n).max())
    if found > tolerance:  # it settles: only what it came to counts
        found = float(orbit.steps(n)[-1])
    if orbit.states is window.releases:
        return OrbitLabel(OrbitKind.STICKING, None, orbit.periods(n), tolerance, found, spent)
    return OrbitLabel(OrbitKind.PERIODIC, n, orbit.periods(n), tolerance, found, spent)


def _recurrences(window: Window, source: OrbitSource) -> "_Recurrences":
    if window.releases is not None and len(window.releases) > 0:
        return _Recurrences(window.releases, window.release_times, source)
    return _Recurrences(window.states, window.times, source)


class _Recurrences:
    """Distances between the states of one window, relative to the largest of them."""

    def __init__(self, states: Array, times: Array | None, source: OrbitSource) -> None:
        self.states = states
        self.times = times
        self.source = source
        self.count = len(states)
        largest = float(np.sqrt(np.einsum("ij,ij->i", states, states).max(initial=0.0)))
        self.scale = largest if largest > 0.0 else 1.0

    def distances(self, later: slice | _Indices, earlier: slice | _Indices) -> Array:
        gap = self.source.difference(self.states[later], self.states[earlier])
        distance: Array = np.sqrt(np.einsum("ij,ij->i", gap, gap)) / self.scale
        if self.times is None:
            return distance
        elapsed = self.times[later] - self.times[earlier]
        whole = np.rint(elapsed)
        distance = np.hypot(distance, elapsed - whole)
        # the bounces of a chatter sequence are alike, but no table period passes between them
        distance[whole == 0.0] = np.inf
        return distance

    @cached_property
    def from_last(self) -> Array:
        """Distance of the last state to the one n before it, at index n - 1."""
        return self.distances(slice(-1, None), slice(None, -1))[::-1]

    def periods(self, n: int) -> int | None:
        return None if self.times is None else round(self.times[-1] - self.times[-1 - n])

    def spread(self, n: int) -> float:
        """The largest distance of a state to its counterpart in the window's last n states."""
        early = np.arange(self.count - n)
        return float(self.distances(self._counterparts(early, n), early).max())

    def _counterparts(self, i: int | _Indices, n: int | _Indices) -> _Indices:
        return np.asarray(self.count - n + (i - self.count) % n)

    def steps(self, n: int) -> Array:
        """The largest distance over n, for each period of n states but the first, in time order."""
        begin = self.count % n
        distance = self.distances(slice(begin + n, None), slice(begin, -n))
        return np.asarray(distance.reshape(-1, n).max(axis=1))

    def recurrent(self, tolerance: float) -> int | None:
        """The period n that recurs throughout the window, or None when it is not certain."""
        likely = np.flatnonzero(self.from_last[: self.count // _REPETITIONS] <= tolerance) + 1
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
        reach = self.from_last[: self.count // _REPETITIONS]
        for factor in range(2, len(reach) // n + 1):
            if reach[factor * n - 1] < 0.1 * reach[n - 1]:
                rest = self.rest(factor * n)
                if rest == np.inf:
                    return None
                if 3.0 * rest < self.steps(n)[-1]:
                    return factor
        return 1

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


def _parts_exponentially(growth: list[Array], time: int) -> bool:
    # the first quarter of each run turns the disturbance into the direction that grows
    blocks = np.concatenate([run[len(run) // 4 :] for run in growth])
    if len(blocks) < 2 * _BATCHES or not np.isfinite(blocks).all():
        return False
    means = np.array([batch.mean() for batch in np.array_split(blocks, _BATCHES)])
    sure = means.mean() - 3.0 * means.std(ddof=1) / np.sqrt(_BATCHES)
    # disturbances that grow as a power of time, up to the square, are no chaos
    return bool(sure * len(blocks) > 2.0 * np.log(time))
