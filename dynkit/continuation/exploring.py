"""`explore`: the network of branches that periodic orbits of one system make."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, final

from dynkit.continuation.branch import Branch
from dynkit.continuation.checks import checked_bounds
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.initial_orbits import (
    FindsOrbits,
    Told,
    offered,
    searched,
    told_of_offers,
    told_of_searches,
)
from dynkit.continuation.membership import Trail
from dynkit.continuation.network import Finish, Link, Network, Unexplored
from dynkit.continuation.speculation import Ahead
from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import positive_integer
from dynkit.dynamics.map import Map
from dynkit.engine import WorkerLost
from dynkit.orbits.newton import NoConvergence, NoSolution
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.orbits.search import OrbitSearch, checked_box

if TYPE_CHECKING:
    from dynkit.continuation.bifurcations import Bifurcation

_LEADING = ("PD", "BP", "GR")
# Points of a branch, at most, in each direction.
_POINTS = 2000


def explore(
    system: Map,
    parameter: str,
    bounds: tuple[float, float],
    *,
    iterates: int = 2,
    periods: int = 4,
    values: int = 9,
    seeds: Iterable[PeriodicOrbit] | None = None,
    box: Any = None,
    calls: int = 100_000,
    branches: int = 100,
    points: int = 50_000,
    executor: Executor | None = None,
) -> Network:
    """Return the network of branches of periodic orbits, as far as a budget reaches.

    It starts from orbits at several values of the parameter, and continues each that lies on no
    branch that is known: so it finds branches that hang together with no other, and stable orbits
    that a sweep passes by. Then it switches, breadth first, to what branches off: at PD, BP, and GR
    (orbits of one impact more or fewer), wherever a motion of the system is or borders. The same
    arguments give the same network.

    Parameters
    ----------
    system : Map
        Its parameters but for one are those of all orbits.
    parameter : str
        Name of the parameter that changes.
    bounds : (float, float)
        Least and greatest value of the parameter.
    iterates, periods : int
        Largest n and m of orbits P(n,m) that are followed; of a map the largest n of P(n).
    values : int
        At how many values of the parameter, equally spaced within the bounds, there are orbits to
        start from: all P(1,m), and the admissible ones of more impacts that `find_orbits` of the
        system finds near motions and from random guesses; or those of a map that `find_orbits`
        finds in a box, at both bounds too. A branch that reaches none of these values, and hangs
        together with no other, is not found.
    seeds : iterable of PeriodicOrbit, optional
        The orbits to start from, instead of these.
    box : (d, 2) array_like, optional
        Least and greatest value of each coordinate: where orbits of a map are searched for.
    calls : int
        The budget of the search of the box at one value of the parameter: see `find_orbits`.
    branches, points : int
        The budget: how many branches, and how many points on them. It is looked at before each
        branch.
    executor : concurrent.futures.Executor, optional
        Who searches, continues and switches ahead of time: processes, threads, Dask, MPI. What
        turns out to be a part of what is known is thrown away, so the network is the same bits by
        any executor with any number of workers, and by none; only seconds differ.

    Returns
    -------
    Network
        What was found, also when the budget was used up, after an interrupt, or when memory, a
        worker or a file failed: `Network.finish` and `Network.message` say so.

    Raises
    ------
    ValueError
        When the system has no such parameter or refuses a value within the bounds, a number is out
        of range, or there is nothing to start from.

    Examples
    --------
    >>> from dynkit.systems import Logistic
    >>> network = explore(Logistic(rate=2.9), "rate", (2.8, 3.5), iterates=4, box=[(0.1, 1.0)])
    >>> [round(b.value, 10) for b in network.bifurcations if b.kind == "PD"]
    [3.0, 3.4494897428]
    >>> network.message
    'the search went to its end; searched: P(1) to P(4) with states in [0, 1] at 11 values of rate
    from 2.8 to 3.5, resolved up to P(4) at 11 of them'
    """
    began = time.perf_counter()
    low, high = checked_bounds("bounds", bounds)
    most = positive_integer("iterates", iterates)
    longest = positive_integer("periods", periods)
    searching = positive_integer("calls", calls)
    start, what = _starts(
        system, parameter, (low, high), (most, longest), values, seeds, box, searching
    )
    exploration = _Exploration(
        parameter,
        (low, high),
        (most, longest),
        positive_integer("branches", branches),
        positive_integer("points", points),
        Ahead(executor),
        what,
    )
    finish, failure = Finish.COMPLETE, ""
    try:
        exploration.run(start)
    except _UsedUp:
        finish = Finish.BUDGET
    except KeyboardInterrupt:
        if not exploration.found:
            raise
        finish = Finish.INTERRUPTED
    except _FAILURES as error:
        if not exploration.found:
            raise
        finish, failure = Finish.FAILED, f": {type(error).__name__}: {error}"
    finally:
        exploration.ahead.close()
    return exploration.network(finish, failure, time.perf_counter() - began)


def _starts(
    system: Map,
    parameter: str,
    bounds: tuple[float, float],
    largest: tuple[int, int],
    values: int,
    seeds: Iterable[PeriodicOrbit] | None,
    box: Any,
    calls: int,
) -> tuple[Sequence[Callable[[], Sequence[PeriodicOrbit]]], Told]:
    """Return what gives the orbits to start from, and what says what they searched."""
    if not isinstance(system, Map):
        raise ValueError(f"system must be a Map; got {system!r}")
    if parameter not in system.parameters:
        known = ", ".join(system.parameters) or "none"
        raise ValueError(f"parameter must be one of: {known}; got {parameter!r}")
    count = positive_integer("values", values)
    if seeds is not None:
        if box is not None:
            raise ValueError(f"box must not be given beside seeds; got {box!r}")
        if not isinstance(seeds, Iterable):
            raise ValueError(f"seeds must be periodic orbits; got {seeds!r}")
        orbits = list(seeds)
        for i, orbit in enumerate(orbits):
            if not isinstance(orbit, PeriodicOrbit):
                raise ValueError(f"seeds[{i}] must be a PeriodicOrbit; got {orbit!r}")
        return [partial(list, [orbit]) for orbit in orbits], _nothing
    low, high = bounds
    at = [low + (high - low) * (i + 0.5) / count for i in range(count)]
    if box is not None:
        at = [low, *at, high]
    elif not isinstance(system, FindsOrbits):
        raise ValueError(
            "box must be given, or seeds, for a system that offers no orbits; got None"
        )
    systems = [system.replace(**{parameter: value}) for value in at]
    where = f"at {parameter} {at[0]:.6g}"
    if len(at) > 1:
        where = f"at {len(at)} values of {parameter} from {at[0]:.6g} to {at[-1]:.6g}"
    if box is not None:
        inside = checked_box(box, system.dimension)
        return searched(systems, inside, largest[0], calls), partial(told_of_searches, where=where)
    return offered(systems, *largest), partial(told_of_offers, periods=largest[1], where=where)


def _nothing(searches: Sequence[OrbitSearch[Any]]) -> str:
    del searches  # there are none
    return "nothing beside the orbits given"


class _UsedUp(Exception):
    """The budget."""


@final
@dataclass(eq=False)
class _Group:
    """Orbits that come of one call, once it was made."""

    key: Hashable
    call: Callable[[], Sequence[PeriodicOrbit]]
    leads: list[_Lead] | None = None
    search: OrbitSearch[Any] | None = None

    def have(self, orbits: Sequence[PeriodicOrbit] | None) -> list[_Lead]:
        """Take the orbits, when they are there."""
        if self.leads is None and orbits is not None:
            self.search = orbits if isinstance(orbits, OrbitSearch) else None
            self.leads = [_Lead((self.key, i), orbit) for i, orbit in enumerate(orbits)]
        return self.leads or []


@final
@dataclass(eq=False)
class _Lead:
    """An orbit, the branch that it lies on, and how many it was held against."""

    key: Hashable
    orbit: PeriodicOrbit
    known: int | None = None
    distinct: int = 0


@final
@dataclass
class _Exploration:
    """What was found so far, and what is still to be done."""

    parameter: str
    bounds: tuple[float, float]
    largest: tuple[int, int]
    most_branches: int
    most_points: int
    ahead: Ahead
    told: Told
    searches: list[OrbitSearch[Any]] = field(default_factory=list)
    found: list[Branch] = field(default_factory=list)
    trails: list[Trail] = field(default_factory=list)
    links: list[Link] = field(default_factory=list)
    left: list[Unexplored] = field(default_factory=list)
    waiting: deque[tuple[int, int]] = field(default_factory=deque)
    starting: str = ""
    points: int = 0
    coming: deque[_Group] = field(default_factory=deque)

    def run(self, starts: Sequence[Callable[[], Sequence[PeriodicOrbit]]]) -> None:
        """Explore from orbits to start from, the shortest ones first, then breadth first.

        Raises
        ------
        _UsedUp
            When the budget is used up.
        """
        self.starting = "the first orbit to start from"
        self.coming.extend(_Group(("start", i), call) for i, call in enumerate(starts))
        self._gather()
        while self.coming:
            for lead in self._leads_of(self.coming[0]):
                orbit = lead.orbit
                value = orbit.system.parameters[self.parameter]
                self.starting = f"orbits to start from, from {orbit.label} at {value:.6g} on"
                if not self._follows(orbit):
                    continue
                try:
                    self._number_of(lead)
                except _REFUSALS as refusal:
                    why = f"continuing {orbit.label} at {value:.6g} fails: {refusal}"
                    self.left.append(Unexplored(None, None, why))
            self.coming.popleft()
        self.starting = ""
        self.coming.extend(self._group(*place) for place in self.waiting)
        while self.waiting:
            self._switch(*self.waiting[0])
            self.waiting.popleft()
            self.coming.popleft()

    def _gather(self) -> None:
        """Find the orbits to start from, and put those of the same P(n,m) together.

        What a search finds need not be a motion where it has several impacts: of these the
        inadmissible ones are too many, and lead nowhere that motions are.
        """
        by_length: dict[tuple[int, int], list[_Lead]] = {}
        while self.coming:
            leads = self._leads_of(self.coming[0])
            search = self.coming.popleft().search
            if search is not None:
                self.searches.append(search)
            for lead in leads:
                n, m = _length(lead.orbit)
                if search is None or n == 1 or lead.orbit.admissible:
                    by_length.setdefault((n, m), []).append(lead)
        for length, group in sorted(by_length.items()):
            self.coming.append(_Group(("start", "of", length), list, group))

    def _switch(self, number: int, place: int) -> None:
        bifurcation = self.found[number].bifurcations[place]
        try:
            leads = self._leads_of(self.coming[0])
        except _REFUSALS as refusal:
            self.left.append(Unexplored(number, place, f"switching fails: {refusal}"))
            return
        if not leads and bifurcation.kind != "GR":
            self.left.append(Unexplored(number, place, "no orbit was found on another branch"))
        for lead in leads:
            if not self._follows(lead.orbit):
                continue
            try:
                to = self._number_of(lead)
            except _REFUSALS as refusal:
                self.left.append(Unexplored(number, place, f"continuing fails: {refusal}"))
                continue
            link = Link(number, place, to)
            if to != number and link not in self.links:
                self.links.append(link)

    def _group(self, number: int, place: int) -> _Group:
        call = partial(_switched, self.found[number].bifurcations[place])
        return _Group(("switch", number, place), call)

    def _leads_of(self, group: _Group) -> list[_Lead]:
        """The orbits of a group."""
        self._look_ahead()
        if group.leads is None:
            group.have(self.ahead.result(group.key, group.call))
        return group.have(None)

    def _look_ahead(self) -> None:
        """Begin what is likely to be needed: the next groups, and branches of their orbits.

        Of the orbits of one label, which likely lie on one branch, only one is continued at a time.
        """
        busy: set[str] = set()
        for group in self.coming:
            if not self.ahead.has_room:
                return
            if group.leads is None:
                self.ahead.begin(group.key, group.call)
            for lead in group.have(self.ahead.seen(group.key)):
                label = lead.orbit.label
                if label in busy or not self._follows(lead.orbit):
                    continue
                if lead.key in self.ahead:
                    busy.add(label)
                elif self._known(lead) is None:
                    self.ahead.begin(lead.key, self._continued(lead.orbit, _POINTS))
                    busy.add(label)

    def _continued(self, orbit: PeriodicOrbit, points: int) -> Callable[[], Branch]:
        return partial(_branch_of, orbit, self.parameter, self.bounds, points)

    def _follows(self, orbit: PeriodicOrbit) -> bool:
        (n, m), (iterates, periods) = _length(orbit), self.largest
        return n <= iterates and m <= periods

    def _known(self, lead: _Lead) -> int | None:
        """The number of the branch that an orbit lies on, of those that are found."""
        while lead.known is None and lead.distinct < len(self.found):
            number = lead.distinct
            same_label = self.found[number].label == lead.orbit.label
            if same_label and self.trails[number].holds(lead.orbit):
                lead.known = number
            lead.distinct += 1
        return lead.known

    def _number_of(self, lead: _Lead) -> int:
        """The number of the branch that an orbit lies on, which is continued when it is new."""
        known = self._known(lead)
        if known is not None:
            self.ahead.drop(lead.key)
            return known
        if len(self.found) >= self.most_branches or self.points >= self.most_points:
            raise _UsedUp
        left = min(_POINTS, self.most_points - self.points)
        if left < _POINTS:
            self.ahead.drop(lead.key)
        self._look_ahead()
        branch = self.ahead.result(lead.key, self._continued(lead.orbit, left))
        trail = Trail(branch)
        number = len(self.found)
        self.found.append(branch)
        self.trails.append(trail)
        self.points += len(branch)
        for place, bifurcation in enumerate(branch.bifurcations):
            if bifurcation.kind in _LEADING and at_motions(branch, bifurcation):
                self.waiting.append((number, place))
                if not self.starting:
                    self.coming.append(self._group(number, place))
        return number

    def network(self, finish: Finish, failure: str, seconds: float) -> Network:
        """What was found, and what was left."""
        left = list(self.left)
        why = finish.value
        if self.starting and finish is not Finish.COMPLETE:
            left.append(Unexplored(None, None, f"{why}: {self.starting}"))
        left += [Unexplored(*place, why) for place in self.waiting]
        ending = f"{why}{failure}"
        if left:
            count = sum(entry.branch is not None for entry in left)
            parts = [f"{count} bifurcations"] if count else []
            if self.starting:
                parts.append(self.starting)
            elif count < len(left):
                parts.append(f"{len(left) - count} orbits to start from")
            ending += f"; left unexplored: {' and '.join(parts)}"
        ending += f"; searched: {self.told(self.searches)}"
        steps = sum(branch.cost.counts.get("newton_steps", 0) for branch in self.found)
        counts = {"branches": len(self.found), "points": self.points, "newton_steps": steps}
        return Network(
            tuple(self.found),
            tuple(self.links),
            tuple(left),
            finish,
            ending,
            Cost(seconds, counts),
        )


def _length(orbit: PeriodicOrbit) -> tuple[int, int]:
    """Numbers of states and of periods of the forcing, one where nothing forces."""
    return len(orbit.states), getattr(orbit, "periods", 1)


_REFUSALS = (NoSolution, NoConvergence, NoMotion)
# Of the machine: what was found before is kept. A fault in a program is raised.
_FAILURES = (MemoryError, OSError, WorkerLost)


def _branch_of(
    orbit: PeriodicOrbit, parameter: str, bounds: tuple[float, float], points: int
) -> Branch:
    """The branch of an orbit, which a switch may have put beyond the bounds: NoSolution there."""
    value, (low, high) = orbit.system.parameters[parameter], bounds
    if not low <= value <= high:
        raise NoSolution(f"{parameter} must lie in [{low}, {high}]; got {value}")
    return continue_orbit(orbit, parameter, bounds=bounds, points=points)


def at_motions(branch: Branch, bifurcation: Bifurcation) -> bool:
    """Whether a point beside it is a motion of the system."""
    before, after = math.ceil(bifurcation.place) - 1, math.floor(bifurcation.place) + 1
    return bool(branch.admissible[max(before, 0) : after + 1].any())


def _switched(bifurcation: Bifurcation) -> list[PeriodicOrbit]:
    return [_once(orbit) for orbit in bifurcation.switch()]


def _once(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """The same orbit, run through once."""
    problem = orbit.problem()
    shorter, x = problem.shortest(orbit.unknowns)
    return orbit if shorter is problem else shorter.orbit(x, problem.values, orbit.history)
