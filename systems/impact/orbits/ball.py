"""The equations of periodic orbits of a ball on a vibrating table, smooth through grazing."""

# ruff: noqa: ARG002 (arguments that an equation does not contain)

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, Self, final

import numpy as np
from scipy.optimize import brentq

from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array
from dynkit.orbits.map_orbit import StatesProblem
from dynkit.orbits.map_problem import ROUNDINGS
from dynkit.orbits.newton import NoSolution
from dynkit.orbits.problem import Condition, Event, Problem
from dynkit.systems.impact.state import TWO_PI

_EPSILON = 2.0**-52


def whole_turns(ball: Any, states: Array) -> Any:
    """Return how many turns, (n,) of int, to add to the next phase so that a flight ends there."""
    turns = []
    for state, following in zip(states, np.roll(states, -1, axis=0), strict=True):
        run = ball._run(ball.impact_state(state), 1, store=True)
        lasts = ball.frequency * float(run.time[0])
        turns.append(round((state[-1] + lasts - following[-1]) / TWO_PI))
    return np.array(turns, dtype=np.intp)


@final
class Bounces:
    """The flights between the impacts of an orbit, as functions of the phase since an impact.

    Lengths are in units of gravity / frequency^2, velocities of gravity / frequency; the strength
    Gamma is amplitude frequency^2 / gravity. With U the relative velocity after the impact at phase
    phi, the gap at phase phi + s is

        G(s) = (U + Gamma cos(phi)) s - s^2 / 2 - Gamma (sin(phi + s) - sin(phi)).

    Parameters
    ----------
    ball : BouncingBall
    states : (n, 2) array
        Velocities u after the impacts, and phases.
    turns : (n,) int
        Added to the next phase they give the phase at which a flight ends.
    """

    def __init__(self, ball: Any, states: Array, turns: Any) -> None:
        self.ball = ball
        self.strength = ball.amplitude * ball.frequency**2 / ball.gravity
        self.speeds = states[:, 0] * ball.frequency / ball.gravity
        self.phases = states[:, 1]
        self.lasts = np.roll(self.phases, -1) + TWO_PI * turns - self.phases

    def gap(self, i: Any, since: Any, order: int = 0) -> Any:
        """Return a derivative of the gap in flight i; arrays are taken together."""
        phase, strength = self.phases[i], self.strength
        if order == 2:
            return strength * np.sin(phase + since) - 1.0
        start = self.speeds[i] + strength * np.cos(phase)
        if order == 1:
            return start - since - strength * np.cos(phase + since)
        swing = np.sin(phase + since) - np.sin(phase)
        return start * since - 0.5 * since**2 - strength * swing

    @cached_property
    def rates(self) -> Array:
        """Relative velocities (n,) just before the impacts that end the flights."""
        return np.asarray(self.gap(np.arange(len(self.phases)), self.lasts, 1))

    def roundings(self) -> tuple[Array, Array]:
        """What rounding leaves in the gaps and in the rates at the ends of the flights, (n,)."""
        angle = abs(self.phases) + abs(self.lasts)
        speed = abs(self.speeds) + self.strength * (2.0 + angle) + abs(self.lasts)
        length = speed * abs(self.lasts) + self.strength * (2.0 + angle)
        return ROUNDINGS * _EPSILON * length, ROUNDINGS * _EPSILON * speed

    def smallest(self, i: int) -> tuple[float, float]:
        """Return the least minimum of the gap within flight i, and when; infinite without one.

        Between the places where the second derivative is zero the rate is monotonic: a minimum is
        in an interval through which the rate rises from a negative to a positive value.
        """
        last = float(self.lasts[i])
        if self.strength <= 1.0 or not last > 0.0:
            return math.inf, math.nan
        rising = math.asin(1.0 / self.strength)
        ends = [(place - self.phases[i]) % TWO_PI for place in (rising, math.pi - rising)]
        count = math.ceil(last / TWO_PI)
        turns = [end + TWO_PI * k for k in range(count) for end in ends]
        places = [0.0, *sorted(turn for turn in turns if turn < last), last]
        found = (math.inf, math.nan)
        for a, b in pairwise(places):
            if self.gap(i, 0.5 * (a + b), 2) > 0.0 and self.gap(i, a, 1) < 0.0 < self.gap(i, b, 1):
                at = float(brentq(lambda since: self.gap(i, since, 1), a, b, xtol=1e-15))
                found = min(found, (float(self.gap(i, at)), at))
        return found


@final
class BallProblem(StatesProblem):
    """P(n,m) of a `BouncingBall`: n impacts in m periods of the table.

    The unknowns are (u, phase) just after each impact, as in the impact map. The equations: the gap
    is zero where a flight ends, and the next velocity is -restitution times the rate there. Nothing
    in them contains whether the gap is open in between, or an impulse positive: they continue the
    orbits smoothly beyond grazing, where they are no motions.

    Parameters
    ----------
    ball : BouncingBall
    states : (n, 2) array
    turns : (n,) int
        As for `Bounces`; their sum is m.
    names : sequence of str
        The free parameters.

    References
    ----------
    J. M. Luck, A. Mehta, Bouncing ball with a finite restitution: chattering, locking, and chaos,
    Physical Review E 48 (1993) 3988-3997.
    """

    def __init__(
        self, ball: SmoothMap, states: Array, turns: Any, names: Sequence[str] = ()
    ) -> None:
        super().__init__(ball, states, names)
        self._turns = turns
        s = Bounces(ball, states, turns)
        speed = max(1.0, s.strength, float(abs(s.speeds).max()), float(abs(s.lasts).max()))
        self.unit: float = speed
        """Unit of the rates, in gravity / frequency: the largest of what they are made of."""

    @property
    def periods(self) -> int:
        """The number m of periods of the table."""
        return int(self._turns.sum())

    @property
    def label(self) -> str:
        return f"P({len(self._like)},{self.periods})"

    def made_of(self, system: SmoothMap, states: Array, which: Any, names: Sequence[str]) -> Self:
        return type(self)(system, states, self._turns[which], names)

    def states(self, x: Array) -> Array:
        return self._rows(x) % [math.inf, TWO_PI]

    def bounces(self, x: Array, p: Array) -> Bounces:
        """The flights at a place."""
        return Bounces(self.at(p), self._rows(x), self._turns)

    def residual(self, x: Array, p: Array) -> Array:
        s = self.bounces(x, p)
        gaps = s.gap(np.arange(len(s.phases)), s.lasts)
        rates = s.ball.restitution * s.rates + np.roll(s.speeds, -1)
        return np.stack([gaps, rates], axis=1).ravel() / self.unit

    def rounding(self, x: Array, p: Array) -> Array:
        return np.stack(self.bounces(x, p).roundings(), axis=1).ravel() / self.unit

    def blocks(self, x: Array, p: Array) -> tuple[Array, Array]:
        s = self.bounces(x, p)
        r, to_units = s.ball.restitution, s.ball.frequency / s.ball.gravity
        each, none = np.arange(len(s.phases)), np.zeros(len(s.phases))
        falls, presses = -s.gap(each, 0.0, 2), s.gap(each, s.lasts, 2)
        by_phase = s.lasts * falls - s.speeds
        here = [[s.lasts * to_units, by_phase], [none + r * to_units, r * falls]]
        there = [[none, s.rates], [none + to_units, r * presses]]
        by_state, by_next = (np.moveaxis(np.array(rows), -1, 0) for rows in (here, there))
        return by_state / self.unit, by_next / self.unit

    def factors(self, x: Array, p: Array) -> tuple[Array, Array]:
        here, there = self.blocks(x, p)
        if (there[:, 0, 1] == 0.0).any():
            raise NoSolution("an impact that only grazes has no derivative")
        back = np.linalg.inv(there)
        off = (abs(back) @ abs(there) @ abs(back) @ abs(here)).max(axis=(1, 2))
        return -back @ here, 4.0 * ROUNDINGS * _EPSILON * off

    def parameter_derivative(self, x: Array, p: Array) -> Array:
        s = self.bounces(x, p)
        r = s.ball.restitution
        ends = s.phases + s.lasts
        swing = np.sin(ends) - np.sin(s.phases)
        by_strength = s.lasts * np.cos(s.phases) - swing, r * (np.cos(s.phases) - np.cos(ends))
        by_units = s.lasts * s.speeds, r * s.speeds + np.roll(s.speeds, -1)
        none, strength = np.zeros(len(swing)), s.strength
        w, g = s.ball.frequency, s.ball.gravity
        known = {
            "amplitude": [w**2 / g * part for part in by_strength],
            "frequency": [
                (2.0 * strength * a + b) / w for a, b in zip(by_strength, by_units, strict=True)
            ],
            "gravity": [
                -(strength * a + b) / g for a, b in zip(by_strength, by_units, strict=True)
            ],
            "restitution": [none, s.rates],
        }
        columns = [np.stack(known[name], axis=1).ravel() / self.unit for name in self._names]
        return np.stack(columns, axis=1) if columns else np.empty((self.size, 0))

    # --- what is watched --------------------------------------------------------------------------

    def events(self, x: Array, p: Array) -> list[Event]:
        """Approach speeds, least gaps within the flights, accelerations without rebound.

        A flight from or to an impact that pulls begins or ends below the table, and one without
        rebound may begin into it: their least gaps tell nothing.
        """
        s = self.bounces(x, p)
        pulled = (s.rates > 0.0) | (np.roll(s.rates, 1) > 0.0)
        dead = s.ball.restitution == 0.0
        each = range(len(s.phases))
        lifted = [float(s.gap(i, 0.0, 2)) if dead else math.inf for i in each]
        found = [Event("GR", i, float(-s.rates[i])) for i in each]
        for i in each:
            blind = pulled[i] or lifted[i] < 0.0
            found.append(Event("GR", i, math.nan if blind else s.smallest(i)[0]))
        return found + [Event("CB", i, lifted[i]) for i in each]

    def condition(self, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
        kind, i = divmod(event, len(self._like))
        if kind == 1:
            return _Touching(self, i), np.array([self.bounces(x, p).smallest(i)[1]])
        return _Vanishing(self, i, kind == 2), np.empty(0)

    def admissible(self, x: Array, p: Array) -> bool:
        # negative where a gap closes, and NaN where that cannot be: then an impulse is negative
        s = self.bounces(x, p)
        return bool((s.lasts > 0.0).all()) and all(e.value >= 0.0 for e in self.events(x, p))

    def touching(self, event: int, x: Array, own: Array, p: Array) -> Mapping[str, float]:
        """Return where the gap touches: phase in [0, 2 pi), time from the first impact."""
        s = self.bounces(x, p)
        kind, i = divmod(event, len(s.phases))
        within = (float(s.lasts[i]), float(own[0]) if len(own) else 0.0, 0.0)[kind]
        since = float(s.lasts[:i].sum()) + within
        phase = float(s.phases[i] + within) % TWO_PI
        return {"phase": phase, "time": since / s.ball.frequency}

    def neighbours(self, event: int, x: Array, p: Array) -> list[tuple[Problem, Array, Array]]:
        """Return the same motion as an orbit of one impact more or fewer.

        Where the gap touches, an impact with no velocity is added; an impact that vanishes is left
        out.
        """
        s = self.bounces(x, p)
        n = len(s.phases)
        kind, i = divmod(event, n)
        speeds = self._rows(x)[:, 0]
        # not wrapped: only the last flight ends in a state of another period
        phases = s.phases[0] + np.append(0.0, np.cumsum(s.lasts)[:-1])
        periods = self.periods
        if kind == 1:
            speeds = np.insert(speeds, i + 1, 0.0)
            phases = np.insert(phases, i + 1, phases[i] + s.smallest(i)[1])
        elif kind == 0 and n > 1:
            gone = (i + 1) % n
            speeds, phases = np.delete(speeds, gone), np.delete(phases, gone)
        else:
            return []
        states = np.stack([speeds, phases], axis=1)
        turns = np.zeros(len(states), dtype=np.intp)
        turns[-1] = periods
        problem = type(self)(self._system, states, turns, self._names)
        return [(problem, states.ravel(), p)]


@final
class _Vanishing(Condition):
    """The approach speed of an impact is zero; or the acceleration after one without rebound."""

    unknowns = 0

    def __init__(self, problem: BallProblem, i: int, lifted: bool) -> None:
        self._problem, self._i, self._lifted = problem, i, lifted

    def residual(self, x: Array, own: Array, p: Array) -> Array:
        s = self._problem.bounces(x, p)
        value = s.gap(self._i, 0.0, 2) if self._lifted else s.rates[self._i]
        return np.array([value / self._problem.unit])


@final
class _Touching(Condition):
    """The gap is zero and has its minimum, at a phase since the impact of its own."""

    unknowns = 1

    def __init__(self, problem: BallProblem, i: int) -> None:
        self._problem, self._i = problem, i

    def residual(self, x: Array, own: Array, p: Array) -> Array:
        s = self._problem.bounces(x, p)
        parts = [s.gap(self._i, own[0], order) for order in range(2)]
        return np.array(parts) / self._problem.unit
