"""The equations of periodic orbits that stick, smooth through grazing before the chatter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import Refused, replaced
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import Condition, Event, WatchedProblem
from dynkit.orbits.multipliers import product_eigenvalues
from dynkit.orbits.newton import NoSolution
from dynkit.orbits.problem import PeriodicProblem, fractions
from dynkit.systems.impact.orbits.machine import Changes, passage_change
from dynkit.systems.impact.state import TWO_PI
from dynkit.systems.impact.sticking.orbit import StickingOrbit
from dynkit.systems.impact.sticking.passage import PASSED, Passage, Scene, Word
from dynkit.systems.impact.sticking.watching import condition_of, is_motion, touched, watched
from dynkit.systems.impact.sticking.words import neighbours_of

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap

_REPEATED = 1e-7
"""Passages that agree so well, in their units, are the same."""


@final
class StickingProblem(PeriodicProblem, WatchedProblem):
    """P(inf,m): releases, the impacts after them, chatter and contact, in m periods of the forcing.

    The unknowns are, passage by passage from one release to the next, the positions and velocities
    of all coordinates but that in contact at the release, (2N - 2,), then the phases, not wrapped,
    of the release and of the impacts that a `Word` names. The equations: the passage ends where the
    next one begins, (2N - 2,); the contact force at the release, and the gaps at the impacts, are
    zero. Chatter is simulated, and nothing but the chatter knows whether the motion is possible.

    Parameters
    ----------
    oscillator : ImpactMap
        At whose parameters the others than the free ones stay.
    names : tuple of str
    periods : int
    words : tuple of Word
        One for each passage.
    sizes : (2,)
        Typical size of positions and of velocities.

    References
    ----------
    A. B. Nordmark, P. T. Piiroinen, Simulation and stability analysis of impacting systems with
    complete chattering, Nonlinear Dynamics 58 (2009) 85-106.
    """

    def __init__(
        self,
        oscillator: ImpactMap,
        names: tuple[str, ...],
        periods: int,
        words: tuple[Word, ...],
        sizes: tuple[float, float],
    ) -> None:
        self.oscillator = oscillator
        self._names = names
        self.periods = periods
        self.words = words
        self.sizes = sizes
        self.half = oscillator.degrees_of_freedom - 1
        lengths = [2 * self.half + word.size for word in words]
        self._begins = np.concatenate([[0], np.cumsum(lengths)])
        kinds = [np.repeat([0.0, 1.0], [2 * self.half, word.size]) for word in words]
        self._turning = np.concatenate(kinds)
        self._changes = Changes(self.system)
        self._scenes: list[tuple[bytes, Scene]] = []
        self._last: tuple[bytes, list[Passage]] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        # Without what is kept for the next call.
        return StickingProblem, (
            self.oscillator,
            self._names,
            self.periods,
            self.words,
            self.sizes,
        )

    # --- parameters -------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        return self._names

    def free(self, *names: str) -> Self:
        return type(self)(self.oscillator, names, self.periods, self.words, self.sizes)

    @property
    def values(self) -> Array:
        return np.array([self.oscillator.parameters[name] for name in self._names], dtype=float)

    def of_words(self, words: tuple[Word, ...]) -> Self:
        """The same problem with other impacts."""
        return type(self)(self.oscillator, self._names, self.periods, words, self.sizes)

    def system(self, p: Array) -> ImpactMap:
        """The oscillator with these values (k,) of the free parameters."""
        try:
            changes: Any = dict(zip(self._names, p.tolist(), strict=True))
            return replaced(self.oscillator, **changes)
        except Refused as refusal:
            raise NoSolution(str(refusal)) from refusal

    def scene(self, p: Array) -> Scene:
        """The last few are kept."""
        key = p.tobytes()
        for known, scene in self._scenes:
            if known == key:
                return scene
        system = self.system(p)
        if not system._drive.turns:
            raise NoSolution("nothing drives the system")
        scene = Scene(system)
        self._scenes = [(key, scene), *self._scenes[:7]]
        return scene

    # --- unknowns ---------------------------------------------------------------------------------

    def parts(self, x: Array) -> list[tuple[Array, Array]]:
        """Places (2N - 2,) and phases of each passage, that of the next release at the end."""
        n = 2 * self.half
        own = [x[a:b] for a, b in zip(self._begins[:-1], self._begins[1:], strict=True)]
        ends = [part[n] for part in own[1:]] + [own[0][n] + TWO_PI * self.periods]
        return [(part[:n], np.append(part[n:], end)) for part, end in zip(own, ends, strict=True)]

    def passages(self, x: Array, p: Array) -> list[Passage]:
        """All passages at a place."""
        key = x.tobytes() + p.tobytes()
        if self._last is None or self._last[0] != key:
            scene = self.scene(p)
            pairs = zip(self.words, self.parts(x), strict=True)
            self._last = key, [Passage(scene, word, *part) for word, part in pairs]
        return self._last[1]

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
        passages = self.passages(x, p)
        begins = [places for places, _ in self.parts(x)]
        out = []
        for passage, begin in zip(passages, begins[1:] + begins[:1], strict=True):
            side = passage.word.sides[-1]
            end = passage.scene.holdings[side].places(passage.end)
            gaps, force = passage.gaps, passage.release[0]
            out.append(np.concatenate([end - begin, [force], gaps]) / self._units(passage))
        return np.concatenate(out)

    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        passages, n = self.passages(x, p), 2 * self.half
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

    def parameter_derivative(self, x: Array, p: Array) -> Array:
        columns = [self._by(x, p, k) for k in range(len(self._names))]
        return np.stack(columns, axis=1) if columns else np.empty((self.size, 0))

    def _by(self, x: Array, p: Array, k: int) -> Array:
        """Derivative by the free parameter number `k`."""
        change, out = self._changes.by(p, k), []
        for passage in self.passages(x, p):
            end, force, gaps = passage_change(passage, change)
            out.append(np.concatenate([end, [force], gaps]) / self._units(passage))
        return np.concatenate(out)

    def multipliers(self, x: Array, p: Array) -> Any:
        """Two are zero: contact forgets the gap and its rate."""
        passages = self.passages(x, p)
        found = np.zeros(2 * self.half + 2, dtype=complex)
        if not all(rate for passage in passages for rate in passage.rates):
            # An impact that only grazes stretches without bound.
            found[0] = np.inf
        elif self.half:
            found[:-2] = product_eigenvalues(self._matrices(passages))
        return found

    def factors(self, x: Array, p: Array) -> tuple[Array, Array] | None:
        passages = self.passages(x, p)
        if not self.half or not all(rate for passage in passages for rate in passage.rates):
            return None
        matrices = self._matrices(passages)
        return matrices, PASSED * 2.0**-52 * np.linalg.norm(matrices, axis=(1, 2))

    def _matrices(self, passages: list[Passage]) -> Array:
        unit = np.repeat(self.sizes, self.half)
        return np.array([q.derivative * unit / unit[:, None] for q in passages])

    # --- orbits -----------------------------------------------------------------------------------

    def orbit(self, x: Array, p: Array, history: Sequence[float] = ()) -> StickingOrbit:
        fixed = type(self)(self.system(p), (), self.periods, self.words, self.sizes)
        return StickingOrbit(fixed, x, tuple(history), Cost(0.0))

    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        problem = type(self)(
            self.oscillator, self._names, 2 * self.periods, 2 * self.words, self.sizes
        )
        return problem, np.concatenate([x, self._later(x)]), np.append(disturbance, -disturbance)

    def _later(self, x: Array) -> Array:
        """The same solution a period later."""
        return x + TWO_PI * self.periods * self._turning

    def shortest(self, x: Array) -> tuple[StickingProblem, Array]:
        for k, periods, changes in self._repetitions(x):
            if abs(changes).max() < _REPEATED:
                names, words, cut = self._names, self.words[:k], int(self._begins[k])
                return type(self)(self.oscillator, names, periods, words, self.sizes), x[:cut]
        return self, x

    def repetition(self, x: Array) -> float:
        parts = [changes for _, _, changes in self._repetitions(x)]
        return min((float(np.sqrt(np.mean(part**2))) for part in parts), default=np.inf)

    def _repetitions(self, x: Array) -> Iterator[tuple[int, int, Array]]:
        """Passages and periods after which it may come again; changes of releases until then.

        The words need not agree: how many impacts they name before a chatter is a choice.
        """
        count, m = len(self.words), self.periods
        unit, parts = np.repeat(self.sizes, self.half), self.parts(x)
        places = np.array([place / unit for place, _ in parts])
        phases = np.array([phase[0] for _, phase in parts])
        for k in fractions(count):
            if m % (count // k) == 0:
                periods = m // (count // k)
                later = np.append(phases[k:], phases[:k] + TWO_PI * m) - TWO_PI * periods
                yield (
                    k,
                    periods,
                    np.column_stack([np.roll(places, -k, axis=0) - places, later - phases]),
                )

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

    def events(self, x: Array, p: Array) -> list[Event]:
        return watched(self.passages(x, p))

    def condition(self, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
        return condition_of(self, event, x, p)

    def admissible(self, x: Array, p: Array) -> bool:
        return is_motion(self.passages(x, p))

    def touching(self, event: int, x: Array, own: Array, p: Array) -> Mapping[str, float]:
        """Return phase in [0, 2 pi) and time from the first release at which it touches."""
        return touched(self.passages(x, p), event, own)

    def neighbours(self, event: int, x: Array, p: Array) -> list[tuple[Problem, Array, Array]]:
        """Return the same motion with one impact more before a chatter, or fewer."""
        return neighbours_of(self, event, x, p)
