"""What a sweep does at each value in its own ways: a proof of stability, or the bits of others."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit.systems import ImpactChain, SingleImpactOscillator
from dynkit.systems.impact.variational.tangents import settles


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
