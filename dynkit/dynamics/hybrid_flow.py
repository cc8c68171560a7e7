"""Flows whose state jumps where a guard falls to zero, and the maps from one reset to the next."""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self, final

import numpy as np

from dynkit.core.angles import in_turn
from dynkit.core.differences import by_parameter, numerical_derivative
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoCrossing, TangentCrossing
from dynkit.core.validation import Array, finite_array, index_in, of_type, positive, returned
from dynkit.dynamics.flow import Crossing, Flow
from dynkit.dynamics.return_map import ReturnMap

_TURN = 2.0 * np.pi


class HybridFlow(Flow):
    """A flow whose state jumps where a guard falls to zero.

    Besides what a `Flow` must implement, a subclass must implement:

    1. ``guard(state)``, a smooth number. The state jumps where it falls to zero, if it was positive
       before. A motion may start where it is zero or negative; it must become positive first.
    2. ``reset(state)``, the (d,) state after the jump, from the state (d,) just before it. Both are
       smooth.

    A subclass may implement:

    3. ``armed(state)``, a number or a truth value: where the guard falls to zero and this is not
       positive, or false, nothing happens. By default it is one everywhere.
    4. ``guard_gradient(state)``, (d,), and ``reset_jacobian(state)``, (d, d), the exact derivatives
       by the state; ``guard_parameter_derivative(state, name)``, a number, and
       ``reset_parameter_derivative(state, name)``, (d,), those by a parameter. By default they are
       differences.

    `velocity`, `advance`, `derivative` and `next_crossing` are those of the motion between jumps;
    `next_crossing` must use only the dimension, direction, value and gradient of a section.
    `ResetMap` is the map from one jump to the next.
    """

    _following: ClassVar[Mapping[str, tuple[str, ...]]] = {
        **Flow._following,
        "guard_gradient": ("guard",),
        "guard_parameter_derivative": ("guard",),
        "reset_jacobian": ("reset",),
        "reset_parameter_derivative": ("reset",),
    }

    if TYPE_CHECKING:
        guard: Any  # in a subclass that derives them from symbols: functions of the symbols, too
        reset: Any
        armed: Any
    else:

        @abstractmethod
        def guard(self, state: Array) -> float:
            """Return the number that falls to zero where the state jumps."""

        @abstractmethod
        def reset(self, state: Array) -> Array:
            """Return the state after the jump, (d,), from the state before it, (d,)."""

        def armed(self, state: Array) -> float:  # noqa: ARG002
            """Return a number that is positive where the state may jump."""
            return 1.0

    def guard_gradient(self, state: Array) -> Array:
        """Return the derivative, (d,), of the guard at a state, (d,)."""
        here = finite_array("state", state, (self.dimension,))
        rows, _ = numerical_derivative(lambda at: np.array([_guard(self, at)]), here)
        return np.asarray(rows[0])

    def guard_parameter_derivative(self, state: Array, name: str) -> float:
        """Return the derivative of the guard at a state, (d,), by a parameter."""
        return float(by_parameter(self, name, lambda at: np.array([_guard(at, state)]))[0])

    def reset_jacobian(self, state: Array) -> Array:
        """Return the derivative, (d, d), of the state after the jump by that before it, (d,)."""
        here = finite_array("state", state, (self.dimension,))
        return numerical_derivative(self.reset, here)[0]

    def reset_parameter_derivative(self, state: Array, name: str) -> Array:
        """Return the derivative, (d,), of the state after the jump by a parameter."""
        return by_parameter(self, name, lambda flow: flow.reset(state))


def smooth(name: str, flow: Flow) -> None:
    """Refuse a flow whose state jumps.

    Raises
    ------
    ValueError
        Naming the argument.
    """
    if isinstance(flow, HybridFlow):
        raise ValueError(f"{name} must have no resets; got {flow!r}: ResetMap is its map")


def _number(flow: HybridFlow, method: str, value: Any) -> float:
    """Return what a method of the user returned as a float; it need not be finite.

    `armed` may return a truth value.
    """
    found = np.asarray(value)
    if found.ndim or found.dtype.kind not in ("fiub" if method == ".armed" else "fiu"):
        raise ValueError(f"{type(flow).__name__}{method} must return a real number; got {value!r}")
    return float(found)


def _guard(flow: HybridFlow, state: Array) -> float:
    return _number(flow, ".guard", flow.guard(state))


@final
@dataclass(frozen=True, eq=False)
class _GuardSurface:
    """The surface on which the guard of a flow falls to zero: a section without a chart."""

    flow: HybridFlow
    direction = -1

    @property
    def dimension(self) -> int:
        return self.flow.dimension

    def value(self, state: Array) -> float:
        return _guard(self.flow, state)

    def gradient(self, state: Array) -> Array:
        return self.flow.guard_gradient(state)


@final
@dataclass(frozen=True, eq=False)
class ResetMap(ReturnMap):
    """The map of a hybrid flow from the state after one jump to the state after the next.

    Its states are those of the flow, (d,). A disturbance along the flow changes only the time of
    the next jump: multipliers and Lyapunov exponents are those of the d - 1 other directions.

    Parameters
    ----------
    flow : HybridFlow
    time_limit : float
        The longest time to the next jump; a call without a jump by then raises `NoCrossing`.
    angles : sequence of int
        Indices of coordinates that are angles: they are taken modulo 2 pi after a jump.

    Raises
    ------
    ValueError
        When the flow does not jump, the time limit is not positive, or an angle is not an index of
        a coordinate.

    References
    ----------
    M. di Bernardo, C. J. Budd, A. R. Champneys, P. Kowalczyk, Piecewise-smooth Dynamical Systems,
    Springer 2008, section 2.5 (the derivative across an event: the saltation matrix).

    Examples
    --------
    A wheel without a rim, of twelve spokes, rolls down a slope and loses speed at each spoke. Its
    steady speed has a closed form (T. McGeer, International Journal of Robotics Research 9 (1990)
    62-82), and its multiplier is the square of the loss:

    >>> import sympy
    >>> from dynkit import periodic_orbit
    >>> from dynkit.systems import SymbolicHybridFlow
    >>> class Wheel(SymbolicHybridFlow):
    ...     slope: float = 0.08
    ...     spoke: float = np.pi / 6
    ...
    ...     def velocity(self, angle, rate):
    ...         return rate, sympy.sin(angle)
    ...
    ...     def guard(self, angle, rate):
    ...         return self.slope + self.spoke / 2 - angle
    ...
    ...     def reset(self, angle, rate):
    ...         return angle - self.spoke, sympy.cos(self.spoke) * rate
    >>> roll = ResetMap(Wheel(), time_limit=100.0)
    >>> orbit = periodic_orbit(roll, [-0.18, 0.5])
    >>> gained = 4.0 * np.sin(0.08) * np.sin(np.pi / 12)
    >>> bool(abs(orbit.states[0, 1] ** 2 - 0.75 * gained / 0.25) < 1e-14)
    True
    >>> bool(abs(orbit.multipliers[0] - 0.75) < 1e-14)
    True
    """

    flow: HybridFlow
    time_limit: float
    angles: Sequence[int] = ()

    def __post_init__(self) -> None:
        of_type("flow", self.flow, HybridFlow, "a HybridFlow, with guard and reset")
        object.__setattr__(self, "time_limit", positive("time_limit", self.time_limit))
        last = self.flow.dimension - 1
        turning = (index_in(f"angles[{i}]", k, 0, last) for i, k in enumerate(self.angles))
        object.__setattr__(self, "angles", tuple(turning))

    @property
    def dimension(self) -> int:
        return self.flow.dimension

    @property
    def parameters(self) -> Mapping[str, float]:
        """The parameters of the flow."""
        return self.flow.parameters

    def replace(self, **parameters: float) -> Self:
        return dataclasses.replace(self, flow=self.flow.replace(**parameters))

    def difference(self, a: Array, b: Array) -> Array:
        gap = super().difference(a, b)
        turning = list(self.angles)
        gap[..., turning] -= _TURN * np.rint(gap[..., turning] / _TURN)
        return gap

    @cached_property
    def _surface(self) -> Any:
        return _GuardSurface(self.flow)

    def crossing(self, state: Array) -> Crossing:
        """Return time and state, (d,), just before the next jump of a motion.

        Parameters
        ----------
        state : (d,) array

        Raises
        ------
        NoCrossing
            When there is no jump within the time limit.
        ValueError
            When the state is not finite, or not of that shape.
        """
        here, time = finite_array("state", state, (self.dimension,)), 0.0
        while time < self.time_limit:
            hit = self.flow.next_crossing(here, self._surface, self.time_limit - time)
            here, time = hit.state, time + hit.time
            if _number(self.flow, ".armed", self.flow.armed(here)) > 0.0:
                return Crossing(time, here)
        raise NoCrossing(f"no jump within {self.time_limit}")

    def _landed(self, hit: Crossing) -> Array:
        state = returned(self.flow, self.flow.reset(hit.state), self.dimension, ".reset").copy()
        turning = list(self.angles)
        state[turning] = in_turn(state[turning])
        return state

    def orbit_factors(self, state: Array, following: Array) -> tuple[Array, Array]:
        """Return the `jacobian_factors` without the direction along the flow, (n, d - 1, d - 1)."""
        last = self._frame(following).T
        return self._chained(state, self.crossing(state), self._frame(state), last, self._frame)

    def _frame(self, state: Array) -> Array:
        return self._across(state)

    @property
    def _framed(self) -> bool:
        return True

    def _after(self, hit: Crossing, change: Array, of_guard: float = 0.0) -> Array:
        """Return changes (d, k) after the jump for changes (d, k) at a fixed time before it.

        `of_guard` is the change of the guard at a fixed state, by a parameter.
        """
        velocity, gradient = self.flow.velocity(hit.state), self.flow.guard_gradient(hit.state)
        rate = float(gradient @ velocity)
        if rate == 0.0:
            raise TangentCrossing(f"the motion is tangent to the guard at {hit.state.tolist()}")
        later = -(gradient @ change + of_guard) / rate
        jumped = self.flow.reset_jacobian(hit.state) @ (change + np.outer(velocity, later))
        return np.asarray(jumped)

    def parameter_derivative(self, state: Array, name: str) -> Array:
        """Return the derivative, (d,), by a parameter of velocity, guard or reset.

        Raises
        ------
        TangentCrossing, NoCrossing
            As for `jacobian_factors`.
        ValueError
            As the call itself; and when there is no such parameter.
        """
        self.value_of(name)
        hit, here = self.crossing(state), finite_array("state", state, (self.dimension,))
        change = self.flow.parameter_derivative(here, hit.time, name)[:, None]
        of_guard = self.flow.guard_parameter_derivative(hit.state, name)
        moved = self._after(hit, change, of_guard)[:, 0]
        return moved + self.flow.reset_parameter_derivative(hit.state, name)
