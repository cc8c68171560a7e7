"""Calls from kernels of the machine code of expressions, by its address."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numba
from numba.core import types
from numba.extending import intrinsic

from dynkit.core.validation import Array

_settings: Any = numba.config

INTERPRETED = bool(_settings.DISABLE_JIT)
"""Whether Numba's compiler is switched off; then the code is a Python function."""


@intrinsic
def _called(_context: Any, _address: Any, state: Any, parameters: Any, out: Any) -> Any:
    """Call machine code of type void(state, parameters, out), with pointers to doubles."""
    from llvmlite import ir

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        arrays = zip(signature.args[1:], values[1:], strict=True)
        pointers = [context.make_array(kind)(context, builder, v).data for kind, v in arrays]
        called = ir.FunctionType(ir.VoidType(), [pointer.type for pointer in pointers])
        builder.call(builder.inttoptr(values[0], called.as_pointer()), pointers)
        return context.get_dummy_value()

    return types.void(types.intp, state, parameters, out), code


@cache
def caller() -> Any:
    """Return a Python function that calls machine code, for use without Numba's compiler."""
    from numba.core.registry import CPUDispatcher

    code: Any = _called
    dispatcher: Any = CPUDispatcher

    def function(address: int, state: Array, parameters: Array, out: Array) -> None:
        code(address, state, parameters, out)

    return dispatcher(function, targetoptions={"nopython": True})


def _plain(
    function: Callable[[Array, Array, Array], None], state: Array, parameters: Array, out: Array
) -> None:
    function(state, parameters, out)


call: Any = _plain if INTERPRETED else _called
"""Calls code with (address, state, parameters, out)."""
