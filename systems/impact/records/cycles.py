"""How long a period of a motion lasts, also where nothing drives it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynkit.labels.label import OrbitLabel
from dynkit.systems.impact.simulation.runs import course_from
from dynkit.systems.impact.simulation.state import TWO_PI, ImpactState

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

# Twin runs for the error, the size of their disturbances, and the factor on the distance they
# reach, as for `ImpactRecord.error`; the factor on what the motion is still away from its orbit.
_TWINS, _NOISE, _SAFETY, _SETTLING = 3, 2.0**-49, 4.0, 2.0


def period_of(system: ImpactMap, start: ImpactState, label: OrbitLabel) -> tuple[float, float]:
    """The period of a periodic motion, and an estimate of its error, from a state on its section.

    Where nothing drives it two periods are simulated. The error is what rounding does, as twin runs
    say, and what the second period changes, summed up over all periods to come.
    """
    if label.periods is not None:
        length = label.periods * TWO_PI / system.frequency
        return length, 2.0**-52 * length
    n = label.iterates or 1

    def twice(noise: float, seed: int) -> tuple[float, float]:
        course = course_from(system, start, noise=noise, seed=seed)
        times = course.advance(2 * n, store=True).time
        return float(times[n - 1]), float(times[2 * n - 1] - times[n - 1])

    own = twice(0.0, 1)
    apart = abs(np.subtract([twice(_NOISE, seed) for seed in range(1, _TWINS + 1)], own)).max()
    change, left = abs(own[1] - own[0]), 1.0 - label.multiplier
    if label.stable:
        change *= _SETTLING / min(left, 1.0)
    return own[0], _SAFETY * float(apart) + change + 2.0**-51 * own[0]
