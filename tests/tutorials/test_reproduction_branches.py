"""Figure 4 and its branches: what the sweep finds lies on them, and what lies on them is found."""

from pathlib import Path

import numpy as np
import pytest

from dynkit import Network, Sweep
from dynkit.systems import ImpactAttractor, ImpactOrbit
from tutorials.cusumano_bai_1993 import branches, paper
from tutorials.cusumano_bai_1993.branches import compare, figure_4_branches, network_of
from tutorials.cusumano_bai_1993.section import Section
from tutorials.cusumano_bai_1993.workshop import Workshop, frequencies

# Motions of one and of two impacts, and chaos, with all kinds of bifurcations in between.
WINDOW = (0.74, 0.98, 0.01)
# Errors that are claimed are smaller than what two motions here differ by.
SMALL = 1e-8


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    chain = Workshop(Path()).chain(WINDOW[0])
    return Workshop.swept(chain, frequencies(WINDOW))


@pytest.fixture(scope="module")
def network(sweep: Sweep) -> Network:
    chain = Workshop(Path()).chain(WINDOW[0])
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(branches, "PERIODS", 3)
        patched.setattr(branches, "_EVERY", 1)
        return network_of(chain, WINDOW[:2], sweep)


def settled(sweep: Sweep, place: int) -> ImpactAttractor:
    """The motion at one value after so long that it has settled to rounding."""
    attractor = sweep.attractor(place)
    assert isinstance(attractor, ImpactAttractor)
    later = attractor.system.attractor(transient=20_000, impacts=1, start=attractor.final)
    found = attractor.system.attractor(transient=0, impacts=20, start=later.final)
    assert isinstance(found, ImpactAttractor)
    return found


def motions(sweep: Sweep) -> list[int]:
    labels = [sweep.label(place) for place in range(len(sweep))]
    return [i for i, label in enumerate(labels) if label.iterates in (1, 2) and label.periods == 3]


def test_settled_motions_of_the_sweep_lie_on_stable_branches(
    sweep: Sweep, network: Network
) -> None:
    places = motions(sweep)
    assert {str(sweep.label(place)) for place in places} == {"P(1,3)", "P(2,3)"}
    for place in places:
        motion, label = settled(sweep, place), str(sweep.label(place))
        orbits = [
            orbit
            for orbit in network.orbits(float(sweep.values[place]), label)
            if isinstance(orbit, ImpactOrbit) and orbit.stable and orbit.admissible
        ]
        n = int(label[2])
        expected = np.sort(motion.record.relative_velocity[-n:])
        # both are wrong by no more than they say
        errors = [motion.error + orbit.error for orbit in orbits]
        distances = [abs(np.sort(orbit.relative_velocity) - expected).max() for orbit in orbits]
        near = [e for e, distance in zip(errors, distances, strict=True) if distance <= e]
        assert near, f"{label} at {sweep.values[place]}"
        assert min(near) < SMALL


def test_stable_parts_of_branches_are_where_simulation_stays(network: Network) -> None:
    count = 0
    for branch in network.branches:
        places = np.flatnonzero(branch.stable & branch.admissible)[2::6]
        for place in places.tolist():
            orbit = branch.orbit(place)
            assert isinstance(orbit, ImpactOrbit)
            start = orbit.system.impact_state(orbit.states[0])
            kept = orbit.system.attractor(transient=3000 * orbit.impacts, impacts=20, start=start)
            expected = np.sort(orbit.relative_velocity)
            found = np.sort(kept.record.relative_velocity[-orbit.impacts :])
            error = kept.error + orbit.error
            assert error < SMALL
            assert abs(found - expected).max() <= error, repr(orbit)
            count += 1
    assert count > 10


def test_unstable_orbits_are_left_by_simulation(network: Network) -> None:
    (branch, *_) = (b for b in network.branches if b.label == "P(2,3)")
    places = np.flatnonzero(~branch.stable & branch.admissible)
    orbit = branch.orbit(int(places[len(places) // 2]))
    assert isinstance(orbit, ImpactOrbit)
    start = orbit.system.impact_state(orbit.states[0])
    gone = orbit.system.attractor(transient=5000, impacts=20, start=start)
    distance = abs(np.sort(gone.record.relative_velocity[-2:]) - np.sort(orbit.relative_velocity))
    assert distance.max() > 1e-4


@pytest.fixture(scope="module")
def item(tmp_path_factory: pytest.TempPathFactory) -> tuple[Section, Path]:
    folder = tmp_path_factory.mktemp("results")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(paper, "FREQUENCIES", (0.78, 0.92, 0.004))
        patched.setattr(branches, "PERIODS", 3)
        return figure_4_branches(Workshop(folder)), folder


def test_item_writes_its_figure(item: tuple[Section, Path]) -> None:
    section, folder = item
    assert section.figures == ["figure-4-branches"]
    assert sorted(path.name for path in folder.iterdir()) == [
        "figure-4-branches.html",
        "figure-4-branches.png",
        "figure-4-branches.svg",
    ]


def test_item_finds_all_motions_on_the_branches(item: tuple[Section, Path]) -> None:
    found = {finding.what: finding.found for finding in item[0].findings}
    on, of = found["motions of figure 4 on stable branches"].split(" of ")
    assert on == of
    assert int(on) >= 5


def test_item_lists_the_bifurcations(item: tuple[Section, Path]) -> None:
    assert "| P(1,3) | GR | 0.8102005455 | - |" in item[0].text


def test_motion_without_a_branch_is_said_to_have_none(sweep: Sweep, network: Network) -> None:
    none = Network((), (), (), network.finish, network.message, network.cost)
    assert {entry.distance for entry in compare(none, sweep)} == {np.inf}
