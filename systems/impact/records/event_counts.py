"""Counts of events in a period of a motion, by element."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.elements.parameters import names_of
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.simulation.state import ImpactState
from dynkit.systems.impact.simulation.trajectory import Ending

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

LASTING = 2.0**-40
"""Segments that last a smaller part of the period than this are not counted."""


def element_names(system: ImpactMap) -> list[str]:
    """Names of the elements as in their parameters, hard stops first."""
    if not system.elements:
        return ["table", "far_stop"][: len(system._stops)]
    pairs = zip(names_of(system.elements), system.elements, strict=True)
    return [name for name, _ in sorted(pairs, key=lambda pair: not isinstance(pair[1], HardStop))]


def event_counts(system: ImpactMap, start: ImpactState, length: float) -> dict[str, float] | None:
    """Count the events of a periodic motion in one period of a given length, from a state on it.

    For hard stops these are impacts (infinite if they accumulate) and contacts. For other elements
    they are the beginnings of pressing, or of sticking. The result is None if the motion ends.
    """
    impacts = 64
    record = system.simulate(impacts=impacts, start=start)
    while not record._run.duration > 3.0 * length:
        if record.ending is not Ending.COUNT_REACHED:
            return None
        impacts *= 2
        record = system.simulate(impacts=impacts, start=start)
    run = record._run
    s, switches = run.segments, run.switches
    # The period ends in the middle of its longest time without an event, so that no event is at
    # its ends.
    last = s.begin[-1]
    border = np.append(last - length, s.begin[s.begin > last - length])
    longest = int(np.argmax(np.diff(border)))
    end = 0.5 * (border[longest] + border[longest + 1])

    def within(times: Any) -> Any:
        return (times > end - length) & (times <= end)

    lasts = np.diff(s.begin, append=np.inf) > LASTING * length
    modes, begin = s.mode[lasts], s.begin[lasts]
    regimes = np.array(run.regimes)
    impact = within(s.begin[1:]) & (s.kind[1:] == EventKind.IMPACT)
    found: dict[str, float] = {}
    for k, (name, element) in enumerate(zip(element_names(system), system._elements, strict=True)):
        if isinstance(element, HardStop):
            cut = (switches.speed > 0.0) & (run.guards[switches.guard, 1] == k)
            hits = int((impact & (s.element[1:] == k)).sum())
            found[f"{name}.impacts"] = math.inf if within(switches.time[cut]).any() else hits
        doing = np.array(element.doing)[regimes[modes, k]]
        for what in sorted(filter(None, set(element.doing))):
            on = doing == what
            begins = on & ~np.append(True, on[:-1])
            found[f"{name}.{what}"] = int((begins & within(begin)).sum())
    return found
