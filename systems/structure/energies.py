"""Quadratic forms read from SymPy expressions, term by term, in exact rational arithmetic.

An energy of a thousand bodies has a few thousand terms of two or three symbols each. Each term is
expanded by itself, so that the work grows with the number of terms and not with the square of the
number of bodies. Floats are taken as exact binary fractions: a matrix element is the exact sum of
its contributions, rounded once.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from dynkit.systems.structure.symmetric import SymmetricMatrix

if TYPE_CHECKING:
    import sympy

# Sorted numbers of the symbols of a product, repeated for powers: (3, 3) is x_4**2, () a constant.
_Monomial: TypeAlias = tuple[int, ...]
_Polynomial: TypeAlias = dict[_Monomial, Fraction]

# Higher powers are an error at once; cubes and fourth powers may cancel against other terms.
_HIGHEST_DEGREE = 4
# Decimal digits of an irrational coefficient such as sqrt(2).
_DIGITS = 60


class NotQuadraticError(ValueError):
    """An energy has other functions than powers, or higher powers than squares."""


class _RefusedError(Exception):
    """The reason why a term cannot be read."""


class _HigherError(_RefusedError):
    """A term is not a polynomial, or its degree is too high."""


def symbols(letter: str, count: int) -> tuple[sympy.Symbol, ...]:
    """Real symbols numbered from 1: ``x_1, ..., x_N``."""
    from sympy import Symbol

    return tuple(Symbol(f"{letter}_{number}", real=True) for number in range(1, count + 1))


def quadratic_form(
    energy: str, expression: object, arguments: tuple[sympy.Symbol, ...]
) -> SymmetricMatrix:
    """Return the matrix A of an energy that is the quadratic form ``x'Ax/2`` in its arguments.

    Parameters
    ----------
    energy : str
        Name of the energy in error messages.
    expression : SymPy expression or number
        The energy. A constant is dropped from a potential, and is an error elsewhere.
    arguments : tuple of SymPy symbols, length N
        The coordinates or velocities.

    Returns
    -------
    SymmetricMatrix
        A, shape (N, N), each element the exact sum of the contributions of all terms, rounded once.

    Raises
    ------
    ValueError
        Naming the energy and the offending term: when the expression holds other symbols, is no
        polynomial, has terms that are not quadratic, or coefficients that are not finite real
        numbers. The error is a `NotQuadraticError` for other functions or higher powers.

    Examples
    --------
    >>> x = symbols("x", 2)
    >>> quadratic_form("potential", 0.1 * (x[0] - x[1]) ** 2 / 2, x).dense
    array([[ 0.1, -0.1],
           [-0.1,  0.1]])
    >>> quadratic_form("potential", x[0] ** 2 + 0.2 * x[1] ** 4, x)
    Traceback (most recent call last):
    ...
    dynkit.systems.structure.energies.NotQuadraticError: potential must be a quadratic form in x_1,
    x_2; the term 0.2*x_2**4 is of degree 4
    """
    reader = _Reader(arguments)
    total: _Polynomial = {}
    sources: dict[_Monomial, object] = {}
    for term in _terms(energy, expression):
        try:
            polynomial = reader.polynomial(term)
        except _RefusedError as reason:
            kind = NotQuadraticError if isinstance(reason, _HigherError) else ValueError
            raise _refusal(energy, arguments, f"the term {shown(term)} {reason}", kind) from None
        for monomial, coefficient in polynomial.items():
            total[monomial] = total.get(monomial, Fraction(0)) + coefficient
            if len(monomial) != 2:
                sources.setdefault(monomial, term)
    for monomial, term in sources.items():
        if total[monomial] and (monomial or energy != "potential"):
            fault = f"is of degree {len(monomial)}" if monomial else "is a constant"
            if len(monomial) == 1 and energy == "potential":
                fault += ", a constant force: give it as constant_forces"
            kind = NotQuadraticError if len(monomial) > 2 else ValueError
            raise _refusal(energy, arguments, f"the term {shown(term)} {fault}", kind)
    elements = {
        (pair[0], pair[1]): coefficient * (2 if pair[0] == pair[1] else 1)
        for pair, coefficient in total.items()
        if len(pair) == 2
    }
    try:
        return SymmetricMatrix.from_fractions(len(arguments), elements)
    except OverflowError:
        raise _refusal(energy, arguments, "a coefficient exceeds the range of floats") from None


def expression_of(energy: str, expression: object) -> sympy.Expr:
    """Return the result of an energy as an expression; the result may be a number.

    Raises
    ------
    ValueError
        When the result is neither an expression nor a number.
    """
    from sympy import Expr, sympify

    if isinstance(expression, int | float | np.number) and not isinstance(expression, bool):
        expression = sympify(expression, strict=True)
    if not isinstance(expression, Expr) or not expression.is_commutative:
        raise ValueError(f"{energy} must return a SymPy expression; got {expression!r}")
    return expression


def _terms(energy: str, expression: object) -> tuple[Any, ...]:
    from sympy import Add

    terms: tuple[Any, ...] = Add.make_args(expression_of(energy, expression))
    return terms


class _Reader:
    """Reads polynomials with rational coefficients from SymPy's expression trees."""

    def __init__(self, arguments: tuple[sympy.Symbol, ...]) -> None:
        self._numbers = {symbol: number for number, symbol in enumerate(arguments)}

    def polynomial(self, expression: Any) -> _Polynomial:
        """Return the expanded expression; raises _RefusedError if it is no polynomial."""
        if expression.is_Symbol:
            return self._symbol(expression)
        if expression.is_Number:
            return _constant(expression)
        if expression.is_Add:
            return _sum(self.polynomial(part) for part in expression.args)
        if expression.is_Mul:
            return product(self.polynomial(part) for part in expression.args)
        if not expression.free_symbols:
            return _constant(expression)
        if expression.is_Pow and expression.exp.is_Number:
            return self._power(expression)
        raise _HigherError(f"holds {shown(expression)}, which is not a polynomial")

    def _symbol(self, symbol: Any) -> _Polynomial:
        if symbol not in self._numbers:
            raise _RefusedError(f"holds {symbol}, which is not among them")
        return {(self._numbers[symbol],): Fraction(1)}

    def _power(self, expression: Any) -> _Polynomial:
        base, exponent = expression.args
        times = _constant(exponent)[()]
        if times.denominator != 1 or times < 0:
            raise _HigherError(f"holds {shown(expression)}, which is not a polynomial")
        if times > _HIGHEST_DEGREE:
            raise _HigherError(f"holds {shown(expression)}, which is of too high a degree")
        return product([self.polynomial(base)] * int(times))


def _constant(number: Any) -> _Polynomial:
    """The number as a fraction: exact for rationals and floats, else with `_DIGITS` digits."""
    given = number
    if not number.is_Number:
        number = number.evalf(_DIGITS)
    if number.is_infinite or (number.is_Number and number.is_finite is not True):
        raise _RefusedError(f"has the coefficient {shown(given)}, which is not finite")
    if not number.is_Number:
        raise _RefusedError(f"has the coefficient {shown(given)}, which is not a real number")
    if number.is_Rational:
        return {(): Fraction(int(number.p), int(number.q))}
    sign, mantissa, exponent, _ = number._mpf_
    value = Fraction(-int(mantissa) if sign else int(mantissa))
    return {(): value * Fraction(2) ** int(exponent)}


def _sum(parts: Iterable[_Polynomial]) -> _Polynomial:
    total: _Polynomial = {}
    for part in parts:
        for monomial, coefficient in part.items():
            total[monomial] = total.get(monomial, Fraction(0)) + coefficient
    return total


def product(parts: Iterable[_Polynomial]) -> _Polynomial:
    """Return the expanded product of polynomials; only here the cost depends on their lengths."""
    found: _Polynomial = {(): Fraction(1)}
    for part in parts:
        total: _Polynomial = {}
        for left, first in found.items():
            for right, second in part.items():
                monomial = tuple(sorted(left + right))
                if len(monomial) > _HIGHEST_DEGREE:
                    raise _HigherError(f"is of degree {len(monomial)}")
                total[monomial] = total.get(monomial, Fraction(0)) + first * second
        found = total
    return found


def _refusal(
    energy: str,
    arguments: tuple[sympy.Symbol, ...],
    fault: str,
    kind: type[ValueError] = ValueError,
) -> ValueError:
    names = [str(argument) for argument in arguments]
    if len(names) > 3:
        names = [names[0], "...", names[-1]]
    listed = ", ".join(names)
    return kind(f"{energy} must be a quadratic form in {listed}; {fault}")


def shown(expression: object) -> str:
    """The expression as text, shortened."""
    text = str(expression)
    return text if len(text) <= 80 else f"{text[:77]}..."
