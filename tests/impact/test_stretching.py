"""Stretching along motions with several elements: derivatives of many impacts from one run."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit.analysis import LyapunovSpectrum
from dynkit.systems import DryFriction, HardStop, ImpactChain, Jenkins, SoftStop
from dynkit.systems.impact.impact_map import _FEW

TABLE = HardStop(2, amplitude=0.1, restitution=0.85, name="table")
MACHINES: dict[str, tuple[float, list[Any]]] = {
    "two stops, one of which holds": (0.35, [TABLE, HardStop(0, offset=-0.05, restitution=0.1)]),
    "friction that sticks": (0.35, [TABLE, DryFriction(0, force=0.1, static=0.15)]),
    "friction at the stop": (0.35, [TABLE, DryFriction(1, coefficient=0.3, normal="table")]),
    "all kinds": (
        0.35,
        [
            TABLE,
            HardStop((0, 1), offset=-0.2, restitution=0.5),
            SoftStop(1, offset=-0.3, stiffness=50.0, damping=0.2),
            Jenkins(1, stiffness=2.0, force=0.1),
            DryFriction(0, force=0.02, static=0.03, velocity=0.1),
        ],
    ),
    "friction that always sticks": (0.9, [TABLE, DryFriction(0, force=0.3)]),
    "no hard stop": (
        0.8,
        [
            SoftStop(2, amplitude=0.2, offset=0.1, stiffness=30.0, damping=0.1),
            Jenkins(0, stiffness=2.0, force=0.05),
        ],
    ),
}


def machine(name: str) -> ImpactChain:
    frequency, elements = MACHINES[name]
    return ImpactChain(masses=3, frequency=frequency, elements=elements)


@pytest.mark.parametrize("name", MACHINES)
def test_derivatives_of_one_run_are_those_from_each_impact_anew(name: str) -> None:
    system = machine(name)
    count = 3 * _FEW // 2  # a second run is longer
    states = system.attractor(transient=60, impacts=count + 1).states
    here, done = states[0], 0
    while done < count:
        here, found, times = system._followed(here, count - done)
        assert 0 < len(found) == len(times) <= count - done
        for (factor,), *_ in found:
            anew = system.jacobian(states[done])
            assert abs(factor - anew).max() < 1e-9 * max(1.0, abs(anew).max())
            done += 1
        assert abs(system.difference(here, states[done])).max() < 1e-9
        last = states[done - len(times) : done]
        assert times == pytest.approx([system.return_time(state) for state in last], rel=1e-9)


@pytest.mark.parametrize("name", MACHINES)
def test_exponents_of_any_machine_are_known_by_time(name: str) -> None:
    system = machine(name)
    attractor = system.attractor(transient=60, impacts=20)
    spectrum = LyapunovSpectrum(attractor, iterations=160)
    again = system.stretching(attractor.final, 200)
    assert again.times is not None
    run = system.simulate(impacts=20, start=attractor.final)
    assert again.times[:20] == pytest.approx(np.diff(run.time, prepend=0.0), rel=1e-9)
    known = np.isfinite(spectrum.exponents) & (abs(spectrum.exponents) > 1e-3)
    durations = spectrum.exponents[known] / spectrum.per_time[known]
    assert known.any()
    assert durations == pytest.approx(durations[0], rel=1e-9)
    assert durations[0] == pytest.approx(again.times[100:].mean(), rel=0.05)
