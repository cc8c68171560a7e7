"""Flows given by their velocity."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Self, final

import numpy as np

from dynkit.core.differences import numerical_derivative
from dynkit.core.no_motion import CannotFollow
from dynkit.core.validation import Array, in_interval, non_negative, one_of
from dynkit.dynamics.flow import Basis, Crossing, Flow, Part, every_direction
from dynkit.systems.flows.crossings import Search, checked_search
from dynkit.systems.flows.integration import METHODS, Velocity, integrate, integrated_steps, steps

if TYPE_CHECKING:
    from dynkit.dynamics.section import PoincareSection


@dataclass(frozen=True, kw_only=True)
class IntegratedFlow(Flow):
    """A flow given by its velocity; states, derivatives and crossings come from integration.

    A subclass must implement:

    1. `dimension`, the number d of the state's coordinates;
    2. ``velocity(state)``, the rate (d,) of the state, at least twice differentiable.

    It may implement two derivatives. By default they are differences, which are accurate to about
    1e-12 and need further calls of the velocity:

    3. ``velocity_jacobian(state)``, the exact derivative (d, d) of the velocity: row i belongs to
       coordinate i of the velocity. The error of differences adds to that of multipliers and
       exponents;
    4. ``velocity_parameter_derivative(state, name)``, the exact derivative (d,) by a parameter.

    All methods must raise ValueError for a state that is not finite, or not of shape (d,), as
    `dynkit.core.validation.finite_array` does. Choose units in which the coordinates are of order
    one: the tolerance is absolute for coordinates below one and relative above.

    The integrator is SciPy's DOP853, a Runge-Kutta method of order 8. For stiff flows choose Radau,
    an implicit method of order 5, which uses the `velocity_jacobian` and suits tolerances of 1e-9
    and more. The derivative follows from the variational equations, which are integrated with the
    state. The estimated error of every step stays below ``tolerance * (1 + |x_i|)``, as a root mean
    square over the coordinates. Errors of steps add up, and grow as disturbances of the motion
    grow: `advance_error` estimates their sum.

    A crossing is found if the section's value has at most one extremum in every quarter of a step.
    It is then refined by integration until the value is below rounding. Where the motion is tangent
    to the section up to the error of integration, it may or may not be reported as a crossing.

    Parameters
    ----------
    tolerance : float
        Largest error of a step; in [1e-13, 1e-2].
    method : {"DOP853", "Radau"}

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed.,
    Springer 1993, section II.10 (DOP853) and I.14 (variational equations). E. Hairer, G. Wanner,
    Solving Ordinary Differential Equations II, 2nd ed., Springer 1996, section IV.8 (Radau).

    Examples
    --------
    >>> from dynkit.core.validation import finite_array
    >>> @dataclass(frozen=True, kw_only=True)
    ... class Pendulum(IntegratedFlow):
    ...     damping: float = 0.1
    ...     dimension = 2
    ...
    ...     def velocity(self, state):
    ...         angle, rate = finite_array("state", state, (2,))
    ...         return np.array([rate, -np.sin(angle) - self.damping * rate])
    ...
    ...     def velocity_jacobian(self, state):
    ...         angle, _ = finite_array("state", state, (2,))
    ...         return np.array([[0.0, 1.0], [-np.cos(angle), -self.damping]])
    >>> pendulum = Pendulum(damping=0.0)
    >>> pendulum.advance([1.0, 0.0], 10.0)
    array([-0.99894981, -0.04203338])
    >>> pendulum.advance_error([1.0, 0.0], 10.0) < 1e-10
    True

    The period of a swing, compared with its closed form:

    >>> from dynkit import Hyperplane, PoincareMap
    >>> from scipy.special import ellipk
    >>> swing = PoincareMap(pendulum, Hyperplane([0.0, 1.0], direction=-1), time_limit=100.0)
    >>> bool(abs(swing.return_time([1.0]) - 4.0 * ellipk(np.sin(0.5) ** 2)) < 1e-11)
    True
    """

    tolerance: float = 1e-12
    method: str = "DOP853"

    def __post_init__(self) -> None:
        one_of("method", self.method, METHODS)
        object.__setattr__(self, "tolerance", in_interval("tolerance", self.tolerance, 1e-13, 1e-2))

    @property
    def parameters(self) -> Mapping[str, float]:
        """The parameters of this flow, by name, without its tolerance."""
        return {k: v for k, v in super().parameters.items() if k != "tolerance"}

    def replace(self, **parameters: float) -> Self:
        """Return the same flow with some of its parameters, or its tolerance, changed.

        Raises
        ------
        ValueError
            When a name is not one of these, or a value is out of range.
        """
        tolerance = parameters.pop("tolerance", self.tolerance)
        return dataclasses.replace(super().replace(**parameters), tolerance=tolerance)

    @property
    def accuracy(self) -> float:
        """Error of a crossing, relative to a state of order one: 20 times the tolerance.

        The error of a step is at most ``tolerance * (1 + |x_i|)``, twice the tolerance. About ten
        steps contribute to the error of a crossing. `advance_error` examines the motion itself.
        """
        return 20.0 * self.tolerance

    @property
    def _by_differences(self) -> bool:
        return self._velocity_by_differences

    @final
    def advance(self, state: Array, duration: float) -> Array:
        """Return the state, (d,), a duration >= 0 after a state, (d,).

        Raises
        ------
        ValueError
            When the state is not finite or not of that shape, or the duration is negative.
        CannotFollow
            When the motion diverges to infinity, or needs more than 10^8 steps of the integrator.
        """
        return self._integrated(self._velocity, self._checked(state), duration, self.tolerance)

    @final
    def advance_error(self, state: Array, duration: float) -> float:
        """Return an estimate of the error of `advance`, from two less accurate integrations.

        These have ten and a hundred times the tolerance, and about as many times the error. The
        estimate adds their distances from `advance`, since either may be small by chance, and the
        error of a single step, since all three may take the same steps. It is about a hundred times
        too large.

        Raises
        ------
        ValueError, CannotFollow
            As `advance`.
        """
        fine = self.advance(state, duration)
        start = self._checked(state)
        if duration == 0.0:
            return 0.0
        total = self.tolerance * float(np.linalg.norm(1.0 + abs(fine)))
        for times in (10.0, 100.0):
            rough = self._integrated(self._velocity, start, duration, times * self.tolerance)
            total += float(np.linalg.norm(rough - fine))
        return total

    def _disturbance(self, state: Array, sizes: Array) -> Array:  # noqa: ARG002
        return self.tolerance * (1.0 + abs(state))

    @final
    def derivative(self, state: Array, duration: float) -> Array:
        """Return the derivative, (d, d), of the advanced state with respect to the state.

        Raises
        ------
        ValueError, CannotFollow
            As `advance`.
        """
        product = np.eye(self.dimension)
        for part in self._parts(self._checked(state), duration, every_direction):
            product = part.derivative @ product
        return product

    def _parts(self, state: Array, duration: float, basis: Basis) -> Iterator[Part]:
        # Parts end at ends of integrator steps. The derivative is examined after every step: so a
        # growth that is reversed within a part is noticed, and no part is integrated twice.
        d = self.dimension
        left, step, wrong = non_negative("duration", duration), None, 0.0

        def velocity(both: Array) -> Array:
            nonlocal wrong
            if self._by_differences:
                jacobian, off = numerical_derivative(self._velocity, both[:d])
                wrong = max(wrong, float(np.linalg.norm(off)))
            else:
                jacobian = self.velocity_jacobian(both[:d])
            change = jacobian @ both[d:].reshape(d, d)
            return np.concatenate([self._velocity(both[:d]), change.ravel()])

        first = state
        while left > 0.0:
            begin, start, size = basis(state), np.concatenate([state, np.eye(d).ravel()]), 1.0
            try:
                for count, solver in enumerate(
                    steps(velocity, start, left, self.tolerance, step, method=self.method), 1
                ):
                    end, derivative = solver.y[:d].copy(), solver.y[d:].reshape(d, d).copy()
                    size = max(size, float(np.linalg.norm(derivative, 2)))
                    # errors of single steps, as long as these are few
                    error = min(count * self.tolerance * (1.0 + size), self.accuracy * size)
                    # errors of the Jacobian accumulate in time, and grow with the disturbance
                    error += wrong * float(solver.t) * size
                    part = Part(end, derivative, size, error)
                    if not part.even(begin, basis(end)):
                        break
            except CannotFollow as failure:
                raise CannotFollow(
                    f"the motion from {first.tolist()} cannot be followed for {duration}: "
                    f"beyond time {duration - left:.6g} no step is short enough"
                ) from failure
            yield part
            left = left - float(solver.t) if solver.status == "running" else 0.0
            state, step = part.end, min(float(solver.h_abs), left)

    def parameter_derivative(self, state: Array, duration: float, name: str) -> Array:
        """Return the derivative, (d,), of the advanced state with respect to a parameter.

        Raises
        ------
        ValueError
            As `advance`; and when there is no such parameter.
        """
        d = self.dimension
        self.value_of(name)
        start = np.concatenate([self._checked(state), np.zeros(d)])

        def velocity(both: Array) -> Array:
            change = self.velocity_jacobian(both[:d]) @ both[d:]
            change += self.velocity_parameter_derivative(both[:d], name)
            return np.concatenate([self._velocity(both[:d]), change])

        return self._integrated(velocity, start, duration, self.tolerance)[d:]

    def next_crossing(self, state: Array, section: PoincareSection, time_limit: float) -> Crossing:
        start, limit = checked_search(self, state, section, time_limit)
        how: dict[str, Any] = {"method": self.method, "jacobian": self.velocity_jacobian}
        follow = partial(integrated_steps, self._velocity, self.tolerance, **how)
        # the tolerance is relative to coordinates above one, and absolute below
        return Search(self._velocity, section, follow, 1.0, self.tolerance).first(start, limit)

    def _integrated(
        self, velocity: Velocity, start: Array, duration: float, tolerance: float
    ) -> Array:
        plain = len(start) == self.dimension
        jacobian = self.velocity_jacobian if plain else None
        how: dict[str, Any] = {"method": self.method, "jacobian": jacobian}
        try:
            return integrate(velocity, start, non_negative("duration", duration), tolerance, **how)
        except CannotFollow as end:
            raise CannotFollow(
                f"the motion from {start[: self.dimension].tolist()} cannot be followed for "
                f"{duration}: {end}"
            ) from end
