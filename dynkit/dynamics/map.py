"""Maps: dynamical systems in discrete time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoCrossing
from dynkit.core.reprs import system_repr
from dynkit.core.smooth_map import SmoothMap, generic_direction
from dynkit.core.validation import Array, finite_array, non_negative_integer, positive_integer
from dynkit.dynamics.attractor import Attractor, MapAttractor
from dynkit.orbits.map_orbit import MapOrbit
from dynkit.orbits.map_problem import MapProblem


@final
@dataclass(frozen=True, eq=False, repr=False)
class Stream:
    """The states of a motion after its transient, in successive blocks; made by `Map.stream`.

    Each block is an `Attractor` that continues the one before. The states are, bit for bit, those
    of one attractor of all states. For machines with soft stops, friction or sliders they are the
    same to rounding, because each block begins with a change of coordinates. Each iteration begins
    at the start.

    Parameters
    ----------
    system : Map
    start : start or None
        As for `Map.attractor`.
    transient, keep, block : int
        Numbers of states to skip, to keep, and in a block.

    Raises
    ------
    ValueError
        When a number is not a count.
    """

    system: Any
    start: Any
    transient: int
    keep: int
    block: int

    def __post_init__(self) -> None:
        non_negative_integer("transient", self.transient)
        positive_integer("keep", self.keep)
        positive_integer("block", self.block)

    def __iter__(self) -> Iterator[Attractor]:
        return self.blocks_after(0)

    def blocks_after(self, done: int, last: Any = None) -> Iterator[Attractor]:
        """Yield the blocks after a number of states, from the `final` of the last block.

        Raises
        ------
        ValueError
            When the start is refused.
        NoMotion
            When the motion has no next state; the states before have been yielded.
        """
        count = done
        while count < self.keep:
            size = min(self.block - count % self.block, self.keep - count)
            if count:
                part = self.system.following(last, size)
            else:
                part = self.system.attractor(start=self.start, transient=self.transient, keep=size)
            if part._kept:
                yield part
            if part._kept < size:
                raise NoCrossing(f"there is no next state: {part.ending.value}")
            count, last = count + size, part.final

    @property
    def identity(self) -> Mapping[str, object]:
        """Everything that determines the states of all blocks."""
        start = self.system.default_start if self.start is None else self.start
        packed = tuple(self.system.pack_state(start).tolist())
        own: dict[str, object] = {"start": packed, "transient": self.transient}
        own |= {"block": self.block}
        return {**self.system.identity, **{f"stream.{name}": own[name] for name in own}}

    def __repr__(self) -> str:
        size = f"{self.keep} states after {self.transient}, in blocks of {self.block}"
        return f"<Stream of {system_repr(self.system, 6)}: {size}>"


Arrivals: TypeAlias = tuple[NDArray[np.intp], Array, Cost]
"""Numbers of orbits (k,), states (k, d), and counted work: see `Map.arrivals`."""


class Map(SmoothMap):
    """A dynamical system in discrete time: a smooth function from states to states.

    A subclass must implement:

    1. `dimension`, the number d of the state's coordinates.
    2. ``__call__(state)``, the next state, a new (d,) array, from a state (d,). The call changes
       neither its argument nor the map. It raises ValueError for a state that is not finite, or not
       of that shape (`dynkit.core.validation.finite_array` does so). Where the motion diverges, the
       call returns numbers that are not finite. Where there is no next state for another reason, it
       raises a `NoMotion`: `NoCrossing`, or `Refused` for a finite state outside the map's domain.
       Every other exception is a fault of the map: no sweep, basin or orbit search catches it.

    A subclass may implement:

    3. ``jacobian(state)``, the exact (d, d) derivative of the call: row i belongs to coordinate i
       of the result. Otherwise it is computed from differences, with 5 to 20 calls for each
       coordinate, and errors of multipliers, exponents and bifurcations include their error.
    4. ``difference(a, b)``, when coordinates are angles: a - b, wrapped to the shortest way. Its
       arguments are (..., d) and broadcast; it is antisymmetric, and zero where a equals b. The
       call returns angles within one turn: tolerances and errors are relative to sizes of states.
    5. ``parameters`` and ``replace``, when the class has parameters but is not a dataclass; see
       `Family`.
    6. `accuracy`, when a call has errors beyond rounding, and ``call_errors(states)``, when these
       are known state by state.
    7. ``parameter_derivative(state, name)``, the exact (d,) derivative of the call by a parameter;
       otherwise it is computed from differences.
    8. ``jacobian_factors(state)``, when the derivative is a product of factors and the product
       would lose its small eigenvalues; `jacobian` multiplies them.
    9. ``iterate_into(states)`` and ``stretching(state, n, frame)``, when there is a faster
       computation of many iterates, or for Lyapunov exponents.

    Sweeps, parameter planes and basins use the following, which have defaults. A map whose motions
    start from more than a state of the map, such as an impact oscillator, implements all of them:

    10. `observables`, the names of a state's observables, and ``attractor(start=...,
        transient=..., keep=...)``, an `Attractor` with these observables.
    11. `default_start`, the start if none is given; `start_size`, `start_names` and
        ``state_from(numbers)``, the start with these numbers.
    12. ``pack_state(state)``, an array of finite floats whose length is the same at all values of
        the parameters, and ``unpack_state(packed)``, the same state again, from which `attractor`
        gives the same bits. A state from other values of the parameters is first converted to a
        state of this map.
    13. ``following(final, keep)``, the next states after the `final` of an attractor, bit for bit
        those of a longer attractor; to rounding, where a machine has soft stops, friction or
        sliders.
    14. ``displaced(motion, size)``, the last state of a motion, displaced in a direction without
        symmetry.

    A map may implement, for basins of very many starts:

    15. ``arrivals(starts, orbits, transient, near)``, when there is a faster simulation of many
        starts that ends at known periodic orbits.

    A subclass of a map that overrides ``__call__`` does not inherit `jacobian`,
    `parameter_derivative` and other methods that belong to the overridden call: they are computed
    by differences, unless the subclass defines them, too. If the inherited jacobian is also that of
    the new call, the subclass declares ``jacobian = Base.jacobian``. In the same way the
    derivatives of a `Flow` belong to its velocity.

    Stores and executors also require that the fields (`identity`) are numbers, strings, arrays,
    flows, sections, or tuples of them. The class must be importable from a file, and instances must
    be picklable. A store can be continued only with the same code of the class in the same version
    of Python: it is refused if a method has changed, or a function or constant that a method uses
    by name. Constants are compared if they are numbers, texts, arrays or tuples, and not if they
    are lists, dictionaries or other objects.

    Instances are immutable. `dynkit.testing.check_map` tests a subclass against this contract.

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
    >>> logistic = Logistic(rate=4.0)
    >>> logistic.iterate([0.25], 2)
    array([[0.25],
           [0.75],
           [0.75]])
    >>> logistic.replace(rate=2.0).parameters
    {'rate': 2.0}
    """

    _closed: ClassVar[frozenset[str]] = frozenset({"orbit_factors", "seen_of"})

    @property
    def _solutions(self) -> tuple[type, ...]:
        """Classes of its periodic orbits and of their equations, as stores hold them."""
        return MapOrbit, MapProblem

    def attractor(self, *, start: Any = None, transient: int = 700, keep: int = 100) -> Attractor:
        """Return the motion from a start after its transient.

        Parameters
        ----------
        start : (d,) array
        transient, keep : int
            Number of states to skip, zero or more, and to keep, one or more.

        Returns
        -------
        MapAttractor

        Raises
        ------
        ValueError
            When no start is given, the start is not finite or not of that shape, or transient or
            keep is not a count.
        NoMotion
            When the motion diverges (`Diverged`), or has no next state.

        Examples
        --------
        >>> from dynkit.systems import Logistic
        >>> print(Logistic(rate=3.2).attractor(start=[0.3]).label)
        P(2)
        """
        if start is None:
            raise ValueError(f"start must be a state of the map, ({self.dimension},); got None")
        return MapAttractor(self, start, transient, positive_integer("keep", keep))

    def following(self, final: Any, keep: int) -> Attractor:
        """Return the next states after the `final` of an attractor of this map.

        Parameters
        ----------
        final : start
        keep : int
            Number of states.

        Raises
        ------
        NoMotion
            When the motion has no next state.
        """
        return self.attractor(start=final, transient=1, keep=keep)

    @final
    def stream(
        self, *, start: Any = None, transient: int = 700, keep: int, block: int = 10_000
    ) -> Stream:
        """Return the motion from a start after its transient, in blocks, for long runs.

        Parameters
        ----------
        start, transient : optional
            As for `attractor`.
        keep : int
            Number of states in all blocks.
        block : int
            Number of states in a block, which must fit into memory.

        Raises
        ------
        ValueError
            When a number is not a count. The start is examined when the first block is computed.

        Examples
        --------
        >>> from dynkit.systems import Logistic
        >>> stream = Logistic(rate=4.0).stream(start=[0.3], keep=25_000)
        >>> [len(block.states) for block in stream]
        [10000, 10000, 5000]
        """
        return Stream(self, start, transient, keep, block)

    @property
    def default_start(self) -> Any:
        """The start of motions when none is given; None where a start is required."""
        return None

    @property
    def start_size(self) -> int:
        """Number of numbers that `state_from` takes."""
        return self.dimension

    @property
    def start_names(self) -> Sequence[str]:
        """Names of the numbers that `state_from` takes; figures of basins have them as axes."""
        return tuple(f"state[{i}]" for i in range(self.start_size))

    def state_from(self, numbers: Array) -> Any:
        """Return the start with these numbers, (`start_size`,).

        Raises
        ------
        ValueError
            When they are not finite, or not of that shape.
        Refused
            When no state has these numbers.
        """
        return finite_array("numbers", numbers, (self.start_size,))

    def pack_state(self, state: Any) -> Array:
        """Return a start as one array of finite numbers."""
        return finite_array("start", state, (self.dimension,))

    def unpack_state(self, packed: Array) -> Any:
        """Return the start from the numbers that `pack_state` returned."""
        return packed

    def displaced(self, motion: Any, size: float) -> Any:
        """Return the last state of a motion, displaced by this fraction of the motion's size.

        The direction is fixed, and lies in no subspace that a symmetric map preserves.

        Parameters
        ----------
        motion : Attractor
            Attractor of this map with at least one state.
        size : float
            Displacement relative to the largest number in the states; relative to 1 where all
            states are zero.
        """
        states: Array = motion.states
        largest = float(abs(states).max()) or 1.0
        return np.asarray(states[-1] + size * largest * generic_direction(self.dimension))

    def arrivals(
        self,
        starts: Array,  # noqa: ARG002
        orbits: Sequence[Attractor],  # noqa: ARG002
        transient: int,  # noqa: ARG002
        near: float,  # noqa: ARG002
    ) -> Arrivals | None:
        """Simulate many starts until they arrive at known periodic orbits.

        A motion has arrived when a state of it is near a state of the orbit, and the state a period
        later is near the same state.

        Parameters
        ----------
        starts : (k, `start_size`) array
        orbits : sequence of Attractor
            One or more periodic motions: P(n,m) keep n states, P(inf,m) more than a period.
        transient : int
            Largest number of states of a motion.
        near : float
            Largest distance from the orbit, in relation to the size of its states.

        Returns
        -------
        orbit : (k,) array of int
            Number of the orbit at which each motion has arrived; -1 for none.
        states : (k, d) array
            The last states; NaN where a motion has arrived at no orbit.
        cost : Cost
            Counted work. In place of all three, None when the map has no such simulation.
        """
        return None
