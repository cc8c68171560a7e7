"""Bifurcations of orbits that are no motions of the system say so wherever they are shown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from dynkit import Branch, continue_orbit
from dynkit.continuation.bifurcations.bifurcation import borders_a_motion
from dynkit.continuation.network import Finish, Network
from dynkit.core.cost import Cost
from dynkit.systems import ImpactChain


@pytest.fixture(scope="module")
def chain() -> Branch:
    """P(1,3), on both sides of where it grazes the table between impacts."""
    orbit = ImpactChain(frequency=0.87).periodic_orbit(periods=3)
    return continue_orbit(orbit, "frequency", bounds=(0.75, 1.05))


@pytest.mark.parametrize("off", [0.0, 1e-9, -1e-9])
def test_a_border_at_a_point_has_the_neighbours_of_that_point(off: float) -> None:
    # rounding decides whether the orbit on the border is a motion
    for motions in ([True, False, False], [False, False, True]):
        assert borders_a_motion(np.array(motions), 1.0 + off)
    assert not borders_a_motion(np.array([True, False, False, False, True]), 2.0 + off)


def test_a_bifurcation_is_admissible_just_where_its_orbit_is_a_motion(chain: Branch) -> None:
    assert [(b.kind, b.admissible) for b in chain.bifurcations] == [
        ("PD", False),
        ("GR", True),
        ("GR", True),
        ("PD", False),
    ]
    for found in chain.bifurcations:
        around = [int(np.floor(found.place)), int(np.floor(found.place)) + 1]
        beside = chain.admissible[np.clip(around, 0, len(chain) - 1)]
        if found.event >= 0:
            assert found.admissible == beside.any()
        else:
            assert found.admissible == found.orbit.admissible
            assert found.admissible in beside


def test_text_names_what_is_inadmissible(chain: Branch) -> None:
    for found in chain.bifurcations:
        assert ("inadmissible" in repr(found)) is not found.admissible
    (virtual, *_) = (b for b in chain.bifurcations if not b.admissible)
    assert f"{virtual.kind} {virtual.value:.6g} (inadmissible)" in repr(chain)
    assert ">no<" in virtual._repr_html_()
    assert chain._repr_html_().count(">no<") == sum(not b.admissible for b in chain.bifurcations)


def test_the_dataset_says_what_is_admissible(chain: Branch) -> None:
    told = chain.to_xarray()["bifurcation_admissible"].values
    assert told.tolist() == [b.admissible for b in chain.bifurcations]


def test_a_store_keeps_what_is_admissible(chain: Branch, tmp_path: Path) -> None:
    chain.save(tmp_path / "branch.h5")
    loaded = Branch.load(tmp_path / "branch.h5")
    assert [b.admissible for b in loaded.bifurcations] == [b.admissible for b in chain.bifurcations]


def test_networks_name_what_is_inadmissible_in_brackets(chain: Branch) -> None:
    network = Network((chain,), (), (), Finish.COMPLETE, "", Cost(0.0))
    axes = network.plot(Figure().add_subplot())
    marks = {
        str(line.get_label()): {float(x) for x in np.asarray(line.get_xdata())}
        for line in axes.get_lines()
        if line.get_linestyle() == "None"
    }
    listed = [b for b in chain.bifurcations if b.kind != "BP"]
    assert marks["(PD)"] == {b.value for b in listed if not b.admissible}
    assert marks["GR"] == {b.value for b in listed if b.admissible}
