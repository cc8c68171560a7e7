"""`find_orbits`: periodic orbits of a map from a search of a box."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeVar, final, overload

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.reprs import told
from dynkit.core.smooth_map import SmoothMap, checked_map
from dynkit.core.validation import Array, finite_array, positive_integer
from dynkit.orbits.covering import Covering
from dynkit.orbits.laps import CELLS, periodic_points, reached
from dynkit.orbits.map_calls import MapCalls, Spent
from dynkit.orbits.map_problem import angles, sizes
from dynkit.orbits.newton import NoConvergence, NoSolution

if TYPE_CHECKING:
    from dynkit.orbits.map_orbit import MapOrbit
    from dynkit.orbits.problem import PeriodicOrbit

_Orbit = TypeVar("_Orbit", bound="PeriodicOrbit")

# States of orbits are looked for as far as this beside the box, in its widths.
_BESIDE = 3.0
# Cells have as many corners as 2^d: maps of more dimensions are searched from random guesses.
_COVERED = 3
# Guesses in a box, the iterates of each among which close returns are looked for, and how many.
_GUESSES, _ITERATES, _RETURNS = 20, 200, 5
# Orbits whose states all agree to this part of their size are one: `periodic_orbit` takes two
# states that agree so well for one.
_SAME = 1e-7
# A halved covering says something about orbits once so many halvings found no more of them: the
# first coverings are so coarse that Newton's method gets nowhere, twice in a row.
_STILL, _LEAST_LEVEL = 2, 6
_ROUNDING = 1e-14


@final
class OrbitSearch(Sequence[_Orbit]):
    """What a search for periodic orbits found: a sequence of them, by rising periods.

    From `find_orbits`, or from `find_orbits` of an impact oscillator: there the period is the
    number n of impacts of P(n,m).

    Attributes
    ----------
    system : Map
    period : int
        The largest period that was asked for.
    resolved : int
        The largest period up to which the search was carried through; zero for none. For a map of
        one dimension: all laps of the iterates were searched. For two and three dimensions: halving
        the cells twice more led to no more orbits. A search from random guesses, or from motions,
        resolves nothing.
    region : (d, 2) array
        Least and greatest coordinates of the states that were looked at; NaN where there were none.
    message : str
        What was searched, how, and what stopped it.
    cost : Cost
        Calls of the map and its derivative, or guesses, starts, impacts that were simulated and
        returns that were tried; the steps of Newton's method come with each orbit.
    """

    def __init__(
        self,
        system: SmoothMap,
        period: int,
        resolved: int,
        region: Array,
        message: str,
        orbits: Sequence[_Orbit],
        cost: Cost,
    ) -> None:
        self.system = system
        self.period = period
        self.resolved = resolved
        self.region = region
        self.message = message
        self.cost = cost
        self._orbits = tuple(orbits)
        region.setflags(write=False)

    @property
    def error(self) -> Array:
        """Largest error of a coordinate of each orbit, (number of orbits,): `PeriodicOrbit.error`.

        Orbits that were not found have no error here: `resolved` and `message` say how far the
        search went.
        """
        return np.array([orbit.error for orbit in self._orbits])

    @property
    def counts(self) -> dict[int, int]:
        """How many orbits of each least period were found."""
        counts = dict.fromkeys(range(1, self.period + 1), 0)
        for orbit in self._orbits:
            counts[len(orbit.states)] += 1
        return counts

    @overload
    def __getitem__(self, place: int) -> _Orbit: ...

    @overload
    def __getitem__(self, place: slice) -> Sequence[_Orbit]: ...

    def __getitem__(self, place: int | slice) -> _Orbit | Sequence[_Orbit]:
        """Return one orbit, or several."""
        return self._orbits[place]

    def __len__(self) -> int:
        return len(self._orbits)

    def __repr__(self) -> str:
        return f"<{len(self)} orbits of {told(self.system, 6)}; {self.message}>"


def find_orbits(
    system: SmoothMap, period: int, box: Any, *, calls: int = 200_000
) -> OrbitSearch[MapOrbit]:
    """Return the periodic orbits of a map, stable or not, that a search of a box finds.

    It looks for orbits of each period up to the one asked for that have a state in the box, and all
    their states in the box or in what iterates reach from it, three widths of the box beside it at
    most.

    A map of one dimension is searched lap by lap: where an iterate f^n falls, it has one periodic
    point at most; where it rises, intervals are halved until the slope of f^n is on one side of
    one, at both ends and in the middle. Turning points of the map are looked for on a grid of 1024
    cells, halved further where the map is bent. So an orbit is missed only where two turning points
    lie in one cell, or two orbits in one interval. Maps with an angle, and of two and three
    dimensions, are searched by Newton's method from each cell of a covering of all that returns,
    which is halved until no more orbits are found. For more dimensions Newton's method starts
    from close returns among iterates of random guesses.

    Parameters
    ----------
    system : Map
    period : int
        The largest period.
    box : (d, 2) array_like
        Least and greatest value of each coordinate.
    calls : int
        The budget: calls of the map and its derivative, those of Newton's method for the orbits
        not counted.

    Returns
    -------
    OrbitSearch
        The orbits, and what was searched.

    Raises
    ------
    ValueError
        When the box is none, or a number no positive integer.

    References
    ----------
    The number of orbits of Henon's map: O. Biham, W. Wenzel, Phys. Rev. Lett. 63 (1989) 819-822;
    Z. Galias, Int. J. Bifurcation Chaos 11 (2001) 2427-2450 (proved).

    Examples
    --------
    >>> from dynkit.systems import Logistic
    >>> search = find_orbits(Logistic(rate=4.0), 6, [(0.0, 1.0)])
    >>> search.counts
    {1: 2, 2: 1, 3: 2, 4: 3, 5: 6, 6: 9}
    >>> search.message
    'P(1) to P(6) with states in [0, 1]: 64 laps of f^6 were searched'
    """
    began = time.perf_counter()
    checked_map(system)
    longest = positive_integer("period", period)
    given = checked_box(box, system.dimension)
    counted = MapCalls(system, positive_integer("calls", calls))
    found = _Found(system, longest)
    limit = given + _BESIDE * (given[:, 1] - given[:, 0])[:, None] * np.array([-1.0, 1.0])
    if system.dimension == 1 and not angles(system).any():
        resolved, region, how = _by_laps(counted, found, given, limit)
    elif system.dimension <= _COVERED:
        resolved, region, how = _by_cells(counted, found, given, limit)
    else:
        resolved, region, how = _by_returns(counted, found, given)
    sides = " x ".join(f"[{low:.6g}, {high:.6g}]" for low, high in region.tolist())
    spent = f"; the budget of {counted.most} calls was used up" if found.spent else ""
    asked = "P(1)" if longest == 1 else f"P(1) to P({longest})"
    message = f"{asked} with states in {sides}: {how}{spent}"
    cost = Cost(time.perf_counter() - began, {"calls": counted.made})
    return OrbitSearch(system, longest, resolved, region, message, found.sorted(), cost)


def checked_box(box: Any, dimension: int) -> Array:
    """Return least and greatest coordinates, (d, 2).

    Raises
    ------
    ValueError
        When they are not.
    """
    found = finite_array("box", box, (dimension, 2))
    for i in np.flatnonzero(~(found[:, 0] < found[:, 1]))[:1].tolist():
        raise ValueError(f"box[{i}] must be (low, high) with low < high; got {found[i].tolist()}")
    return found


@final
class _Found:
    """Orbits that were found, each once."""

    def __init__(self, system: SmoothMap, longest: int) -> None:
        self._system = system
        self.longest = longest
        self._orbits: list[list[MapOrbit]] = [[] for _ in range(longest + 1)]
        self.spent = False

    def count(self, period: int) -> int:
        return len(self._orbits[period])

    def sorted(self) -> list[MapOrbit]:
        """By their periods, and the first coordinate."""
        return [
            orbit
            for orbits in self._orbits
            for orbit in sorted(orbits, key=lambda orbit: orbit.states.min(axis=0).tolist())
        ]

    def holds(self, states: Array) -> bool:
        """Whether states, each the image of the one before it, are those of an orbit."""
        n = len(states)
        divisors = (k for k in range(1, n + 1) if n % k == 0)
        return any(self._same(orbit, states) for k in divisors for orbit in self._orbits[k])

    def add(self, states: Array) -> None:
        """Take the orbit that Newton's method finds from all its states, if it is new."""
        from dynkit.orbits.periodic_orbit import periodic_orbit

        if not np.isfinite(states).all():
            return
        try:
            orbit = periodic_orbit(self._system, states)
            small = abs(orbit.states) <= _ROUNDING * abs(states).max()
            if small.any():
                # numbers that have no digits but rounding are zero
                orbit = periodic_orbit(self._system, np.where(small, 0.0, orbit.states))
        except (NoConvergence, NoSolution):
            return
        if not any(self._same(other, orbit.states) for other in self._orbits[orbit.period]):
            self._orbits[orbit.period].append(orbit)

    def _same(self, orbit: MapOrbit, states: Array) -> bool:
        known = orbit.states
        near = _SAME * sizes(known)
        close = (abs(self._system.difference(known, states[0])) <= near).all(axis=1)
        for first in np.flatnonzero(close).tolist():
            again = known[(first + np.arange(len(states))) % len(known)]
            if (abs(self._system.difference(again, states)) <= near).all():
                return True
        return False


def _by_laps(calls: MapCalls, found: _Found, box: Array, limit: Array) -> tuple[int, Array, str]:
    longest = found.longest
    try:
        laps = reached(calls, box[0], longest - 1, limit[0])
    except Spent:
        found.spent = True
        return 0, box, f"not all turning points were looked for on a grid of {CELLS} cells"
    resolved, number = 0, len(laps.first)
    for n, points, count in periodic_points(laps, longest):
        for x in points:
            found.add(_iterates(calls.system, np.array([x]), n))
        resolved, number = n, count
    region = np.array([[laps.low, laps.high]])
    found.spent = resolved < longest
    if not resolved:
        return 0, region, f"{number} laps of the map were found, and not searched"
    return resolved, region, f"{number} laps of f^{resolved} were searched"


def _by_cells(calls: MapCalls, found: _Found, box: Array, limit: Array) -> tuple[int, Array, str]:
    longest = found.longest
    still, region, said = np.zeros(longest + 1, dtype=int), box, "not even a first covering"
    try:
        covering = Covering(calls, box, limit)
        region = covering.region
        while covering.level < _LEAST_LEVEL or (still[1:] < _STILL).any():
            covering.halve()
            count = len(covering.cells)
            said = f"{count} cells of side {' x '.join(f'{s:.3g}' for s in covering.side)}"
            if not count:
                still[:] = _STILL
                break
            before = [found.count(n) for n in range(longest + 1)]
            for n, x in covering.starts(longest):
                states = _iterates(calls.system, x, n)
                if not found.holds(states):
                    found.add(states)
            same = [found.count(n) == k for n, k in enumerate(before)]
            still = np.where(same, still + 1, 0)
    except Spent:
        found.spent = True
    settled = still[1:] >= _STILL
    resolved = longest if settled.all() else int(np.argmin(settled))
    return resolved, region, f"Newton's method from {said}"


def _by_returns(calls: MapCalls, found: _Found, box: Array) -> tuple[int, Array, str]:
    random = np.random.default_rng(0)
    try:
        for guess in random.uniform(box[:, 0], box[:, 1], (_GUESSES, len(box))):
            states = [guess]
            while len(states) < _ITERATES + found.longest and np.isfinite(states[-1]).all():
                states.append(calls.next(states[-1]))
            path = np.array(states[:-1] if np.isnan(states[-1]).any() else states)
            for n in range(1, min(found.longest, len(path) - 1) + 1):
                gaps = abs(calls.system.difference(path[n:], path[:-n]) / sizes(path)).max(axis=1)
                for start in {0, *np.argsort(gaps)[:_RETURNS].tolist()}:
                    found.add(path[start : start + n])
    except Spent:
        found.spent = True
    how = (
        f"Newton's method from {_GUESSES} random guesses and, for each period, from the "
        f"{_RETURNS} closest returns among {_ITERATES} iterates of each"
    )
    return 0, box, how


def _iterates(system: SmoothMap, state: Array, period: int) -> Array:
    """The states of an orbit from one of them on, (n, d); all NaN where the motion ends."""
    states = [state]
    try:
        for _ in range(period - 1):
            states.append(system.image(states[-1]))
    except NoMotion:
        return np.full((period, len(state)), np.nan)
    return np.array(states)
