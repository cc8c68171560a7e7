"""The checks of continuation problems pass what conforms, and name the defect of what does not."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from dynkit import continue_orbit, equilibrium, periodic_orbit, testing
from dynkit.core.parameters import Family
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem, ProblemSolution
from dynkit.orbits.families import FamilyProblem, find_solution
from dynkit.systems import BouncingBall, Henon, ImpactChain, Logistic, Lorenz
from tests.continuation.families import CycleProblem


class Balance(Family):
    """x' = force + y - x^2, y' = coupling x - 2 y."""

    force: float = 1.0
    coupling: float = 0.5


class BalanceProblem(FamilyProblem):
    """Where it is at rest."""

    size = 2

    def scale(self, x: Array) -> Array:
        return np.ones(2)

    def residual(self, x: Array, p: Array) -> Array:
        system = self.at(p)
        return np.array([system.force + x[1] - x[0] ** 2, system.coupling * x[0] - 2.0 * x[1]])

    def linearization(self, x: Array, p: Array) -> Any:
        return np.array([[-2.0 * x[0], 1.0], [self.at(p).coupling, -2.0]])

    def parameter_derivative(self, x: Array, p: Array) -> Array:
        columns = {"force": [1.0, 0.0], "coupling": [0.0, x[0]]}
        return np.array([columns[name] for name in self.names]).T


def rest(kind: type[FamilyProblem] = BalanceProblem) -> ProblemSolution:
    return find_solution(kind(Balance()), [1.0, 0.3])


@cache
def solutions() -> dict[str, tuple[ProblemSolution, tuple[str, ...]]]:
    fixed = equilibrium(Lorenz(rho=15.0), [6.0, 6.0, 14.0])
    hopf = next(b for b in continue_orbit(fixed, "rho", bounds=(10.0, 30.0)).bifurcations)
    chain = ImpactChain(masses=3, frequency=0.87)
    ball = BouncingBall(restitution=0.8, amplitude=0.5, frequency=1.0)
    return {
        "own": (rest(), ("force", "coupling")),
        "fixed point": (periodic_orbit(Henon(), [0.6, 0.2]), ("a", "b")),
        "P(2)": (periodic_orbit(Logistic(3.2), [0.5], period=2), ("rate",)),
        "P(1,3)": (chain.periodic_orbit(impacts=1, periods=3), ("frequency", "restitution")),
        "P(inf,1)": (
            ImpactChain(masses=1, frequency=0.408, restitution=0.3).periodic_orbit(sticking=True),
            ("frequency", "restitution"),
        ),
        "ball": (periodic_orbit(ball, [2.8, 0.8]), ("restitution", "amplitude")),
        "equilibrium": (fixed, ("rho", "beta")),
        "origin": (equilibrium(Lorenz(rho=15.0), [0.1, 0.1, 0.1]), ("sigma", "rho")),
        "cycle": (hopf.switch()[0], ("rho",)),
    }


NAMES = (
    *("own", "fixed point", "P(2)", "P(1,3)", "P(inf,1)", "ball"),
    *("equilibrium", "origin", "cycle"),
)


@pytest.mark.parametrize("check", testing.problem_checks, ids=testing.check_name)
@pytest.mark.parametrize("name", NAMES)
def test_problems_conform(check: testing.ProblemCheck, name: str) -> None:
    solution, names = solutions()[name]
    problem = solution.problem(*names)
    check(problem, np.array(solution.unknowns), problem.values)


class LongResidual(BalanceProblem):
    def residual(self, x: Array, p: Array) -> Array:
        return np.append(super().residual(x, p), 0.0)


class NegativeScale(BalanceProblem):
    def scale(self, x: Array) -> Array:
        return -np.ones(2)


class Counting(BalanceProblem):
    calls = 0

    def residual(self, x: Array, p: Array) -> Array:
        self.calls += 1
        return super().residual(x, p) * (1.0 + 1e-9 * self.calls) + 1e-12 * self.calls


class WrongLinearization(BalanceProblem):
    def linearization(self, x: Array, p: Array) -> Any:
        return super().linearization(x, p) * [[1.0, 1.0], [1.001, 1.0]]


class WrongParameterDerivative(BalanceProblem):
    def parameter_derivative(self, x: Array, p: Array) -> Array:
        return super().parameter_derivative(x, p) * 0.999


class ForgetsItsNames(BalanceProblem):
    def free(self, *names: str) -> Any:
        return super().free(*sorted(names))


class StaysAtItsParameters(BalanceProblem):
    def solution(self, x: Array, p: Array, history: Any = ()) -> Any:
        return super().solution(x, p + 1.0, history)


class ApartFromItself(BalanceProblem):
    def apart(self, x: Array, other: Array) -> Array:
        return super().apart(x, other) + 1e-3


class WrongPencil(BalanceProblem):
    def pencil(self, x: Array, p: Array, value: complex) -> Any:
        return super().pencil(x, p, 1.001 * value)


BROKEN: list[tuple[type[FamilyProblem], testing.ProblemCheck, str]] = [
    (LongResidual, testing.equations_have_the_shape, "the residual has shape"),
    (NegativeScale, testing.equations_have_the_shape, "the scale is positive"),
    (Counting, testing.equations_are_pure, "the residual is pure"),
    (WrongLinearization, testing.linearization_is_the_derivative, "linearization is the deriv"),
    (WrongParameterDerivative, testing.parameter_derivative_is_the_derivative, "is the deriv"),
    (ForgetsItsNames, testing.free_changes_the_names_only, "free gives the names"),
    (StaysAtItsParameters, testing.solution_gives_back_its_equations, "has its parameters"),
    (ApartFromItself, testing.same_solutions_are_not_apart, "not apart from itself"),
    (WrongPencil, testing.pencil_is_singular_at_the_spectrum, "singular at the spectrum"),
]


@pytest.mark.parametrize(("kind", "check", "message"), BROKEN)
def test_a_broken_problem_is_caught_by_name(
    kind: type[FamilyProblem], check: testing.ProblemCheck, message: str
) -> None:
    found = rest()
    problem = kind(Balance(), ("force", "coupling"))
    with pytest.raises(AssertionError, match=message):
        check(problem, np.array(found.unknowns), problem.values)


def test_parameters_may_be_zero() -> None:
    # where the residual is only rounding as well, nothing else says how large steps are
    at_zero = Balance(force=0.0, coupling=0.3)
    found = find_solution(BalanceProblem(at_zero), [0.15, 0.02])
    x, p = np.array(found.unknowns) * (1.0 + 2.0**-51), np.zeros(1)
    problem = BalanceProblem(at_zero, ("force",))
    assert 0.0 < abs(problem.residual(x, p)).max() < 1e-16
    testing.parameter_derivative_is_the_derivative(problem, x, p)
    wrong = WrongParameterDerivative(at_zero, ("force",))
    with pytest.raises(AssertionError, match="is the derivative"):
        testing.parameter_derivative_is_the_derivative(wrong, x, p)


class HalfDoubled(CycleProblem):
    """Twice the period, with a direction that does not turn its sign."""

    def doubled(self, x: Array, disturbance: Array) -> Any:
        twice, start, _ = super().doubled(x, disturbance)
        return twice, start, np.concatenate([disturbance, disturbance])


def test_a_wrong_doubling_is_caught_by_name() -> None:
    orbit = periodic_orbit(Henon(), [0.6, 0.2])
    problem = HalfDoubled(Henon(), 1, ("a",))
    with pytest.raises(AssertionError, match=r"the doubled direction is one of D\(-1\)"):
        testing.doubled_solution_solves(problem, np.array(orbit.unknowns), problem.values)


def test_all_checks_at_once() -> None:
    found = rest()
    problem: Problem = BalanceProblem(Balance(), ("force",))
    testing.check_problem(problem, np.array(found.unknowns), problem.values)


def test_what_is_no_solution_is_refused() -> None:
    problem = BalanceProblem(Balance(), ("force",))
    with pytest.raises(AssertionError, match="x solves the equations: a residual is"):
        testing.check_problem(problem, np.array([1.0, 1.0]), problem.values)
