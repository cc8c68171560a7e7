"""The contracts of an orbit's equations, for several of its parameters."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from dynkit.testing import (
    check_problem,
    equations_have_the_shape,
    free_changes_the_names_only,
    parameter_derivative_is_the_derivative,
    solution_gives_back_its_equations,
)

OF_THE_PARAMETER = (
    equations_have_the_shape,
    parameter_derivative_is_the_derivative,
    free_changes_the_names_only,
    solution_gives_back_its_equations,
)
"""The others are the same whichever parameter is free."""


def check_parameters(orbit: Any, names: Iterable[str]) -> None:
    """Check all contracts with the first parameter free, with each other one what is its own."""
    first, *others = names
    problem = orbit.problem(first)
    check_problem(problem, orbit.unknowns, problem.values)
    for name in others:
        problem = orbit.problem(name)
        for check in OF_THE_PARAMETER:
            check(problem, orbit.unknowns, problem.values)
