"""Maps of a flow's returns: from one crossing of a surface to the next."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.flow import Basis, Crossing
from dynkit.dynamics.map import Map


class ReturnMap(Map):
    """The map from one crossing of a surface to the next, with its derivatives in parts.

    A subclass must implement `crossing`, the next crossing from a state of the map, and:

    1. `_landed`, the state of the map after a crossing, and `_after`, its changes (d, k) for
       changes (D, k) of the flow's state at a fixed time.

    It may implement, where its states are not those of the flow:

    2. `_lifted`, the state of the flow from which the motion starts, and `_begin`, its derivative;
    3. `_basis`, directions (D, m) of the flow's states to which disturbances are projected at the
       end of a part of the motion.
    """

    flow: Any

    @abstractmethod
    def crossing(self, state: Array) -> Crossing:
        """Return time and state of the flow at the next crossing from a state of the map, (d,)."""

    @abstractmethod
    def _landed(self, hit: Crossing) -> Array: ...

    @abstractmethod
    def _after(self, hit: Crossing, change: Array) -> Array: ...

    def _lifted(self, state: Array) -> Array:
        return finite_array("state", state, (self.dimension,))

    def _begin(self, state: Array) -> Array:
        return np.eye(len(state))

    def _basis(self, state: Array) -> Array:
        return np.eye(len(state))

    def __call__(self, state: Array) -> Array:
        return self._landed(self.crossing(state))

    @property
    def accuracy(self) -> float:
        """Error of one call, relative to the size of the state: the flow's accuracy."""
        return float(self.flow.accuracy)

    @property
    def _by_differences(self) -> bool:
        return bool(self.flow._by_differences)

    def return_time(self, state: Array) -> float:
        """Return the time from a state, (d,), to the next crossing."""
        return self.crossing(state).time

    def call_errors(self, states: Array) -> Array:
        """Return errors (n,) of the calls of states (n, d), by disturbed motions.

        They include disturbances that grow after a crossing and shrink again before the next.
        """
        found = []
        for state in states:
            hit, path = self._way(state)
            after = self._after(hit, np.eye(self.flow.dimension))
            found.append(self.flow._carried_error(path, hit.time, after))
        return np.maximum(super().call_errors(states), found)

    def _way(self, state: Array) -> tuple[Crossing, Array]:
        hit = self.crossing(state)
        return hit, self.flow._path(self._lifted(state), hit.time)

    def jacobian_factors(self, state: Array) -> tuple[Array, Array]:
        """Return derivatives (n, d, d) over parts of the return, and errors of entries.

        The derivatives include the change of the crossing time, and the reset of a flow that has
        one. At the end of a part, disturbances of a `PoincareMap` are projected across the flow: a
        disturbance along the flow changes the time of the return and not the state. In each part,
        every disturbance across the flow grows by at least a sixteenth of the largest growth of any
        disturbance, those along the flow included. The errors are proportional to that largest
        growth; a projected factor may be smaller than its error.

        Raises
        ------
        TangentCrossing
            When the motion is tangent to the surface at the crossing.
        NoCrossing, ValueError
            As the call itself.
        """
        return self._factors(state, self.crossing(state))

    def _factors(self, state: Array, hit: Crossing) -> tuple[Array, Array]:
        return self._chained(state, hit, self._begin(state), None, self._basis)

    def _chained(
        self, state: Array, hit: Crossing, begin: Array, last: Array | None, across: Basis
    ) -> tuple[Array, Array]:
        """Return factors over parts of the return, from `begin` (D, k) to `last` (k, d).

        By default `last` is the identity.
        """
        arrived = self._after(hit, np.eye(self.flow.dimension))
        end = arrived if last is None else last @ arrived
        factors, errors = self.flow._framed(self._lifted(state), hit.time, begin, across, end)
        return factors, errors

    def _followed(
        self,
        state: Array,
        most: int,  # noqa: ARG002 (returns are followed one by one)
    ) -> tuple[Array, list[tuple[Array, Array]], Sequence[float]]:
        hit = self.crossing(state)
        return self._landed(hit), [self._factors(state, hit)], [hit.time]

    def _pushed(self, state: Array, direction: Array) -> tuple[Array, Array]:
        """Return the next state and the direction, by one derivative over the whole return.

        The return need not be divided into parts: the direction turns to the one that grows most.
        """
        hit, moved = self.crossing(state), self._begin(state) @ direction
        change = self.flow.derivative(self._lifted(state), hit.time) @ moved
        return self._landed(hit), self._after(hit, change[:, None])[:, 0]

    def _across(self, state: Array) -> Array:
        """Return orthonormal directions, (D, D - 1), across the flow at a state of the flow."""
        return np.linalg.qr(self.flow.velocity(state)[:, None], mode="complete")[0][:, 1:]
