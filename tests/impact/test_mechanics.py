"""What mechanics says of every motion: energy, reversal, closed forms, a stepper."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.product_kernels import fused
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.reference.brute_force import BruteForceChain

UNEQUAL: dict[str, Any] = {"masses": (1.0, 0.5, 2.0), "springs": (1.0, 3.0, 0.7)}


def table_velocity(record: ImpactRecord) -> Array:
    chain = record.system
    return np.asarray(chain.amplitude * chain.frequency * np.cos(record.phase))


def energy_jumps(record: ImpactRecord) -> Array:
    """Change of energy at each impact (equation 17, times the mass), for restitution > 0."""
    chain = record.system
    r, before = chain.restitution, -record.relative_velocity / chain.restitution
    jump = 2.0 * (1.0 + r) * abs(before) * table_velocity(record) + (r * r - 1.0) * before**2
    return np.asarray(0.5 * chain.mass[-1, -1] * jump)


@kernel(entry=True)
def _square_less(a: float, b: float) -> float:
    square_less: float = fused(a, a, -b)
    return square_less


def products_are_fused() -> bool:
    """Whether compiled sums take products with all their digits."""
    a = 1.0 + 2.0**-30
    return bool(_square_less(a, a * a) != 0.0)


# --- energy --------------------------------------------------------------------------------------


@pytest.mark.parametrize("more", [{}, UNEQUAL], ids=["paper", "unequal"])
@pytest.mark.parametrize("frequency", [0.35, 0.87])
@pytest.mark.parametrize("restitution", [0.3, 0.85, 1.0])
def test_without_damping_only_impacts_change_the_energy(
    restitution: float, frequency: float, more: dict[str, Any]
) -> None:
    chain = ImpactChain(damping=0.0, restitution=restitution, frequency=frequency, **more)
    record = chain.simulate(impacts=100)
    # While they are in contact the table works on the mass.
    flights = np.ones(99, dtype=bool)
    flights[np.searchsorted(record.time, record.sticking[:, 0], side="right") - 1] = False
    assert flights.sum() > 80
    jumps = np.diff(record.energy)
    assert jumps[flights] == pytest.approx(energy_jumps(record)[1:][flights], abs=1e-13)


@pytest.mark.parametrize("more", [{}, UNEQUAL], ids=["paper", "unequal"])
@pytest.mark.parametrize("frequency", [0.16, 0.35, 0.87, 1.346])
def test_every_impact_changes_the_energy_by_equation_17(
    frequency: float, more: dict[str, Any]
) -> None:
    record = ImpactChain(frequency=frequency, **more).simulate(impacts=60)
    chain = record.system
    x, v = record.sample(np.nextafter(record.time, 0.0))
    before = 0.5 * ((v @ chain.mass * v).sum(axis=1) + (x @ chain.stiffness * x).sum(axis=1))
    # Where flights are shorter than the rounding of the time there is no "just before".
    clear = np.diff(np.append(0.0, record.time)) > 1e-6
    jumps = record.energy - before
    assert clear.sum() > 30
    assert jumps[clear] == pytest.approx(energy_jumps(record)[clear], abs=1e-13)


@pytest.mark.parametrize(
    ("more", "impacts"),
    [({}, 1_000_000), (UNEQUAL, 200_000), ({"masses": 1}, 1_000_000), ({"masses": 2}, 200_000)],
    ids=["paper", "unequal", "one", "two"],
)
def test_elastic_motion_on_a_table_at_rest_keeps_its_energy(
    more: dict[str, Any], impacts: int
) -> None:
    chain = ImpactChain(damping=0.0, restitution=1.0, amplitude=0.0, frequency=1.0, **more)
    record = chain.simulate(impacts=impacts)
    assert record.ending is Ending.COUNT_REACHED
    # Where a processor adds a product without rounding it first, the low parts of the propagators
    # are not lost, and the energy does not drift. Elsewhere each impact may add half an ulp.
    drift = 1e-11 if products_are_fused() else 2.0**-53 * len(record)
    assert abs(record.energy / record.energy[0] - 1.0).max() < drift


def test_the_energy_is_that_of_positions_and_velocities() -> None:
    record = ImpactChain(frequency=0.35, **UNEQUAL).simulate(impacts=50)
    x, v = record.position, record.velocity
    mass, stiffness = record.system.mass, record.system.stiffness
    energy = 0.5 * ((v @ mass * v).sum(axis=1) + (x @ stiffness * x).sum(axis=1))
    assert record.energy == pytest.approx(energy, rel=1e-14)


# --- reversal ------------------------------------------------------------------------------------


def reversed_state(state: Array) -> Array:
    """Section coordinates of the motion run backwards: velocities and phase change sides."""
    half = len(state) // 2 - 1
    out = state.copy()
    out[half : 2 * half] *= -1.0
    out[-1] = math.pi - state[-1]
    return out


@pytest.mark.parametrize("amplitude", [0.0, 0.1])
@pytest.mark.parametrize("n", [1, 2, 3, 10])
def test_undamped_elastic_motion_runs_backwards(n: int, amplitude: float) -> None:
    chain = ImpactChain(
        masses=n, damping=0.0, restitution=1.0, amplitude=amplitude, offset=-0.1, frequency=0.7
    )
    begin = chain.section_state(chain.simulate(impacts=3).final)
    there = chain.simulate(impacts=12, start=chain.impact_state(begin))
    turned = chain.impact_state(reversed_state(chain.section_state(there.final)))
    back = chain.simulate(impacts=12, start=turned)
    off = chain.difference(reversed_state(chain.section_state(back.final)), begin)
    assert abs(off).max() <= max(float(there.error[-1] + back.error[-1]), 1e-14)
    assert abs(off).max() < 1e-9
    assert back.time[-1] == pytest.approx(there.time[-1], abs=1e-9)


# --- closed forms --------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.3])
def test_one_mass_hits_a_table_at_rest_when_the_closed_form_says(restitution: float) -> None:
    # x = cos t from x = 1 down to the table at -1/2; each flight is an arc of the phase circle.
    chain = ImpactChain(
        masses=1, damping=0.0, restitution=restitution, amplitude=0.0, offset=-0.5, frequency=1.0
    )
    record = chain.simulate(impacts=10, start=chain.state([1.0], [0.0]))
    u = math.sqrt(0.75) * restitution ** np.arange(1.0, 11.0)
    flights = 2.0 * (math.pi - np.arctan2(u, 0.5))
    times = 2.0 * math.pi / 3.0 + np.append(0.0, np.cumsum(flights))[:10]
    assert (abs(record.relative_velocity - u) <= record.error).all()
    assert (abs(record.time - times) <= record.error + 4.0 * np.spacing(times)).all()
    assert record.error[3] < 1e-12


@pytest.mark.parametrize("damping", [0.0, 0.1, 2.0, 20.0])
@pytest.mark.parametrize("offset", [-0.05, 0.0, 0.05])
@pytest.mark.parametrize("before", [0.1, 1.0, 2.0])
def test_one_mass_leaves_the_table_at_the_phase_of_the_closed_form(
    damping: float, offset: float, before: float
) -> None:
    # The contact force F = B sin(phase + lag) + k A0 vanishes there, falling.
    chain = ImpactChain(masses=(2.0,), springs=1.5, damping=damping, offset=offset, frequency=2.0)
    a, w = chain.amplitude, chain.frequency
    elastic, viscous = (1.5 - 2.0 * w * w) * a, 1.5 * damping * w * a
    lag, size = math.atan2(viscous, elastic), math.hypot(viscous, elastic)
    release = math.pi + math.asin(1.5 * offset / size)
    phase = release - lag - before
    start = chain.state([a * math.sin(phase) + offset], [a * w * math.cos(phase)], phase=phase)
    record = chain.simulate(impacts=1, start=start)
    assert record.sticking[0, 0] == 0.0
    assert record.sticking[0, 1] == pytest.approx(before / w, rel=1e-14)


@pytest.mark.parametrize("phase", [0.5 * math.pi, 1.5 * math.pi])
def test_one_mass_bounces_periodically_where_the_closed_form_says(phase: float) -> None:
    # Undamped and elastic, once in two periods of the table: it leaves a turning point of the table
    # at u and comes back at -u, on the arc x = x_T cos(t - T/2) / cos(T/2).
    period = 4.0 * math.pi / 2.5
    chain = ImpactChain(
        masses=1, damping=0.0, restitution=1.0, amplitude=0.2, offset=-0.5, frequency=2.5
    )
    u = (0.2 * math.sin(phase) - 0.5) * math.tan(0.5 * period)
    state = np.array([u, phase])
    assert u > 0.0
    assert abs(chain.difference(chain(state), state)).max() < 1e-14
    assert chain.simulate(impacts=1, start=chain.impact_state(state)).time[0] == pytest.approx(
        period, rel=1e-14
    )


# --- the stepper ---------------------------------------------------------------------------------


def test_a_stepper_of_fourth_order_converges_to_the_impacts() -> None:
    chain = ImpactChain(frequency=0.8, damping=0.3, amplitude=0.4, restitution=0.7, **UNEQUAL)
    start = chain.state([0.2, 0.5, 0.9], [0.1, 0.0, -0.3])
    record = chain.simulate(impacts=5, start=start)
    steps = 0.08 * 0.5 ** np.arange(4)
    errors = []
    for step in steps.tolist():
        stepper = BruteForceChain(
            np.array(chain.masses),
            np.array(chain.springs),
            damping=0.3,
            restitution=0.7,
            amplitude=0.4,
            offset=0.0,
            frequency=0.8,
            step=step,
        )
        run = stepper.run(start.position, start.velocity, impacts=5, limit=200.0)
        errors.append(float(abs(run.position - record.position).max()))
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 3.6 < order < 4.4
    assert errors[-1] < 1e-7


@pytest.mark.parametrize("frequency", [0.16, 0.408])
def test_a_stepper_sticks_and_releases_where_the_chain_does(frequency: float) -> None:
    chain = ImpactChain(frequency=frequency)
    record = chain.simulate(impacts=160)
    stepper = BruteForceChain(
        np.ones(10),
        np.ones(10),
        damping=0.1,
        restitution=0.85,
        amplitude=0.1,
        offset=0.0,
        frequency=frequency,
        step=2e-3,
    )
    begin, release = record.sticking[0]
    start = chain.state()
    run = stepper.run(start.position, start.velocity, impacts=1000, limit=release + 0.1)
    # The stepper holds the mass from the first bounce shorter than a step on; those left out then
    # take 1/(1 - r) steps.
    assert begin - 2.0 * 2e-3 / 0.15 < run.contact[0, 0] < begin
    assert run.contact[0, 1] == pytest.approx(release, abs=4e-3)
