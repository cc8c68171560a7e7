"""Orbits with a given itinerary, from motions near them."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array, positive_integer
from dynkit.orbits.newton import NoConvergence
from dynkit.orbits.solving import solve
from dynkit.systems.impact.orbits.itineraries.equations import ItineraryEquations
from dynkit.systems.impact.orbits.itineraries.flying import flights_of
from dynkit.systems.impact.orbits.itineraries.happening import Happening, Itinerary
from dynkit.systems.impact.orbits.itineraries.itinerary import (
    Course,
    Seen,
    events_seen,
    from_release,
    of_cycle,
    of_period,
    regimes_of,
)
from dynkit.systems.impact.orbits.itineraries.motion import AT_ONCE
from dynkit.systems.impact.orbits.itineraries.parting import commute
from dynkit.systems.impact.orbits.itineraries.simulated import run_for, simulated
from dynkit.systems.impact.orbits.machine import machine_of
from dynkit.systems.impact.orbits.orbit import NONE, ImpactOrbit
from dynkit.systems.impact.simulation.sampling import sample_run, sample_sliders
from dynkit.systems.impact.simulation.starts import own_start
from dynkit.systems.impact.simulation.state import TWO_PI, ImpactState, without_shift
from dynkit.systems.impact.simulation.trajectory import Ending, Trajectory

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

_FAMILY = (
    "no isolated periodic orbit found from the guess: it is one of a family, as where friction "
    "never slips, or nothing damps the motion"
)
_STUCK = (
    "no isolated periodic orbit found from the guess: it is one of a family, as a slider that "
    "never slips may be anywhere; got {!r}"
)
_MERGE = "no periodic orbit found from the guess, but one whose events merge"
_IN_TURN = (
    "no periodic orbit found from the guess, but one in which two events merge whose order counts; "
    "got {!r} and {!r}"
)
_NEVER = "the motion does not come again: the nearest solution of its equations is no motion"
_HELD = "the motion is not released by a stop at the same phase again"
_AMID = "the motion begins amid a chatter: no impact is seen before its contact"
_SINGULAR = 1e-13
"""Least ratio of singular values of the row-scaled Jacobian: below this it is singular."""
_LARGE = 1e5
"""Largest scaled derivative for which states at nodes suffice: beyond, all states are unknowns."""
_SAMPLES, _TRANSIENT = 64, 700
"""Samples for the largest position and velocity; returns, or periods, of a transient."""
_CYCLE = 256
"""Largest number of returns to the section, and of switches, within which a cycle repeats."""


_LENGTHS = 4.0
"""Characteristic lengths from which a motion starts: outside a stick-slip cycle, which may
surround a state at rest."""


def orbit_from(system: ImpactMap, periods: object, start: ImpactState | None) -> ImpactOrbit:
    """Return the orbit near the motion from a state; by default after a transient."""
    m = positive_integer("periods", periods)
    if start is None:
        state = system._run(own_start(system, _LENGTHS), _TRANSIENT, store=False).final
    else:
        state = system._entered(start)
    return orbit_near(system, state, m)


def orbit_near(system: ImpactMap, state: ImpactState, periods: int) -> ImpactOrbit:
    """Return the orbit of some periods of the forcing near the motion from a state.

    If the orbit repeats within these periods, the shorter orbit is returned. For an undriven
    machine the orbit is the cycle of the motion, and `periods` has no effect.

    Raises
    ------
    NotImplementedError
        When an element rests on a preloaded stop.
    NoConvergence
        When the motion is too far from an orbit, or the orbit is one of a family.
    """
    began, state = time.perf_counter(), without_shift(state)
    driven = system._excitation.turns
    if driven:
        length = periods * TWO_PI / system.frequency
        whole = simulated(system, state, 3.0 * length)
        seen = of_period(whole, 2.5 * length, length)
        if any(event.chatters for event in seen.events):
            seen = _of_contact(whole, length, TWO_PI / system.frequency)
    else:
        run = system._run(state, _CYCLE, store=True, most_switches=_CYCLE)
        seen, length = of_cycle(events_seen(system, run), run, system._progression.removed)
        periods = 1
    problem, guess = anchored(*guess_of(system, state, seen, periods, length))
    x, history = _solved(problem, guess)
    cost = Cost(time.perf_counter() - began, {"steps": len(history) - 1})
    problem, x = problem.shortest(x)
    found = ImpactOrbit(*problem.in_turn(x), history, cost)
    if not driven and not found.admissible:  # e.g. decaying bounces: a cycle of period zero
        raise NoConvergence(_NEVER)
    return found


def _of_contact(seen: Seen, length: float, turn: float) -> Seen:
    """Return the events between the last two releases of one stop that are `length` apart."""
    for first in reversed(seen.releases):
        found = from_release(seen, first, float(seen.times[first]) + length, 0.25 * turn)
        if found is not None:
            return found
    raise NoConvergence(_HELD)


def _quiet(system: ImpactMap, state: ImpactState, periods: int) -> Seen:
    """Return a motion without events, by its states at the begin of each period.

    With Taylor's method the states are those after a transient, if no event was found within the
    limit of the search.
    """
    turn = TWO_PI / system.frequency
    run, begins = run_for(system, state, periods * turn), turn * np.arange(float(periods))
    late = (-state.phase % TWO_PI) / system.frequency
    if run.ending is Ending.SEARCH_LIMIT and system.engine == "Taylor":
        late += _TRANSIENT * turn
    states = *sample_run(system, run, late + begins), sample_sliders(system, run, late + begins)
    marked = Happening(regimes_of(system, run.regimes[run.segments.mode[-1]]), -1, 0)
    return Seen(begins, (marked,) * periods, np.concatenate(states, axis=1))


def guess_of(
    system: ImpactMap,
    state: ImpactState,
    seen: Seen,
    periods: int,
    length: float,
    sizes: list[float] | None = None,
) -> tuple[ItineraryEquations, Array, Array]:
    """Equations with the itinerary of a motion, from a state on, its unknowns, and its states.

    The states (n, 2N + J) are those before all events, for `anchored`. Sizes are those of positions
    and velocities, by default the largest of the motion.

    Raises
    ------
    NoConvergence
        When a slider never slips, a sticking motion does not begin at a release, or the motion
        begins amid a chatter.
    """
    if quiet := not len(seen.events):
        seen = _quiet(system, state, periods)
    along = system._progression
    if along.shift.size:  # the first state has no shift
        first = seen.states[0]
        seen = seen._replace(states=seen.states - (first - along.removed(first)))
    if sizes is None:
        sizes = _sizes(system, state, seen, length)
    for k in system._parts.sliders:
        if not any(event.mode.numbers[k] for event in seen.events):
            raise NoConvergence(_STUCK.format(system._elements[k]))
    if seen.events and _begins_amid_chatter(seen.events):
        raise NoConvergence(_AMID)
    driven = system._excitation.turns
    clock = system.frequency if driven else TWO_PI / length
    phases, course = clock * seen.times + (0.0 if quiet else state.phase), Course(seen.events, (0,))
    if not driven:
        phases -= phases[0]
        phases[0] = length
    elif course.sticks:  # phases after many turns have larger rounding errors
        phases -= TWO_PI * np.floor(phases[0] / TWO_PI)
    nodes = course.releases if course.sticks else tuple(range(periods)) if quiet else (0,)
    if nodes[:1] != (0,):
        raise NoConvergence(_HELD)
    problem = ItineraryEquations(system, (), periods, seen.events, sizes, driven, nodes)
    states = along.removed(seen.states)
    own = [] if problem.responds else [states[node] for node in nodes]
    return problem, np.concatenate([phases, _impulses(system, seen, phases), *own]), states


def anchored(
    problem: ItineraryEquations, guess: Array, states: Array | None
) -> tuple[ItineraryEquations, Array]:
    """Equations and unknowns, with given states before all events where these grow: `_grows`."""
    if states is None or problem.responds or problem.of_nodes or not _grows(problem, guess):
        return problem, guess
    known, every = guess[: -problem.dimension], tuple(range(len(states)))
    return problem.remade(nodes=every), np.concatenate([known, *states])


def _begins_amid_chatter(events: Itinerary) -> bool:
    """Whether a stop is closed just after an impact that is not marked as followed by contact."""
    pairs = zip(events, (*events[1:], events[0]), strict=True)
    return any(e.kicked and not e.chatters and e.element in after.mode.held for e, after in pairs)


def _grows(problem: ItineraryEquations, guess: Array) -> bool:
    """Whether states depend so strongly on earlier ones that all of them must be unknowns."""
    try:
        matrix = problem.linearization(guess, NONE) * problem.scale(guess)
    except NoMotion:
        return False
    return bool(abs(matrix).max() > _LARGE)


def _sizes(system: ImpactMap, state: ImpactState, seen: Seen, length: float) -> list[float]:
    """Largest absolute position and velocity of a motion; 1 in place of zero."""
    run = run_for(system, state, length)
    stays = run.ending in (Ending.NO_FURTHER_CONTACT, Ending.CONTACT_FOR_EVER)  # in its last mode
    return sizes_of(system, run, seen, 0.0, length if stays else min(length, run.duration))


def sizes_of(
    system: ImpactMap, run: Trajectory, seen: Seen, begin: float, length: float
) -> list[float]:
    """Largest absolute position and velocity of a motion from a time on, and at its events."""
    times, n = np.linspace(begin, begin + length, _SAMPLES), system.degrees_of_freedom
    parts = zip(
        (seen.states[:, :n], seen.states[:, n : 2 * n]), sample_run(system, run, times), strict=True
    )
    return [float(abs(np.concatenate(part)).max()) or 1.0 for part in parts]


def _impulses(system: ImpactMap, seen: Seen, phases: Array) -> Array:
    """Those that the law gives."""
    machine, found = machine_of(system), []
    for event, state, phase in zip(seen.events, seen.states, phases, strict=True):
        if event.kicked:
            z = np.concatenate([state, [np.sin(phase), np.cos(phase), 1.0]])
            moving = flights_of(system, machine, event.mode)
            rate = float(moving.rate_of(event.element, z)[0])
            r, _ = machine.rebound(event.element, event.piece, rate)
            found.append(-(1.0 + r) * rate)
    return np.array(found)


def _solved(problem: ItineraryEquations, guess: Array) -> tuple[Array, tuple[float, ...]]:
    try:
        x, history = solve(problem, guess, NONE)
    except NoConvergence as failure:
        family = _never_slips(problem) or _singular(problem, guess)
        raise NoConvergence(_FAMILY if family else str(failure)) from failure
    s = problem.at(x, NONE)
    together = np.flatnonzero(abs(s.durations) <= AT_ONCE * s.period)
    for i in together.tolist() if s.events > 1 else ():
        pair = s.itinerary[i].element, s.following[i].element
        if pair[0] == pair[1]:
            raise NoConvergence(_MERGE)
        if not commute(problem, x, i):
            elements = problem.oscillator._elements
            raise NoConvergence(_IN_TURN.format(*(elements[k] for k in pair)))
    if _singular(problem, x):
        raise NoConvergence(_FAMILY)
    return x, history


def _never_slips(problem: ItineraryEquations) -> bool:
    """Whether the friction of one element sticks in all modes."""
    held = set(problem.itinerary[0].mode.held).intersection(
        *(e.mode.held for e in problem.itinerary)
    )
    return any(k >= len(problem.oscillator._stops) for k in held)


def _singular(problem: ItineraryEquations, x: Array) -> bool:
    """Whether the Jacobian of the equations is singular up to rounding."""
    try:
        matrix = problem.linearization(x, NONE) * problem.scale(x)
    except NoMotion:
        return False
    matrix /= np.maximum(abs(matrix).max(axis=1), 1.0)[:, None]  # rows of stiff stops are large
    sizes = np.linalg.svd(matrix, compute_uv=False)
    return not sizes[-1] > _SINGULAR * sizes[0]
