"""Guesses of orbits P(inf,m): the courses of motions from one release to another."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.passages.equations import PassageEquations
from dynkit.systems.impact.orbits.passages.passage import Scene, Word
from dynkit.systems.impact.simulation.sampling import sample_run
from dynkit.systems.impact.simulation.state import TWO_PI, ImpactState
from dynkit.systems.impact.simulation.trajectory import Indices, Trajectory

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

STARTS = 8
"""Motions that a search starts from."""

RELEASES = 4
"""Releases of each of them from which an orbit is sought."""

_MOST = 4096
"""Impacts within which releases are sought."""


Course = tuple[PassageEquations, Array]
"""Equations, and a guess of their unknowns."""


def courses(oscillator: ImpactMap, periods: int) -> Iterator[Course]:
    """From the releases of some motions, always the same.

    What was at rest on the table, the motion from the default start after 1000 impacts, and stuck
    structures in random motion.

    Raises
    ------
    ValueError
        When nothing drives the oscillator.
    """
    if not oscillator._excitation.turns:
        raise ValueError("system must be driven: amplitude and harmonic_forces are zero")
    scene = Scene(oscillator)
    for state in _starts(oscillator, scene):
        for release in _releases(oscillator, state, RELEASES):
            course = _course(scene, *release, periods)
            if course is not None:
                yield course


def course_of(system: ImpactMap, state: ImpactState, periods: int) -> Course:
    """From the first release of the motion from a state.

    Raises
    ------
    ValueError
        When it does not stick, or not a period later.
    """
    for release in _releases(system, state, 1):
        course = _course(Scene(system), *release, periods)
        if course is not None:
            return course
    raise ValueError(f"motion must be released by the table, and {periods} periods later again")


def _starts(oscillator: ImpactMap, scene: Scene) -> Iterator[ImpactState]:
    """States on the table, and after a while."""
    phases = np.linspace(0.0, TWO_PI, 720, endpoint=False)
    random = np.random.default_rng(0)
    half = oscillator.degrees_of_freedom - 1
    for holding in scene.holdings:
        mode = holding.mode
        for k in range(STARTS):
            q = np.zeros((len(phases), 2, half))
            steady = mode.states(q, np.sin(phases), np.cos(phases))
            places = holding.places(steady)
            if k:
                size = abs(places).max(axis=0)
                places = places + size * random.uniform(-1.0, 1.0, places.shape[1])
            force = np.array(
                [holding.force(holding.state(z, a)) for z, a in zip(places, phases, strict=True)]
            )
            falls = np.flatnonzero((force >= 0.0) & (np.roll(force, -1) < 0.0))
            if len(falls):
                yield holding.release(places[falls[0]], float(phases[falls[0]]))
    yield oscillator.attractor(transient=1000, impacts=1).final


def _releases(
    oscillator: ImpactMap, state: ImpactState, most: int
) -> list[tuple[int, Array, float]]:
    """Side, places and phase of the first releases of a motion."""
    count = 256
    while True:
        run = oscillator._run(state, count, store=True)
        ended = np.flatnonzero(np.isfinite(run.contacts[:, 1]))[:most]
        if len(ended) >= most or run.impacts < count or count >= _MOST:
            break
        count *= 4
    sides, ends = run.contact_sides[ended].tolist(), run.contacts[ended, 1]
    phases = state.phase + oscillator.frequency * ends
    return list(zip(sides, _places(oscillator, run, ends), phases.tolist(), strict=True))


def _places(oscillator: ImpactMap, run: Trajectory, times: Array) -> Array:
    """Positions and velocities (k, 2N - 2) of all coordinates but that in contact."""
    x, v = sample_run(oscillator, run, times)
    others = oscillator._contact.others
    return np.concatenate([x[:, others], v[:, others]], axis=1)


def _course(scene: Scene, side: int, places: Array, phase: float, periods: int) -> Course | None:
    """Problem and unknowns of the motion from a release, if it is released m periods later."""
    system = scene.system
    period = TWO_PI / system.frequency
    state = scene.holdings[side].release(places, phase)
    count, wanted = 128, (periods + 0.25) * period
    while True:
        run = system._run(state, count, store=True)
        if run.impacts < count or run.time[-1] > wanted or count >= _MOST:
            break
        count *= 2
    ends = run.contacts[:, 1]
    near = np.flatnonzero(abs(ends - periods * period) < 0.25 * period)
    if not len(near):
        return None
    last = int(near[np.argmin(abs(ends[near] - periods * period))])
    before = run.before[: last + 1]
    if before[0] == 0 or (np.diff(before) == 0).any():
        return None
    begins = np.append(0, before[:-1])
    sides = run.sides[1:]
    starts = np.append(side, sides[before - 1])
    held = np.concatenate([places[None], _places(system, run, ends[:last])])
    begun = phase + system.frequency * np.append(0.0, ends[:last])
    words, parts = [], []
    states = run.free_states
    for k, (a, b) in enumerate(zip(begins.tolist(), before.tolist(), strict=True)):
        n = _before_chatter(scene, states[a + 1 : b + 1], run.time[a:b], sides[a:b])
        words.append(Word(int(starts[k]), tuple(sides[a : a + n].tolist())))
        phases = phase + system.frequency * run.time[a : a + n]
        parts.append(np.concatenate([held[k], [begun[k]], phases]))
    q, sine, cosine = system._free.parts(states[: before[-1] + 1])
    x = system._free.forced.positions(q, sine, cosine)
    v = system._free.forced.velocities(q, sine, cosine)
    speed = max(float(abs(v).max()), system.amplitude * system.frequency)
    sizes = max(float(abs(x).max()), system.amplitude, speed / system.frequency), speed
    return PassageEquations(system, (), periods, tuple(words), sizes), np.concatenate(parts)


def _before_chatter(scene: Scene, states: Array, times: Array, sides: Indices) -> int:
    """Number of impacts before those between which the gap is concave, and shrinks, to the end."""
    side = int(sides[-1])
    pressing = -scene.gap(states, side, 2)
    flights = np.diff(times)
    change = abs(np.diff(pressing))
    smooth = (np.minimum(pressing[:-1], pressing[1:]) > 2.0 * change) & (sides[:-1] == side)
    smooth[1:] &= flights[1:] < flights[:-1]
    rough = np.flatnonzero(~smooth)
    return 1 if not len(rough) else int(rough[-1]) + 2
