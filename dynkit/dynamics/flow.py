"""Flows: dynamical systems in continuous time, and their crossings of a section."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeAlias, final

import numpy as np

from dynkit.core.differences import by_parameter, numerical_derivative
from dynkit.core.no_motion import Diverged
from dynkit.core.parameters import Family
from dynkit.core.smooth_map import stretched
from dynkit.core.stretching import CLEAR, Stretching
from dynkit.core.validation import (
    finite_array,
    non_negative_integer,
    one_of,
    positive,
    returned,
)

if TYPE_CHECKING:
    from dynkit.core.validation import Array
    from dynkit.dynamics.section import PoincareSection


Basis: TypeAlias = "Callable[[Array], Array]"

_STAGES, _TWINS = 8, 3
"""Number of times at which a motion is disturbed, and number of disturbed motions, for errors."""

_HALVINGS = 7
"""An interval that stretches a frame unevenly is halved at most this number of times."""

_EVEN = 1.0 / 16.0
"""Least growth of a disturbance in one part of an interval, relative to the largest growth: at this
ratio the relative error is 16 times as large. Two halves with ratios 1/4 have half of that
error."""


def every_direction(state: Array) -> Array:
    """Return the unit vectors, (d, d)."""
    return np.eye(len(state))


def flow_coordinates(states: Array) -> dict[str, Array]:
    """Return the coordinates (n,) of a flow's states (n, d), and their norm, by name."""
    columns = {f"flow[{i}]": column for i, column in enumerate(states.T)}
    return {**columns, "norm": np.linalg.norm(states, axis=1)}


@final
class Part(NamedTuple):
    """A part of a trajectory: the state at its end, and its derivative (d, d) by the start.

    `size` is the largest norm of the derivative within the part, at least one. `error` estimates
    the error of an entry of the derivative; it is proportional to that size.
    """

    end: Array
    derivative: Array
    size: float
    error: float

    def even(self, begin: Array, end: Array) -> bool:
        """Whether all directions of a frame (d, k) remain clear of the errors of this part.

        `begin` and `end` are orthonormal frames at its start and its end. The least growth between
        them is compared with the largest growth of any disturbance, and with its error.
        """
        carried = end.T @ self.derivative @ begin
        if not carried.size:
            return True
        least = float(np.linalg.svd(carried, compute_uv=False)[-1])
        # for inaccurate flows the limit is twice the length below which `stretched` gives NaN
        return least >= max(_EVEN * self.size, min(2.0 * CLEAR * self.error, 0.5 * self.size))


@final
@dataclass(frozen=True, eq=False)
class Crossing:
    """Where and when a flow crosses a section.

    Parameters
    ----------
    time : float
        Time since the start; positive.
    state : (d,) array
        The flow's state at that time.
    """

    time: float
    state: Array


class Flow(Family, ABC):
    """A dynamical system in continuous time, autonomous.

    The state of a system that is driven in time has its time, or its phase, as an additional
    coordinate.

    A subclass must implement:

    1. `dimension`, the number d of the state's coordinates.
    2. ``velocity(state)``, the (d,) rate of the state.
    3. ``advance(state, duration)``, the (d,) state after a duration >= 0.
    4. ``next_crossing(state, section, time_limit)``, the first time t > 0 at which the section's
       value passes through zero in the section's direction. A state that lies on the section, to
       rounding, has not crossed it yet. Without a crossing by the time limit it raises
       `NoCrossing`.

    A subclass may implement ``parameters``, ``replace`` and `accuracy` as a map does, and four
    derivatives that otherwise are computed from differences:

    5. ``derivative(state, duration)``, the exact (d, d) derivative of ``advance`` with respect to
       the state, the duration held fixed.
    6. ``parameter_derivative(state, duration, name)``, the exact (d,) derivative of ``advance`` by
       a parameter.
    7. ``velocity_jacobian(state)``, the exact (d, d) derivative of ``velocity``.
    8. ``velocity_parameter_derivative(state, name)``, its exact (d,) derivative by a parameter.

    A flow that conserves a quantity, such as the energy, declares it:

    9. `integrals`, a class variable, the names of methods such as ``energy(state)``, each of which
       returns a number that is constant along motions: a first integral. `PoincareMap` acts on a
       level of one of them.
    10. ``integral_gradient(name, state)``, its exact (d,) derivative, and
        ``integral_parameter_derivative(name, state, parameter)``; by default differences.

    None of these changes its arguments or the flow. A state that is not finite, or not of the right
    shape, raises ValueError. Where the motion diverges, `velocity` and `advance` return numbers
    that are not finite, or raise a `NoMotion`, such as `Diverged`. Every other exception is a fault
    of the flow, and no caller catches it. Instances are immutable.
    `dynkit.testing.check_flow` and `check_poincare_map` test a subclass against this contract.
    """

    _following: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "velocity_jacobian": ("velocity",),
        "velocity_parameter_derivative": ("velocity",),
        "derivative": ("advance",),
        "parameter_derivative": ("advance",),
    }

    integrals: ClassVar[tuple[str, ...]] = ()
    """Names of the methods that are first integrals."""

    def __init_subclass__(cls, **options: Any) -> None:
        own = "integral_gradient", "integral_parameter_derivative"
        names: Any = cls.integrals  # anything but a tuple is refused later
        names = names if isinstance(names, tuple) else ()
        cls._following = {**cls._following, **dict.fromkeys(own, names)}
        super().__init_subclass__(**options)

    @property
    @abstractmethod
    def dimension(self) -> int:
        """The number d of the state's coordinates."""

    if TYPE_CHECKING:
        velocity: Any  # in a subclass that derives it from symbols: a function of the symbols, too
    else:

        @abstractmethod
        def velocity(self, state: Array) -> Array:
            """Return the rate of change, (d,), of a state, (d,)."""

    def _velocity(self, state: Array) -> Array:
        """Return the velocity, (d,); ValueError when `velocity` does not return such an array."""
        return returned(self, self.velocity(state), self.dimension, ".velocity")

    def _checked(self, state: Array) -> Array:
        return finite_array("state", state, (self.dimension,))

    def velocity_jacobian(self, state: Array) -> Array:
        """Return the derivative, (d, d), of the velocity at a state, (d,)."""
        return self._velocity_differences(state)[0]

    def _velocity_differences(self, state: Array) -> tuple[Array, Array]:
        """Return the derivative, (d, d), of the velocity by differences, and its error."""
        here = self._checked(state)
        return numerical_derivative(self._velocity, here)

    @property
    def _velocity_by_differences(self) -> bool:
        return type(self).velocity_jacobian is Flow.velocity_jacobian

    def velocity_parameter_derivative(self, state: Array, name: str) -> Array:
        """Return the derivative, (d,), of the velocity at a state, (d,), by a parameter.

        Raises
        ------
        ValueError
            As ``velocity``; and when there is no such parameter.
        """
        return by_parameter(self, name, lambda flow: flow.velocity(state))

    @final
    def integral(self, name: str, state: Array) -> float:
        """Return the value of one of the `integrals` at a state, (d,)."""
        return float(getattr(self, one_of("integral", name, self.integrals))(state))

    def integral_gradient(self, name: str, state: Array) -> Array:
        """Return the derivative, (d,), of one of the `integrals` at a state, (d,)."""
        here = self._checked(state)
        rows, _ = numerical_derivative(lambda at: np.array([self.integral(name, at)]), here)
        return np.asarray(rows[0])

    def integral_parameter_derivative(self, name: str, state: Array, parameter: str) -> float:
        """Return the derivative of one of the `integrals` at a state, (d,), by a parameter."""
        found = by_parameter(self, parameter, lambda at: np.array([at.integral(name, state)]))
        return float(found[0])

    @abstractmethod
    def advance(self, state: Array, duration: float) -> Array:
        """Return the state, (d,), a duration >= 0 after a state, (d,)."""

    def derivative(self, state: Array, duration: float) -> Array:
        """Return the derivative, (d, d), of the advanced state with respect to the state.

        A subclass may define it. Otherwise it is computed from differences of `advance`; the errors
        of multipliers and exponents include their error, as for `Map.jacobian`.
        """
        return self._differences(state, duration)[0]

    @property
    def _by_differences(self) -> bool:
        """Whether derivatives are differences, whose error may exceed the `accuracy`."""
        return type(self).derivative is Flow.derivative

    def _differences(self, state: Array, duration: float) -> tuple[Array, Array]:
        """Return the derivative, (d, d), by differences, and its error."""

        def advanced(start: Array) -> Array:
            end = self.advance(start, duration)
            if not np.isfinite(end).all():
                raise Diverged(f"the motion from {start.tolist()} runs away within {duration}")
            return end

        here = self._checked(state)
        return numerical_derivative(advanced, here, accuracy=self.accuracy)

    def parameter_derivative(self, state: Array, duration: float, name: str) -> Array:
        """Return the derivative, (d,), of the advanced state with respect to a parameter.

        A subclass may define it. Otherwise it is computed from differences of flows that `replace`
        returns, with the accuracy of `Map.parameter_derivative`.

        Parameters
        ----------
        state : (d,) array
        duration : float
            Held fixed.
        name : str
            One of `parameters`.

        Raises
        ------
        ValueError
            As ``advance``; and when there is no such parameter, or its value is not finite.
        """
        how = {"accuracy": self.accuracy}
        return by_parameter(self, name, lambda flow: flow.advance(state, duration), **how)

    @property
    def accuracy(self) -> float:
        """Error of a crossing, relative to the state's size: by default one rounding, 2^-52."""
        return 2.0**-52

    def stretching(self, state: Array, interval: float, n: int) -> Stretching:
        """Return how n intervals of time stretch a frame that starts as the unit vectors.

        Parameters
        ----------
        state : (d,) array
        interval : float
            Duration of an interval; positive. An interval that stretches some direction much less
            than others is divided into parts; a logarithm that is not reliable even then is NaN.
        n : int
            How many intervals; zero or more.

        Raises
        ------
        ValueError
            When the state is not finite or not of that shape, or a number is refused.
        NoMotion
            When the motion diverges, or cannot be followed.

        References
        ----------
        See `Map.stretching`.
        """
        count = non_negative_integer("n", n)
        duration = positive("interval", interval)
        here = self._checked(state)
        frame = np.eye(self.dimension)
        logs, errors = np.empty((2, count, self.dimension))
        for i in range(count):
            parts = list(self._parts(here, duration, every_direction))
            derivatives = np.array([part.derivative for part in parts])
            wrong = np.array([part.error for part in parts])
            here, (logs[i], errors[i]) = parts[-1].end, stretched([(derivatives, wrong)], frame)
        return Stretching(logs, errors, np.full(count, duration), here, frame)

    def _framed(
        self, state: Array, duration: float, begin: Array, across: Basis, last: Array
    ) -> tuple[Array, Array]:
        """Return derivatives over parts between frames of directions, and errors of their entries.

        Parameters
        ----------
        state : (d,) array
        duration : float
        begin : (d, k) array
            The directions at the start.
        across : callable
            The directions (d, k) at the ends of parts, onto which disturbances are projected.
        last : (k, d) array
            Its product with a disturbance at the end of the last part is the result.

        Returns
        -------
        factors : (n, k, k) array
        errors : (n,) array
        """
        known: dict[bytes, Array] = {}

        def once(at: Array) -> Array:
            key = at.tobytes()
            if key not in known:
                known[key] = across(at)
            return known[key]

        parts = list(self._parts(state, duration, once))
        frames = [once(part.end) for part in parts[:-1]]
        begins, ends = np.array([begin, *frames]), np.array([*(each.T for each in frames), last])
        factors = ends @ np.array([part.derivative for part in parts]) @ begins
        sizes = [np.linalg.norm(each, 2, axis=(1, 2)) for each in (begins, ends)]
        return factors, np.array([part.error for part in parts]) * sizes[0] * sizes[1]

    def _parts(self, state: Array, duration: float, basis: Basis) -> Iterator[Part]:
        """Yield the trajectory over a positive duration in parts that are `Part.even`.

        ``basis(state)`` returns the orthonormal directions (d, k) that must remain clear of errors.
        """
        return self._halved(state, duration, basis, _HALVINGS)

    def _halved(self, state: Array, duration: float, basis: Basis, halvings: int) -> Iterator[Part]:
        part = self._part(state, duration)
        if not halvings or part.even(basis(state), basis(part.end)):
            yield part
            return
        for _ in range(2):
            for part in self._halved(state, 0.5 * duration, basis, halvings - 1):
                yield part
                state = part.end

    def _part(self, state: Array, duration: float) -> Part:
        """Return the trajectory over a positive duration as one part."""
        end, off = self.advance(state, duration), 0.0
        if not np.isfinite(end).all():
            raise Diverged(f"the motion from {state.tolist()} runs away within {duration}")
        if self._by_differences:
            derivative, wrong = self._differences(state, duration)
            off = float(wrong.max())
        else:
            derivative = self.derivative(state, duration)
        size = max(1.0, float(np.linalg.norm(derivative, 2)))
        return Part(end, derivative, size, max(off, self.accuracy * size))

    def _disturbance(self, state: Array, sizes: Array) -> Array:  # noqa: ARG002
        """Return the errors (d,) of a short part of the motion near a state of a path.

        `sizes` (d,) are the largest coordinates on the path.
        """
        return self.accuracy / _STAGES * sizes

    def _path(self, state: Array, duration: float) -> Array:
        """Return the states (n, d) at even times of a motion."""
        path = [state]
        for _ in range(_STAGES):
            path.append(self.advance(path[-1], duration / _STAGES))
        return np.array(path)

    def _carried_error(self, path: Array, duration: float, last: Array) -> float:
        """Return the error of the end of a path (n, d), multiplied by `last` (k, d).

        It is a quarter of the distance between the ends of the path and of disturbed motions: an
        orbit's `error` allows for four times as much. Each coordinate is disturbed with a random
        sign at the times of the path. So disturbances that grow on the path are included, even if
        they shrink again later.
        """
        sizes, worst = abs(path).max(axis=0), 0.0
        for seed in range(_TWINS):
            signs, twin = np.random.default_rng(seed), path[0]
            for _ in path[1:]:
                either = signs.choice((-1.0, 1.0), size=len(sizes))
                disturbed = twin + either * self._disturbance(twin, sizes)
                twin = self.advance(disturbed, duration / _STAGES)
            worst = max(worst, float(np.linalg.norm(last @ (twin - path[-1]))))
        return 0.25 * worst

    @abstractmethod
    def next_crossing(self, state: Array, section: PoincareSection, time_limit: float) -> Crossing:
        """Return the first crossing of the section in its direction, after the start.

        Parameters
        ----------
        state : (d,) array
        section : PoincareSection
        time_limit : float
            The longest time to wait; positive.

        Raises
        ------
        NoCrossing
            When there is none within the time limit.
        ValueError
            When the state is not finite, or not of that shape.
        """
