"""Periodic orbits of impact oscillators."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, final

import numpy as np

from dynkit.core.validation import Array, finite_array
from dynkit.systems.impact.orbits.driven import NONE, DrivenOrbit
from dynkit.systems.impact.orbits.solution import ROUNDING
from dynkit.systems.impact.orbits.watching import section_states

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.problem import ImpactProblem
    from dynkit.systems.impact.orbits.solution import Solution


@final
class ImpactOrbit(DrivenOrbit):
    """P(n,m): n impacts in m periods of the forcing.

    From `ImpactOscillator.periodic_orbit`, from an attractor or from a branch. Its unknowns are
    phases and impulses, (2n,), and the modes that no spring holds; it is admissible when all
    impulses push, and no impact is missing.
    """

    _problem: ImpactProblem

    @property
    def _solution(self) -> Solution:
        return self._problem.at(self._x, NONE)

    @property
    def impacts(self) -> int:
        """The number n of impacts."""
        return len(self._problem.sides)

    @property
    def label(self) -> str:
        """``P(n,m)``."""
        return f"P({self.impacts},{self.periods})"

    @property
    def phases(self) -> Array:
        """Phases (n,) of the forcing at the impacts, ascending, not wrapped."""
        return self._x[: self.impacts]

    @property
    def impulses(self) -> Array:
        """Changes (n,) of the relative velocity by the impacts; negative where they would pull."""
        return self._x[self.impacts : 2 * self.impacts]

    @property
    def time(self) -> Array:
        """Times (n,) of the impacts, from the first one."""
        return np.asarray((self.phases - self.phases[0]) / self.system.frequency)

    @property
    def _impact_times(self) -> Array:
        return np.append(self.time, self.period)

    @cached_property
    def states(self) -> Array:
        """Section coordinates (n, 2N) just after the impacts: see `ImpactOscillator`."""
        states = section_states(self.system, self._solution)
        states.setflags(write=False)
        return states

    @property
    def relative_velocity(self) -> Array:
        """Rate (n,) of the gap just after the impacts; negative on the far side of a play."""
        return self.states[:, -2]

    @cached_property
    def error(self) -> float:
        """Bound of the largest error of a section coordinate, to first order in the rounding.

        The sum over the inverse derivative of what rounding and the last residual leave in the
        equations, and the rounding of the states themselves. Infinite where the derivative is
        singular.
        """
        s, problem = self._solution, self._problem
        left = problem.rounding(self._x, NONE) + self.residual
        try:
            moved = abs(np.linalg.inv(problem.linearization(self._x, NONE))) @ left
        except np.linalg.LinAlgError:
            return float("inf")
        moved *= problem.scale(self._x)
        return self._error_of_states(moved) + float(s.rounded.max())

    def _error_of_states(self, moved: Array) -> float:
        """Largest change of a section coordinate by changes (2n,) of the unknowns."""
        n = self.impacts
        worst = ROUNDING * float(abs(self.states).max()) + float(moved[:n].max())
        x = self._x
        scale = self._problem.scale(x)
        for k in np.flatnonzero(moved):
            h = 1e-6 * scale[k]
            there = x.copy()
            there[k] += h
            states = section_states(self.system, self._problem.at(there, NONE))
            gap = self.system.difference(states, self.states)
            worst += float(abs(gap).max() / h * moved[k])
        return worst

    def problem(self, *names: str) -> ImpactProblem:
        problem: ImpactProblem = super().problem(*names)
        return problem

    def observable(self, name: str) -> Array:
        """Return ``relative_velocity``, ``phase`` or ``time`` at the impacts, (n,)."""
        if name == "phase":
            return self.states[:, -1]
        if name in ("relative_velocity", "time"):
            return np.asarray(getattr(self, name))
        raise ValueError(f"name must be relative_velocity, phase or time; got {name!r}")

    def sample(self, times: object) -> tuple[Array, Array]:
        """Positions and velocities at given times, from just after the first impact.

        Parameters
        ----------
        times : (k,) array_like
            Of any size and sign: the motion repeats itself.

        Returns
        -------
        position, velocity : (k, N) arrays
        """
        s = self._solution
        asked = finite_array("times", times, (None,)) % self.period
        which = np.searchsorted(self.time, asked, side="right") - 1
        states = s.motion.mode.after(s.states, which, asked - self.time[which])
        q = states[..., s.motion.mode.layout.modes]
        turn = np.exp(1j * (s.phases[0] + s.terms.frequency * asked))[:, None]
        basis = self.system._structure.free
        position = basis.positions(q) + (s.terms.shape * turn).imag + s.terms.still
        velocity = basis.velocities(q) + s.terms.frequency * (s.terms.shape * turn).real
        velocity += s.motion.mode.forced.drift
        return position, velocity
