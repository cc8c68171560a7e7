"""Impact laws as programs for kernels, out of SymPy's expression trees."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.kept import kept
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.law_kernels import (
    ADD,
    ATAN,
    CONSTANT,
    COS,
    EXP,
    LESS,
    LOG,
    MULTIPLY,
    POWER,
    REGISTERS,
    SELECT,
    SIN,
    TANH,
    VELOCITY,
)

if TYPE_CHECKING:
    import sympy

_DIGITS, _MOST_DIGITS = 100, 2000
"""Digits of 1 - r, and of its terms, which cancel."""

_LEAST, _SAME = 0.1, 1e-6
"""The smallest power of which sums are known, and by how much it may differ between velocities."""


def checked(given: Any, velocity: sympy.Symbol) -> Any:
    """The expression of a law; ValueError for what is none of the velocity alone."""
    from sympy import Expr, Float

    if isinstance(given, int | float | np.number) and not isinstance(given, bool):
        given = Float(float(given), 17)
    if not isinstance(given, Expr):
        raise ValueError(f"expression must return a SymPy expression; got {given!r}")
    if others := given.free_symbols - {velocity}:
        names = ", ".join(sorted(map(str, others)))
        raise ValueError(f"expression must depend on the velocity alone; got {names}, too")
    return given


def program_of(expression: Any, velocity: sympy.Symbol) -> Array:
    """The program (REGISTERS, 4) of an expression; ValueError for functions that it cannot have."""
    writer = _Writer(velocity)
    result = writer.row(expression)
    if result != len(writer.rows) - 1:  # the last row is the result
        writer.add(SELECT, result, result, result)
    if len(writer.rows) > REGISTERS:
        raise ValueError(
            f"expression must not have more than {REGISTERS} operations; got {len(writer.rows)}"
        )
    out = np.full((REGISTERS, 4), -1.0)
    out[: len(writer.rows)] = writer.rows
    return out


@final
class _Writer:
    """Rows of a program; each expression has one, however often it occurs."""

    def __init__(self, velocity: sympy.Symbol) -> None:
        self.rows: list[tuple[float, float, float, float]] = []
        self._velocity = velocity

    def add(self, what: int, x: int = 0, y: int = 0, z: float = 0.0) -> int:
        """Write a row; return its number."""
        self.rows.append((what, x, y, z))
        return len(self.rows) - 1

    @kept
    def row(self, e: Any) -> int:
        """The row that gives an expression, or a condition: 1 where it is true."""
        import sympy as sp

        if e == self._velocity:
            return self.add(VELOCITY)
        if e in (sp.true, sp.false) or e.is_number:
            return self._number(1.0 if e == sp.true else 0.0 if e == sp.false else float(e))
        if isinstance(e, sp.exp):
            return self.add(EXP, self.row(e.args[0]))
        if isinstance(e, sp.Piecewise):
            return self._pieces(e)
        one = {sp.log: LOG, sp.sin: SIN, sp.cos: COS, sp.tanh: TANH, sp.atan: ATAN}
        if e.func in one:
            return self.add(one[e.func], self.row(e.args[0]))
        many: dict[Any, Any] = {
            sp.Add: lambda x, y: self.add(ADD, x, y),
            sp.Mul: lambda x, y: self.add(MULTIPLY, x, y),
            sp.Pow: lambda x, y: self.add(POWER, x, y),
            sp.Max: lambda x, y: self.add(SELECT, y, x, self.add(LESS, x, y)),
            sp.Min: lambda x, y: self.add(SELECT, x, y, self.add(LESS, x, y)),
            sp.StrictLessThan: lambda x, y: self.add(LESS, x, y),
            sp.StrictGreaterThan: lambda x, y: self.add(LESS, y, x),
            sp.LessThan: lambda x, y: self._without(self.add(LESS, y, x)),
            sp.GreaterThan: lambda x, y: self._without(self.add(LESS, x, y)),
            sp.And: lambda x, y: self.add(MULTIPLY, x, y),
            sp.Or: lambda x, y: self.add(SELECT, x, y, x),
        }
        if e.func in many:
            first, *others = map(self.row, e.args)
            for other in others:
                first = many[e.func](first, other)
            return first
        if isinstance(e, sp.Abs | sp.sign | sp.Heaviside):  # the last two are slopes of others
            positive = self.row(sp.StrictLessThan(0, e.args[0], evaluate=False))
            if isinstance(e, sp.Heaviside):
                return positive
            sign = self.add(SELECT, self._number(1.0), self._number(-1.0), positive)
            own = isinstance(e, sp.sign)
            return sign if own else self.add(MULTIPLY, sign, self.row(e.args[0]))
        raise ValueError(
            "expression must be made of sums, products, powers, exp, log, sin, cos, tanh, atan, "
            f"Abs, Min, Max and Piecewise; got {e}"
        )

    def _number(self, value: float) -> int:
        return self.add(CONSTANT, 0, 0, value)

    def _without(self, condition: int) -> int:
        """One less a condition."""
        return self.add(SELECT, self._number(0.0), self._number(1.0), condition)

    def _pieces(self, e: Any) -> int:
        found = self._number(np.nan)
        for value, condition in reversed(e.args):
            found = self.add(SELECT, self.row(value), found, self.row(condition))
        return found


def tail_of(expression: Any, velocity: sympy.Symbol) -> tuple[float, float, float, float, float]:
    """`ImpactLaw.tail` of a law with r(0+) = 1, from its values in many digits at tiny velocities.

    Where 1 - r is a power there; the next term is what that leaves.
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
