"""Translation of SymPy expressions into operations, for machine code or heyoka's expressions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache, reduce
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, final

if TYPE_CHECKING:
    import sympy

Value: TypeAlias = Any
"""A value on which an `Arithmetic` operates, or one of its truth values."""

_LARGEST = 64
"""Largest integer power that becomes a product."""

_ORDER = ("<", "<=", ">", ">=", "==", "!=")


class Arithmetic(Protocol):
    """Operations on values of one kind."""

    def number(self, value: float) -> Value:
        """Return a constant."""

    def add(self, a: Value, b: Value) -> Value:
        """Return a + b."""

    def subtract(self, a: Value, b: Value) -> Value:
        """Return a - b."""

    def multiply(self, a: Value, b: Value) -> Value:
        """Return a b."""

    def divide(self, a: Value, b: Value) -> Value:
        """Return a / b."""

    def call(self, name: str, *arguments: Value) -> Value:
        """Return the call of a function of C's mathematical library, such as sin, pow or fmod."""

    def compare(self, sign: str, a: Value, b: Value) -> Value:
        """Return the truth value of a comparison; `sign` is a comparison operator of Python."""

    def both(self, a: Value, b: Value) -> Value:
        """Return whether both are true."""

    def either(self, a: Value, b: Value) -> Value:
        """Return whether one of them is true."""

    def choose(self, condition: Value, a: Value, b: Value) -> Value:
        """Return a if the condition is true, else b."""


def translate(
    name: str,
    expressions: Iterable[sympy.Expr],
    symbols: Mapping[sympy.Symbol, Value],
    arithmetic: Arithmetic,
) -> list[Value]:
    """Return the values of expressions; common subexpressions are evaluated once.

    Parameters
    ----------
    name : str
        Name of the expressions in error messages.
    expressions : sequence
    symbols : mapping
        The value of each symbol.
    arithmetic : Arithmetic

    Raises
    ------
    ValueError
        When an expression contains an unknown function, or a number that is not real and finite.
    """
    from sympy import cse

    shared, rest = cse(list(expressions), order="canonical")
    reading = _Reading(name, dict(symbols), arithmetic)
    for symbol, expression in shared:
        reading.known[symbol] = reading.of(expression)
    return [reading.of(expression) for expression in rest]


@final
class _Reading:
    def __init__(self, name: str, known: dict[Any, Value], arithmetic: Arithmetic) -> None:
        self.name, self.known, self.make = name, known, arithmetic

    def of(self, e: Any) -> Value:
        """Return the value of an expression."""
        if e not in self.known:
            self.known[e] = self._worked_out(e)
        return self.known[e]

    def _worked_out(self, e: Any) -> Value:
        if e.is_Atom:
            return self._constant(e)
        reader = _readers().get(e.func)
        if reader is not None:
            return reader(self, e)
        simple = _functions().get(e.func)
        if simple is not None:
            return self.make.call(simple, *map(self.of, e.args))
        if e.is_Relational:
            return self.make.compare(_signs()[e.func], *map(self.of, e.args))
        raise ValueError(
            f"{self.name} must be made of functions that can be compiled; got {e.func.__name__}"
        )

    def _constant(self, e: Any) -> Value:
        try:
            if e.is_real and e.is_finite:
                # Python rounds the quotient of integers once
                return self.make.number(e.p / e.q if e.is_Rational else float(e))
        except OverflowError:
            pass
        raise ValueError(f"{self.name} must be real and finite; got {e}")

    def sum(self, e: Any) -> Value:
        """Return a sum; terms with a negative sign are subtracted after all others."""
        negative = [term for term in e.args if term.as_coeff_Mul()[0].is_negative]
        positive = [self.of(term) for term in e.args if term not in negative]
        taken = [self.of(-term) for term in negative]
        if not positive:
            return self._minus(reduce(self.make.add, taken))
        return reduce(self.make.subtract, taken, reduce(self.make.add, positive))

    def product(self, e: Any) -> Value:
        """Return a product as one quotient of products."""
        coefficient, rest = e.as_coeff_Mul()
        if coefficient.is_negative:
            return self._minus(self.of(-e))
        over, under = [], []
        numerator, denominator = coefficient.as_numer_denom()
        over += [self.of(numerator)] if numerator != 1 else []
        under += [self.of(denominator)] if denominator != 1 else []
        for factor in rest.as_ordered_factors():
            base, exponent = factor.as_base_exp()
            inverse = factor.is_Pow and exponent.is_Rational and exponent.is_negative
            (under if inverse else over).append(self.of(base**-exponent if inverse else factor))
        product = reduce(self.make.multiply, over) if over else self.make.number(1.0)
        return self.make.divide(product, reduce(self.make.multiply, under)) if under else product

    def power(self, e: Any) -> Value:
        base, exponent = e.args
        if exponent.is_Rational and exponent.is_negative:
            return self.make.divide(self.make.number(1.0), self.of(base**-exponent))
        if exponent.is_Integer and exponent <= _LARGEST:
            return self._integer_power(self.of(base), int(exponent))
        if exponent.is_Rational and exponent.q == 2 and exponent.p <= _LARGEST:
            root = self.make.call("sqrt", self.of(base))
            whole = int(exponent.p) // 2
            if not whole:
                return root
            return self.make.multiply(self._integer_power(self.of(base), whole), root)
        return self.make.call("pow", self.of(base), self.of(exponent))

    def _integer_power(self, base: Value, exponent: int) -> Value:
        if exponent == 1:
            return base
        half = self._integer_power(base, exponent // 2)
        square = self.make.multiply(half, half)
        return self.make.multiply(square, base) if exponent % 2 else square

    def _minus(self, value: Value) -> Value:
        return self.make.multiply(self.make.number(-1.0), value)

    def sign(self, e: Any) -> Value:
        zero, one = self.make.number(0.0), self.make.number(1.0)
        value = self.of(e.args[0])
        below = self.make.choose(self.make.compare("<", value, zero), self._minus(one), value)
        return self.make.choose(self.make.compare(">", value, zero), one, below)

    def step(self, e: Any) -> Value:
        zero, one = self.make.number(0.0), self.make.number(1.0)
        value, middle = map(self.of, e.args)
        below = self.make.choose(self.make.compare("<", value, zero), zero, middle)
        return self.make.choose(self.make.compare(">", value, zero), one, below)

    def modulo(self, e: Any) -> Value:
        """Return the exact remainder with the sign of the divisor, as Python's modulo."""
        dividend, divisor = map(self.of, e.args)
        rest, zero = self.make.call("fmod", dividend, divisor), self.make.number(0.0)
        wrong = self.make.compare("<", self.make.multiply(rest, divisor), zero)
        return self.make.choose(wrong, self.make.add(rest, divisor), rest)

    def fraction(self, e: Any) -> Value:
        value = self.of(e.args[0])
        return self.make.subtract(value, self.make.call("floor", value))

    def extreme(self, e: Any, sign: str) -> Value:
        values = list(map(self.of, e.args))
        return reduce(lambda a, b: self.make.choose(self.make.compare(sign, a, b), a, b), values)

    def pieces(self, e: Any) -> Value:
        """Return a piecewise expression; NaN where no condition is true."""
        found = self.make.number(float("nan"))
        for value, condition in reversed(e.args):
            if condition == True:  # noqa: E712  SymPy's own
                found = self.of(value)
            else:
                found = self.make.choose(self.of(condition), self.of(value), found)
        return found

    def negation(self, e: Any) -> Value:
        zero, one = self.make.number(0.0), self.make.number(1.0)
        chosen = self.make.choose(self.of(e.args[0]), one, zero)
        return self.make.compare("==", chosen, zero)


@cache
def _readers() -> dict[Any, Callable[[_Reading, Any], Value]]:
    import sympy as sp

    return {
        sp.Add: _Reading.sum,
        sp.Mul: _Reading.product,
        sp.Pow: _Reading.power,
        sp.sign: _Reading.sign,
        sp.Heaviside: _Reading.step,
        sp.Mod: _Reading.modulo,
        sp.frac: _Reading.fraction,
        sp.Max: lambda reading, e: reading.extreme(e, ">"),
        sp.Min: lambda reading, e: reading.extreme(e, "<"),
        sp.Piecewise: _Reading.pieces,
        sp.And: lambda reading, e: reduce(reading.make.both, map(reading.of, e.args)),
        sp.Or: lambda reading, e: reduce(reading.make.either, map(reading.of, e.args)),
        sp.Not: _Reading.negation,
    }


@cache
def _functions() -> dict[Any, str]:
    import sympy as sp

    names = (
        "sin cos tan asin acos atan atan2 sinh cosh tanh asinh acosh atanh exp log floor erf erfc"
    )
    return {getattr(sp, name): name for name in names.split()} | {
        sp.Abs: "fabs",
        sp.ceiling: "ceil",
    }


@cache
def _signs() -> dict[Any, str]:
    import sympy as sp

    kinds = (sp.StrictLessThan, sp.LessThan, sp.StrictGreaterThan, sp.GreaterThan, sp.Eq, sp.Ne)
    return dict(zip(kinds, _ORDER, strict=True))
