"""Networks of a mass between two stops: mirrored branches, and where the symmetry breaks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynkit import Network, explore
from dynkit.continuation.network import Finish
from dynkit.continuation.results.branch import Branch
from dynkit.continuation.results.membership import Trail
from dynkit.systems import PlayOscillator
from dynkit.systems.impact.orbits.itineraries.equations import ItineraryEquations

SYSTEM = PlayOscillator(
    frequency=1.0, play=1.0, spring=1.0, amplitude=0.6, damping=0.1, restitution=0.7
)


@pytest.fixture(scope="module")
def network() -> Network:
    found = explore(SYSTEM, "frequency", (0.8, 1.6), iterates=2, periods=1, values=3)
    assert found.finish is Finish.COMPLETE
    return found


def stops_of(branch: Branch) -> list[int]:
    problem = branch.problem
    assert isinstance(problem, ItineraryEquations)
    return [int(side) for side in np.sort(problem.sides)]


def test_each_stop_has_branches_of_its_own(network: Network) -> None:
    near, far = network.find("P(1,1)")  # in an order that rounding decides
    assert sorted([stops_of(near), stops_of(far)]) == [[0], [1]]
    # mirror images of one another
    values = [[b.value for b in branch.bifurcations] for branch in (near, far)]
    assert np.allclose(values[0], values[1], rtol=0.0, atol=1e-10)


def test_no_branch_between_two_stops_is_found_twice(network: Network) -> None:
    for i, a in enumerate(network.branches):
        for j, b in enumerate(network.branches):
            if i != j and a.label == b.label:
                trail = Trail(b)
                middle = range(len(a) // 5, 4 * len(a) // 5, max(1, len(a) // 5))
                assert not any(trail.holds(a.orbit(place)) for place in middle)


def test_asymmetric_orbits_branch_off_the_symmetric_ones(network: Network) -> None:
    """The symmetric P(2,1) has its impacts half a period apart, with equal impulses."""
    symmetric, asymmetric = network.find("P(2,1)")
    impulses = symmetric.unknowns[:, 2:]
    assert abs(impulses[:, 0] - impulses[:, 1]).max() < 1e-9
    assert abs(np.diff(asymmetric.unknowns[:, 2:], axis=1)).max() > 0.01
    (point,) = (b for b in symmetric.bifurcations if b.kind == "BP")
    ends = [b.value for b in asymmetric.bifurcations if b.kind == "BP"]
    assert min(abs(np.array(ends) - point.value)) < 1e-10


def test_branches_of_both_stops_are_read_with_their_own_orbits(
    network: Network, tmp_path: Path
) -> None:
    network.save(tmp_path / "network.h5")
    orbits = [branch.orbit(0) for branch in network.branches]
    found = Network.load(tmp_path / "network.h5", orbits)
    for one, other in zip(found.branches, network.branches, strict=True):
        assert stops_of(one) == stops_of(other)
        assert np.array_equal(one.observable("phase"), other.observable("phase"))
