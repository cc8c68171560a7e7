"""Expressions of a class's methods, called with symbols, and their derivatives."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias, final

from dynkit.core.kept import cached_property
from dynkit.core.overriding import watching
from dynkit.core.parameters import Family, arguments, cached_in
from dynkit.core.validation import finite_scalar

if TYPE_CHECKING:
    import sympy

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
