"""Orbits of flows whose disturbances grow, and shrink again, between two crossings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy as sp

from dynkit import PoincareMap, Stroboscope, periodic_orbit
from dynkit.dynamics.hybrid_flow import ResetMap
from dynkit.systems import SymbolicFlow, SymbolicHybridFlow

PHASES = (-0.5 * np.pi, 0.0, 0.5 * np.pi)
LOSS = 0.1


def growing(x: Any, t: Any, growth: Any) -> Any:
    """The rate of x, which is sin t on the orbit; disturbances grow while cos t is positive.

    They grow by exp(2 growth), and over a period by exp(-2 pi LOSS): a closed form.
    """
    return (growth * sp.cos(t) - LOSS) * (x - sp.sin(t)) + sp.cos(t)


class Growing(SymbolicFlow):
    """Disturbances grow and shrink within a period of the drive."""

    growth: float = 6.0

    def velocity(self, x: Any, t: Any) -> Any:
        return growing(x, t, self.growth), sp.Integer(1)


class Restarted(SymbolicHybridFlow):
    """The same, where the time restarts after a period that begins at a phase."""

    growth: float = 6.0
    phase: float = 0.5 * np.pi

    def velocity(self, x: Any, t: Any) -> Any:
        return growing(x, t, self.growth), sp.Integer(1)

    def guard(self, x: Any, t: Any) -> Any:
        return self.phase + 2 * sp.pi - t

    def reset(self, x: Any, t: Any) -> Any:
        return x, t - 2 * sp.pi


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("growth", [1.0, 3.0, 6.0])
def test_the_error_covers_what_grew_on_the_way(growth: float, phase: float) -> None:
    returns = PoincareMap(Growing(growth=growth), Stroboscope(2, phase), time_limit=10.0)
    orbit = periodic_orbit(returns, [np.sin(phase) + 1e-9])
    assert abs(orbit.states[0, 0] - np.sin(phase)) <= orbit.error
    # roundings of 1 grow by exp(2 growth) at most; their sum is found with a margin of a hundred
    most = np.exp(2.0 * growth) if phase > 0.0 else np.exp(growth) if phase == 0.0 else 1.0
    assert orbit.error < 1e-12 + 1e-13 * most
    moved = abs(orbit.multipliers[0] - np.exp(-2.0 * np.pi * LOSS))
    assert moved <= max(orbit.multipliers_error[0], 1e-12)


def test_the_error_covers_what_grew_before_a_jump() -> None:
    phase = 0.5 * np.pi
    restarts = ResetMap(Restarted(), time_limit=10.0)
    orbit = periodic_orbit(restarts, [1.0 + 1e-9, phase])
    assert abs(orbit.states[0, 0] - 1.0) <= orbit.error < 1e-6
