"""`find_orbits`: search of a box for periodic orbits of a map."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, final, overload

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.reprs import system_repr
from dynkit.core.smooth_map import SmoothMap, checked_map, proper_divisors
from dynkit.core.validation import Array, finite_array, positive_integer, read_only
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import SavedWithSystem
from dynkit.orbits.covering import Covering
from dynkit.orbits.laps import CELLS, periodic_points, reached
from dynkit.orbits.map_calls import MapCalls, Spent
from dynkit.orbits.map_problem import angles, sizes
from dynkit.orbits.newton import NoConvergence
from dynkit.orbits.problem import PeriodicOrbit

if TYPE_CHECKING:
    from dynkit.orbits.map_orbit import MapOrbit

_Orbit = TypeVar("_Orbit", bound="PeriodicOrbit")

# Largest distance of an orbit's states from the box, in widths of the box.
_BESIDE = 3.0
# Largest number of dimensions for a covering by cells, which have 2^d corners; maps of more
# dimensions are searched from random guesses.
_COVERED = 3
# Number of random guesses; number of iterates of each guess; number of close returns among these
# from which Newton's method starts, for each period.
_GUESSES, _ITERATES, _RETURNS = 20, 200, 5
# Orbits whose states differ by at most this, relative to their size, are equal, as in
# `periodic_orbit`.
_SAME = 1e-7
# A period is resolved when _STILL successive halvings of the cells found no more orbits, but not
# before level _LEAST_LEVEL: from the coarsest coverings Newton's method seldom converges.
_STILL, _LEAST_LEVEL = 2, 6
# A coordinate below this, relative to the largest of the states, may be a rounding error of zero.
_ROUNDING = 1e-14


@final
class OrbitSearch(Sequence[_Orbit], SavedWithSystem):
    """Result of a search for periodic orbits: a sequence of orbits by ascending periods.

    It is made by `find_orbits`, or by `find_orbits` of an impact oscillator, where the period is
    the number n of impacts of P(n,m).

    Attributes
    ----------
    system : Map
    period : int
        The largest period of the search.
    resolved : int
        The largest period up to which the search was completed; zero for none. For a map of one
        dimension: all laps of the iterates were searched. For two and three dimensions: two more
        halvings of the cells found no more orbits. A search from random guesses, or from motions,
        resolves no period.
    region : (d, 2) array
        Least and greatest coordinates of the searched states; NaN where there were none.
    message : str
        Region, method and end of the search, in words.
    cost : Cost
        Calls of the map and its derivative, or guesses, starts, simulated impacts and tried
        returns; the steps of Newton's method are in the costs of the orbits.
    """

    _stored: ClassVar = ("period", "resolved", "region", "message", "_orbits", "cost")
    _given: ClassVar = "system"
    period: int
    resolved: int
    region: Array
    message: str
    cost: Cost
    _orbits: tuple[PeriodicOrbit, ...]

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
        self.region = read_only(region)
        self.message = message
        self.cost = cost
        self._orbits = tuple(orbits)

    def _restored(self) -> Self:
        if self.region.shape != (self.system.dimension, 2):
            raise ValueError(f"region is {self.region.shape}")
        if not 0 <= self.resolved <= self.period:
            raise ValueError(f"{self.resolved} of {self.period} periods were resolved")
        if not all(isinstance(orbit, PeriodicOrbit) for orbit in self._orbits):
            raise ValueError("it holds something else than orbits")
        return self

    @property
    def error(self) -> Array:
        """Largest error of a coordinate of each orbit, (number of orbits,): `PeriodicOrbit.error`.

        It does not account for orbits that were not found; see `resolved` and `message`.
        """
        return np.array([orbit.error for orbit in self._orbits])

    @property
    def counts(self) -> dict[int, int]:
        """Number of orbits found of each least period."""
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
        orbits: Any = self._orbits
        found: _Orbit | Sequence[_Orbit] = orbits[place]
        return found

    def __len__(self) -> int:
        return len(self._orbits)

    def dataset(self) -> Dataset:
        """Return observables and multipliers of the orbits as a dataset over ``orbit``.

        Rows of orbits with fewer states, or without multipliers, are filled with NaN.
        """
        names = self._orbits[0].observables if self._orbits else self.system.observables
        columns = {name: [orbit.observable(name) for orbit in self] for name in names}
        return Dataset(
            {"period": ("orbit", [len(orbit.states) for orbit in self])},
            {
                **{name: (("orbit", "state"), _filled(rows)) for name, rows in columns.items()},
                "multiplier": (
                    ("orbit", "multiplier"),
                    _filled([orbit._spectrum() for orbit in self], np.complex128),
                ),
                "error": ("orbit", self.error),
                "region": (("coordinate", "side"), self.region),
            },
            described(
                "Search for periodic orbits",
                cost=self.cost,
                error="largest error of a coordinate of each orbit",
                system=self.system,
                largest_period=float(self.period),
                resolved=float(self.resolved),
                message=self.message,
            ),
        )

    def __repr__(self) -> str:
        return f"<{len(self)} orbits of {system_repr(self.system, 6)}; {self.message}>"


def _filled(rows: Sequence[Array], kind: type = np.float64) -> Any:
    """Return rows of different lengths as one array, filled with NaN."""
    found: Any = np.full((len(rows), max(map(len, rows), default=0)), np.nan, dtype=kind)
    for place, row in zip(found, rows, strict=True):
        place[: len(row)] = row
    return found


def find_orbits(
    system: SmoothMap, period: int, box: Any, *, calls: int = 200_000
) -> OrbitSearch[MapOrbit]:
    """Return the periodic orbits of a map, stable or unstable, that a search of a box finds.

    It searches for orbits of each period up to the given one that have a state in the box. Their
    other states must be in the box or among its iterates, at most three widths of the box beside
    it.

    A map of one dimension is searched lap by lap. Where an iterate f^n decreases, it has at most
    one periodic point. Where it increases, intervals are halved until all slopes of f^n in them are
    above one, or all below. Slopes and turning points of the map are those of a grid of 1024 cells,
    refined where the map is curved. So an orbit can be missed only if two turning points lie in one
    cell, or if the slope within a cell leaves the range of the slopes on the grid. Maps with an
    angle, and maps of two and three dimensions, are searched by Newton's method from each cell of a
    covering of the recurrent states. The covering is refined until no more orbits are found. In
    more dimensions Newton's method starts from close returns among iterates of random guesses.

    Parameters
    ----------
    system : Map
    period : int
        The largest period.
    box : (d, 2) array_like
        Least and greatest value of each coordinate.
    calls : int
        Largest number of calls of the map and its derivative, without those of Newton's method for
        the final orbits.

    Returns
    -------
    OrbitSearch
        The orbits, and the extent of the search.

    Raises
    ------
    ValueError
        When the box is not (d, 2) with low < high, or period or calls is not a positive integer.

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
    with counted.bar:
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
    """Return the box as an array (d, 2) of least and greatest coordinates.

    Raises
    ------
    ValueError
        When the box is not finite, not (d, 2), or empty.
    """
    found = finite_array("box", box, (dimension, 2))
    for i in np.flatnonzero(~(found[:, 0] < found[:, 1]))[:1].tolist():
        raise ValueError(f"box[{i}] must be (low, high) with low < high; got {found[i].tolist()}")
    return found


@final
class _Found:
    """The orbits found, without duplicates."""

    def __init__(self, system: SmoothMap, longest: int) -> None:
        self._system = system
        self.longest = longest
        self._orbits: list[list[MapOrbit]] = [[] for _ in range(longest + 1)]
        self.spent = False

    def count(self, period: int) -> int:
        return len(self._orbits[period])

    def sorted(self) -> list[MapOrbit]:
        """Return the orbits, sorted by period and least coordinates."""
        return [
            orbit
            for orbits in self._orbits
            for orbit in sorted(orbits, key=lambda orbit: orbit.states.min(axis=0).tolist())
        ]

    def holds(self, states: Array) -> bool:
        """Whether the successive iterates `states`, (n, d), belong to a known orbit."""
        n = len(states)
        divisors = (*proper_divisors(n), n)
        return any(self._same(orbit, states) for k in divisors for orbit in self._orbits[k])

    def add(self, states: Array) -> None:
        """Add the orbit that Newton's method finds from states (n, d), if it is new."""
        from dynkit.orbits.periodic_orbit import periodic_orbit

        if not np.isfinite(states).all():
            return
        try:
            orbit = periodic_orbit(self._system, states)
            small = abs(orbit.states) <= _ROUNDING * abs(states).max()
            if small.any():
                # try zero for coordinates that are below rounding
                orbit = periodic_orbit(self._system, np.where(small, 0.0, orbit.states))
        except (NoConvergence, NoMotion):
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
    """Return the first `period` iterates, (n, d), from a state; all NaN if the motion ends."""
    states = [state]
    try:
        for _ in range(period - 1):
            states.append(system.image(states[-1]))
    except NoMotion:
        return np.full((period, len(state)), np.nan)
    return np.array(states)
