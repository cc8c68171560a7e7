"""The equations of periodic orbits P(n,m), smooth through grazing."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple, Self, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.modes.impulse_responses import FreeMotion, forced_motion
from dynkit.systems.impact.modes.structure import Contact
from dynkit.systems.impact.orbits.flights import Flight
from dynkit.systems.impact.orbits.impulses import neutral
from dynkit.systems.impact.orbits.impulses.monodromy import factors, multipliers
from dynkit.systems.impact.orbits.impulses.openness import flights_are_open
from dynkit.systems.impact.orbits.impulses.solution import ROUNDING, ImpulseSolution
from dynkit.systems.impact.orbits.impulses.terms import Terms
from dynkit.systems.impact.orbits.machine import difference, residual_change
from dynkit.systems.impact.orbits.problem import APART, ImpactProblem
from dynkit.systems.impact.simulation.parameters import EXACT, changes_alone
from dynkit.systems.impact.simulation.state import TWO_PI

LEAST = 1e-13
"""Smaller impulses are rounding: at resonance those of all orbits are zero."""

LARGEST = 50
"""Of so many coordinates at most: the cost grows with the third power of their number."""


class Scene(NamedTuple):
    """A structure, how it moves freely, and what acts on it."""

    contact: Contact
    motion: FreeMotion
    terms: Terms


@final
class ImpulseEquations(ImpactProblem[ImpulseSolution]):
    """P(n,m): n impacts in m periods of the forcing.

    The unknowns are the phases (n,) at the impacts, not wrapped, the impulses (n,), changes of
    the relative velocity, and just before the first impact the modes (2b,) that no spring holds, or
    that dashpots couple to such. The equations: no gap, (n,); the rate of the gap just after the
    impact is r/(1 + r) of the impulse, (n,); those modes return, (2b,). Nothing in them knows
    whether the gap is open in between, or an impulse positive.

    The itinerary, (n,) int, is of which stop each impact is: 0 for the table and 1 for the far one;
    the size is a typical impulse.

    References
    ----------
    J. Shaw, S. W. Shaw, The onset of chaos in a two-degree-of-freedom impacting system, Journal of
    Applied Mechanics 56 (1989) 168-174 (impulse responses).
    """

    sticks = False

    def _scene(self, p: Array) -> Scene:
        contact, motion, _ = self._here
        if self._plain_names.issuperset(self._names):
            # No need of a system for each value.
            changes = dict(zip(self._names, p.tolist(), strict=True))
            return Scene(contact, motion, Terms.of(self.oscillator, motion, changes))
        system = self.system(p)
        motion = forced_motion(system._contact, system._excitation)
        return Scene(system._contact, motion, Terms.of(system, motion))

    @cached_property
    def _here(self) -> Scene:
        """At the oscillator's parameters."""
        motion = forced_motion(self.oscillator._contact, self.oscillator._excitation)
        return Scene(self.oscillator._contact, motion, Terms.of(self.oscillator, motion))

    def _solution(self, x: Array, scene: Scene) -> ImpulseSolution:
        return ImpulseSolution(*scene, self.periods, self.sides, x)

    @cached_property
    def sides(self) -> Any:
        """Of which stop each impact is, (n,)."""
        return np.asarray(self.itinerary, dtype=np.intp)

    @property
    def speed(self) -> float:
        """Typical size of impulses."""
        return float(self.sizes)

    # --- equations --------------------------------------------------------------------------------

    @property
    def size(self) -> int:
        return 2 * len(self.sides) + len(self._units)

    @cached_property
    def _units(self) -> Array:
        """Typical sizes (2b,) of the modes that no spring holds, at the oscillator's parameters."""
        period = TWO_PI * self.periods / self._here.terms.frequency
        return neutral.sizes(self._here.motion, period, self.speed)

    @cached_property
    def _scale(self) -> Array:
        found = np.append(np.repeat([1.0, self.speed], len(self.sides)), self._units)
        found.setflags(write=False)
        return found

    def scale(self, x: Array) -> Array:  # noqa: ARG002
        return self._scale

    def residual(self, x: Array, p: Array) -> Array:
        s = self.at(x, p)
        r = s.terms.restitution
        length = self.speed / s.terms.frequency
        rates = s.gaps[1] - r / (1.0 + r) * s.impulses
        found = np.concatenate([s.gaps[0] / length, rates / self.speed])
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
        both, own = s.signs[:, None] * s.signs, np.arange(n)
        pushed = both * s.impulses
        out = np.empty((self.size, self.size), dtype=np.result_type(back, multiplier))
        rows = out[: 2 * n].reshape(2, n, -1)
        rows[..., :n] = -pushed * back[1:]
        # Its own impulse moves along with an impact, that of other periods as multiplied.
        rows[:, own, own] += s.steady[1:] + (pushed * g[1:3]).sum(axis=2)
        rows[..., :n] /= t.frequency
        rows[..., n : 2 * n] = both * back[:2]
        rows[1, own, n + own] -= t.restitution / (1.0 + t.restitution)
        if len(self._units):
            neutral.add_to_linearization(out, s, multiplier)
        out[:n] *= t.frequency / self.speed
        out[n : 2 * n] /= self.speed
        if len(self._units):
            out[2 * n :] /= self._units[:, None]
        return out

    def _by(self, x: Array, p: Array, k: int) -> Array:
        s, name = self.at(x, p), self._names[k]
        w = s.terms.frequency
        if name not in self._plain_names:
            if len(self._units) or self.oscillator.degrees_of_freedom > LARGEST:
                return self._numerically(x, p, k)
            gaps, rates = residual_change(self.system(p), s, self._changes.by(p, k))
            return np.concatenate([gaps * w, rates]) / self.speed
        found = self._plainly(name, s)
        if len(self._units):
            closes = name == "frequency"
            closing = neutral.by_frequency(s) / self._units if closes else 0.0 * self._units
            found = np.append(found, closing)
        return found

    def _plainly(self, name: str, s: ImpulseSolution) -> Array:
        """Derivative (2n,) of the equations of the impacts by a parameter of `EXACT`."""
        n, t, w = len(self.sides), s.terms, s.terms.frequency
        gaps, rates = np.zeros((2, n))
        if name == "frequency":
            g = s.responses[1:3] * s.since + s.by_period * s.period
            free = g @ (s.signs * s.impulses)
            if len(s.border):
                drift = s.motion.mode.rate(s.carried).reshape(n, -1)
                free += s.since[:, 0] * (s.motion.rows[:2] @ drift.T)
            gaps, rates = t.gaps_by_frequency(self.sides, s.turning) - s.signs * free / w
            gaps = gaps * w + s.gaps[0]
        elif name == "restitution":
            rates = -s.impulses / (1.0 + t.restitution) ** 2
        elif name == "amplitude":
            gaps, rates = -s.signs * s.turning.imag * w, -s.signs * s.turning.real * w
        elif name == "offset":
            gaps = -s.signs * w
        else:
            gaps = np.where(self.sides == 1, -s.signs * t.signs[0], 0.0) * w
        return np.concatenate([gaps, rates]) / self.speed

    @cached_property
    def _plain_names(self) -> frozenset[str]:
        """Of the names in closed form those that change nothing but themselves."""
        return frozenset(name for name in EXACT if changes_alone(self.oscillator, name))

    def _numerically(self, x: Array, p: Array, k: int) -> Array:
        """Derivative (2n + 2b,) by the free parameter number `k`, from differences."""
        # Small beside a turn of the fastest mode over the period.
        turns = self.at(x, p).period * float(self.oscillator.natural_frequencies[-1])
        h = 5e-3 * max(abs(float(p[k])), 1e-2) / (1.0 + turns)

        def residual(value: float) -> Array:
            moved = p.copy()
            moved[k] = value
            return self.residual(x, moved)

        return difference(residual, float(p[k]), h)

    # --- orbits -----------------------------------------------------------------------------------

    def multipliers(self, x: Array, p: Array) -> Any:
        return multipliers(self.at(x, p))

    def factors(self, x: Array, p: Array) -> tuple[Array, Array] | None:
        return factors(self.at(x, p))

    def state_error(self, x: Array, p: Array, residual: float) -> float:
        s, n, scale = self.at(x, p), len(self.sides), self.scale(x)
        try:
            moved = abs(np.linalg.inv(self.linearization(x, p))) @ (self.rounding(x, p) + residual)
        except np.linalg.LinAlgError:
            return float("inf")
        moved *= scale
        states = s.section_states
        worst = ROUNDING * float(abs(states).max()) + float(moved[:n].max())
        worst += self.states_moved(x, p, moved)
        return worst + float(s.rounded.max())

    def in_turn(self, x: Array) -> tuple[Self, Array]:
        """With its impacts in turn, from its first one in [0, 2 pi) on."""
        n, turn = len(self.sides), TWO_PI * self.periods
        late = turn * np.floor((x[:n] - x[0]) / turn)
        phases = x[:n] - late - TWO_PI * np.floor(x[0] / TWO_PI)
        return self._ascending(phases, x[n : 2 * n], self.sides, x[2 * n :])

    def proper(self, x: Array) -> bool:
        """Without rebound an impulse of zero follows any impact: two impacts are one."""
        n = len(self.sides)
        ends = np.append(x[:n], x[0] + TWO_PI * self.periods)
        slow = bool((x[n : 2 * n] <= LEAST * self.speed).any())
        return not slow and bool(np.diff(ends).min() >= APART)

    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        n, turn = len(self.sides), TWO_PI * self.periods
        problem = self.remade(periods=2 * self.periods, itinerary=np.tile(self.sides, 2))
        phases, impulses, border = np.split(x, [n, 2 * n])
        twice = np.concatenate([phases, phases + turn, impulses, impulses, border])
        a, b, c = np.split(disturbance, [n, 2 * n])
        return problem, twice, np.concatenate([a, -a, b, -b, c])

    def _may_repeat(self, k: int) -> bool:
        return bool((np.roll(self.sides, -k) == self.sides).all())

    def _marked(self, x: Array) -> tuple[Array, Array]:
        n = len(self.sides)
        return x[:n], x[n : 2 * n] / self.speed

    def _part(self, x: Array, k: int) -> Array:
        n = len(self.sides)
        return np.concatenate([x[:k], x[n : n + k], x[2 * n :]])

    def canonical(self, x: Array) -> Array:
        n = len(self.sides)
        turn = np.exp(1j * x[:n])
        weights = (1.0 - 2.0 * self.sides) * x[n : 2 * n] / self.speed
        moments = np.array([turn, weights * turn, weights**2 * turn])
        return np.concatenate([moments.sum(axis=1).view(float), [weights.sum()]]) / n

    # --- what is watched --------------------------------------------------------------------------

    def admissible(self, x: Array, p: Array) -> bool:
        s = self.at(x, p)
        return bool((s.impulses > 0.0).all()) and flights_are_open(lambda: self.system(p), s)

    def units(self, solution: ImpulseSolution) -> tuple[float, float, float]:
        return self.speed / solution.frequency, self.speed, self.speed * solution.frequency

    def with_impact(self, x: Array, flight: Flight, phase: float) -> tuple[Self, Array]:
        """Return equations and unknowns with one impact more, where a gap touches zero."""
        phases, impulses, border = np.split(x, [len(self.sides), 2 * len(self.sides)])
        sides = np.append(self.sides, flight.side)
        return self._ascending(np.append(phases, phase), np.append(impulses, 0.0), sides, border)

    def without_impact(self, x: Array, p: Array, i: int) -> tuple[Self, Array] | None:
        phases, impulses, border = np.split(x, [len(self.sides), 2 * len(self.sides)])
        if len(phases) == 1:
            return None
        if i == 0 and len(border):
            border = self.at(x, p).before(1)
        sides = np.delete(self.sides, i)
        return self._ascending(np.delete(phases, i), np.delete(impulses, i), sides, border)

    def _ascending(
        self, phases: Array, impulses: Array, sides: Any, border: Array
    ) -> tuple[Self, Array]:
        order = np.argsort(phases)
        x = np.concatenate([phases[order], impulses[order], border])
        return self.remade(itinerary=sides[order]), x
