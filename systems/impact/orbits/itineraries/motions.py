"""Motions that a search for orbits without a closed form starts from."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.state import TWO_PI, ImpactState

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

STARTS, _TRIED = 10, 200
"""Random starts, of so many that are tried at most: some are beyond a stop."""

PARTS, PART = 5, 200
"""Parts of the motion from the default start, and impacts of each, and of the other motions."""

SWITCHES = 32
"""Switches of soft stops and friction, for each of these impacts, after which a motion is left."""


def simulated_motions(oscillator: ImpactMap) -> Iterator[ImpactRecord]:
    """The motion from the default start in parts, then those from random starts.

    These have coordinates up to twice as large as the largest of the former motion.
    """
    n, size = oscillator.degrees_of_freedom, np.zeros(2 * oscillator.degrees_of_freedom)
    with suppress(NoMotion):
        state = oscillator.state()
        for _ in range(PARTS):
            record = _part(oscillator, state)
            state = record.final
            motion = np.concatenate([record.position, record.velocity], axis=1)
            size = np.maximum(size, abs(motion).max(axis=0, initial=0.0))
            yield record
    size[size == 0.0] = 1.0
    random, left = np.random.default_rng(0), STARTS
    for _ in range(_TRIED):
        x, v = np.split(2.0 * size * random.uniform(-1.0, 1.0, 2 * n), 2)
        phase = random.uniform(0.0, TWO_PI)
        with suppress(NoMotion):
            yield _part(oscillator, oscillator.state(x, v, phase))
            left -= 1
        if not left:
            return


def _part(oscillator: ImpactMap, start: ImpactState) -> ImpactRecord:
    run = oscillator._run(start, PART, store=True, most_switches=SWITCHES * PART)
    return ImpactRecord(oscillator, run)
