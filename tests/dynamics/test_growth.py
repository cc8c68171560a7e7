"""Growth of disturbances along iterates, in machine code and step by step."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit.core.smooth_map import SmoothMap
from dynkit.systems import Henon, Logistic, StandardMap, SymbolicMap


@pytest.mark.parametrize("system", [Logistic(rate=3.9), Henon(), StandardMap(k=2.0)])
def test_growth_in_machine_code_is_that_of_single_steps(system: SymbolicMap) -> None:
    state = np.full(system.dimension, 0.3)
    fast, slow = system._growth(state, 25), SmoothMap._growth(system, state, 25)
    assert fast == pytest.approx(slow, abs=1e-6)  # chaos parts the motions, from the last digits
    assert fast[:5] == pytest.approx(slow[:5], abs=1e-12)
    assert state.tolist() == [0.3] * system.dimension


def test_of_a_superstable_orbit_all_growth_is_lost() -> None:
    assert (Logistic(rate=2.0)._growth(np.array([0.5]), 9) == -np.inf).all()


def test_a_direction_that_nearly_vanishes_has_a_logarithm() -> None:
    """Its first coordinate is lost but for rounding, and its second one is multiplied by b."""
    system = Henon(a=1.4, b=1e-17)
    logs = system._growth(np.array([3.0**0.5 / (2.8 * 2.0**0.5), 0.0]), 2)
    assert np.isfinite(logs).all()
    assert logs[0] < -34.0
