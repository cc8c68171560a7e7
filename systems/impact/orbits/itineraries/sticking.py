"""Guesses of orbits P(inf,m): motions from one release of a stop to another."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.itineraries.finding import guess_of, sizes_of
from dynkit.systems.impact.orbits.itineraries.itinerary import events_seen, from_release
from dynkit.systems.impact.orbits.itineraries.motions import simulated_motions
from dynkit.systems.impact.orbits.machine import Machine, machine_of
from dynkit.systems.impact.simulation.starts import own_start
from dynkit.systems.impact.simulation.state import (
    TWO_PI,
    ImpactState,
    Motion,
    state_at,
    turning,
    without_shift,
)

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.orbits.itineraries.equations import ItineraryEquations

STARTS = 8
"""Number of motions from which a search starts, for each stop."""

RELEASES = 4
"""Number of releases of each motion from which an orbit is sought."""

_MOST = 4096
"""Number of impacts within which releases are sought."""

Guess = tuple["ItineraryEquations", Array]
"""Equations, and a guess of their unknowns."""


def sticking_guesses(oscillator: ImpactMap, periods: int) -> Iterator[Guess]:
    """Guesses from the releases of some motions, the same in each call.

    The motions are the steady ones in contact with a stop, random ones in contact, and the motion
    from a start at the machine's own length after 1000 impacts.

    Raises
    ------
    ValueError
        When nothing drives the oscillator.
    """
    if not oscillator._excitation.turns:
        raise ValueError("system must be driven: amplitude and harmonic_forces are zero")
    for state in _starts(oscillator):
        yield from released(oscillator, state, periods, RELEASES)


def sticking_guess(system: ImpactMap, state: ImpactState, periods: int) -> Guess:
    """Return the guess from the first release of the motion from a state.

    Raises
    ------
    ValueError
        When no stop releases the motion, or none releases it again some periods later.
    """
    for guess in released(system, state, periods, 1):
        return guess
    raise ValueError(
        f"motion must be released by a stop, and {periods} periods later again; a release that "
        "friction sets off does not count"
    )


def released(system: ImpactMap, state: ImpactState, periods: int, most: int) -> Iterator[Guess]:
    """Guesses from the first releases of a motion that occur again some periods later."""
    turn, count, state = TWO_PI / system.frequency, 64, without_shift(state)
    length = periods * turn
    while True:
        run = system._run(state, count, store=True)
        seen = events_seen(system, run)
        found = seen.releases[:most]
        wanted = seen.times[found[-1]] + length + 0.25 * turn if len(found) == most else np.inf
        if run.duration > wanted or run.impacts < count or count >= _MOST:
            break
        count *= 4
    for k in found:
        begin = float(seen.times[k])
        part = from_release(seen, k, begin + length, 0.25 * turn)
        if part is not None and any(event.kicked for event in part.events):
            sizes = sizes_of(system, run, part, begin, length)
            yield guess_of(system, state, part, periods, length, sizes)[:2]


def _starts(oscillator: ImpactMap) -> Iterator[ImpactState]:
    """Releases of steady and random motions in contact, and a state after a transient.

    If a table is not the only element, they are the ends of simulated motions that stick.
    """
    if not oscillator._table_alone:
        motions = simulated_motions(oscillator)
        yield from (record.final for record in motions if len(record.sticking))
        return
    turns = turning(np.linspace(0.0, TWO_PI, 720, endpoint=False))
    random, m = np.random.default_rng(0), machine_of(oscillator)
    for side in range(len(oscillator._stops)):
        closed, others = m.closed(side), oscillator._others[side]
        places, motion = np.append(others, m.size + others), turns @ _steady(m, side).T
        size = abs(motion[:, places]).max(axis=0)
        put = m.caught(m.free, closed) @ m.put_on(side)
        for k in range(STARTS):
            z = np.concatenate([motion, turns], axis=1)
            z[:, places] += size * random.uniform(-1.0, 1.0, len(size)) if k else 0.0
            z = z @ put.T
            force = z @ m.force(closed, side)
            falls = np.flatnonzero((force >= 0.0) & (np.roll(force, -1) < 0.0))
            if len(falls):
                at, n = z[falls[0]], m.size
                own = at[:n], at[n : 2 * n], at[-3:-1]
                yield state_at(oscillator, *own, 0.0, side, Motion.RELEASE)
    yield oscillator.attractor(start=own_start(oscillator), transient=1000, impacts=1).final


def _steady(m: Machine, side: int) -> Array:
    """Steady motion in contact: coefficients (2N, 3) of sine, cosine and one."""
    d, flow, gap = 2 * m.size, m.flow(m.closed(side)), m.gap(side)
    inner, given, w = flow[:d, :d], flow[:d, d:], float(m.frequency)
    turned = np.block([[inner, w * np.eye(d)], [-w * np.eye(d), inner]])
    rows = np.kron(np.eye(2), gap[:d])
    harmonic = np.linalg.lstsq(
        np.vstack([turned, rows]), -np.append(given[:, :2].T.ravel(), gap[d : d + 2]), rcond=None
    )[0]
    still = np.linalg.lstsq(
        np.vstack([inner, gap[:d]]), -np.append(given[:, 2], gap[-1]), rcond=None
    )
    return np.stack([*harmonic.reshape(2, d), still[0]], axis=1)
