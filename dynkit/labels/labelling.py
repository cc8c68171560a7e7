"""Labels from the recurrence of section states; chaos from the growth of disturbances."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, final

import numpy as np

from dynkit.core.kept import copied
from dynkit.core.validation import Array, positive, positive_integer
from dynkit.labels.label import OrbitKind, OrbitLabel
from dynkit.labels.recurrence import REPETITIONS, Recurrences
from dynkit.labels.rotation import Rotation, rotation_of
from dynkit.orbits.multipliers import MARGIN, PROBES, disturbed_eigenvalues, product_eigenvalues

# Largest distance of the extrapolated orbit of a geometric decay: _NEAR tolerances, or
# _NEAR_AT_LAST relative to the largest state when the budget ends.
_NEAR, _NEAR_AT_LAST = 100.0, 1e-2
# Growth is measured only after _CHAOS_AFTER undecided states, and averaged over _BATCHES batches.
_CHAOS_AFTER, _BATCHES = 800, 16
_BUDGET = 20_000
# Error of a map's derivative in units of its accuracy: flows integrate derivatives with a separate
# accuracy, and in maps rounding grows along a period.
_DERIVATIVES = 1e3
# Factor of the remaining change of a multiplier, which is estimated as that of a geometric decay:
# near a fold the change decreases like a power of time, and more of it remains.
_LATER = 3.0

UNKNOWN = 0.0, False
"""The `attraction` of an orbit without derivatives."""


@final
@dataclass(frozen=True, eq=False)
class Window:
    """Consecutive section states of an orbit.

    Parameters
    ----------
    states : (k, d) array
        Section states, without the phase where times are given.
    times : (k,) array or None
        Their times in periods of the forcing, on one clock for all windows of an orbit. None for a
        map without forcing.
    releases : (j, e) array or None
        States at releases from sticking contact during the window, without the phase.
    release_times : (j,) array or None
        Times of the releases, on the same clock.
    release_error : callable or None
        Function (n, size) that returns the error of the n-th release after the first, from rounding
        since the beginning of the window: the largest error of a coordinate, relative to the size,
        or of the phase. None for exact releases.
    given_up : bool
        Whether the search for the next state was given up, if there are fewer states than
        requested.
    resolves : callable or None
        Function of n that returns whether the map is nearly linear over the distances of the
        states to their counterparts in the last n ones. Otherwise these distances may be those of a
        nonlinear motion, and no recurrence. None where motions are never so small without being
        periodic.
    attraction : callable or None
        Function (n, m) that returns the `attraction` of an orbit of n states or releases, and m
        periods of the forcing, from the derivatives over the last two periods; `UNKNOWN` without
        these. None where it is not known.
    """

    states: Array
    times: Array | None = None
    releases: Array | None = None
    release_times: Array | None = None
    release_error: Callable[[int, float], float] | None = None
    given_up: bool = False
    resolves: Callable[[int], bool] | None = None
    attraction: Callable[[int, int | None], tuple[float, bool]] | None = None


class OrbitSource(Protocol):
    """An orbit that can be simulated further, as `label_orbit` requires.

    Attributes
    ----------
    accuracy : float
        Error of one iterate, relative to the size of the state.
    """

    accuracy: float

    def more(self, count: int) -> Window:
        """Return the next count states; the first call begins with the first state of the orbit.

        Fewer than count states mean that no more follow, or that the search was given up.
        """
        ...

    def difference(self, a: Array, b: Array) -> Array:
        """Return a - b, (..., d), for states or releases; angles wrapped to the shortest way."""
        ...

    def growth(self, steps: int) -> Array:
        """Return the logarithmic growth of a disturbance over the next `steps` states, by blocks.

        The blocks are consecutive and have the same length in all calls; each call returns 64 or
        more. It does not change the states that `more` returns next.
        """
        ...


def label_orbit(
    source: OrbitSource, *, kept: int = 100, tolerance: float = 1e-6, budget: int | None = None
) -> OrbitLabel:
    """Label an orbit by the recurrence of its section states.

    The states are examined in windows. The first window has the kept states; each further window
    has as many states as all windows before it. In each window:

    - P(n,m): n is the smallest number such that all states n apart agree within the tolerance
      throughout the window, which holds at least three periods, and are m >= 1 periods of the
      forcing apart. When a multiple of n recurs much better, and the recurrence of n does not
      decrease, the multiple is the period (a period doubling smaller than the tolerance, down to
      1e-10). A recurrence is no sign of a period if the derivative of the map varies by a tenth
      over its distances, because these may be those of a small nonlinear motion. It is none
      either if the states drift from period to period, as a motion does that passes slowly beside
      a fold. When n is a multiple of a period on which the orbit may still settle, the next
      window decides.
    - P(inf,m): a window with releases from sticking contact is decided by the states at release.
      Contact removes all memory of the motion before it: in double precision, two equal releases
      repeat exactly even if the motion between them is chaotic, and rounding decides which contact
      ends it. Therefore the error of the release a period later must also be within the tolerance.
    - A motion that settles geometrically gets the label of the orbit that it approaches, when the
      ratio of its decay is below 1 by five standard errors, the decay does not slow down, and the
      extrapolated orbit is within 100 tolerances (1e-2 when the budget ends). The orbit of an
      impact machine must also be that near by its `attraction`, because a small disturbance that
      decays slowly is hidden behind a large one. If the map has derivatives, it must also be
      certain that the orbit is stable, or that it is unstable: see `with_multiplier`.
    - A motion also gets the label of an orbit that is certain to attract by its multipliers, when
      the derivative of the map shows that the last state is within the tolerance of this orbit: see
      `attraction`.
    - After 800 states, a motion that neither recurs nor settles is chaotic when disturbances grow
      exponentially: their mean growth minus three standard errors is positive, and their total
      growth exceeds that of the square of time. The `chance` is the p-value of Student's t of 16
      batches.
    - When the budget ends, a motion is quasi-periodic when the mean growth is zero within three
      standard errors and that of the square of time, and the states of the last window fill smooth
      closed curves on which they advance by a constant turn: see
      `dynkit.labels.rotation.rotation_of`.

    The label describes only the states examined. A chaotic motion may settle later, and a
    quasi-periodic motion may be a periodic orbit with a period longer than the window, or a very
    slow decay.

    Parameters
    ----------
    source : OrbitSource
    kept : int
        States in the first window.
    tolerance : float
        Largest recurrence of a periodic motion, relative to the largest state of the window.
    budget : int, optional
        Largest number of states to examine besides the kept ones, those for the growth included; by
        default 20,000, or four times the kept ones where that is more.

    Raises
    ------
    ValueError
        When kept or budget is not a count, or the tolerance is not positive.
    """
    began = time.perf_counter()
    label = _decided(source, kept, tolerance, budget)
    return copied(label, seconds=time.perf_counter() - began)


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
            doubt = np.inf if window.given_up else 0.0
            return OrbitLabel(OrbitKind.NO_IMPACTS, None, None, tolerance, doubt, spent)
        if window.releases is not None and len(window.releases):
            orbit = Recurrences(window.releases, window.release_times, source.difference)
        else:
            orbit = Recurrences(window.states, window.times, source.difference)
        nearest = float(orbit.from_last.min(initial=np.inf))
        period = orbit.recurrent(tolerance)
        if period is not None and window.resolves is not None and not window.resolves(period):
            period = None
        period = period or orbit.settling(_NEAR * tolerance, window.attraction)
        if period is None and window.attraction is not None:
            period = orbit.attracted(tolerance, window.attraction)
        if period is not None and not _is_certain(window, period, orbit.scale, tolerance):
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
            period = orbit.settling(_NEAR_AT_LAST, window.attraction)
            if period and not _is_certain(window, period, orbit.scale, _NEAR_AT_LAST):
                period = None
        if period is not None:
            return _periodic_label(orbit, period, window, tolerance, spent)
        if ends:
            # without a measured growth the motion is unsettled, whatever its states show
            neutral = growth and not orbit.decays and _neither_part_nor_meet(growth, spent)
            rotation = rotation_of(orbit, tolerance, source.accuracy) if neutral else None
            if rotation and _is_certain(window, orbit.count - 1, orbit.scale, tolerance):
                return _quasi_periodic_label(rotation, tolerance, spent)
            return OrbitLabel(OrbitKind.UNSETTLED, None, None, tolerance, nearest, spent)


def with_multiplier(
    label: OrbitLabel, last: Array, before: Array, accuracy: float, errors: Array | None = None
) -> OrbitLabel:
    """Return the label of a periodic orbit with its `multiplier`.

    A motion that does not recur yet, and whose orbit is not certain to be stable or unstable, is
    unsettled: near a resonance, states of a torus approach each other for a while.

    Parameters
    ----------
    label : OrbitLabel
    last, before : (n, d, d) arrays
        Derivatives of the map at the states of the last period, and of the one before it, in the
        order of time. The error estimate is the difference of their multipliers, summed over all
        later periods under the assumption that it decays as disturbances do. It is the larger of
        two sums: of the differences of the modulus, and of those of the complex number.
    accuracy : float
        Relative accuracy of the map.
    errors : (n,) array, optional
        Errors of the entries of the last period's derivatives beyond that accuracy.
    """
    if not (np.isfinite(last).all() and np.isfinite(before).all()):
        return label
    found, error = _multiplier(last, before, accuracy, errors)
    known = copied(label, multiplier=found, multiplier_error=error)
    if label.recurrence > label.tolerance and known.stable is None:
        return replace(label, kind=OrbitKind.UNSETTLED, iterates=None, periods=None)
    return known


def _multiplier(
    last: Array, before: Array, accuracy: float, errors: Array | None
) -> tuple[float, float]:
    """Return the largest modulus of the multipliers, and its error: see `with_multiplier`."""
    (largest, *_), earlier = map(product_eigenvalues, (last, before))
    found, series = float(abs(largest)), np.inf
    if found != 1.0:
        with np.errstate(invalid="ignore"):  # infinite multipliers have no known change
            change = abs(found - abs(earlier[0])) * max(1.0, found / abs(1.0 - found))
            # while a complex pair turns, its modulus may be the same for a moment
            turn = abs(earlier - largest).min() * max(1.0, found / abs(1.0 - largest))
            series = _LATER * float(max(change, turn))
    error = series + _DERIVATIVES * len(last) * accuracy * max(1.0, found)
    if errors is not None:
        random = np.random.default_rng(0)
        probes = [disturbed_eigenvalues(last, errors, random)[0] for _ in range(PROBES)]
        error += MARGIN * float(abs(abs(np.array(probes)) - found).max())
    return found, error


def attraction(last: Array, before: Array, accuracy: float) -> tuple[float, bool]:
    """Return the distance of a motion from a periodic orbit, and whether this orbit attracts.

    The distance is in units of the change of the state over the last period. Let A be the
    derivative over this period, and d the change. To first order, a periodic orbit, stable or
    unstable, is at a distance of |(1 - A)^-1 d| from the state before the change. The first result
    is the norm of (1 - A)^-1. It is the norm in the coordinates of the derivatives; labels compare
    states in section coordinates, and times in periods, where it may differ.

    The second result is whether the multipliers prove that the orbit attracts: see
    `with_multiplier`, also for the arguments. Derivatives that are not finite give `UNKNOWN`.
    """
    if not (np.isfinite(last).all() and np.isfinite(before).all()):
        return UNKNOWN
    found, error = _multiplier(last, before, accuracy, None)
    unit = product = np.eye(last.shape[1])
    with np.errstate(over="ignore", invalid="ignore"):
        for factor in last:
            product = factor @ product
    if not np.isfinite(product).all():
        return UNKNOWN
    least = float(np.linalg.norm(unit - product, -2))
    return 1.0 / least if least else np.inf, found + error < 1.0


def settled_label(
    source: OrbitSource, *, kept: int = 100, tolerance: float = 1e-6, budget: int = 100_000
) -> OrbitLabel:
    """Label the orbit that a motion settles on, also after transient chaos.

    `label_orbit` is repeated from the point where it found chaos, until it finds another kind or
    the budget is spent. A transient longer than the budget looks like sustained chaos.

    Parameters
    ----------
    source, kept, tolerance, budget
        As for `label_orbit`.

    Returns
    -------
    OrbitLabel
        ``transient_chaos`` is positive after transient chaos.

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
        if limit - spent < 4 * _CHAOS_AFTER:  # too few states for another decision
            return label
        chaos, kept = counted.seen, _CHAOS_AFTER


class _Counted:
    """A source that counts the states it returned."""

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
    if found > tolerance:  # the motion settles: its last recurrence is the relevant one
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


def _is_certain(window: Window, period: int, size: float, most: float) -> bool:
    """Whether the rounding error of the release a period later is at most `most`.

    The error is relative to `size`. Without an error estimate the releases are exact.
    """
    return window.release_error is None or window.release_error(period, size) <= most


def _growth_of(growth: list[Array]) -> tuple[int, float, float] | None:
    """Return the number of blocks, their mean, and its standard error; None for too few blocks."""
    # during the first quarter of each run the disturbance turns into the growing direction
    blocks = np.concatenate([np.empty(0), *(run[len(run) // 4 :] for run in growth)])
    if len(blocks) < 2 * _BATCHES or not np.isfinite(blocks).all():
        return None
    size, rest = divmod(len(blocks), _BATCHES)
    edges = [k * size + min(k, rest) for k in range(_BATCHES + 1)]  # the longest batches first
    means = np.add.reduceat(blocks, edges[:-1]) / np.diff(edges)
    return len(blocks), float(means.mean()), float(means.std(ddof=1) / np.sqrt(_BATCHES))


def _parts_exponentially(growth: list[Array], time: int) -> float | None:
    """Return the p-value of zero mean growth where growth is exponential; None elsewhere."""
    count, mean, error = _growth_of(growth) or (0, 0.0, 0.0)
    # disturbances that grow as a power of time, up to the square, do not mean chaos
    if not (mean - 3.0 * error) * count > 2.0 * np.log(time):
        return None
    from scipy.special import stdtr

    return float(stdtr(_BATCHES - 1, -mean / error)) if error else 0.0


def _neither_part_nor_meet(growth: list[Array], time: int) -> bool:
    """Whether disturbances grow or decay on average by no more than a power of time."""
    count, mean, error = _growth_of(growth) or (0, np.inf, 0.0)
    return bool((abs(mean) - 3.0 * error) * count <= 2.0 * np.log(time))
