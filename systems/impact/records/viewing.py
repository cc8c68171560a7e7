"""Time series of impact oscillators for pages in the browser."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.records.drawing import shown_until
from dynkit.systems.impact.records.event_counts import element_names
from dynkit.viewer.page import Page, page_of_section
from dynkit.viewer.series import Series

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

PERIODS = 12
"""Periods of the forcing that are shown for a motion that is not periodic."""

# An impact that is closer than this to the end time, relative to it, is shown.
_ROUNDING = 1e-6
# Largest numbers of samples in one period, of samples of a motion, and of masses.
_SAMPLES, _MOST_SAMPLES, _MASSES = 120, 600, 24


_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


def series_of(
    system: ImpactMap,
    sample: Callable[[Array], tuple[Array, Array]],
    phase: float,
    end: float,
    impacts: Array,
) -> Series:
    """Return the motion up to the time `end`, with its impacts; `phase` is the phase at time 0.

    Velocities jump at impacts; therefore there are two samples at each impact.
    """
    turns = end * system.frequency / (2.0 * math.pi)
    count = int(np.clip(math.ceil(_SAMPLES * turns), _SAMPLES, _MOST_SAMPLES)) + 1
    last = impacts[abs(impacts - end) <= _ROUNDING * end]
    end = float(last[-1]) if len(last) else end
    impacts = impacts[(impacts > 0.0) & (impacts <= end)]
    before = np.nextafter(impacts, 0.0)
    times = np.unique(np.concatenate([np.linspace(0.0, end, count), before, impacts]))
    position, velocity = sample(times)
    n, first = system.degrees_of_freedom, system._elements[0]
    of_first = first.coordinate if isinstance(first.coordinate, int) else n - 1
    along = of_first % n
    masses = sorted({along, *np.rint(np.linspace(0, n - 1, min(n, _MASSES))).astype(int).tolist()})
    columns = {_named("x", k): position[:, k] for k in masses}
    columns[_named("v", along)] = velocity[:, along]
    turn, stops, shown = phase + system.frequency * times, [], [_named("x", along)]
    for name, stop in zip(element_names(system), system._elements, strict=True):
        where: Any = stop.coordinate
        if isinstance(where, int) and where % n in masses and "sticks" not in stop.doing:
            columns[name] = stop.offset + stop.swing(np.sin(turn), np.cos(turn))
            side = 1 if stop.side == "above" else -1
            stops.append({"column": name, "mass": masses.index(where % n), "side": side})
            shown += [name] * (where % n == along)
    tied = abs(system.stiffness.sum(axis=1)) > 1e-12 * abs(system.stiffness).max()
    machine = {
        "masses": [_named("x", k) for k in masses],
        "stops": stops,
        "walls": [bool(tied[0]), bool(tied[-1]) and n > 1],
    }
    portrait = _named("x", along), _named("v", along)
    marks = np.searchsorted(times, impacts).tolist()
    return Series(times, columns, tuple(shown), portrait, marks=marks, machine=machine)


def page_of_record(record: Any, motions: int) -> Page:
    """Return the page of a record: its impacts, and the motion from its start."""
    system, turn = record.system, 2.0 * math.pi / record.system.frequency
    end = min(PERIODS * turn, shown_until(turn, record._run))

    def series(_: int) -> Series:
        return series_of(system, record.sample, record.start.phase, end, record.time)

    return page_of_section("Record of a motion", record, series, motions)


def _named(letter: str, coordinate: int) -> str:
    return letter + str(coordinate + 1).translate(_SUBSCRIPTS)
