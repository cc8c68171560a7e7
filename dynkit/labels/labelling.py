"""Labels are decided from the recurrence of section states, and chaos from growth."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, final

import numpy as np

from dynkit.core.validation import Array, positive, positive_integer
from dynkit.labels.label import OrbitKind, OrbitLabel
from dynkit.labels.recurrence import REPETITIONS, Recurrences
from dynkit.labels.rotation import Rotation, rotation_of
from dynkit.orbits.multipliers import MARGIN, PROBES, disturbed_eigenvalues, product_eigenvalues

# A decay is extrapolated when the orbit it leads to is this near: in tolerances; relative, when the
# budget ends.
_NEAR, _NEAR_AT_LAST = 100.0, 1e-2
# Growth is asked for only when so many states did not decide; and is averaged over batches.
_CHAOS_AFTER, _BATCHES = 800, 16
_BUDGET = 20_000
# A derivative of a map may be wrong by so many times its accuracy: in flows it is integrated beside
# the motion, with an accuracy of its own; in maps rounding grows along a period.
_DERIVATIVES = 1e3


@final
@dataclass(frozen=True, eq=False)
class Window:
    """Consecutive section states of an orbit.

    Parameters
    ----------
    states : (k, d) array
        Section states, without the phase where times are given.
    times : (k,) array or None
        When they occur, in periods of the forcing, on a clock that runs through all windows of an
        orbit.
        None for a map that has no forcing.
    releases : (j, e) array or None
        States at which the motion left sticking contact, during the window; without the phase.
    release_times : (j,) array or None
        When it did, on the same clock.
    release_error : callable or None
        Return the largest error of a number of the n-th release after the first, by what rounding
        does from the beginning of the window on; n is asked for where a period is found. None for
        exact ones.
    """

    states: Array
    times: Array | None = None
    releases: Array | None = None
    release_times: Array | None = None
    release_error: Callable[[int], float] | None = None


class OrbitSource(Protocol):
    """An orbit that can be followed on, as `label_orbit` asks for it.

    Attributes
    ----------
    accuracy : float
        How wrong a state may be that follows from another one, relative to its size.
    """

    accuracy: float

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
    source: OrbitSource, *, kept: int = 100, tolerance: float = 1e-6, budget: int | None = None
) -> OrbitLabel:
    """Label an orbit by the recurrence of its section states.

    The states are taken in windows: the kept ones, then as many again as were seen so far, and so
    on. In each window:

    - P(n,m) is the smallest n such that all states n apart agree within the tolerance throughout
      the window, at least three periods of it, and are m >= 1 periods of the forcing apart. When a
      multiple of n recurs better by far, and n does not get better (a period doubling smaller than
      the tolerance, down to 1e-10), the multiple is taken. When n is a multiple of a period that
      the orbit may still be settling on, more is looked at.
    - A window with releases from sticking contact is decided on the states at release: P(inf,m).
      Contact forgets: doubles that are released twice alike repeat themselves to the last digit,
      also where chaos lies between, and which contact ends it is a matter of rounding. So the error
      of the release a period later must be within the tolerance, too.
    - A motion that settles geometrically is taken for the orbit that it settles on, when the ratio
      of its decay is below 1 by five standard errors, is the same in both halves of the window, and
      the extrapolated orbit is within 100 tolerances (1e-2 when the budget ends).
    - From 800 states on, a motion that neither recurs nor settles is chaotic when nearby states
      part exponentially: when their mean growth less three standard errors is positive, and amounts
      to more than that of the square of time. The `chance` is Student's t of 16 batches.
    - When the budget ends, a motion is quasi-periodic when the mean growth is zero within three
      standard errors and that of the square of time, and the states of the last window fill smooth
      closed curves, on which they advance by a constant turn: see
      `dynkit.labels.rotation.rotation_of`.

    `chaotic` speaks of the states looked at, not of later. So does `quasi-periodic`: a periodic
    orbit of a period longer than the window, or a decay far slower than it, is not told from it.

    Parameters
    ----------
    source : OrbitSource
    kept : int
        States in the first window.
    tolerance : float
        Recurrence that counts as periodic, relative to the largest state of the window.
    budget : int, optional
        The most states to look at, those for the growth included, but for the kept ones, which
        are always looked at; by default 20,000, or four times the kept ones where that is more.

    Raises
    ------
    ValueError
        When kept or budget are no counts, or the tolerance is not positive.
    """
    began = time.perf_counter()
    label = _decided(source, kept, tolerance, budget)
    return replace(label, seconds=time.perf_counter() - began)


def _decided(source: OrbitSource, kept: int, tolerance: float, budget: int | None) -> OrbitLabel:
    request = positive_integer("kept", kept)
    limit = max(_BUDGET, 4 * request) if budget is None else positive_integer("budget", budget)
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
        if period is not None and not _is_certain(window, period, tolerance * orbit.scale):
            period = None
        if period is None and seen >= _CHAOS_AFTER and not orbit.decays:
            steps = min(seen, (limit - spent) // 2)
            if steps >= _CHAOS_AFTER:
                spent += 2 * steps
                growth.append(source.growth(steps))
                chance = _parts_exponentially(growth, spent)
                if chance is not None:
                    found = (tolerance, nearest, spent)
                    return OrbitLabel(OrbitKind.CHAOTIC, None, None, *found, chance=chance)
        request = min(max(seen, REPETITIONS), limit - spent)
        ends = 2 * request < seen
        if period is None and ends:
            period = orbit.settling(_NEAR_AT_LAST)
            nearly = _NEAR_AT_LAST * orbit.scale
            if period is not None and not _is_certain(window, period, nearly):
                period = None
        if period is not None:
            return _periodic_label(orbit, period, window, tolerance, spent)
        if ends:
            neutral = not orbit.decays and _neither_part_nor_meet(growth, spent)
            rotation = rotation_of(orbit, tolerance, source.accuracy) if neutral else None
            if rotation and _is_certain(window, orbit.count - 1, tolerance * orbit.scale):
                return _quasi_periodic_label(rotation, tolerance, spent)
            return OrbitLabel(OrbitKind.UNSETTLED, None, None, tolerance, nearest, spent)


def with_multiplier(
    label: OrbitLabel, last: Array, before: Array, accuracy: float, errors: Array | None = None
) -> OrbitLabel:
    """Return the label of a periodic orbit with its `multiplier`.

    Parameters
    ----------
    label : OrbitLabel
    last, before : (n, d, d) arrays
        Derivatives of the map at the states of the last period, and of the one before it, in the
        order of time. The difference of their multipliers is the error, summed up over all periods
        to come when it falls by as much in each as disturbances do.
    accuracy : float
        Of the map, relative.
    errors : (n,) array, optional
        How wrong entries of the derivatives of the last period may be beyond that.
    """
    if not (np.isfinite(last).all() and np.isfinite(before).all()):
        return label
    found, earlier = (float(abs(product_eigenvalues(factors)[0])) for factors in (last, before))
    apart = abs(1.0 - found)
    change = abs(found - earlier)
    series = change * max(1.0, found / apart) if apart else np.inf
    error = series + _DERIVATIVES * len(last) * accuracy * max(1.0, found)
    if errors is not None:
        random = np.random.default_rng(0)
        probes = [disturbed_eigenvalues(last, errors, random)[0] for _ in range(PROBES)]
        error += MARGIN * float(abs(abs(np.array(probes)) - found).max())
    return replace(label, multiplier=found, multiplier_error=error)


def settled_label(
    source: OrbitSource, *, kept: int = 100, tolerance: float = 1e-6, budget: int = 100_000
) -> OrbitLabel:
    """Label the orbit that a motion settles on, when it was chaotic before too.

    `label_orbit`, again and again from where it found chaos, until it finds something else or the
    budget is spent. What stays chaotic may still settle later.

    Parameters
    ----------
    source, kept, tolerance, budget
        As for `label_orbit`.

    Returns
    -------
    OrbitLabel
        ``transient_chaos`` is positive when chaos passed before.

    Raises
    ------
    ValueError
        As `label_orbit`.
    """
    limit = positive_integer("budget", budget)
    counted = _Counted(source)
    began, spent, chaos = time.perf_counter(), 0, 0
    while True:
        label = label_orbit(counted, kept=kept, tolerance=tolerance, budget=limit - spent)
        spent += label.simulated
        label = replace(label, simulated=spent, seconds=time.perf_counter() - began)
        if label.kind is not OrbitKind.CHAOTIC:
            return replace(label, transient_chaos=chaos)
        if limit - spent < 4 * _CHAOS_AFTER:  # too few to tell chaos from what follows it
            return label
        chaos, kept = counted.seen, _CHAOS_AFTER


class _Counted:
    """A source that counts the states which it gave."""

    def __init__(self, source: OrbitSource) -> None:
        self._source = source
        self.seen = 0
        self.difference, self.growth = source.difference, source.growth
        self.accuracy = source.accuracy

    def more(self, count: int) -> Window:
        window = self._source.more(count)
        self.seen += len(window.states)
        return window


def _periodic_label(
    orbit: Recurrences, n: int, window: Window, tolerance: float, spent: int
) -> OrbitLabel:
    found = float(orbit.steps(n).max())
    if found > tolerance:  # it settles: only what it came to counts
        found = float(orbit.steps(n)[-1])
    if orbit.states is window.releases:
        return OrbitLabel(OrbitKind.STICKING, None, orbit.periods(n), tolerance, found, spent)
    return OrbitLabel(OrbitKind.PERIODIC, n, orbit.periods(n), tolerance, found, spent)


def _quasi_periodic_label(rotation: Rotation, tolerance: float, spent: int) -> OrbitLabel:
    found = (tolerance, rotation.distance, spent)
    return OrbitLabel(
        *(OrbitKind.QUASI_PERIODIC, None, None, *found),
        rotation_number=rotation.number,
        rotation_error=rotation.error,
        curves=rotation.curves,
    )


def _recurrences(window: Window, source: OrbitSource) -> Recurrences:
    if window.releases is not None and len(window.releases) > 0:
        return Recurrences(window.releases, window.release_times, source.difference)
    return Recurrences(window.states, window.times, source.difference)


def _is_certain(window: Window, period: int, most: float) -> bool:
    """Whether rounding moves the release a period later by no more than this."""
    return window.release_error is None or window.release_error(period) <= most


def _growth_of(growth: list[Array]) -> tuple[int, float, float] | None:
    """How many blocks there are, their mean and its standard error; None for too few of them."""
    # the first quarter of each run turns the disturbance into the direction that grows
    blocks = np.concatenate([np.empty(0), *(run[len(run) // 4 :] for run in growth)])
    if len(blocks) < 2 * _BATCHES or not np.isfinite(blocks).all():
        return None
    means = np.array([batch.mean() for batch in np.array_split(blocks, _BATCHES)])
    return len(blocks), float(means.mean()), float(means.std(ddof=1) / np.sqrt(_BATCHES))


def _parts_exponentially(growth: list[Array], time: int) -> float | None:
    """The chance of growth like this where there is none on average; None where it is not sure."""
    count, mean, error = _growth_of(growth) or (0, 0.0, 0.0)
    # disturbances that grow as a power of time, up to the square, are no chaos
    if not (mean - 3.0 * error) * count > 2.0 * np.log(time):
        return None
    from scipy.special import stdtr

    return float(stdtr(_BATCHES - 1, -mean / error)) if error else 0.0


def _neither_part_nor_meet(growth: list[Array], time: int) -> bool:
    """Whether disturbances grow or decay on average by no more than a power of time."""
    count, mean, error = _growth_of(growth) or (0, np.inf, 0.0)
    return bool((abs(mean) - 3.0 * error) * count <= 2.0 * np.log(time))
