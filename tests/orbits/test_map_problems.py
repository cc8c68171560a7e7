"""The equations of periodic orbits of maps keep the contract of `Problem`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dynkit import Hyperplane, Map, PoincareMap, Stroboscope, periodic_orbit
from dynkit.continuation.bifurcations.kinds import condition_of
from dynkit.core.no_motion import NoCrossing, Refused
from dynkit.core.validation import Array
from dynkit.orbits.events import events_of, is_admissible
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.map_problem import MapProblem
from dynkit.orbits.newton import NoSolution
from dynkit.systems import BouncingBall, Duffing, Henon, HighBounce, Logistic, Lorenz
from dynkit.testing import numerical_derivative

ROUNDING = 2.0**-52

# A map, states near an orbit of it, its free parameters.
CASES: dict[str, tuple[Map, list[list[float]], tuple[str, ...]]] = {
    "logistic": (Logistic(3.84), [[0.15], [0.49], [0.96]], ("rate",)),
    "henon": (Henon(), [[0.97, -0.14], [-0.47, 0.29]], ("a", "b")),
    "high bounce": (
        HighBounce(restitution=0.8, gamma=2.0),
        [[4.1, 6.3], [4.1, 6.3]],
        ("gamma", "restitution"),
    ),
    "ball": (
        BouncingBall(amplitude=0.1, frequency=3.2, restitution=0.7),
        [[0.81, 1.0]],
        ("frequency", "restitution", "amplitude", "gravity"),
    ),
    "duffing": (
        PoincareMap(Duffing(force=0.28), Stroboscope(3), time_limit=10.0),
        [[1.2, 0.2], [0.6, 0.1]],
        ("force", "damping", "frequency"),
    ),
    "lorenz": (
        PoincareMap(Lorenz(), Hyperplane(np.eye(3)[2], 27.0, -1), time_limit=10.0),
        [[3.0, 1.0], [-2.0, 0.5]],
        ("rho", "sigma", "beta"),
    ),
}
FLOWS = ("duffing", "lorenz")


@pytest.fixture(params=CASES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def made(name: str) -> tuple[MapProblem, Array, Array]:
    system, states, names = CASES[name]
    problem = MapProblem(system, np.array(states), names)
    return problem, np.array(states).ravel(), problem.values


def assert_derivative(
    name: str, claimed: Array, function: Callable[[Array], Array], place: Array
) -> None:
    accuracy = CASES[name][0].accuracy
    found, error = numerical_derivative(function, place, accuracy=accuracy)
    # twenty times, as the conformance checks of maps
    assert (abs(claimed - found) <= 20.0 * error + 1e-12 * abs(found).max()).all()


def test_the_values_are_those_of_the_system(name: str) -> None:
    problem, x, p = made(name)
    system, _, names = CASES[name]
    assert problem.names == names
    assert p.tolist() == [system.parameters[each] for each in names]
    assert problem.size == len(x)
    assert (problem.scale(x) > 0.0).all()


def test_the_linearization_is_the_derivative(name: str) -> None:
    problem, x, p = made(name)
    assert_derivative(name, problem.linearization(x, p), lambda y: problem.residual(y, p), x)


def test_the_parameter_derivative_is_the_derivative(name: str) -> None:
    problem, x, p = made(name)
    for k in range(len(p)):

        def along(value: Array, k: int = k) -> Array:
            there = p.copy()
            there[k] = value[0]
            return problem.residual(x, there)

        claimed = problem.parameter_derivative(x, p)[:, k : k + 1]
        assert_derivative(name, claimed, along, p[k : k + 1])


def test_other_parameters_can_be_free(name: str) -> None:
    problem, x, p = made(name)
    last = problem.free(problem.names[-1])
    assert last.names == problem.names[-1:]
    assert last.values.tolist() == [p[-1]]
    assert (last.residual(x, p[-1:]) == problem.residual(x, p)).all()
    with pytest.raises(ValueError, match=r"parameter must be one of: .*; got 'mass'"):
        problem.free("mass")


def test_multipliers_are_where_the_linearization_is_singular(name: str) -> None:
    problem, x, p = made(name)
    found = problem.multipliers(x, p)
    for multiplier in [complex(value) for value in found]:
        matrix = problem.linearization(x, p, multiplier)
        sizes = np.linalg.svd(matrix, compute_uv=False)
        # 30: of the units of the equations, and of the multipliers of neighbours
        assert sizes[-1] <= 30.0 * len(x) * ROUNDING * sizes[0]
    for other in (0.37, 1.7 + 0.2j, -3.0):
        away = abs(found - other).min() / max(1.0, abs(found).max())
        sizes = np.linalg.svd(problem.linearization(x, p, other), compute_uv=False)
        assert sizes[-1] > 1e-6 * away * sizes[0]


def test_real_multipliers_have_real_linearizations(name: str) -> None:
    problem, x, p = made(name)
    assert problem.linearization(x, p, -1.0).dtype == np.float64
    assert problem.linearization(x, p, np.exp(0.3j)).dtype == np.complex128


def test_the_doubled_problem_runs_through_twice(name: str) -> None:
    problem, x, p = made(name)
    _, _, rows = np.linalg.svd(problem.linearization(x, p, -1.0))
    doubled, twice, direction = problem.doubled(x, rows[-1])
    assert doubled.size == 2 * problem.size
    assert doubled.names == problem.names
    assert (doubled.residual(twice, p) == np.tile(problem.residual(x, p), 2)).all()
    # what the first round makes of a disturbance that changes its sign, and the second, reversed
    once = problem.linearization(x, p, -1.0) @ rows[-1]
    change = doubled.linearization(twice, p) @ direction
    assert change == pytest.approx(np.concatenate([once, -once]), abs=1e-12)
    exact = np.sort_complex(problem.multipliers(x, p) ** 2)
    assert np.sort_complex(doubled.multipliers(twice, p)) == pytest.approx(exact, rel=1e-9)


def test_where_an_orbit_begins_is_no_difference(name: str) -> None:
    problem, x, _ = made(name)
    for shift in range(len(CASES[name][1])):
        turned = np.roll(x, shift * CASES[name][0].dimension)
        assert not problem.apart(turned, x).any()


@pytest.mark.parametrize("turns", [1, -5])
def test_angles_a_turn_apart_are_no_difference(turns: int) -> None:
    problem, x, _ = made("high bounce")
    moved = x + np.tile([2.0 * np.pi * turns, 0.0], 2)
    assert problem.apart(moved, x) == pytest.approx(0.0, abs=1e-14)


def test_different_orbits_are_apart(name: str) -> None:
    problem, x, _ = made(name)
    moved = x.copy()
    moved[0] += 0.01
    assert abs(problem.apart(moved, x)).max() > 1e-4


def test_there_is_nothing_to_watch(name: str) -> None:
    problem, x, p = made(name)
    assert events_of(problem, x, p) == ()
    assert is_admissible(problem, x, p)
    with pytest.raises(ValueError, match=r"^problem must have events, for GR; got <"):
        condition_of(BifurcationKind.GR, 0, problem, x, np.empty(0), p, np.ones(1))


def test_an_orbit_gives_back_its_equations() -> None:
    orbit = periodic_orbit(Henon(), [0.6, 0.2])
    problem = orbit.problem("b", "a")
    assert problem.names == ("b", "a")
    again = problem.orbit(orbit.unknowns, np.array([0.3, 1.4]), (1.0, 1e-16))
    assert again.states.tobytes() == orbit.states.tobytes()
    assert again.history == (1.0, 1e-16)
    other = problem.orbit(orbit.unknowns, np.array([0.2, 1.3]))
    assert dict(other.system.parameters) == {"a": 1.3, "b": 0.2}
    assert other.residual == abs(problem.residual(orbit.unknowns, np.array([0.2, 1.3]))).max()
    with pytest.raises(ValueError, match="parameter must be one of: a, b; got 'c'"):
        orbit.problem("c")


METHODS = ("residual", "linearization", "parameter_derivative", "multipliers")


@pytest.mark.parametrize("method", METHODS)
def test_parameters_that_the_system_refuses_have_no_solution(method: str) -> None:
    problem = MapProblem(HighBounce(restitution=0.8, gamma=2.0), np.ones((1, 2)), ("restitution",))
    with pytest.raises(Refused, match=r"restitution must lie in \[0, 1\]; got 1\.1"):
        getattr(problem, method)(np.ones(2), np.array([1.1]))


@pytest.mark.parametrize("method", METHODS)
def test_states_that_the_system_refuses_have_no_solution(method: str) -> None:
    # relative velocities after an impact are not negative
    problem = MapProblem(CASES["ball"][0], np.ones((1, 2)), ("frequency",))
    with pytest.raises(Refused, match=r"state\[0\] must not be negative; got -0\.1"):
        getattr(problem, method)(np.array([-0.1, 1.0]), problem.values)


@pytest.mark.parametrize("method", METHODS)
def test_without_a_next_state_there_is_no_solution(method: str) -> None:
    system, _, _ = CASES["duffing"]
    assert isinstance(system, PoincareMap)
    short = PoincareMap(system.flow, system.section, time_limit=1.0)
    problem = MapProblem(short, np.ones((1, 2)), ("force",))
    with pytest.raises(NoCrossing, match=r"no crossing within 1\.0"):
        getattr(problem, method)(np.ones(2), problem.values)


def test_what_overflows_is_no_solution() -> None:
    problem = MapProblem(Logistic(4.0), np.ones((1, 1)))
    with pytest.raises(NoSolution, match="the map is not finite at"):
        problem.residual(np.array([1e200]), np.empty(0))
