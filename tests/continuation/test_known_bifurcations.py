"""Bifurcations whose place is known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from dynkit.continuation.bifurcations.bifurcation import Bifurcation
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.defining_systems import null_vector
from dynkit.continuation.results.branch import Branch
from dynkit.dynamics.equilibrium import equilibrium
from dynkit.systems import Logistic, Lorenz
from tests.continuation.families import Cycle, Exchange, Flat, PoleOrbit, Rotation
from tests.continuation.starts import delayed_logistic, flat, henon, iterated, logistic

TEN_DIGITS = 1e-10


def only(branch: Branch, kind: str) -> Bifurcation:
    (found,) = (b for b in branch.bifurcations if b.kind == kind)
    return found


@pytest.fixture(scope="module")
def quadratic() -> Branch:
    return continue_orbit(logistic(), "rate", bounds=(2.0, 4.0))


@pytest.fixture(scope="module")
def twofold(quadratic: Branch) -> Branch:
    (orbit,) = only(quadratic, "PD").switch()
    return continue_orbit(orbit, "rate", bounds=(2.0, 4.0))


def test_the_branch_of_equilibria_beside_the_origin_of_lorenz_passes_its_pitchfork() -> None:
    # at rho = 1: C. Sparrow, The Lorenz Equations, Springer 1982, chapter 1
    origin = equilibrium(Lorenz(rho=0.5), np.zeros(3))
    pitchfork = only(continue_orbit(origin, "rho", bounds=(0.5, 10.0)), "BP")
    (beside,) = pitchfork.switch()
    branch = continue_orbit(beside, "rho", bounds=(0.5, 10.0))
    assert [b.kind for b in branch.bifurcations] == ["BP"]
    assert abs(only(branch, "BP").value - 1.0) < 1e-9
    assert [ending.reason.name for ending in branch.endings] == ["BOUND", "BOUND"]


# The logistic map: R. M. May, Simple mathematical models with very complicated dynamics, Nature 261
# (1976) 459-467.


def test_the_fixed_point_of_the_logistic_map_doubles_at_three(quadratic: Branch) -> None:
    assert [b.kind for b in quadratic.bifurcations] == ["PD"]
    assert abs(only(quadratic, "PD").value - 3.0) < TEN_DIGITS


def test_its_orbit_of_period_two_doubles_at_one_plus_root_six(twofold: Branch) -> None:
    assert abs(only(twofold, "PD").value - (1.0 + np.sqrt(6.0))) < TEN_DIGITS


def test_a_doubled_branch_ends_where_it_left(twofold: Branch) -> None:
    assert abs(only(twofold, "BP").value - 3.0) < TEN_DIGITS
    assert twofold.endings[0].reason.name == "RETRACED"
    assert twofold.label == "P(2)"


def test_orbits_of_the_doubled_branch_are_the_known_ones(twofold: Branch) -> None:
    r = twofold.parameter
    half, sum_ = np.sqrt((r + 1.0) * np.maximum(r - 3.0, 0.0)) / (2.0 * r), (r + 1.0) / (2.0 * r)
    exact = np.column_stack([sum_ - half, sum_ + half])
    # beside 3 the coordinates are square roots of what the parameter is off by
    away = r > 3.001
    assert abs(np.sort(twofold.unknowns, axis=1) - exact)[away].max() < 1e-12


def test_period_three_is_born_at_one_plus_root_eight() -> None:
    branch = continue_orbit(iterated(Logistic(3.835), [0.5], 3), "rate", bounds=(3.8, 3.9))
    fold = only(branch, "SN")
    assert abs(fold.value - (1.0 + np.sqrt(8.0))) < TEN_DIGITS
    assert [str(ending) for ending in branch.endings] == ["the bound was reached: rate 3.9"] * 2


# Henon's map: its fixed points and multipliers are roots of quadratics.


def test_fixed_points_of_henon_fold() -> None:
    branch = continue_orbit(henon(), "a", bounds=(-0.2, 1.4), points=400)
    assert abs(only(branch, "SN").value - -((1.0 - 0.3) ** 2) / 4.0) < TEN_DIGITS


def test_the_fixed_point_of_henon_doubles() -> None:
    branch = continue_orbit(henon(), "a", bounds=(-0.1, 1.4), points=400)
    assert abs(only(branch, "PD").value - 3.0 * (1.0 - 0.3) ** 2 / 4.0) < TEN_DIGITS


# The delayed logistic map: J. M. Maynard Smith, Mathematical Ideas in Biology, Cambridge 1968; its
# multipliers solve mu^2 - mu + r - 1 = 0.


def test_the_delayed_logistic_map_has_its_torus_at_two() -> None:
    branch = continue_orbit(delayed_logistic(), "rate", bounds=(1.5, 2.5))
    torus = only(branch, "NS")
    assert abs(torus.value - 2.0) < TEN_DIGITS
    assert torus.multiplier is not None
    assert abs(torus.multiplier - np.exp(1j * np.pi / 3.0)) < TEN_DIGITS


@pytest.mark.parametrize("shape", ["pitchfork", "transcritical"])
def test_crossing_branches_meet_at_a_branch_point(shape: str) -> None:
    branch = continue_orbit(flat(shape, 0.0, 0.3), "p", bounds=(-1.0, 1.0))
    (point,) = branch.bifurcations
    assert point.kind == "BP"
    assert abs(point.value) < TEN_DIGITS


def test_the_cusp_family_has_two_folds() -> None:
    branch = continue_orbit(flat("cusp", 0.0, 0.0, 1.0), "p", bounds=(-1.5, 1.5))
    folds = [b.value for b in branch.bifurcations if b.kind == "SN"]
    assert np.allclose(sorted(folds), np.array([-1.0, 1.0]) * np.sqrt(4.0 / 27.0), atol=TEN_DIGITS)


# What multipliers alone do not tell


@pytest.mark.parametrize("largest_step", [0.01, 0.3])
def test_a_pair_that_leaves_while_another_multiplier_enters_is_seen(largest_step: float) -> None:
    orbit = Cycle(Exchange(0.9), np.zeros(3))
    branch = continue_orbit(orbit, "d", bounds=(0.8, 1.2), largest_step=largest_step)
    assert abs(only(branch, "NS").value - 1.0) < TEN_DIGITS
    assert abs(only(branch, "PD").value - 1.001) < TEN_DIGITS


def test_a_pair_that_forms_and_leaves_within_a_step_is_seen() -> None:
    # real below d = 0.9025
    orbit = Cycle(Rotation(0.85, 1.9), np.zeros(2))
    branch = continue_orbit(orbit, "d", bounds=(0.8, 1.2), step=0.5, largest_step=0.5)
    assert abs(only(branch, "NS").value - 1.0) < TEN_DIGITS


def test_real_multipliers_of_product_one_are_no_torus() -> None:
    orbit = Cycle(Rotation(0.85, 3.0), np.zeros(2))
    branch = continue_orbit(orbit, "d", bounds=(0.8, 1.2))
    assert branch.bifurcations == ()


def test_a_pair_that_forms_beyond_the_product_one_is_no_torus() -> None:
    # real up to d = 1.050625, with the product d; one of them is 1 at d = 1.05
    orbit = Cycle(Rotation(0.9, 2.05), np.zeros(2))
    branch = continue_orbit(orbit, "d", bounds=(0.8, 1.3), step=0.5, largest_step=0.5)
    assert [b.kind for b in branch.bifurcations] == ["BP"]


def test_pairs_that_stay_on_the_unit_circle_are_no_tori() -> None:
    # area is preserved; mu^2 - t mu + 1 has the double root 1 at t = 2, and -1 at t = -2
    orbit = Cycle(Rotation(1.0, 0.3), np.zeros(2))
    branch = continue_orbit(orbit, "t", bounds=(-3.0, 3.0))
    assert [b.kind for b in branch.bifurcations] == ["PD", "BP"]
    assert np.allclose([b.value for b in branch.bifurcations], [-2.0, 2.0], rtol=0.0, atol=1e-10)


def test_a_multiplier_that_passes_infinity_is_no_bifurcation() -> None:
    orbit = PoleOrbit(Flat("pitchfork", -0.5), np.zeros(1))
    branch = continue_orbit(orbit, "p", bounds=(-0.6, 0.6))
    assert branch.multipliers[0].real * branch.multipliers[-1].real < 0.0
    assert branch.bifurcations == ()


KNOWN: dict[str, tuple[Callable[[], Any], str, tuple[float, float], dict[str, Any]]] = {
    "logistic": (logistic, "rate", (0.5, 4.0), {"BP": 1.0, "PD": 3.0}),
    "period three": (
        lambda: iterated(Logistic(3.835), [0.5], 3),
        "rate",
        (3.8, 3.84),
        {"SN": 8**0.5 + 1},
    ),
    "henon": (henon, "a", (-0.2, 1.4), {"SN": -0.1225, "PD": 0.3675}),
    "delayed logistic": (delayed_logistic, "rate", (0.5, 2.5), {"BP": 1.0, "NS": 2.0}),
    "pitchfork": (lambda: flat("pitchfork", 0.0, 0.3, 0.1), "p", (-1.0, 1.0), {"BP": 0.1}),
    "circle": (lambda: flat("circle", 0.0, 0.7, 0.49), "p", (-2.0, 0.7), {"SN": (-0.7, 0.7)}),
}


@cache
def branch_of(name: str) -> Branch:
    orbit, parameter, bounds, _ = KNOWN[name]
    return continue_orbit(orbit(), parameter, bounds=bounds, points=400)


@pytest.mark.parametrize(
    ("name", "kind", "value"),
    [
        (name, kind, value)
        for name, (*_, values) in KNOWN.items()
        for kind, each in values.items()
        for value in np.atleast_1d(each).tolist()
    ],
)
def test_errors_bound_what_a_value_is_off_by(name: str, kind: str, value: float) -> None:
    found = [b for b in branch_of(name).bifurcations if b.kind == kind]
    nearest = min(found, key=lambda b: abs(b.value - value))
    # the known value is rounded too
    assert abs(nearest.value - value) <= nearest.error + 2.0**-52 * abs(value)
    assert nearest.error < 1e-11
    assert len(found) == np.size(KNOWN[name][3][kind])


def test_the_nearest_null_vector_is_that_of_a_doubling() -> None:
    doubling = only(continue_orbit(henon(), "a", bounds=(0.05, 0.6)), "PD")
    value = np.array([doubling.value])
    vector = null_vector(doubling.problem, doubling.unknowns, value, -1.0)
    assert abs(abs(vector @ doubling.direction) - 1.0) < 1e-12
