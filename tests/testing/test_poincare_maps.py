"""The checks of crossings pass what conforms, and name the defect of what does not."""

from dataclasses import dataclass

import numpy as np
import pytest

from dynkit import testing
from dynkit.core.validation import Array
from dynkit.dynamics.flow import Crossing, Flow
from dynkit.dynamics.poincare_map import PoincareMap
from dynkit.dynamics.section import Hyperplane, PoincareSection
from tests.example_systems import DampedRotation
from tests.testing.cases import PLANE, POINTS


@pytest.mark.parametrize("check", testing.poincare_map_checks, ids=testing.check_name)
def test_poincare_maps_conform(check: testing.PoincareMapCheck) -> None:
    check(PoincareMap(DampedRotation(), PLANE, 10.0), POINTS)


@dataclass(frozen=True)
class ShiftedCrossing(DampedRotation):
    """Reports a crossing moved in time, in space, or by whole returns."""

    late: float = 0.0
    aside: float = 0.0
    turns: int = 1
    against: bool = False
    patient: bool = False

    def next_crossing(self, state: Array, section: PoincareSection, time_limit: float) -> Crossing:
        if self.against:
            section = Hyperplane(section.gradient(state), 0.1 / np.sqrt(1.13), -1)
        limit = 100.0 if self.patient or self.turns > 1 else time_limit
        time = 0.0
        here = state
        for _ in range(self.turns):
            crossing = super().next_crossing(here, section, limit)
            time, here = time + crossing.time, crossing.state
        return Crossing(time + self.late, here + self.aside)


@pytest.mark.parametrize(
    ("flow", "check", "message"),
    [
        (
            ShiftedCrossing(aside=1e-3),
            testing.crossing_lands_on_the_section,
            "crossings lie on the section",
        ),
        (
            ShiftedCrossing(against=True),
            testing.crossing_goes_in_the_direction,
            "crossings go in the section's direction",
        ),
        (
            ShiftedCrossing(late=1e-3),
            testing.crossing_is_where_the_flow_is,
            "the flow at the return time",
        ),
        (
            ShiftedCrossing(late=-20.0),
            testing.crossing_is_where_the_flow_is,
            "return times are positive",
        ),
        (ShiftedCrossing(turns=2), testing.crossing_is_the_first, "crossings are the first"),
        (ShiftedCrossing(patient=True), testing.time_limit_is_kept, "NoCrossing is raised"),
    ],
)
def test_a_broken_crossing_is_caught_by_name(
    flow: Flow, check: testing.PoincareMapCheck, message: str
) -> None:
    system = PoincareMap(flow, PLANE, 10.0)
    with pytest.raises(AssertionError, match=message):
        check(system, POINTS)
    with pytest.raises(AssertionError):
        testing.check_poincare_map(system, POINTS)
