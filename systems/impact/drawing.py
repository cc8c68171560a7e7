"""Figures of records and of periodic orbits of impact oscillators."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.validation import Array
from dynkit.plotting.points import displacement, draw_motion
from dynkit.systems.impact.trajectory import Ending

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.systems.impact.impact_map import ImpactMap

# Samples in each period; periods drawn at most, at least where the motion ended by itself, and
# after its last impact then.
_SAMPLES, _MOST, _LEAST, _AFTER = 100, 1000, 12, 2

# Positions that are worked out at a time.
_NUMBERS = 2**20


def shown_until(period: float, time: Array, ending: Ending) -> float:
    """Up to when the motion of a record is drawn, as `ImpactRecord.plot` says."""
    end = float(time[-1]) if len(time) else 0.0
    if ending in (Ending.NO_FURTHER_CONTACT, Ending.CONTACT_FOR_EVER):
        end = max(end + _AFTER * period, _LEAST * period)
    return min(end, _MOST * period)


def draw(
    ax: Axes | None,
    system: ImpactMap,
    sample: Callable[[Array], tuple[Array, Array]],
    phase: float,
    end: float,
    impacts: Array,
) -> Axes:
    """Draw the contact coordinate, the stops and the impacts, from a phase of the table on."""
    count = math.ceil(_SAMPLES * end * system.frequency / (2.0 * math.pi)) + 1
    times = np.union1d(np.linspace(0.0, end, count), impacts)
    contact = system.contact % system.degrees_of_freedom
    parts = np.array_split(times, 1 + len(times) * system.degrees_of_freedom // _NUMBERS)
    place = np.concatenate([sample(part)[0][:, contact] for part in parts])
    table = system.amplitude * np.sin(phase + system.frequency * times)
    stops = [table + stop.offset for stop in system._stops]
    at = place[np.searchsorted(times, impacts)]
    return draw_motion(ax, times, place, displacement(contact), stops, (impacts, at))
