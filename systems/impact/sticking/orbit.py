"""Periodic orbits of impact oscillators that stick."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.orbits import PeriodicOrbit
from dynkit.results import Cost
from dynkit.systems.impact.motion import evolve, sample_run
from dynkit.systems.impact.state import TWO_PI
from dynkit.validation import Array, finite_array

if TYPE_CHECKING:
    from dynkit.systems.impact.oscillator import ImpactOscillator
    from dynkit.systems.impact.sticking.passage import Passage
    from dynkit.systems.impact.sticking.problem import StickingProblem

_NONE = np.empty(0)
_ROUNDING = 2.0**-52
_PROBES = 4
"""Evaluations that show how far rounding changes the equations."""


@final
class StickingOrbit(PeriodicOrbit):
    """P(inf,m): chatter, contact and release, once or more, in m periods of the forcing.

    From `ImpactOscillator.periodic_orbit`, from an attractor or from a branch. Its states are those
    at the releases, where the relative velocity and the contact force are zero.
    """

    def __init__(
        self, problem: StickingProblem, x: Array, history: tuple[float, ...], cost: Cost
    ) -> None:
        self._problem = problem
        self._x = x.copy()
        self._x.setflags(write=False)
        self._history = history
        self._cost = cost

    def __reduce__(self) -> tuple[Any, ...]:
        # Made anew: copies of arrays could be written to.
        return StickingOrbit, (self._problem, self._x, self._history, self._cost)

    def __repr__(self) -> str:
        kind = "stable" if self.stable else "unstable"
        if not self.admissible:
            kind += ", inadmissible"
        return f"<{self.label} of {self.system!r}: {kind}>"

    @property
    def _passages(self) -> list[Passage]:
        return self._problem.passages(self._x, _NONE)

    @property
    def system(self) -> ImpactOscillator:
        return self._problem.oscillator

    @property
    def periods(self) -> int:
        """The number m of periods of the forcing."""
        return self._problem.periods

    @property
    def period(self) -> float:
        """Time until it repeats."""
        return self.periods * TWO_PI / self.system.frequency

    @property
    def label(self) -> str:
        """``P(inf,m)``."""
        return f"P(inf,{self.periods})"

    @cached_property
    def phases(self) -> Array:
        """Phases (k,) of the forcing at the releases, ascending, not wrapped."""
        return np.array([passage.phases[0] for passage in self._passages])

    @cached_property
    def states(self) -> Array:
        """Section coordinates (k, 2N) at the releases: see `ImpactOscillator`."""
        rows = [
            np.append(passage.places, [0.0, passage.phases[0] % TWO_PI])
            for passage in self._passages
        ]
        states = np.array(rows)
        states.setflags(write=False)
        return states

    @cached_property
    def contacts(self) -> Array:
        """Times (k, 2) at which contact begins, before each release, and of the next release.

        They count from the first release. Contact begins where the rest of the chatter is replaced.
        """
        first = self.phases[0]
        spans = [[q.contact_phase - first, q.phases[-1] - first] for q in self._passages]
        return np.array(spans) / self.system.frequency

    @cached_property
    def multipliers(self) -> Any:
        """Floquet multipliers, (2N,) complex, the largest modulus first; two of them are zero.

        Those of the map from one release to the same release a period later, (2N - 2,), beside the
        zeros of the impact map: contact forgets the gap and its rate. They are wrong by rounding
        relative to the largest.
        """
        found = self._problem.multipliers(self._x, _NONE)
        found.setflags(write=False)
        return found

    @cached_property
    def admissible(self) -> bool:
        """Whether simulation from each release finds the same impacts and the next release."""
        return self._problem.admissible(self._x, _NONE)

    @property
    def history(self) -> tuple[float, ...]:
        return self._history

    @cached_property
    def chatter_error(self) -> float:
        """Largest change of a position or velocity that replacing the rest of a chatter makes."""
        return max(passage.run.chatter_error for passage in self._passages)

    @cached_property
    def error(self) -> float:
        """Estimate of the largest error of a coordinate of its states.

        What the residual, rounding and the chatters that were cut leave in the equations, by the
        inverse of their derivative. Rounding is what the equations change by, beyond their
        derivative, when the unknowns are changed in the last digits. Infinite where the derivative
        is singular.
        """
        problem, x = self._problem, self._x
        derivative = np.asarray(problem.linearization(x, _NONE))
        here, scale = problem.residual(x, _NONE), problem.scale(x)
        noise = np.zeros(len(x))
        random = np.random.default_rng(0)
        for _ in range(_PROBES):
            moved = x + 8.0 * _ROUNDING * scale * random.uniform(-1.0, 1.0, len(x))
            change = problem.residual(moved, _NONE) - here - derivative @ (moved - x)
            noise = np.maximum(noise, abs(change))
        left = 4.0 * noise.max() + abs(here) + self.chatter_error / min(problem.sizes)
        try:
            inverse = np.linalg.inv(derivative * scale)
        except np.linalg.LinAlgError:
            return float("inf")
        moved = scale * (abs(inverse) @ left)
        return float(moved.max() + 4.0 * _ROUNDING * (1.0 + abs(x).max()))

    @property
    def cost(self) -> Cost:
        return self._cost

    def problem(self, *names: str) -> StickingProblem:
        """Return the equations that it solves, with the named parameters free.

        Raises
        ------
        ValueError
            When the system has no such parameter.
        """
        known = self.system.parameters
        for name in names:
            if name not in known:
                raise ValueError(f"parameter must be one of: {', '.join(known)}; got {name!r}")
        return self._problem.free(*names)

    @property
    def unknowns(self) -> Array:
        """Passage by passage, see `StickingProblem`."""
        return self._x

    @cached_property
    def _impacts(self) -> Array:
        """Relative velocity after, phase and time (3, n) of all impacts down to the cut."""
        parts = []
        for q in self._passages:
            signs = np.where(np.array(q.word.sides) == 1, -1.0, 1.0)
            after = -signs * self.system.restitution * np.array(q.rates)
            chatter = q.run.states[:, -2:]
            phases = np.append(q.phases[1:-1], q.phases[-2] + q.w * chatter[:, 1])
            parts.append([np.append(after, chatter[:, 0]), phases])
        found = np.concatenate(parts, axis=1)
        time = (found[1] - self.phases[0]) / self.system.frequency
        return np.stack([found[0], found[1] % TWO_PI, time])

    def observable(self, name: str) -> Array:
        """Return ``relative_velocity``, ``phase`` or ``time`` at the impacts, down to the cut."""
        names = ("relative_velocity", "phase", "time")
        if name not in names:
            raise ValueError(f"name must be relative_velocity, phase or time; got {name!r}")
        return np.asarray(self._impacts[names.index(name)])

    def sample(self, times: object) -> tuple[Array, Array]:
        """Positions and velocities at given times, from the first release.

        Parameters
        ----------
        times : (k,) array_like
            Of any size and sign: the motion repeats itself.

        Returns
        -------
        position, velocity : (k, N) arrays
        """
        asked = finite_array("times", times, (None,)) % self.period
        out = np.empty((2, len(asked), self.system.degrees_of_freedom))
        begins = (self.phases - self.phases[0]) / self.system.frequency
        which = np.searchsorted(begins, asked, side="right") - 1
        for k, passage in enumerate(self._passages):
            here = which == k
            out[:, here] = _sampled(passage, asked[here] - begins[k])
        return out[0], out[1]


def _sampled(passage: Passage, since: Array) -> Array:
    """Positions and velocities (2, k, N) at times (k,) after a release."""
    scene, w = passage.scene, passage.w
    free = scene.system._free
    out = np.empty((2, len(since), scene.system.degrees_of_freedom))
    events = (passage.phases[:-1] - passage.phases[0]) / w
    contact = (passage.contact_phase - passage.phases[0]) / w
    which = np.searchsorted(events, since, side="right") - 1
    flying = which < len(events) - 1
    held = since >= contact
    states = evolve(
        scene.system._gaps[0],
        np.array(passage.states),
        which[flying],
        (since - events[which])[flying],
    )
    out[:, flying] = _moved(free, states)
    chatter = ~flying & ~held
    if chatter.any():
        out[:, chatter] = sample_run(scene.system, passage.run, since[chatter] - events[-1])
    if held.any():
        holding = scene.holdings[passage.word.sides[-1]]
        out[:, held] = _moved(holding.regime, holding.after(passage.caught, since[held] - contact))
    return out


def _moved(regime: Any, states: Array) -> tuple[Array, Array]:
    q, sine, cosine = regime.parts(states)
    return regime.forced.positions(q, sine, cosine), regime.forced.velocities(q, sine, cosine)
