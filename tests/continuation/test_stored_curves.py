"""Curves of bifurcations in stores: the same bits, whole or not at all, for their own system."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.curves import BifurcationCurve, continue_curve
from dynkit.systems import Henon
from tests.continuation.families import Cycle
from tests.continuation.starts import delayed_logistic, flat, henon, logistic

BOUNDS = ((-2.0, 3.0), (-0.9, 0.9))


@pytest.fixture(scope="module")
def curve() -> BifurcationCurve:
    branch = continue_orbit(henon(), "a", bounds=(-0.2, 1.4), points=60)
    doubling = next(found for found in branch.bifurcations if found.kind == "PD")
    return continue_curve(doubling, ("a", "b"), bounds=BOUNDS, points=40)


@pytest.fixture
def stored(curve: BifurcationCurve, tmp_path: Path) -> Path:
    path = tmp_path / "curve.h5"
    curve.save(path)
    return path


def assert_same(a: BifurcationCurve, b: BifurcationCurve) -> None:
    for name in ("parameters", "unknowns", "own", "admissible", "residuals", "error"):
        first, second = getattr(a, name), getattr(b, name)
        assert first.dtype == second.dtype
        assert first.shape == second.shape
        assert first.tobytes() == second.tobytes()
    assert (a.kind, a.label, a.names) == (b.kind, b.label, b.names)
    assert (a.endings, a.cost, a.closed, repr(a)) == (b.endings, b.cost, b.closed, repr(b))


def test_a_loaded_curve_has_the_same_bits(curve: BifurcationCurve, stored: Path) -> None:
    assert_same(curve, BifurcationCurve.load(stored, henon(0.5)))


@pytest.mark.parametrize("kind", ["NS", "GR", "SN"])
def test_curves_of_every_kind_are_stored(kind: str, tmp_path: Path) -> None:
    start, name, names, bounds = {
        "NS": (delayed_logistic(), "rate", ("rate", "s"), ((0.5, 4.0), (0.5, 4.0))),
        "GR": (
            flat("cusp", 1.2, 1.2**3 - 1.2, 1.0, border=1.05),
            "p",
            ("p", "q"),
            ((-1.0, 1.0), (0.0, 2.0)),
        ),
        "SN": (flat("cusp", 0.0, 0.0, 1.0), "p", ("p", "q"), ((-2.0, 2.0), (-1.0, 2.0))),
    }[kind]
    low, high = {"NS": (1.5, 2.5), "GR": (0.1, 1.5), "SN": (-1.5, 1.5)}[kind]
    branch = continue_orbit(start, name, bounds=(low, high), points=400)
    found = next(each for each in branch.bifurcations if each.kind == kind)
    curve = continue_curve(found, names, bounds=bounds, points=30)
    curve.save(tmp_path / "curve.h5")
    loaded = BifurcationCurve.load(tmp_path / "curve.h5", start)
    assert_same(curve, loaded)
    for place in (0, -1):
        a, b = curve.orbit(place), loaded.orbit(place)
        assert a.states.tobytes() == b.states.tobytes()
        assert a.system == b.system


def test_a_curve_without_its_orbit_has_its_numbers(curve: BifurcationCurve, stored: Path) -> None:
    loaded = BifurcationCurve.load(stored)
    assert_same(curve, loaded)
    with pytest.raises(
        ValueError, match=r"^orbit must be given to BifurcationCurve.load to get orbits back; got "
    ):
        loaded.orbit(0)


def test_a_curve_without_its_orbit_is_not_stored_again(stored: Path) -> None:
    before = stored.read_bytes()
    with pytest.raises(ValueError, match=r"^orbit must be given to BifurcationCurve.load"):
        BifurcationCurve.load(stored).save(stored)
    assert stored.read_bytes() == before


def test_both_parameters_may_differ(stored: Path) -> None:
    assert BifurcationCurve.load(stored, henon(0.4, 0.1)).orbit(0).system == (
        BifurcationCurve.load(stored, henon(0.9, 0.2)).orbit(0).system
    )


def test_another_kind_of_orbit_is_refused(stored: Path) -> None:
    orbit = Cycle(Henon(0.9, 0.3), np.tile(henon(0.9).unknowns, 2))
    with pytest.raises(ValueError, match=r"was made with orbits P\(1\); got P\(2\)$"):
        BifurcationCurve.load(stored, orbit)


def test_a_system_without_the_parameter_is_refused(stored: Path) -> None:
    with pytest.raises(ValueError, match=r"was made with parameter a; got a system without it$"):
        BifurcationCurve.load(stored, logistic())
