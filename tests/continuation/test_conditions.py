"""Derivatives of conditions, by differences."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit.continuation.defining_systems import BifurcationEquations
from dynkit.core.validation import Array
from dynkit.orbits.events import Condition
from tests.continuation.starts import henon


class Turning(Condition):
    """sin(k p - 1/10), as what depends on a frequency over many turns."""

    unknowns = 0

    def __init__(self, turns: float) -> None:
        self.turns = turns

    def residual(self, x: Array, own: Array, p: Array) -> Array:
        del x, own
        return np.asarray(np.sin(self.turns * p - 0.1))


@pytest.mark.parametrize("turns", [1.0, 1e3, 1e4, 1e5, 3e5, 1e6])
def test_steps_are_shorter_where_a_condition_changes_fast(turns: float) -> None:
    orbit = henon()
    equations = BifurcationEquations(orbit.problem("a"), Turning(turns), np.ones(1))
    y = np.append(orbit.unknowns, 0.0)
    found = equations.full_jacobian(y)[-1, -1]
    assert found == pytest.approx(turns * np.cos(0.1), rel=1e-3)
