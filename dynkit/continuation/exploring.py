"""`explore`: the network of branches that periodic orbits or equilibria of one system make."""

from __future__ import annotations

import operator
import time
from collections import deque
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from typing import Any, final

from dynkit.continuation.bifurcations import Bifurcation, borders_a_motion
from dynkit.continuation.branch import Branch
from dynkit.continuation.checks import checked_bounds
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.initial_orbits import Search, Told, searches_of, seeds_of
from dynkit.continuation.kinds import KINDS, Noticed
from dynkit.continuation.membership import Trail
from dynkit.continuation.network import Finish, Link, Network, Unexplored
from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import positive_integer
from dynkit.dynamics.flow import Flow
from dynkit.dynamics.map import Map
from dynkit.engine.executors import WorkerLost, all_finished, finished
from dynkit.orbits.equations import ProblemSolution
from dynkit.orbits.newton import NoConvergence, NoSolution
from dynkit.orbits.problem import PeriodicOrbit, shortest
from dynkit.orbits.search import OrbitSearch
from dynkit.orbits.spectrum import Spectrum

# Points of a branch, at most, in each direction.
_POINTS = 2000
# Why an orbit is not continued, or a bifurcation leads to none: said, and passed over.
_REFUSALS = (NoSolution, NoConvergence, NoMotion)
# Of the machine: what was found before is kept. A fault in a program is raised.
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
    """Return the network of branches of periodic orbits or equilibria, as far as a budget reaches.

    It starts from orbits at several values of the parameter, and continues each that lies on no
    branch that is known: so it finds branches that hang together with no other, and stable orbits
    that a sweep passes by. Then it switches, breadth first, to what branches off: at PD, BP, and GR
    (orbits of one impact more or fewer), wherever a motion of the system is or borders. The same
    arguments give the same network.

    Of a flow it starts from equilibria, and switches at BP and, to periodic orbits, at HB. Each
    branch of these lies on a plane of its own.

    Parameters
    ----------
    system : Map or Flow
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
    seeds : iterable of PeriodicOrbit or Equilibrium, optional
        What to start from, instead of these; of a flow there must be some.
    box : (d, 2) array_like, optional
        Least and greatest value of each coordinate: where orbits of a map are searched for.
    calls : int
        The budget of the search of the box at one value of the parameter: see `find_orbits`.
    branches, points : int
        The budget: how many branches, and how many points on them. It is looked at before each
        branch.
    executor : concurrent.futures.Executor, optional
        Who searches, switches, and continues orbits of different labels at the same time:
        processes, threads, Dask, MPI. The network is the same bits by any executor with any number
        of workers, and by none; only seconds differ.

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
    within = checked_bounds("bounds", bounds)
    largest = positive_integer("iterates", iterates), positive_integer("periods", periods)
    budget = positive_integer("calls", calls)
    if not isinstance(system, Map | Flow):
        raise ValueError(f"system must be a Map or a Flow; got {system!r}")
    system.value_of(parameter)
    count = positive_integer("values", values)
    searches: list[Search] = []
    orbits: list[ProblemSolution] = []
    told: Told = _told_of_seeds
    if seeds is None:
        if isinstance(system, Flow):
            raise ValueError("seeds must be equilibria, for a flow; got None")
        searches, told = searches_of(
            system, parameter, within, values=count, largest=largest, box=box, calls=budget
        )
    elif box is not None:
        raise ValueError(f"box must not be given beside seeds; got {box!r}")
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
    return exploration.network(finish, failure, told, time.perf_counter() - began)


def _told_of_seeds(_: Sequence[OrbitSearch[Any]]) -> str:
    return "nothing beside the orbits given"


class _UsedUp(Exception):
    """The budget."""


@final
@dataclass(eq=False)
class _Lead:
    """An orbit, and with how many branches it was compared.

    `known` is the number of the branch that it lies on, or why it cannot be compared.
    """

    orbit: ProblemSolution
    known: int | str | None = None
    compared: int = 0


@final
@dataclass
class _Exploration:
    """What was found so far, and what is still to be done.

    An orbit is compared with branches of its own group only, mostly its label. So orbits of
    different groups can be continued at the same time, and nothing is continued twice.
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
    links: list[Link] = field(default_factory=list)
    left: list[Unexplored] = field(default_factory=list)
    waiting: deque[tuple[int, int]] = field(default_factory=deque)
    starting: str = ""
    points: int = 0
    coming: deque[_Lead] = field(default_factory=deque)
    ready: dict[_Lead, Branch | str] = field(default_factory=dict)

    def run(self, searches: Sequence[Search], seeds: Sequence[ProblemSolution]) -> None:
        """Explore from orbits to start from, the shortest ones first, then breadth first.

        What a search finds need not be a motion where it has several impacts: of these the
        inadmissible ones are too many, and lead nowhere that motions are.

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
        """Continue what branches off at some bifurcations: branches and places on them."""
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
        """Return what is to be continued next, of orbits that are not too long."""
        pairs = [(orbit, _length(orbit)) for orbit in orbits]
        most, longest = self.largest
        leads = [_Lead(orbit) for orbit, (n, m) in pairs if n <= most and m <= longest]
        self.coming.extend(leads)
        return leads

    def _known(self, lead: _Lead) -> int | str | None:
        """The number of the branch, of those found, that an orbit lies on; or why none can tell."""
        while lead.known is None and lead.compared < len(self.found):
            number = lead.compared
            branch = self.found[number]
            periodic = branch.spectrum is Spectrum.MULTIPLIERS
            same = self._group(branch.label, periodic) == self._group_of(lead)
            try:
                if same and self.trails[number].holds(lead.orbit, self.on_planes):
                    lead.known = number
            except _REFUSALS as refusal:
                lead.known = str(refusal)
            lead.compared += 1
        return lead.known

    def _number_of(self, lead: _Lead) -> int | str:
        """The number of the next orbit's branch, continued when it is new; or why it is not."""
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
            others = [] if self.executor is None else self._others(self._group_of(lead))
            self._continue([lead, *others][: self.most_branches - len(self.found)], left)
        branch = self.ready.pop(lead)
        return branch if isinstance(branch, str) else self._add(branch)

    def _group(self, label: str, periodic: bool) -> str:
        """What two orbits share that can be the same: on other planes they have other labels."""
        return "any plane" if self.on_planes and periodic else label

    def _group_of(self, lead: _Lead) -> str:
        return self._group(lead.orbit.label, isinstance(lead.orbit, PeriodicOrbit))

    def _others(self, group: str) -> list[_Lead]:
        """Of each other group the next orbit that lies on no branch that is found."""
        busy, others = {group, *map(self._group_of, self.ready)}, []
        for lead in self.coming:
            if self._group_of(lead) not in busy and self._known(lead) is None:
                busy.add(self._group_of(lead))
                others.append(lead)
        return others

    def _continue(self, leads: list[_Lead], points: int) -> None:
        work = partial(_continued, parameter=self.parameter, bounds=self.bounds, points=points)
        for place, branch in finished(work, [lead.orbit for lead in leads], self.executor):
            self.ready[leads[place]] = branch

    def _add(self, branch: Branch) -> int:
        """Return the number of a branch that is new."""
        number = len(self.found)
        self.found.append(branch)
        self.trails.append(Trail(branch))
        self.points += len(branch)
        for place, bifurcation in enumerate(branch.bifurcations):
            at_motions = borders_a_motion(branch.admissible, bifurcation.place)
            if KINDS[bifurcation.kind].switch and at_motions:
                self.waiting.append((number, place))
        return number

    def kept(self) -> bool:
        """Whether there is any branch, with those that are continued and have no number yet."""
        for lead, branch in self.ready.items():
            if isinstance(branch, Branch) and self._known(lead) is None:
                self._add(branch)
        return bool(self.found)

    def network(self, finish: Finish, failure: str, told: Told, seconds: float) -> Network:
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
        ending += f"; searched: {told(self.searches)}"
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
    """Numbers of states and of periods of the forcing, one where nothing forces."""
    states = len(orbit.states) if isinstance(orbit, PeriodicOrbit) else 1
    return states, getattr(orbit, "periods", 1)


def _continued(
    orbit: ProblemSolution, parameter: str, bounds: tuple[float, float], points: int
) -> Branch | str:
    """The branch of an orbit, or why there is none; a switch may have put it beyond the bounds."""
    value, (low, high) = orbit.system.parameters[parameter], bounds
    if not low <= value <= high:
        return f"{parameter} must lie in [{low}, {high}]; got {value}"
    try:
        return continue_orbit(orbit, parameter, bounds=bounds, points=points)
    except _REFUSALS as refusal:
        return str(refusal)


def _switched(bifurcation: Bifurcation) -> tuple[list[ProblemSolution], str]:
    """Orbits on the branches that leave a bifurcation, or why there are none where some should be.

    Where an orbit grazes there need not be any.
    """
    try:
        orbits = [_once(orbit) for orbit in bifurcation.switch()]
    except _REFUSALS as refusal:
        return [], f"switching fails: {refusal}"
    missing = not orbits and KINDS[bifurcation.kind].noticed is Noticed.TEST_FUNCTION
    return orbits, "no orbit was found on another branch" if missing else ""


def _once(orbit: ProblemSolution) -> ProblemSolution:
    """The same orbit, run through once."""
    problem = orbit.problem()
    shorter, x = shortest(problem, orbit.unknowns)
    return orbit if shorter is problem else shorter.solution(x, problem.values, orbit.history)
