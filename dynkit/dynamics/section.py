"""Poincare sections: surfaces that a flow crosses."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import final

import numpy as np

from dynkit.core.angles import in_turn
from dynkit.core.overriding import Extensible
from dynkit.core.validation import (
    Array,
    finite_array,
    finite_scalar,
    non_negative_integer,
    of_type,
    positive_integer,
)

_TURN = 2.0 * np.pi


class PoincareSection(Extensible, ABC):
    """A surface in the state space of a flow, crossed in one direction, with a chart.

    A subclass must implement:

    1. `dimension`, the number d of coordinates of the surrounding state space.
    2. `direction`: +1 when a crossing increases the value, -1 when it decreases the value.
    3. ``value(state)``, a smooth number that is zero on the surface, and not elsewhere near it.
    4. ``gradient(state)``, its exact (d,) derivative.
    5. ``reduce(state)``, the (d - 1,) coordinates of a state on the surface, and
       ``lift(reduced)``, the (d,) state on the surface with these coordinates: the inverse.
       ``reduce`` is also defined and smooth near the surface.
    6. ``reduce_derivative(state)``, (d - 1, d), and ``lift_derivative(reduced)``, (d, d - 1).

    A subclass may implement:

    7. ``difference(a, b)``, when coordinates on the surface are angles, as a `Map` does; ``reduce``
       may then jump by a whole turn.

    None of these changes its argument. An argument that is not finite, or not of the right shape,
    raises ValueError. Instances are immutable. `dynkit.testing.check_section` tests a subclass
    against this contract.
    """

    @property
    @abstractmethod
    def dimension(self) -> int:
        """The number d of coordinates of the surrounding state space."""

    @property
    @abstractmethod
    def direction(self) -> int:
        """+1 when a crossing increases the value, -1 when it decreases the value."""

    @abstractmethod
    def value(self, state: Array) -> float:
        """Return the number whose zeros are the surface, at a state, (d,)."""

    @abstractmethod
    def gradient(self, state: Array) -> Array:
        """Return the derivative, (d,), of the value at a state, (d,)."""

    @abstractmethod
    def reduce(self, state: Array) -> Array:
        """Return the coordinates on the surface, (d - 1,), of a state, (d,)."""

    @abstractmethod
    def lift(self, reduced: Array) -> Array:
        """Return the state, (d,), with these coordinates on the surface, (d - 1,)."""

    @abstractmethod
    def reduce_derivative(self, state: Array) -> Array:
        """Return the derivative, (d - 1, d), of `reduce` at a state, (d,)."""

    @abstractmethod
    def lift_derivative(self, reduced: Array) -> Array:
        """Return the derivative, (d, d - 1), of `lift` at coordinates on the surface, (d - 1,)."""

    def difference(self, a: Array, b: Array) -> Array:
        """Return a - b, (..., d - 1); a section with angles wraps them to the shortest way."""
        return np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64)


class _Charted(PoincareSection):
    """A section on which some coordinates are angles."""

    _direction = 1
    _angles: list[int]

    @property
    def direction(self) -> int:
        return self._direction

    def difference(self, a: Array, b: Array) -> Array:
        return _shortest(super().difference(a, b), self._angles)

    def _checked(self, state: Array) -> Array:
        return finite_array("state", state, (self.dimension,))


@final
class Hyperplane(_Charted):
    """The plane ``normal @ state = offset``, with an orthonormal chart.

    The value is the signed distance to the plane. For a plane normal to a coordinate axis the chart
    is the list of the other coordinates.

    Parameters
    ----------
    normal : (d,) array
        Normal of the plane, of any length but zero; d >= 2.
    offset : float
    direction : {+1, -1}
        +1 counts crossings along the normal, -1 those in the opposite direction.
    angles : sequence of int
        Indices of the state's coordinates that are angles: `reduce` takes them modulo 2 pi. The
        normal must be zero there.

    Raises
    ------
    ValueError
        When the normal is zero, or not zero at an angle. Also when an argument is not finite or not
        of that shape, or an angle is not an index of the normal.

    Examples
    --------
    >>> plane = Hyperplane(normal=[0.0, 0.0, 2.0], offset=54.0)
    >>> plane.value([1.0, 2.0, 30.0])
    3.0
    >>> plane.reduce([1.0, 2.0, 27.0]), plane.lift([1.0, 2.0])
    (array([1., 2.]), array([ 1.,  2., 27.]))
    """

    def __init__(
        self,
        normal: Array,
        offset: float = 0.0,
        direction: int = 1,
        angles: Sequence[int] = (),
    ) -> None:
        given = finite_array("normal", normal, (None,))
        if given.size < 2:
            raise ValueError(f"normal must have 2 or more coordinates; got {given.size}")
        if not given.any():
            raise ValueError(f"normal must not be zero; got {given.tolist()}")
        if isinstance(direction, bool | np.ndarray) or direction not in (1, -1):
            raise ValueError(f"direction must be +1 or -1; got {direction!r}")
        # scaled first: the squares of a very long or very short normal would overflow or underflow
        size = float(np.abs(given).max())
        length = float(np.linalg.norm(given / size))
        self._unit = given / size / length
        self._distance = finite_scalar("offset", offset) / size / length
        self._direction = int(direction)
        self._chart = _orthonormal_complement(self._unit)
        self._angles = self._places_of(angles, given)
        self._shown = _shown(angles)
        for array in (self._unit, self._chart):
            array.setflags(write=False)

    @property
    def dimension(self) -> int:
        return int(self._unit.size)

    def value(self, state: Array) -> float:
        return float(self._unit @ self._checked(state)) - self._distance

    def gradient(self, state: Array) -> Array:
        self._checked(state)
        return self._unit.copy()

    def reduce(self, state: Array) -> Array:
        coordinates = np.asarray(self._chart @ self._checked(state))
        coordinates[self._angles] = in_turn(coordinates[self._angles])
        return coordinates

    def lift(self, reduced: Array) -> Array:
        coordinates = finite_array("reduced", reduced, (self.dimension - 1,))
        return np.asarray(coordinates @ self._chart + self._distance * self._unit)

    def reduce_derivative(self, state: Array) -> Array:
        self._checked(state)
        return self._chart.copy()

    def lift_derivative(self, reduced: Array) -> Array:
        finite_array("reduced", reduced, (self.dimension - 1,))
        return self._chart.T.copy()

    def __repr__(self) -> str:
        place = f"{self._unit.tolist()}, {self._distance}, {self._direction:+d}"
        return f"Hyperplane({place}{self._shown})"

    def _places_of(self, angles: Sequence[int], normal: Array) -> list[int]:
        """Return the indices, in the chart, of coordinates along which the normal is zero."""
        places = []
        for index in _indices(angles, self.dimension):
            if normal[index] != 0.0:
                raise ValueError(
                    f"normal[{index}], an angle's, must be zero; got {float(normal[index])}"
                )
            # the row of the chart for such a coordinate is the coordinate itself
            places.append(int(np.argmax(self._chart[:, index])))
        return places


@final
class Stroboscope(_Charted):
    """The states with a given phase, modulo 2 pi: a strobe light that flashes once a period.

    The phase of a flow that is driven in time is the last coordinate, and it grows. The value is
    sin(last coordinate - phase). Half a period later it passes through zero in the other direction,
    which is not a crossing. The chart is the list of the other coordinates.

    Parameters
    ----------
    dimension : int
        Number d of the state's coordinates; d >= 2.
    phase : float
        Phase of the flashes, in radians.
    angles : sequence of int
        Indices of the other coordinates that are angles: `reduce` takes them modulo 2 pi. The
        motion of a driven pendulum that turns is periodic with ``angles=[0]`` only.

    Raises
    ------
    ValueError
        When the dimension is not an integer >= 2, the phase is not finite, or an angle is not an
        index of the other coordinates.

    Examples
    --------
    >>> flashes = Stroboscope(3, phase=0.5)
    >>> flashes.lift([1.0, 2.0])
    array([1. , 2. , 0.5])
    >>> abs(flashes.value([1.0, 2.0, 0.5 + 2.0 * np.pi])) < 1e-15
    True
    """

    def __init__(self, dimension: int, phase: float = 0.0, angles: Sequence[int] = ()) -> None:
        self._dimension = positive_integer("dimension", dimension)
        if self._dimension < 2:
            raise ValueError(f"dimension must be 2 or more; got {dimension}")
        self._phase = finite_scalar("phase", phase)
        self._angles = _indices(angles, self._dimension - 1)
        self._shown = _shown(angles)

    @property
    def dimension(self) -> int:
        return self._dimension

    def value(self, state: Array) -> float:
        return math.sin(float(self._checked(state)[-1]) - self._phase)

    def gradient(self, state: Array) -> Array:
        gradient = np.zeros(self._dimension)
        gradient[-1] = math.cos(float(self._checked(state)[-1]) - self._phase)
        return gradient

    def reduce(self, state: Array) -> Array:
        coordinates = self._checked(state)[:-1].copy()
        coordinates[self._angles] = in_turn(coordinates[self._angles])
        return coordinates

    def lift(self, reduced: Array) -> Array:
        return np.append(finite_array("reduced", reduced, (self._dimension - 1,)), self._phase)

    def reduce_derivative(self, state: Array) -> Array:
        self._checked(state)
        return np.eye(self._dimension - 1, self._dimension)

    def lift_derivative(self, reduced: Array) -> Array:
        finite_array("reduced", reduced, (self._dimension - 1,))
        return np.eye(self._dimension, self._dimension - 1)

    def __repr__(self) -> str:
        return f"Stroboscope({self._dimension}, {self._phase}{self._shown})"


def _indices(angles: Sequence[int], count: int) -> list[int]:
    """Return the indices of angles among coordinates, checked."""
    of_type("angles", angles, Sequence | np.ndarray, "a sequence of indices")
    found = []
    for i, angle in enumerate(angles):
        index = non_negative_integer(f"angles[{i}]", angle)
        if index >= count:
            raise ValueError(f"angles[{i}] must be less than {count}; got {index}")
        found.append(index)
    return found


def _shown(angles: Sequence[int]) -> str:
    return f", angles={[int(angle) for angle in angles]}" if len(angles) else ""


def _shortest(gap: Array, angles: list[int]) -> Array:
    """Wrap the angles of a difference (..., d), modified in place, to the shortest way."""
    gap[..., angles] -= _TURN * np.rint(gap[..., angles] / _TURN)
    return gap


def _orthonormal_complement(unit: Array) -> Array:
    """Return rows, (d - 1, d), that complete a unit vector to an orthonormal basis.

    They are all rows but one of the Householder reflection that maps the vector to an axis (Golub
    and Van Loan, Matrix Computations, 4th ed., section 5.1).
    """
    axis = int(np.argmax(np.abs(unit)))
    mirror = unit.copy()
    mirror[axis] += np.copysign(1.0, unit[axis])
    reflection = np.eye(unit.size) - np.outer(mirror, mirror) * (2.0 / float(mirror @ mirror))
    return np.delete(reflection, axis, axis=0)
