"""What the criticality of a period doubling says of the orbits that are born there."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynkit import Bifurcation
from dynkit.orbits.problem import PeriodicProblem


def growth_of_born(doubling: Bifurcation, born: Any) -> float:
    """1 - mu of an orbit that is born, over 4 c a^2 with its distance a: one, to first order."""
    assert isinstance(doubling.problem, PeriodicProblem)
    twice, start, way = doubling.problem.doubled(doubling.unknowns, doubling.direction)
    found = doubling.criticality
    assert found is not None
    scale = twice.scale(start)
    along = way / scale
    distance = float((born.unknowns - start) / scale @ along / (along @ along))
    multiplier = born.multipliers[np.argmin(abs(born.multipliers - 1.0))]
    return float((1.0 - multiplier).real / (4.0 * found.coefficient * distance**2))
