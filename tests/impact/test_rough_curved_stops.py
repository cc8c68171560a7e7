"""Coulomb friction at stops along functions of the coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import sympy as sp

from dynkit import CannotFollow
from dynkit.systems import DryFriction, HardStop, ImpactOscillator
from dynkit.systems.impact.simulation.trajectory import Ending
from dynkit.testing.maps import jacobian_is_the_derivative
from tests.impact.test_coulomb import dropped

SLOPE = math.hypot(1.0, 0.3)
"""Derivative of sinh(y) where it is 0.3."""


@dataclass(frozen=True, kw_only=True)
class Sliding(ImpactOscillator):
    """The body of `dropped`; the potential may depend on the phase."""

    lean: float = 0.0

    degrees_of_freedom = 2

    def kinetic(self, v: Any) -> Any:
        return (v[0] ** 2 + sp.Float(1.3) * v[1] ** 2) / 2

    def potential(self, x: Any, phase: Any) -> Any:  # type: ignore[override]
        del phase
        return (x[0] ** 2 + x[1] ** 2) / 2 - sp.Float(0.3) * x[0] * x[1]

    def dissipation(self, v: Any) -> Any:
        return sp.Float(0.025) * v[0] ** 2 + sp.Float(0.01) * v[1] ** 2

    def height(self, x: Any) -> Any:
        return sp.sinh(x[1]) + self.lean * x[0]


def sliding(coefficient: float, row: int = 0, **own: Any) -> Sliding:
    """That body above the table sinh(y) >= 0.3."""
    return Sliding(
        frequency=1.0,
        constant_forces=[0.3, -1.0],
        chatter_tolerance=1e-14,
        elements=[
            HardStop("height", offset=0.3, restitution=0.6, name="table", **own),
            DryFriction(row, coefficient=coefficient, normal="table"),
        ],
    )


def test_friction_at_a_curved_stop_is_that_of_a_straight_one_whose_force_is_as_large() -> None:
    # The force along y is the contact force along sinh(y), times the slope.
    straight = dropped(0.3, 0.25, 0.6, 1e-14)
    table = HardStop(1, offset=math.asinh(0.3), restitution=0.6, name="table")
    straight = straight.replace(elements=[table, straight.elements[1]])
    curved, start = sliding(0.25 * SLOPE), ([0.0, 0.6], [1.0, 0.0])
    one = straight.simulate(impacts=60, start=straight.state(*start))
    two = curved.simulate(impacts=60, start=curved.state(*start))
    # The chatter is cut later along a function.
    within = (one.error[:10] + two.error[:10])[:, None]
    assert (abs(one.position[:10] - two.position[:10]) <= within).all()
    assert (abs(one.velocity[:10] - two.velocity[:10]) <= within).all()
    assert two.sticking[0, 0] == pytest.approx(one.sticking[0, 0], rel=1e-9)
    assert abs(one.final.position - two.final.position).max() < 1e-9
    assert two.energy_balance().error < 1e-12
    jacobian_is_the_derivative(curved, two.states[1:4])


def test_friction_that_the_masses_couple_with_a_curved_stop_leaves_the_impact_open() -> None:
    leaning = sliding(0.3).replace(lean=0.2)
    record = leaning.simulate(impacts=4, start=leaning.state([0.0, 0.6], [1.0, 0.0]))
    assert record.ambiguous == 0
    assert np.isinf(record.error).all()


def test_friction_along_the_gradient_of_its_stop_is_refused_by_name() -> None:
    blocked = sliding(0.3, row=1)
    start = blocked.state([0.0, 0.6], [1.0, 0.0])
    with pytest.raises(CannotFollow, match="must not act along what stops hold"):
        blocked.simulate(impacts=200, start=start)


def test_a_bead_that_sticks_and_slips_on_a_curved_table_for_ever_ends_soon() -> None:
    class Bead(Sliding):
        def height(self, x: Any) -> Any:
            return x[1] - x[0] ** 2 / 10

    belt = DryFriction(0, force=0.3, static=0.5, velocity=0.2, name="belt")
    table = HardStop("height", restitution=0.4)
    bead = Bead(frequency=1.0, constant_forces=[0.0, -1.0], elements=[table, belt])
    record = bead.simulate(impacts=3, start=bead.state([0.0, 0.0], [0.2, 0.0]))
    assert record.ending is Ending.REPEATS
    # as it says: each cycle takes as long as the one before
    times = record.events.time[-5:]
    assert times[4] - times[2] == pytest.approx(times[2] - times[0], rel=1e-12)
    assert len(record.events) < 200
