"""Chatter between an impact of an itinerary and contact, simulated with its derivative."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.differences import STEP
from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.elements.laws import ImpactLaw
from dynkit.systems.impact.orbits.itineraries.flying import Flights
from dynkit.systems.impact.orbits.itineraries.happening import Happening
from dynkit.systems.impact.orbits.itineraries.itinerary import way
from dynkit.systems.impact.orbits.machine import Machine, Rubs
from dynkit.systems.impact.simulation.runs import to_contact
from dynkit.systems.impact.simulation.state import Motion, beside, state_at, whole_states
from dynkit.systems.impact.simulation.trajectory import Trajectory, grouped

CHUNK, TAYLOR_CHUNK, MOST = 128, 32, 8192
"""Impacts of a chatter simulated at first, those at first by Taylor's method, and their limit."""

_NEARLY = 1e-3
"""A chatter nearly completes if its slowest impact has this part of the largest impulse or less."""


class Steps(NamedTuple):
    """Derivatives of n flights and of the impacts that end them: arguments of `carry`."""

    flown: Array
    hits: Array
    which: NDArray[np.intp]
    movings: Array
    delays: Array
    delay: Array
    more: Array


@final
class Chatter:
    """The impacts between an impact with a stop and the contact that follows.

    A chatter that nearly completes, but does not, is cut after its slowest impact.

    Parameters
    ----------
    oscillator : ImpactMap
    machine : Machine
        Real machine of the oscillator.
    event : Happening
        The impact before the chatter.
    flights : tuple of two
        Flights of the chatter, and of contact.
    state : (D,)
        The state just after this impact, on the stop.
    fastest : float
        Largest change of velocity by an impact of the orbit.
    rebounds : bool
        Whether this impact rebounds; otherwise contact follows at once.

    Attributes
    ----------
    run : Trajectory
        The impacts (n,), without contact.
    complete : bool
        Whether contact follows without a cut.
    begin : (D,)
        State with which contact begins.
    start : (D,)
        The state just after the impact before the chatter.

    Raises
    ------
    NoSolution
        When the chatter is neither complete nor nearly complete.
    """

    def __init__(
        self,
        oscillator: Any,
        machine: Machine,
        event: Happening,
        flights: tuple[Flights, Flights],
        state: Array,
        fastest: float,
        rebounds: bool,
    ) -> None:
        assert event.kicked is not None
        self._flights, self._held = flights
        self.machine, self.element, self.flying = machine, event.element, event.kicked
        self._rub = [k for k, _ in event.rubs]
        self.start, self.rebounds = state, rebounds
        self._kept: tuple[Array, Array, Steps, list[Any]] | None = None
        self._followed = event._replace(mode=event.kicked)
        n, rate = machine.size, self._flights.rate_of(self.element, state)[0]
        speed = rebounds * float(rate)
        if not (speed >= 0.0 and np.isfinite(state).all()):
            raise NoSolution("the chatter must begin with an impact that pushes")
        turn, numbers = state[-3:-1], self.flying.numbers
        slide = () if oscillator._motion else (k for k in machine.sliders if numbers[k])
        closed = (*self.flying.held, *slide)
        x, v = np.append(state[:n], state[2 * n : -3]), beside(oscillator, state[n : 2 * n])
        start = state_at(oscillator, x, v, turn, speed, self.element, Motion.TABLE, closed)
        self.run = self._to_contact(oscillator, start, fastest)
        self.begin = self._landed(self._held, self._last)[0]

    def _to_contact(self, oscillator: Any, start: Any, fastest: float) -> Trajectory:
        count = CHUNK if oscillator._motion is None else TAYLOR_CHUNK
        while True:
            run, follows = to_contact(oscillator, start, count)
            kinds, elements = run.guards[run.switches.guard][:, [3, 1]].T
            (at,) = np.nonzero((kinds == EventKind.CONTACT) & (elements == self.element))
            k = int(run.switches.before[at[0]]) if len(at) else run.impacts
            states = _states(run, k)
            away = self._lifts_off(run, states)
            if k < count or follows or away.any() or count >= MOST:
                break
            count *= 4
        follows = follows or len(at) > 0
        self.complete = follows and not away.any()
        if follows and run.switches.time[: at[0] if len(at) else None].any():
            raise NoSolution("nothing else may happen during a chatter")
        if not self.complete:
            speeds = run.speeds
            most = int(np.argmax(away)) if away.any() else k
            k = int(np.argmin(speeds[: most + 1]))
            if speeds[k] > _NEARLY * fastest:
                raise NoSolution("the chatter must be complete")
        self.after = states[:k]
        begun = int(np.searchsorted(run.switches.time, 0.0, side="right"))
        return replace(run.part(0, k), switches=run.switches.until(begun))

    def _lifts_off(self, run: Trajectory, after: Array) -> Any:
        """Whether each flight, which ends at an impact with state `after` (n, D), ends the chatter.

        It does if it is longer than the one before and the gap's acceleration is positive at its
        end, or if its impact is with another stop. Without rebound there is no chatter, and all do.
        """
        count = len(after)
        if not self.rebounds:
            return np.ones(count, dtype=bool)
        flights = np.diff(run.time[:count], prepend=0.0)
        bend, change = self._flights.bends(self.element, self._since(after))
        freed = bend + np.maximum(change, 0.0) * flights >= 0.0
        longer = flights > np.append(np.inf, flights[:-1])
        return (freed & longer) | (run.element[:count] != self.element)

    @property
    def _last(self) -> Array:
        """The state (D,) just after the last impact."""
        return self.after[-1] if len(self.after) else self.start

    @cached_property
    def _flights_last(self) -> Array:
        """Durations (n,) of the flights that end at the impacts."""
        return np.diff(self.run.time, prepend=0.0)

    @cached_property
    def lasts(self) -> float:
        """Time until contact begins."""
        return float(self.run.time[-1]) if self.run.impacts else 0.0

    @cached_property
    def error(self) -> float:
        """Largest change of a position or velocity by the omission of bounces."""
        system: Any = self.run.start._system
        run = system._run(self.run.start, self.run.impacts + 1, store=False)
        return float(run.chatter_error)

    @property
    def pressing(self) -> float:
        """Contact force where contact begins; negative where the chatter does not complete."""
        force, rate = self._held.force(self.element, self.begin)
        if self.complete or not self.rebounds:
            return force
        # the velocity at the cut is proportional to the square of the missing force
        speed = float(self.run.speeds[-1])
        return -math.sqrt(speed * abs(rate))

    def _landed(self, held: Flights, state: Any) -> tuple[Any, Any]:
        """The state (D,) in contact, with gap and rate zero, and its derivative (D, D)."""
        put, by = held.begun(self._followed._replace(chatters=True), state)
        found, caught = held.begun(self._followed._replace(chatters=False), put)
        return found, caught @ by

    def carried(
        self, machine: Machine, flights: Flights, held: Flights, changes: Array
    ) -> tuple[Array, Array]:
        """Changes (D, k) of the state with which contact begins, and (k,) of the time until then.

        The times of impacts change so that the gap stays zero. Late in a chatter, gap rates are far
        below the rounding errors of velocities, and changes of the state in a flight are far below
        those of states. So the rates are those of the simulation, and the gap at the begin of each
        flight is exactly zero.

        Parameters
        ----------
        machine : Machine
            With imaginary parts where its numbers change.
        flights, held : Flights
            Flights of the chatter, and of contact, with these imaginary parts.
        changes : (D, k)
            Changes of the state just after the impact before the chatter, on the stop.
        """
        late = np.zeros(changes.shape[1])
        if self.run.impacts:
            from dynkit.systems.impact.orbits.itineraries.several_modes.chatter_kernels import carry

            steps = (_varying_steps if flights.varies else Chatter._steps)(self, machine, flights)
            changes, delayed = np.array(changes, order="C"), np.empty((2, len(late)))
            carry(*steps, changes, np.empty_like(changes), delayed)
            late = delayed[1]
        landed, by = self._landed(held, self._last)
        return by @ changes + (landed.imag / STEP)[:, None], late

    def _steps(self, m: Machine, flights: Flights) -> Steps:
        """See `Steps`; all that does not depend on changes of the numbers is kept."""
        moved, rates, steps, parts = self._kept or self._matrices(m, flights)
        self._kept = moved, rates, steps, parts
        if not m.changes:
            return steps
        since = self._since(self.after)
        more = np.zeros(since.shape)
        k, added = self.element, flights.carried(since, self._flights_last)
        row, gap_changed = m.gap(k).real, m.gap(k).imag / STEP
        delay = -(added @ row + moved @ gap_changed) / rates
        r, slopes, r_changed = m.rebounds(k, rates)
        jumps = -(1.0 + r) * rates
        for rubs, i, landed, back, put in parts:
            kick, stop = m.kick(self.flying, k, rubs), m.stopped(self.flying, rubs)
            faster = landed @ (m.rate(k).imag / STEP)
            changed = np.outer((1.0 + slopes[i]) * faster + rates[i] * r_changed[i], kick.real)
            changed -= np.outer(jumps[i], kick.imag / STEP)
            after = landed + np.outer(jumps[i], kick.real)
            more[i] = (put @ added[i][:, :, None])[..., 0]
            more[i] += after @ (stop.imag / STEP).T - changed @ stop.real.T
            more[i] -= (landed @ gap_changed)[:, None] * back
        return steps._replace(delay=delay, more=more)

    def _since(self, after: Array) -> Array:
        """States (n, D) with which flights begin, from those after the impacts at their ends."""
        return np.concatenate([self.start[None], after])[:-1]

    def _matrices(self, m: Machine, flights: Flights) -> tuple[Array, Array, Steps, list[Any]]:
        """Derivatives for `_steps`, without changes of numbers; `parts` group impacts of one slip.

        Returns the changes of states in flights, the gap rates before impacts, the steps, and the
        parts.
        """
        k, since, parts = self.element, self._since(self.after), list[Any]()
        row = m.gap(k).real
        lasts = self._flights_last
        flown, ends = flights.lifted(since, lasts)
        moved = (flown @ since[:, :, None])[..., 0]
        rates = self._rates(m, ends @ m.rate(k).real)
        delays = -(row @ flown) / rates[:, None]
        which, movings = np.empty(len(since), dtype=np.intp), np.empty_like(since)
        r, slopes, _ = m.rebounds(k, rates)
        jumps = -(1.0 + r) * rates
        ways = self._ways(flights, ends, jumps)
        for own in set(map(tuple, ways.tolist())):
            i = (ways == own).all(axis=1)
            rubs = tuple(zip(self._rub, own, strict=True))
            kick, stop = m.kick(self.flying, k, rubs).real, m.stopped(self.flying, rubs).real
            landed = self.after[i] - np.outer(jumps[i], kick)
            if 0 in own:  # the slip before the impact does not follow from the state after it
                landed = ends[i]
            slope = slopes[i]
            if (slope == slope[0]).all():  # one matrix for all impacts
                slope = slope[:1]
            lost = (1.0 + slope)[:, None, None] * np.outer(kick, m.rate(k).real)
            through = stop @ (np.eye(len(row)) - lost)
            back = through @ m.shift(k)
            put = through - back[:, :, None] * row
            movings[i] = (put @ flights.rates(landed)[:, :, None])[..., 0]
            which[i] = sum(len(part[-1]) for part in parts) + np.arange(len(landed)) % len(put)
            parts.append((rubs, i, landed, back, put))
        hits = np.concatenate([part[-1] for part in parts])
        none = np.zeros(len(since)), np.zeros(since.shape)
        return moved, rates, Steps(flown, hits, which, movings, delays, *none), parts

    def _rates(self, m: Machine, near: Array) -> Array:
        """Rates (n,) of the gap before the impacts; `near` are the same with fewer digits."""
        law: Any = getattr(m.elements[self.element], "restitution", None)
        if isinstance(law, ImpactLaw):
            return -law.approach(-near, self.run.log.speed)
        return np.asarray(-self.run.log.speed / float(m.restitution(self.element).real))

    def _ways(self, flights: Flights, before: Array, jumps: Array) -> NDArray[np.intp]:
        """Signs (n, f) of slip at the impacts, from changes `jumps` of the gap rate: see `Rubs`."""
        if not self._rub:
            return np.empty((len(jumps), 0), dtype=np.intp)
        found = [
            [
                way(float(flights.rate_of(k, z)[0].real), flights.takes(k, z) * jump)
                for k in self._rub
            ]
            for z, jump in zip(before, jumps.tolist(), strict=True)
        ]
        return np.array(found, dtype=np.intp)


def _states(run: Trajectory, count: int) -> Array:
    """States (count, D) just after the first impacts of a run."""
    log, system = run.log, run.start._system
    n = system.degrees_of_freedom
    out = np.empty((count, n + system._size + 3))
    phases = run.start.phase + system.frequency * log.time[:count]
    for number, where in grouped(log.guard[:count]):
        mode = system._automaton.mode(run.regimes[int(run.guards[number, 0])])
        states = log.states[:count][where][..., : mode.layout.slots]
        out[where] = whole_states(mode, states, phases[where])
    return out


def _taken(flights: Any, rubs: Rubs, pushed: tuple[Array, Array], by: Array) -> Any:
    """Derivative (D, D) after an impact that may stop slips, and change (D,) by numbers.

    `pushed` is the state with these slips and its change; `by` is its derivative.
    """
    if all(way for _, way in rubs):
        return by, pushed[1]
    state, stopped = flights.stopped(rubs, pushed[0] + 1j * pushed[1])
    return stopped @ by, state.imag


def _varying_steps(chatter: Chatter, machine: Machine, flights: Any) -> Steps:
    """See `Steps`; here rows and kicks depend on the state.

    The gap is zero at both ends of a flight, but its row differs. Late in a chatter this difference
    is far below the rounding errors of rows; so it is integrated along the flight: see `rolled`.
    The same is done for the changes of the gap due to changed numbers.
    """
    k, since = chatter.element, chatter._since(chatter.after)
    lasts = chatter._flights_last
    (flown, ends), added = flights.lifted(since, lasts), flights.carried(since, lasts)
    near = [float(flights.rate_of(k, z)[0].real) for z in ends]
    rates = chatter._rates(machine, np.array(near))
    r, slopes, r_changed = machine.rebounds(k, rates)
    ways = chatter._ways(flights, ends, -(1.0 + r) * rates).tolist()
    turned, moved = flights.rolled(k, since, lasts)
    n, unit = machine.size, np.eye(since.shape[1])
    gap_changed = machine.gap(k).imag / STEP
    found = []
    for i, rate in enumerate(rates.tolist()):
        rubs = tuple(zip(chatter._rub, ways[i], strict=True))
        kick = flights.kick(k, chatter.after[i], rubs)
        push, pull = (1.0 + r[i]) * kick, (1.0 + slopes[i]) * kick.real
        # a slip that the impact stopped does not follow from the state after it
        before = ends[i] if 0 in ways[i] else chatter.after[i] + rate * push.real
        (gap, row), (closing, by_rate) = flights.gap_of(k, before), flights.rate_of(k, before)
        shift, row = np.zeros(len(before)), row.real
        shift[:n] = row[:n] / (row[:n] @ row[:n])
        hit = unit - np.outer(pull, by_rate.real)
        hit -= (1.0 + r[i]) * rate * flights.turned(k, before, rubs)
        later = -(row @ flown[i] + turned[i]) / rate
        delay = -(row @ added[i] + flown[i] @ since[i] @ gap_changed + moved[i]) / rate
        changed = -rate * (push.imag + STEP * r_changed[i] * kick.real)
        changed -= hit @ shift * gap.imag + pull * closing.imag
        hit, changed = _taken(flights, rubs, (before - rate * push.real, changed), hit)
        put = hit @ (unit - np.outer(shift, row))
        moving, more = put @ flights.rate(before), put @ added[i] + changed / STEP
        found.append((put, moving, later, delay, more))
    hits, *others = map(np.array, zip(*found, strict=True))
    return Steps(flown, hits, np.arange(len(hits)), *others)
