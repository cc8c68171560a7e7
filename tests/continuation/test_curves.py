"""Curves of bifurcations in two parameters, against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit.continuation.bifurcations.bifurcation import Bifurcation
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.curves import continue_curve
from dynkit.orbits.problem import PeriodicOrbit
from tests.continuation.families import Cycle, Edge, Rotation
from tests.continuation.starts import delayed_logistic, flat, henon

ROUNDING = 1e-12


def first(orbit: PeriodicOrbit, name: str, bounds: tuple[float, float], kind: str) -> Bifurcation:
    branch = continue_orbit(orbit, name, bounds=bounds, points=400)
    return next(b for b in branch.bifurcations if b.kind == kind)


@pytest.mark.parametrize(("kind", "factor"), [("SN", -0.25), ("PD", 0.75)])
def test_curves_of_henon(kind: str, factor: float) -> None:
    # M. Henon, Commun. Math. Phys. 50 (1976) 69-77: the fixed points' discriminant and trace
    start = first(henon(), "a", (-0.2, 1.4), kind)
    curve = continue_curve(start, ("a", "b"), bounds=((-2.0, 3.0), (-0.9, 0.9)))
    a, b = curve.parameters.T
    assert abs(a - factor * (1.0 - b) ** 2).max() < ROUNDING
    assert sorted(b[[0, -1]]) == [-0.9, 0.9]
    assert curve.kind == kind


def test_a_torus_curve() -> None:
    start = first(delayed_logistic(), "rate", (1.5, 2.5), "NS")
    curve = continue_curve(start, ("rate", "s"), bounds=((0.5, 4.0), (0.5, 4.0)))
    assert abs(curve.parameters.prod(axis=1) - 2.0).max() < ROUNDING
    assert abs(curve.own - np.pi / 3.0).max() < ROUNDING


def test_a_torus_curve_ends_at_strong_resonances() -> None:
    orbit = Cycle(Rotation(0.9, 0.5), np.zeros(2))
    start = first(orbit, "d", (0.5, 1.5), "NS")
    curve = continue_curve(start, ("d", "t"), bounds=((0.5, 1.5), (-3.0, 3.0)))
    d, t = curve.parameters.T
    assert abs(d - 1.0).max() < ROUNDING
    assert abs(t - 2.0 * np.cos(curve.own[:, 0])).max() < ROUNDING
    assert [ending.reason.name for ending in curve.endings] == ["RESONANCE"] * 2
    assert np.ptp(curve.own) > 3.13


def test_what_does_not_change_along_a_curve_is_not_measured_in_its_rounding() -> None:
    # of Henon's map areas are kept just where b = -1
    start = first(henon(0.5, -0.95), "b", (-1.05, -0.9), "NS")
    curve = continue_curve(start, ("b", "a"), bounds=((-1.5, -0.5), (0.2, 0.9)))
    assert np.ptp(curve.parameters[:, 0]) < ROUNDING
    assert (curve.error < ROUNDING).all()


def test_a_branch_point_curve() -> None:
    # where there is a symmetry, or a solution that is always there, branch points have curves
    start = first(flat("pitchfork", 0.0, 0.3), "p", (-1.0, 1.0), "BP")
    curve = continue_curve(start, ("p", "q"), bounds=((-1.0, 1.0), (-0.5, 0.5)))
    p, q = curve.parameters.T
    assert abs(p - q).max() < ROUNDING
    assert abs(curve.own).max() < ROUNDING


def test_a_branch_point_curve_ends_where_the_branches_come_apart() -> None:
    # x^3 - q x = p: branches cross at q = 0 for p = 0 alone
    start = first(flat("cusp", 0.0, 0.0, -0.5), "q", (-1.0, 1.0), "BP")
    curve = continue_curve(start, ("q", "p"), bounds=((-1.0, 1.0), (-1.0, 1.0)))
    assert abs(curve.parameters).max() < 1e-8
    assert len(curve) == 1
    assert [ending.reason.name for ending in curve.endings] == ["SEPARATED"] * 2


def test_folds_meet_in_a_cusp() -> None:
    start = first(flat("cusp", 0.0, 0.0, 1.0), "p", (-1.5, 1.5), "SN")
    curve = continue_curve(start, ("p", "q"), bounds=((-2.0, 2.0), (-1.0, 2.0)))
    p, q = curve.parameters.T
    assert abs(p**2 - 4.0 * q**3 / 27.0).max() < ROUNDING
    assert list(q[[0, -1]]) == [2.0, 2.0]
    assert p[0] * p[-1] < 0.0


def test_a_grazing_curve() -> None:
    start = flat("cusp", 1.2, 1.2**3 - 1.2, 1.0, border=1.05)
    grazing = first(start, "p", (0.1, 1.5), "GR")
    curve = continue_curve(grazing, ("p", "q"), bounds=((-1.0, 1.0), (0.0, 2.0)))
    p, q = curve.parameters.T
    assert abs(p - (1.05**3 - 1.05 * q)).max() < ROUNDING
    assert abs(curve.own - 2.1).max() < ROUNDING


def test_orbits_of_a_curve_are_the_critical_ones() -> None:
    start = first(henon(), "a", (-0.2, 1.4), "PD")
    curve = continue_curve(start, ("a", "b"), bounds=((-2.0, 3.0), (-0.9, 0.9)))
    for place in (0, len(curve) // 2, -1):
        orbit = curve.orbit(place)
        assert tuple(orbit.system.parameters.values()) == tuple(curve.parameters[place])
        assert abs(orbit.multipliers + 1.0).min() < 1e-10


def test_curves_say_what_they_are() -> None:
    start = first(henon(), "a", (-0.2, 1.4), "PD")
    curve = continue_curve(start, ("a", "b"), bounds=((-2.0, 3.0), (-0.9, 0.9)), points=3)
    assert repr(curve).startswith("<BifurcationCurve of PD: 5 points, a from ")
    assert [ending.reason.name for ending in curve.endings] == ["LIMIT", "LIMIT"]


@pytest.mark.parametrize(
    ("names", "bounds", "message"),
    [
        (("a", "a"), ((0, 1), (0, 1)), r"parameters must be two names; got \('a', 'a'\)"),
        (("a",), ((0, 1), (0, 1)), r"parameters must be two names; got \('a',\)"),
        (("a", "c"), ((0, 1), (0, 1)), "parameter must be one of: a, b; got 'c'"),
        (("a", "b"), ((0, 1),), r"bounds must be two pairs of numbers; got \(\(0, 1\),\)"),
        (("a", "b"), ((0, 1), (1, 0)), r"bounds\[1\] must be \(low, high\) with low < high; .*"),
        (("a", "b"), ((0, 1), (0.5, 1)), r"b must lie in \[0.5, 1.0\]; got 0.3"),
    ],
)
def test_bad_curves_are_refused(names: Any, bounds: Any, message: str) -> None:
    start = first(henon(), "a", (-0.2, 1.4), "PD")
    with pytest.raises(ValueError, match=f"^{message}$"):
        continue_curve(start, names, bounds=bounds)


def test_a_curve_ends_on_the_edge_of_what_the_system_allows() -> None:
    # of `Edge` no value of e above one is allowed; its NS is at d = e
    start = first(Cycle(Edge(0.5, 0.9), np.zeros(2)), "d", (0.3, 1.5), "NS")
    curve = continue_curve(start, ("d", "e"), bounds=((0.3, 1.5), (0.5, 1.0)))
    assert sorted(curve.parameters[[0, -1], 1]) == [0.5, 1.0]
    assert abs(curve.parameters[:, 0] - curve.parameters[:, 1]).max() < ROUNDING
    assert [ending.reason.name for ending in curve.endings] == ["BOUND", "BOUND"]
