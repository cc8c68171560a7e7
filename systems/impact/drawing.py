"""Figures of records and of periodic orbits of impact oscillators."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

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
    """Draw what the stops act along, the stops and the impacts, from a phase of the table on."""
    count = math.ceil(_SAMPLES * end * system.frequency / (2.0 * math.pi)) + 1
    times = np.union1d(np.linspace(0.0, end, count), impacts)
    first = system._elements[0]
    row = first.row(system.degrees_of_freedom)
    stops = [stop for stop in system._stops if stop.coordinate == first.coordinate]
    parts = np.array_split(times, 1 + len(times) * system.degrees_of_freedom // _NUMBERS)
    place = np.concatenate([sample(part)[0] @ row for part in parts])
    turn = phase + system.frequency * times
    places = [stop.swing(np.sin(turn), np.cos(turn)) + stop.offset for stop in stops]
    at = place[np.searchsorted(times, impacts)]
    return draw_motion(ax, times, place, _named(first.coordinate), places, (impacts, at))


def _named(along: Any) -> str:
    """How what a stop acts along is written on an axis."""
    if isinstance(along, int):
        return displacement(along)
    if isinstance(along[0], int):
        return f"displacement $x_{{{along[1] + 1}}} - x_{{{along[0] + 1}}}$"
    return "displacement $J x$"
