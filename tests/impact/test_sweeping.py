"""What a sweep does at each value in ways of its own: proofs of stability, and the same bits."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit.core.validation import Array
from dynkit.systems import ImpactChain, SingleImpactOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.variational.tangents import returned, settles


def test_what_norms_prove_stable_is_stable() -> None:
    proved = 0
    for frequency in np.linspace(0.4, 1.95, 16).tolist():
        motion = ImpactChain(frequency=frequency).attractor(transient=700, keep=100)
        label = motion.label_within(100)
        assert not motion._stays or label.stable
        proved += motion._stays
        if label.stable and (label.multiplier_error or 1.0) < 1e-9:
            assert motion._stays
    assert proved > 0


@pytest.mark.plain
@pytest.mark.parametrize("impacts", [3, 4, 30])
def test_norms_prove_nothing_of_an_unstable_orbit(impacts: int) -> None:
    machine = SingleImpactOscillator(frequency=2.8, restitution=0.8)
    (orbit,) = machine.periodic_orbits(impacts=1, periods=1)
    assert orbit.stable is False
    run = machine.simulate(impacts=impacts, start=machine.impact_state(orbit.states[0]))._run
    assert not settles(machine, run)


@pytest.mark.plain
def test_norms_prove_one_mass_stable() -> None:
    motion = SingleImpactOscillator(frequency=2.2, restitution=0.8).attractor(
        transient=200, keep=10
    )
    assert motion._stays
    assert abs(motion.label.multiplier or 1.0) < 1.0


MACHINES = [
    ImpactChain(frequency=0.87),
    ImpactChain(masses=4, contact=1, side="below", frequency=0.9),
    ImpactChain(masses=3, frequency=0.8, damping=(0.1, 0.2, 0.4)),
    ImpactChain(masses=2, frequency=0.8, constant_forces=[0.0, -0.1]),
    ImpactChain(masses=2, frequency=0.8, damping=3.0),
    SingleImpactOscillator(frequency=2.2, restitution=0.8),
    ImpactChain(masses=2, frequency=0.4, restitution=0.2),  # it sticks
]


@pytest.mark.parametrize("machine", MACHINES)
def test_section_coordinates_have_the_bits_of_positions_and_velocities(
    machine: ImpactOscillator,
) -> None:
    record = machine.simulate(impacts=50)
    others = machine._contacts[0].others
    parts = record.position[:, others], record.velocity[:, others]
    expected: Array = np.column_stack([*parts, record.relative_velocity])
    assert np.array_equal(record._without_phase, expected)


@pytest.mark.parametrize("machine", MACHINES)
def test_derivatives_over_the_last_periods_are_those_of_the_whole_run(
    machine: ImpactOscillator,
) -> None:
    run = machine.simulate(impacts=40)._run
    found = returned(machine, run, [33, 36, 39])
    assert np.array_equal(found, returned(machine, run, [0, 33, 36, 39])[1:])
