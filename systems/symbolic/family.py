"""Base class of maps and flows of machine code: parameters as an array; no code is pickled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.parameters import Family, without_cached
from dynkit.core.user_code import reading_of
from dynkit.core.validation import Array, finite_array
from dynkit.systems.symbolic.derivation import (
    Structure,
    checked_parameters,
    expressions_of,
    structure_of,
)

if TYPE_CHECKING:
    from dynkit.systems.symbolic.machine_code import Code


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
