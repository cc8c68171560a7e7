"""The period of a periodic motion, also of an undriven machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynkit.labels.label import OrbitLabel
from dynkit.systems.impact.simulation.runs import course_from
from dynkit.systems.impact.simulation.state import TWO_PI, ImpactState

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

# Number of disturbed runs for the error, relative size of the disturbances, and factor on their
# largest distance, as for `ImpactRecord.error`; factor on the distance of the motion to its orbit.
_TWINS, _NOISE, _SAFETY, _SETTLING = 3, 2.0**-49, 4.0, 2.0


def period_of(system: ImpactMap, start: ImpactState, label: OrbitLabel) -> tuple[float, float]:
    """The period of a periodic motion, and an estimate of its error, from a state on its section.

    For an undriven machine two periods are simulated. The error is the sum of two estimates. The
    effect of rounding is estimated from disturbed runs. The distance of the motion to its orbit is
    the change from the first to the second period, summed over all later periods.
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
