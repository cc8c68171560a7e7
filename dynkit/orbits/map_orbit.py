"""Periodic orbits of maps."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, final

import numpy as np

from dynkit.core.reprs import told
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array, finite_array, one_of
from dynkit.orbits.equations import KeptSolution
from dynkit.orbits.newton import orbit_bound
from dynkit.orbits.problem import PeriodicOrbit

_NONE = np.empty(0)


@final
class MapOrbit(KeptSolution, PeriodicOrbit):
    """P(n): n states that a map takes one into the next, and the last into the first.

    From `periodic_orbit`, from an attractor or from a branch. It is a motion of the map wherever
    the map is defined: always admissible.
    """

    def __repr__(self) -> str:
        hidden = int((~self.multipliers_resolved).sum())
        doubt = f"; {hidden} of {len(self.multipliers)} multipliers not resolved" if hidden else ""
        kind = "stable" if self.stable else "unstable"
        return f"<{self.label} of {told(self.system, 6)}: {kind}{doubt}>"

    @property
    def system(self) -> SmoothMap:
        system: SmoothMap = self._problem.system
        return system

    @property
    def period(self) -> int:
        """The number n of states."""
        return self._x.size // self.system.dimension

    @property
    def label(self) -> str:
        """``P(n)``."""
        return f"P({self.period})"

    @cached_property
    def states(self) -> Array:
        """Its states, (n, d), one after the other, read-only; angles are where the map has them."""
        states: Array = self._problem.states(self._x)
        states.setflags(write=False)
        return states

    @cached_property
    def multipliers(self) -> Any:
        """Floquet multipliers, (d,) complex, the largest modulus first.

        They are the `product_eigenvalues` of the map's `jacobian_factors` at all states: small ones
        are right too, relative to themselves, to the errors of these factors and of the states. See
        `multipliers_error`, and `multipliers_resolved` for those of which nothing is known.

        Raises
        ------
        NoSolution
            When the map has no derivative there.
        """
        return self.problem().multipliers(self._x, _NONE)

    @property
    def admissible(self) -> bool:
        return True

    @cached_property
    def error(self) -> float:
        """Bound of the largest error of a coordinate, to first order in the map's `accuracy`.

        Twice the sum, over the inverse derivative, of the residual that is left and four times the
        accuracy of a call, for states of the size of the largest. Infinite where the derivative is
        singular, or may be within the error of differences.
        """
        return float(orbit_bound(self.problem(), self._x, _NONE).max())

    def observable(self, name: str) -> Array:
        """Return one coordinate of its states, (n,): ``state[0]`` and so on, or of the flow.

        Raises
        ------
        ValueError
            When there is no such coordinate.
        """
        known = self.system.coordinates(self.states)
        return known[one_of("name", name, list(known))]

    @property
    def observables(self) -> Sequence[str]:
        """Names of its coordinates, the first by default."""
        return tuple(self.system.coordinates(self.states))

    def sample(self, iterates: object) -> Array:
        """Return the states, (k, d), so many iterates after the first one.

        Parameters
        ----------
        iterates : (k,) array_like
            Integers of any size and sign: the motion repeats itself.

        Raises
        ------
        ValueError
            When one is no integer.
        """
        asked = finite_array("iterates", iterates, (None,))
        for i in np.flatnonzero(asked != np.rint(asked))[:1].tolist():
            raise ValueError(f"iterates[{i}] must be an integer; got {float(asked[i])!r}")
        return np.asarray(self.states[np.asarray(asked % self.period, dtype=np.intp)])
