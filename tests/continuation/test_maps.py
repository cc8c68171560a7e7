"""Orbits of the textbook maps, as users continue them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynkit import Branch, continue_curve, continue_orbit, periodic_orbit
from dynkit.systems import Henon, Logistic


@pytest.fixture(scope="module")
def henon() -> Branch:
    orbit = periodic_orbit(Henon(a=0.2, b=0.3), np.array([0.8, 0.2]))
    return continue_orbit(orbit, "a", bounds=(-0.2, 1.4), points=300)


def test_orbits_of_henon_double_again_and_again(henon: Branch) -> None:
    branch = henon
    for period in (2, 4, 8):
        (orbit,) = next(b for b in branch.bifurcations if b.kind == "PD").switch()
        assert orbit.label == f"P({period})"
        branch = continue_orbit(orbit, "a", bounds=(0.3, 1.4))
        assert branch.label == f"P({period})"
    # at the fourth doubling the product of the eight derivatives has the eigenvalue -1
    orbit = next(b for b in branch.bifurcations if b.kind == "PD").orbit
    product = np.eye(2)
    for state in orbit.states:
        product = orbit.system.jacobian(state) @ product
    assert abs(np.linalg.eigvals(product) + 1.0).min() < 1e-10


def test_the_curve_of_a_doubled_orbit_is_followed(henon: Branch) -> None:
    (orbit,) = next(b for b in henon.bifurcations if b.kind == "PD").switch()
    branch = continue_orbit(orbit, "a", bounds=(0.3, 1.4))
    doubling = next(b for b in branch.bifurcations if b.kind == "PD")
    curve = continue_curve(doubling, ("a", "b"), bounds=((0.0, 2.0), (0.0, 0.6)))
    a, b = curve.parameters.T
    # of period two the trace of the derivative is 4 (1 - b)^2 - 4 a + 2 b, its determinant b^2
    assert abs(1.0 + b**2 + 4.0 * (1.0 - b) ** 2 - 4.0 * a + 2.0 * b).max() < 1e-10


def test_a_branch_of_a_map_is_stored(henon: Branch, tmp_path: Path) -> None:
    henon.save(tmp_path / "henon.h5")
    loaded = Branch.load(tmp_path / "henon.h5", henon.orbit(-1))
    again = continue_orbit(loaded.bifurcations[1].orbit, "a", bounds=(0.3, 0.4))
    first = continue_orbit(henon.bifurcations[1].orbit, "a", bounds=(0.3, 0.4))
    assert again.unknowns.tobytes() == first.unknowns.tobytes()


def test_from_a_doubled_branch_one_comes_back_to_the_single_orbit() -> None:
    orbit = periodic_orbit(Logistic(rate=2.5), np.array([0.6]))
    (doubling,) = continue_orbit(orbit, "rate", bounds=(2.0, 3.5)).bifurcations
    (doubled,) = doubling.switch()
    branch = continue_orbit(doubled, "rate", bounds=(2.0, 3.3))
    (point,) = branch.bifurcations
    assert point.kind == "BP"
    (single,) = point.switch()
    assert single.label == "P(1)"
    assert abs(single.states[0, 0] - (1.0 - 1.0 / single.system.parameters["rate"])) < 1e-14
