"""Base class of maps and flows of machine code: parameters as an array; no code is pickled."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.overriding import watching
from dynkit.core.parameters import Family, arguments, cached_in, without_cached
from dynkit.core.user_code import reading_of
from dynkit.core.validation import Array, finite_array, finite_scalar

if TYPE_CHECKING:
    import sympy

    from dynkit.systems.symbolic.machine_code import Code


Structure: TypeAlias = tuple[tuple[str, Any], ...]
"""Fields of a family that are no parameters, such as strings; expressions depend on them."""

_REAL_NUMBERS = ("float", float)


@final
@dataclass(frozen=True, eq=False)
class Expressions:
    """Expressions (d,) of coordinates (d,) and parameters (m,), and their derivatives."""

    coordinates: tuple[sympy.Symbol, ...]
    parameters: tuple[sympy.Symbol, ...]
    values: tuple[sympy.Expr, ...]

    def modulo_turns(self, places: Iterable[int]) -> Expressions:
        """Return the same expressions with the values at these places modulo 2 pi."""
        from sympy import Mod, pi

        values = list(self.values)
        for i in places:
            values[i] = Mod(values[i], 2 * pi)
        return dataclasses.replace(self, values=tuple(values))

    @cached_property
    def jacobian(self) -> tuple[sympy.Expr, ...]:
        """The derivatives by the coordinates, (d, d), row by row."""
        return tuple(derivatives(self.values, self.coordinates))

    @cached_property
    def by_parameters(self) -> tuple[sympy.Expr, ...]:
        """The derivatives by the parameters, (d, m), row by row."""
        return tuple(derivatives(self.values, self.parameters))


@cache
def coordinate_names(function: Callable[..., Any], others: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return the names of a function's arguments, without self and `others`.

    Raises
    ------
    TypeError
        When it has no such arguments, or one that is not a plain name.
    """
    names = []
    for name, argument in inspect.signature(function).parameters.items():
        if argument.kind is not inspect.Parameter.POSITIONAL_OR_KEYWORD:
            raise TypeError(
                f"{function.__qualname__} must name its coordinates, as in (self, x, y); "
                f"got {argument}"
            )
        names.append(name)
    found = tuple(name for name in names if name not in ("self", *others))
    if not found:
        raise TypeError(f"{function.__qualname__} must take coordinates; got none")
    return found


def checked_parameters(family: Any) -> None:
    """Convert the fields of a dataclass that are annotated as float to finite floats, in place.

    Raises
    ------
    ValueError
        When a field is not a finite number, naming the field and the value.
    """
    for entry in dataclasses.fields(family):
        if entry.type in _REAL_NUMBERS:
            number = finite_scalar(entry.name, getattr(family, entry.name))
            object.__setattr__(family, entry.name, number)


def structure_of(family: Family, parameters: Iterable[str]) -> Structure:
    """Return the fields of a family, by name, that are not parameters.

    Raises
    ------
    TypeError
        When it has an attribute that is no argument: expressions would not contain its value.
    """
    kind: Any = type(family)
    known = arguments(kind)
    for name in sorted(vars(family).keys() - cached_in(kind) - set(known)):
        raise TypeError(
            f"{kind.__name__}.{name} must be an argument or a property, as expressions are made of "
            f"symbols for the arguments; got an attribute of value {getattr(family, name)!r}"
        )
    return tuple((name, getattr(family, name)) for name in sorted(set(known) - set(parameters)))


def expressions_of(
    kind: type,
    function: Callable[..., Any],
    parameters: tuple[str, ...],
    structure: Structure,
    scalar: bool = False,
) -> Expressions:
    """Call a method of a class with symbols, and return its expressions.

    A scalar method returns one expression; any other returns a tuple, one for each coordinate. The
    attributes of ``self`` that are parameters are symbols as well.

    Raises
    ------
    TypeError, ValueError
        When the method compares symbols, or returns no expressions or a wrong number of them.
    """
    from sympy import Symbol

    called = function.__qualname__
    coordinates = tuple(Symbol(name, real=True) for name in coordinate_names(function))
    taken = {symbol.name for symbol in coordinates} & set(parameters)
    if taken:
        raise TypeError(f"{called} must not name a coordinate as a field; got {min(taken)}")
    symbols = tuple(Symbol(name, real=True) for name in parameters)
    subject: Any = object.__new__(watching(kind))
    for name, value in (*structure, *zip(parameters, symbols, strict=True)):
        object.__setattr__(subject, name, value)
    try:
        found = function(subject, *coordinates)
    except TypeError as fault:
        if "truth value" in str(fault):
            raise TypeError(
                f"{called} must not compare symbols, as `if x > 0` does: "
                "sympy.Piecewise says what holds where"
            ) from fault
        fault.add_note(f"{called} is called with SymPy symbols: use sympy.sin, not math.sin")
        raise
    count = len(coordinates)
    if scalar:
        if isinstance(found, tuple | list):
            raise ValueError(f"{called} must return one expression; got {found!r}")
        found, count = (found,), 1
    values = _checked(called, found, count, {*coordinates, *symbols})
    return Expressions(coordinates, symbols, values)


def _checked(
    name: str, found: object, count: int, known: set[sympy.Symbol]
) -> tuple[sympy.Expr, ...]:
    """Return the expressions of a result after a check of their number and symbols."""
    from sympy import Expr, Float, Integer

    if not isinstance(found, tuple | list):
        raise ValueError(f"{name} must return a tuple of {count} expressions; got {found!r}")
    if len(found) != count:
        raise ValueError(
            f"{name} must return {count} expressions, one for each coordinate; got {len(found)}"
        )
    values = []
    for i, value in enumerate(found):
        if isinstance(value, int | float) and not isinstance(value, bool):
            value = Integer(value) if isinstance(value, int) else Float(value)
        if not isinstance(value, Expr):
            raise ValueError(f"{name}: result {i} must be an expression; got {value!r}")
        strange = sorted(symbol.name for symbol in value.free_symbols - known)
        if strange:
            raise ValueError(
                f"{name}: result {i} must hold coordinates and fields only; got {strange[0]}"
            )
        values.append(value)
    return tuple(values)


def derivatives(values: Iterable[sympy.Expr], symbols: Iterable[sympy.Symbol]) -> list[sympy.Expr]:
    """Return the derivatives of values by symbols, row by row.

    Step functions (floor, ceiling, sign, Heaviside's function) have the derivative zero, which is
    their derivative wherever it exists.
    """
    symbols = tuple(symbols)
    rows = []
    for value in values:
        steps: dict[sympy.Expr, sympy.Symbol] = {}
        smooth = _without_steps(value, steps)
        back: Mapping[sympy.Symbol, sympy.Expr] = {dummy: step for step, dummy in steps.items()}
        for symbol in symbols:
            slope = smooth.diff(symbol)
            while slope.free_symbols & back.keys():  # a step may lie within another
                slope = slope.xreplace(back)
            rows.append(slope)
    return rows


def _without_steps(value: sympy.Expr, steps: dict[sympy.Expr, sympy.Symbol]) -> sympy.Expr:
    """Return the expression with each step function replaced by a constant symbol."""
    from sympy import Abs, Dummy, Heaviside, Mod, ceiling, floor, frac, sign

    def constant(step: sympy.Expr) -> sympy.Symbol:
        return steps.setdefault(step, Dummy(real=True))

    if not value.args:
        return value
    inner = [_without_steps(argument, steps) for argument in value.args]
    made = value.func(*inner)
    if isinstance(made, Mod):
        dividend, divisor = made.args
        return dividend - divisor * constant(floor(dividend / divisor))
    if isinstance(made, Abs):
        return made.args[0] * constant(sign(made.args[0]))
    if isinstance(made, frac):
        return made.args[0] - constant(floor(made.args[0]))
    if isinstance(made, floor | ceiling | sign | Heaviside):
        return constant(made)
    return made


@cache
def _kernels() -> Any:
    """Return the module of kernels, imported at the first evaluation."""
    from dynkit.systems.symbolic import kernels

    return kernels


class CodedFamily(Family):
    """Systems whose parameters are arguments of machine code, which is compiled once per class."""

    def __post_init__(self) -> None:
        checked_parameters(self)

    def __getstate__(self) -> dict[str, Any]:
        return without_cached(self)

    @cached_property
    def _numbers(self) -> Array:
        return np.array([getattr(self, name) for name in self.parameters], dtype=np.float64)

    def _filled(self, code: Code, state: Array, shape: tuple[int, ...]) -> Array:
        """Return the output of code at a state, (d,), after a check of the state."""
        here, out = finite_array("state", state, (self.dimension,)), np.empty(shape)
        _kernels().apply(code.address, np.ascontiguousarray(here), self._numbers, out)
        return out

    def _tangent(self, program: Program, state: Array) -> Array:
        """Return the derivative, (d, d), of d expressions by the state."""
        d = self.dimension
        return self._filled(program.tangent, state, (d + 1, d))[1:].copy()

    def _by_parameter(self, program: Program, state: Array, name: str) -> Array:
        """Return the derivative, (d,), of a program's expressions by a parameter."""
        self.value_of(name)
        names = list(self.parameters)
        shape = len(program.expressions.values), len(names)
        found = self._filled(program.by_parameters, state, shape)
        return found[:, names.index(name)].copy()

    @final
    @cached_property
    def dimension(self) -> int:
        """The number d of the state's coordinates."""
        return len(self._coordinates)

    @property
    def _coordinates(self) -> tuple[str, ...]:
        raise NotImplementedError


@final
class Program:
    """The code of a class's expressions; each part is compiled when it is first needed."""

    def __init__(
        self,
        kind: type,
        function: Callable[..., Any],
        parameters: tuple[str, ...],
        structure: Structure,
        scalar: bool = False,
        angles: tuple[int, ...] = (),
    ) -> None:
        self.name = f"{kind.__name__}.{function.__name__}"
        found = expressions_of(kind, function, parameters, structure, scalar)
        self.expressions = found.modulo_turns(angles) if angles else found

    def _compiled(self, values: Sequence[Any]) -> Code:
        from dynkit.systems.symbolic.machine_code import compiled

        given = self.expressions
        return compiled(self.name, values, given.coordinates, given.parameters)

    @cached_property
    def step(self) -> Code:
        """Code that fills (d,) with the expressions."""
        return self._compiled(self.expressions.values)

    @cached_property
    def tangent(self) -> Code:
        """Code that fills an array with the expressions, (d,), then their Jacobian, (d, d)."""
        return self._compiled([*self.expressions.values, *self.expressions.jacobian])

    @cached_property
    def by_parameters(self) -> Code:
        """Code that fills (d, m) with the derivatives by the parameters."""
        return self._compiled(self.expressions.by_parameters)


_programs: dict[tuple[Any, ...], Program] = {}


def program_of(
    system: Family, method: str, scalar: bool = False, angles: tuple[int, ...] = ()
) -> Program:
    """Return the program of a system's class, which all values of its parameters share."""
    kind: Any = type(system)
    names = tuple(system.parameters)
    # the key contains functions and attributes, since those of a class can be replaced
    given = kind, getattr(kind, method), names, structure_of(system, names), scalar, angles
    found = _programs.get((given, reading_of(kind)))
    if found is None:
        found = Program(*given)
        _programs[given, reading_of(kind)] = found  # the used attributes are known now
    return found
