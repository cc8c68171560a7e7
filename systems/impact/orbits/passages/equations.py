"""The equations of periodic orbits P(inf,m), smooth through grazing before the chatter."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Self, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.multipliers import product_eigenvalues
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.orbits.flights import Flight
from dynkit.systems.impact.orbits.machine import passage_change
from dynkit.systems.impact.orbits.orbit import NONE
from dynkit.systems.impact.orbits.passages.passage import PASSED, Passage, Scene, Word
from dynkit.systems.impact.orbits.passages.solution import PassageSolution
from dynkit.systems.impact.orbits.problem import APART, ImpactProblem
from dynkit.systems.impact.simulation.state import TWO_PI

_ROUNDING = 2.0**-52
_COMMON = 16.0 * _ROUNDING / PASSED
"""What rounding left in rows and modes, in the units of the equations: all probes have the same."""
_LEAST = 1e-9
"""Impacts that are slower, beside the fastest, are rounding."""
_STEPS, _SOLVED = 20, 1e-12
"""Steps of Newton's method to a return, and the last of them, in units of the unknowns."""
_PROBES = 4
"""Evaluations that show how far rounding changes the equations."""


@final
class PassageEquations(ImpactProblem[PassageSolution]):
    """P(inf,m): releases, the impacts after them, chatter and contact, in m periods of the forcing.

    The unknowns are, passage by passage from one release to the next, the positions and velocities
    of all coordinates but that in contact at the release, (2N - 2,), then the phases, not wrapped,
    of the release and of the impacts that a `Word` names. The equations: the passage ends where the
    next one begins, (2N - 2,); the contact force at the release, and the gaps at the impacts, are
    zero. Chatter is simulated, and nothing but the chatter knows whether the motion is possible.

    The itinerary is a tuple with a `Word` for each passage; the sizes, (2,), are typical ones of
    positions and of velocities.

    References
    ----------
    A. B. Nordmark, P. T. Piiroinen, Simulation and stability analysis of impacting systems with
    complete chattering, Nonlinear Dynamics 58 (2009) 85-106.
    """

    sticks = True

    def _scene(self, p: Array) -> Scene:
        system = self.system(p)
        if not system._excitation.turns:
            raise NoSolution("nothing drives the system")
        return Scene(system)

    def _solution(self, x: Array, scene: Scene) -> PassageSolution:
        pairs = zip(self.words, self.parts(x), strict=True)
        return PassageSolution([Passage(scene, word, *part) for word, part in pairs], self.periods)

    @property
    def words(self) -> tuple[Word, ...]:
        """Which impacts each passage has."""
        words: tuple[Word, ...] = self.itinerary
        return words

    @property
    def half(self) -> int:
        """Number of coordinates beside that in contact."""
        return self.oscillator.degrees_of_freedom - 1

    @cached_property
    def _begins(self) -> Any:
        """Where the unknowns of each passage begin, and where all end."""
        return np.cumsum([0, *(2 * self.half + word.size for word in self.words)])

    # --- unknowns ---------------------------------------------------------------------------------

    def parts(self, x: Array) -> list[tuple[Array, Array]]:
        """Places (2N - 2,) and phases of each passage, that of the next release at the end."""
        n = 2 * self.half
        own = [x[a:b] for a, b in zip(self._begins[:-1], self._begins[1:], strict=True)]
        ends = [part[n] for part in own[1:]] + [own[0][n] + TWO_PI * self.periods]
        return [(part[:n], np.append(part[n:], end)) for part, end in zip(own, ends, strict=True)]

    @property
    def size(self) -> int:
        return int(self._begins[-1])

    def scale(self, x: Array) -> Array:  # noqa: ARG002
        unit = np.repeat(self.sizes, self.half)
        return np.concatenate([part for word in self.words for part in (unit, np.ones(word.size))])

    # --- equations --------------------------------------------------------------------------------
    # Of one passage: places at the end, contact force at the release, gaps at the impacts.

    def _units(self, passage: Passage) -> Array:
        """What the equations of one passage are measured in."""
        unit = np.repeat(self.sizes, self.half)
        force = float(abs(passage.release[1]) @ unit) + abs(passage.release[2])
        gaps = np.full(len(passage.word.sides), self.sizes[0])
        # The impact before is no solution: without rebound it is one twice.
        short = passage.w * passage.durations[1:]
        gaps[1:] *= short if passage.r > 0.0 else short**2
        return PASSED * np.concatenate([unit, [force], gaps])

    def residual(self, x: Array, p: Array) -> Array:
        passages = self.at(x, p).passages
        begins = [places for places, _ in self.parts(x)]
        out = []
        for passage, begin in zip(passages, begins[1:] + begins[:1], strict=True):
            side = passage.word.sides[-1]
            end = passage.scene.holdings[side].places(passage.end)
            gaps, force = passage.gaps, passage.release[0]
            out.append(np.concatenate([end - begin, [force], gaps]) / self._units(passage))
        return np.concatenate(out)

    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        passages, n = self.at(x, p).passages, 2 * self.half
        out = np.zeros((self.size, self.size), dtype=np.result_type(multiplier, x))
        for k, passage in enumerate(passages):
            last = k == len(passages) - 1
            here, there = int(self._begins[k]), 0 if last else int(self._begins[k + 1])
            back = multiplier if last else 1.0
            gaps, ended = passage.linear
            rows, stop = slice(here, here + n), int(self._begins[k + 1])
            _, by_places, by_phase = passage.release
            out[rows, here:stop] += ended[:, :-1]
            out[rows, there + n] += back * ended[:, -1]
            out[rows, there : there + n] -= back * np.eye(n)
            out[here + n, here : here + n] = by_places
            out[here + n, here + n] = by_phase
            out[here + n + 1 : stop, here:stop] = gaps[:, :-1]
            out[here:stop] /= self._units(passage)[:, None]
        return out

    def _by(self, x: Array, p: Array, k: int) -> Array:
        """Derivative by the free parameter number `k`."""
        (change, _), out = self._changes.by(p, k), []
        for passage in self.at(x, p).passages:
            end, force, gaps = passage_change(passage, change)
            out.append(np.concatenate([end, [force], gaps]) / self._units(passage))
        return np.concatenate(out)

    def multipliers(self, x: Array, p: Array) -> Any:
        """Two are zero: contact forgets the gap and its rate."""
        passages = self.at(x, p).passages
        found = np.zeros(2 * self.half + 2, dtype=complex)
        if not all(rate for passage in passages for rate in passage.rates):
            # An impact that only grazes stretches without bound.
            found[0] = np.inf
        elif self.half:
            found[:-2] = product_eigenvalues(self._matrices(passages))
        return found

    def factors(self, x: Array, p: Array) -> tuple[Array, Array] | None:
        passages = self.at(x, p).passages
        if not self.half or not all(rate for passage in passages for rate in passage.rates):
            return None
        matrices = self._matrices(passages)
        return matrices, PASSED * 2.0**-52 * np.linalg.norm(matrices, axis=(1, 2))

    def _matrices(self, passages: list[Passage]) -> Array:
        unit = np.repeat(self.sizes, self.half)
        return np.array([q.derivative * unit / unit[:, None] for q in passages])

    def returns(self, x: Array, p: Array) -> tuple[Callable[[Array], Array], Array]:
        """Return the derivative (2N - 2, 2N - 2) of the map of returns, and the orbit's places.

        The map is that from places in contact, at the phase of the orbit's first release, to those
        of whole periods later. Where it releases earlier or later it is the same to first order.
        """
        d, last, at = 2 * self.half, int(self._begins[-2]), float(x[2 * self.half])
        rows = np.delete(np.arange(self.size), np.s_[last : last + d])
        scene, scale = self.scene(p), self.scale(x)[d:]
        holding, w = scene.holdings[self.words[0].start], scene.system.frequency
        mode = holding.mode

        def jacobian(places: Array) -> Array:
            y = np.append(places, x[d:])
            for _ in range(_STEPS):
                since = np.array([(y[d] - at) / w])
                released = mode.flown(holding.state(places, at), since)[0]
                y[:d] = holding.places(released)
                matrix = self.linearization(y, p)[rows]
                matrix[:, d] += matrix[:, :d] @ holding.change(mode.rate(released)) / w
                step = np.linalg.solve(matrix[:, d:], self.residual(y, p)[rows])
                y[d:] -= step
                if abs(step / scale).max() < _SOLVED:
                    break
            else:
                raise NoSolution("there is no such return")
            to = mode.transitions(since).matrices(mode.layout.modes)[0]
            out = to = holding.outward @ to @ holding.inward
            for passage in self.at(y, p).passages:
                out = passage.derivative @ out
            return np.linalg.solve(to, out)

        return jacobian, x[:d]

    # --- orbits -----------------------------------------------------------------------------------

    def state_error(self, x: Array, p: Array, residual: float) -> float:
        del residual  # that of each equation is taken
        derivative = np.asarray(self.linearization(x, p))
        here, scale = self.residual(x, p), self.scale(x)
        cut = self.at(x, p).chatter_error / (PASSED * min(self.sizes))
        noise = np.full(len(x), _COMMON)
        random = np.random.default_rng(0)
        for _ in range(_PROBES):
            near = x + 8.0 * _ROUNDING * scale * random.uniform(-1.0, 1.0, len(x))
            change = self.residual(near, p) - here - derivative @ (near - x)
            noise = np.maximum(noise, abs(change))
        left = 4.0 * (noise + cut) + abs(here)
        try:
            inverse = np.linalg.inv(derivative * scale)
        except np.linalg.LinAlgError:
            return float("inf")
        apart = scale * (abs(inverse) @ left)
        return float(apart.max() + 4.0 * _ROUNDING * (1.0 + abs(x).max()))

    def in_turn(self, x: Array) -> tuple[Self, Array]:
        return self.shortest(x)

    def proper(self, x: Array) -> bool:
        impulses = abs(self.at(x, NONE).impulses)
        # Without rebound any number of impacts of no impulse follows any impact. Where the
        # derivative is all but singular it is not solved for.
        slow = bool(impulses.min() < _LEAST * impulses.max())
        return not slow and self.state_error(x, NONE, 0.0) < APART

    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        problem = self.remade(periods=2 * self.periods, itinerary=2 * self.words)
        kinds = [np.repeat([0.0, 1.0], [2 * self.half, word.size]) for word in self.words]
        later = x + TWO_PI * self.periods * np.concatenate(kinds)
        return problem, np.concatenate([x, later]), np.append(disturbance, -disturbance)

    def _may_repeat(self, k: int) -> bool:  # noqa: ARG002
        # The words need not agree: how many impacts they name before a chatter is a choice.
        return True

    def _marked(self, x: Array) -> tuple[Array, Array]:
        unit, parts = np.repeat(self.sizes, self.half), self.parts(x)
        phases = np.array([phases[0] for _, phases in parts])
        return phases, np.array([places / unit for places, _ in parts])

    def _part(self, x: Array, k: int) -> Array:
        return x[: self._begins[k]]

    def canonical(self, x: Array) -> Array:
        """Means over the releases, which do not depend on which is the first."""
        parts = self.parts(x)
        places = np.array([place for place, _ in parts]).reshape(len(parts), 2, -1)
        sizes = abs(places).max(axis=(0, 2), initial=0.0) + (self.half == 0)
        places = (places / sizes[:, None]).reshape(len(parts), -1)
        turn = np.exp(1j * np.array([phases[0] for _, phases in parts]))[:, None]
        marks = [places, places**2, places * turn.real, turn.real, turn.imag]
        return np.append(np.concatenate(marks, axis=1).mean(axis=0), sizes[0] / sizes[1])

    # --- what is watched --------------------------------------------------------------------------

    def admissible(self, x: Array, p: Array) -> bool:
        return all(passage.is_motion for passage in self.at(x, p).passages)

    def units(self, solution: PassageSolution) -> tuple[float, float, float]:
        length, speed = self.sizes
        return length, speed, length * solution.frequency**2

    def with_impact(self, x: Array, flight: Flight, phase: float) -> tuple[Self, Array]:
        """Return equations and unknowns with one impact more, where a gap touches zero."""
        return self._renamed(x, flight.end, added=(flight.side, phase))

    def without_impact(self, x: Array, p: Array, i: int) -> tuple[Self, Array] | None:
        del p  # the other impacts stay where they are
        last = np.cumsum([len(word.sides) for word in self.words]) - 1
        return None if i in last else self._renamed(x, i)

    def _renamed(
        self, x: Array, i: int, added: tuple[int, float] | None = None
    ) -> tuple[Self, Array]:
        """With an impact named before impact number `i`, or that one not named."""
        counts = np.cumsum([0, *(len(word.sides) for word in self.words)])
        k = int(np.searchsorted(counts, i, side="right")) - 1
        number, words = i - int(counts[k]), list(self.words)
        sides, at = list(words[k].sides), int(self._begins[k]) + 2 * self.half + 1 + number
        if added is None:
            del sides[number]
            x = np.delete(x, at)
        else:
            sides.insert(number, added[0])
            x = np.insert(x, at, added[1])
        words[k] = Word(words[k].start, tuple(sides))
        return self.remade(itinerary=tuple(words)), x
