"""`continue_orbit`: the branch of periodic orbits through an orbit, along one parameter."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynkit.continuation.arclength import Continuation
from dynkit.continuation.bifurcations.bifurcation import Bifurcation, borders_a_motion
from dynkit.continuation.bifurcations.step_acceptance import Acceptance
from dynkit.continuation.bifurcations.tracing import (
    Trace,
    both_ways,
    is_of_event,
    is_of_symmetry,
    joined,
    trace,
)
from dynkit.continuation.checks import checked_bounds, checked_method, problem_of
from dynkit.continuation.crossings import Located
from dynkit.continuation.initial_tangents import start_points
from dynkit.continuation.method import ContinuationMethod
from dynkit.continuation.orbit_equations import OrbitEquations
from dynkit.continuation.points import Point, cost_of
from dynkit.continuation.results.branch import Branch
from dynkit.continuation.termination import Bound, Ending, Reason
from dynkit.continuation.test_functions import examine
from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array, boolean, in_interval
from dynkit.dynamics.equilibrium import shrinks
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import WatchedProblem, is_admissible
from dynkit.orbits.newton import correct
from dynkit.orbits.solving import FixedParameters

if TYPE_CHECKING:
    from dynkit.orbits.equations import ProblemSolution


def continue_orbit(
    orbit: ProblemSolution,
    parameter: str,
    *,
    bounds: tuple[float, float],
    step: float = 0.01,
    largest_step: float = 0.05,
    points: int = 2000,
    inadmissible: bool = True,
) -> Branch:
    """Return the branch of periodic orbits, or equilibria, through an orbit, in both directions.

    The method is pseudo-arclength continuation, which passes through folds. The branch ends at the
    bounds, when it closes on itself, or where no further orbit is found; `Branch.endings` says why.
    The points found before are always returned. Bifurcations are solved for by Newton's method.

    Parameters
    ----------
    orbit : PeriodicOrbit or Equilibrium
        Start of the branch, for instance the orbit of a bifurcation; any `ProblemSolution`.
    parameter : str
        Name of the parameter that changes.
    bounds : (float, float)
        Least and greatest value of the parameter.
    step : float
        First distance between points. The parameter is measured in units of the distance of the
        bounds, and the unknowns in units of their typical sizes (root mean square).
    largest_step : float
        Largest distance between points.
    points : int
        Largest number of points in each direction.
    inadmissible : bool
        Whether the branch continues where the orbits are not motions of the system; these points
        are marked.

    Returns
    -------
    Branch
        The points in the order of the curve.

    Raises
    ------
    ValueError
        When the system has no such parameter, the bounds are reversed, or a number is out of range.
        Also when the orbit lies outside of the bounds, does not solve its equations, has no
        neighbouring orbits, or is inadmissible while `inadmissible` is False.

    References
    ----------
    H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, in
    Applications of Bifurcation Theory, ed. P. H. Rabinowitz, Academic Press 1977, 359-384.

    Examples
    --------
    >>> from dynkit import periodic_orbit
    >>> from dynkit.systems import Henon
    >>> orbit = periodic_orbit(Henon(a=0.2, b=0.3), [0.8, 0.2])
    >>> branch = continue_orbit(orbit, "a", bounds=(-0.2, 1.4), points=300)
    >>> branch.bifurcations
    (<SN at a -0.1225>, <PD at a 0.3675>)
    >>> branch.bifurcations[0].error < 1e-12
    True
    """
    method = checked_method(step, largest_step, points)
    return continue_by(method, orbit, parameter, bounds=bounds, inadmissible=inadmissible)


def continue_by(
    method: ContinuationMethod,
    orbit: ProblemSolution,
    parameter: str,
    *,
    bounds: tuple[float, float],
    inadmissible: bool = True,
) -> Branch:
    """Return the branch of `continue_orbit`, by a method with replaceable parts.

    Parameters
    ----------
    method : ContinuationMethod
        Predictor, corrector, step control, test functions, and the number of points.
    orbit, parameter, bounds, inadmissible
        As in `continue_orbit`.

    Returns
    -------
    Branch

    Raises
    ------
    ValueError
        As `continue_orbit`.
    """
    began = time.perf_counter()
    low, high = checked_bounds("bounds", bounds)
    problem, start_x = _once(problem_of(orbit, (parameter,)), orbit)
    in_interval(parameter, float(problem.values[0]), low, high)
    problem, start_x = problem.departing(start_x, 1.0 if problem.values[0] < high else -1.0)
    beyond = boolean("inadmissible", inadmissible)
    if not beyond and not orbit.admissible:
        raise ValueError("orbit must be admissible where inadmissible=False; got one that is not")
    equations = OrbitEquations(problem, high - low)
    try:
        start = start_points(equations, np.append(start_x, problem.values))[0]
    except NoMotion as end:
        here = f"{parameter} {problem.values[0]:.10g}"
        raise ValueError(f"orbit must have others beside it; got one at {here}: {end}") from end
    bound = Bound(problem.size, parameter, low, high)

    def follow(point: Point) -> Trace:
        examined = replace(point, seen=examine(problem, point))
        accept = Acceptance(problem, method.tests)
        return trace(problem, Continuation(equations, examined, (bound,), method, accept), beyond)

    traces = both_ways(start, follow)
    return _branch(orbit, problem, *traces, time.perf_counter() - began)


def _once(problem: Problem, orbit: ProblemSolution) -> tuple[Problem, Array]:
    """Return the equations and unknowns of an orbit with its least period.

    At a period doubling the orbit of the doubled branch is the single orbit, repeated twice.
    """
    once, x = problem.shortest(orbit.unknowns)
    if once is problem:
        return problem, x
    return once, correct(FixedParameters(once, once.values), x, once.scale(x)).y


def _branch(
    orbit: ProblemSolution, problem: Problem, forward: Trace, backward: Trace, seconds: float
) -> Branch:
    points, endings = joined(forward, backward)
    begin, end = (
        _explained(problem, *last) for last in zip((points[0], points[-1]), endings, strict=True)
    )
    first = len(backward.points) - 1
    places = [(first - place, found, -way) for place, found, way in reversed(backward.located)]
    places += [(first + place, found, way) for place, found, way in forward.located]
    centres = backward.centres + forward.centres
    scale = points[first].scale
    events = [entry[:2] for entry in places if entry[1].crossing.event >= 0]
    places = [entry for entry in places if not is_of_event(*entry[:2], events)]
    places = [entry for entry in places if not is_of_symmetry(entry[1], centres, scale)]
    admissible = np.array([point.seen.admissible for point in points])
    return Branch(
        label=problem.solution(points[first].y[:-1], points[first].y[-1:]).label,
        name=problem.names[0],
        parameter=np.array([point.y[-1] for point in points]),
        unknowns=np.array([point.y[:-1] for point in points]),
        multipliers=np.array([point.seen.spectrum for point in points]),
        admissible=admissible,
        residuals=np.array([point.residual for point in points]),
        bifurcations=tuple(
            _bifurcation(
                problem, admissible, place, found, way / _length(problem, found, way, scale)
            )
            for place, found, way in places
        ),
        endings=(begin, end),
        cost=cost_of(points, seconds),
        _problem=problem,
        spectrum=problem.stability,
        _system=orbit.system,
    )


def _length(problem: Problem, found: Located, way: Array, scale: Array) -> float:
    """Return the length of a step in scaled unknowns at a bifurcation."""
    units = OrbitEquations(problem, float(scale[-1])).scale(found.place)
    return float(np.linalg.norm(way / units))


def _explained(problem: Problem, last: Point, ending: Ending) -> Ending:
    """Return the ending of a branch; EQUILIBRIUM where its last orbit shrinks to one."""
    if ending.reason not in (Reason.NO_SOLUTION, Reason.NO_CONVERGENCE):
        return ending
    if not shrinks(problem.solution(last.y[:-1], last.y[-1:])):
        return ending
    place = f"{problem.names[0]} {last.y[-1]:.7g}"
    return Ending(Reason.EQUILIBRIUM, f"{Reason.EQUILIBRIUM.value}: near {place}")


def _bifurcation(
    problem: Problem, admissible: NDArray[np.bool_], place: float, found: Located, tangent: Array
) -> Bifurcation:
    kind, event, _ = found.crossing
    # on a border rounding decides whether the orbit itself is admissible: examine its neighbours
    on_border = event >= 0
    motion = (
        borders_a_motion(admissible, place)
        if on_border
        else is_admissible(problem, found.x, found.p)
    )
    touching = {}
    if isinstance(problem, WatchedProblem) and on_border and found.solved:
        touching = dict(problem.touching(event, found.x, found.own, found.p))
    return Bifurcation(
        kind=kind,
        parameter=problem.names[0],
        value=float(found.p[0]),
        error=float(found.errors[-1]),
        multiplier=found.multiplier,
        direction=found.direction,
        place=place,
        touching=touching,
        history=found.history,
        cost=Cost(found.seconds, {"newton_steps": found.steps}),
        unknowns=found.x,
        unknowns_error=found.errors[: len(found.x)],
        own=found.own,
        own_error=found.errors[len(found.x) : -1],
        tangent=tangent,
        event=event,
        admissible=motion,
        _problem=problem,
    )
