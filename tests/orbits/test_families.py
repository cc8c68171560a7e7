"""Problems of one's own are solved, and what is bad is refused in one line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit import NoConvergence, continue_orbit, find_solution
from tests.testing.test_problems import Balance, BalanceProblem, rest

# force + y - x^2 = 0 and coupling x = 2 y: x^2 - x / 4 = 1
EXACT = 0.125 + np.sqrt(0.125**2 + 1.0)


def test_the_solution_is_as_wrong_as_it_says() -> None:
    found = rest()
    assert abs(found.unknowns - [EXACT, EXACT / 4.0]).max() <= found.error < 1e-13


def test_eigenvalues_are_those_of_the_linearization() -> None:
    found: Any = rest()
    exact = np.linalg.eigvals([[-2.0 * EXACT, 1.0], [0.5, -2.0]])
    assert abs(np.sort(found.eigenvalues.real) - np.sort(exact)).max() < 1e-13
    assert found.stable


def test_a_fold_of_ones_own_problem_is_solved_for() -> None:
    # x^2 - x / 4 = force has one root where force = -1/64
    branch = continue_orbit(rest(), "force", bounds=(-1.0, 2.0))
    (fold,) = branch.bifurcations
    assert fold.kind == "SN"
    assert abs(fold.value + 1.0 / 64.0) <= fold.error < 1e-12


@pytest.mark.parametrize(
    ("problem", "guess", "message"),
    [
        (Balance(), [1.0, 1.0], r"^problem must be a FamilyProblem; got Balance"),
        (BalanceProblem(Balance()), [1.0], r"^guess must"),
        (BalanceProblem(Balance()), [1.0, np.inf], r"^guess"),
    ],
)
def test_bad_input_is_refused(problem: Any, guess: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        find_solution(problem, guess)


@pytest.mark.parametrize(
    ("method", "value", "message"),
    [
        (
            "residual",
            [0.0, 0.0],
            r"^residual must return an array \(2,\) of floats; got \[0",
        ),
        ("residual", np.zeros((1, 2)), r"got float64 \(1, 2\)"),
        ("residual", np.zeros(2, dtype=complex), r"got complex128 \(2,\)"),
        ("scale", 1.0, r"^scale must return an array \(2,\) of floats; got 1.0"),
        ("linearization", np.zeros(2), r"^linearization must return an array \(2, 2\) of floats"),
    ],
)
def test_a_method_that_returns_something_else_is_named(
    method: str, value: Any, message: str
) -> None:
    wrong: Any = type("Wrong", (BalanceProblem,), {method: lambda *_: value})
    with pytest.raises(ValueError, match=message):
        find_solution(wrong(Balance()), [1.0, 1.0])


def test_a_system_without_parameters_by_name_is_refused() -> None:
    system: Any = {"force": 1.0}
    with pytest.raises(ValueError, match=r"^system must be a Family; got "):
        BalanceProblem(system)


def test_no_solution_is_an_error_that_says_how_far_it_came() -> None:
    with pytest.raises(NoConvergence, match=r"^no solution found from the guess after "):
        find_solution(BalanceProblem(Balance(force=-1.0)), [1.0, 1.0])
