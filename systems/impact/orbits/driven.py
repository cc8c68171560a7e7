"""What periodic orbits of impact oscillators have in common."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.reprs import Facts, told
from dynkit.core.validation import Array
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.systems.impact.state import TWO_PI

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.orbits.equations import Problem
    from dynkit.systems.impact.impact_map import ImpactMap

NONE = np.empty(0)
"""Values of the free parameters where there are none."""


class DrivenOrbit(PeriodicOrbit):
    """A periodic orbit of an impact oscillator in a number of periods of its forcing.

    A subclass says which problem it solves: one with an `oscillator` and a number of `periods`.
    """

    _problem: Any

    def __init__(self, problem: Problem, x: Array, history: tuple[float, ...], cost: Cost) -> None:
        self._problem = problem
        self._x = x.copy()
        self._x.setflags(write=False)
        self._history = history
        self._cost = cost

    def __reduce__(self) -> tuple[Any, ...]:
        # Made anew: copies of arrays could be written to.
        return type(self), (self._problem, self._x, self._history, self._cost)

    def __repr__(self) -> str:
        kind = "stable" if self.stable else "unstable"
        if not self.admissible:
            kind = f"inadmissible, {kind}"
        largest = abs(self.multipliers[0])
        return f"<{self.label} of {told(self.system, 6)}: {kind}, multipliers up to {largest:.4g}>"

    def _facts(self) -> Facts:
        return {**super()._facts(), "period": self.period, "states": len(self.states)}

    @property
    def system(self) -> ImpactMap:
        system: ImpactMap = self._problem.oscillator
        return system

    @property
    def periods(self) -> int:
        """The number m of periods of the forcing."""
        return int(self._problem.periods)

    @property
    def period(self) -> float:
        """Time until it repeats."""
        return self.periods * TWO_PI / self.system.frequency

    @property
    @abstractmethod
    def phases(self) -> Array:
        """Phases of the forcing at its states, ascending, not wrapped."""

    @property
    @abstractmethod
    def _impact_times(self) -> Array:
        """Times, (k,), of the impacts in a period, from the first of its states on."""

    @abstractmethod
    def sample(self, times: object) -> tuple[Array, Array]:
        """Positions and velocities, (k, N) each, at times (k,) from the first of its states on."""

    @cached_property
    def multipliers(self) -> Any:
        """Floquet multipliers, (2N,) complex, the largest modulus first.

        Those of the impact map, or of the flow over the whole period: they are the same.
        """
        found = self._problem.multipliers(self._x, NONE)
        found.setflags(write=False)
        return found

    @cached_property
    def admissible(self) -> bool:
        """Whether simulation from each of its states finds the next in place."""
        return bool(self._problem.admissible(self._x, NONE))

    @property
    def history(self) -> tuple[float, ...]:
        return self._history

    @property
    def cost(self) -> Cost:
        return self._cost

    def problem(self, *names: str) -> Any:
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

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw one period of the contact coordinate, the stops dashed, the impacts as dots.

        Parameters
        ----------
        ax : Axes, optional
            Where to draw; by default a new figure of column width.

        Returns
        -------
        Axes
        """
        from dynkit.systems.impact.drawing import draw

        begin = float(self.phases[0])
        return draw(ax, self.system, self.sample, begin, self.period, self._impact_times)

    @property
    def unknowns(self) -> Array:
        """The solution, (m,), of the equations of its `problem`; read-only."""
        return self._x
