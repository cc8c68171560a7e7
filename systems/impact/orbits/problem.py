"""The equations of periodic orbits of impact oscillators, smooth through grazing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import Refused, replaced
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import Condition, Event, WatchedProblem
from dynkit.orbits.newton import NoSolution
from dynkit.orbits.problem import PeriodicProblem, fractions
from dynkit.systems.impact.orbits import neutral
from dynkit.systems.impact.orbits.machine import Changes, residual_change
from dynkit.systems.impact.orbits.monodromy import factors, multipliers
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.orbits.responses import FreeMotion, forced_motion
from dynkit.systems.impact.orbits.solution import Solution
from dynkit.systems.impact.orbits.terms import EXACT, Terms, changes_alone
from dynkit.systems.impact.orbits.watching import condition_of, flights_are_open, watched
from dynkit.systems.impact.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

LARGEST = 50
"""Of so many coordinates at most: the cost grows with the third power of their number."""

# Impacts and impulses that agree so well, in their units, are the same.
_REPEATED = 1e-7


@final
class ImpactProblem(PeriodicProblem, WatchedProblem):
    """P(n,m): n impacts in m periods of the forcing.

    The unknowns are the phases (n,) at the impacts, not wrapped, the impulses (n,), changes of
    the relative velocity, and just before the first impact the modes (2b,) that no spring holds, or
    that dashpots couple to such. The equations: no gap, (n,); the rate of the gap just after the
    impact is r/(1 + r) of the impulse, (n,); those modes return, (2b,). Nothing in them knows
    whether the gap is open in between, or an impulse positive.

    Parameters
    ----------
    oscillator : ImpactMap
        At whose parameters the others than the free ones stay.
    names : tuple of str
    periods : int
    sides : (n,) int, 0 for the table and 1 for the far stop
    speed : float
        Typical size of impulses.

    References
    ----------
    J. Shaw, S. W. Shaw, The onset of chaos in a two-degree-of-freedom impacting system, Journal of
    Applied Mechanics 56 (1989) 168-174 (impulse responses).
    """

    def __init__(
        self,
        oscillator: ImpactMap,
        names: tuple[str, ...],
        periods: int,
        sides: Any,
        speed: float,
    ) -> None:
        self.oscillator = oscillator
        self._names = names
        self.periods = periods
        self.sides = np.asarray(sides, dtype=np.intp)
        self.speed = speed
        self._motion = forced_motion(oscillator._structure, oscillator._drive)
        self._base = Terms.of(oscillator, self._motion)
        self._known: list[tuple[bytes, tuple[FreeMotion, Terms]]] = []
        self._changes = Changes(self.system)
        self._last: tuple[bytes, Solution] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        # Without what is kept for the next call.
        names, sides = self._names, self.sides
        return ImpactProblem, (self.oscillator, names, self.periods, sides, self.speed)

    # --- parameters -------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        return self._names

    def free(self, *names: str) -> Self:
        return type(self)(self.oscillator, names, self.periods, self.sides, self.speed)

    @property
    def values(self) -> Array:
        return np.array([getattr(self.oscillator, name) for name in self._names], dtype=float)

    def system(self, p: Array) -> ImpactMap:
        """The oscillator with these values (k,) of the free parameters."""
        try:
            changes: Any = dict(zip(self._names, p.tolist(), strict=True))
            return replaced(self.oscillator, **changes)
        except Refused as refusal:
            raise NoSolution(str(refusal)) from refusal

    def parts(self, p: Array) -> tuple[FreeMotion, Terms]:
        """The last few are kept."""
        key = p.tobytes()
        for known, parts in self._known:
            if known == key:
                return parts
        if all(name in self._plain_names for name in self._names):
            # No need of a system for each value.
            changes = dict(zip(self._names, p.tolist(), strict=True))
            parts = self._motion, Terms.of(self.oscillator, self._motion, changes)
        else:
            system = self.system(p)
            motion = forced_motion(system._structure, system._drive)
            parts = motion, Terms.of(system, motion)
        self._known = [(key, parts), *self._known[:7]]
        return parts

    def at(self, x: Array, p: Array) -> Solution:
        """All responses at a place."""
        key = x.tobytes() + p.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = key, Solution(*self.parts(p), self.periods, self.sides, x.copy())
        return self._last[1]

    # --- equations --------------------------------------------------------------------------------

    @property
    def size(self) -> int:
        return 2 * len(self.sides) + len(self._units)

    @cached_property
    def _units(self) -> Array:
        """Typical sizes (2b,) of the modes that no spring holds, at the oscillator's parameters."""
        period = TWO_PI * self.periods / self._base.frequency
        return neutral.sizes(self._motion, period, self.speed)

    def scale(self, x: Array) -> Array:  # noqa: ARG002
        return np.append(np.repeat([1.0, self.speed], len(self.sides)), self._units)

    def residual(self, x: Array, p: Array) -> Array:
        s = self.at(x, p)
        r = s.terms.restitution
        length = self.speed / s.terms.frequency
        rates = s.gaps(1) - r / (1.0 + r) * s.impulses
        found = np.concatenate([s.gaps(0) / length, rates / self.speed])
        if len(self._units):
            missing = s.motion.neutral_numbers(s.end) - s.border
            found = np.append(found, missing / self._units)
        return found

    def rounding(self, x: Array, p: Array) -> Array:
        """What rounding leaves in the equations, (2n,): responses grow, and cancel, on the way."""
        s = self.at(x, p)
        gaps, rates = s.roundings(0) * s.terms.frequency, s.roundings(1)
        found = np.concatenate([gaps, rates]) / self.speed
        if len(self._units):
            found = np.append(found, s.rounded_ends / self._units)
        return found

    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        s = self.at(x, p)
        n, t = len(self.sides), s.terms
        g = s.responses
        back = g[:3] if multiplier == 1.0 else s.disturbed(multiplier)
        both = np.outer(s.signs, s.signs)
        out = np.empty((self.size, self.size), dtype=np.result_type(back, multiplier))
        for order in range(2):
            rows = slice(order * n, (order + 1) * n)
            # Its own impulse moves along with an impact, that of other periods as multiplied.
            moved = both * g[order + 1] * s.impulses
            mine = t.frequency ** (order + 1) * t.gap(self.sides, s.phases, order + 1)
            mine = mine + moved.sum(axis=1)
            out[rows, :n] = (np.diag(mine) - both * back[order + 1] * s.impulses) / t.frequency
            out[rows, n : 2 * n] = both * back[order]
        out[n : 2 * n, n : 2 * n] -= np.eye(n) * t.restitution / (1.0 + t.restitution)
        if len(self._units):
            neutral.add_to_linearization(out, s, multiplier)
        out[:n] *= t.frequency / self.speed
        out[n : 2 * n] /= self.speed
        out[2 * n :] /= self._units[:, None]
        return out

    def parameter_derivative(self, x: Array, p: Array) -> Array:
        return np.stack([self._by(name, x, p, k) for k, name in enumerate(self._names)], axis=1)

    def _by(self, name: str, x: Array, p: Array, k: int) -> Array:
        s = self.at(x, p)
        w = s.terms.frequency
        if name not in self._plain_names:
            if len(self._units) or self.oscillator.degrees_of_freedom > LARGEST:
                return self._numerically(x, p, k)
            gaps, rates = residual_change(self.system(p), s, self._changes.by(p, k))
            return np.concatenate([gaps * w, rates]) / self.speed
        closing = np.zeros(len(self._units))
        if len(closing) and name == "frequency":
            closing = neutral.by_frequency(s) / self._units
        return np.append(self._plainly(name, s), closing)

    def _plainly(self, name: str, s: Solution) -> Array:
        """Derivative (2n,) of the equations of the impacts by a parameter of `EXACT`."""
        n, t, w = len(self.sides), s.terms, s.terms.frequency
        none = np.zeros(n)
        if name == "frequency":
            impulses = s.signs * s.impulses
            parts = []
            for order in range(2):
                g = s.responses[order + 1] * s.since + s.by_period[order] * s.period
                free = g @ impulses
                if len(s.border):
                    drift = s.motion.mode.rate(s.carried).reshape(n, -1)
                    free = free + s.since[:, 0] * (drift @ s.motion.rows[order])
                parts.append(t.gap_rate(self.sides, s.phases, order) - s.signs * free / w)
            return np.concatenate([parts[0] * w + s.gaps(0), parts[1]]) / self.speed
        if name == "restitution":
            return np.concatenate([none, -s.impulses / (1.0 + t.restitution) ** 2 / self.speed])
        if name == "amplitude":
            turn = np.exp(1j * s.phases)
            return np.concatenate([-s.signs * turn.imag * w, -s.signs * turn.real * w]) / self.speed
        if name == "offset":
            return np.concatenate([-s.signs * w / self.speed, none])
        moved = np.where(self.sides == 1, -s.signs * t.signs[0], 0.0)
        return np.concatenate([moved * w / self.speed, none])

    @cached_property
    def _plain_names(self) -> frozenset[str]:
        """Of the names in closed form those that change nothing but themselves."""
        return frozenset(name for name in EXACT if changes_alone(self.oscillator, name))

    def _numerically(self, x: Array, p: Array, k: int) -> Array:
        """Derivative (2n,) by the free parameter number `k`, from differences of fourth order."""
        # Small beside a turn of the fastest mode over the period.
        turns = self.at(x, p).period * float(self.oscillator.natural_frequencies[-1])
        h = 5e-3 * max(abs(float(p[k])), 1e-2) / (1.0 + turns)

        def at(steps: float) -> Array:
            moved = p.copy()
            moved[k] += steps * h
            return self.residual(x, moved)

        try:
            return (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * h)
        except NoSolution:
            # At the end of what the system allows, from one side.
            sign = 1.0 if self._allows(p, k, h) else -1.0
            weights = (-25.0, 48.0, -36.0, 16.0, -3.0)
            terms = [a * at(sign * i) for i, a in enumerate(weights)]
            return np.asarray(sign * np.sum(terms, axis=0) / (12.0 * h))

    def _allows(self, p: Array, k: int, step: float) -> bool:
        moved = p.copy()
        moved[k] += step
        try:
            self.parts(moved)
        except NoSolution:
            return False
        return True

    # --- orbits -----------------------------------------------------------------------------------

    def multipliers(self, x: Array, p: Array) -> Any:
        return multipliers(self.at(x, p))

    def factors(self, x: Array, p: Array) -> tuple[Array, Array] | None:
        return factors(self.at(x, p))

    def orbit(self, x: Array, p: Array, history: Sequence[float] = ()) -> ImpactOrbit:
        fixed = type(self)(self.system(p), (), self.periods, self.sides, self.speed)
        return ImpactOrbit(fixed, x, tuple(history), Cost(0.0))

    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        n, turn = len(self.sides), TWO_PI * self.periods
        problem = type(self)(
            self.oscillator, self._names, 2 * self.periods, np.tile(self.sides, 2), self.speed
        )
        phases, impulses, border = np.split(x, [n, 2 * n])
        twice = np.concatenate([phases, phases + turn, impulses, impulses, border])
        a, b, c = np.split(disturbance, [n, 2 * n])
        return problem, twice, np.concatenate([a, -a, b, -b, c])

    def shortest(self, x: Array) -> tuple[ImpactProblem, Array]:
        n = len(self.sides)
        for k, periods, changes in self._repetitions(x):
            if abs(changes).max() < _REPEATED:
                once = type(self)(self.oscillator, self._names, periods, self.sides[:k], self.speed)
                return once, np.concatenate([x[:k], x[n : n + k], x[2 * n :]])
        return self, x

    def repetition(self, x: Array) -> float:
        parts = [changes for _, _, changes in self._repetitions(x)]
        return min((float(np.sqrt(np.mean(part**2))) for part in parts), default=np.inf)

    def _repetitions(self, x: Array) -> Iterator[tuple[int, int, Array]]:
        """Impacts and periods after which it may come again, and changes (2n,) until then."""
        n, m = len(self.sides), self.periods
        for k in fractions(n):
            if m % (n // k) == 0 and (np.roll(self.sides, -k) == self.sides).all():
                periods = m // (n // k)
                phases = np.append(x[k:n], x[:k] + TWO_PI * m) - TWO_PI * periods
                impulses = (np.roll(x[n : 2 * n], -k) - x[n : 2 * n]) / self.speed
                yield k, periods, np.concatenate([phases - x[:n], impulses])

    def canonical(self, x: Array) -> Array:
        n = len(self.sides)
        turn = np.exp(1j * x[:n])
        weights = (1.0 - 2.0 * self.sides) * x[n : 2 * n] / self.speed
        moments = np.array([turn, weights * turn, weights**2 * turn])
        return np.concatenate([moments.sum(axis=1).view(float), [weights.sum()]]) / n

    # --- what is watched --------------------------------------------------------------------------

    def events(self, x: Array, p: Array) -> list[Event]:
        return watched(self.at(x, p))

    def condition(self, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
        return condition_of(self, event, x, p)

    def admissible(self, x: Array, p: Array) -> bool:
        n = len(self.sides)
        if (x[n : 2 * n] <= 0.0).any():
            return False
        return flights_are_open(partial(self.system, p), self.at(x, p))

    def touching(self, event: int, x: Array, own: Array, p: Array) -> Mapping[str, float]:
        """Return where the gap touches: phase in [0, 2 pi), time from the first impact, side."""
        s = self.at(x, p)
        n, stops = len(self.sides), len(s.terms.signs)
        if event < n:
            at, side = float(s.phases[event]), int(self.sides[event])
        elif event < n + n * stops:
            at, side = float(own[0]), (event - n) % stops
        else:
            at, side = (
                float(s.phases[event - n - n * stops]),
                int(self.sides[event - n - n * stops]),
            )
        since = (at - float(s.phases[0])) % s.turn / s.terms.frequency
        return {"phase": at % TWO_PI, "time": since, "side": float(side)}

    def neighbours(self, event: int, x: Array, p: Array) -> list[tuple[Problem, Array, Array]]:
        """Return the same motion as an orbit of one impact more or fewer.

        Where the gap touches, an impulse of zero is added; where an impulse vanishes it is left
        out. Both are solutions, to rounding.
        """
        s = self.at(x, p)
        n, stops = len(self.sides), len(s.terms.signs)
        phases, impulses, sides, border = x[:n], x[n : 2 * n], self.sides, x[2 * n :]
        if event < n and n > 1:
            if event == 0 and len(border):
                border = s.before(1)
            phases, impulses = np.delete(phases, event), np.delete(impulses, event)
            sides = np.delete(sides, event)
        elif n <= event < n + n * stops:
            flight = s.flights[event - n]
            phase = phases[flight.start] + s.terms.frequency * flight.smallest[1]
            phases, impulses = np.append(phases, phase), np.append(impulses, 0.0)
            sides = np.append(sides, flight.side)
        else:
            return []
        order = np.argsort(phases)
        problem = type(self)(self.oscillator, self._names, self.periods, sides[order], self.speed)
        return [(problem, np.concatenate([phases[order], impulses[order], border]), p)]
