"""The parts of a continuation can be replaced, one by one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from dynkit.continuation.continuing import continue_by, continue_orbit
from dynkit.continuation.corrector import Failure, NewtonCorrector
from dynkit.continuation.method import ContinuationMethod
from dynkit.continuation.points import Point, interpolated
from dynkit.continuation.predictor import cubic, tangent
from dynkit.continuation.step_control import AdaptiveSteps
from dynkit.continuation.test_functions import TESTS
from dynkit.core.validation import Array
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.newton import Equations
from tests.continuation.starts import henon

# fold and period doubling of Henon's map, b = 0.3: a = -(1 - b)^2 / 4 and 3 (1 - b)^2 / 4
FOLD, DOUBLING = -0.1225, 0.3675


def test_the_method_of_continue_orbit_is_the_default() -> None:
    one = continue_orbit(henon(), "a", bounds=(0.05, 1.4))
    other = continue_by(ContinuationMethod(), henon(), "a", bounds=(0.05, 1.4))
    assert one.unknowns.tobytes() == other.unknowns.tobytes()


def test_a_tangent_predictor_finds_the_same_bifurcations() -> None:
    method = ContinuationMethod(predictor=tangent, points=400)
    found = continue_by(method, henon(), "a", bounds=(-0.2, 1.4)).bifurcations
    values = [b.value for b in found]
    assert np.allclose(values, [FOLD, DOUBLING], atol=1e-13, rtol=0.0)


def test_cubics_do_not_depend_on_the_units_of_their_ends() -> None:
    def end(t: float, scale: Array) -> Point:
        y, along = np.array([t, t**3 - t]), np.array([1.0, 3.0 * t * t - 1.0]) / scale
        return Point(y, scale, along / np.linalg.norm(along), 1.0, 0.0, 0)

    for other in ([1.0, 1.0], [3.0, 3.0], [0.5, 4.0]):
        a, b = end(0.0, np.ones(2)), end(0.1, np.array(other))
        for part in (0.25, 0.5, 2.0):
            found, exact = interpolated(a, b, part), end(0.1 * part, np.ones(2)).y
            assert np.linalg.norm(found - exact) < 0.01
        step = 0.1 * float(np.linalg.norm(np.array([1.0, -0.99]) / other))
        assert np.linalg.norm(cubic(b, a, step) - end(0.2, np.ones(2)).y) < 0.01


def test_a_cubic_predictor_needs_fewer_newton_steps_than_the_tangent() -> None:
    costs = [
        continue_by(method, henon(), "a", bounds=(0.05, 1.4)).cost.counts
        for method in (ContinuationMethod(), ContinuationMethod(predictor=tangent))
    ]
    cubic, straight = (cost["newton_steps"] / cost["points"] for cost in costs)
    assert cubic < straight


@dataclass(frozen=True)
class Counted:
    """Newton's method, counted."""

    calls: list[float] = field(default_factory=list)

    def __call__(
        self, equations: Equations, guess: Array, near: Point, row: Array
    ) -> Point | Failure:
        self.calls.append(float(guess[-1]))
        return NewtonCorrector()(equations, guess, near, row)


def test_a_corrector_of_ones_own_makes_every_point() -> None:
    counted = Counted()
    branch = continue_by(ContinuationMethod(corrector=counted), henon(), "a", bounds=(0.05, 1.4))
    assert len(counted.calls) >= len(branch) - 1
    assert branch.endings[1].reason.name == "BOUND"


def test_points_are_no_further_apart_than_the_largest_step() -> None:
    method = ContinuationMethod(steps=AdaptiveSteps(first=0.01, largest=0.02))
    branch = continue_by(method, henon(), "a", bounds=(0.05, 1.4))
    # the parameter in units of its bounds; a point is at most 0.3 steps aside of its guess
    assert abs(np.diff(branch.parameter)).max() <= np.hypot(1.0, 0.3) * 0.02 * 1.35


def test_what_no_test_function_notices_is_passed_over() -> None:
    tests = tuple(test for test in TESTS if test.kind is not BifurcationKind.PD)
    method = ContinuationMethod(tests=tests, points=400)
    branch = continue_by(method, henon(), "a", bounds=(-0.2, 1.4))
    assert [b.kind for b in branch.bifurcations] == ["SN"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"first": 0.1}, r"first must be at most largest, 0.05; got 0.1"),
        ({"smallest": 0.0}, r"smallest must be positive; got 0.0"),
        ({"angle": np.nan}, r"angle must be a finite number; got nan"),
    ],
)
def test_bad_step_sizes_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        AdaptiveSteps(**options)


def test_a_method_has_room_for_a_point() -> None:
    with pytest.raises(ValueError, match=r"^points must be a positive integer; got 0$"):
        ContinuationMethod(points=0)
