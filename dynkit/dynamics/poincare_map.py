"""Poincare maps: a flow and a section."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from dynkit.core.differences import by_parameter, numerical_derivative
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoCrossing, Refused, TangentCrossing
from dynkit.core.validation import (
    Array,
    check_fields,
    finite_array,
    finite_scalar,
    non_negative,
    of_type,
    one_of,
    positive,
)
from dynkit.dynamics.flow import Crossing, Flow, flow_coordinates
from dynkit.dynamics.hybrid_flow import smooth
from dynkit.dynamics.return_map import ReturnMap
from dynkit.dynamics.section import PoincareSection, Stroboscope

# Largest number of Newton's steps, and the rounding of an integral relative to its terms.
_STEPS, _ROUNDINGS = 50, 4.0 * 2.0**-52
# A change of an integral along a motion up to this, relative to its terms, is an error of the flow.
_DRIFT = 1e-6


@final
@dataclass(frozen=True, eq=False)
class Level:
    """States of a section at which a first integral of a flow has a given value.

    A state r near the level is moved onto the level along the gradient g of the integral at the
    state: the result is r + c g(r). In the terms of the reference, the multiple c is the unfolding
    parameter, and the value of the integral is the additional equation. On the level c is zero.

    Parameters
    ----------
    flow : Flow
    section : PoincareSection
    name : str
        One of the flow's `integrals`.
    value : float

    References
    ----------
    F. J. Munoz-Almaraz, E. Freire, J. Galan, E. Doedel, A. Vanderbauwhede, Continuation of periodic
    orbits in conservative and Hamiltonian systems, Physica D 181 (2003) 1-38.
    """

    flow: Flow
    section: PoincareSection
    name: str
    value: float

    def gradient(self, reduced: Array) -> Array:
        """Return the derivative, (d - 1,), of the integral by coordinates of the section."""
        full = self.flow.integral_gradient(self.name, self.section.lift(reduced))
        return np.asarray(self.section.lift_derivative(reduced).T @ full)

    def onto(self, reduced: Array) -> tuple[Array, float]:
        """Return the state on the level, (d - 1,), and the multiple c of the gradient.

        Raises
        ------
        Refused
            When there is no state of this level along the gradient.
        """
        way, here, multiple = self.gradient(reduced), reduced, 0.0
        for _ in range(_STEPS):
            full = self.section.lift(here)
            off = self.value - self.flow.integral(self.name, full)
            terms = abs(self.flow.integral_gradient(self.name, full)) @ abs(full)
            if abs(off) <= _ROUNDINGS * float(terms + abs(self.value)):
                return here, multiple
            slope = float(way @ self.gradient(here))
            if slope == 0.0 or not np.isfinite(off / slope):
                break
            multiple += off / slope
            here = reduced + multiple * way
        raise Refused(f"no state with {self.name} {self.value!r} is near {reduced.tolist()}")

    def require_constant(self, arrived: Array) -> None:
        """Raise ValueError if the integral has another value after a motion from the level."""
        value = self.flow.integral(self.name, arrived)
        terms = abs(self.flow.integral_gradient(self.name, arrived)) @ abs(arrived)
        most = max(_DRIFT, self.flow.accuracy**0.5) * float(terms + abs(self.value))
        if abs(value - self.value) > most:
            raise ValueError(
                f"{self.name} must be constant along motions, as one of the integrals; it went "
                f"from {self.value:.6g} to {value:.6g}, at {arrived.tolist()}"
            )

    def derivative(self, reduced: Array) -> Array:
        """Return the derivative, (d - 1, d - 1), of the state on the level by the state."""
        here, multiple = self.onto(reduced)
        bent = np.eye(len(reduced))
        if self._is_off(reduced, here):
            bent += multiple * numerical_derivative(self.gradient, reduced)[0]
        along, rows = self._along(reduced, here)
        return bent - np.outer(along, rows @ bent)

    def by_parameter(self, reduced: Array, parameter: str) -> Array:
        """Return the derivative, (d - 1,), of the state on the level by a parameter.

        The value of the integral is a parameter, too, with the integral's name.
        """
        here, multiple = self.onto(reduced)
        along, rows = self._along(reduced, here)
        if parameter == self.name:
            return along
        moved = np.zeros(len(reduced))
        if self._is_off(reduced, here):
            moved = multiple * by_parameter(
                self.flow, parameter, lambda flow: replace(self, flow=flow).gradient(reduced)
            )
        full = self.section.lift(here)
        change = self.flow.integral_parameter_derivative(self.name, full, parameter)
        return np.asarray(moved - along * (change + float(rows @ moved)))

    def _is_off(self, reduced: Array, here: Array) -> bool:
        """Whether the state is off the level by more than errors of the flow."""
        return float(abs(here - reduced).max()) > self.flow.accuracy * float(abs(here).max())

    def _along(self, reduced: Array, here: Array) -> tuple[Array, Array]:
        """Return the derivative of the state on the level by the value of the integral.

        Return also the gradient, (d - 1,), of the integral at the state on the level, `here`.
        """
        way, rows = self.gradient(reduced), self.gradient(here)
        return way / float(way @ rows), rows

    def frame(self, here: Array) -> Array:
        """Return orthonormal directions, (d - 1, d - 2), of the section within the level."""
        return np.linalg.qr(self.gradient(here)[:, None], mode="complete")[0][:, 1:]


# Times that differ by less than this fraction of the period are equal.
_CLOSED = 1e-6


@final
@dataclass(frozen=True, eq=False)
class PoincareMap(ReturnMap):
    """The map from one crossing of a section to the next: a flow and a section.

    Its states are coordinates on the section: d - 1 for a flow of dimension d.

    Parameters
    ----------
    flow : Flow
    section : PoincareSection
        A section in the flow's state space.
    time_limit : float
        The longest time to the next crossing; a call without a crossing by then raises
        `NoCrossing`.
    least_rate : float
        Least rate at which the section's value grows, in its direction, at the state itself; a
        smaller rate raises `TangentCrossing`. By default no state is refused.
    level : (str, float), optional
        One of the flow's `integrals` by name, and its value: a motion starts from the state that is
        put onto this level along the integral's gradient. The value is a parameter of the map, of
        this name. By default a motion starts from the state itself.

    Raises
    ------
    ValueError
        When the dimensions differ, the time limit is not positive, the least rate is negative, the
        flow has no such integral, or it has resets: see `ResetMap`.

    References
    ----------
    T. S. Parker and L. O. Chua, Practical Numerical Algorithms for Chaotic Systems, Springer 1989,
    chapter 2 (the map) and appendix D (its derivative). See `Level` for the level.

    Examples
    --------
    Orbits of a conservative flow form families. On a level of the energy they are isolated, and
    the energy is the parameter of a branch:

    >>> from dynkit import Hyperplane, continue_orbit, periodic_orbit
    >>> from dynkit.systems import HenonHeiles
    >>> plane = Hyperplane([0.0, 1.0, 0.0, 0.0])
    >>> returns = PoincareMap(HenonHeiles(), plane, time_limit=50.0, level=("energy", 0.1))
    >>> orbit = periodic_orbit(returns, [0.0, 0.0, 0.4])
    >>> orbit.states.round(12), orbit.stable
    (array([[0.       , 0.       , 0.4472136]]), True)
    >>> continue_orbit(orbit, "energy", bounds=(0.05, 0.13)).endings[1].message
    'the bound was reached: energy 0.13'
    """

    flow: Flow
    section: PoincareSection
    time_limit: float
    least_rate: float = 0.0
    level: tuple[str, float] | None = None

    def __post_init__(self) -> None:
        of_type("flow", self.flow, Flow, "a Flow")
        of_type("section", self.section, PoincareSection, "a PoincareSection")
        smooth("flow", self.flow)
        if self.section.dimension != self.flow.dimension:
            raise ValueError(
                f"section must have the flow's dimension {self.flow.dimension}; "
                f"got {self.section.dimension}"
            )
        check_fields(self, time_limit=positive, least_rate=non_negative)
        if self.level is not None:
            of_type("level", self.level, tuple, "a pair of a name and a value")
            name, value = self.level
            one_of("level", name, self.flow.integrals)
            object.__setattr__(self, "level", (name, finite_scalar(name, value)))

    @property
    def dimension(self) -> int:
        return self.flow.dimension - 1

    @property
    def parameters(self) -> Mapping[str, float]:
        """The parameters of the flow, and the value of the integral on the level."""
        return {**self.flow.parameters, **dict([self.level] if self.level else [])}

    def replace(self, **parameters: float) -> Self:
        level = self.level
        if level and level[0] in parameters:
            level = level[0], parameters.pop(level[0])
        return dataclasses.replace(self, flow=self.flow.replace(**parameters), level=level)

    @property
    def conservative(self) -> bool:
        return self.level is not None

    @property
    def _families(self) -> str:
        if self.level is not None:
            return ""
        return (
            "as where an energy is conserved; declare it in `integrals` of the flow, and give the "
            "Poincare map a `level` of it"
        )

    @cached_property
    def _level(self) -> Level | None:
        return self.level and Level(self.flow, self.section, *self.level)

    def _reach(self, states: Array) -> float:
        ways = (self._way(state)[1] for state in states)
        return float(
            max(abs(self.section.reduce(at)).max(initial=0.0) for way in ways for at in way)
        )

    def difference(self, a: Array, b: Array) -> Array:
        return self.section.difference(a, b)

    def coordinates(self, states: Array) -> Mapping[str, Array]:
        """Return the coordinates (n,) of states (n, d - 1), by name, with those of the flow."""
        full = np.array([self.section.lift(state) for state in states])
        return {**super().coordinates(states), **flow_coordinates(full)}

    def seen_of(self, other: Any, states: Array) -> Array:
        """Return the crossings (n, d - 1) of this section by a periodic orbit of another one."""
        if not isinstance(other, PoincareMap) or other.section is self.section:
            return states
        period = sum(other.return_time(state) for state in states)
        at, left, found = other._lifted(states[0]), period, list[Array]()
        # the orbit closes up to its error: a crossing at the start is found again at the end
        while left > _CLOSED * period:
            try:
                hit = self.flow.next_crossing(at, self.section, left + _CLOSED * period)
            except NoCrossing:
                break
            at, left = hit.state, left - hit.time
            found.append(self.section.reduce(at))
        return np.array(found).reshape(-1, self.dimension)

    def _path(self, state: Array, samples: int) -> tuple[Array, Array]:
        hit, at = self.crossing(state), self._lifted(state)
        times = np.linspace(0.0, hit.time, samples)
        rows = [at]
        for step in np.diff(times[:-1]).tolist():
            rows.append(self.flow.advance(rows[-1], step))
        return times, np.array([*rows, hit.state])

    def crossing(self, state: Array) -> Crossing:
        """Return time and full state, (d,), of the next crossing from a point of the section.

        Parameters
        ----------
        state : (d - 1,) array

        Raises
        ------
        NoCrossing
            When the flow does not cross the section within the time limit.
        TangentCrossing
            When the rate of the section's value at the state is below the least rate.
        Refused
            When the phase of a flow shrinks, and the section is a `Stroboscope`.
        ValueError
            When the state is not finite, or not of that shape; when the integral of the level
            changes along the motion.
        """
        start = self._lifted(finite_array("state", state, (self.dimension,)))
        if self.least_rate:
            rate = float(self.section.gradient(start) @ self.flow.velocity(start))
            if not self.section.direction * rate >= self.least_rate:
                raise TangentCrossing(
                    f"the flow must leave the section at a rate of {self.least_rate:.2g} or more; "
                    f"got {self.section.direction * rate:.2g} at {start.tolist()}"
                )
        if isinstance(self.section, Stroboscope):
            rate = float(self.flow.velocity(start)[-1])
            if rate < 0.0:  # the section's value would then rise half a period from the flashes
                raise Refused(
                    "the phase, the last coordinate, must grow for a Stroboscope; "
                    f"got the rate {rate:.6g} at {start.tolist()}"
                )
        hit = self.flow.next_crossing(start, self.section, self.time_limit)
        if self._level:
            self._level.require_constant(hit.state)
        return hit

    def orbit_factors(self, state: Array, following: Array) -> tuple[Array, Array]:
        """Return the `jacobian_factors`; on a level those of disturbances within the level.

        The first integral's gradient and the flow's direction, each with the multiplier 1, are
        split off: the factors are (n, d - 2, d - 2).
        """
        if self._level is None:
            return self.jacobian_factors(state)
        hit = self.crossing(state)
        start = self._onto(state)
        begin = self.section.lift_derivative(start) @ self._level.frame(start)
        # at the given state: at the computed crossing rounding may turn the frame
        end = self._level.frame(self._onto(following)).T
        return self._chained(state, hit, begin, end, self._across_on_level)

    def _begin(self, state: Array) -> Array:
        """Return the derivative, (d, d - 1), of the full state by the coordinates."""
        begin = self.section.lift_derivative(self._onto(state))
        return begin if self._level is None else begin @ self._level.derivative(state)

    def _across_on_level(self, state: Array) -> Array:
        """Return orthonormal directions, (d, d - 2), within the level across the flow."""
        assert self.level is not None
        gradient = self.flow.integral_gradient(self.level[0], state)
        both = np.column_stack([self.flow.velocity(state), gradient])
        return np.linalg.qr(both, mode="complete")[0][:, 2:]

    def _basis(self, state: Array) -> Array:
        return self._across(state)

    def _landed(self, hit: Crossing) -> Array:
        return self.section.reduce(hit.state)

    def _onto(self, state: Array) -> Array:
        return state if self._level is None else self._level.onto(state)[0]

    def _lifted(self, state: Array) -> Array:
        """Return the full state, (d,), from which the motion starts."""
        return self.section.lift(self._onto(state))

    def parameter_derivative(self, state: Array, name: str) -> Array:
        """Return the derivative, (d - 1,), by a parameter, with the change of the crossing time.

        It is as accurate as the flow's derivatives; the section does not depend on the parameter.

        Raises
        ------
        TangentCrossing, NoCrossing
            As for `jacobian_factors`.
        ValueError
            As the call itself; and when there is no such parameter.
        """
        self.value_of(name)
        hit, start = self.crossing(state), self._lifted(state)
        change = np.zeros(self.flow.dimension)
        if name in self.flow.parameters:
            change = self.flow.parameter_derivative(start, hit.time, name)
        if self._level is not None:
            onto = self.section.lift_derivative(self._onto(state))
            moved = onto @ self._level.by_parameter(state, name)
            change = change + self.flow.derivative(start, hit.time) @ moved
        return self._after(hit, change[:, None])[:, 0]

    def _after(self, hit: Crossing, change: Array) -> Array:
        """Return the changes (d - 1, k) on the section for changes (d, k) at a fixed time."""
        velocity = self.flow.velocity(hit.state)
        gradient = self.section.gradient(hit.state)
        rate = float(gradient @ velocity)
        if rate == 0.0:
            raise TangentCrossing(f"the flow is tangent to the section at {hit.state.tolist()}")
        # Parker and Chua, appendix D: the hit time moves by -(gradient . change) / rate
        on_section = change - np.outer(velocity, gradient @ change) / rate
        return np.asarray(self.section.reduce_derivative(hit.state) @ on_section)
