"""What maps are to equations of orbits: smooth functions from states to states."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np

from dynkit.core.differences import numerical_derivative, parameter_difference
from dynkit.core.no_motion import Diverged, replaced
from dynkit.core.parameters import Family
from dynkit.core.stretching import Stretching, product_with_error, stretched
from dynkit.core.validation import (
    Array,
    finite_array,
    finite_scalar,
    non_negative_integer,
    within_memory,
)


class SmoothMap(Family, ABC):
    """A smooth function from states to states, its derivatives and its iterates.

    The first half of the contract of `dynkit.Map`, of which every system is a subclass: what
    periodic orbits, attractors and their labels need of a map.
    """

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

        Unless a subclass gives it, or its factors, it is found from differences of next states, by
        `dynkit.core.differences.numerical_derivative`; `jacobian_factors` has its error.

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

        Multipliers and Lyapunov exponents come from the factors. The factors of a map whose state
        moves on the way belong to parts of the way, short enough that no part shrinks a disturbance
        to the size of the errors of another disturbance. By default there is one factor.

        Parameters
        ----------
        state : (d,) array

        Returns
        -------
        factors : (n, d, d) array
            In the order of time: the jacobian is ``factors[n - 1] @ ... @ factors[0]``.
        errors : (n,) array
            Estimate of the error of an entry of each factor: by default the `accuracy` times the
            norm of the jacobian, or what the differences claim where no jacobian is given.

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
    def _by_differences(self) -> bool:
        """Whether neither jacobian nor factors are given: differences may err beyond `accuracy`."""
        given = type(self).jacobian, type(self).jacobian_factors
        return given == (SmoothMap.jacobian, SmoothMap.jacobian_factors)

    def _differences(self, state: Array) -> tuple[Array, Array]:
        """The jacobian, (d, d), by differences, and its error."""
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

    def parameter_derivative(self, state: Array, name: str) -> Array:
        """Return the derivative of the next state with respect to a parameter.

        Unless a subclass knows better it is found from differences of maps that `replace` makes, as
        `dynkit.core.differences.parameter_difference` does: right to some 1e-11, relative, for a
        call that is wrong by rounding, and to 1e-9 for an `accuracy` of 1e-11, when the map
        changes over changes of the parameter by its own size, or by one.

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
            it is not finite.
        """
        value = finite_scalar(name, self.value_of(name))
        return parameter_difference(
            lambda changed: replaced(self, **{name: changed})(state),
            value,
            accuracy=self.accuracy,
            difference=self.difference,
        )

    @property
    def observables(self) -> Sequence[str]:
        """Names of what can be kept of a state, the first by default: its coordinates."""
        return tuple(f"state[{i}]" for i in range(self.dimension))

    def coordinates(self, states: Array) -> Mapping[str, Array]:
        """Return the coordinates (n,) of states (n, d), by name: what a diagram of orbits draws."""
        return {f"state[{i}]": column for i, column in enumerate(states.T)}

    def seen_of(self, other: Any, states: Array) -> Array:  # noqa: ARG002
        """Return states (n, d) of a periodic orbit of another map as this one sees the same motion.

        They are its states, but where maps see motions in different places, as Poincare maps do.
        There may be none.
        """
        return states

    @property
    def accuracy(self) -> float:
        """How wrong one call may be, relative to the size of the state: one rounding, 2^-52."""
        return 2.0**-52

    def stretching(self, state: Array, n: int) -> Stretching:
        """Return how the next n iterates stretch a frame, which starts as the unit vectors.

        Its directions may belong to other coordinates of the same states: what holds on average
        over many iterates, the Lyapunov exponents, does not depend on the coordinates.

        Parameters
        ----------
        state : (d,) array
        n : int
            How many iterates; zero or more.

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
        frame = np.eye(self.dimension)
        logs, errors = np.empty((2, count, self.dimension))
        times = np.empty(count)
        for i in range(count):
            here, factors, times[i] = self._followed(here)
            frame, logs[i], errors[i] = stretched(*factors, frame)
        return Stretching(logs, errors, None if np.isnan(times).any() else times, here)

    def _followed(self, state: Array) -> tuple[Array, tuple[Array, Array], float]:
        """The next state, the factors of the jacobian, and the time; NaN for none."""
        return self.image(state), self.jacobian_factors(state), np.nan

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
            The first row is the state itself, row i + 1 the map of row i.

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
                states[i] = self(states[i - 1])
                refuse_infinite(states[i], i)

    @final
    def image(self, state: Array) -> Array:
        """Return the next state, (d,), which is finite.

        Raises
        ------
        Diverged
            When the call returns numbers that are not finite.
        """
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = np.asarray(self(state), dtype=np.float64)
        refuse_infinite(found, 1)
        return found


def checked_map(system: object, kind: type = SmoothMap) -> Any:
    """Return the system, which is a map of this kind.

    Raises
    ------
    ValueError
        When the system is none.
    """
    if isinstance(system, kind):
        return system
    if isinstance(system, type):
        name = system.__name__
        raise ValueError(f"system must be an instance, such as {name}(...); got the class {name}")
    raise ValueError(f"system must be a Map; got {system!r}")


def generic_direction(dimension: int) -> Array:
    """Return a direction, (d,), of length one without symmetry, always the same.

    It lies in no subspace that a symmetric system is likely to keep: square roots of different
    integers.
    """
    roots = np.sqrt(np.arange(2.0, 2.0 + dimension))
    return np.asarray(roots / np.linalg.norm(roots))


def refuse_infinite(state: Array, iterates: int) -> None:
    """Refuse a state after some iterates that is not finite.

    Raises
    ------
    Diverged
        Naming the first coordinate that is infinite, or not a number.
    """
    # the sum of finite numbers may be infinite too: then each is looked at
    if math.isfinite(sum(state.tolist())) or np.isfinite(state).all():
        return
    i = int(np.argmin(np.isfinite(state)))
    after = f"{iterates} iterate{'s' if iterates > 1 else ''}"
    raise Diverged(f"the motion runs away: state[{i}] is {float(state[i])} after {after}")
