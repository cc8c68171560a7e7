"""Coulomb friction at the contact with a hard stop: closed forms, many digits, and what is open."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpmath import mp

from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, MatrixOscillator
from tests.reference.soft_stops import DIGITS, SoftStopReference


def random_machine(seed: int, restitution: float) -> tuple[MatrixOscillator, Array, Array]:
    """Two to four masses on springs that couple all of them, with stops and friction at them."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 5))
    root = random.normal(size=(n, n))
    springs = root @ root.T + np.diag(random.uniform(0.1, 2.0, n))
    rows = random.permutation(n)
    tables = 1 if n < 4 else int(random.integers(1, 3))
    elements: list[Any] = []
    for k in range(tables):
        name = f"table{k}"
        elements.append(
            HardStop(
                rows[2 * k],
                offset=random.uniform(-0.2, 0.1),
                amplitude=random.choice([0.0, 0.15]),
                phase=random.uniform(-3.0, 3.0),
                restitution=restitution,
                side=str(random.choice(["above", "below"])),
                name=name,
            )
        )
        coefficient = random.uniform(0.05, 0.9)
        elements.append(
            DryFriction(
                rows[2 * k + 1],
                coefficient=coefficient,
                static=coefficient * random.choice([1.0, random.uniform(1.0, 1.8)]),
                normal=name,
                velocity=random.choice([0.0, random.uniform(-0.5, 0.5)]),
                amplitude=random.choice([0.0, random.uniform(0.0, 0.4)]),
                phase=random.uniform(-3.0, 3.0),
                slope=random.choice([0.0, random.uniform(0.0, 0.3)]),
                side=str(random.choice(["above", "below"])),
            )
        )
    pushed = np.zeros(n)
    for stop in elements[::2]:
        pushed[stop.coordinate] = -stop.sign * random.uniform(0.5, 2.0)
    damping = 0.1 * springs if random.random() < 0.5 else np.diag(random.uniform(0.0, 0.2, n))
    machine = MatrixOscillator(
        M=np.diag(random.uniform(0.5, 2.0, n)),
        C=damping,
        K=springs,
        frequency=random.uniform(0.4, 1.6),
        harmonic_forces=random.normal(size=n),
        constant_forces=pushed,
        elements=[elements[k] for k in random.permutation(len(elements))],
    )
    place = random.normal(size=n)
    for stop in machine._stops:
        place[stop.coordinate] = stop.offset + stop.sign * (0.3 + abs(random.normal()))
    return machine, place, random.normal(size=n)


@pytest.mark.parametrize("restitution", [0.0, 0.6])
@pytest.mark.parametrize("seed", range(24))
def test_random_machines_move_as_in_many_digits(seed: int, restitution: float) -> None:
    machine, place, velocity = random_machine(seed, restitution)
    record = machine.simulate(impacts=6, start=machine.state(place, velocity))
    run = record._run
    cut = run.switches.before[run.switches.speed > 0.0]  # the reference does not end chatter
    count = min([len(record), *cut.tolist()])
    assert count >= 1
    start = np.concatenate([place, velocity])
    with mp.workdps(DIGITS):
        reference = SoftStopReference(machine, 0.01)
        found = reference.impacts(start, count)
        states = np.array([[float(number) for number in z] for _, z in found])
        times = record.time[:count].tolist()
        late = [abs(float(t - mp.mpf(o))) for (t, _), o in zip(found, times, strict=True)]
    motion = np.concatenate([record.position, record.velocity], axis=1)[:count]
    apart = abs(motion - states[:, : machine.dimension]).max(axis=1)
    assert (apart <= record.error[:count]).all()
    assert (np.array(late) * machine.frequency <= record.error[:count] + 2.0**-48).all()
