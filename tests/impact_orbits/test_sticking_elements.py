"""Orbits that stick beside other elements, against simulation alone."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from dynkit import NoConvergence, continue_orbit
from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, ImpactChain, Jenkins, SoftStop
from dynkit.systems.impact.orbits.itineraries.happening import Happening
from dynkit.systems.impact.orbits.itineraries.itinerary import Seen, counts_of, regimes_of
from dynkit.systems.impact.orbits.itineraries.simulated import simulated as followed
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.testing import check_problem
from tests.impact_orbits.sticking_cases import differences
from tests.reference.random_machines import random_machine

NONE = np.empty(0)


def table(coordinate: object, restitution: float) -> HardStop:
    return HardStop(coordinate, amplitude=0.1, restitution=restitution, name="table")


MACHINES = {
    "beside a soft stop": ImpactChain(
        masses=2,
        frequency=0.408,
        elements=[table(1, 0.3), SoftStop(0, offset=-0.05, stiffness=2.0)],
    ),
    "without rebound": ImpactChain(
        masses=2,
        frequency=0.408,
        elements=[table(1, 0.0), SoftStop(0, offset=-0.05, stiffness=2.0)],
    ),
    "a soft stop is left in contact": ImpactChain(
        masses=2,
        damping=0.05,
        frequency=0.48,
        harmonic_forces=[0.96, 0.72],
        elements=[
            HardStop(1, offset=0.05, restitution=0.43, name="table"),
            SoftStop(0, offset=0.024, stiffness=2.75, damping=0.2),
        ],
    ),
    "of two masses": ImpactChain(
        masses=2, frequency=0.5, damping=0.2, elements=[table((0, 1), 0.2)]
    ),
    "beside a stop": ImpactChain(
        masses=3,
        frequency=0.3,
        elements=[table(2, 0.3), HardStop((0, 1), offset=-0.05, restitution=0.5)],
    ),
    "beside friction": ImpactChain(
        masses=3,
        damping=0.05,
        frequency=0.3,
        elements=[table(2, 0.3), DryFriction(0, force=0.02)],
    ),
}
JOINED = ImpactChain(
    masses=2,
    damping=0.05,
    frequency=0.394,
    harmonic_forces=[0.64, 0.646],
    elements=[
        HardStop(1, restitution=0.59, name="table"),
        Jenkins(0, stiffness=0.6635, force=0.05, name="joint"),
    ],
)
SMOOTH = [name for name in MACHINES if "friction" not in name]
"""Those in which small changes at a release break no stick."""


@cache
def orbit_of(name: str) -> ImpactOrbit:
    found = MACHINES[name].attractor().periodic_orbit()
    assert isinstance(found, ImpactOrbit)
    return found


def released(system: ImpactChain, state: Array, period: float) -> tuple[Array, float]:
    """Section coordinates but the last two, and phase, at the release about a period later."""
    record = system.simulate(impacts=300, start=system.impact_state(state))
    ends = record.sticking[:, 1]
    time = float(ends[np.argmin(abs(ends - period))])
    x, v = record.sample([time])
    others = system._others[0]
    phase = state[-1] + system.frequency * time
    return np.concatenate([x[0, others], v[0, others]]), phase


@pytest.mark.parametrize("name", MACHINES)
def test_simulation_from_the_release_comes_back_to_it(name: str) -> None:
    orbit = orbit_of(name)
    assert orbit.sticks
    assert orbit.admissible
    assert orbit.label == "P(inf,1)"
    (state,) = orbit.states
    places, phase = released(MACHINES[name], state, orbit.period)
    assert abs(places - state[:-2]).max() < 1e-11 + 4.0 * orbit.error
    assert abs(phase - state[-1] - 2.0 * np.pi) < 1e-7  # a release is a root of second order


@pytest.mark.parametrize("name", SMOOTH)
def test_multipliers_are_those_of_differences_of_simulations(name: str) -> None:
    """Of the map from places in contact at one phase to those of a period later."""
    orbit, system = orbit_of(name), MACHINES[name]
    (state,) = orbit.states
    early, d = 0.05, len(state) - 2

    def held(places: Array) -> Array:
        """Places in contact a little before the release, after a period."""
        start = np.concatenate([places, [0.0, state[-1] - early]])
        record = system.simulate(impacts=300, start=system.impact_state(start))
        x, v = record.sample([orbit.period])
        others = system._others[0]
        return np.concatenate([x[0, others], v[0, others]])

    times = np.array([orbit.period - early / system.frequency])
    others = system._others[0]
    x, v = orbit.sample(times)
    begin = np.concatenate([x[0, others], v[0, others]])
    matrix = differences(held, begin, np.full(d, 1e-5))
    wanted = np.sort(abs(np.linalg.eigvals(matrix)))
    assert abs(np.sort(abs(orbit.multipliers[:-2])) - wanted).max() < 1e-7
    assert not orbit.multipliers[-2:].any()


@pytest.mark.parametrize("name", MACHINES)
def test_the_contract_of_problems_holds(name: str) -> None:
    orbit = orbit_of(name)
    check_problem(orbit.problem("frequency"), orbit.unknowns, np.array([orbit.system.frequency]))


def test_a_slider_slips_while_a_stop_chatters() -> None:
    attractor: Any = JOINED.attractor(transient=300, impacts=60)
    orbit = attractor.periodic_orbit()
    assert isinstance(orbit, ImpactOrbit)
    assert orbit.sticks
    assert orbit.admissible
    assert orbit.counts["joint.sticks"] == attractor.label.counts["joint.sticks"]
    solution: Any = orbit._solution
    assert any(event.chatters and event.mode.numbers[1] for event in solution.itinerary)
    record = attractor.record
    begin, end = record.sticking[-2, 1], record.sticking[-1, 1]
    times = np.linspace(0.0, end - begin, 50)
    for found, wanted in zip(orbit.sample(times), record.sample(begin + times), strict=True):
        assert abs(found - wanted).max() < 1e-9
    check_problem(orbit.problem("joint.force"), orbit.unknowns, np.array([0.05]))


def test_friction_sticks_and_slips_between_the_contacts() -> None:
    orbit = orbit_of("beside friction")
    label = MACHINES["beside friction"].attractor().label
    assert label.counts is not None
    assert dict(orbit.counts) == dict(label.counts)
    assert orbit.counts["elements[1].sticks"] == 3
    assert not orbit.multipliers[-2:].any()
    branch = continue_orbit(orbit, "elements[1].force", bounds=(0.0195, 0.0205))
    assert branch.admissible.all()
    assert len(branch.parameter) < 60  # what is nowhere near a border shortens no step


def test_friction_holds_a_mass_on_a_stop_that_does_not_bear_it_any_more() -> None:
    machine = ImpactChain(
        masses=1,
        damping=0.15,
        frequency=0.8,
        harmonic_forces=[1.6],
        elements=[
            HardStop(0, offset=-0.05, side="below", restitution=0.0),
            DryFriction(0, force=0.25, static=0.4),
        ],
    )
    attractor = machine.attractor(transient=100, impacts=20)
    orbit: Any = attractor.periodic_orbit()
    assert orbit.label == str(attractor.label) == "P(inf,1)"
    assert orbit.admissible
    times = np.linspace(0.0, orbit.period, 40)
    motion = attractor.record.sample(orbit.period - attractor.record.start.phase / 0.8 + times)
    own = orbit.sample(orbit.period - orbit.phases[0] / 0.8 + times)
    assert np.array(own) == pytest.approx(np.array(motion), abs=1e-9)


def test_a_branch_is_followed_in_numbers_of_an_element() -> None:
    orbit = orbit_of("beside a soft stop")
    branch = continue_orbit(orbit, "elements[1].stiffness", bounds=(1.0, 4.0))
    assert branch.parameter.min() == 1.0
    assert branch.parameter.max() == 4.0
    assert branch.admissible.all()
    end = branch.orbit(int(np.argmax(branch.parameter)))
    changed = MACHINES["beside a soft stop"].replace(**{"elements[1].stiffness": 4.0})
    other = changed.attractor().periodic_orbit()
    assert abs(other.states - end.states).max() < 1e-10


def test_a_chatter_that_another_stop_sets_off_is_refused_by_name() -> None:
    """Two stops chatter by turns: an impact of one opens the other, which closes at once."""
    system, start = random_machine(227)
    attractor = system.attractor(start=start, transient=400, impacts=40)
    assert "P(inf,1)" in str(attractor.label)
    with pytest.raises(NoConvergence, match="a chatter begins with another stop's impact"):
        attractor.periodic_orbit()


def test_a_slider_that_yields_for_a_moment_at_an_impact_changes_no_motion(monkeypatch: Any) -> None:
    """An impact may leave a slider at its limit; rounding decides whether it slips at the next."""
    orbit: Any = JOINED.attractor(transient=300, impacts=60).periodic_orbit()
    inserted = []

    def simulated(*given: Any) -> Seen:
        seen = followed(*given)
        events, times = list(seen.events), seen.times
        for k in range(len(events) - 1, -1, -1):
            mode = events[k].mode
            if events[k].kicked and mode.numbers[1] == 0 == events[k + 1].mode.numbers[1]:
                slips = regimes_of(JOINED, (mode.numbers[0], 1))
                events[k : k + 1] = [Happening(mode, 1, 0), events[k]._replace(mode=slips)]
                times = np.insert(times, k, times[k])
                inserted.append(k)
        return Seen(times, tuple(events), np.zeros((len(times), 5)))

    monkeypatch.setattr("dynkit.systems.impact.orbits.itineraries.simulated.simulated", simulated)
    assert orbit.sticks
    assert orbit.admissible
    assert inserted


def test_a_slider_that_yields_for_a_moment_at_an_impact_is_not_counted() -> None:
    orbit: Any = JOINED.attractor(transient=300, impacts=60).periodic_orbit()
    itinerary, n = orbit._problem.itinerary, len(orbit._problem.itinerary)
    k = next(k for k, e in enumerate(itinerary) if e.kicked and not e.mode.numbers[1])
    hit = itinerary[k]
    yields = Happening(hit.mode, 1, 0)
    slips = hit._replace(mode=regimes_of(JOINED, (hit.mode.numbers[0], 1)))
    events, lasting = (*itinerary[:k], yields, slips, *itinerary[k + 1 :]), np.ones(n + 1)
    assert counts_of(JOINED, events, lasting)["joint.sticks"] == orbit.counts["joint.sticks"] + 1
    lasting[k + 1] = 0.0
    assert counts_of(JOINED, events, lasting) == orbit.counts
