"""Checks of the arguments of `continue_orbit` and `continue_curve`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynkit.continuation.method import ContinuationMethod
from dynkit.continuation.step_control import AdaptiveSteps
from dynkit.core.no_motion import NoMotion, Refused
from dynkit.core.validation import finite_scalar, positive, positive_integer
from dynkit.orbits.equations import Problem, ProblemSolution


def checked_bounds(name: str, bounds: Any) -> tuple[float, float]:
    """Return bounds as two numbers, the first below the second.

    Raises
    ------
    ValueError
        When the bounds are not two such numbers.
    """
    flat = isinstance(bounds, np.ndarray) and bounds.ndim == 0
    if not isinstance(bounds, Sequence | np.ndarray) or flat or len(bounds) != 2:
        raise ValueError(f"{name} must be two numbers; got {bounds!r}")
    low, high = (finite_scalar(f"{name}[{i}]", bounds[i]) for i in range(2))
    if not low < high:
        raise ValueError(f"{name} must be (low, high) with low < high; got ({low}, {high})")
    return low, high


def checked_method(step: float, largest_step: float, points: int) -> ContinuationMethod:
    """Return the continuation method with these options.

    Raises
    ------
    ValueError
        When an option is out of range.
    """
    largest = positive("largest_step", largest_step)
    first = min(positive("step", step), largest)
    return ContinuationMethod(
        steps=AdaptiveSteps(first=first, largest=largest),
        points=positive_integer("points", points),
    )


def problem_of(orbit: ProblemSolution, names: tuple[str, ...]) -> Problem:
    """Return the equations of an orbit with free parameters.

    Raises
    ------
    ValueError
        When the orbit is not a `ProblemSolution`, or its system lacks a parameter.
    Refused
        When the orbit does not solve its equations.
    """
    if not isinstance(orbit, ProblemSolution):
        raise ValueError(f"orbit must be a PeriodicOrbit or an Equilibrium; got {_no_orbit(orbit)}")
    for name in names:
        orbit.system.value_of(name)
    problem = orbit.problem(*names)
    try:
        residual = float(abs(problem.residual(orbit.unknowns, problem.values)).max())
    except NoMotion as refusal:
        raise Refused(f"orbit must solve its equations; got {refusal}") from refusal
    if not residual <= 1e-8:
        raise Refused(f"orbit must solve its equations; got a residual of {residual:.1e}")
    return problem


def _no_orbit(given: object) -> str:
    has_one = hasattr(given, "periodic_orbit")
    return f"{given!r}{', whose periodic_orbit() gives one' if has_one else ''}"
