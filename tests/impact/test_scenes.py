"""Forces, contact anywhere, play, rigid bodies and resonance against 50 digits."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.reference.general_oscillator import BITS, GeneralOscillator, History

ONE = {"M": [[1.0]], "C": [[0.0]], "K": [[1.0]]}
BALL = {"M": [[1.0]], "C": [[0.0]], "K": [[0.0]], "constant_forces": (-1.0,)}
CHAIN = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
LOOSE = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
BRANCH = np.array([[2.0, -1.0, -1.0], [-1.0, 1.5, 0.0], [-1.0, 0.0, 1.5]])
THREE = {"M": np.eye(3), "C": 0.1 * CHAIN, "K": CHAIN, "start": (0.2, 0.5, 0.3)}
FREE = {"M": np.eye(3), "K": LOOSE, "constant_forces": (-0.1, -0.1, -0.2), "start": (1.2, 1.5, 1.3)}
PUSHED = {"harmonic_forces": (0.0, 0.1j, 0.2), "constant_forces": (0.0, -0.1, -0.2)}

SCENES: dict[str, dict[str, Any]] = {
    "ball on a stop": {**BALL, "amplitude": 0.0, "restitution": 0.8, "start": (1.0,)},
    "ball on a table": {**BALL, "frequency": 3.0, "restitution": 0.8, "start": (1.0,)},
    "ball in a fluid": {**BALL, "C": [[0.3]], "frequency": 3.0, "start": (1.0,)},
    "ball below a table": {
        **BALL,
        "constant_forces": (1.0,),
        "side": "below",
        "frequency": 3.0,
        "start": (-1.0,),
    },
    "ball that comes to rest on a table": {
        **BALL,
        "frequency": 1.7,
        "amplitude": 0.4,
        "restitution": 0.2,
        "start": (0.5,),
        "impacts": 100,
    },
    "force on one mass": {
        **ONE,
        "C": [[0.1]],
        "harmonic_forces": (1.0,),
        "amplitude": 0.0,
        "offset": -0.5,
        "frequency": 2.1,
        "start": (0.0,),
    },
    "at resonance": {
        **ONE,
        "harmonic_forces": (0.3 + 0.1j,),
        "amplitude": 0.0,
        "offset": -1.5,
        "frequency": 1.0,
        "start": (0.0,),
    },
    "a billionth beside resonance": {
        **ONE,
        "harmonic_forces": (0.3 + 0.1j,),
        "amplitude": 0.0,
        "offset": -1.5,
        "frequency": 1.0 + 1e-9,
        "start": (0.0,),
    },
    "near resonance, hardly damped": {
        **ONE,
        "C": [[1e-5]],
        "harmonic_forces": (0.3 + 0.1j,),
        "offset": -1.5,
        "frequency": 1.0 + 1e-4,
        "start": (0.0,),
    },
    "play": {
        **ONE,
        "C": [[0.1]],
        "harmonic_forces": (1.0,),
        "amplitude": 0.0,
        "offset": -0.5,
        "play": 1.1,
        "frequency": 2.1,
        "restitution": 0.8,
        "start": (0.0,),
        "impacts": 20,
    },
    "free mass in a moving housing": {
        "M": [[1.0]],
        "C": [[0.0]],
        "K": [[0.0]],
        "amplitude": 0.3,
        "offset": -0.5,
        "play": 1.1,
        "frequency": 2.1,
        "restitution": 0.7,
        "start": (-0.3,),
        "impacts": 20,
    },
    "sticking on both sides of a play": {
        "M": [[1.0]],
        "C": [[0.0]],
        "K": [[0.0]],
        "amplitude": 0.8,
        "offset": -0.8,
        "play": 1.0,
        "frequency": 1.3,
        "restitution": 0.1,
        "start": (-0.3,),
        "impacts": 100,
    },
    "contact in the middle": {**THREE, "contact": 1, "frequency": 0.9},
    "contact in the middle, forces": {
        **THREE,
        **PUSHED,
        "C": np.diag([0.1, 0.0, 0.3]),
        "contact": 0,
        "frequency": 0.9,
    },
    "sticking in the middle": {
        **THREE,
        "contact": 1,
        "frequency": 0.4,
        "restitution": 0.3,
        "impacts": 150,
    },
    "sticking for ever under forces": {
        **THREE,
        **PUSHED,
        "contact": 1,
        "frequency": 0.4,
        "restitution": 0.3,
        "impacts": 150,
    },
    "sticking below": {
        **THREE,
        "side": "below",
        "start": (-0.2, -0.5, -0.3),
        "frequency": 0.4,
        "restitution": 0.3,
        "impacts": 150,
    },
    "free-free": {**FREE, "C": 0.0 * LOOSE, "frequency": 0.9},
    "free-free, damped": {**FREE, "C": 0.2 * LOOSE, "frequency": 0.9},
    "free-free, held by a dashpot": {**FREE, "C": np.diag([0.0, 0.5, 0.0]), "frequency": 0.9},
    "free-free, sticking": {
        **FREE,
        "C": 0.2 * LOOSE,
        "frequency": 0.2,
        "restitution": 0.2,
        "impacts": 150,
    },
    "a mode that the contact cannot see": {
        "M": np.eye(3),
        "C": 0.1 * BRANCH,
        "K": BRANCH,
        "contact": 0,
        "frequency": 0.9,
        "start": (0.5, 0.2, -0.3),
    },
    "driven on the table at resonance": {
        "M": np.eye(2),
        "C": np.zeros((2, 2)),
        "K": [[2.0, -1.0], [-1.0, 1.0]],
        "frequency": math.sqrt(2.0),
        "restitution": 0.0,
        "start": (0.3, 0.4),
    },
    "a fast small table": {
        **ONE,
        "C": [[0.1]],
        "amplitude": 1e-3,
        "frequency": 1e4,
        "start": (1.0,),
        "impacts": 6,
    },
    "a slow table": {**ONE, "C": [[0.1]], "frequency": 1e-3, "start": (1.0,), "impacts": 6},
}


@cache
def simulated(name: str) -> tuple[ImpactRecord, GeneralOscillator, History]:
    """The scene by both simulators, from the same doubles; enough of the exact bounces."""
    scene = {"impacts": 12, "frequency": 1.0, **SCENES[name]}
    start, impacts = scene.pop("start"), scene.pop("impacts")
    system = MatrixOscillator(**scene)
    begin = system.state(start, phase=0.3)
    record = system.simulate(impacts=impacts, start=begin)
    far = None if system.play == math.inf else system.offset + system.play
    reference = GeneralOscillator(
        system.M,
        system.C,
        system.K,
        system.frequency,
        system.restitution,
        system.amplitude,
        system.offset,
        contact=system.contact % len(system.M),
        side="above" if system.side == "above" else "below",
        harmonic_forces=system.harmonic_forces,
        constant_forces=system.constant_forces,
        far_stop=far,
    )
    exact = reference.simulate(
        begin.position.tolist(), begin.velocity.tolist(), begin.phase, impacts
    )
    return record, reference, exact


def exact_states(record: ImpactRecord, exact: History) -> tuple[Array, Array]:
    """Errors (k, 2N) of section coordinates and (k,) of times, of what both simulated.

    The exact motion bounces on where the record replaced the bounces by contact.
    """
    system = record.system
    c = system.contact % system.degrees_of_freedom
    times = np.array([float(impact.time) for impact in exact.impacts])
    states, late = [], []
    with mp.workprec(BITS):
        for i, time in enumerate(record.time.tolist()):
            if time > times[-1] + 1e-9:
                break
            impact = exact.impacts[int(np.argmin(abs(times - time)))]
            others = [j for j in range(len(impact.position)) if j != c]
            sign = -1 if impact.side == "far" else 1
            row = [impact.position[j] for j in others] + [impact.velocity[j] for j in others]
            row += [sign * impact.relative_velocity, impact.phase]
            off = [mpf(a) - b for a, b in zip(record.states[i].tolist(), row, strict=True)]
            off[-1] -= 2 * mp.pi * mp.nint(off[-1] / (2 * mp.pi))
            states.append([float(e) for e in off])
            late.append(float(mpf(time) - impact.time))
    return abs(np.array(states)), abs(np.array(late))


@pytest.mark.parametrize("name", SCENES)
def test_impacts_are_off_by_less_than_the_record_says(name: str) -> None:
    record, _, exact = simulated(name)
    states, late = exact_states(record, exact)
    assert len(states) >= min(6, len(record))
    assert (states.max(axis=1) <= record.error[: len(states)]).all()
    frequency = record.system.frequency
    # the phase of a fast table is known to some roundings of the time, whatever the processor
    of_time = 8.0 * frequency * np.spacing(record.time[len(states) - 1])
    assert record.error[: len(states)].max() < max(1e-10, of_time)
    rounding = 4.0 * np.spacing(record.time[: len(late)])
    assert (late <= record.error[: len(late)] / min(frequency, 1.0) + rounding).all()


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.plain
def test_scenes_end_as_they_do(name: str) -> None:
    record, _, exact = simulated(name)
    endings = {
        Ending.COUNT_REACHED: "count",
        Ending.NO_FURTHER_CONTACT: "no further contact",
        Ending.CONTACT_FOR_EVER: "contact for ever",
    }
    if exact.ending != "count":
        assert endings[record.ending] == exact.ending
    if not len(record.sticking):
        assert len(record) == len(exact.impacts)


@pytest.mark.parametrize("name", [name for name in SCENES if "rest" in name or "stick" in name])
@pytest.mark.plain
def test_contacts_begin_and_end_when_they_do(name: str) -> None:
    record, _, exact = simulated(name)
    assert exact.contacts
    for (begin, end), contact in zip(record.sticking.tolist(), exact.contacts, strict=False):
        assert begin == pytest.approx(float(contact.start), abs=1e-12)
        assert end == pytest.approx(float(contact.release), abs=1e-12)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.plain
def test_motion_between_impacts_is_sampled_exactly(name: str) -> None:
    record, reference, exact = simulated(name)
    last = min(record.time[-1], float(exact.impacts[-1].time))
    times = np.linspace(0.0, last, 23)[1:-1]
    positions, velocities = record.sample(times)
    error = record.error.max()
    forces = 10.0 + record.system.amplitude * record.system.frequency**2
    for time, x, v in zip(times.tolist(), positions, velocities, strict=True):
        exact_x, exact_v = reference.state_at(exact, time)
        allowed = error + 1e-14 * (1.0 + abs(x).max())
        assert x == pytest.approx([float(a) for a in exact_x], abs=allowed)
        allowed += forces * 4.0 * np.spacing(time)
        assert v == pytest.approx([float(a) for a in exact_v], abs=allowed)
