"""Whether an orbit of one mode is a motion: whether no impact is missing in its flights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.itineraries.motion import SAME
from dynkit.systems.impact.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.itineraries.one_mode.responses import ResponseSolution


def flights_are_open(s: ResponseSolution) -> bool:
    """Whether no impact is missing.

    This is proved by bounds of the gaps. Where a gap nearly closes and the proof fails, simulation
    from just after each impact decides.
    """
    gaps = [s.is_open(i, k) for i in range(s.events) for k in range(len(s.terms.rests))]
    if False in gaps or None not in gaps:
        return False not in gaps
    system, within = s.system(), SAME * s.period
    size = float(s.measures[0])
    at_once = [s.lasts[i] <= s.least_apart(i, size) * s.period for i in range(s.events)]
    for i, state in enumerate(s.section_states):
        if at_once[i]:
            continue  # the order of simultaneous impacts is decided by rounding
        try:
            run = system._run(system.impact_state(state), 1, store=True)
        except NoMotion:  # at a grazing impact another gap is zero, or negative by rounding
            return False
        ends = [s.ends(i)[1]]
        while at_once[ends[-1]] and len(ends) < s.events:
            ends.append(s.ends(ends[-1])[1])
        if not any(follows(run, s.lasts[i : i + 1], [int(s.sides[k])], within) for k in ends):
            return False
    return True


def follows(run: Trajectory, times: Array, sides: Sequence[int], within: float) -> bool:
    """Whether a simulated run has the same impacts, and no contact.

    Parameters
    ----------
    times, sides : (n,)
    within : float
        Largest difference of times.
    """
    n = len(times)
    if run.impacts < n or run.sides[1 : n + 1].tolist() != list(sides) or len(run.contacts):
        return False
    return bool((abs(run.time[:n] - times) <= within).all())
