"""Runs of structures whose energies are not quadratic: Taylor's method from event to event."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import HALT, IMPACT, JAM, REST, SWITCH
from dynkit.systems.impact.modes.constrained import ContactParadox
from dynkit.systems.impact.simulation.clock_kernels import BOUNCED, BOUNCES, FLIGHT, SWITCHED
from dynkit.systems.impact.simulation.scrape_kernels import tail, taken
from dynkit.systems.impact.simulation.scraping import Rub
from dynkit.systems.impact.simulation.state import MOTIONS, TWO_PI, ImpactState, Motion, state_of
from dynkit.systems.impact.simulation.taylor.chatter import chatter, disturbed
from dynkit.systems.impact.simulation.taylor.log import Log, repeats
from dynkit.systems.impact.simulation.taylor.position import ABOVE, Position
from dynkit.systems.impact.simulation.trajectory import Ending, Impacts, Switches, Trajectory

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure

_PERIODS = 1000.0
"""Periods of the forcing without an event after which a run ends, with `Ending.SEARCH_LIMIT`."""

_BRIEF = 1e-8, 1e-4
"""Parts of a period at which the first Taylor steps of a flight end: a guard may soon be zero."""

_SLOW, _LOW = 0.05, 100.0
"""Impacts are tested for the end of a chatter if they are slower than this part of the largest stop
velocity, or slower than this number times the cubic root of the tolerance."""

_AT_ONCE, _SWITCHES = 1000, 1 << 16
"""Limits that end a run: impacts in no time (for each element), switches without an impact."""

_TOGETHER = 64.0 * 2.0**-52
"""Events are simultaneous if they are closer than this part of the time since the start; impacts on
two stops, of the longest flight so far."""

_PACE = 0.4
"""Length of the steps of a disturbed run, relative to the longest step of Taylor's method."""


@final
class TaylorCourse(Position):
    """A simulation that can be continued in pieces; the pieces do not change a bit of the result.

    `noise` is the relative size of pseudo-random disturbances of the start and of the states after
    events. A disturbed run also takes shorter steps of Taylor's method, so that its distance to the
    undisturbed run includes the errors of the method.

    Attributes
    ----------
    impacts : int
        Number of impacts so far.
    ending : Ending
        Why the simulation ended.
    cells : int
        Steps of Taylor's method so far.
    """

    def __init__(
        self, oscillator: DrivenStructure, start: ImpactState, *, noise: float, seed: int
    ) -> None:
        super().__init__(oscillator, start, noise=noise, seed=seed)
        self._tolerance = oscillator.chatter_tolerance
        self.impacts, self.ending, self.cells = 0, Ending.COUNT_REACHED, 0
        self._chatter_error, self._touches, self._ambiguous, self._at_once = 0.0, 0, -1, 0
        self._bounce, self._marked, self._searched = 0.0, -1.0, 0.0
        self._touching = False
        self._laws = [stop.restitution for stop in oscillator._stops]
        self._several = len(self._laws) > 1
        self._strobed = oscillator._strobed and not oscillator._cycled
        # Only impacts slower than `_slowly` are tested for the end of a chatter.
        moved = max((stop.amplitude for stop in oscillator._stops), default=0.0)
        slow = max(_SLOW * moved * oscillator.frequency, _LOW * self._tolerance ** (1.0 / 3.0))
        self._slowly = slow if moved else math.inf
        self._since, self._last_switches = 0.0, 0
        self._switches: list[tuple[float, float, float, int, int, Array]] = []
        if self._strobed:
            self._remaining = (TWO_PI - start.phase) / oscillator.frequency
        else:
            self._motion[start.element] = MOTIONS.index(start.motion)
            self._speed[start.element] = start.speed
        self._enter(*start._coordinates)
        for k in start.closed:
            while self._jumps(start.closed):
                pass  # elements that stick or hold bear the forces of others from the start
            self._close(k)
        self._disturb()

    def _close(self, k: int) -> None:
        """Enter contact with a stop, or friction, on which the motion starts."""
        automaton, place = self._automaton, self._place()
        rests = (i for i, (j, w) in enumerate(self._mode.guards) if (j, w.event) == (k, REST))
        number = next((self._first + i for i in rests), automaton.guard(self._number, k))
        guard = automaton.guards[number]
        if guard.element == k and guard.watch.event in (IMPACT, HALT, REST):
            self._number = automaton.enter(number)
            self._enter(*place)
            self._note(number, 0.0, 0.0)

    # --- the loop ---------------------------------------------------------------------------------

    def advance(self, count: int, *, store: bool) -> Impacts:
        """Simulate up to `count` further impacts; return their log, empty unless stored."""
        log, done, strobed = Log(count if store else 0, self._mode), 0, self._oscillator._strobed
        guards = self._automaton.guards
        while done < count:
            try:
                number = self._next()
            except ContactParadox:
                self.ending, number = Ending.PARADOX, None
            if number is None:
                break
            if number >= 0 and guards[number].watch.event != IMPACT:
                at_once = self._time - self._marked <= _TOGETHER * self._time
                if at_once or not self._automaton.marks(guards[number]):
                    continue
                number, self._marked = guards[number].partner, self._time
            elif number >= 0:
                number = self._hit(number)
                if self._jammed:
                    break
            if store:
                speed = math.nan if strobed else self._speed[self._left]
                log.note(
                    self._time, speed, max(number, self._first), self._chart, self._z, self._turn
                )
            done += 1
            self.impacts += 1
        return log.impacts()

    def _next(self) -> int | None:
        """Settle, fly to the next guard, and enter its mode if it is no impact: see `_fly`."""
        number = self._onward()
        if number is None or number < 0:
            return number
        guard = self._automaton.guards[number]
        self._latest = guard.element
        if guard.watch.event != IMPACT:
            self._change(number)
        return number

    def _onward(self) -> int | None:
        """Settle, and fly to the next guard: see `_fly`."""
        self._settle()
        return self._fly() if self.ending is Ending.COUNT_REACHED else None

    def _fly(self) -> int | None:
        """Fly to the next guard, return its number; -1 at the end of a period; None if none."""
        strobed = self._strobed
        known = zip(self._motion, self._speed, strict=True)
        self._touching = any(motion != FLIGHT and not speed for motion, speed in known)
        if (self._several or not self._plain) and (number := self._struck()) is not None:
            return number
        longest = self._remaining if strobed else _PERIODS * self._period
        pace = _PACE if self._noise else math.inf
        early = self._early(longest)
        chart, (sine, cosine) = self._chart, self._turn
        with chart.lock:
            index, duration, steps = chart.fly(self._z, sine, cosine, longest, pace, early)
            if index == -1:
                end = chart.reached
        self.cells, self._steps = self.cells + steps, steps
        if index == -2 or (index == -1 and not strobed):
            self.ending = Ending.SEARCH_LIMIT
            self._searched = self._time + (longest if index == -1 else 0.0)
            return None
        self._pass(duration)
        if index >= 0 and not self._plain and self._goes_back(index, duration):
            return self._onward()
        if duration > 2.0**-52 * self._time:
            self._motion, self._at_once = [FLIGHT] * len(self._motion), 0
        if index == -1:
            # The rounding error of the period's duration is the same in all periods.
            self._z, self._remaining = end, self._period
            self._turn = self._noise * self._late, 1.0
            self._afresh()
            self._disturb()
            return -1
        return int(self._first + index)

    def _goes_back(self, i: int, duration: float) -> bool:
        """Whether the guard of an element that has just switched is zero again by rounding only."""
        k, watch = self._mode.guards[i]
        just = self._motion[k] == SWITCHED and duration < _BRIEF[0] * self._period
        return just and watch.event == SWITCH and self._passes(i)

    def _early(self, longest: float) -> list[float]:
        """Durations, below the longest, at which the first Taylor steps of a flight end."""
        most = longest if self._plain and self._mode.scene.curves else _BRIEF[1] * self._period
        early = [self._bounce] if 0.0 < self._bounce < min(most, longest) else []
        if self._plain and not self._touching:
            return early
        return sorted(early + [t for part in _BRIEF if (t := part * self._period) < longest])

    def _struck(self) -> int | None:
        """The guard of a stop that is touched and whose gap closes; None if there is none."""
        state = self._state()
        for i, (k, watch) in enumerate(self._mode.guards):
            if watch.event == IMPACT:
                value, band = self._mode.watched(i, state)
                if value <= band and self._rate_of(k) < -band:
                    return int(self._first + i)
                self._touching = self._touching or value <= band
        return None

    def _note(self, number: int, rest: float, speed: float) -> None:
        """Log a change of the mode; end the run if switches repeat, or are too many."""
        self._switches.append((self._time, rest, speed, self.impacts, number, self._state()))
        if self.impacts != self._since:
            self._since, self._last_switches = self.impacts, len(self._switches)
        count = len(self._switches) - self._last_switches
        if repeats(self._switches, count, phased=self._oscillator._excitation.turns):
            self.ending = Ending.REPEATS
        elif count > _SWITCHES:
            self.ending = Ending.SEARCH_LIMIT

    # --- events -----------------------------------------------------------------------------------

    def _change(self, number: int, *, moved: int = SWITCHED) -> None:
        """Enter the mode that a guard leads to, at its zero."""
        guard = self._automaton.guards[number]
        if guard.watch.event == JAM:
            self.ending = Ending.JAMMED
            return
        k, place, stuck = guard.element, self._place(), self._mode.sticking
        gaps = self._gaps()
        before, self._number = self._number, self._automaton.enter(number)
        sticks = self._oscillator._elements[k].regimes[guard.watch.to].sticks
        self._motion[k] = FLIGHT if sticks else moved
        self._speed[k] = 0.0
        self._slide(before, halts=guard.watch.event in (SWITCH, HALT) and bool(guard.watch.rate))
        self._appear(before)
        self._enter(*place)
        self._keep(gaps)
        if k in self._chart.springs and not self._mode.regimes[k].anchored:
            forward = next(w.rate for j, w in self._mode.guards if j == k)
            place_of, least = self._half + self._chart.speeds[k], self._above(SWITCHED)
            if self._z[place_of] * forward < least:
                self._z[place_of] = least * forward
        if k in stuck and k in self._chart.speeds:
            forward = next(w.rate for j, w in self._mode.guards if j == k and w.halts)
            slip = self._above(SWITCHED)
            self._z[self._half + self._chart.speeds[k]] = slip * forward
        self._again(k)
        self._disturb()
        self._note(number, 0.0, 0.0)

    def _hit(self, number: int) -> int:
        """Apply Newton's law of impact at a guard; return the guard's number in the next mode."""
        automaton, self._bounce = self._automaton, 0.0
        guard = automaton.guards[number]
        k = guard.element
        opens, ambiguous = self._outcome(guard)
        if len(self._motion) > 1 and (ambiguous or self._together(guard)):
            self._ambiguous = self.impacts if self._ambiguous < 0 else self._ambiguous
        while opens >= 0:  # stops that the impact opens are released first
            self._change(automaton.guard(self._number, opens), moved=BOUNCED)
            number = automaton.guard(self._number, k)
            guard = automaton.guards[number]
            opens, _ = self._outcome(guard)
        if not self._fixed and self._automaton.jams(guard, *self._where()):
            self.ending = Ending.JAMMED
            return number
        if self._left != k:
            self._left = k
            if k not in self._chart.places:
                self._enter(*self._place())
        z, place, n = self._z, self._chart.places[k], self._half
        rate = min(float(z[n + place]), 0.0)
        if rate == 0.0:
            self._touches += 1
        r = self._restitution(k, -rate)
        kick = self._kick(k)
        if kick is not None:
            z[n:] -= (1.0 + r) * rate * kick
        still = []
        for j, ratio in self._scrapes(guard):
            lost = taken(float(z[n + self._chart.speeds[j]]), -(1.0 + r) * rate * ratio)
            self._slow(j, *lost)
            still += [j] if lost[1] else []
        z[place], z[n + place] = ABOVE, 0.0 - r * rate
        self._speed[k], self._motion[k] = 0.0 - r * rate, BOUNCED
        self._hold(k, still)
        if len(self._motion) > 1:
            self._canonical(k)
        self._at_once += 1
        if self._at_once > _AT_ONCE * len(self._motion):
            self.ending = Ending.COLLAPSED
        if self._noise:
            self._disturb()
            self._speed[k] = float(self._z[n + place])
        return number

    def _scrapes(self, guard: Any) -> tuple[Rub, ...]:
        """Friction at an impact."""
        if self._fixed:
            known: tuple[Rub, ...] = guard.scrapes
            return known
        found: tuple[Rub, ...] = self._automaton.scrapes(guard, *self._where())
        return found

    def _tails(self, rubs: Sequence[Rub], series: Array, k: int) -> Any:
        """Changes of slip when contact replaces bounces, and their error; None if undecided."""
        found, error, u = list[tuple[int, float, bool]](), 0.0, self._speed[k]
        r: Any = self._laws[k]
        second = 2.0 * float(series[self._chart.places[k], 2])
        for j, ratio in rubs:
            slip = series[self._half + self._chart.speeds[j]]
            motion = float(slip[0]), float(slip[1])
            known, stops, change, moved = tail(ratio, *motion, r, u, second, self._tolerance)
            if not known:
                return None
            error += moved
            found.append((j, change, stops))
        return found, error

    def _restitution(self, k: int, speed: float) -> float:
        law: Any = self._laws[k]
        if type(law) is float:
            return law
        return float(law.at([speed])[0]) if speed > 0.0 else 0.0

    def _together(self, guard: Any) -> bool:
        """Whether another stop is also reached, and the impact changes the rate of its gap."""
        state, where = self._state(), self._where()
        for i, (j, watch) in enumerate(self._mode.guards):
            if j != guard.element and watch.event == IMPACT:
                value, band = self._mode.watched(i, state)
                late = _TOGETHER * self._longest * abs(self._rate_of(j))
                if value <= max(band, late) and self._automaton.coupled(guard, j, *where):
                    return True
        return False

    @property
    def _jammed(self) -> bool:
        return self.ending is Ending.JAMMED

    def _outcome(self, guard: Any) -> tuple[int, bool]:
        """The element that an impact opens or moves, and whether its outcome is ambiguous."""
        if self._fixed:
            return guard.opens, guard.ambiguous
        found: tuple[int, bool] = self._automaton.outcome(guard, *self._where())
        return found

    # --- changes immediately after an event -------------------------------------------------------

    def _settle(self) -> None:
        """Enter modes until no guard is negative, and contact at stops that were hit is decided."""
        while self.ending is Ending.COUNT_REACHED:
            if self._jumps():
                continue
            if BOUNCED not in self._motion:
                return
            bounced = self._motion.index(BOUNCED)
            if bounced >= len(self._laws):
                return
            if bounced in self._mode.held:
                self._motion[bounced] = FLIGHT
                continue
            self._rest(bounced)

    def _jumps(self, apart: Sequence[int] = ()) -> bool:
        """Enter the mode of a negative guard, if there is one; ignore the elements in `apart`."""
        number = None if self._plain else self._jumped(apart)
        if number is None:
            return False
        i = number - self._first
        value, band = self._mode.watched(i, self._state())
        soft = self._mode.guards[i][1].gap != 0.0 and value < -band
        self._change(number, moved=FLIGHT if soft else SWITCHED)
        return True

    def _rest(self, k: int) -> None:
        """Decide whether a stop that has just been hit holds; if it does, enter contact."""
        chart, u = self._chart, self._speed[k]
        self._motion[k] = BOUNCES
        if u >= self._slowly:
            return
        if k not in chart.places:
            self._left = k
            self._enter(*self._place())
            chart = self._chart
        number = self._automaton.guard(self._number, k)
        if self._automaton.guards[number].element != k:
            return
        rest: float | None = None
        lost, guard = 0.0, self._automaton.guards[number]
        loose = False
        if u == 0.0:  # friction is decided only after contact has begun
            loose = any(
                r and m != SWITCHED for r, m in zip(guard.rubbed, self._motion, strict=True)
            )
            rest = 0.0 if loose or self._presses(k) else None
            self._z[chart.places[k]] = self._above(SWITCHED)
        else:
            series = chart.coefficients(self._z, *self._turn)
            found = series[chart.places[k]]
            a = -2.0 * float(found[2])
            if a > 0.0:
                self._bounce = 4.0 * u / a
                rubs, state = self._scrapes(guard), self._state()
                turns = self._automaton.turns(guard, *self._where())
                given = self._laws[k], self._tolerance, u, found, rubs, turns
                rest, lost = chatter(self._mode, chart, k, state, *given)
                if rest is not None:
                    slows = self._tails(rubs, series, k)
                    more = u, rest, *given[:2], rubs, guard.rubbed
                    disturbs = disturbed(self._mode, k, state, *more)
                    rest = None if slows is None or disturbs else rest
        if rest is None:
            return
        self._bounce = 0.0
        if u > 0.0:
            self._chatter_error += lost + slows[1]
            for change in slows[0]:
                self._slow(*change)
            kick = self._kick(k)
            if kick is not None:
                self._z[self._half :] -= u * kick
            self._z[self._half + chart.speeds[k]] = 0.0
            if self._noise:
                self._z += lost * self._random.choice((-1.0, 1.0), size=self._z.shape)
        self._motion[k], self._speed[k] = FLIGHT if loose else SWITCHED, 0.0
        place = self._place()
        for j, _, stops in slows[0] if u > 0.0 else ():
            if stops and j in chart.scene.curves:
                place = self._onto(j, *place, 0.0)
        self._number = self._automaton.enter(number)
        self._left = k
        self._enter(*place)
        self._again(k)
        self._note(number, rest, u)

    # --- the trajectory ---------------------------------------------------------------------------

    def trajectory(self, log: Impacts, seconds: float) -> Trajectory:
        """The trajectory of all events so far, with a log of impacts."""
        oscillator, automaton = self._oscillator, self._automaton
        stops, element = len(oscillator._stops), self._left
        closed = automaton.parts.holding(automaton.regimes[self._number])
        hard = [k for k in closed if k < stops]
        motion, speed = Motion.FLIGHT, 0.0
        if stops:
            motion, speed = MOTIONS[self._motion[element]], self._speed[element]
        if hard and self._motion[element] != BOUNCED:
            element = element if element in hard else hard[0]
            motion, speed = Motion.TABLE, 0.0
        closed = [k for k in closed if k != element or oscillator._strobed]
        slots, count = self._mode.size, len(self._switches)
        columns: Any = list(zip(*self._switches, strict=True)) or [()] * 6
        times, rests, speeds = np.array(columns[:3], dtype=float)
        before, guards = np.array(columns[3:5], dtype=np.intp)
        states = np.array(columns[5]).reshape(count, 2, slots + 1)
        switches = Switches(times, rests, speeds, before, guards, states)
        turn = np.array(self._turn)
        return Trajectory(
            self._start,
            state_of(
                oscillator, self._state()[:, :-1], turn, speed, element, motion, tuple(closed)
            ),
            log,
            switches,
            tuple(automaton.regimes),
            automaton.table,
            self.impacts,
            self.ending,
            self._chatter_error,
            self.cells,
            self._touches,
            seconds,
            self._longest,
            self._time,
            self._ambiguous,
            max(self._time, self._searched),
        )
