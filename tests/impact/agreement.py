"""Random chains, and motions of machines against the same in 60 digits."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems import HardStop, ImpactChain, SoftStop
from tests.validation.machines import Comparison, compared


def moves_as_in_many_digits(
    machine: Any, position: Array, velocity: Array, *, impacts: int, most: float
) -> Comparison:
    """Assert that events are the same, and states and times within errors; states within `most`."""
    start = machine.state(position, velocity)
    found = compared(machine, start, impacts=impacts)
    assert not found.wrong
    assert found.states
    assert all(actual <= claimed for actual, claimed in (*found.states, *found.times))
    assert max(actual for actual, _ in found.states) < most
    record = machine.simulate(impacts=len(found.states), start=start)
    x, v = record.sample(record.time)
    assert abs(np.concatenate([x - record.position, v - record.velocity])).max() < most
    return found


def random_chain(
    random: np.random.Generator, n: int, elements: list[Any], *, hit: bool
) -> tuple[ImpactChain, Array, Array]:
    """A chain of n masses with elements, perhaps a soft stop, and a hard one or none; its start."""
    if random.random() < 0.5:
        dashpot = random.choice([0.0, 0.3])
        elements.append(
            SoftStop(0, offset=-0.2, stiffness=random.uniform(0.5, 9.0), damping=dashpot)
        )
    if hit:
        r = random.choice([0.0, random.uniform(0.3, 0.9)])
        elements.append(HardStop(n - 1, offset=-0.2, amplitude=0.2, restitution=r))
    chain = ImpactChain(
        masses=tuple(random.uniform(0.5, 2.0, n).tolist()),
        damping=random.choice([0.0, 0.1]),
        frequency=random.uniform(0.4, 1.6),
        harmonic_forces=random.normal(size=n),
        constant_forces=0.3 * random.normal(size=n) - [*[0.0] * (n - 1), 0.5 * hit],
        elements=[elements[k] for k in random.permutation(len(elements))],
    )
    place = random.normal(size=n)
    place[-1] = 0.3 + abs(place[-1])
    return chain, place, random.normal(size=n)


def omitted_bounces_are_within_the_error(system: Any, **start: Any) -> None:
    """Assert that the bounces omitted from a chatter change no more than its record says."""
    runs = []
    for tolerance in (1e-8, 1e-20):
        changed = system.replace(chatter_tolerance=tolerance)
        record = changed.simulate(impacts=60, start=changed.state(**start))
        begin, end = record.sticking[0]
        assert 1e-3 * tolerance < record.chatter_error
        runs.append((record, begin, end))
    (coarse, begin, end), (fine, exact_begin, exact_end) = runs
    assert abs(begin - exact_begin) < 1e-4 * (end - begin)
    times = np.linspace(begin, min(end, exact_end), 6)[1:-1]
    for a, b in zip(coarse.sample(times), fine.sample(times), strict=True):
        assert abs(a - b).max() <= 2.0 * coarse.chatter_error + 1e-13
