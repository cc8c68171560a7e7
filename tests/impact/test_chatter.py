"""Chatter, contact and release: against 50 digits, against theory, and at the limits."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.impact.many_digits import reference_of, state_error, time_error
from tests.reference.impact_chain import History

FREQUENCIES = (0.16, 0.202, 0.408)


# --- against 50 digits ---------------------------------------------------------------------------


@cache
def sticking(frequency: float) -> tuple[ImpactRecord, History]:
    """The paper's chain up to beyond its first release, twice."""
    chain = ImpactChain(frequency=frequency)
    record = chain.simulate(impacts=160)
    before = int(np.searchsorted(record.time, record.sticking[0, 0]))
    history = reference_of(chain, stick_below=1e-12).simulate(before + 120)
    assert len(history.contacts) == 1
    return record, history


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_release_times_are_those_of_50_digits(frequency: float) -> None:
    record, history = sticking(frequency)
    with mp.workdps(50):
        late = abs(float(mpf(float(record.sticking[0, 1])) - history.contacts[0][1]))
    assert late <= record.error[100] + np.spacing(record.sticking[0, 1])


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_contacts_begin_where_the_impacts_of_50_digits_accumulate(frequency: float) -> None:
    # The bounces left out are summed up to first order in their velocity.
    record, history = sticking(frequency)
    with mp.workdps(50):
        off = abs(float(mpf(float(record.sticking[0, 0])) - history.contacts[0][0]))
    assert off < 1e-8


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_impacts_after_the_release_are_those_of_50_digits(frequency: float) -> None:
    record, history = sticking(frequency)
    own = int(np.searchsorted(record.time, record.sticking[0, 1]))
    released = history.contacts[0][1]
    after = [impact for impact in history.impacts if impact.time > released]
    for i, impact in zip(range(own, own + 5), after, strict=False):
        assert state_error(record.states[i], impact) <= min(record.error[i], 2e-14)
        assert time_error(record.time[i], impact) <= 2e-14 + np.spacing(record.time[i])


# --- theory --------------------------------------------------------------------------------------


def above(n: int) -> Array:
    """Positions of masses in line, the last one at 1."""
    return np.arange(1.0, n + 1.0) / n


def pressed(n: int, restitution: float, **more: Any) -> ImpactChain:
    """A chain that a table at 0.3 presses on more strongly than it shakes."""
    arguments = {"frequency": 0.1, "offset": 0.3, "chatter_tolerance": 0.0, **more}
    return ImpactChain(masses=n, restitution=restitution, **arguments)


@pytest.mark.parametrize("n", [1, 2, 10])
@pytest.mark.parametrize("restitution", [0.1, 0.3, 0.6, 0.85])
def test_flights_and_velocities_of_a_chatter_shrink_by_the_restitution(
    n: int, restitution: float
) -> None:
    chain = pressed(n, restitution)
    start = chain.state(above(n), np.zeros(n))
    u = chain.simulate(impacts=5000, start=start).relative_velocity
    late = (u < 1e-11) & (u > 1e-100)
    pairs = np.flatnonzero(late[:-1] & late[1:])
    assert len(pairs) > 87.0 / -np.log10(restitution)
    assert abs(u[pairs + 1] / u[pairs] / restitution - 1.0).max() < 1e-6


def test_flight_times_of_the_paper_chatter_shrink_by_the_restitution_for_300_bounces() -> None:
    record = ImpactChain(frequency=0.408, chatter_tolerance=0.0).simulate(impacts=450)
    tail = slice(130, 430)
    # A flight takes 2u/a, also where the times no longer differ as doubles.
    ratios = record.relative_velocity[tail][1:] / record.relative_velocity[tail][:-1]
    assert len(ratios) >= 299
    assert abs(ratios - 0.85).max() < 1e-6


@pytest.mark.parametrize("n", [1, 2, 10])
def test_without_tolerance_chatter_goes_on_to_the_smallest_numbers(n: int) -> None:
    chain = pressed(n, 0.85)
    start = chain.state(above(n), np.zeros(n))
    record = chain.simulate(impacts=5000, start=start)
    assert record.ending is Ending.CONTACT_FOR_EVER
    assert record.relative_velocity[-1] < 1e-90
    assert record.chatter_error == 0.0


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_elastic_impacts_never_stick(frequency: float) -> None:
    record = ImpactChain(frequency=frequency, restitution=1.0).simulate(impacts=2000)
    assert len(record.sticking) == 0


@pytest.mark.parametrize("frequency", FREQUENCIES)
@pytest.mark.plain
def test_dead_impacts_stick_where_they_press_and_only_there(frequency: float) -> None:
    record = ImpactChain(frequency=frequency, restitution=0.0).simulate(impacts=100)
    assert (record.relative_velocity == 0.0).all()
    assert record.chatter_error == 0.0
    forces = contact_forces(record.system, record.position, record.velocity, record.phase)
    begins = np.isin(record.time, record.sticking[:, 0])
    clear = abs(forces) > 1e-12
    clear[-1] = False  # what follows the last impact is not part of the record
    assert begins.sum() > 10
    assert np.array_equal(begins[clear], forces[clear] > 0.0)


def contact_forces(system: ImpactChain | Any, x: Array, v: Array, phase: Array) -> Array:
    """Force (k,) of the table that keeps the contact mass on it (equation 15)."""
    acceleration = -system.amplitude * system.frequency**2 * np.sin(phase)
    inner = x @ system.stiffness[-1] + v @ system.damping_matrix[-1]
    return np.asarray(system.mass[-1, -1] * acceleration + inner)


@pytest.mark.parametrize("frequency", FREQUENCIES)
@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.85])
def test_the_table_pushes_throughout_contact(frequency: float, restitution: float) -> None:
    chain = ImpactChain(frequency=frequency, restitution=restitution)
    record = chain.simulate(impacts=300)
    contacts = record.sticking[np.isfinite(record.sticking[:, 1])]
    assert len(contacts) >= 3
    part = np.linspace(0.0, 1.0, 200)
    times = (contacts[:, :1] + (contacts[:, 1:] - contacts[:, :1]) * part).ravel()
    x, v = record.sample(times)
    forces = contact_forces(chain, x, v, chain.frequency * times)
    assert forces.min() > -1e-12


@pytest.mark.parametrize("frequency", FREQUENCIES)
@pytest.mark.plain
def test_the_force_vanishes_at_the_release(frequency: float) -> None:
    chain = ImpactChain(frequency=frequency)
    record = chain.simulate(impacts=300)
    releases = record.sticking[:, 1][np.isfinite(record.sticking[:, 1])]
    x, v = record.sample(releases)
    assert abs(contact_forces(chain, x, v, chain.frequency * releases)).max() < 1e-12


# --- ends ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 3, 10])
@pytest.mark.parametrize("restitution", [0.0, 0.85])
@pytest.mark.plain
def test_a_table_that_always_pushes_is_never_left(n: int, restitution: float) -> None:
    # A static press of about 0.3/n against accelerations of the table below 0.1 * 0.1^2.
    chain = ImpactChain(masses=n, restitution=restitution, offset=0.3, frequency=0.1)
    start = chain.state(above(n), np.zeros(n))
    record = chain.simulate(impacts=5000, start=start)
    assert record.ending is Ending.CONTACT_FOR_EVER
    assert np.isinf(record.sticking[-1, 1])
    assert len(record) < 5000


@pytest.mark.parametrize("n", [1, 3, 10])
def test_a_table_at_rest_that_pushes_is_never_left(n: int) -> None:
    chain = ImpactChain(masses=n, amplitude=0.0, offset=0.2, frequency=1.0)
    start = chain.state(above(n), np.zeros(n))
    record = chain.simulate(impacts=5000, start=start)
    assert record.ending is Ending.CONTACT_FOR_EVER


def test_a_table_at_rest_drives_no_resonance() -> None:
    # Held at the contact, the other two masses swing at the frequency 1 without damping.
    chain = ImpactChain(masses=3, damping=0.0, amplitude=0.0, offset=0.2, frequency=1.0)
    record = chain.simulate(impacts=500, start=chain.state(above(3)))
    other = chain.replace(frequency=0.9)
    expected = other.simulate(impacts=500, start=other.state(above(3)))
    assert record.relative_velocity == pytest.approx(expected.relative_velocity, abs=1e-9)


@pytest.mark.parametrize("n", [1, 3, 10])
def test_a_table_out_of_reach_is_left_after_some_impacts(n: int) -> None:
    chain = ImpactChain(masses=n, offset=-0.8, frequency=0.5)
    record = chain.simulate(impacts=5000, start=chain.state(above(n), -2.0 * above(n)))
    assert record.ending is Ending.NO_FURTHER_CONTACT
    assert 0 < len(record) < 5000


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_mass_put_on_a_pushing_table_sticks_from_the_start(restitution: float) -> None:
    chain = ImpactChain(masses=2, offset=0.3, frequency=0.2, restitution=restitution)
    start = chain.state([0.0, 0.3], [0.0, chain.amplitude * chain.frequency])
    record = chain.simulate(impacts=10, start=start)
    assert record.sticking[0, 0] == 0.0
    assert record.sticking[0, 1] > 0.0


@pytest.mark.parametrize("restitution", [0.5, 0.85])
def test_without_a_tolerance_no_bounce_is_left_out_under_constant_forces(
    restitution: float,
) -> None:
    # where contact changes nothing, to any order
    ball = MatrixOscillator(
        M=[[1]],
        C=[[0]],
        K=[[0]],
        constant_forces=[-1.0],
        amplitude=0,
        frequency=1,
        restitution=restitution,
        chatter_tolerance=0.0,
    )
    record = ball.simulate(impacts=100, start=ball.state([0.0], [1.0]))
    assert len(record) == 100
    exact = restitution ** np.arange(1, 101)
    np.testing.assert_allclose(record.relative_velocity, exact, rtol=1e-12)
