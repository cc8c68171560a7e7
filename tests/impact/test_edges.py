"""Motions on the edge of what can happen: forces that vanish, ends of cells, decay to rounding."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import pytest

from dynkit.core.angles import in_turn
from dynkit.exponential.sums import ExponentialSum, RootKind
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.oscillators.play import PlayOscillator
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.impact.exact import exact_errors
from tests.reference.general_oscillator import GeneralOscillator, chain_of
from tests.reference.random_machines import random_machine

pytestmark = pytest.mark.plain

# --- impacts where a cell of the search ends -----------------------------------------------------


@pytest.mark.parametrize("sixteenths", range(1, 60))
def test_a_root_where_a_cell_ends_is_a_root(sixteenths: int) -> None:
    # The first zero of the cosine, at a multiple of any smallest step.
    time = sixteenths / 16.0
    root = ExponentialSum([1.0], [0.0], [0.5 * math.pi / time], [0.0]).first_root()
    assert root.kind is RootKind.ROOT
    assert root.time == pytest.approx(time, rel=4e-16, abs=0.0)
    assert root.rate == pytest.approx(-0.5 * math.pi / time, rel=1e-14, abs=0.0)


def test_impacts_where_cells_end_are_not_lost() -> None:
    # Period 4 in free flight: impacts at the times 1, 3, 5, ...
    chain = ImpactChain(
        masses=1,
        springs=(0.5 * math.pi) ** 2,
        damping=0.0,
        amplitude=0.0,
        restitution=0.8,
        frequency=1.0,
    )
    record = chain.simulate(impacts=20, start=chain.state([1.0], [0.0]))
    u = 0.5 * math.pi * 0.8 ** np.arange(1.0, 21.0)
    assert record.time == pytest.approx(np.arange(1.0, 41.0, 2.0), rel=1e-14, abs=0.0)
    assert record.relative_velocity == pytest.approx(u, rel=1e-13, abs=0.0)


# --- a mass put on the table where its contact force vanishes ------------------------------------


@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("frequency", [0.3, 0.9])
def test_a_force_that_rises_from_zero_holds_the_mass(frequency: float, damping: float) -> None:
    # F = (k - m w^2) A sin(phase) + c w A cos(phase), from its zero on.
    chain = ImpactChain(masses=1, damping=damping, frequency=frequency)
    phase = -math.atan2(damping * frequency, 1.0 - frequency**2)
    start = chain.state([0.1 * math.sin(phase)], [0.1 * frequency * math.cos(phase)], phase=phase)
    record = chain.simulate(impacts=1, start=start)
    assert record.sticking[0] == pytest.approx([0.0, math.pi / frequency], abs=1e-6)


def test_a_force_that_falls_from_zero_lets_the_mass_go() -> None:
    chain = ImpactChain(masses=1, damping=0.0, frequency=2.0)
    record = chain.simulate(impacts=5, start=chain.state([0.0], [0.2]))
    assert len(record.sticking) == 0
    assert record.time[0] > 1.0
    assert (np.diff(record.time) > 0.0).all()
    assert exact_errors(record)[:, 1].max() < 1e-13


@pytest.mark.parametrize("n", [1, 3, 10])
@pytest.mark.parametrize("damping", [0.0, 0.1, 9.0])
def test_a_chain_at_rest_on_a_table_at_rest_stays(n: int, damping: float) -> None:
    chain = ImpactChain(masses=n, damping=damping, amplitude=0.0, frequency=1.0)
    record = chain.simulate(impacts=10, start=chain.state(np.zeros(n), np.zeros(n)))
    assert record.ending is Ending.CONTACT_FOR_EVER
    assert len(record) == 0


def test_a_mass_that_swings_with_the_table_stays_on_it() -> None:
    # At its own frequency the table need not push: the contact force vanishes at all times.
    chain = ImpactChain(masses=1, damping=0.0, frequency=1.0)
    record = chain.simulate(impacts=10, start=chain.state([0.0], [0.1]))
    assert record.ending is Ending.CONTACT_FOR_EVER
    assert len(record) == 0


# --- decay to rounding ---------------------------------------------------------------------------

DECAYING: dict[str, dict[str, Any]] = {
    "overdamped": {"masses": 1, "damping": 10.0},
    "three overdamped": {"masses": 3, "damping": 10.0},
    "one of two overdamped": {"masses": 2, "springs": (1.36, 0.89), "damping": 5.0},
    "dead": {"masses": 1, "restitution": 0.0},
    "two dead": {"masses": 2, "damping": 2.0, "restitution": 0.0},
    "elastic": {"masses": 3, "damping": 5.0, "restitution": 0.999},
}


@pytest.mark.parametrize("name", DECAYING)
def test_a_motion_that_decays_on_a_table_at_rest_ends_or_goes_on_in_time(name: str) -> None:
    chain = ImpactChain(**DECAYING[name], amplitude=0.0, frequency=1.0)
    start = chain.state(np.ones(chain.degrees_of_freedom))
    record = chain.simulate(impacts=200, start=start)
    assert (np.diff(record.time, prepend=0.0) > 0.0).all()
    assert record.ending is not Ending.SEARCH_LIMIT


@pytest.mark.parametrize("damping", [0.1, 0.5, 1.0])
def test_impacts_that_never_end_are_told_until_they_die_out(damping: float) -> None:
    # About a rest on the table: half a period of free flight each, and u falls by the same factor.
    chain = ImpactChain(masses=1, damping=damping, amplitude=0.0, frequency=1.0)
    record = chain.simulate(impacts=6000, start=chain.state([1.0]))
    assert record.ending is Ending.DIED_OUT
    half = math.pi / math.sqrt(1.0 - 0.25 * damping**2)
    count = np.arange(len(record))
    late = abs(record.time - record.time[0] - half * count)
    assert (late <= 2.0**-50 * record.time + 1e-15).all()
    logs = np.log(record.relative_velocity)
    fall = math.log(chain.restitution) - 0.5 * damping * half
    assert abs(logs - logs[0] - fall * count).max() < 1e-11
    assert record.relative_velocity[-1] < 1e-199
    assert str(chain.attractor(transient=6000).label) == "no impacts"


@pytest.mark.parametrize("factor", [1.0, 2.0, 4.0])
def test_a_slow_mode_that_ends_on_the_table_keeps_the_others_off_it(factor: float) -> None:
    # From t = 0 on the gap is above 0.005 exp(-0.0028 t): other terms decay faster.
    mass = np.diag([2.5369438458969875, 0.8750600176462597, 2.410163678103507])
    stiffness = np.array(
        [
            [0.21767298934051485, 0.3680083899769145, 0.040531593184829975],
            [0.3680083899769145, 0.6585305370526447, 0.0008966284063944636],
            [0.040531593184829975, 0.0008966284063944636, 0.3974928879760802],
        ]
    )
    system = MatrixOscillator(
        M=factor * mass,
        C=factor * mass,
        K=factor * stiffness,
        frequency=1.0,
        restitution=0.0,
        amplitude=0.0,
        contact=0,
    )
    place, velocity = [1.0, -0.46042657, -0.91805295], [-0.96694473, 0.62654048, 0.82551115]
    record = system.simulate(impacts=12, start=system.state(place, velocity))
    assert len(record) == 0
    assert record.ending is Ending.NO_FURTHER_CONTACT


@pytest.mark.parametrize("decay", [2.0, 20.0, 2000.0])
def test_a_sum_of_decaying_exponentials_of_one_sign_has_no_root(decay: float) -> None:
    root = ExponentialSum([1.0], [0.0], [1.0], [decay]).first_root()
    assert root.kind is RootKind.NEVER


def test_dead_impacts_have_the_relative_velocity_plus_zero() -> None:
    record = ImpactChain(frequency=0.408, restitution=0.0).simulate(impacts=50)
    assert not np.signbit(record.relative_velocity).any()


# --- overdamped modes ----------------------------------------------------------------------------


@pytest.mark.parametrize("position", [0.967, 0.977, 0.987, 0.997, 1.007])
def test_an_overdamped_mass_is_as_exact_as_any(position: float) -> None:
    chain = ImpactChain(
        masses=(2.27,), damping=5.0, restitution=1.0, amplitude=1.0, offset=-0.3, frequency=1.208
    )
    record = chain.simulate(impacts=3, start=chain.state([position], [0.045]))
    assert exact_errors(record)[:, 1].max() < 4e-15


def test_overdamped_masses_leave_with_the_velocities_of_their_states() -> None:
    chain = ImpactChain(
        masses=(0.25, 0.5), damping=7.5, restitution=1.0, amplitude=1.0, frequency=0.5
    )
    record = chain.simulate(impacts=60, start=chain.state([0.0, 0.25]))
    table = chain.amplitude * chain.frequency * np.cos(record.phase)
    off = record.velocity[:, -1] - table - record.relative_velocity
    assert abs(off).max() < 2e-15


# --- what never happens again is known -----------------------------------------------------------


@pytest.mark.parametrize("detuning", [0.0, 1e-9, 1e-4, 9e-4])
@pytest.mark.parametrize("damping", [1e-6, 1e-3])
def test_a_driven_mode_that_stays_below_the_stop_never_hits_it(
    damping: float, detuning: float
) -> None:
    # At most the steady response, force / (damping frequency), and as much again to begin with.
    w, force = 1.0 + detuning, 0.3
    steady = force / math.hypot(1.0 - w * w, damping * w)
    system = PlayOscillator(
        play=6.0 * steady, spring=1.0, damping=damping, force=force, amplitude=0.0, frequency=w
    )
    record = system.simulate(impacts=5, start=system.state([0.0], [0.0]))
    assert record.ending is Ending.NO_FURTHER_CONTACT


@pytest.mark.parametrize("drag", [1e-300, 1e-100, 1e-18, 1e-9, 0.011962890625, 1.0, 1e5])
def test_a_dragged_body_that_goes_away_never_comes_back(drag: float) -> None:
    # No velocity and place where drag takes it exactly: v / drag has other digits.
    system = MatrixOscillator(
        M=[[1.0]], C=[[drag]], K=[[0.0]], amplitude=0.1, frequency=1.7, offset=-0.5
    )
    record = system.simulate(impacts=5, start=system.state([0.0], [0.3]))
    assert record.ending is Ending.NO_FURTHER_CONTACT


def test_a_dragged_body_pushed_away_never_comes_back() -> None:
    system = MatrixOscillator(
        M=[[1.0]], C=[[0.3]], K=[[0.0]], constant_forces=(1e-5,), amplitude=0.1, frequency=1.7
    )
    record = system.simulate(impacts=5, start=system.state([20.0], [-0.3]))
    assert record.ending is Ending.NO_FURTHER_CONTACT


# --- beyond what doubles hold --------------------------------------------------------------------


def test_a_flight_of_too_many_steps_has_no_impact_that_was_not_found() -> None:
    # Let go by the dashpot after 3e7 time constants of 5e-13 times 1e12.
    system = MatrixOscillator(
        M=[[1.0 / 64.0]], C=[[3.2e10]], K=[[1.0]], amplitude=0.0, offset=1.0, frequency=1.0
    )
    record = system.simulate(impacts=1, start=system.state([1.001], [0.3]))
    assert len(record) == 0
    assert record.ending is Ending.SEARCH_LIMIT


def test_slips_that_become_ever_rarer_are_given_up_as_one_flight_is() -> None:
    """Nothing drives or damps it: its slips come after 1e4 periods, and cross no section."""
    system, start = random_machine(27001489)
    record = system.simulate(impacts=3, start=start)
    assert record.ending is Ending.SEARCH_LIMIT
    assert len(record) == 2
    assert record._run.cells < 4_000_000


@pytest.mark.parametrize("spring", [1e-300, 1e-100, 1e-30, 1e-28, 1e-26, 1e-22])
@pytest.mark.parametrize("amplitude", [0.0, 0.2])
def test_a_spring_too_weak_to_be_felt_changes_nothing(spring: float, amplitude: float) -> None:
    free = PlayOscillator(amplitude=amplitude, frequency=1.0, restitution=0.5)
    held = free.replace(spring=spring)
    records = [s.simulate(impacts=8, start=s.state([0.0], [0.3])) for s in (free, held)]
    off = abs(free.difference(records[0].states, records[1].states)).max(axis=1)
    # The spring bends a flight of 50 by 50 spring / 2 of its velocity, at most.
    assert (off <= records[0].error + records[1].error + 1e3 * spring).all()


@pytest.mark.parametrize("drag", [1e-300, 1e-100, 1e-30, 1e-18])
@pytest.mark.parametrize("amplitude", [0.0, 0.2])
@pytest.mark.parametrize("force", [0.0, 0.1])
def test_drag_too_weak_to_be_felt_changes_nothing(
    drag: float, amplitude: float, force: float
) -> None:
    free = PlayOscillator(amplitude=amplitude, force=force, frequency=1.0, restitution=0.5)
    dragged = free.replace(damping=drag)
    records = [s.simulate(impacts=8, start=s.state([0.0], [0.3])) for s in (free, dragged)]
    off = abs(free.difference(records[0].states, records[1].states)).max(axis=1)
    assert (off <= records[0].error + records[1].error + 1e3 * drag).all()


@pytest.mark.parametrize("held", [{"spring": 1e-300}, {"spring": 1e-24}, {"damping": 1e-30}])
@pytest.mark.parametrize("amplitude", [0.0, 0.2])
def test_what_is_too_weak_to_be_felt_does_not_change_the_error(
    held: dict[str, float], amplitude: float
) -> None:
    free = PlayOscillator(amplitude=amplitude, frequency=1.0, restitution=0.5)
    free_error, held_error = (
        system.simulate(impacts=8, start=system.state([0.0], [0.3])).error
        for system in (free, free.replace(**held))
    )
    # Disturbances by the same pseudo-random numbers: they differ by what the rounding of runs does.
    assert (held_error < 2.0 * free_error).all()
    assert (free_error < 2.0 * held_error).all()


@pytest.mark.parametrize("force", [1e-100, 1e-155, 1e-200, 1e-290])
def test_motions_of_any_size_are_similar(force: float) -> None:
    unit = PlayOscillator(play=1.0, spring=1.0, force=1.0, amplitude=0.0, frequency=2.1)
    small = unit.replace(play=force, force=force)
    one = unit.simulate(impacts=20, start=unit.state([0.0], [0.3]))
    other = small.simulate(impacts=20, start=small.state([0.0], [0.3 * force]))
    off = abs(other.relative_velocity / force - one.relative_velocity)
    assert (off <= 2.0 * one.error).all()


# --- errors of what rounding leaves open ---------------------------------------------------------


def test_the_error_of_a_touch_is_that_of_its_time() -> None:
    # Put down at the table's own frequency: it comes back to it once a turn, with no speed left.
    chain = ImpactChain(
        masses=1, damping=0.0, restitution=0.0, amplitude=0.03, frequency=1.0, offset=-0.25
    )
    record = chain.simulate(impacts=3, start=chain.state([-0.22], [-0.2], phase=1.9))
    turns = (record.phase[1:] - record.phase[0]) / math.tau
    off = math.tau * abs(turns - np.rint(turns))
    assert record.cost.counts["touches"] == 2
    assert (off <= record.error[1:]).all()


@pytest.mark.parametrize("frequency", [49.5, 1e4])
def test_phases_of_many_turns_keep_their_digits(frequency: float) -> None:
    chain = ImpactChain(masses=1, damping=0.0, amplitude=0.0, offset=-0.5, frequency=frequency)
    record = chain.simulate(impacts=3, start=chain.state([1.0], [0.0]))
    wait = mpmath.mpf(2) * mpmath.pi / 3
    assert record.time[0] == pytest.approx(float(wait), rel=4e-16, abs=0.0)
    # The time itself has an error of one or two units in its last place.
    off = math.remainder(record.phase[0] - float(frequency * wait % (2 * mpmath.pi)), math.tau)
    assert abs(off) <= frequency * 4.0 * 2.0**-52 + 4.0 * 2.0**-52


# --- slow motions: of what fast ones leave behind, and towards a fast table -----------------------

SLIDING: dict[str, Any] = {
    "masses": (1.0, 0.5, 1.0),
    "springs": (0.0, 1.0, 2.25),
    "damping": (2.0**-13, 2.0**-14, 1.625),
    "restitution": 0.59375,
    "amplitude": 0.0,
    "frequency": 64.0,
}


def test_fast_motions_do_not_round_the_velocity_that_drag_leaves() -> None:
    # Springs that are stretched by 1 relax within 10; the bodies slide on for 1000, at 2e-4.
    chain = ImpactChain(**SLIDING, offset=-0.0011, side="below", play=1.375)
    place, velocity = [0.0625, 0.0, -0.6875], [0.0, 0.0, 2.0**-11]
    record = chain.simulate(impacts=1, start=chain.state(place, velocity))
    exact = chain_of(**SLIDING, offset=-0.0011, side="below", far_stop=-0.0011 - 1.375)
    impact = exact.simulate(place, velocity, impacts=1).impacts[0]
    assert record.time[0] > 500.0
    assert abs(record.time[0] - float(impact.time)) <= record.error[0] / chain.frequency


@pytest.mark.parametrize(("spring", "damping"), [(3.0, 0.1), (3.0, 1.0), (7.0, 0.5), (11.0, 0.7)])
@pytest.mark.parametrize("offset", [-0.1, -0.3, -0.7])
def test_the_error_counts_the_rounding_of_a_rest_that_is_all_but_on_the_table(
    spring: float, damping: float, offset: float
) -> None:
    # The weight stretches the spring down to the table, but for the rounding of all three.
    parameters: dict[str, Any] = {
        "frequency": 1.0,
        "restitution": 0.85,
        "amplitude": 0.0,
        "offset": offset,
        "constant_forces": (spring * offset,),
    }
    system = MatrixOscillator(M=[[1.0]], C=[[damping]], K=[[spring]], **parameters)
    record = system.simulate(impacts=60, start=system.state([1.0], [0.0]))
    exact = GeneralOscillator([[1.0]], [[damping]], [[spring]], **parameters)
    impacts = exact.simulate([1.0], [0.0], 0.0, impacts=60).impacts
    common = min(len(record), len(impacts))
    assert common > 10
    off = abs(record.time[:common] - np.array([float(x.time) for x in impacts[:common]]))
    assert (off <= record.error[:common] + 2.0**-51 * record.time[:common]).all()


def test_the_error_of_a_time_counts_the_turns_of_the_table() -> None:
    # Dead impacts: the force carries the mass on by 1e-5 a unit of time, the table moves by 0.2.
    parameters: dict[str, Any] = {
        "restitution": 0.0,
        "amplitude": 0.001325364681914646,
        "frequency": 172.8360637610908,
        "constant_forces": (-2.482538755816541e-06,),
    }
    system = MatrixOscillator(M=[[1.0]], C=[[0.28125]], K=[[0.0]], **parameters)
    record = system.simulate(impacts=4, start=system.state([1.0], [0.0], 5.4))
    exact = GeneralOscillator([[1.0]], [[0.28125]], [[0.0]], **parameters)
    impacts = exact.simulate([1.0], [0.0], 5.4, impacts=4).impacts
    off = abs(record.time - np.array([float(impact.time) for impact in impacts]))
    assert off[-1] > math.tau / system.frequency
    assert (off <= record.error / system.frequency + 2.0**-51 * record.time).all()


@pytest.mark.parametrize("power", range(-6, 3))
def test_an_impact_at_the_very_end_of_the_first_cell_keeps_its_speed(power: int) -> None:
    # a flight of 2 u under unit gravity: for powers of two it ends where a cell does
    ball = MatrixOscillator(
        M=[[1]],
        C=[[0]],
        K=[[0]],
        constant_forces=[-1.0],
        amplitude=0,
        frequency=1,
        restitution=1.0,
    )
    speed = 2.0**power
    record = ball.simulate(impacts=3, start=ball.state([0.0], [speed]))
    assert record.time.tolist() == [2.0 * speed, 4.0 * speed, 6.0 * speed]
    assert record.relative_velocity.tolist() == [speed, speed, speed]


def test_a_phase_just_below_zero_is_zero_and_no_whole_turn() -> None:
    # -1e-17 modulo a turn rounds to the turn itself
    angles = in_turn(np.array([-1e-17, 0.0, 1.0, -1.0, math.tau]))
    assert angles.tolist() == [0.0, 0.0, 1.0, math.tau - 1.0, 0.0]
