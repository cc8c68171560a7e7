"""Smooth functions of a structure's coordinates, along which elements act."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.systems.structure.energies import symbols
from dynkit.systems.structure.equations import checked, form_of

if TYPE_CHECKING:
    import sympy

_MOST_KEPT = 64
"""Largest number of forms whose derivatives are kept."""


@final
@dataclass(frozen=True, eq=False)
class Form:
    """A function y(x) of coordinates with its derivatives; its numbers are symbols.

    Attributes
    ----------
    x : (N,) symbols
    numbers : (p,) symbols of the numbers in the expression
    values : (1 + N + N^2,) expressions: y, its gradient, and its second derivatives row by row
    """

    x: tuple[sympy.Symbol, ...]
    numbers: tuple[sympy.Symbol, ...]
    values: tuple[sympy.Expr, ...]

    @cached_property
    def code(self) -> Any:
        """Code that fills (1 + N + N^2,) with the values."""
        from dynkit.systems.symbolic.machine_code import compiled

        return compiled("the coordinate of an element", self.values, self.x, self.numbers)

    @cached_property
    def text(self) -> str:
        """The expression, with symbols for numbers."""
        return str(self.values[0])

    @cached_property
    def changes(self) -> Any:
        """Code that fills (1 + N, p) with derivatives of y and its gradient by the numbers."""
        from dynkit.systems.symbolic.machine_code import compiled

        some = self.values[: 1 + len(self.x)]
        by = [value.diff(number) for value in some for number in self.numbers]
        return compiled("the coordinate of an element", by, self.x, self.numbers)


@final
class CoordinateFunction:
    """A function y(x) of coordinates, with the numbers of one structure.

    Attributes
    ----------
    form : Form
    numbers : (p,) float
        Complex if they have imaginary changes. Positions may be complex as well, except in `bend`.
    """

    def __init__(self, form: Form, numbers: Array) -> None:
        self.form, self.numbers = form, numbers

    @property
    def text(self) -> str:
        """The expression, for stores."""
        return f"{self.form.text}, {self.numbers.tolist()}"

    def __call__(self, x: Array) -> Any:
        """Values (...) at positions (..., N)."""
        return self._filled(x)[..., 0]

    def gradient(self, x: Array) -> Array:
        """Gradients (..., N) at positions (..., N)."""
        return self._filled(x)[..., 1 : 1 + x.shape[-1]]

    def bend(self, x: Array, v: Array) -> Array:
        """Second derivatives times velocities, (..., N), at positions and velocities (..., N)."""
        n = x.shape[-1]
        second = self._filled(x)[..., 1 + n :].reshape(*x.shape, n)
        return np.asarray((second @ v[..., None])[..., 0])

    def _filled(self, x: Array) -> Array:
        if np.iscomplexobj(x) or np.iscomplexobj(self.numbers):
            return self._changed(x)
        from dynkit.systems.symbolic import kernels

        rows = np.ascontiguousarray(x, dtype=float).reshape(-1, x.shape[-1])
        out = np.empty((len(rows), len(self.form.values)))
        kernels.apply_all(self.form.code.address, rows, self.numbers, out)
        return out.reshape(*x.shape[:-1], -1)

    def _changed(self, x: Array) -> Array:
        """Value and gradient, (1 + N,), at one position (N,), with their imaginary changes."""
        from dynkit.systems.symbolic import kernels

        n, still = len(x), CoordinateFunction(self.form, self.numbers.real.copy())
        found = still._filled(x.real)
        by_x = np.concatenate([found[1 : 1 + n], found[1 + n :]]).reshape(1 + n, n)
        by_numbers = np.empty((1 + n, len(self.numbers)))
        if by_numbers.size:
            at = np.ascontiguousarray(x.real), still.numbers
            kernels.apply(self.form.changes.address, *at, by_numbers.ravel())
        changes = by_x @ x.imag + by_numbers @ self.numbers.imag
        return np.asarray(found[: 1 + n] + 1j * changes)


def function_of(owner: object, name: str, size: int) -> CoordinateFunction:
    """Derive the function that a method of a structure returns.

    Raises
    ------
    ValueError
        When the expression holds other symbols, is not finite, real or smooth, or is constant.
    """
    x = symbols("x", size)
    expression = checked(name, getattr(owner, name)(x), set(x))
    if not expression.free_symbols:
        raise ValueError(f"{name} must depend on the coordinates; got {expression}")
    numbers: dict[Any, Any] = {}
    form = form_of(expression, numbers)
    made = _derived(size, form, tuple(numbers.values()))
    return CoordinateFunction(made, np.array([float(value) for value in numbers]))


@lru_cache(_MOST_KEPT)
def _derived(size: int, form: sympy.Expr, numbers: tuple[sympy.Symbol, ...]) -> Form:
    x = symbols("x", size)
    gradient = [form.diff(each) for each in x]
    second = [part.diff(each) for part in gradient for each in x]
    return Form(x, numbers, (form, *gradient, *second))
