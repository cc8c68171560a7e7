"""`explore`: the network of branches that periodic orbits of one system make."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.continuation.branch import Branch
from dynkit.continuation.checks import checked_bounds
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.network import Finish, Link, Network, Unexplored
from dynkit.continuation.newton import NoConvergence
from dynkit.continuation.problem import NoSolution
from dynkit.continuation.seeds import OffersOrbits, checked_box, offered, searched
from dynkit.continuation.trails import Trail
from dynkit.maps import Map
from dynkit.results import Cost
from dynkit.validation import positive_integer

if TYPE_CHECKING:
    from dynkit.continuation.bifurcations import Bifurcation
    from dynkit.orbits import PeriodicOrbit

_LEADING = ("PD", "BP", "GR")
# Points of a branch, at most, in each direction.
_POINTS = 2000


def explore(
    system: Map,
    parameter: str,
    bounds: tuple[float, float],
    *,
    impacts: int = 2,
    periods: int = 4,
    values: int = 9,
    seeds: Iterable[PeriodicOrbit] | None = None,
    box: Any = None,
    branches: int = 100,
    points: int = 50_000,
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
    impacts, periods : int
        Largest n and m of orbits P(n,m) that are followed; of a map the largest n of P(n).
    values : int
        At how many values of the parameter, equally spaced, there are orbits to start from: all
        P(1,m) and the admissible P(2,m) and P(3,m) that the system offers; or those of maps that
        are found from 20 guesses in a box, of up to three iterates. A branch that reaches none of
        these values, and hangs together with no other, is not found.
    seeds : iterable of PeriodicOrbit, optional
        The orbits to start from, instead of these.
    box : (d, 2) array_like, optional
        Least and greatest value of each coordinate of the guesses.
    branches, points : int
        The budget: how many branches, and how many points on them. It is looked at before each
        branch.

    Returns
    -------
    Network
        What was found, also when the budget was used up, or after an interrupt or a failure;
        `Network.finish` and `Network.message` tell.

    Raises
    ------
    ValueError
        When the system has no such parameter or refuses a value within the bounds, a number is out
        of range, or there is nothing to start from.

    Examples
    --------
    >>> from dynkit.systems import Logistic
    >>> network = explore(Logistic(rate=2.9), "rate", (2.8, 3.5), impacts=4, box=[(0.1, 1.0)])
    >>> [round(b.value, 10) for b in network.bifurcations if b.kind == "PD"]
    [3.0, 3.4494897428]
    >>> network.message
    'all was explored, up to the largest orbits asked for'
    """
    began = time.perf_counter()
    low, high = checked_bounds("bounds", bounds)
    most = positive_integer("impacts", impacts)
    longest = positive_integer("periods", periods)
    start = _starts(system, parameter, (low, high), (most, longest), values, seeds, box)
    exploration = _Exploration(
        parameter,
        (low, high),
        (most, longest),
        positive_integer("branches", branches),
        positive_integer("points", points),
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
    except Exception as error:
        if not exploration.found:
            raise
        finish, failure = Finish.FAILED, f": {type(error).__name__}: {error}"
    return exploration.network(finish, failure, time.perf_counter() - began)


def _starts(
    system: Map,
    parameter: str,
    bounds: tuple[float, float],
    largest: tuple[int, int],
    values: int,
    seeds: Iterable[PeriodicOrbit] | None,
    box: Any,
) -> Iterator[PeriodicOrbit]:
    if not isinstance(system, Map):
        raise ValueError(f"system must be a Map; got {system!r}")
    if parameter not in system.parameters:
        known = ", ".join(system.parameters) or "none"
        raise ValueError(f"parameter must be one of: {known}; got {parameter!r}")
    count = positive_integer("values", values)
    if seeds is not None:
        if box is not None:
            raise ValueError(f"box must not be given beside seeds; got {box!r}")
        return iter(list(seeds))
    low, high = bounds
    at = [low + (high - low) * (i + 0.5) / count for i in range(count)]
    systems = [system.replace(**{parameter: value}) for value in at]
    if box is not None:
        return searched(systems, checked_box(box, system.dimension), largest[0])
    if isinstance(system, OffersOrbits):
        return offered(systems, *largest)
    raise ValueError("box must be given, or seeds, for a system that offers no orbits; got None")


class _UsedUp(Exception):
    """The budget."""


@final
@dataclass
class _Exploration:
    """What was found so far, and what is still to be done."""

    parameter: str
    bounds: tuple[float, float]
    largest: tuple[int, int]
    most_branches: int
    most_points: int
    found: list[Branch] = field(default_factory=list)
    trails: list[Trail] = field(default_factory=list)
    links: list[Link] = field(default_factory=list)
    left: list[Unexplored] = field(default_factory=list)
    waiting: deque[tuple[int, int]] = field(default_factory=deque)
    starting: str = ""
    points: int = 0

    def run(self, starts: Iterator[PeriodicOrbit]) -> None:
        """Explore from orbits to start from, one after the other, then breadth first.

        Raises
        ------
        _UsedUp
            When the budget is used up.
        """
        self.starting = "the first orbit to start from"
        for orbit in starts:
            value = orbit.system.parameters[self.parameter]
            self.starting = f"orbits to start from, from {orbit.label} at {value:.6g} on"
            if not self._follows(orbit):
                continue
            try:
                self._number_of(orbit)
            except _REFUSALS as refusal:
                why = f"continuing {orbit.label} at {value:.6g} fails: {refusal}"
                self.left.append(Unexplored(None, None, why))
        self.starting = ""
        while self.waiting:
            number, place = self.waiting[0]
            self._switch(number, place)
            self.waiting.popleft()

    def _switch(self, number: int, place: int) -> None:
        bifurcation = self.found[number].bifurcations[place]
        try:
            orbits = [_once(orbit) for orbit in bifurcation.switch()]
        except _REFUSALS as refusal:
            self.left.append(Unexplored(number, place, f"switching fails: {refusal}"))
            return
        if not orbits and bifurcation.kind != "GR":
            self.left.append(Unexplored(number, place, "no orbit was found on another branch"))
        for orbit in orbits:
            if not self._follows(orbit):
                continue
            try:
                to = self._number_of(orbit)
            except _REFUSALS as refusal:
                self.left.append(Unexplored(number, place, f"continuing fails: {refusal}"))
                continue
            link = Link(number, place, to)
            if to != number and link not in self.links:
                self.links.append(link)

    def _follows(self, orbit: PeriodicOrbit) -> bool:
        impacts, periods = self.largest
        return len(orbit.states) <= impacts and getattr(orbit, "periods", 1) <= periods

    def _number_of(self, orbit: PeriodicOrbit) -> int:
        """The number of the branch that an orbit lies on, which is continued when it is new."""
        for number, (branch, trail) in enumerate(zip(self.found, self.trails, strict=True)):
            if branch.label == orbit.label and trail.holds(orbit):
                return number
        if len(self.found) >= self.most_branches or self.points >= self.most_points:
            raise _UsedUp
        left = min(_POINTS, self.most_points - self.points)
        branch = continue_orbit(orbit, self.parameter, bounds=self.bounds, points=left)
        trail = Trail(branch)
        number = len(self.found)
        self.found.append(branch)
        self.trails.append(trail)
        self.points += len(branch)
        for place, bifurcation in enumerate(branch.bifurcations):
            if bifurcation.kind in _LEADING and at_motions(branch, bifurcation):
                self.waiting.append((number, place))
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
            ending += f"; left unexplored: {' and '.join(parts)}"
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


_REFUSALS = (NoSolution, NoConvergence, ValueError, ArithmeticError, np.linalg.LinAlgError)


def at_motions(branch: Branch, bifurcation: Bifurcation) -> bool:
    """Whether a point beside it is a motion of the system."""
    before, after = math.ceil(bifurcation.place) - 1, math.floor(bifurcation.place) + 1
    return bool(branch.admissible[max(before, 0) : after + 1].any())


def _once(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """The same orbit, run through once."""
    problem = orbit.problem()
    shorter, x = problem.shortest(orbit.unknowns)
    return orbit if shorter is problem else shorter.orbit(x, problem.values, orbit.history)
