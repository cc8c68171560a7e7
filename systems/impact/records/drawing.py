"""Figures of records and of periodic orbits of impact oscillators."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.plotting.figures import ink, print_style
from dynkit.plotting.points import displacement, draw_motion
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.impact.records.event_counts import element_names
from dynkit.systems.impact.simulation.trajectory import Ending, Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.systems.impact.impact_map import ImpactMap

# Samples in each period; largest number of periods drawn; for a motion that ended by itself, the
# smallest number of periods, and the number drawn after its last impact.
_SAMPLES, _MOST, _LEAST, _AFTER = 100, 1000, 12, 2

# Number of positions that are computed at a time.
_NUMBERS = 2**20


def shown_until(period: float, run: Trajectory) -> float:
    """Time up to which the motion of a record is drawn by default; see `ImpactRecord.plot`."""
    end = float(run.time[-1]) if len(run.time) else 0.0
    alone = Ending.NO_FURTHER_CONTACT, Ending.CONTACT_FOR_EVER, Ending.CYCLE_ENDED
    if run.ending in alone or run.searched > run.duration:
        end = max(end + _AFTER * period, _LEAST * period)
    return min(end, _MOST * period)


def draw(
    ax: Axes | None,
    system: ImpactMap,
    sample: Callable[[Array], tuple[Array, Array]],
    phase: float,
    end: float,
    impacts: Array,
    along: Element | None = None,
    begin: float = 0.0,
) -> Axes:
    """Draw the coordinate of an element, the stops there and the impacts; `phase` is at time 0."""
    count = math.ceil(_SAMPLES * (end - begin) * system.frequency / (2.0 * math.pi)) + 1
    times = np.union1d(np.linspace(begin, end, count), impacts)
    first = system._elements[0] if along is None else along
    number = next(k for k, element in enumerate(system._elements) if element == first)
    function = system._functions[number]
    parts = np.array_split(times, 1 + len(times) * system.degrees_of_freedom // _NUMBERS)
    place = np.concatenate([function(sample(part)[0]) for part in parts])
    turn = phase + system.frequency * times
    named = zip(element_names(system), system._elements, strict=True)
    places = {
        name.replace("_", " "): stop.swing(np.sin(turn), np.cos(turn)) + stop.offset
        for name, stop in named
        if stop.coordinate == first.coordinate and "sticks" not in stop.doing
    }
    at = place[np.searchsorted(times, impacts)]
    return draw_motion(ax, times, place, _named(first.coordinate), places, (impacts, at))


@print_style()
def shade(ax: Axes, run: Trajectory, along: Element, begin: float, end: float) -> None:
    """Shade contact and pressing of elements on the same coordinate; hatch sticking."""
    regimes = np.array(run.regimes)[run.segments.mode]
    begins = np.append(run.segments.begin, np.inf).clip(begin, end)
    for k, element in enumerate(run.start._system._elements):
        if element.coordinate != along.coordinate:
            continue
        doing = np.array(element.doing)[regimes[:, k]]
        for what, label, face, hatch in _SHADES:
            (now,) = np.nonzero((doing == what) & (np.diff(begins) > 0.0))
            spans = list(zip(begins[now], np.diff(begins)[now], strict=True))
            if spans:
                ax.broken_barh(
                    spans,
                    (0.0, 1.0),
                    transform=ax.get_xaxis_transform(),
                    linewidth=0.0,
                    zorder=0.0,
                    label=label,
                    facecolor=ink(face),
                    edgecolor=ink(0.6),
                    hatch=hatch,
                )


_SHADES = (
    ("contacts", "in contact", 0.75, None),
    ("presses", "pressed", 0.9, None),
    ("sticks", "sticks", 1.0, "////"),
)


def _named(along: Any) -> str:
    """Label of an axis for the coordinate along which a stop acts."""
    if isinstance(along, str):
        return along
    if isinstance(along, int):
        return displacement(along)
    if isinstance(along[0], int):
        return f"displacement $x_{{{along[1] + 1}}} - x_{{{along[0] + 1}}}$"
    return "displacement $J x$"
