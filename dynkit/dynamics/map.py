"""Maps: dynamical systems in discrete time."""

from typing import Any

import numpy as np

from dynkit.core.smooth_map import SmoothMap, generic_direction
from dynkit.core.validation import Array, finite_array, positive_integer
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map_attractor import MapAttractor


class Map(SmoothMap):
    """A dynamical system in discrete time: a smooth function from states to states.

    A subclass owes:

    1. `dimension`, the number d of the state's coordinates.
    2. ``__call__(state)``, the next state. The state is (d,) and so is the result, a new array. The
       call changes nothing: not its argument, and not the map. A state that is not finite, or not
       of that shape, is refused with ValueError: `dynkit.core.validation.finite_array` does it.
       Where the motion runs away, the call returns numbers that are not finite. Where there is no
       next state for another reason, it raises a `NoMotion`: `NoCrossing`, or `Refused` for a
       finite state outside of the map's range. Every other exception is taken for a fault in the
       map: no sweep, basin or orbit search catches it.

    and may offer:

    3. ``jacobian(state)``, the exact (d, d) derivative of the call: row i belongs to coordinate i
       of the result. Otherwise it is found by differences, some 5 to 20 calls for each coordinate,
       and their error is part of what is claimed of multipliers, exponents and bifurcations.
    4. ``difference(a, b)``, when coordinates are angles: a - b, wrapped to the shortest way. Its
       arguments are (..., d) and broadcast; it is antisymmetric, and zero where a equals b.
    5. ``parameters`` and ``replace``, when it belongs to a family of maps and is no dataclass; see
       `Family`.
    6. `accuracy`, when a call is wrong by more than rounding.
    7. ``parameter_derivative(state, name)``, the exact (d,) derivative of the call by a parameter;
       otherwise it is found by differences.
    8. ``jacobian_factors(state)``, when the derivative is a product along the way, whose small
       eigenvalues would be lost in the product itself; `jacobian` multiplies them.
    9. ``iterate_into(states)`` and ``stretching(state, n)``, when it knows a faster way to many
       iterates, and to what Lyapunov exponents are made of.

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
    >>> logistic = Logistic(rate=4.0)
    >>> logistic.iterate([0.25], 2)
    array([[0.25],
           [0.75],
           [0.75]])
    >>> logistic.replace(rate=2.0).parameters
    {'rate': 2.0}
    """

    def attractor(self, *, start: Any = None, transient: int = 700, keep: int = 100) -> Attractor:
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
