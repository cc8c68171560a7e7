"""Checks of the crossings of a Poincare map against the contract of its flow."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from dynkit.core.no_motion import NoCrossing
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.poincare_map import PoincareMap
from dynkit.testing.maps import map_checks
from dynkit.testing.requirements import FLOW_ACCURACY, require, require_close

PoincareMapCheck: TypeAlias = Callable[[PoincareMap, Array], None]


def crossing_lands_on_the_section(system: PoincareMap, states: Array) -> None:
    """The section's value is zero at a crossing."""
    for state in states:
        hit = system.crossing(state).state
        reach = float(np.linalg.norm(system.section.gradient(hit)) * (1.0 + np.linalg.norm(hit)))
        off = abs(system.section.value(hit))
        require(off <= FLOW_ACCURACY * reach, "crossings lie on the section", f"the value is {off}")


def crossing_goes_in_the_direction(system: PoincareMap, states: Array) -> None:
    """At a crossing the section's value changes in the section's direction."""
    for state in states:
        hit = system.crossing(state).state
        rate = float(system.section.gradient(hit) @ system.flow.velocity(hit))
        require(
            rate * system.section.direction > 0.0,
            "crossings go in the section's direction",
            f"the value changes at the rate {rate}",
        )


def crossing_is_where_the_flow_is(system: PoincareMap, states: Array) -> None:
    """The return time is positive, and the flow advanced by it is at the crossing."""
    for state in states:
        hit = system.crossing(state)
        require(hit.time > 0.0, "return times are positive", f"got {hit.time}")
        there = system.flow.advance(system.section.lift(state), hit.time)
        require_close("the flow at the return time", there, hit.state, FLOW_ACCURACY)


def crossing_is_the_first(system: PoincareMap, states: Array) -> None:
    """No passage in the section's direction, in 200 samples, comes before the crossing."""
    for state in states:
        here = system.section.lift(state)
        times = np.linspace(0.0, system.return_time(state), 200)[1:-1]
        values = []
        for duration in np.diff(times, prepend=0.0):
            # from sample to sample: `advance_composes` checks that two advances equal one
            here = system.flow.advance(here, duration)
            values.append(system.section.value(here))
        side = system.section.direction * np.array(values) > 0.0
        early = times[1:][side[1:] & ~side[:-1]]
        require(not early.size, "crossings are the first", f"one was missed before {early[:1]}")


def time_limit_is_kept(system: PoincareMap, states: Array) -> None:
    """A time limit of half the return time raises `NoCrossing`."""
    for state in states:
        try:
            replace(system, time_limit=0.5 * system.return_time(state))(state)
        except NoCrossing:
            continue
        require(False, "NoCrossing is raised at the time limit", f"it was not from {state}")


poincare_map_checks: tuple[PoincareMapCheck, ...] = (
    crossing_lands_on_the_section,
    crossing_goes_in_the_direction,
    crossing_is_where_the_flow_is,
    crossing_is_the_first,
    time_limit_is_kept,
)


def check_poincare_map(system: PoincareMap, states: Array) -> None:
    """Run `poincare_map_checks` and `map_checks` on a Poincare map, at states (k, d - 1)."""
    given = finite_array("states", states, (None, None))
    for check in (*poincare_map_checks, *map_checks):
        check(system, given)
