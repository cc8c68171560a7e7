"""Maps whose step is machine code, from SymPy expressions or from a function for Numba."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.smooth_map import generic_direction, refuse_infinite
from dynkit.core.stretching import Stretching
from dynkit.core.validation import Array, finite_array, non_negative_integer
from dynkit.dynamics.map import Map
from dynkit.systems.symbolic.family import (
    CodedFamily,
    Program,
    coordinate_names,
    program_of,
)

if TYPE_CHECKING:
    from dynkit.systems.symbolic.machine_code import Code

_TURN = 2.0 * np.pi


class CompiledMap(CodedFamily, Map):
    """A map whose next state is a function compiled by Numba.

    A subclass must implement ``next_state``, a static method decorated by ``numba.njit``. Its
    arguments are the coordinates and then the parameters by name; it returns a tuple of the next
    values of the coordinates. The fields of the class, ``rate: float = 3.0``, are its parameters;
    fields annotated as float must be finite. Derivatives are computed by differences, unless the
    subclass implements `jacobian`.

    Attributes
    ----------
    angles : tuple of str
        A class variable: names of coordinates that are angles. They are taken modulo 2 pi in next
        states, and their `difference` is wrapped.

    Raises
    ------
    ValueError
        When a number is not finite.
    TypeError
        At the first call, when ``next_state`` is not such a method.

    Examples
    --------
    >>> import numba
    >>> class Tent(CompiledMap):
    ...     slope: float = 1.5
    ...
    ...     @staticmethod
    ...     @numba.njit
    ...     def next_state(x, slope):
    ...         return (slope * min(x, 1.0 - x),)
    >>> Tent().iterate([0.25], 2)
    array([[0.25  ],
           [0.375 ],
           [0.5625]])
    """

    _following: ClassVar[Mapping[str, tuple[str, ...]]] = {
        name: (*originals, "next_state") for name, originals in Map._following.items()
    }

    angles: ClassVar[Sequence[str]] = ()

    if TYPE_CHECKING:
        next_state: Any  # any arguments, of a method or a static one
    else:

        @abstractmethod
        def next_state(self, *coordinates: Any) -> tuple[Any, ...]:
            """Return the next values of the coordinates, as a tuple."""

    def __call__(self, state: Array) -> Array:
        return self._filled(self._step, state, (self.dimension,))

    def iterate_into(self, states: Array) -> None:
        from dynkit.systems.symbolic import kernels

        stop = kernels.iterate(self._step.address, self._numbers, states)
        if stop:
            refuse_infinite(states[stop], stop)

    def difference(self, a: Array, b: Array) -> Array:
        """Return a - b with the `angles` wrapped; (..., d) arrays."""
        gap = super().difference(a, b)
        if self.angles:
            places = list(self._angle_places)
            gap[..., places] -= _TURN * np.rint(gap[..., places] / _TURN)
        return gap

    @cached_property
    def _angle_places(self) -> tuple[int, ...]:
        known = self._coordinates
        if isinstance(self.angles, str) or not set(self.angles) <= set(known):
            raise ValueError(
                f"angles must be a tuple of names of coordinates, {', '.join(known)}; "
                f"got {self.angles!r}"
            )
        return tuple(known.index(name) for name in self.angles)

    @property
    def _coordinates(self) -> tuple[str, ...]:
        kind = type(self)
        return _names_of_static(kind.__name__, kind.next_state, tuple(self.parameters))

    @cached_property
    def _step(self) -> Code:
        kind, given = type(self), (tuple(self.parameters), self._angle_places)
        return _static_step(kind.__name__, kind.next_state, *given)


class SymbolicMap(CompiledMap):
    """A map given by SymPy expressions, with derivatives by SymPy, compiled to machine code.

    A subclass must implement ``next_state(self, x, y, ...)``. It takes one SymPy symbol for each
    coordinate and returns a tuple of as many expressions; the argument names are the names of the
    coordinates. The fields of the class, ``a: float = 1.4``, are its parameters: within the method
    ``self.a`` is a symbol. Other fields, such as strings and tuples, keep their values.

    The method is called once for each class, not for each value of a parameter. So it must not
    compare symbols; use ``sympy.Piecewise``, ``Min``, ``Max`` or ``Abs`` to choose between
    expressions. Functions of C's mathematical library, powers, ``Mod``, ``sign`` and ``Heaviside``
    can be compiled. The derivative of a step function is zero.

    Next states, the `jacobian`, derivatives by parameters, `iterate` and `stretching` use machine
    code. A call from Python takes about a microsecond, an iterate within a loop some nanoseconds.

    Attributes
    ----------
    angles : tuple of str
        A class variable: names of coordinates that are angles, as for `CompiledMap`.

    Raises
    ------
    ValueError
        When a number is not finite. At the first call, when ``next_state`` does not return one
        expression for each coordinate, or returns a function that cannot be compiled.
    TypeError
        At the first call, when ``next_state`` compares symbols.

    Examples
    --------
    >>> import sympy
    >>> class Ikeda(SymbolicMap):
    ...     u: float = 0.6
    ...
    ...     def next_state(self, x, y):
    ...         t = 0.4 - 6 / (1 + x**2 + y**2)
    ...         turned = x * sympy.cos(t) - y * sympy.sin(t), x * sympy.sin(t) + y * sympy.cos(t)
    ...         return 1 + self.u * turned[0], self.u * turned[1]
    >>> Ikeda()([0.0, 0.0])
    array([1., 0.])
    >>> bool(abs(np.linalg.det(Ikeda(u=0.9).jacobian([0.3, 0.2])) - 0.9**2) < 1e-14)
    True
    """

    def jacobian(self, state: Array) -> Array:
        return self._tangent(self._program, state)

    def parameter_derivative(self, state: Array, name: str) -> Array:
        return self._by_parameter(self._program, state, name)

    def stretching(self, state: Array, n: int, frame: Array | None = None) -> Stretching:
        count, d = non_negative_integer("n", n), self.dimension
        here = np.array(finite_array("state", state, (d,)))
        directions = np.eye(d) if frame is None else frame.copy()
        logs, errors = self._carried(here, directions, count, self.accuracy)
        return Stretching(logs, errors, None, here, directions)

    def _growth(self, state: Array, n: int) -> Array:
        frame = generic_direction(self.dimension)[:, None].copy()
        logs = self._carried(state.copy(), frame, n, 0.0)[0][:, 0]
        return logs if np.isfinite(logs).all() else np.full(n, -np.inf)

    def _carried(self, state: Array, frame: Array, n: int, accuracy: float) -> tuple[Array, Array]:
        """Propagate a state and a frame (d, k), in place; return logarithms (n, k) and errors."""
        from dynkit.systems.symbolic import kernels

        d, k = frame.shape
        room, (logs, errors) = np.empty((d + 1, d)), np.empty((2, n, k))
        code = self._program.tangent.address
        stop = kernels.stretch(code, self._numbers, state, frame, accuracy, room, logs, errors)
        if stop:
            refuse_infinite(state, stop)
        return logs, errors

    @property
    def _coordinates(self) -> tuple[str, ...]:
        return coordinate_names(type(self).next_state)

    @cached_property
    def _step(self) -> Code:
        return self._program.step

    @cached_property
    def _program(self) -> Program:
        return program_of(self, "next_state", angles=self._angle_places)


@cache
def _names_of_static(kind: str, function: Any, parameters: tuple[str, ...]) -> tuple[str, ...]:
    from numba.extending import is_jitted

    from dynkit.systems.symbolic.call_kernels import INTERPRETED

    if not (is_jitted(function) or INTERPRETED):
        raise TypeError(
            f"{kind}.next_state must be a static method that numba.njit compiles; got {function!r}"
        )
    function = getattr(function, "py_func", function)
    found = coordinate_names(function)
    if parameters != found[len(found) - len(parameters) :]:
        raise TypeError(
            f"{kind}.next_state must take coordinates, then {', '.join(parameters)}; got "
            f"{', '.join(found)}"
        )
    return coordinate_names(function, parameters)


@cache
def _static_step(
    kind: str, function: Any, parameters: tuple[str, ...], angles: tuple[int, ...]
) -> Code:
    from dynkit.systems.symbolic.machine_code import wrapped

    count = len(_names_of_static(kind, function, parameters))
    return wrapped(f"{kind}.next_state", function, count, len(parameters), angles)
