"""Orbits that random machines settle on: stable, with the multipliers of the map."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit.testing import parameter_derivative_is_the_derivative
from tests.validation.itineraries import SETTLED, found


@pytest.mark.parametrize("number", SETTLED)
def test_an_orbit_is_that_of_its_attractor_and_of_the_map(number: int) -> None:
    case = found(number)
    assert case is not None
    orbit = case.orbit
    assert orbit.stable
    # a motion that is weakly damped turns about the orbit for long
    apart = [
        abs(orbit.system.difference(state, y)).max()
        for state in case.attractor.states
        for y in orbit.states
    ]
    assert min(apart) < 1e-2
    assert orbit.residual < 1e-9
    of_map = np.linalg.eigvals(case.product(0))
    within = orbit.multipliers_error.max() + 1e-9
    for multiplier in of_map[abs(of_map) > 1e-7]:
        assert abs(orbit.multipliers - multiplier).min() <= within
    problem = orbit.problem("frequency")
    x, p = np.array(orbit.unknowns), np.array([orbit.system.frequency])
    parameter_derivative_is_the_derivative(problem, x, p)
