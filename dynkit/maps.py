"""Maps: dynamical systems in discrete time."""

import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.differences import parameter_difference
from dynkit.family import Family
from dynkit.no_motion import Diverged, replaced
from dynkit.stretching import Stretching, stretched
from dynkit.validation import (
    Array,
    finite_array,
    finite_scalar,
    non_negative_integer,
    positive_integer,
    within_memory,
)

if TYPE_CHECKING:
    from dynkit.attractors import Attractor
    from dynkit.map_problems import StatesProblem


class Map(Family, ABC):
    """A dynamical system in discrete time: a smooth function from states to states.

    A subclass owes:

    1. `dimension`, the number d of the state's coordinates.
    2. ``__call__(state)``, the next state. The state is (d,) and so is the result, a new array. The
       call changes nothing: not its argument, and not the map. A state that is not finite, or not
       of that shape, is refused with ValueError: `dynkit.validation.finite_array` does it. Where
       the motion runs away, the call returns numbers that are not finite. Where there is no next
       state for another reason, it raises a `NoMotion`: `NoCrossing`, or `Refused` for a finite
       state outside of the map's range. Every other exception is taken for a fault in the map: no
       sweep, basin or orbit search catches it.
    3. ``jacobian(state)``, the exact (d, d) derivative of the call: row i belongs to coordinate i
       of the result.

    and may offer:

    4. ``difference(a, b)``, when coordinates are angles: a - b, wrapped to the shortest way. Its
       arguments are (..., d) and broadcast; it is antisymmetric, and zero where a equals b.
    5. ``parameters`` and ``replace``, when it belongs to a family of maps and is no dataclass; see
       `Family`.
    6. `accuracy`, when a call is wrong by more than rounding.
    7. ``parameter_derivative(state, name)``, the exact (d,) derivative of the call by a parameter;
       otherwise it is found by differences.
    8. ``jacobian_factors(state)``, when the derivative is a product along the way, whose small
       eigenvalues would be lost in the product itself.
    9. ``stretching(state, n)``, when it knows a faster way to what Lyapunov exponents are made of.

    What sweeps, parameter planes and basins use has a default, and belongs together where the
    motion starts from states of another kind than the map's own, as impact oscillators do:

    10. `observables`, the names of what can be kept of a state, and ``attractor(start=...,
        transient=..., keep=...)``, an `Attractor` that knows them.
    11. `default_start`, where a motion starts when no start is given; `start_size` and
        ``state_from(numbers)``, the start that plain numbers make.
    12. ``pack_state(state)``, one array of finite floats, of one length at all values of the
        parameters, and ``unpack_state(packed)``, the same state again, from which `attractor` gives
        the same bits. A state from another value of a parameter is made one of this map first.
    13. ``displaced(motion, size)``, the last state of a motion, moved out of all symmetries.

    Stores and executors ask for more: the fields are numbers, strings, arrays, or tuples of them
    (`identity`), the class can be imported from a file, and instances can be pickled.

    Instances are immutable. `dynkit.testing.check_map` runs any subclass through this contract.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Logistic(Map):
    ...     rate: float
    ...
    ...     @property
    ...     def dimension(self):
    ...         return 1
    ...
    ...     def __call__(self, state):
    ...         x = finite_array("state", state, (1,))
    ...         return self.rate * x * (1.0 - x)
    ...
    ...     def jacobian(self, state):
    ...         (x,) = finite_array("state", state, (1,))
    ...         return np.array([[self.rate * (1.0 - 2.0 * x)]])
    >>> logistic = Logistic(rate=4.0)
    >>> logistic.iterate([0.25], 2)
    array([[0.25],
           [0.75],
           [0.75]])
    >>> logistic.replace(rate=2.0).parameters
    {'rate': 2.0}
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

    @abstractmethod
    def jacobian(self, state: Array) -> Array:
        """Return the derivative of the next state with respect to the state.

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
        """

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
            norm of the jacobian.

        Raises
        ------
        ValueError
            When the state is not finite, or not of that shape.
        """
        factor = self.jacobian(state)
        return factor[None], np.array([self.accuracy * np.linalg.norm(factor)])

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
        `dynkit.differences.parameter_difference` does: right to some 1e-11, relative, for a call
        that is wrong by rounding, and to 1e-9 for an `accuracy` of 1e-11, when the map changes over
        changes of the parameter by its own size, or by one.

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

    # --- motions after a transient ----------------------------------------------------------------

    @property
    def observables(self) -> Sequence[str]:
        """Names of what can be kept of a state, the first by default: its coordinates."""
        return tuple(f"state[{i}]" for i in range(self.dimension))

    @property
    def identity(self) -> Mapping[str, object]:
        """Everything that the motion depends on, by name: a store of another is refused."""
        instance: Any = self  # is_dataclass tells the type checker too much
        if not dataclasses.is_dataclass(instance):
            return self.parameters
        return {entry.name: getattr(instance, entry.name) for entry in dataclasses.fields(instance)}

    def attractor(self, *, start: Any = None, transient: int = 700, keep: int = 100) -> "Attractor":
        """Return what is left of the motion from a start after a number of states.

        Parameters
        ----------
        start : (d,) array
        transient, keep : int
            How many states to skip, zero or more, and how many to keep, one or more.

        Returns
        -------
        MapAttractor

        Raises
        ------
        ValueError
            When no start is given, it is not finite or not of that shape, or a number is no count.
        NoMotion
            When the motion runs away (`Diverged`), or has no next state.

        Examples
        --------
        >>> from dynkit.systems import Logistic
        >>> print(Logistic(rate=3.2).attractor(start=[0.3]).label)
        P(2)
        """
        from dynkit.attractors import MapAttractor

        if start is None:
            raise ValueError(f"start must be a state of the map, ({self.dimension},); got None")
        return MapAttractor(self, start, transient, positive_integer("keep", keep))

    @property
    def default_start(self) -> Any:
        """Where a motion starts when no start is given; None where one must be given."""
        return None

    @property
    def start_size(self) -> int:
        """How many numbers `state_from` takes."""
        return self.dimension

    def state_from(self, numbers: Array) -> Any:
        """Return the start that plain numbers, (`start_size`,), make.

        Raises
        ------
        ValueError
            When they are not finite, or not of that shape.
        Refused
            When no state has them.
        """
        return finite_array("numbers", numbers, (self.start_size,))

    def pack_state(self, state: Any) -> Array:
        """Return a start as one array of finite numbers."""
        return finite_array("start", state, (self.dimension,))

    def unpack_state(self, packed: Array) -> Any:
        """Return the start that `pack_state` turned into numbers."""
        return packed

    def displaced(self, motion: Any, size: float) -> Any:
        """Return the last state of a motion, moved by this part of the motion's size.

        The direction is always the same, and lies in no subspace that a symmetric map keeps.

        Parameters
        ----------
        motion : Attractor
            Of this map, with one state at least.
        size : float
        """
        states: Array = motion.states
        # a coordinate that is zero throughout has no size of its own; nor has a state that is zero
        largest = float(abs(states).max()) or 1.0
        return np.asarray(states[-1] + size * largest * generic_direction(self.dimension))

    # --- orbits and exponents ---------------------------------------------------------------------

    def _orbit_problem(self, states: Array) -> "StatesProblem | None":  # noqa: ARG002
        """Equations of periodic orbits near one with these states (n, d); None: `MapProblem`."""
        return None

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
        return self.next_state(state), self.jacobian_factors(state), np.nan

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
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for i in range(count):
                states[i + 1] = self(states[i])
                refuse_infinite(states[i + 1], i + 1)
        return states

    @final
    def next_state(self, state: Array) -> Array:
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


def checked_map(system: object) -> Map:
    """Return the system, which is a map.

    Raises
    ------
    ValueError
        When it is none.
    """
    if isinstance(system, Map):
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
