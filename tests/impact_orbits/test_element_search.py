"""Searches for orbits of machines with elements, and grazing of soft stops both ways."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from dynkit import continue_orbit, explore
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    ImpactDuffing,
    Jenkins,
    MatrixOscillator,
    SingleImpactOscillator,
    SoftStop,
    ViscoelasticSpheres,
)
from dynkit.systems.impact.orbits import searching
from dynkit.systems.impact.orbits.itineraries import motions


def soft(frequency: float, damping: float = 0.2) -> MatrixOscillator:
    """x'' + 0.05 x' + x = 0.3 sin(phase), before a soft stop at -0.3."""
    stop = SoftStop(0, offset=-0.3, stiffness=50.0, damping=damping)
    return MatrixOscillator(
        M=[[1.0]],
        C=[[0.05]],
        K=[[1.0]],
        frequency=frequency,
        harmonic_forces=[0.3],
        elements=[stop],
    )


def response(frequency: float) -> complex:
    """That which the stop does not touch, x = Im(response exp(i phase))."""
    return complex(0.3 / (1.0 - frequency**2 + 0.05j * frequency))


def swing(frequency: float) -> float:
    return abs(response(frequency))


@cache
def grazing() -> float:
    return float(brentq(lambda w: swing(w) - 0.3, 1.3, 1.6, xtol=1e-15))


@pytest.mark.parametrize("length", [1.0, 1e-6, 1e-9, 1e5])
def test_a_search_in_any_unit_of_length_finds_each_orbit_once(length: float) -> None:
    # a stop at zero has orbits of any size
    chain = ImpactChain(
        masses=1,
        springs=1.0,
        damping=0.05,
        frequency=2.2,
        harmonic_forces=[length],
        elements=[SoftStop(-1, stiffness=30.0, damping=0.4)],
    )
    found = chain.find_orbits(impacts=3, periods=3)
    (orbit,) = (orbit for orbit in found if orbit.label == "P(1,1)")
    assert orbit.admissible
    assert not any(other.admissible for other in found if other is not orbit)
    assert len({other.label for other in found}) == len(found)
    assert abs(orbit.multipliers[0]) == pytest.approx(0.846199304, abs=1e-9)


@pytest.mark.parametrize(
    ("length", "duration"), [(1.0, 1.0), (1e-9, 1.0), (1e-9, 1e-6), (1e4, 1.0)]
)
def test_orbits_in_two_wells_differ_in_any_unit(length: float, duration: float) -> None:
    duffing = ImpactDuffing(
        linear=-(duration**-2),
        cubic=(duration * length) ** -2,
        damping=0.2 / duration,
        force=0.05 * length / duration**2,
        frequency=1.2 / duration,
        elements=[HardStop(0, offset=-1.2 * length, restitution=0.7)],
    )
    orbits = duffing.find_orbits(impacts=1, periods=1)
    assert [orbit.label for orbit in orbits] == ["P(0,1)"] * 2
    places = sorted(float(orbit.states[0, 0] / length) for orbit in orbits)
    np.testing.assert_allclose(places, [-1.0267572, 0.95828687], atol=1e-6)


def test_a_table_that_lags_has_the_orbits_of_a_table() -> None:
    # Those of a table alone are found in another way, with one impact from their closed form. Which
    # of those that are no motions are found depends on last digits of chaotic motions.
    table = ImpactChain(masses=1, frequency=2.8, restitution=0.8)
    stop = HardStop(0, amplitude=0.1, restitution=0.8, phase=0.7)
    late = ImpactChain(masses=1, frequency=2.8, elements=[stop])
    known = table.find_orbits(impacts=3, periods=3)
    found = late.find_orbits(impacts=3, periods=3)
    for orbit in (orbit for orbit in found if orbit.admissible):
        shifted = orbit.states - [*np.zeros(orbit.states.shape[1] - 1), 0.7]
        same = [other for other in known if other.label == orbit.label]
        apart = [
            min(
                abs(table.difference(np.roll(shifted, k, axis=0), other.states)).max()
                for k in range(len(shifted))
            )
            - (orbit.error + other.error)
            for other in same
        ]
        assert min(apart) <= 0.0
    admissible = [orbit.label for orbit in found if orbit.admissible]
    assert admissible == [orbit.label for orbit in known if orbit.admissible]
    assert admissible == ["P(1,1)", "P(2,2)", "P(3,3)", "P(3,3)"]


def test_orbits_between_two_stops_come_with_their_mirror_images() -> None:
    stops = [
        HardStop(0, offset=-0.8, restitution=0.7, name="left"),
        HardStop(0, offset=0.8, side="below", restitution=0.7, name="right"),
    ]
    box = MatrixOscillator(
        M=[[1.0]], C=[[0.1]], K=[[1.0]], frequency=0.7, harmonic_forces=[1.0], elements=stops
    )
    found = box.find_orbits(impacts=3, periods=2)
    assert found[0].label == "P(1,1)"
    assert {"P(2,1)", "P(3,2)"} <= {orbit.label for orbit in found}
    for orbit in found:
        # the mirror image happens half a turn later, at the other stop
        left, right = (orbit.counts[f"{name}.impacts"] for name in ("left", "right"))
        image = [o for o in found if (o.counts["left.impacts"], o.label) == (right, orbit.label)]
        speeds = np.sort(abs(orbit.relative_velocity))
        gaps = [abs(np.sort(abs(o.relative_velocity)) - speeds).max() for o in image]
        assert min(gaps) <= 2.0 * orbit.error
        assert left + right == orbit.impacts
    (there,) = [orbit for orbit in found if orbit.admissible]
    known, turn = box.attractor().periodic_orbit().states, 2.0 * np.pi
    phases = [np.sort(states[:, -1] % turn) for states in (known, there.states)]
    assert abs(phases[0] - phases[1]).max() < 1e-11
    assert [orbit.label for orbit in box.periodic_orbits(impacts=2)] == ["P(2,1)"]


def test_orbits_beside_an_impact_law_are_found() -> None:
    chain = ImpactChain(frequency=0.87, restitution=ViscoelasticSpheres(0.2))
    stable = [orbit for orbit in chain.find_orbits(impacts=2, periods=3) if orbit.stable]
    known = chain.attractor().periodic_orbit()
    assert [orbit.label for orbit in stable] == [known.label] == ["P(1,3)"]
    assert abs(chain.difference(stable[0].states, known.states)).max() <= stable[0].error


def test_without_a_hard_stop_orbits_that_press_and_that_do_not_are_found() -> None:
    found = soft(2.3).find_orbits(impacts=2, periods=2)
    quiet, *pressing = (orbit for orbit in found if orbit.admissible)
    assert [orbit.label for orbit in (quiet, *pressing)] == ["P(1,1)", "P(2,2)", "P(2,2)"]
    assert [orbit.counts["elements[0].presses"] for orbit in (quiet, *pressing)] == [0, 1, 1]
    assert sorted(orbit.stable for orbit in pressing) == [False, True]
    x, v = quiet.states[0]
    assert abs(np.hypot(x, v / 2.3) - swing(2.3)) <= quiet.error
    again = soft(2.3).periodic_orbit(periods=2, start=soft(2.3).state([x], [v]))
    assert again.label == "P(1,1)"  # not the same one run through twice


def test_a_motion_that_impacts_no_more_is_left_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    few = motions.FEW._replace(impacts=5)
    monkeypatch.setattr(searching, "FEW", few)
    elements = [HardStop((0, 1), offset=-9.0), DryFriction(0, force=0.03)]
    machine = ImpactChain(masses=2, frequency=1.1, harmonic_forces=[0.0, 0.4], elements=elements)
    records = list(motions.simulated_motions(machine, few))
    assert len(records) == few.parts + few.starts
    most = 5 * motions.SWITCHES  # each with an event or two
    # random starts are as far apart as the stop, and some hit it at first
    assert all(len(record) < 5 for record in records)
    assert all(len(record) == 0 for record in records[: few.parts])
    assert all(most < len(record.events.time) <= 2 * most for record in records)
    (quiet,) = machine.find_orbits(impacts=1, periods=1)
    assert quiet.label == "P(0,1)"
    assert quiet.admissible
    x, v = np.split(quiet.states[0], 2)
    record = machine.simulate(impacts=1, start=machine.state(x, v))
    place, velocity = record.sample([quiet.period])
    again = np.append(place, velocity)
    assert abs(again - quiet.states[0]).max() < 1e-12


@pytest.mark.parametrize(("frequency", "bounds"), [(4.0, (1.0, 4.0)), (0.3, (0.3, 1.0))])
def test_a_single_mass_grazes_where_its_response_reaches_the_stop(
    frequency: float, bounds: tuple[float, float]
) -> None:
    # the amplitude is |1 - w^2 + 2 i z w|^-1: (1 - w^2)^2 + (2 z w)^2 = 1/4 where it is 2
    mass = SingleImpactOscillator(frequency=frequency, stop=2.0, damping_ratio=0.05)
    branch = continue_orbit(mass.attractor().periodic_orbit(), "frequency", bounds=bounds)
    (border,) = branch.bifurcations
    half = 1.0 - 2.0 * 0.05**2
    root = math.sqrt(half**2 - 0.75)
    expected = math.sqrt(half + root if frequency > 1.0 else half - root)
    assert border.kind == "GR"
    assert abs(border.value - expected) <= border.error + 2.0**-52
    assert (branch.admissible == ((branch.parameter - expected) * (frequency - 1.0) >= 0.0)).all()


def test_a_mass_that_stays_on_a_table_while_a_slider_slips_has_an_orbit() -> None:
    machine = ImpactChain(
        masses=2,
        damping=0.05,
        frequency=0.8,
        harmonic_forces=[0.8, 0.1],
        constant_forces=[0.0, -3.0],
        elements=[
            HardStop(1, offset=-0.2, restitution=0.5),
            Jenkins(0, stiffness=1.0, force=0.2, name="joint"),
        ],
    )
    orbit: Any = machine.attractor(transient=0, impacts=40).periodic_orbit()
    # the table is the wall of one mass on the joint, shaken by the first force
    one = MatrixOscillator(
        M=[[1.0]],
        C=[[machine.damping_matrix[0, 0]]],
        K=[[machine.stiffness[0, 0]]],
        frequency=0.8,
        harmonic_forces=[0.8],
        constant_forces=[machine.stiffness[0, 1] * 0.2],
        elements=[Jenkins(0, stiffness=1.0, force=0.2, name="joint")],
    )
    other: Any = one.attractor(transient=300, impacts=1).periodic_orbit()
    times = np.linspace(0.0, orbit.period, 9)
    (x, v), (y, w) = orbit.sample(times), other.sample(times)
    assert orbit.counts["joint.sticks"] == 2
    # without friction the slider may be anywhere to begin with: the loop is centred
    assert abs(np.ptp(x[:, 0]) - np.ptp(y[:, 0])) <= orbit.error + other.error
    assert abs(v[:, 0] - w[:, 0]).max() <= orbit.error + other.error


@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_a_branch_goes_through_grazing_of_a_soft_stop_both_ways(damping: float) -> None:
    # a dashpot lets go before the gap opens: three events merge there, of a spring alone two
    low, high, at = 1.41, 1.6, soft(1.5, damping)
    start = at.state([response(1.5).imag], [1.5 * response(1.5).real])
    quiet = continue_orbit(at.periodic_orbit(start=start), "frequency", bounds=(low, high))
    (touch,) = quiet.bifurcations
    assert touch.kind == "GR"
    assert abs(touch.value - grazing()) <= touch.error < 1e-12
    (pressing,) = touch.switch()
    assert pressing.counts["elements[0].presses"] == 1
    branch = continue_orbit(pressing, "frequency", bounds=(low, high), largest_step=0.2)
    assert "SN" in [found.kind for found in branch.bifurcations]
    (touched,) = [found for found in branch.bifurcations if found.kind == "GR"]
    assert abs(touched.value - grazing()) <= touched.error
    # multipliers have a limit: the force -c v begins with the velocity v at the gap, which is zero
    ends = branch.multipliers[[0, -1]]
    nearest = ends[np.argmin(abs(branch.parameter[[0, -1]] - grazing()))]
    assert abs(np.sort_complex(nearest) - np.sort_complex(pressing.multipliers)).max() < 1e-3
    free = expm(np.array([[0.0, 1.0], [-1.0, -0.05]]) * (2.0 * np.pi / grazing()))
    limit = np.linalg.eigvals(free @ np.array([[1.0, 0.0], [-damping, 1.0]]))
    assert abs(np.sort_complex(limit) - np.sort_complex(pressing.multipliers)).max() < 1e-9
    (back,) = touched.switch()
    assert back.counts["elements[0].presses"] == 0
    assert abs(np.hypot(*(back.states[0] / [1.0, grazing()])) - 0.3) < 1e-12


def test_an_exploration_of_a_soft_stop_links_its_branches() -> None:
    network = explore(soft(2.0), "frequency", (1.3, 1.8), values=1, iterates=1, periods=1)
    assert len(network.branches) == 2
    links = [network.branches[link.branch].bifurcations[link.bifurcation] for link in network.links]
    assert "GR" in [found.kind for found in links]


def test_a_search_near_orbits_with_an_impact_and_without_one_finds_both() -> None:
    stop = HardStop(0, offset=-0.421, side="below", restitution=0.831)
    machine = MatrixOscillator(
        M=[[1.0]],
        C=[[0.0235913]],
        K=[[1.0]],
        harmonic_forces=[0.39838838],
        frequency=3.76074688,
        elements=[stop, SoftStop(0, offset=-100.0, stiffness=1.0)],
    )
    search = machine.find_orbits(impacts=1, periods=2)
    alone = machine.replace(elements=[stop]).find_orbits(impacts=1, periods=2)
    found = [orbit.states[0, 0] for orbit in search if orbit.admissible]
    for orbit in alone:
        if orbit.admissible:
            assert abs(orbit.states[0, 0] - np.array(found)).min() < 1e-12


def returns_to_itself(orbit: Any) -> bool:
    """Whether simulation from its first state comes back to it after its impacts."""
    system = orbit.system
    record = system.simulate(impacts=orbit.impacts, start=system.impact_state(orbit.states[0]))
    back = abs(record.time[-1] - orbit.period) < 1e-6
    return bool(back and abs(system.difference(record.states[-1], orbit.states[0])).max() < 1e-6)


def test_an_impact_that_rebounds_is_not_followed_by_contact_at_once() -> None:
    """A motion from amid a chatter is in contact before it is seen to hit anything."""
    stop = HardStop(0, offset=-0.076, restitution=0.45)
    pad = SoftStop(0, side="below", offset=0.254, stiffness=25.05)
    machine = ImpactChain(
        masses=1, damping=0.126, frequency=1.2939, harmonic_forces=[0.597], elements=[stop, pad]
    )
    found = [orbit for orbit in machine.find_orbits(impacts=3, periods=1) if orbit.admissible]
    assert "P(3,1)" in [orbit.label for orbit in found]
    assert all(returns_to_itself(orbit) for orbit in found if orbit.impacts)


@pytest.mark.parametrize("number", [17, 19, 20, 30, 36, 37])
def test_all_orbits_of_one_impact_are_found_where_no_other_element_acts(number: int) -> None:
    """Unstable partners beyond a fold among them, which motions do not come near to."""
    random = np.random.default_rng(9000 + number)
    side = str(random.choice(["above", "below"]))
    offset, restitution = random.uniform(-0.2, 0.6), random.uniform(0.3, 0.95)
    place = -offset if side == "above" else offset
    stop = HardStop(0, side=side, offset=place, restitution=restitution)
    far = SoftStop(0, offset=-100.0, stiffness=1.0)
    random.integers(2)
    damping, force = random.uniform(0.01, 0.2), random.uniform(0.1, 0.8)
    alone = MatrixOscillator(
        M=[[1.0]],
        C=[[damping]],
        K=[[1.0]],
        harmonic_forces=[force],
        frequency=random.uniform(0.4, 4.0),
        elements=[stop],
    )
    exact = [orbit for m in (1, 2, 3) for orbit in alone.periodic_orbits(periods=m)]
    exact = [orbit for orbit in exact if orbit.admissible]
    assert not all(orbit.stable for orbit in exact)
    found = alone.replace(elements=[stop, far]).find_orbits(impacts=1, periods=3)
    for orbit in exact:
        same = [other for other in found if other.label == orbit.label]
        gaps = [abs(alone.difference(other.states, orbit.states)).max() for other in same]
        assert min(gaps) <= 1e-11
