"""Simulations that go on from where others ended, with the same parameters or with others."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import pytest

from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.simulation.state import Motion
from dynkit.systems.impact.simulation.trajectory import Ending

STICKING = (0.16, 0.202, 0.408)


@pytest.mark.parametrize("frequency", [0.35, 0.87, 1.336, *STICKING])
@pytest.mark.parametrize("first", [1, 80, 143])
def test_two_runs_give_the_bits_of_one(frequency: float, first: int) -> None:
    chain = ImpactChain(frequency=frequency)
    whole = chain.simulate(impacts=200)
    part = chain.simulate(impacts=first)
    rest = chain.simulate(impacts=200 - first, start=part.final)
    assert np.concatenate([part.states, rest.states]).tobytes() == whole.states.tobytes()
    assert rest.final.position.tobytes() == whole.final.position.tobytes()


@pytest.mark.parametrize("frequency", STICKING)
def test_runs_of_one_impact_stick_and_release_as_one_long_run_does(frequency: float) -> None:
    chain = ImpactChain(frequency=frequency)
    whole = chain.simulate(impacts=150)
    assert np.isfinite(whole.sticking).any()
    state, contacts = chain.state(), 0
    for i in range(150):
        record = chain.simulate(impacts=1, start=state)
        assert record.states.tobytes() == whole.states[i : i + 1].tobytes()
        state, contacts = record.final, contacts + len(record.sticking)
    assert contacts == len(whole.sticking)


@pytest.mark.parametrize("frequency", [0.87, 0.408])
def test_times_of_two_runs_add_up(frequency: float) -> None:
    chain = ImpactChain(frequency=frequency)
    whole = chain.simulate(impacts=200).time
    part = chain.simulate(impacts=80)
    rest = chain.simulate(impacts=120, start=part.final)
    assert np.allclose(part.time[-1] + rest.time, whole[80:], rtol=4e-16, atol=0.0)


@pytest.mark.parametrize("name", ["position", "velocity", "energy", "phase"])
def test_an_impact_has_the_same_bits_in_any_record(name: str) -> None:
    chain = ImpactChain(frequency=0.35)
    long, short = chain.simulate(impacts=37), chain.simulate(impacts=1)
    assert getattr(long, name)[:1].tobytes() == getattr(short, name).tobytes()


def test_the_final_state_has_the_bits_of_the_last_impact() -> None:
    record = ImpactChain(frequency=0.35).simulate(impacts=37)
    assert record.final.position.tobytes() == record.position[-1].tobytes()
    assert record.final.velocity.tobytes() == record.velocity[-1].tobytes()
    assert record.final.relative_velocity == record.relative_velocity[-1]
    assert record.final.phase == record.phase[-1]


def test_phases_of_final_states_have_the_bits_of_those_of_a_record() -> None:
    chain = ImpactChain(frequency=0.35)
    finals = [chain.simulate(impacts=n).final.phase for n in range(1, 201)]
    assert finals == chain.simulate(impacts=200).phase.tolist()


def test_a_packed_state_goes_on_with_the_same_bits() -> None:
    chain = ImpactChain(frequency=0.408)
    final = chain.simulate(impacts=90).final
    packed = chain.unpack_state(chain.pack_state(final))
    one = chain.simulate(impacts=50, start=final)
    other = chain.simulate(impacts=50, start=packed)
    assert one.states.tobytes() == other.states.tobytes()


@pytest.mark.parametrize(
    "changed",
    [{"frequency": 0.91}, {"amplitude": 0.17}, {"offset": 0.05}, {"restitution": 0.5}],
    ids=lambda changed: next(iter(changed)),
)
def test_another_oscillator_takes_phase_and_contact_over(changed: dict[str, float]) -> None:
    final = ImpactChain(frequency=0.87).simulate(impacts=50).final
    other = ImpactChain(frequency=0.87).replace(**changed)
    start = other.simulate(impacts=1, start=final).start
    table = other.amplitude * math.sin(final.phase) + other.offset
    speed = other.amplitude * other.frequency * math.cos(final.phase)
    assert start.phase == pytest.approx(final.phase, rel=1e-15)
    assert start.position[-1] == pytest.approx(table, abs=1e-15)
    assert start.velocity[-1] - speed == pytest.approx(final.relative_velocity, abs=1e-15)
    assert start.relative_velocity == final.relative_velocity
    assert start.position[:-1] == pytest.approx(final.position[:-1], abs=1e-15)


def test_a_chain_of_another_size_does_not_take_a_state() -> None:
    final = ImpactChain(masses=9, frequency=0.87).simulate(impacts=2).final
    with pytest.raises(ValueError, match=r"start must have 10 masses; got 9"):
        ImpactChain(frequency=0.87).simulate(impacts=1, start=final)


def test_a_state_in_flight_below_the_other_table_is_refused() -> None:
    start = ImpactChain(frequency=0.87).state()
    with pytest.raises(ValueError, match=r"start must not be below the table at 3\.0; got 0\.43"):
        ImpactChain(frequency=0.87, offset=3.0).simulate(impacts=1, start=start)


def released_for_good() -> tuple[ImpactChain, Any]:
    chain = ImpactChain(masses=2, damping=3.0, restitution=0.0, offset=-0.2, frequency=0.3)
    record = chain.simulate(impacts=100, start=chain.state([1.0, 2.0], [0.0, -3.0]))
    assert record.ending is Ending.NO_FURTHER_CONTACT
    assert record.final.motion is Motion.RELEASE
    return chain, record.final


@pytest.mark.parametrize("changed", [{"frequency": 0.45}, {"amplitude": 0.15}, {"offset": 0.1}])
def test_a_state_of_release_is_one_on_the_table_for_others(changed: dict[str, float]) -> None:
    # The contact force that vanished at the release does not vanish with other parameters.
    chain, final = released_for_good()
    other = chain.replace(**changed)
    taken = other.simulate(impacts=5, start=final)
    state = taken.start
    expected = other.simulate(
        impacts=5, start=other.state(state.position, state.velocity, state.phase)
    )
    assert taken.ending is expected.ending
    assert taken.time == pytest.approx(expected.time, abs=1e-9)


def test_a_released_motion_that_ended_ends_again() -> None:
    chain, final = released_for_good()
    again = chain.simulate(impacts=3, start=final)
    assert again.ending is Ending.NO_FURTHER_CONTACT
    assert len(again) == 0


def test_contact_for_ever_goes_on_for_ever() -> None:
    chain = ImpactChain(masses=3, offset=0.5, amplitude=0.01, frequency=0.3)
    record = chain.simulate(impacts=500)
    assert record.ending is Ending.CONTACT_FOR_EVER
    again = chain.simulate(impacts=3, start=record.final)
    assert again.ending is Ending.CONTACT_FOR_EVER
    assert len(again) == 0
    assert np.isinf(again.sticking[0, 1])


# --- values --------------------------------------------------------------------------------------


def test_equal_arguments_make_equal_chains() -> None:
    one = ImpactChain(masses=(1, 2), springs=1, frequency=0.87)
    other = ImpactChain(masses=(1.0, 2.0), springs=1.0, frequency=0.87)
    assert one == other
    assert hash(one) == hash(other)


def test_what_was_worked_out_does_not_make_chains_differ() -> None:
    used, fresh = ImpactChain(frequency=0.408), ImpactChain(frequency=0.408)
    used.simulate(impacts=100)
    assert used == fresh
    assert hash(used) == hash(fresh)


@pytest.mark.parametrize("name", ["frequency", "restitution", "amplitude", "offset", "damping"])
def test_other_parameters_make_other_chains(name: str) -> None:
    chain = ImpactChain(frequency=0.87)
    assert chain != chain.replace(**{name: 0.5})


@pytest.mark.parametrize("frequency", [0.87, 0.408])
def test_pickled_chains_simulate_the_same_bits(frequency: float) -> None:
    chain = ImpactChain(frequency=frequency)
    record = chain.simulate(impacts=120)
    copy = pickle.loads(pickle.dumps(chain))
    assert copy == chain
    assert copy.simulate(impacts=120).states.tobytes() == record.states.tobytes()


def test_pickled_states_go_on_with_the_same_bits() -> None:
    chain = ImpactChain(frequency=0.408)
    final = chain.simulate(impacts=90).final
    copy = pickle.loads(pickle.dumps(final))
    one = chain.simulate(impacts=50, start=final)
    other = chain.simulate(impacts=50, start=copy)
    assert one.states.tobytes() == other.states.tobytes()


def test_pickled_records_keep_their_numbers() -> None:
    record = ImpactChain(frequency=0.408).simulate(impacts=120)
    copy = pickle.loads(pickle.dumps(record))
    assert copy.states.tobytes() == record.states.tobytes()
    assert copy.sticking.tobytes() == record.sticking.tobytes()
    times = np.linspace(0.0, record.time[-1], 50)
    assert copy.sample(times)[0].tobytes() == record.sample(times)[0].tobytes()
