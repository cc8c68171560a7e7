"""Simulated motions from which a search for orbits without a closed form starts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.starts import own_start
from dynkit.systems.impact.simulation.state import TWO_PI, ImpactState

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

_TRIED = 200
"""Largest number of random starts tried: some are beyond a stop."""

_FAR = 1e3
"""A part of a motion larger than its last part by this factor is a transient from far away."""

SWITCHES = 32
"""Largest number of switches of soft stops and friction, per impact, of a simulated motion."""


class Effort(NamedTuple):
    """Amount of simulation: parts of the motion from the first start, and random starts.

    Each part, and each motion from a random start, has `impacts` impacts.
    """

    parts: int
    impacts: int
    starts: int


FEW, MANY = Effort(5, 200, 10), Effort(10, 300, 20)


def simulated_motions(oscillator: ImpactMap, effort: Effort = FEW) -> Iterator[ImpactRecord]:
    """Yield the motion from a start at the machine's own length, in parts, then random motions.

    A chaotic motion comes near to other orbits in each part. Random starts have coordinates up to
    twice as large as the largest ones of the first motion. Parts of a transient from far away are
    left out. The orbits found do not depend on the units.
    """
    n, length, parts = oscillator.degrees_of_freedom, oscillator._length, []
    with suppress(NoMotion):
        state = own_start(oscillator)
        for _ in range(effort.parts):
            parts.append(_simulated(oscillator, state, effort.impacts))
            state = parts[-1].final
    motions = [np.concatenate([part.position, part.velocity], axis=1) for part in parts]
    sizes = np.array([abs(motion).max(axis=0, initial=0.0) for motion in motions])
    sizes = sizes.reshape(-1, 2 * n)
    lengths = sizes[:, :n].max(axis=1)
    near = (lengths <= _FAR * lengths[-1:]) | (lengths[-1:] == 0.0)
    yield from (part for part, kept in zip(parts, near, strict=True) if kept)
    size = sizes[near].max(axis=0, initial=0.0)
    size = np.where(size > 0.0, size, np.repeat([length, length * oscillator.frequency], n))
    random, left = np.random.default_rng(0), effort.starts
    for _ in range(_TRIED):
        x, v = np.split(2.0 * size * random.uniform(-1.0, 1.0, 2 * n), 2)
        phase = random.uniform(0.0, TWO_PI)
        with suppress(NoMotion):
            yield _simulated(oscillator, oscillator.state(x, v, phase), effort.impacts)
            left -= 1
        if not left:
            return


def _simulated(oscillator: ImpactMap, state: ImpactState, impacts: int) -> ImpactRecord:
    run = oscillator._run(state, impacts, store=True, most_switches=SWITCHES * impacts)
    return ImpactRecord(oscillator, run)
