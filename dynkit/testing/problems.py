"""Checks of problems against the contracts of `Problem` and its subclasses."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import WatchedProblem
from dynkit.orbits.multiplier_errors import multiplier_errors
from dynkit.orbits.problem import PeriodicProblem
from dynkit.orbits.solving import orbit_bound
from dynkit.testing.requirements import (
    require,
    require_derivative,
    require_pure,
    require_shape,
    same_bits,
)

ProblemCheck: TypeAlias = Callable[[Problem, Array, Array], None]

_ROUNDING = 2.0**-52
# Largest residual of a solution, as for `continue_orbit`.
_SOLVED = 1e-8
# Relative step of a value of the spectrum, for the derivative of the pencil.
_STEP = 1e-6
# Largest distance of an orbit from a repetition of a shorter orbit.
_REPEATED = 1e-7


def equations_have_the_shape(problem: Problem, x: Array, p: Array) -> None:
    """F is (m,), its derivatives (m, m) and (m, k), the scale (m,) and positive; x solves F."""
    m, k = problem.size, len(problem.names)
    require_shape("the residual", problem.residual(x, p), (m,))
    require_shape("the linearization", np.asarray(problem.linearization(x, p)), (m, m))
    require_shape("the parameter derivative", problem.parameter_derivative(x, p), (m, k))
    for name, values in (("scale", problem.scale(x)), ("rounding", problem.rounding(x, p))):
        require_shape(f"the {name}", values, (m,))
        require(bool((values > 0.0).all()), f"the {name} is positive", f"got {values}")
    size = float(abs(problem.residual(x, p)).max())
    require(size <= _SOLVED, "x solves the equations", f"a residual is {size}")


def equations_are_pure(problem: Problem, x: Array, p: Array) -> None:
    """Calls with the same unknowns return the same bits and leave the unknowns unchanged."""
    require_pure("the residual", lambda y: problem.residual(y, p), x[None])
    require_pure("the scale", problem.scale, x[None])


def linearization_is_the_derivative(problem: Problem, x: Array, p: Array) -> None:
    """The linearization equals differences of the residual, within the errors of both."""
    off = np.max(problem.linearization_error(x, p))
    require_derivative(
        "the linearization",
        np.asarray(problem.linearization(x, p)),
        lambda y: problem.residual(y, p),
        x,
        accuracy=max(float(problem.rounding(x, p).max()), float(off), _ROUNDING),
    )


def parameter_derivative_is_the_derivative(problem: Problem, x: Array, p: Array) -> None:
    """The derivative by the parameters equals differences of the residual."""
    require_derivative(
        "the parameter derivative",
        problem.parameter_derivative(x, p),
        lambda q: problem.residual(x, q),
        p,
        accuracy=max(float(problem.rounding(x, p).max()), _ROUNDING),
        least=0.0 if p.any() else 1.0,  # steps cannot be relative to zero
    )


def free_changes_the_names_only(problem: Problem, x: Array, p: Array) -> None:
    """`free` with the same names returns the same equations, and with other names their values."""
    again = problem.free(*problem.names)
    require(again.names == problem.names, "free gives the names", f"got {again.names}")
    require(same_bits(again.values, problem.values), "free keeps the values", f"got {again.values}")
    require(
        same_bits(again.residual(x, p), problem.residual(x, p)), "free keeps the equations", f"{p}"
    )
    turned = problem.free(*problem.names[::-1])
    require(
        same_bits(turned.values, problem.values[::-1]),
        "free gives the values in the order of the names",
        f"got {turned.values} for {turned.names}",
    )
    require(not problem.free().names, "free without names frees none", "it does not")


def solution_gives_back_its_equations(problem: Problem, x: Array, p: Array) -> None:
    """A solution has the given unknowns and parameters, and solves its problem."""
    made = problem.solution(x, p, (1.0, 1e-16))
    require(same_bits(made.unknowns, x), "a solution keeps its unknowns", f"got {made.unknowns}")
    require(made.residual == 1e-16, "a solution keeps its history", f"got {made.history}")
    values = [made.system.value_of(name) for name in problem.names]
    require(values == p.tolist(), "a solution has its parameters", f"got {values}, of {p}")
    again = made.problem(*problem.names)
    size = float(abs(again.residual(x, again.values)).max())
    require(size <= _SOLVED, "a solution solves its problem", f"a residual is {size}")


def same_solutions_are_not_apart(problem: Problem, x: Array, p: Array) -> None:
    """A solution is not apart from itself."""
    gap = problem.apart(x, x.copy())
    require(not np.any(gap), "a solution is not apart from itself", f"got {gap}, at {p}")


def pencil_is_singular_at_the_spectrum(problem: Problem, x: Array, p: Array) -> None:
    """D(neutral value) is the linearization, and D is singular at each value of the spectrum.

    Its smallest singular value is at most the change of D within the error of the value.
    Multipliers that are exactly zero are left out.
    """
    scale = problem.scale(x)
    neutral = np.asarray(problem.pencil(x, p, problem.stability.neutral)) * scale
    matrix = np.asarray(problem.linearization(x, p)) * scale
    size = float(np.linalg.norm(matrix))
    off = float(abs(neutral - matrix).max())
    require(off <= 1e-12 * size, "D(neutral) is the linearization", f"they differ by {off}")
    values = np.asarray(problem.spectrum(x, p))
    moved = np.concatenate([orbit_bound(problem, x, p), np.zeros(len(p))])
    errors = multiplier_errors(problem, x, p, values, moved)
    for value, error in zip(values.tolist(), errors.tolist(), strict=True):
        by_nature = value == 0.0 and problem.stability.periodic
        if by_nature or not np.isfinite(error):
            continue
        here = np.asarray(problem.pencil(x, p, value)) * scale
        there = np.asarray(problem.pencil(x, p, value + _STEP * (abs(value) or 1.0))) * scale
        slope = float(np.linalg.norm(there - here)) / (_STEP * (abs(value) or 1.0))
        allowed = 2.0 * slope * error + 64.0 * _ROUNDING * float(np.linalg.norm(here))
        least = float(np.linalg.svd(here, compute_uv=False)[-1])
        require(
            least <= allowed,
            "D is singular at the spectrum",
            f"at {value} the smallest singular value is {least}, above {allowed}",
        )


def doubled_solution_solves(problem: Problem, x: Array, p: Array) -> None:
    """Two periods of a solution solve the doubled problem, whose derivative contains D(-1)."""
    if not isinstance(problem, PeriodicProblem):
        return
    disturbance = problem.scale(x) * np.linspace(1.0, 2.0, len(x))
    twice, start, along = problem.doubled(x, disturbance)
    require_shape("the solution run through twice", start, (2 * len(x),))
    size = float(abs(twice.residual(start, p)).max())
    require(size <= _SOLVED, "the solution run through twice solves", f"a residual is {size}")
    found = float(np.linalg.norm(np.asarray(twice.linearization(start, p)) @ along))
    expected = 2.0**0.5 * float(np.linalg.norm(problem.pencil(x, p, -1.0) @ disturbance))
    require(
        abs(found - expected) <= 1e-9 * max(found, expected),
        "the doubled direction is one of D(-1)",
        f"its change has length {found}, not {expected}",
    )
    apart = twice.repetition(start)
    require(
        apart <= _REPEATED or apart == np.inf,
        "the solution run through twice repeats itself",
        f"it is {apart} from doing so",
    )


def events_have_conditions(problem: Problem, x: Array, p: Array) -> None:
    """The number of events is constant; a finite one has a condition of the right size."""
    if not isinstance(problem, WatchedProblem):
        return
    events = problem.events(x, p)
    again = [(event.kind, event.part) for event in problem.events(x, p)]
    require(
        again == [(event.kind, event.part) for event in events],
        "events come in the same order",
        f"got {events}, then {again}",
    )
    alone = [problem.event(i, x, p) for i in range(len(events))]
    values, others = ([event.value for event in part] for part in (events, alone))
    require(
        np.array_equal(values, others, equal_nan=True)
        and [event.ends for event in alone] == [event.ends for event in events],
        "each event alone is the same",
        f"got {events}, then {alone}",
    )
    admissible = problem.admissible(x, p)
    require(admissible in (True, False), "admissible is true or false", f"got {admissible!r}")
    for i, event in enumerate(events):
        if not np.isfinite(event.value):
            continue
        try:
            condition, own = problem.condition(i, x, p)
            left = condition.residual(x, own, p)
        except NoMotion:
            continue
        require_shape(f"the guess for event {i}", own, (condition.unknowns,))
        require_shape(f"the condition of event {i}", left, (condition.unknowns + 1,))


problem_checks: tuple[ProblemCheck, ...] = (
    equations_have_the_shape,
    equations_are_pure,
    linearization_is_the_derivative,
    parameter_derivative_is_the_derivative,
    free_changes_the_names_only,
    solution_gives_back_its_equations,
    same_solutions_are_not_apart,
    pencil_is_singular_at_the_spectrum,
    doubled_solution_solves,
    events_have_conditions,
)


def check_problem(problem: Problem, x: Array, p: Array) -> None:
    """Run all `problem_checks` on a continuation problem, at a solution.

    Parameters
    ----------
    problem : Problem
        A problem with at least one free parameter.
    x : (m,) array
        Unknowns that solve the equations.
    p : (k,) array
        Values of the free parameters at the solution, inside their ranges.
    """
    for check in problem_checks:
        check(problem, x, p)
