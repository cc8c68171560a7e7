"""Figures of records and of periodic orbits of impact oscillators."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.plotting.points import displacement, draw_motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.orbits.driven import DrivenOrbit
    from dynkit.systems.impact.record import ImpactRecord

# Samples in each period; periods drawn at most, at least where the motion ended by itself, and
# after its last impact then.
_SAMPLES, _MOST, _LEAST, _AFTER = 100, 1000, 12, 2

# Positions that are worked out at a time.
_NUMBERS = 2**20


def draw_record(record: ImpactRecord, ax: Axes | None) -> Axes:
    """Draw the motion of a record as `ImpactRecord.plot` says."""
    from dynkit.systems.impact.trajectory import Ending

    system = record.system
    period = 2.0 * math.pi / system.frequency
    end = float(record.time[-1]) if len(record) else 0.0
    if record.ending in (Ending.NO_FURTHER_CONTACT, Ending.CONTACT_FOR_EVER):
        end = max(end + _AFTER * period, _LEAST * period)
    end = min(end, _MOST * period)
    impacts = record.time[record.time <= end]
    return _draw(ax, system, record, record.start.phase, end, impacts)


def draw_orbit(orbit: DrivenOrbit, ax: Axes | None) -> Axes:
    """Draw one period of an orbit as `DrivenOrbit.plot` says."""
    begin, end = float(orbit.phases[0]), orbit.period
    return _draw(ax, orbit.system, orbit, begin, end, orbit._impact_times)


def _draw(
    ax: Axes | None, system: ImpactMap, motion: Any, phase: float, end: float, impacts: Array
) -> Axes:
    count = math.ceil(_SAMPLES * end * system.frequency / (2.0 * math.pi)) + 1
    times = np.union1d(np.linspace(0.0, end, count), impacts)
    contact = system.contact % system.degrees_of_freedom
    parts = np.array_split(times, 1 + len(times) * system.degrees_of_freedom // _NUMBERS)
    place = np.concatenate([motion.sample(part)[0][:, contact] for part in parts])
    table = system.amplitude * np.sin(phase + system.frequency * times)
    stops = [table + stand.offset for stand in system._stands]
    at = place[np.searchsorted(times, impacts)]
    return draw_motion(ax, times, place, displacement(contact), stops, (impacts, at))
