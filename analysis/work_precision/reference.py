"""Impacts of dynkit as the reference, where no exact ones are known."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from dynkit.analysis.work_precision.event_driven import weakest_bounce
from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.core.validation import Array, positive_integer


def reference_impacts(system: Any, start: Any, impacts: int, coarsest: float) -> ExactImpacts:
    """Return the first impacts that dynkit finds, with their error.

    Bounces before sticking that are weaker than those a method at the coarsest tolerance simulates
    are left out, as chatters.

    Raises
    ------
    ValueError
        When the system is not an impact oscillator, there are no impacts, or their error is as
        large as the motion.
    """
    count = positive_integer("impacts", impacts)
    for name in ("state", "simulate"):
        if not hasattr(system, name):
            raise ValueError(f"system must be an ImpactOscillator; got {system!r}")
    state = system.simulate(impacts=1, start=start).start
    # the state in doubles, as the methods get it, without further digits of the start
    anew = system.state(state.position, state.velocity, state.phase)
    record = system.simulate(impacts=count + 1, start=anew)
    times = record.time
    if not len(times):
        raise ValueError(f"start must lead to an impact; got {start!r}")
    # half-way to the next impact, or half a period later where there is none
    later = times[count] if len(times) > count else times[-1] + math.pi / system.frequency
    until = float(0.5 * (times[:count][-1] + later))
    cut = 0.0  # without restitution there are no bounces
    if system.restitution != 0.0:
        cut = weakest_bounce(system.amplitude * system.frequency, state.velocity, coarsest)
    chatters = _chatters(times, abs(record.relative_velocity) < cut, record.sticking, until)
    inside = np.zeros(len(times), dtype=bool)
    for begin, end in chatters:
        inside |= (begin <= times) & (times <= end)
    kept = (times <= until) & ~inside
    if not kept.any():
        raise ValueError(f"impacts must not all be weak bounces; got {impacts} of them")
    releases = record.sticking[:, 1]
    exact = ExactImpacts(
        system=system,
        position=state.position,
        velocity=state.velocity,
        phase=state.phase,
        until=until,
        times=times[kept],
        positions=record.position[kept],
        velocities=record.velocity[kept],
        releases=releases[releases <= until],
        chatters=chatters,
    )
    error = _error(system, float(record.error[times <= until][-1]), exact)
    if not error < 1.0:
        raise ValueError(
            f"impacts must be so few that dynkit's own error stays below the size of the motion; "
            f"got {impacts}, error {error:.1e}"
        )
    return replace(exact, error=error)


def _chatters(times: Array, weak: Any, sticking: Array, until: float) -> list[tuple[float, float]]:
    """Return intervals from before the first weak bounce of each contact to its release."""
    found = []
    for contact, release in [*sticking.tolist(), (until, until)]:
        last = int(np.searchsorted(times, contact, side="right"))
        first = last
        while first and weak[first - 1]:
            first -= 1
        if first < last:
            # a motion that begins in a chatter has no earlier bounce
            begin = float(0.5 * (times[first - 1] + times[first])) if first else 0.0
            found.append((min(begin, until), min(release, until)))
    return found


def _error(system: Any, error: float, exact: ExactImpacts) -> float:
    """Return an error of section coordinates in the norm of `ExactImpacts.errors`.

    An error of the phase is also one of the position and the velocity of the table, and so of the
    contact mass.
    """
    position, velocity = exact.size
    reach = max(1.0, system.amplitude)
    speed = 1.0 + system.amplitude * system.frequency
    parts = (1.0 / (2.0 * math.pi), reach / position, speed / velocity)
    return float(max(error * max(parts), exact.rounding))
