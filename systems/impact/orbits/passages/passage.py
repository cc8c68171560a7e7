"""From one release to the next: impacts, chatter, contact."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.modes.impulse_responses import FreeMotion, free_motion
from dynkit.systems.impact.modes.mode import Mode
from dynkit.systems.impact.orbits.flights import Curve
from dynkit.systems.impact.orbits.passages.holding import Holding, seen, seen_change
from dynkit.systems.impact.orbits.solution import SAME, follows
from dynkit.systems.impact.simulation.sampling import sample_run
from dynkit.systems.impact.simulation.state import TWO_PI, Motion, state_of
from dynkit.systems.impact.simulation.trajectory import Trajectory
from dynkit.systems.impact.variational.saltation import by_time, closing, release, reset
from dynkit.systems.impact.variational.tangents import chatter_carried

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

CHUNK, MOST = 128, 8192
"""Impacts of a chatter that are simulated at first, and at most."""

PASSED = 64.0
"""How much rounding a passage collects, in units of that of its states."""

_NEARLY = 1e-3
"""A chatter nearly completes where its slowest impact is so slow, beside the fastest of all."""


@final
@dataclass(frozen=True)
class Word:
    """Which impacts happen from one release to the next, but for those of the chatter at the end.

    Attributes
    ----------
    start : 0 for the table and 1 for the far stop, from which it is released
    sides : of which stop each impact is, one at least; the chatter is with that of the last
    """

    start: int
    sides: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of phases that are unknown: of the release and of the impacts."""
        return 1 + len(self.sides)


class Scene:
    """An oscillator as passages see it.

    Attributes
    ----------
    system : ImpactMap
    motion : FreeMotion
    holdings : (stops,) of Holding
    kick : (2, slots)
        Change of the free state by a unit jump of the contact velocity.
    shift : (2, slots)
        The same by a unit jump of the contact coordinate.
    """

    def __init__(self, system: ImpactMap) -> None:
        self.system = system
        self.motion: FreeMotion = free_motion(system._contact)
        self.holdings = tuple(Holding(system, side) for side in range(len(system._stops)))
        contact, free = system._contact, system._free
        self.kick = free.placed(contact.kick[:2])
        unit = np.eye(len(contact.row))[contact.place]
        self.shift = free.placed(contact.structure.free.coordinates(unit, 0.0 * unit))

    def gap(self, states: Array, side: int, order: int) -> Array:
        """Gaps (...) of free states (..., 2, slots), or a derivative of them in time."""
        return np.asarray(seen(self.system._gaps[side], states, order))

    def flat(self, states: Array) -> Array:
        """Modes (..., 2N) of free states (..., 2, slots), both rows in turn."""
        modes = states[..., self.system._free.layout.modes]
        return np.asarray(modes.reshape(*modes.shape[:-2], -1))


@final
class Passage:
    """A motion from places and phase at a release, with impacts at given phases, to the next one.

    That the gap is zero at the impacts, or the contact force at the release, is not asked for here.

    Parameters
    ----------
    scene : Scene
    word : Word
    places : (2N - 2,)
    phases : (len(word.sides) + 2,)
        Of the release, of the impacts and of the next release, not wrapped.

    Attributes
    ----------
    states : list of (2, slots)
        Free states just after the release and after each impact.
    before : list of (2, slots)
        Free states just before each impact.
    rates : list of float
        Rates of the gap just before each impact.

    Raises
    ------
    NoSolution
        When the phases do not ascend, or contact does not follow.
    """

    def __init__(self, scene: Scene, word: Word, places: Array, phases: Array) -> None:
        self.scene, self.word, self.places, self.phases = scene, word, places, phases
        system = scene.system
        self.w, self.r = system.frequency, system.restitution
        self.durations = np.diff(phases[:-1]) / self.w
        if not (self.durations > 0.0).all():
            raise NoSolution("impacts must come one after the other")
        self.start = scene.holdings[word.start].state(places, float(phases[0]))
        state = scene.holdings[word.start].released(self.start)
        self.states, self.before, self.rates = [state], [], []
        for side, lasts, phase in zip(word.sides, self.durations, phases[1:-1], strict=True):
            state = system._free.flown(state, np.array([lasts]))[0]
            self._turn(state, float(phase))
            rate = float(scene.gap(state, side, 1))
            self.before.append(state)
            self.rates.append(rate)
            sign = system._stops[side].sign
            state = state - (1.0 + self.r) * rate * sign * scene.kick
            self.states.append(state)
        self._chatter()

    def _turn(self, state: Array, phase: float) -> None:
        """The table in a free state is where it is at this phase; modified in place."""
        state[:, self.scene.system._free.layout.table] = math.sin(phase), math.cos(phase)

    def _chatter(self) -> None:
        """The chatter, contact, and the end."""
        scene, side = self.scene, self.word.sides[-1]
        free, holding = scene.system._free, scene.holdings[side]
        if self.rates[-1] > 0.0:
            raise NoSolution("the chatter must begin with an impact that pushes")
        # From here on the gap is taken to be zero, so the contact coordinate is put onto the stop.
        sign = scene.system._stops[side].sign
        self.states[-1] = self.states[-1] - sign * self.gaps[-1] * scene.shift
        q, sine, cosine = free.parts(self.states[-1])
        turn = np.array([float(sine), float(cosine)])
        self.run = self._to_contact(
            state_of(scene.system, q, turn, abs(self.r * self.rates[-1]), side, Motion.TABLE)
        )
        self.last = self.states[-1]
        lasts = 0.0
        if self.run.impacts:
            self.last, lasts = self.run.free_states[-1], float(self.run.time[-1])
        self.contact_phase = float(self.phases[-2]) + self.w * lasts
        self.lasts = (float(self.phases[-1]) - self.contact_phase) / self.w
        if self.lasts < 0.0:
            raise NoSolution("the chatter must be complete before the release")
        self.caught = holding.caught(self.last)
        self.end = holding.mode.flown(self.caught, np.array([self.lasts]))[0]
        table = holding.mode.layout.table
        self.end[:, table] = math.sin(self.phases[-1]), math.cos(self.phases[-1])

    def _to_contact(self, start: Any) -> Trajectory:
        """The impacts until contact, without it.

        Where the chatter does not complete, only just, they are cut where they are slowest.
        """
        system, count = self.scene.system, CHUNK
        while True:
            run = system._run(start, count, store=True)
            k = int(run.before[0]) if len(run.contacts) else run.impacts
            away = self._lifts_off(run, k)
            if k < count or away.any() or count >= MOST:
                break
            count *= 4
        self.complete = len(run.contacts) > 0 and not away.any()
        if not self.complete:
            speeds = run.speeds
            most = int(np.argmax(away)) if away.any() else k
            k = int(np.argmin(speeds[: most + 1]))
            if speeds[k] > _NEARLY * max(abs(rate) for rate in self.rates):
                raise NoSolution("the chatter must be complete")
        return replace(run.part(0, k), switches=run.switches.until(0))

    def _lifts_off(self, run: Trajectory, count: int) -> Any:
        """Whether each of the first flights, (count,), leaves the chatter.

        It is longer than the one before, and nothing holds the mass down to its end. Without
        rebound there is no chatter, and any flight leaves.
        """
        if self.r == 0.0:
            return np.ones(count, dtype=bool)
        states, flights = run.free_states[:count], np.diff(run.time[:count], prepend=0.0)
        bend, change = (self.scene.gap(states, self.word.sides[-1], order) for order in (2, 3))
        freed = bend + np.maximum(change, 0.0) * flights >= 0.0
        longer = flights > np.append(np.inf, flights[:-1])
        far = run.sides[1 : count + 1] != self.word.sides[-1]
        return (freed & longer) | far

    @property
    def pressing(self) -> float:
        """Contact force where contact begins; negative where the chatter does not complete."""
        holding = self.scene.holdings[self.word.sides[-1]]
        if self.complete or self.r == 0.0:
            return float(holding.force(self.caught))
        # What is left of the velocity is about the square of the force that is missing.
        return -math.sqrt(self.speed * abs(float(holding.force(self.caught, 1))))

    @property
    def speed(self) -> float:
        """Relative velocity after the last impact before contact."""
        if self.run.impacts:
            return float(self.run.speeds[-1])
        return -self.r * self.rates[-1]

    # --- derivatives ------------------------------------------------------------------------------
    # Disturbances are those of the free or stuck modes at one time; that of a phase moves an event.

    @cached_property
    def gaps(self) -> Array:
        """Gaps (n,) at the impacts."""
        scene, sides = self.scene, self.word.sides
        return np.array([scene.gap(y, s, 0) for y, s in zip(self.before, sides, strict=True)])

    @cached_property
    def linear(self) -> tuple[Array, Array]:
        """Derivatives of the gaps (n, m) and of the places at the end (2N - 2, m).

        By the places and phases, m = 2N - 2 + n + 2.
        """
        scene, word, w = self.scene, self.word, self.w
        holding = scene.holdings[word.start]
        n, d = len(word.sides), len(holding.inward)
        motion, rows = scene.motion, scene.motion.vectors
        moved = np.zeros((d, d + n + 2))
        moved[:, :d] = holding.inward
        moved[:, d] = self._stuck_modes(holding, holding.turned(float(self.phases[0])))
        moved[:, d] -= self._stuck_modes(holding, holding.mode.rate(self.start)) / w
        moved = release(scene.system, word.start) @ moved
        flights = motion.mode.transitions(self.durations).matrices(motion.mode.layout.modes)
        gaps = np.empty((n, d + n + 2))
        for k, side in enumerate(word.sides):
            sign = scene.system._stops[side].sign
            moved = flights[k] @ moved
            gaps[k] = sign * (rows[2] @ moved)
            gaps[k, d + 1 + k] += self.rates[k] / w
            kick, bend = sign * rows[0], float(scene.gap(self.before[k], side, 2))
            moved = moved + reset(self.r, kick, sign * (rows[3] @ moved))
            later = by_time(self.r, kick, sign * rows[1], self.rates[k], bend)
            moved[:, d + 1 + k] += later / w
        moved = moved - sign * np.outer(scene.flat(scene.shift), gaps[-1])
        ended = self._ended(moved)
        end = scene.holdings[word.sides[-1]]
        ended[:, -1] += end.change(end.mode.rate(self.end)) / w
        return gaps, ended

    def _ended(self, moved: Array) -> Array:
        """Changes of the places at the end by disturbances (2N, m) after the last impact."""
        system, side = self.scene.system, self.word.sides[-1]
        moved = chatter_carried(system, self.run, moved)
        moved = closing(system, side, self.last[None], np.array([self.speed]))[0] @ moved
        mode = self.scene.holdings[side].mode
        moved = mode.transitions(np.array([self.lasts])).matrices(mode.layout.modes)[0] @ moved
        return np.asarray(self.scene.holdings[side].outward @ moved)

    @staticmethod
    def _stuck_modes(holding: Holding, change: Array) -> Array:
        return np.asarray(change[:, holding.mode.layout.modes].ravel())

    @cached_property
    def derivative(self) -> Array:
        """Derivative (2N - 2, 2N - 2) of the places at the end by those at the release.

        The phases of the impacts follow; those of the releases stay, and as the contact force is
        zero there it makes no difference.
        """
        gaps, ended = self.linear
        d, n = len(ended), len(gaps)
        moved = np.linalg.solve(gaps[:, d + 1 : d + 1 + n], gaps[:, :d])
        return np.asarray(ended[:, :d] - ended[:, d + 1 : d + 1 + n] @ moved)

    @cached_property
    def release(self) -> tuple[float, Array, float]:
        """Contact force at the release, its derivative by the places, and by the phase."""
        holding = self.scene.holdings[self.word.start]
        turned = holding.turned(float(self.phases[0]))
        slope = float(seen_change(holding.contact.force, turned))
        return float(holding.force(self.start)), holding.force_row, slope

    # --- the motion -------------------------------------------------------------------------------

    @property
    def rebounds(self) -> Array:
        """Relative velocities (n,) after the impacts before the chatter."""
        signs = np.where(np.array(self.word.sides) == 1, -1.0, 1.0)
        return np.asarray(-signs * self.r * np.array(self.rates))

    def gap(self, flight: int, side: int) -> Curve:
        """The gap of a stop in the flight that ends at impact number `flight`."""
        system = self.scene.system
        lasts = float(self.durations[flight])
        return _curve(system._free, system._gaps[side], self.states[flight], lasts)

    @cached_property
    def force(self) -> Curve:
        """The contact force during contact."""
        holding = self.scene.holdings[self.word.sides[-1]]
        return _curve(holding.mode, holding.contact.force, self.caught, self.lasts)

    @property
    def force_rate(self) -> float:
        """Rate of the contact force at the release."""
        return float(self.scene.holdings[self.word.start].force(self.start, 1))

    @property
    def is_motion(self) -> bool:
        """Whether simulation from the release finds the same impacts, contact and next release."""
        if not self.complete or any(rate >= 0.0 for rate in self.rates):
            return False
        system, word = self.scene.system, self.word
        start = self.scene.holdings[word.start].release(self.places, float(self.phases[0]))
        # Where the chatter is cut may change by a bounce.
        run = system._run(start, len(word.sides) + self.run.impacts + 3, store=True)
        times = (self.phases[1:] - self.phases[0]) / self.w
        return follows(run, times[:-1], word.sides, SAME * TWO_PI / self.w, float(times[-1]))

    def sample(self, since: Array) -> Array:
        """Positions and velocities (2, k, N) at times (k,) after the release."""
        free = self.scene.system._free
        out = np.empty((2, len(since), self.scene.system.degrees_of_freedom))
        events = (self.phases[:-1] - self.phases[0]) / self.w
        contact = (self.contact_phase - self.phases[0]) / self.w
        which = np.searchsorted(events, since, side="right") - 1
        flying = which < len(events) - 1
        held = since >= contact
        starts, after = np.array(self.states), since - events[which]
        out[:, flying] = free.motion(free.after(starts, which[flying], after[flying]))
        chatter = ~flying & ~held
        if chatter.any():
            out[:, chatter] = sample_run(self.scene.system, self.run, after[chatter])
        if held.any():
            holding = self.scene.holdings[self.word.sides[-1]]
            out[:, held] = holding.mode.motion(
                holding.mode.flown(self.caught, since[held] - contact)
            )
        return out


def _curve(mode: Mode, ladder: Any, start: Array, lasts: float) -> Curve:
    """A gap or a force from a state (2, slots) on."""

    def values(since: Array, orders: int) -> Array:
        states = mode.flown(start, since)
        return np.stack([seen(ladder, states, order) for order in range(orders)])

    rows, size = ladder.rows, abs(start[:, : ladder.rows.shape[1]])
    sums = [float((abs(rows[k : k + 2]) * size).sum()) for k in (0, 4)]
    return Curve(values, lasts, (sums[0], sums[1]))
