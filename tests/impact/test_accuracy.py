"""Impacts against the same motion to 50 digits, and what the record says of its own error."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.steady_response import DISTURBANCE
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.records.record import _TWINS, ImpactRecord
from dynkit.systems.impact.simulation.runs import Course, course_from
from tests.effort import some
from tests.impact.many_digits import Case, errors_before_contact, random_case
from tests.reference.values import PAPER_CHAIN

RESTITUTIONS = (0.0, 0.3, 0.85, 0.999, 1.0)
DAMPINGS = (0.0, 1e-3, 0.1, 1.0, 5.0, 50.0, 1e4)


def off(found: float, exact: str) -> float:
    with mp.workdps(40):
        return abs(float(mpf(float(found)) - mpf(exact)))


@pytest.mark.parametrize(
    ("frequency", "impacts", "allowed"),
    # After 50 impacts at 0.87 an unstable transient has grown: what a Taylor series of order 20
    # (heyoka, tolerance 1e-16) attains is asked for there.
    [(0.87, 10, 3e-15), (0.87, 50, 1.2e-10), (0.35, 10, 3e-15), (0.35, 30, 3e-15)],
)
def test_the_tip_and_its_speed_have_the_digits_of_the_best_peer(
    frequency: float, impacts: int, allowed: float
) -> None:
    record = ImpactChain(frequency=frequency).simulate(impacts=impacts)
    values = PAPER_CHAIN[frequency, impacts]
    assert off(record.position[-1, -1], values.tip) <= allowed
    assert off(record.relative_velocity[-1], values.relative_velocity) <= allowed


@pytest.mark.parametrize(("frequency", "impacts"), PAPER_CHAIN)
def test_times_and_phases_of_the_paper_chain(frequency: float, impacts: int) -> None:
    record = ImpactChain(frequency=frequency).simulate(impacts=impacts)
    values = PAPER_CHAIN[frequency, impacts]
    # What is asked of the tip moves the impact by as much over the closing speed.
    tip = 1.2e-10 if (frequency, impacts) == (0.87, 50) else 3e-15
    allowed = tip * record.system.restitution / float(values.relative_velocity)
    assert off(record.phase[-1], values.phase) <= allowed + np.spacing(record.phase[-1])
    assert off(record.time[-1], values.time) <= allowed + np.spacing(record.time[-1])


# --- random chains -------------------------------------------------------------------------------


@cache
def random_errors(seed: int, damping: float, restitution: float) -> tuple[ImpactRecord, Array]:
    return errors_before_contact(random_case(seed, damping, restitution), 8)


def cases() -> list[tuple[int, float, float]]:
    """Two chains of each damping and restitution, or one of each."""
    seeds = iter(range(1000))
    every = [(next(seeds), g, r) for g in DAMPINGS for r in RESTITUTIONS for _ in range(2)]
    return list(some(every, 2))


@pytest.mark.parametrize(("seed", "damping", "restitution"), cases())
def test_states_are_wrong_by_less_than_the_record_says(
    seed: int, damping: float, restitution: float
) -> None:
    record, errors = random_errors(seed, damping, restitution)
    assert (errors[:, 1] <= record.error[: len(errors)]).all()


@pytest.mark.parametrize(("seed", "damping", "restitution"), cases())
def test_times_are_wrong_by_less_than_the_record_says(
    seed: int, damping: float, restitution: float
) -> None:
    record, errors = random_errors(seed, damping, restitution)
    time = record.time[: len(errors)]
    allowed = record.error[: len(errors)] / record.system.frequency + np.spacing(time)
    assert (errors[:, 0] <= allowed).all()


def test_the_error_is_not_pessimistic_by_more_than_a_factor_100() -> None:
    ratios: list[float] = []
    for case in cases():
        record, errors = random_errors(*case)
        ratios += (errors[:, 1] / record.error[: len(errors)]).tolist()
    assert np.median(ratios) > 0.01


def one_mode_critical(n: int, mode: int) -> ImpactChain:
    """A chain whose damping is critical for one mode, up to the rounding of its frequency."""
    frequency = float(ImpactChain(masses=n, frequency=1.0).natural_frequencies[mode])
    return ImpactChain(masses=n, damping=2.0 / frequency, amplitude=0.5, frequency=0.9)


@pytest.mark.parametrize(("n", "mode"), [(1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2)])
@pytest.mark.parametrize("detuning", [0.0, 1e-12, -1e-12, 1e-6, -1e-6, 0.1, 0.11])
def test_critical_damping_costs_no_digits(n: int, mode: int, detuning: float) -> None:
    chain = one_mode_critical(n, mode)
    assert isinstance(chain.damping, float)
    chain = chain.replace(damping=chain.damping * (1.0 + detuning))
    position = np.linspace(0.2, 0.9, n)
    record, errors = errors_before_contact(Case(chain, position, np.zeros(n)), 4)
    assert len(errors) >= 1
    assert (errors[:, 1] <= record.error[: len(errors)]).all()
    assert errors[0].max() < 1e-14


def test_a_long_flight_costs_no_digits() -> None:
    # The mass, overdamped, comes down on the table after thousands of its periods.
    chain = ImpactChain(masses=2, damping=1e4, restitution=0.0, frequency=1.18)
    case = Case(chain, np.array([0.656, 0.509]), np.array([-0.2, -1.2]))
    record, errors = errors_before_contact(case, 1)
    assert record.time[0] > 1e4
    assert errors[0, 1] <= record.error[0] < 1e-12


def test_the_error_of_the_first_impact_counts_that_of_the_start() -> None:
    # Nearly grazing, the first impact magnifies the rounding of where it came from.
    chain = ImpactChain(masses=1, damping=0.0, amplitude=0.0, frequency=1.0)
    case = Case(chain.replace(offset=-1.0 + 1e-12), np.array([1.0]), np.array([0.0]))
    record, errors = errors_before_contact(case, 1)
    assert errors[0, 1] <= record.error[0]
    assert record.error[0] > 1e-11


def test_three_disturbed_runs_of_a_machine_hardly_ever_all_stay_near() -> None:
    low = HardStop(0, offset=-0.4, restitution=0.9)
    high = HardStop(0, offset=0.7, side="below", restitution=0.9)
    given: Any = {"masses": 1, "damping": 0.02, "frequency": 0.7, "harmonic_forces": [2.0]}
    system = ImpactChain(elements=[low, high], **given)
    start = system.state([0.1], [0.5])

    def last(noise: float = 0.0, seed: int = 1) -> float:
        course = course_from(system, start, noise=noise, seed=seed)
        assert isinstance(course, Course)
        return float(course.advance(25, store=True).time[-1])

    # The motion stretches the disturbances to 1e-11: their rounding does not count.
    own, noise = last(), DISTURBANCE * 2.0**-52
    apart = np.sort([abs(last(noise, seed) - own) for seed in range(1, 3001)])
    assert np.median(apart) > 1e-12
    # Actual errors of random machines are a fifth of that, by root mean squares.
    nearer = np.searchsorted(apart, 0.2 * apart / system._margin) / apart.size
    assert np.mean(nearer**_TWINS) < 3e-5
