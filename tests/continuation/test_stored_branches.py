"""Branches in stores: the same bits, whole or not at all, and only for their own system."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynkit import PoincareMap, Stroboscope, periodic_orbit
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.results.branch import Branch
from dynkit.systems import Duffing, Henon
from tests.continuation.families import Cycle
from tests.continuation.starts import flat, henon, iterated, logistic


@pytest.fixture(scope="module")
def branch() -> Branch:
    return continue_orbit(henon(), "a", bounds=(-0.2, 1.4), points=60)


@pytest.fixture
def stored(branch: Branch, tmp_path: Path) -> Path:
    path = tmp_path / "branch.h5"
    branch.save(path)
    return path


def test_a_loaded_branch_has_the_same_bits(branch: Branch, stored: Path) -> None:
    loaded = Branch.load(stored, henon(0.5))
    for name in ("parameter", "unknowns", "multipliers", "stable", "admissible", "error"):
        a, b = getattr(branch, name), getattr(loaded, name)
        assert a.dtype == b.dtype
        assert a.tobytes() == b.tobytes()
    assert (loaded.endings, loaded.label, loaded.name) == (branch.endings, "P(1)", "a")
    assert (loaded.cost, loaded.closed, repr(loaded)) == (branch.cost, branch.closed, repr(branch))


def test_loaded_bifurcations_have_the_same_bits(branch: Branch, stored: Path) -> None:
    loaded = Branch.load(stored, henon(0.5))
    for a, b in zip(branch.bifurcations, loaded.bifurcations, strict=True):
        for name in (
            *("kind", "value", "error", "multiplier", "place", "history", "cost", "event"),
            "admissible",
        ):
            assert getattr(a, name) == getattr(b, name)
        for name in ("unknowns", "direction", "tangent", "own", "unknowns_error", "own_error"):
            assert getattr(a, name).tobytes() == getattr(b, name).tobytes()


def test_a_loaded_branch_goes_on_as_the_first_did(branch: Branch, stored: Path) -> None:
    loaded = Branch.load(stored, henon(0.5))
    for a, b in zip(branch.bifurcations, loaded.bifurcations, strict=True):
        first, again = (continue_orbit(c.orbit, "a", bounds=(-0.2, 1.4), points=9) for c in (a, b))
        assert first.unknowns.tobytes() == again.unknowns.tobytes()
        switched = [[orbit.unknowns.tobytes() for orbit in c.switch()] for c in (a, b)]
        assert switched[0] == switched[1]


def test_grazing_is_stored_with_its_place(tmp_path: Path) -> None:
    start = flat("cusp", 1.2, 1.2**3 - 1.2, 1.0, border=1.05)
    made = continue_orbit(start, "p", bounds=(0.1, 1.5))
    made.save(tmp_path / "branch.h5")
    loaded = Branch.load(tmp_path / "branch.h5", start)
    assert [b.touching for b in loaded.bifurcations] == [b.touching for b in made.bifurcations]
    assert (loaded.admissible == made.admissible).all()


def test_a_branch_without_its_orbit_has_its_numbers(branch: Branch, stored: Path) -> None:
    loaded = Branch.load(stored)
    assert (loaded.unknowns == branch.unknowns).all()
    assert loaded.bifurcations[0].value == branch.bifurcations[0].value
    message = "^orbit must be given to Branch.load to get orbits back; got None$"
    with pytest.raises(ValueError, match=message):
        loaded.orbit(0)
    with pytest.raises(ValueError, match=message):
        _ = loaded.bifurcations[0].orbit


def test_another_system_is_refused(stored: Path) -> None:
    with pytest.raises(ValueError, match=r"was made with b 0.3; got 0.2$"):
        Branch.load(stored, henon(b=0.2))


def test_another_kind_of_orbit_is_refused(stored: Path) -> None:
    orbit = Cycle(Henon(0.9, 0.3), np.tile(henon(0.9).unknowns, 2))
    with pytest.raises(ValueError, match=r"was made with orbits P\(1\); got P\(2\)$"):
        Branch.load(stored, orbit)


def test_a_system_without_the_parameter_is_refused(stored: Path) -> None:
    with pytest.raises(ValueError, match=r"was made with parameter a; got a system without it$"):
        Branch.load(stored, logistic())


def test_a_stored_branch_of_a_cycle_is_loaded_with_any_orbit_of_its_kind(tmp_path: Path) -> None:
    start = iterated(Henon(0.5, 0.3), [0.1, 0.1], 2)
    made = continue_orbit(start, "a", bounds=(0.45, 0.6))
    made.save(tmp_path / "branch.h5")
    loaded = Branch.load(tmp_path / "branch.h5", made.orbit(-1))
    assert loaded.label == "P(2)"
    assert (loaded.orbit(0).unknowns == made.orbit(0).unknowns).all()


def test_a_branch_of_a_flow_is_stored_and_another_flow_is_refused(tmp_path: Path) -> None:
    returns = PoincareMap(Duffing(), Stroboscope(3), 10.0)
    orbit = periodic_orbit(returns, [0.1, 0.1])
    branch = continue_orbit(orbit, "force", bounds=(0.45, 0.55), points=5)
    branch.save(tmp_path / "x.h5")
    loaded = Branch.load(tmp_path / "x.h5", orbit)
    assert loaded.orbit(2).states.tobytes() == branch.orbit(2).states.tobytes()
    other = periodic_orbit(returns.replace(damping=0.31), [0.1, 0.1])
    with pytest.raises(ValueError, match=r"made with flow Duffing\(damping=0.3, .*; got Duffing"):
        Branch.load(tmp_path / "x.h5", other)
