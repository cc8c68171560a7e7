"""Periodic orbits of impact oscillators that stick."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, final

import numpy as np

from dynkit.core.validation import Array, finite_array
from dynkit.systems.impact.motion import sample_run
from dynkit.systems.impact.orbits.driven import NONE, DrivenOrbit
from dynkit.systems.impact.state import TWO_PI
from dynkit.systems.impact.sticking.passage import PASSED

if TYPE_CHECKING:
    from dynkit.systems.impact.sticking.passage import Passage
    from dynkit.systems.impact.sticking.problem import StickingProblem

_ROUNDING = 2.0**-52
_COMMON = 16.0 * _ROUNDING / PASSED
"""What rounding left in rows and modes, in the units of the equations: all probes have the same."""
_PROBES = 4
"""Evaluations that show how far rounding changes the equations."""


@final
class StickingOrbit(DrivenOrbit):
    """P(inf,m): chatter, contact and release, once or more, in m periods of the forcing.

    From `ImpactOscillator.periodic_orbit`, from an attractor or from a branch. Its states are those
    at the releases, where the relative velocity and the contact force are zero. Its multipliers are
    those of the map from one release to the same one a period later, (2N - 2,), beside two zeros:
    contact forgets the gap and its rate. They are wrong by rounding relative to the largest. It is
    admissible when simulation from each release finds the same impacts and the next release.
    """

    _problem: StickingProblem

    @property
    def _passages(self) -> list[Passage]:
        return self._problem.passages(self._x, NONE)

    @property
    def label(self) -> str:
        """``P(inf,m)``."""
        return f"P(inf,{self.periods})"

    @cached_property
    def phases(self) -> Array:
        """Phases (k,) of the forcing at the releases, ascending, not wrapped."""
        phases = np.array([float(passage.phases[0]) for passage in self._passages])
        phases.setflags(write=False)
        return phases

    @cached_property
    def states(self) -> Array:
        """Section coordinates (k, 2N) at the releases: see `ImpactOscillator`."""
        rows = [
            np.append(q.places, [-0.0 if q.word.start else 0.0, q.phases[0] % TWO_PI])
            for q in self._passages
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
        times = np.array(spans) / self.system.frequency
        times.setflags(write=False)
        return times

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
        derivative = np.asarray(problem.linearization(x, NONE))
        here, scale = problem.residual(x, NONE), problem.scale(x)
        noise = np.full(len(x), _COMMON)
        random = np.random.default_rng(0)
        for _ in range(_PROBES):
            near = x + 8.0 * _ROUNDING * scale * random.uniform(-1.0, 1.0, len(x))
            change = problem.residual(near, NONE) - here - derivative @ (near - x)
            noise = np.maximum(noise, abs(change))
        cut = self.chatter_error / (PASSED * min(problem.sizes))
        left = 4.0 * (noise + cut) + abs(here)
        try:
            inverse = np.linalg.inv(derivative * scale)
        except np.linalg.LinAlgError:
            return float("inf")
        apart = scale * (abs(inverse) @ left)
        return float(apart.max() + 4.0 * _ROUNDING * (1.0 + abs(x).max()))

    @cached_property
    def bounces(self) -> Array:
        """Time from the first release, phase in [0, 2 pi), relative velocity after each impact.

        (n, 3), chatter down to the cut included; how many there are depends on the cut.
        """
        parts = []
        for q in self._passages:
            phases = np.append(q.phases[1:-1], q.phases[-2] + q.w * q.run.time)
            parts.append([phases, np.append(self._named(q), q.run.relative_velocity)])
        phases, speeds = np.concatenate(parts, axis=1)
        time = (phases - self.phases[0]) / self.system.frequency
        impacts = np.stack([time, phases % TWO_PI, speeds], axis=1)
        impacts.setflags(write=False)
        return impacts

    @property
    def _impact_times(self) -> Array:
        return self.bounces[:, 0]

    def _named(self, passage: Passage) -> Array:
        """Relative velocities after the impacts before a chatter."""
        signs = np.where(np.array(passage.word.sides) == 1, -1.0, 1.0)
        return np.asarray(-signs * self.system.restitution * np.array(passage.rates))

    def problem(self, *names: str) -> StickingProblem:
        problem: StickingProblem = super().problem(*names)
        return problem

    def observable(self, name: str) -> Array:
        """Return ``relative_velocity``, ``phase`` or ``time`` at the impacts before the chatters.

        They are as many along a whole branch; see `bounces` for all.
        """
        passages = self._passages
        if name == "relative_velocity":
            return np.concatenate([self._named(q) for q in passages])
        phases = np.concatenate([q.phases[1:-1] for q in passages])
        if name == "phase":
            return np.asarray(phases % TWO_PI)
        if name == "time":
            return np.asarray((phases - self.phases[0]) / self.system.frequency)
        raise ValueError(f"name must be relative_velocity, phase or time; got {name!r}")

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
    starts = np.array(passage.states)
    out[:, flying] = free.motion(free.after(starts, which[flying], (since - events[which])[flying]))
    chatter = ~flying & ~held
    if chatter.any():
        out[:, chatter] = sample_run(scene.system, passage.run, since[chatter] - events[-1])
    if held.any():
        holding = scene.holdings[passage.word.sides[-1]]
        states = holding.after(passage.caught, since[held] - contact)
        out[:, held] = holding.mode.motion(states)
    return out
