"""Branches: through folds, closed on themselves, and on the exact curve all along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynkit.continuation.arclength import Continuation
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.initial_tangents import start_points
from dynkit.continuation.method import ContinuationMethod
from dynkit.continuation.orbit_equations import OrbitEquations
from dynkit.continuation.points import Point
from dynkit.continuation.results.branch import Branch
from dynkit.continuation.termination import Bound, Ending, Reason
from dynkit.systems import Logistic
from tests.continuation.families import BEHIND, Cycle, Flat, VeiledOrbit
from tests.continuation.starts import flat, henon, logistic


@pytest.fixture(scope="module")
def circle() -> Branch:
    return continue_orbit(flat("circle", 1.0, 0.0, 1.0), "p", bounds=(-3.0, 3.0))


@pytest.fixture(scope="module")
def cusp() -> Branch:
    return continue_orbit(flat("cusp", 0.0, 0.0, 1.0), "p", bounds=(-1.5, 1.5))


def off_circle(branch: Branch) -> np.ndarray:
    return np.asarray(abs(np.hypot(branch.parameter, branch.unknowns[:, 0]) - 1.0))


def test_a_circle_is_closed(circle: Branch) -> None:
    assert circle.closed
    assert [ending.reason.name for ending in circle.endings] == ["CLOSED", "CLOSED"]
    ends = np.array([circle.unknowns[0] - circle.unknowns[-1], circle.parameter[[0]]])
    assert abs(ends).max() < 1e-6


def test_a_circle_is_run_round_once(circle: Branch) -> None:
    angles = np.unwrap(np.arctan2(circle.parameter, circle.unknowns[:, 0]))
    assert abs(abs(angles[-1] - angles[0]) - 2.0 * np.pi) < 1e-6
    assert len(set(np.sign(np.diff(angles)))) == 1


def test_a_circle_folds_twice(circle: Branch) -> None:
    assert [b.kind for b in circle.bifurcations] == ["SN", "SN"]


def test_every_point_lies_on_the_circle(circle: Branch) -> None:
    assert off_circle(circle).max() < 1e-14


def test_errors_bound_the_distance_from_the_circle(circle: Branch) -> None:
    # distances in x are larger than scaled ones: all units are 1 or more
    assert (off_circle(circle) / 2.0 <= circle.error).all()
    assert circle.error.max() < 1e-12


def test_a_branch_goes_both_ways(cusp: Branch) -> None:
    assert sorted(cusp.parameter[[0, -1]]) == [-1.5, 1.5]
    assert len(set(np.sign(np.diff(cusp.unknowns[:, 0])))) == 1


def test_stability_changes_at_bifurcations_only(cusp: Branch) -> None:
    changes = np.flatnonzero(cusp.stable[1:] != cusp.stable[:-1])
    assert sorted(changes) == sorted(int(b.place) for b in cusp.bifurcations)


def test_multipliers_are_those_of_the_orbits(cusp: Branch) -> None:
    for place in (0, len(cusp) // 2, -1):
        assert (cusp.multipliers[place] == cusp.orbit(place).multipliers).all()


def test_orbits_are_made_of_points(cusp: Branch) -> None:
    orbit = cusp.orbit(3)
    assert orbit.system.parameters["p"] == cusp.parameter[3]
    assert (orbit.unknowns == cusp.unknowns[3]).all()
    assert orbit.residual == cusp.residuals[3]


def test_observables_are_those_of_the_orbits(cusp: Branch) -> None:
    assert (cusp.observable("state[0]")[:, 0] == cusp.unknowns[:, 0]).all()


def test_what_a_branch_holds_cannot_be_changed(cusp: Branch) -> None:
    with pytest.raises(ValueError, match="read-only"):
        cusp.parameter[0] = 0.0


def test_branches_say_what_they_are(circle: Branch, cusp: Branch) -> None:
    assert repr(circle).startswith("<Branch of P(1): closed, ")
    assert "SN -0.3849, SN 0.3849" in repr(cusp)
    assert "\n" not in repr(circle)


def test_steps_can_be_refined() -> None:
    coarse, fine = (
        continue_orbit(logistic(), "rate", bounds=(0.5, 4.0), largest_step=h) for h in (0.5, 0.002)
    )
    assert 10 * len(coarse) < len(fine)
    for a, b in zip(coarse.bifurcations, fine.bifurcations, strict=True):
        assert a.kind == b.kind
        assert abs(a.value - b.value) < 1e-12


def test_a_system_of_two_coordinates_is_followed() -> None:
    branch = continue_orbit(henon(), "a", bounds=(-0.2, 1.4), points=200)
    a, x = branch.parameter, branch.unknowns[:, 0]
    assert abs(a * x * x + 0.7 * x - 1.0).max() < 1e-12


def test_a_branch_starts_again_at_a_bifurcation(cusp: Branch) -> None:
    for bifurcation in cusp.bifurcations:
        again = continue_orbit(bifurcation.orbit, "p", bounds=(-1.5, 1.5))
        values = [(b.kind, round(b.value, 9) + 0.0) for b in again.bifurcations]
        known = [(b.kind, round(b.value, 9) + 0.0) for b in cusp.bifurcations]
        assert sorted(values) == sorted(known)


def test_a_branch_starts_at_a_branch_point() -> None:
    branch = continue_orbit(flat("transcritical", 0.0, 0.3), "p", bounds=(-1.0, 1.0))
    (point,) = branch.bifurcations
    again = continue_orbit(point.orbit, "p", bounds=(-1.0, 1.0))
    ends = sorted(again.parameter[[0, -1]])
    assert ends == [-1.0, 1.0]
    x, p = again.unknowns[:, 0], again.parameter
    assert abs(x * (p - x)).max() < 1e-12


def test_a_permuted_orbit_is_the_same_orbit() -> None:
    # an isolated closed branch of period 1 looked at as period 2: its points come back as others
    start = Cycle(Logistic(3.2), np.array([0.5130445095326298, 0.7994554904673701]))
    branch = continue_orbit(start, "rate", bounds=(2.9, 3.3))
    assert branch.endings[0].reason.name == "RETRACED"
    assert branch.parameter.max() == 3.3
    assert abs(branch.parameter.min() - 3.0) < 1e-3


def test_borders_are_found_however_long_the_steps() -> None:
    start = flat("cusp", 1.2, 1.2**3 - 1.2, 1.0, border=1.05)
    branch = continue_orbit(start, "p", bounds=(0.1, 1.5), largest_step=0.2)
    (grazing,) = (b for b in branch.bifurcations if b.kind == "GR")
    assert abs(grazing.value - (1.05**3 - 1.05)) < 1e-14
    assert grazing.multiplier is None
    assert grazing.touching == {"twice": pytest.approx(2.1, abs=1e-14)}
    beyond = branch.unknowns[:, 0] < 1.05
    assert (branch.admissible == ~beyond).all()


def test_a_branch_may_end_at_its_border() -> None:
    start = flat("cusp", 1.2, 1.2**3 - 1.2, 1.0, border=1.05)
    branch = continue_orbit(start, "p", bounds=(0.1, 1.5), inadmissible=False)
    assert branch.admissible.all()
    assert branch.endings[0].reason.name == "INADMISSIBLE"
    assert [b.kind for b in branch.bifurcations] == ["GR"]


def test_parameters_of_a_bifurcation_are_all_of_them() -> None:
    branch = continue_orbit(replace(henon()), "a", bounds=(0.05, 1.4))
    (doubling,) = branch.bifurcations
    assert dict(doubling.parameters) == {"a": doubling.value, "b": 0.3}


@pytest.mark.parametrize("largest_step", [0.05, 0.2])
@pytest.mark.parametrize("gap", [1e-3, 1e-5, 1e-8])
def test_a_branch_does_not_step_over_to_one_near_by(gap: float, largest_step: float) -> None:
    # x^3 - q x = gap is a pitchfork torn apart: on this branch x is positive and falls with q
    x = float(max(np.roots([1.0, 0.0, -1.0, -gap]).real))
    branch = continue_orbit(
        flat("cusp", x, gap, 1.0), "q", bounds=(-1.0, 1.5), largest_step=largest_step
    )
    assert branch.unknowns.min() > 0.0
    assert sorted(branch.parameter[[0, -1]]) == [-1.0, 1.5]
    assert [b.kind for b in branch.bifurcations] == ["PD"]


def test_points_come_one_by_one() -> None:
    orbit = logistic(2.5)
    problem = orbit.problem("rate")
    equations = OrbitEquations(problem, 1.0)
    (start,) = start_points(equations, np.append(orbit.unknowns, 2.5))
    bounds = (Bound(1, "rate", 2.0, 3.0),)
    curve = Continuation(equations, start, bounds, ContinuationMethod(), lambda a, b: (b, True))
    points = iter(curve)
    first = [next(points) for _ in range(3)]
    values = [point.y[-1] for point in first if isinstance(point, Point)]
    assert values[0] == 2.5
    assert np.all(np.diff(values) > 0.0)
    *_, last, ending = points
    assert isinstance(last, Point)
    assert last.y[-1] == 3.0
    assert ending == Ending(Reason.BOUND, "the bound was reached: rate 3")


def test_iterating_changes_nothing() -> None:
    orbit = logistic(2.5)
    equations = OrbitEquations(orbit.problem("rate"), 1.0)
    (start,) = start_points(equations, np.append(orbit.unknowns, 2.5))
    bounds = (Bound(1, "rate", 2.0, 3.0),)
    curve = Continuation(equations, start, bounds, ContinuationMethod(), lambda a, b: (b, True))
    first, second = ([e.y.tolist() for e in curve if isinstance(e, Point)] for _ in range(2))
    assert first == second


def test_borders_just_behind_where_they_cannot_be_told_are_found() -> None:
    orbit = VeiledOrbit(Flat("cusp", 0.125, 0.0), np.array([0.5]))
    branch = continue_orbit(orbit, "p", bounds=(0.01, 0.2), step=0.2, largest_step=0.2)
    (grazing,) = branch.bifurcations
    assert abs(grazing.value - BEHIND**3) < 1e-14


def test_bifurcations_of_which_not_even_six_digits_are_known_show_their_error(cusp: Branch) -> None:
    known = next(b for b in cusp.bifurcations if b.kind == "SN")
    doubtful = replace(known, error=0.25)
    value = f"{known.value:.12g}"
    assert repr(known) == f"<SN at p {value}>"
    assert repr(doubtful) == f"<SN at p {value} +- 0.2>"
    assert f"{value} +- 0.2" in doubtful._repr_html_()
    assert f"SN {known.value:.6g} +- 0.2" in repr(replace(cusp, bifurcations=(doubtful,)))
