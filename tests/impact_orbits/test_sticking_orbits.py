"""Orbits that stick: the motion to 50 digits, closed forms, samples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpmath import mp, mpf
from scipy.optimize import brentq

from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.oscillators.ball import BouncingBall
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.play import PlayOscillator
from tests.impact_orbits.sticking_cases import (
    SEVERAL,
    SYSTEMS,
    TURN,
    Releases,
    exact_of,
    monodromy,
    orbit_of,
    releases_of,
    returned,
)

NONE = np.empty(0)
CUT = "1e-9"
"""Part of the fastest approach below which 50 digits stick: wrong by about its square."""

BEFORE = 4e-15
"""Phase, of the order of rounding."""

SLOW = ("chain of 10, 0.202", "chain of 10, 0.408", "chain of 10, dead", "chain in a play", "play")
"""To 50 digits, in which the motion of ten masses can take minutes; and the references start on the
near stop alone."""


# --- Newton's method ------------------------------------------------------------------------------


def after_a_step(orbit: ImpactOrbit, size: float) -> float:
    """The largest residual after one step of Newton's method from a solution that is disturbed."""
    problem, x = orbit.problem(), orbit.unknowns
    off = np.random.default_rng(1).uniform(-1.0, 1.0, len(x)) * problem.scale(x)
    y = x + size * off
    step = np.linalg.solve(problem.linearization(y, NONE), problem.residual(y, NONE))
    return float(abs(problem.residual(y - step, NONE)).max())


@pytest.mark.parametrize("name", SYSTEMS)
def test_steps_of_newtons_method_converge_quadratically(name: str) -> None:
    orbit = orbit_of(name)
    sizes = 1e-5 * 0.5 ** np.arange(4)
    left = np.array([after_a_step(orbit, size) for size in sizes])
    above = left > 1e-14
    assert (left <= 1e-6).all()
    orders = np.diff(np.log2(left[above]))
    assert (orders < -1.7).all()


@pytest.mark.parametrize("name", SYSTEMS)
def test_newtons_method_ends_at_rounding(name: str) -> None:
    orbit = orbit_of(name)
    problem, x = orbit.problem(), orbit.unknowns
    assert (abs(problem.residual(x, NONE)) <= problem.rounding(x, NONE)).all()
    assert orbit.residual < 1e-13


# --- 50 digits ------------------------------------------------------------------------------------


def exact_return(orbit: ImpactOrbit) -> tuple[Array, float]:
    """How far places and phase are from themselves one period later, to 50 digits."""
    releases, places, phase = releases_of(orbit)
    oscillator = exact_of(orbit.system, CUT)
    r = orbit.system.restitution
    chatter = 3 if r == 0.0 else math.ceil(21.0 / -math.log(r)) + 3
    impacts = len(orbit.observable("time")) + chatter * len(orbit.phases)
    # A little before, so that there is still contact, and the release itself has all digits.
    x, v = releases.whole(places, phase - BEFORE)
    history = oscillator.simulate(
        x.tolist(), v.tolist(), phase - BEFORE, impacts, relative_velocity=0
    )
    with mp.workdps(60):
        turn = 2 * mp.pi * orbit.periods / mpf(orbit.system.frequency)
        ends = [contact.release for contact in history.contacts]
        time = min(ends, key=lambda t: abs(t - turn))
        late = float((time - turn) * mpf(orbit.system.frequency))
        found = oscillator.state_at(history, time)
        parts = [[part[i] for i in releases.others] for part in found]
        back = [float(a - mpf(b)) for a, b in zip(parts[0] + parts[1], places, strict=True)]
    return np.array(back), late


@pytest.mark.parametrize("name", [n for n in SYSTEMS if n not in SLOW])
def test_the_error_bounds_the_distance_from_the_orbit_to_50_digits(name: str) -> None:
    orbit = orbit_of(name)
    releases, places, phase = releases_of(orbit)
    back, late = exact_return(orbit)
    off = np.linalg.solve(np.eye(len(back)) - monodromy(name), back) if len(back) else back
    turned = releases.phase(places + off, phase) - phase
    # The phase itself is given to rounding.
    assert abs(off).max(initial=0.0) <= orbit.error
    assert abs(turned) <= orbit.error + 2.0**-51 * phase
    assert abs(late) <= 10.0 * orbit.error + BEFORE


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_error_is_near_rounding(name: str) -> None:
    assert 0.0 < orbit_of(name).error < 1e-9


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_force_is_zero_at_the_releases(name: str) -> None:
    orbit = orbit_of(name)
    for k in range(len(orbit.phases)):
        releases, places, phase = releases_of(orbit, k)
        assert abs(releases.phase(places, phase) - phase) < 1e-13


@pytest.mark.parametrize("name", SEVERAL)
def test_simulation_returns_to_the_release(name: str) -> None:
    orbit = orbit_of(name)
    _, places, _ = releases_of(orbit)
    assert abs(returned(orbit, places) - places).max() < 1e-11


# --- closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["ball", "dead ball"])
def test_a_ball_is_released_where_the_table_falls_as_fast_as_it(name: str) -> None:
    orbit = orbit_of(name)
    assert isinstance(orbit.system, BouncingBall)
    wanted = math.asin(1.0 / orbit.system.amplitude)
    assert orbit.states[0, -1] == pytest.approx(wanted, abs=1e-13)


def test_a_ball_without_rebound_sticks_where_it_falls_on_the_table() -> None:
    orbit = orbit_of("dead ball")
    a, phase = 1.3, math.asin(1.0 / 1.3)

    def gap(t: float) -> float:
        ballistic = a * math.sin(phase) + a * math.cos(phase) * t - 0.5 * t * t
        return ballistic - a * math.sin(phase + t)

    assert orbit.contacts[0, 0] == pytest.approx(brentq(gap, 0.5, 4.0, xtol=1e-14), abs=1e-12)


# --- attractors -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["chain of 10, 0.202", "chain of 10, 0.408", "forces", "play"])
def test_an_attractor_that_sticks_is_the_orbit_that_is_found(name: str) -> None:
    wanted = orbit_of(name)
    attractor = wanted.system.attractor()
    orbit = attractor.periodic_orbit()
    assert isinstance(orbit, ImpactOrbit)
    assert orbit.sticks
    assert orbit.label == wanted.label == str(attractor.label)
    off = [wanted.system.difference(orbit.states[0], state) for state in wanted.states]
    assert abs(np.array(off)).max(axis=1).min() <= orbit.error + wanted.error


@pytest.mark.parametrize(("masses", "restitution"), [(2, 0.3), (2, 0.6), (3, 0.85)])
def test_an_orbit_run_through_twice_is_not_another_one(masses: int, restitution: float) -> None:
    chain = ImpactChain(masses=masses, frequency=0.202, restitution=restitution)
    assert len(chain.periodic_orbits(sticking=True)) == 1
    assert chain.periodic_orbits(sticking=True, periods=2) == []


def test_chains_between_two_stops_are_searched() -> None:
    chain = ImpactChain(masses=2, frequency=0.2, restitution=0.6, play=0.15, damping=0.2)
    start = chain.state([0.05, 0.05], [0.0, 0.0])
    wanted = chain.attractor(start=start).periodic_orbit()
    found = chain.periodic_orbit(sticking=True)
    assert isinstance(wanted, ImpactOrbit)
    assert wanted.sticks
    assert sorted(found.phases % TURN) == pytest.approx(sorted(wanted.phases % TURN), abs=1e-11)


def test_both_stops_of_a_play_hold_the_mass_half_a_period_apart() -> None:
    orbit = orbit_of("play")
    assert isinstance(orbit.system, PlayOscillator)
    assert np.signbit(orbit.states[:, -2]).sum() == 1
    assert np.diff(orbit.phases) == pytest.approx([math.pi], abs=1e-12)


# --- the motion -----------------------------------------------------------------------------------


def record_of(orbit: ImpactOrbit) -> Any:
    start = orbit.system.impact_state(orbit.states[0])
    count = 100
    while True:
        record = orbit.system.simulate(impacts=count, start=start)
        if record.time[-1] > 1.2 * orbit.period:
            return record
        count *= 2


def test_an_orbit_begins_within_the_first_turn_wherever_it_was_found() -> None:
    chain = ImpactChain(frequency=0.408)
    (found,) = chain.periodic_orbits(periods=2, sticking=True)
    assert 0.0 <= found.phases[0] < TURN
    wanted = chain.attractor().periodic_orbit()
    assert isinstance(wanted, ImpactOrbit)
    assert found.phases == pytest.approx(wanted.phases, abs=found.error + wanted.error)


@pytest.mark.parametrize("name", SYSTEMS)
def test_samples_are_those_of_a_simulation(name: str) -> None:
    orbit = orbit_of(name)
    record = record_of(orbit)
    times = np.linspace(0.0, orbit.period, 500, endpoint=False)
    # At the impacts the velocity jumps: which side is seen depends on rounding.
    times = times[abs(times[:, None] - record.time).min(axis=1) > 1e-6]
    for found, wanted in zip(orbit.sample(times), record.sample(times), strict=True):
        assert abs(found - wanted).max() < 1e-10


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_stop_pushes_during_contact(name: str) -> None:
    orbit = orbit_of(name)
    w, first = orbit.system.frequency, orbit.phases[0]
    stops = [releases_of(orbit, k)[0] for k in range(len(orbit.phases))]
    for k, (begin, end) in enumerate(orbit.contacts):
        releases = stops[(k + 1) % len(stops)]
        times = np.linspace(begin, end, 52)[1:-1]
        position, velocity = orbit.sample(times)
        for t, x, v in zip(times.tolist(), position, velocity, strict=True):
            places = np.concatenate([x[releases.others], v[releases.others]])
            assert releases.force(places, first + w * t) > 0.0
            assert x == pytest.approx(releases.whole(places, first + w * t)[0], abs=1e-13)


@pytest.mark.parametrize("name", SYSTEMS)
def test_contacts_end_where_the_simulated_ones_do(name: str) -> None:
    orbit = orbit_of(name)
    ends = record_of(orbit).sticking[:, 1]
    for _, end in orbit.contacts:
        assert abs(ends - end).min() < 1e-9


@pytest.mark.parametrize("name", SYSTEMS)
def test_bounces_are_those_of_the_simulation(name: str) -> None:
    orbit = orbit_of(name)
    record = record_of(orbit)
    times, phases, speeds = orbit.bounces.T
    which = [int(np.argmin(abs(record.time - t))) for t in times]
    assert record.time[which] == pytest.approx(times, abs=1e-9)
    assert record.relative_velocity[which] == pytest.approx(speeds, abs=1e-10)
    assert np.exp(1j * record.phase[which]) == pytest.approx(np.exp(1j * phases), abs=1e-9)


@pytest.mark.parametrize("name", SYSTEMS)
def test_observables_are_those_of_the_first_bounces(name: str) -> None:
    orbit = orbit_of(name)
    for k, what in enumerate(("time", "phase", "relative_velocity")):
        values = orbit.observable(what)
        assert np.isin(values, orbit.bounces[:, k]).all()


# --- objects --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SYSTEMS)
def test_label_period_and_shapes_agree(name: str) -> None:
    orbit, periods = orbit_of(name), SYSTEMS[name][1]
    n, k = orbit.system.degrees_of_freedom, len(orbit.phases)
    assert orbit.label == f"P(inf,{periods})"
    assert orbit.period == pytest.approx(periods * TURN / orbit.system.frequency, rel=1e-15)
    assert (orbit.states.shape, orbit.contacts.shape) == ((k, 2 * n), (k, 2))
    assert orbit.multipliers.shape == (2 * n,)
    assert orbit.admissible
    assert orbit.states[:, -1] == pytest.approx(orbit.phases % TURN)
    assert (orbit.states[:, -2] == 0.0).all()
    assert orbit.contacts[-1, 1] == pytest.approx(orbit.period, rel=1e-13)


def test_states_at_releases_lead_to_the_stop_they_leave() -> None:
    orbit = orbit_of("play")
    for k, state in enumerate(orbit.states):
        _, places, phase = releases_of(orbit, k)
        start = orbit.system.impact_state(state)
        far = Releases(orbit.system, far=bool(np.signbit(state[-2])))
        assert start.position == pytest.approx(far.whole(places, phase)[0], abs=1e-14)
        record = orbit.system.simulate(impacts=1, start=start)
        shift = orbit.phases[k] - orbit.phases[0]
        first = (orbit.observable("time") - shift / orbit.system.frequency) % orbit.period
        assert record.time[0] == pytest.approx(first.min(), abs=1e-9)


def test_a_search_finds_the_orbits_on_which_motions_settle() -> None:
    chain = ImpactChain(masses=2, frequency=0.491233, damping=0.0658276, restitution=0.149039)
    orbits = chain.periodic_orbits(sticking=True)
    stable = [o.multipliers[0] for o in orbits if o.admissible and o.stable]
    assert abs(np.array(stable)) == pytest.approx([0.672, 0.138], abs=1e-3)
    # motions settle on each of them
    random, seen = np.random.default_rng(0), set()
    for x in random.uniform(0.0, 3.0, (24, 2)):
        motion = chain.attractor(start=chain.state(position=x), transient=300)
        seen.add(round(motion.label.multiplier, 2))
    assert {0.67, 0.14} <= seen
