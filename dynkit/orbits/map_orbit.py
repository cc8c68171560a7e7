"""Periodic orbits of maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoMotion
from dynkit.core.reprs import system_repr
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array, finite_array, one_of, read_only
from dynkit.orbits.equations import KeptSolution
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.orbits.solving import orbit_bound

_NONE = np.empty(0)


class _Equations(Protocol):
    @property
    def system(self) -> SmoothMap: ...

    def states(self, x: Array) -> Array: ...


@final
class MapOrbit(KeptSolution, PeriodicOrbit):
    """P(n): n states, each the image of the one before it, and the first the image of the last.

    It is made by `periodic_orbit` or an attractor, or taken from a branch. It is always admissible.
    """

    _problem: _Equations

    def __repr__(self) -> str:
        what = f"{self.label} of {system_repr(self.system, 6)}"
        try:
            return f"<{what}: {self._stability()}>"
        except NoMotion as failure:
            return f"<{what}: no multipliers, as {failure}>"

    def _stability(self) -> str:
        hidden = int((~self.multipliers_resolved).sum())
        doubt = f"; {hidden} of {len(self.multipliers)} multipliers not resolved" if hidden else ""
        kind = "stable" if self.stable else "unstable"
        beyond, error = abs(self.multipliers) - 1.0, self.multipliers_error
        if not self.system.conservative and (abs(beyond) <= error).any():
            kind = kind if (beyond > error).any() else "stability not resolved"
        return kind + doubt

    @property
    def system(self) -> SmoothMap:
        return self._problem.system

    @property
    def period(self) -> int:
        """The number n of states."""
        return self._x.size // self.system.dimension

    @property
    def duration(self) -> float:
        """Time of one turn: for a section of a flow the orbit's period, for other maps n."""
        return float(sum(map(self.system.return_time, self.states)))

    @property
    def label(self) -> str:
        """``P(n)``."""
        return f"P({self.period})"

    @cached_property
    def states(self) -> Array:
        """The states, (n, d), in their order, read-only; angles are those that the map returns."""
        return read_only(self._problem.states(self._x))

    @cached_property
    def multipliers(self) -> Any:
        """Floquet multipliers, (d,) complex, the largest modulus first.

        They are the `product_eigenvalues` of the map's `jacobian_factors` at all states. Small ones
        are accurate relative to themselves, up to the errors of these factors and of the states.
        See `multipliers_error`, and `multipliers_resolved` for multipliers without a correct digit.

        Raises
        ------
        NoMotion
            When the map has no derivative at a state.
        """
        return self.problem().multipliers(self._x, _NONE)

    @property
    def admissible(self) -> bool:
        return True

    @cached_property
    def error(self) -> float:
        """Bound of the largest error of a coordinate, to first order in the errors of the map.

        It is twice the inverse derivative of the equations times the sum of the residual and four
        times the `call_errors` of the map. Infinite where the derivative is singular, or may be
        singular within its error.
        """
        return float(orbit_bound(self.problem(), self._x, _NONE).max())

    def observable(self, name: str) -> Array:
        """Return one coordinate of the states, (n,): ``state[0]`` ..., or of the flow.

        Raises
        ------
        ValueError
            When there is no such coordinate.
        """
        known = self.system.coordinates(self.states)
        return known[one_of("name", name, list(known))]

    @property
    def observables(self) -> Sequence[str]:
        """Names of the coordinates; diagrams draw the first by default."""
        return tuple(self.system.coordinates(self.states))

    def sample(self, iterates: object) -> Array:
        """Return the states, (k, d), at numbers of iterates after the first state.

        Parameters
        ----------
        iterates : (k,) array_like
            Integers of any size and sign.

        Raises
        ------
        ValueError
            When one is not an integer.
        """
        asked = finite_array("iterates", iterates, (None,))
        for i in np.flatnonzero(asked != np.rint(asked))[:1].tolist():
            raise ValueError(f"iterates[{i}] must be an integer; got {float(asked[i])!r}")
        return np.asarray(self.states[np.asarray(asked % self.period, dtype=np.intp)])
