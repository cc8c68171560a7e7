"""Smooth maps: the part of a `Map` that periodic orbits and their multipliers need."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, final

import numpy as np

from dynkit.core.differences import by_parameter, numerical_derivative
from dynkit.core.no_motion import Diverged
from dynkit.core.parameters import Family
from dynkit.core.stretching import Stretching
from dynkit.core.validation import (
    Array,
    all_finite,
    finite_array,
    non_negative_integer,
    returned,
    within_memory,
)


class SmoothMap(Family, ABC):
    """A smooth function from states to states, its derivatives and its iterates.

    This is the first half of the contract of `dynkit.Map`: the part that periodic orbits,
    attractors and their labels use.
    """

    _following: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "jacobian": ("__call__", "jacobian_factors"),
        "jacobian_factors": ("__call__", "jacobian"),
        "parameter_derivative": ("__call__",),
        "iterate_into": ("__call__",),
        "stretching": ("__call__", "jacobian", "jacobian_factors", "return_time"),
        **dict.fromkeys(("_growth", "_followed"), ("__call__", "jacobian", "jacobian_factors")),
    }

    @property
    @abstractmethod
    def dimension(self) -> int:
        """The number d of the state's coordinates."""

    @abstractmethod
    def __call__(self, state: Array) -> Array:
        """Return the next state.

        Parameters
        ----------
        state : (d,) array

        Returns
        -------
        (d,) array

        Raises
        ------
        ValueError
            When the state is not finite, or not of that shape.
        """

    def jacobian(self, state: Array) -> Array:
        """Return the derivative of the next state with respect to the state.

        A subclass may define it, or `jacobian_factors`. Otherwise it is computed from differences
        of next states (`dynkit.core.differences.numerical_derivative`); `jacobian_factors` returns
        the error.

        Parameters
        ----------
        state : (d,) array

        Returns
        -------
        (d, d) array

        Raises
        ------
        ValueError
            When the state is not finite, or not of that shape.
        NoMotion
            When there is no next state, or no derivative.

        Examples
        --------
        >>> from dynkit import Map
        >>> class Square(Map):
        ...     dimension = 1
        ...
        ...     def __call__(self, state):
        ...         return state**2
        >>> Square().jacobian([3.0])
        array([[6.]])
        >>> _, errors = Square().jacobian_factors([3.0])
        >>> bool(errors[0] < 1e-10)
        True
        """
        if type(self).jacobian_factors is SmoothMap.jacobian_factors:
            return self._differences(state)[0]
        return product_with_error(*self.jacobian_factors(state))[0]

    def jacobian_factors(self, state: Array) -> tuple[Array, Array]:
        """Return matrices whose product is the jacobian, and the errors of their entries.

        Multipliers and Lyapunov exponents are computed from the factors. A Poincare map has one
        factor for each part of the return: the parts are so short that no disturbance shrinks to
        the size of the errors of another disturbance. By default there is one factor.

        Parameters
        ----------
        state : (d,) array

        Returns
        -------
        factors : (n, d, d) array
            In the order of time: the jacobian is ``factors[n - 1] @ ... @ factors[0]``.
        errors : (n,) array
            Estimate of the error of an entry of each factor. By default it is the `accuracy` times
            the norm of the jacobian, or the error of the differences where no jacobian is defined.

        Raises
        ------
        ValueError, NoMotion
            As `jacobian`.
        """
        if type(self).jacobian is SmoothMap.jacobian:
            factor, error = self._differences(state)
            return factor[None], np.array([error.max()])
        factor = self.jacobian(state)
        return factor[None], np.array([self.accuracy * np.linalg.norm(factor)])

    @property
    def conservative(self) -> bool:
        """Whether it is the map of a flow on a level of a first integral; False by default."""
        return False

    @property
    def _framed(self) -> bool:
        """Whether the `orbit_factors` are those of fewer directions than the `jacobian_factors`."""
        return self.conservative

    @property
    def _families(self) -> str:
        """Text for the user about orbits that form families; empty where none are expected."""
        return ""

    def orbit_factors(
        self,
        state: Array,
        following: Array,  # noqa: ARG002 (a map without a level needs no frame there)
    ) -> tuple[Array, Array]:
        """Return matrices whose product along an orbit has its multipliers, and errors of entries.

        By default they are the `jacobian_factors`. On a level of a first integral they have the
        dimension of the level. They lead from a frame of directions at the state to a frame at the
        next state of the orbit.
        """
        return self.jacobian_factors(state)

    @property
    def _by_differences(self) -> bool:
        """Whether the jacobian comes from differences, whose error may exceed the `accuracy`."""
        given = type(self).jacobian, type(self).jacobian_factors
        return given == (SmoothMap.jacobian, SmoothMap.jacobian_factors)

    def _differences(self, state: Array) -> tuple[Array, Array]:
        """Return the jacobian, (d, d), by differences, and its error, (d, d)."""
        here = finite_array("state", state, (self.dimension,))
        return numerical_derivative(
            self.image, here, accuracy=self.accuracy, difference=self.difference
        )

    def difference(self, a: Array, b: Array) -> Array:
        """Return a - b; a map with angles wraps them to the shortest way.

        Parameters
        ----------
        a, b : (..., d) arrays
            States, or rows of states, that broadcast.

        Returns
        -------
        (..., d) array
        """
        return np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64)

    def without_shift(self, states: Array) -> Array:
        """Return states (..., d) without the shift that has no effect; by default the same.

        States that differ by such a shift alone count as one: in labels, basins, sweeps and where
        orbits are compared. A machine that progresses has such a shift, its place on the ground.
        """
        return states

    def parameter_derivative(self, state: Array, name: str) -> Array:
        """Return the derivative of the next state with respect to a parameter.

        A subclass may define it. Otherwise it is computed from differences of maps that `replace`
        returns (`dynkit.core.differences.parameter_difference`). The relative error is about 1e-11
        when calls have rounding errors only, and 1e-9 for an `accuracy` of 1e-11. This requires
        that the map varies over changes of the parameter by its own size, or by one.

        Parameters
        ----------
        state : (d,) array
        name : str
            One of `parameters`.

        Returns
        -------
        (d,) array

        Raises
        ------
        ValueError
            When the state is not finite, or not of that shape; when there is no such parameter, or
            its value is not finite.
        """
        how = {"accuracy": self.accuracy, "difference": self.difference}
        return by_parameter(self, name, lambda system: system(state), **how)

    @property
    def observables(self) -> Sequence[str]:
        """Names of the observables of a state; the first is the default. Here: its coordinates."""
        return tuple(f"state[{i}]" for i in range(self.dimension))

    def coordinates(self, states: Array) -> Mapping[str, Array]:
        """Return the coordinates (n,) of states (n, d), by name; diagrams of orbits draw them."""
        return {f"state[{i}]": column for i, column in enumerate(states.T)}

    @property
    def _section_axes(self) -> tuple[str, str] | None:
        """Names of the observables that pages of a section show; None for the coordinates."""
        return None

    def return_time(self, state: Array) -> float:  # noqa: ARG002
        """Return the time from a state, (d,), to the next: by default one, the iterate.

        For a section of a flow it is the time of the flow.
        """
        return 1.0

    def _path(self, state: Array, samples: int) -> tuple[Array, Array] | None:  # noqa: ARG002
        """Return times (m,) and states (m, k) of the flow up to the image; None for a map.

        m is the number of samples asked for, or one less.
        """
        return None

    def seen_of(self, other: Any, states: Array) -> Array:  # noqa: ARG002
        """Return the states (k, d) on this map of a periodic orbit of another map, states (n, d).

        By default both are the same. Poincare maps return the crossings of their section by the
        orbit; there may be none.
        """
        return states

    @property
    def accuracy(self) -> float:
        """Error of one call, relative to the size of the state: by default one rounding, 2^-52."""
        return 2.0**-52

    def call_errors(self, states: Array) -> Array:
        """Return errors (n,) of the calls of states (n, d): by default the `accuracy` times a size.

        The size is the largest coordinate of all these states.
        """
        return np.full(len(states), self.accuracy * float(abs(states).max(initial=0.0)))

    def _reach(self, states: Array) -> float:  # noqa: ARG002
        """Return the largest coordinate on the paths of a flow from states (n, d); 0 for a map."""
        return 0.0

    def stretching(self, state: Any, n: int, frame: Array | None = None) -> Stretching:
        """Return how the next n iterates stretch a frame of directions.

        A subclass may use a frame in other coordinates of the same states: the averages over many
        iterates, the Lyapunov exponents, do not depend on the coordinates.

        Parameters
        ----------
        state : (d,) array
            Or the `final` of an earlier stretching.
        n : int
            How many iterates; zero or more.
        frame : (d, k) array, optional
            The `frame` of an earlier stretching, which is continued; by default the unit vectors.

        Raises
        ------
        ValueError
            When the state is not finite or not of that shape, or n is not a count.
        NoMotion
            When there is no next state, or it is not finite.

        References
        ----------
        G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Lyapunov characteristic exponents for
        smooth dynamical systems, Meccanica 15 (1980) 9-30. J.-P. Eckmann, D. Ruelle, Reviews of
        Modern Physics 57 (1985) 617-656, section V.C (QR).

        Examples
        --------
        >>> from dynkit.systems import Henon
        >>> logs = Henon(b=0.3).stretching([0.1, 0.1], 50).logs
        >>> bool(abs(logs.sum(axis=1) - np.log(0.3)).max() < 1e-13)
        True
        """
        count = non_negative_integer("n", n)
        here = finite_array("state", state, (self.dimension,))
        frame = np.array(self._frame(here) if frame is None else frame, order="C")
        logs, errors = np.empty((2, count, frame.shape[1]))
        times = np.empty(count)
        done = 0
        while done < count:
            here, found, lasts = self._followed(here, count - done)
            now = slice(done, done + len(found))
            logs[now], errors[now] = stretched(found, frame)
            times[now] = lasts
            done = now.stop
        return Stretching(logs, errors, None if np.isnan(times).any() else times, here, frame)

    def _growth(self, state: Array, n: int) -> Array:
        """Return the logarithms (n,) by which each of the next n iterates stretches a direction.

        The first direction is generic. All are -inf where it becomes zero, as on a superstable
        orbit.
        """
        direction, logs = generic_direction(state.size), np.empty(n)
        for i in range(n):
            state, direction = self._pushed(state, direction)
            length = float(np.linalg.norm(direction))
            if length == 0.0:
                return np.full(n, -np.inf)
            logs[i] = np.log(length)
            direction = direction / length
        return logs

    def _pushed(self, state: Array, direction: Array) -> tuple[Array, Array]:
        """Return the next state, (d,), and the product, (d,), of the jacobian and a direction."""
        return self.image(state), self.jacobian(state) @ direction

    def _frame(self, state: Array) -> Array:  # noqa: ARG002
        """Return the first frame of directions, (d, k), without those that have no exponent."""
        return np.eye(self.dimension)

    def _followed(
        self,
        state: Array,
        most: int,  # noqa: ARG002
    ) -> tuple[Array, list[tuple[Any, ...]], Sequence[float]]:
        """Return the state after up to `most` iterates, and factors and time of each iterate.

        The factors are the `jacobian_factors`: matrices and errors. A third entry may follow, the
        number of directions that are known to be lost in each factor. A time is NaN for a map
        without times.
        """
        untimed = type(self).return_time is SmoothMap.return_time
        time = np.nan if untimed else self.return_time(state)
        return self.image(state), [self.jacobian_factors(state)], [time]

    @final
    def iterate(self, state: Array, n: int) -> Array:
        """Return a state and its next n iterates.

        Parameters
        ----------
        state : (d,) array
        n : int
            How many iterates; zero or more.

        Returns
        -------
        (n + 1, d) array
            The first row is the state itself; row i + 1 is the image of row i.

        Raises
        ------
        ValueError
            When the state is not finite or not of that shape, or n is not a count.
        Diverged
            When an iterate is not finite.
        NoMotion
            When there is no next state for another reason.
        """
        count = non_negative_integer("n", n)
        within_memory("n", count, 8.0 * count * self.dimension)
        states = np.empty((count + 1, self.dimension))
        states[0] = finite_array("state", state, (self.dimension,))
        self.iterate_into(states)
        return states

    def iterate_into(self, states: Array) -> None:
        """Fill the rows of states (n + 1, d), from the second on, with the iterates of the first.

        Raises
        ------
        Diverged
            When an iterate is not finite.
        NoMotion
            When there is no next state for another reason.
        """
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for i in range(1, len(states)):
                states[i] = found = returned(self, self(states[i - 1]), states.shape[1])
                if not all_finite(found):
                    refuse_infinite(found, i)

    @final
    def image(self, state: Array) -> Array:
        """Return the next state, (d,), after a check that it is finite.

        Raises
        ------
        ValueError
            When the call does not return an array of that shape.
        Diverged
            When the call returns numbers that are not finite.
        """
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = returned(self, self(state), self.dimension)
        refuse_infinite(found, 1)
        return found


def stretched(steps: Sequence[Sequence[Any]], frame: Array) -> tuple[Array, Array]:
    """Carry a frame (d, k) by n steps, in place; return the logs (n, k) of its growth and errors.

    A step has factors (m, d, d) and errors (m,) of their entries. It may also have the number of
    directions that are known to be lost in each factor: see `stretching_kernels.carry`.
    """
    from dynkit.core.stretching_kernels import decompose

    factors, off = (np.concatenate([step[i] for step in steps]) for i in range(2))
    counts = [len(step[0]) for step in steps]
    lost = np.repeat([step[2] if len(step) > 2 else 0 for step in steps], counts)
    logs, errors = np.empty((2, len(factors), frame.shape[1]))
    decompose(np.ascontiguousarray(factors), off, lost, frame, logs, errors)
    first = np.cumsum([0, *counts[:-1]])
    logs, errors = (np.add.reduceat(each, first, axis=0) for each in (logs, errors))
    # a length of zero is exact
    errors[np.isneginf(logs)] = 0.0
    return logs, errors


def product_with_error(factors: Array, errors: Array) -> tuple[Array, float]:
    """Return the product A_n ... A_1 of factors (n, d, d), and a bound of the error of an entry.

    `errors` (n,) bound the errors of the entries of each factor. The bound is of first order in
    them and leaves out rounding.
    """
    product, error = factors[0], np.full(factors[0].shape, errors[0])
    for factor, off in zip(factors[1:], errors[1:], strict=True):
        # bound each entry: with norms of factors the units of different coordinates would mix
        error = abs(factor) @ error + off * abs(product).sum(axis=0)
        product = factor @ product
    return product, float(error.max())


def checked_map(system: object, kind: type = SmoothMap, what: str = "a Map") -> Any:
    """Return the system after a check that it is an instance of a kind, by default a map.

    Raises
    ------
    ValueError
        When the system is not an instance of the kind.
    """
    if isinstance(system, kind):
        return system
    if isinstance(system, type):
        name = system.__name__
        raise ValueError(f"system must be an instance, such as {name}(...); got the class {name}")
    raise ValueError(f"system must be {what}; got {system!r}")


def generic_direction(dimension: int) -> Array:
    """Return a fixed unit vector, (d,), without symmetry.

    Its coordinates are proportional to the square roots of successive integers, so it lies in no
    subspace that a symmetric system is likely to preserve.
    """
    roots = np.sqrt(np.arange(2.0, 2.0 + dimension))
    return np.asarray(roots / np.linalg.norm(roots))


def proper_divisors(n: int) -> list[int]:
    """Return the proper divisors of n: the possible least periods of an orbit of n iterates."""
    return [k for k in range(1, n // 2 + 1) if n % k == 0]


def refuse_infinite(state: Array, iterates: int) -> None:
    """Raise `Diverged` when the state after some iterates is not finite.

    Raises
    ------
    Diverged
        The message names the first coordinate that is infinite or NaN.
    """
    if all_finite(state):
        return
    i = int(np.argmin(np.isfinite(state)))
    after = f"{iterates} iterate{'s' if iterates > 1 else ''}"
    raise Diverged(f"the motion runs away: state[{i}] is {float(state[i])} after {after}")
