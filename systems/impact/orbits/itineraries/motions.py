"""Motions that a search for orbits without a closed form starts from."""

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
"""Random starts that are tried at most: some are beyond a stop."""

_FAR = 1e3
"""How many times as large as its last part a motion is where it is a transient from far away."""

SWITCHES = 32
"""Switches of soft stops and friction, for each impact of a motion, after which that is left."""


class Effort(NamedTuple):
    """How much is simulated: parts of the motion from the first start, of so many impacts each.

    And as many impacts from each of some random starts.
    """

    parts: int
    impacts: int
    starts: int


FEW, MANY = Effort(5, 200, 10), Effort(10, 300, 20)


def simulated_motions(oscillator: ImpactMap, effort: Effort = FEW) -> Iterator[ImpactRecord]:
    """The motion from a start at the machine's own length in parts, then those from random starts.

    As a motion may be chaotic, it comes near to other orbits in each part. Random starts have
    coordinates up to twice as large as the largest of the former motion. Parts of a transient from
    far away are left out. The same orbits are found whatever the units.
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
