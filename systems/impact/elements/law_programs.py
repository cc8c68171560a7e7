"""Compilation of impact laws from SymPy expressions to programs for the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynkit.core.validation import Array

if TYPE_CHECKING:
    import sympy

    from dynkit.systems.symbolic.machine_code import Code

_DIGITS, _MOST_DIGITS = 100, 2000
"""Decimal digits to which 1 - r is evaluated, and the largest working precision in digits for this,
as terms of 1 - r may cancel."""

_LEAST, _SAME = 0.1, 1e-6
"""Smallest exponent p for which `tail_of` returns a power law, and the largest difference between
the exponents estimated at different velocities."""


def checked(given: Any, velocity: sympy.Symbol) -> Any:
    """Return the expression of a law; ValueError unless it depends on the velocity alone."""
    from sympy import Expr, Float

    if isinstance(given, int | float | np.number) and not isinstance(given, bool):
        given = Float(float(given), 17)
    if not isinstance(given, Expr):
        raise ValueError(f"expression must return a SymPy expression; got {given!r}")
    if others := given.free_symbols - {velocity}:
        names = ", ".join(sorted(map(str, others)))
        raise ValueError(f"expression must depend on the velocity alone; got {names}, too")
    return given


_ALIKE: dict[Any, Any] = {}
"""Cache of expressions whose numbers are replaced by symbols; keys are their expression trees."""


class Program(NamedTuple):
    """Machine code of an expression of the velocity, and the numbers (k,) in the expression."""

    code: Code
    numbers: Array


def program_of(expression: Any, velocity: sympy.Symbol) -> Program:
    """The program of an expression; ValueError for functions that cannot be compiled.

    Expressions that differ only in their numbers share their machine code.
    """
    alike, symbols, numbers = _without_numbers(expression)
    return Program(_code(alike, velocity, symbols), numbers)


def slope_of(expression: Any, velocity: sympy.Symbol) -> Program:
    """The program of d(r u)/du, the slope of the rebound velocity, for a restitution r(u)."""
    alike, symbols, numbers = _without_numbers(expression)
    return Program(_code(_slope(alike, velocity), velocity, symbols), numbers)


def _without_numbers(expression: Any) -> tuple[Any, tuple[sympy.Symbol, ...], Array]:
    """An expression with symbols in place of its numbers, the symbols, and the numbers (k,)."""
    from sympy import Float, Symbol

    symbols: dict[Any, Any] = {}

    def shape(part: Any) -> Any:
        if isinstance(part, Float):
            return symbols.setdefault(part, Symbol(f"c{len(symbols)}", real=True))
        return (part.func, *map(shape, part.args)) if part.args else part

    # cached, since SymPy takes milliseconds to build an expression
    if (key := shape(expression)) not in _ALIKE:
        _ALIKE[key] = expression.xreplace(symbols)
    return _ALIKE[key], tuple(symbols.values()), np.array([float(e) for e in symbols])


@cache
def _slope(expression: Any, velocity: sympy.Symbol) -> Any:
    from dynkit.systems.symbolic.family import derivatives

    return derivatives([velocity * expression], [velocity])[0]


@cache
def _code(expression: Any, velocity: sympy.Symbol, symbols: tuple[sympy.Symbol, ...]) -> Code:
    from dynkit.systems.symbolic.machine_code import compiled

    return compiled("expression", [expression], [velocity], symbols)


def packed(programs: Sequence[Program]) -> tuple[Any, Array]:
    """Addresses (laws,) and numbers (laws, k) of programs, for the kernels."""
    codes = np.array([p.code.address for p in programs]) if programs else np.empty(0, np.intp)
    numbers = np.zeros((len(programs), max((len(p.numbers) for p in programs), default=0)))
    for row, own in zip(numbers, programs, strict=True):
        row[: len(own.numbers)] = own.numbers
    return codes, numbers


def tail_of(expression: Any, velocity: sympy.Symbol) -> tuple[float, float, float, float, float]:
    """`ImpactLaw.tail` of a law with r(0+) = 1, from multiprecision values at tiny velocities.

    The first term is a power fitted to 1 - r; the next term is a power fitted to the remainder. All
    coefficients are zero if 1 - r is not a power of the velocity.
    """
    from sympy import Float, log

    ten, lost = Float(10, _DIGITS), 1 - expression
    values = {
        n: lost.evalf(_DIGITS, subs={velocity: ten**n}, maxn=_MOST_DIGITS)
        for n in (-40, -60, -100, -200, -300)
    }

    def power(of: Any, high: int, low: int) -> Any:
        return log(of[high] / of[low], 10).evalf(_DIGITS) / (high - low)

    if not all(value.is_Float and value > 0 for value in values.values()):
        return 1.0, 0.0, 0.0, 0.0, 0.0
    p = power(values, -200, -300)
    if not (_LEAST <= p < 1 and abs(p - power(values, -100, -200)) < _SAME):
        return 1.0, 0.0, 0.0, 0.0, 0.0
    scale = values[-300] / ten ** (-300 * p)
    left = {n: scale * ten ** (n * p) - values[n] for n in (-40, -60)}
    if abs(left[-40]) < ten**-60 * values[-40] or left[-40] * left[-60] <= 0:
        return 1.0, float(scale), float(p), 0.0, 0.0
    q = power(left, -40, -60)
    return 1.0, float(scale), float(p), float(left[-60] / ten ** (-60 * q)), float(q)
