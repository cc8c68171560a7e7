"""The equations of periodic orbits of maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Self, final

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.stretching import product_with_error
from dynkit.core.validation import Array
from dynkit.orbits.map_orbit import StatesProblem, following
from dynkit.orbits.newton import NoSolution

TURN = 2.0 * np.pi

ROUNDINGS = 4.0
"""What is left in the equations, and in derivatives, in units of the accuracy of a call."""


@final
class MapProblem(StatesProblem):
    """x_{i+1} = f(x_i), i modulo n: n d equations for the n states of a periodic orbit.

    See `StatesProblem`.
    """

    def __init__(self, system: SmoothMap, states: Array, names: Sequence[str] = ()) -> None:
        super().__init__(system, states, names)
        self._derivatives: tuple[bytes, Array, Array, tuple[Array, Array]]
        self._derivatives = b"", np.empty(0), np.empty(0), (np.empty(0), np.empty(0))

    @property
    def label(self) -> str:
        return f"P({len(self._like)})"

    def made_of(self, system: SmoothMap, states: Array, which: Any, names: Sequence[str]) -> Self:  # noqa: ARG002
        return type(self)(system, states, names)

    def residual(self, x: Array, p: Array) -> Array:
        system, states = self.at(p), self._rows(x)
        gap = system.difference(_defined(system, states), following(states))
        return np.asarray((gap / self.units).ravel())

    def rounding(self, x: Array, p: Array) -> Array:
        """Four times what a call may be wrong by, for states of the size of the largest."""
        wrong = ROUNDINGS * self.at(p).accuracy * float(abs(x).max()) / self.units
        return np.tile(wrong, len(self._like))

    def blocks(self, x: Array, p: Array) -> tuple[Array, Array]:
        by_state = self.jacobians(x, p) / self.units[:, None]
        return by_state, np.broadcast_to(-np.diag(1.0 / self.units), by_state.shape)

    def linearization_error(self, x: Array, p: Array) -> Any:
        system = self.at(p)
        if not system._by_differences:
            return 0.0
        self.jacobians(x, p)
        n, d = self._like.shape
        matrix = np.zeros((n, d, n, d))
        each = np.arange(n)
        matrix[each, :, each] = self._derivatives[2][:, None, None] / self.units[:, None]
        return matrix.reshape(n * d, n * d)

    def parameter_derivative(self, x: Array, p: Array) -> Array:
        system, columns = self.at(p), []
        for name in self._names:
            by_name = partial(system.parameter_derivative, name=name)
            columns.append((_defined(by_name, self._rows(x)) / self.units).ravel())
        return np.stack(columns, axis=1) if columns else np.empty((self.size, 0))

    def factors(self, x: Array, p: Array) -> tuple[Array, Array]:
        self.jacobians(x, p)
        return self._derivatives[3]

    def states(self, x: Array) -> Array:
        states = self._rows(x).copy()
        turning = angles(self._system)
        if turning.any():
            arrived = np.array([self._system(state) for state in np.roll(states, 1, axis=0)])
            turns = np.rint((states - arrived) / TURN)
            states[:, turning] -= TURN * turns[:, turning]
        return states

    def jacobians(self, x: Array, p: Array) -> Array:
        """Return the map's derivatives, (n, d, d), at all states; read-only.

        Raises
        ------
        NoSolution
            Where there is none.
        """
        key = np.asarray(x).tobytes() + np.asarray(p, dtype=np.float64).tobytes()
        if key != self._derivatives[0]:
            system, factors, errors = self.at(p), list[Array](), list[Array]()
            wrong = list[float]()

            def jacobian(state: Array) -> Array:
                matrices, off = system.jacobian_factors(state)
                factors.append(matrices)
                errors.append(ROUNDINGS * off)
                product, error = product_with_error(matrices, off)
                wrong.append(error)
                return product

            found = _defined(jacobian, self._rows(x))
            found.setflags(write=False)
            known = np.concatenate(factors), np.concatenate(errors)
            self._derivatives = key, found, np.array(wrong), known
        return self._derivatives[1]


def _defined(function: Callable[[Array], Array], states: Array) -> Array:
    """What a function gives at each of the states (n, d), as an array."""
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = np.array([function(state) for state in states])
    except NoMotion as end:
        raise NoSolution(str(end)) from end
    finite = np.isfinite(found)
    if not finite.all():
        where = int(np.argmin(finite.reshape(len(states), -1).all(axis=1)))
        raise NoSolution(f"the map is not finite at {states[where].tolist()}")
    return found


def angles(system: SmoothMap) -> Any:
    """Which coordinates, (d,) of bool, are angles: those in which a turn is no difference."""
    d = system.dimension
    turned = system.difference(TURN * np.eye(d), np.zeros(d))
    return abs(np.diag(turned)) < 1e-9
