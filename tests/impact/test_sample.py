"""The motion between impacts: what `record.sample` says at any time."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
import sympy as sp

from dynkit.core.validation import Array
from dynkit.systems import HardStop, ImpactOscillator
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.trajectory import Ending

UNEQUAL: dict[str, Any] = {
    "masses": (1.0, 0.5, 2.0),
    "springs": (1.0, 3.0, 0.7),
    "damping": (0.1, 0.4, 0.2),
    "restitution": 0.6,
}
MOTIONS: dict[str, dict[str, Any]] = {
    "sticking": {"frequency": 0.408},
    "chaotic": {"frequency": 0.35},
    "periodic": {"frequency": 0.87},
    "dead": {"frequency": 0.408, "restitution": 0.0},
    "one mass": {"masses": 1, "frequency": 0.4, "offset": 0.05},
    "unequal": {"frequency": 0.5, "offset": 0.05, **UNEQUAL},
    "overdamped": {"masses": 3, "damping": 8.0, "frequency": 0.9, "amplitude": 0.5},
}

motions = pytest.mark.parametrize("motion", MOTIONS)


def simulated(motion: str, impacts: int = 110) -> ImpactRecord:
    return ImpactChain(**MOTIONS[motion]).simulate(impacts=impacts)


def gaps(record: ImpactRecord, times: Array) -> Array:
    chain = record.system
    table = chain.amplitude * np.sin(chain.frequency * times) + chain.offset
    return np.asarray(record.sample(times)[0][:, -1] - table)


def between(edges: Array, count: int) -> Array:
    """So many times in each of the intervals, ends excluded."""
    part = np.linspace(0.0, 1.0, count + 2)[1:-1]
    return np.asarray((edges[:-1, None] + np.diff(edges)[:, None] * part).ravel())


@motions
def test_samples_at_impacts_are_the_states_just_after_them(motion: str) -> None:
    record = simulated(motion)
    alone = np.diff(np.append(record.time, np.inf)) > 0.0
    x, v = record.sample(record.time[alone])
    assert x == pytest.approx(record.position[alone], abs=1e-15)
    assert v == pytest.approx(record.velocity[alone], abs=1e-15)


@motions
def test_positions_do_not_jump_at_impacts(motion: str) -> None:
    record = simulated(motion)
    x, _ = record.sample(np.nextafter(record.time, 0.0))
    allowed = 1e-14 + 2.0 * np.spacing(record.time[:, None])
    assert (abs(x - record.position) <= allowed).all()


@motions
def test_only_the_contact_velocity_jumps_at_impacts(motion: str) -> None:
    record = simulated(motion)
    clear = np.diff(np.append(0.0, record.time)) > 1e-6
    _, v = record.sample(np.nextafter(record.time, 0.0)[clear])
    assert v[:, :-1] == pytest.approx(record.velocity[clear, :-1], abs=1e-13)


@motions
def test_impacts_turn_the_relative_velocity_by_the_restitution(motion: str) -> None:
    record = simulated(motion)
    chain = record.system
    clear = np.diff(np.append(0.0, record.time)) > 1e-6
    _, v = record.sample(np.nextafter(record.time, 0.0)[clear])
    table = chain.amplitude * chain.frequency * np.cos(record.phase[clear])
    expected = -chain.restitution * (v[:, -1] - table)
    assert record.relative_velocity[clear] == pytest.approx(expected, abs=1e-13)


@motions
@pytest.mark.parametrize("end", [0, 1], ids=["begins", "ends"])
def test_positions_do_not_jump_where_contact(motion: str, end: int) -> None:
    record = simulated(motion)
    times = record.sticking[np.isfinite(record.sticking[:, 1]), end]
    assert record.sample(times + 1e-9)[0] == pytest.approx(record.sample(times - 1e-9)[0], abs=1e-8)


@motions
def test_velocities_do_not_jump_at_releases(motion: str) -> None:
    record = simulated(motion)
    times = record.sticking[np.isfinite(record.sticking[:, 1]), 1]
    assert record.sample(times + 1e-9)[1] == pytest.approx(record.sample(times - 1e-9)[1], abs=1e-8)


@motions
def test_the_gap_is_never_negative(motion: str) -> None:
    record = simulated(motion)
    edges = np.append(0.0, record.time[record.time < 60.0])
    times = np.concatenate([between(edges, 60), edges[1:]])
    assert gaps(record, times).min() > -1e-14


@motions
def test_the_gap_is_open_between_impacts(motion: str) -> None:
    record = simulated(motion)
    edges = np.append(0.0, record.time)
    long = np.flatnonzero(np.diff(edges) > 1e-3)
    times = np.concatenate([between(edges[i : i + 2], 60) for i in long])
    stuck = np.zeros(len(times), dtype=bool)
    for begin, end in record.sticking:
        stuck |= (times > begin - 1e-2) & (times < end + 1e-2)
    assert gaps(record, times[~stuck]).min() > 0.0


@motions
def test_the_mass_stays_on_the_table_during_contact(motion: str) -> None:
    record = simulated(motion)
    chain = record.system
    for begin, end in record.sticking[np.isfinite(record.sticking[:, 1])]:
        times = np.linspace(begin, end, 100)
        _, v = record.sample(times)
        speed = chain.amplitude * chain.frequency * np.cos(chain.frequency * times)
        assert abs(gaps(record, times)).max() < 1e-13
        assert abs(v[1:, -1] - speed[1:]).max() < 1e-13


@motions
def test_velocities_are_the_rates_of_positions(motion: str) -> None:
    record = simulated(motion)
    events = np.sort(np.concatenate([[0.0], record.time, record.sticking.ravel()]))
    events = events[np.isfinite(events)]
    long = np.flatnonzero(np.diff(events) > 1e-2)
    times = np.concatenate([between(events[i : i + 2], 5) for i in long])
    h = 1e-4
    steps = (-2, -1, 1, 2)
    far = [record.sample(times + k * h)[0] for k in steps]
    rate = (far[0] - 8.0 * far[1] + 8.0 * far[2] - far[3]) / (12.0 * h)
    assert rate == pytest.approx(record.sample(times)[1], abs=1e-9)


@motions
def test_times_give_the_same_bits_in_any_order_and_company(motion: str) -> None:
    record = simulated(motion)
    times = np.random.default_rng(7).uniform(0.0, record.time[-1], 50)
    x, v = record.sample(times)
    for i in (0, 7, 31):
        alone = record.sample(times[i : i + 1])
        assert alone[0].tobytes() == x[i].tobytes()
        assert alone[1].tobytes() == v[i].tobytes()


@motions
def test_no_times_give_no_samples(motion: str) -> None:
    record = simulated(motion)
    x, v = record.sample([])
    assert x.shape == v.shape == (0, record.system.degrees_of_freedom)


# --- the bounces that were left out --------------------------------------------------------------


@pytest.mark.parametrize("motion", ["sticking", "one mass", "unequal"])
def test_bounces_left_out_are_followed_to_leading_order(motion: str) -> None:
    chain = ImpactChain(**MOTIONS[motion])
    fine = chain.replace(chatter_tolerance=1e-30).simulate(impacts=400)
    coarse = chain.replace(chatter_tolerance=1e-12).simulate(impacts=400)
    begin = coarse.sticking[0, 0]
    cut = coarse.time[np.searchsorted(coarse.time, begin) - 1]
    # Up to where the fine run has 20 bounces more.
    times = np.linspace(cut, cut + 0.95 * (begin - cut), 300)
    off = abs(coarse.sample(times)[0] - fine.sample(times)[0]).max()
    height = gaps(fine, times).max()
    assert height > 1e-10
    assert off < 1e-2 * height


@pytest.mark.parametrize("motion", ["sticking", "one mass", "unequal"])
def test_bounces_left_out_do_not_pierce_the_table(motion: str) -> None:
    record = ImpactChain(**MOTIONS[motion], chatter_tolerance=1e-9).simulate(impacts=110)
    begin = record.sticking[0, 0]
    cut = record.time[np.searchsorted(record.time, begin) - 1]
    assert gaps(record, np.linspace(cut, begin, 1000)).min() > -1e-13


# --- ends ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("time", [-1e-9, -1.0, math.nan, math.inf])
def test_times_that_were_not_simulated_are_refused(time: float) -> None:
    record = simulated("periodic")
    with pytest.raises(ValueError, match=re.escape("times[1] must")):
        record.sample([1.0, time])


def test_times_beyond_the_last_impact_are_refused_by_value() -> None:
    record = simulated("periodic", 3)
    last = float(record.time[-1])
    with pytest.raises(ValueError, match=re.escape(f"times[0] must lie in [0, {last}]; got 99.0")):
        record.sample([99.0])


def test_after_the_last_contact_the_motion_goes_on_for_any_time() -> None:
    chain = ImpactChain(masses=3, offset=-0.9, frequency=0.5)
    record = chain.simulate(impacts=5000)
    assert record.ending is Ending.NO_FURTHER_CONTACT
    times = np.array([record.time[-1] + 50.0, 1e3, 1e6]) if len(record) else np.array([50.0, 1e6])
    x, v = record.sample(times)
    assert np.isfinite(x).all()
    assert abs(x[-1]).max() < 1e-12
    assert abs(v[-1]).max() < 1e-12


def test_times_beyond_all_sense_are_refused() -> None:
    chain = ImpactChain(masses=3, offset=-0.9, frequency=0.5)
    record = chain.simulate(impacts=5000)
    with pytest.raises(ValueError, match=r"times\[0\] must lie in \[0, .*\]; got 1e\+25"):
        record.sample([1e25])


@pytest.mark.parametrize("n", [1, 3])
def test_contact_for_ever_is_sampled_at_any_time(n: int) -> None:
    chain = ImpactChain(masses=n, offset=0.3, frequency=0.1)
    start = chain.state(np.arange(1.0, n + 1.0) / n)
    record = chain.simulate(impacts=5000, start=start)
    assert record.ending is Ending.CONTACT_FOR_EVER
    times = record.sticking[-1, 0] + np.array([0.0, 10.0, 1e3, 1e5])
    assert abs(gaps(record, times)).max() < 1e-12


def test_a_start_that_sticks_at_once_is_sampled_from_the_start() -> None:
    chain = ImpactChain(masses=2, offset=0.3, frequency=0.2)
    start = chain.state([0.0, 0.3], [0.0, chain.amplitude * chain.frequency])
    record = chain.simulate(impacts=10, start=start)
    x, v = record.sample([0.0])
    assert x[0] == pytest.approx(start.position, abs=1e-15)
    assert v[0] == pytest.approx(start.velocity, abs=1e-15)


class CoupledByPhase(ImpactOscillator):
    """Two masses, coupled by a mass matrix that depends on the phase; a force holds the second."""

    degrees_of_freedom = 2

    def kinetic(self, v: Any, phase: Any) -> Any:  # type: ignore[override]
        return (v[0] ** 2 + v[1] ** 2 + sp.cos(phase) * v[0] * v[1]) / 2

    def potential(self, x: Any) -> Any:
        return (x[0] ** 2 + x[1] ** 2) / 2 + 3 * x[1]

    def dissipation(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 20


def test_omitted_bounces_have_the_mass_matrix_of_their_phase() -> None:
    system = CoupledByPhase(frequency=1.0, elements=[HardStop(1, amplitude=0.05, restitution=0.5)])
    record = system.simulate(impacts=60, start=system.state([0.3, 0.6], phase=1.3))
    begins = float(record.sticking[0, 0])
    since = np.linspace(-8e-6, -1e-7, 50)
    _, v = record.sample(begins + since)
    # impulses of the second stop do not change the momentum of the first mass
    momentum = v[:, 0] + 0.5 * np.cos(1.3 + begins + since) * v[:, 1]
    assert np.ptp(v[:, 1]) > 1e-5
    assert abs(momentum - np.polyval(np.polyfit(since, momentum, 1), since)).max() < 1e-10
