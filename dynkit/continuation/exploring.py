"""`explore`: the network of branches of periodic orbits or equilibria of a system."""

from __future__ import annotations

import operator
import time
from collections import deque
from collections.abc import Hashable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from typing import Any, final

from dynkit.continuation.bifurcations.bifurcation import Bifurcation, borders_a_motion
from dynkit.continuation.bifurcations.kinds import KINDS
from dynkit.continuation.checks import checked_bounds
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.initial_orbits import Describe, Search, searches_of, seeds_of
from dynkit.continuation.network import Finish, Link, Network, Unexplored
from dynkit.continuation.results.branch import Branch
from dynkit.continuation.results.membership import Trail
from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import of_type, positive_integer
from dynkit.dynamics.flow import Flow
from dynkit.dynamics.map import Map
from dynkit.engine.executors import WorkerLost, all_finished, finished
from dynkit.orbits.equations import ProblemSolution
from dynkit.orbits.newton import NoConvergence
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.orbits.search import OrbitSearch

# Largest number of points of a branch in each direction.
_POINTS = 4000
# Exceptions that leave an orbit or a bifurcation unexplored; the network reports them.
_REFUSALS = (NoConvergence, NoMotion)
# Failures of the computer or of a worker: the branches found so far are returned. Errors of
# programs are raised.
_FAILURES = (MemoryError, OSError, WorkerLost)


def explore(
    system: Map | Flow,
    parameter: str,
    bounds: tuple[float, float],
    *,
    iterates: int = 2,
    periods: int = 4,
    values: int = 9,
    seeds: Iterable[ProblemSolution] | None = None,
    box: Any = None,
    calls: int = 100_000,
    branches: int = 100,
    points: int = 50_000,
    executor: Executor | None = None,
) -> Network:
    """Return the network of branches of periodic orbits or equilibria, within a budget.

    The exploration starts from orbits at several values of the parameter, and continues each one
    that lies on no known branch. So it also finds isolated branches (isolas), and stable orbits
    that a sweep misses. Then it switches, breadth first, to the branches that leave at PD, BP, and
    GR (orbits of one impact more or fewer), if an orbit next to the bifurcation is
    admissible. The same arguments give the same network.

    For a flow it starts from equilibria, and switches at BP and, to periodic orbits, at HB. Each
    branch of periodic orbits has its own Poincare section, a plane.

    Parameters
    ----------
    system : Map or Flow
        The system; all of its parameters but one are fixed.
    parameter : str
        Name of the parameter that changes.
    bounds : (float, float)
        Least and greatest value of the parameter.
    iterates, periods : int
        Largest n and m of the orbits P(n,m); for a map the largest n of P(n).
    values : int
        Number of values of the parameter, equally spaced within the bounds, at which initial orbits
        are searched. For a machine these are all P(1,m), and the admissible orbits of more impacts
        that its `find_orbits` finds near motions and from random guesses. For a map they are the
        orbits that `find_orbits` finds in a box; the search is then also at both bounds. An
        isolated branch that reaches none of these values is not found.
    seeds : iterable of PeriodicOrbit or Equilibrium, optional
        Initial orbits, instead of these; required for a flow.
    box : (d, 2) array_like, optional
        Least and greatest value of each coordinate in the search for orbits of a map.
    calls : int
        Largest number of calls in the search of the box at one value: see `find_orbits`.
    branches, points : int
        Largest number of branches, and of points on all of them, checked before each branch.
    executor : concurrent.futures.Executor, optional
        Executor that searches, switches, and continues orbits of different labels in parallel:
        processes, threads, Dask, MPI. The network is bit for bit the same with any executor and any
        number of workers, and without one; only seconds differ.

    Returns
    -------
    Network
        The branches found, also when the budget was used up, after an interrupt, or when memory, a
        worker or a file failed: see `Network.finish` and `Network.message`.

    Raises
    ------
    ValueError
        When the system has no such parameter or refuses a value within the bounds, a number is out
        of range, or there are no initial orbits.

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
    within = checked_bounds("bounds", bounds)
    largest = positive_integer("iterates", iterates), positive_integer("periods", periods)
    budget = positive_integer("calls", calls)
    of_type("system", system, Map | Flow, "a Map or a Flow")
    system.value_of(parameter)
    count = positive_integer("values", values)
    searches: list[Search] = []
    orbits: list[ProblemSolution] = []
    describe: Describe = _describe_seeds
    if seeds is None:
        if isinstance(system, Flow):
            raise ValueError("seeds must be equilibria, for a flow; got None")
        searches, describe = searches_of(
            system, parameter, within, values=count, largest=largest, box=box, calls=budget
        )
    elif box is not None:
        raise ValueError(f"box must not be given together with seeds; got {box!r}")
    else:
        orbits = seeds_of(seeds, parameter)
    exploration = _Exploration(
        parameter,
        within,
        largest,
        positive_integer("branches", branches),
        positive_integer("points", points),
        executor,
        isinstance(system, Flow),
    )
    finish, failure = Finish.COMPLETE, ""
    try:
        exploration.run(searches, orbits)
    except _UsedUp:
        finish = Finish.BUDGET
    except KeyboardInterrupt:
        if not exploration.kept():
            raise
        finish = Finish.INTERRUPTED
    except _FAILURES as error:
        if not exploration.kept():
            raise
        finish, failure = Finish.FAILED, f": {type(error).__name__}: {error}"
    return exploration.network(finish, failure, describe, time.perf_counter() - began)


def _describe_seeds(_: Sequence[OrbitSearch[Any]]) -> str:
    return "nothing but the orbits given"


class _UsedUp(Exception):
    """The budget was used up."""


@final
@dataclass(eq=False)
class _Lead:
    """An orbit to continue, and the number `compared` of branches with which it was compared.

    `known` is the number of the branch that contains it, or the reason why it cannot be compared.
    """

    orbit: ProblemSolution
    known: int | str | None = None
    compared: int = 0


@final
@dataclass
class _Exploration:
    """State of an exploration: branches found, and orbits and bifurcations still to explore.

    An orbit is compared only with branches of the same group, mostly the same label. So orbits of
    different groups can be continued in parallel, and no branch is continued twice.
    """

    parameter: str
    bounds: tuple[float, float]
    largest: tuple[int, int]
    most_branches: int
    most_points: int
    executor: Executor | None
    on_planes: bool
    searches: list[OrbitSearch[Any]] = field(default_factory=list)
    found: list[Branch] = field(default_factory=list)
    trails: list[Trail] = field(default_factory=list)
    groups: list[Hashable] = field(default_factory=list)
    links: list[Link] = field(default_factory=list)
    left: list[Unexplored] = field(default_factory=list)
    waiting: deque[tuple[int, int]] = field(default_factory=deque)
    starting: str = ""
    points: int = 0
    coming: deque[_Lead] = field(default_factory=deque)
    ready: dict[_Lead, Branch | str] = field(default_factory=dict)

    def run(self, searches: Sequence[Search], seeds: Sequence[ProblemSolution]) -> None:
        """Explore from initial orbits, the shortest ones first, then breadth first.

        Orbits of several impacts that a search finds may be inadmissible. These are left out: they
        are too many, and do not lead to motions of the system.

        Raises
        ------
        _UsedUp
            When the budget is used up.
        """
        self.starting = "the first orbit to start from"
        self.searches = all_finished(operator.call, searches, self.executor)
        orbits = [*seeds]
        for search in self.searches:
            orbits += [orbit for orbit in search if len(orbit.states) == 1 or orbit.admissible]
        for lead in self._leads(sorted(orbits, key=_length)):
            orbit = lead.orbit
            value = orbit.system.parameters[self.parameter]
            self.starting = f"orbits to start from, from {orbit.label} at {value:.6g} on"
            number = self._number_of(lead)
            if isinstance(number, str):
                why = f"continuing {orbit.label} at {value:.6g} fails: {number}"
                self.left.append(Unexplored(None, None, why))
        self.starting = ""
        while self.waiting:
            self._switch(list(self.waiting))

    def _switch(self, places: list[tuple[int, int]]) -> None:
        """Continue the branches that leave at bifurcations, given as (branch, place)."""
        bifurcations = [self.found[number].bifurcations[place] for number, place in places]
        switched = all_finished(_switched, bifurcations, self.executor)
        leads = [self._leads(orbits) for orbits, _ in switched]
        for (number, place), group, (_, refusal) in zip(places, leads, switched, strict=True):
            if refusal:
                self.left.append(Unexplored(number, place, refusal))
            for lead in group:
                to = self._number_of(lead)
                if isinstance(to, str):
                    self.left.append(Unexplored(number, place, f"continuing fails: {to}"))
                elif to != number and Link(number, place, to) not in self.links:
                    self.links.append(Link(number, place, to))
            self.waiting.popleft()

    def _leads(self, orbits: Iterable[ProblemSolution]) -> list[_Lead]:
        """Queue and return those orbits that are not too long."""
        pairs = [(orbit, _length(orbit)) for orbit in orbits]
        most, longest = self.largest
        leads = [_Lead(orbit) for orbit, (n, m) in pairs if n <= most and m <= longest]
        self.coming.extend(leads)
        return leads

    def _known(self, lead: _Lead) -> int | str | None:
        """Return the number of the branch that contains an orbit, or why it cannot be compared.

        None if none of the branches found so far contains it.
        """
        while lead.known is None and lead.compared < len(self.found):
            number = lead.compared
            same = self.groups[number] == self._group(lead.orbit)
            try:
                if same and self.trails[number].holds(lead.orbit, self.on_planes):
                    lead.known = number
            except _REFUSALS as refusal:
                lead.known = str(refusal)
            lead.compared += 1
        return lead.known

    def _number_of(self, lead: _Lead) -> int | str:
        """Return the number of the next orbit's branch, continued if new, or why there is none."""
        self.coming.popleft()
        known = self._known(lead)
        if known is not None:
            return known
        if len(self.found) >= self.most_branches or self.points >= self.most_points:
            raise _UsedUp
        left = min(_POINTS, self.most_points - self.points)
        if left < _POINTS:
            self._continue([lead], left)
        elif lead not in self.ready:
            others = [] if self.executor is None else self._others(self._group(lead.orbit))
            self._continue([lead, *others][: self.most_branches - len(self.found)], left)
        branch = self.ready.pop(lead)
        return branch if isinstance(branch, str) else self._add(branch)

    def _group(self, orbit: ProblemSolution) -> Hashable:
        """Return the group of an orbit, which is the same for equal orbits.

        The label is not part of it for orbits on different planes, where equal orbits may have
        different labels.
        """
        if self.on_planes and isinstance(orbit, PeriodicOrbit):
            return "any plane"
        return orbit.label, *orbit.counts.items()

    def _others(self, group: Hashable) -> list[_Lead]:
        """Return the next orbit of each other group that lies on no found branch."""
        busy, others = {group, *(self._group(lead.orbit) for lead in self.ready)}, []
        for lead in self.coming:
            own = self._group(lead.orbit)
            if own not in busy and self._known(lead) is None:
                busy.add(own)
                others.append(lead)
        return others

    def _continue(self, leads: list[_Lead], points: int) -> None:
        work = partial(_continued, parameter=self.parameter, bounds=self.bounds, points=points)
        for place, branch in finished(work, [lead.orbit for lead in leads], self.executor):
            self.ready[leads[place]] = branch

    def _add(self, branch: Branch) -> int:
        """Add a new branch, and return its number."""
        number = len(self.found)
        self.found.append(branch)
        self.trails.append(Trail(branch))
        self.groups.append(self._group(branch.orbit(0)))
        self.points += len(branch)
        for place, bifurcation in enumerate(branch.bifurcations):
            at_motions = borders_a_motion(branch.admissible, bifurcation.place)
            if KINDS[bifurcation.kind].switch and at_motions:
                self.waiting.append((number, place))
        return number

    def kept(self) -> bool:
        """Add branches that were continued but not added; return whether any branch is known."""
        for lead, branch in self.ready.items():
            if isinstance(branch, Branch) and self._known(lead) is None:
                self._add(branch)
        return bool(self.found)

    def network(self, finish: Finish, failure: str, describe: Describe, seconds: float) -> Network:
        """Return the network, with the list of unexplored orbits and bifurcations."""
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
        ending += f"; searched: {describe(self.searches)}"
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


def _length(orbit: ProblemSolution) -> tuple[int, int]:
    """Return the numbers of states and of periods of the forcing; one period without forcing."""
    states = len(orbit.states) if isinstance(orbit, PeriodicOrbit) else 1
    return states, getattr(orbit, "periods", 1)


def _continued(
    orbit: ProblemSolution, parameter: str, bounds: tuple[float, float], points: int
) -> Branch | str:
    """Return the branch of an orbit, or why there is none: it may lie outside the bounds."""
    value, (low, high) = orbit.system.parameters[parameter], bounds
    if not low <= value <= high:
        return f"{parameter} must lie in [{low}, {high}]; got {value}"
    try:
        return continue_orbit(orbit, parameter, bounds=bounds, points=points)
    except _REFUSALS as refusal:
        return str(refusal)


def _switched(bifurcation: Bifurcation) -> tuple[list[ProblemSolution], str]:
    """Return orbits on the branches that leave a bifurcation, and why expected ones are missing.

    At GR there need not be any.
    """
    try:
        orbits = [_once(orbit) for orbit in bifurcation.switch()]
    except _REFUSALS as refusal:
        return [], f"switching fails: {refusal}"
    missing = not orbits and KINDS[bifurcation.kind].defining_system is not None
    return orbits, "no orbit was found on another branch" if missing else ""


def _once(orbit: ProblemSolution) -> ProblemSolution:
    """Return the orbit with its least period."""
    problem = orbit.problem()
    shorter, x = problem.shortest(orbit.unknowns)
    return orbit if shorter is problem else shorter.solution(x, problem.values, orbit.history)
