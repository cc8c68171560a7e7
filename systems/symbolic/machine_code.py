"""Machine code of expressions, built from LLVM instructions; no source text is evaluated."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any, final

from dynkit.core.validation import Array
from dynkit.systems.symbolic.call_kernels import INTERPRETED, caller
from dynkit.systems.symbolic.translation import Value, translate

if TYPE_CHECKING:
    import sympy

_numbers = count()


@final
@dataclass(frozen=True, eq=False)
class Code:
    """Machine code for kernels: its address, and the object that keeps it in memory.

    If Numba's compiler is switched off, the address is a Python function of three arrays.
    """

    address: Any
    owner: Any


def compiled(
    name: str,
    values: Sequence[sympy.Expr],
    coordinates: Sequence[sympy.Symbol],
    parameters: Sequence[sympy.Symbol],
) -> Code:
    """Return code that computes the values from coordinates (d,) and parameters (m,).

    The operations are those of the expressions in the order of `translate`; each one is rounded.

    Raises
    ------
    ValueError
        As `translate`.
    """
    from llvmlite import ir
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.registry import cpu_target

    label = f"dynkit_symbolic_{next(_numbers)}"
    with global_compiler_lock:
        library = cpu_target.target_context.codegen().create_library(label)
        module = library.create_ir_module(label)
        double = ir.DoubleType()
        kind = ir.FunctionType(ir.VoidType(), [double.as_pointer()] * 3)
        function = ir.Function(module, kind, label)
        builder = ir.IRBuilder(function.append_basic_block())

        def place(k: int, i: int) -> Any:
            return builder.gep(function.args[k], [ir.Constant(ir.IntType(64), i)])

        groups = enumerate((coordinates, parameters))
        symbols = {s: builder.load(place(k, i)) for k, g in groups for i, s in enumerate(g)}
        found = translate(name, values, symbols, _Instructions(builder, module))
        for i, value in enumerate(found):
            builder.store(value, place(2, i))
        builder.ret_void()
        library.add_ir_module(module)
        library.finalize()
        address = library.get_pointer_to_function(label)
    return Code(partial(caller(), address) if INTERPRETED else address, library)


@final
class _Instructions:
    """LLVM's instructions, as an `Arithmetic`."""

    def __init__(self, builder: Any, module: Any) -> None:
        from llvmlite import ir

        self._double, self._ir = ir.DoubleType(), ir
        self._builder, self._module = builder, module
        self.add, self.subtract = builder.fadd, builder.fsub
        self.multiply, self.divide = builder.fmul, builder.fdiv
        self.both, self.either, self.choose = builder.and_, builder.or_, builder.select

    def number(self, value: float) -> Value:
        return self._ir.Constant(self._double, value)

    def call(self, name: str, *arguments: Value) -> Value:
        if name in ("sqrt", "fabs", "floor", "ceil"):  # the processor has instructions for these
            function = self._module.declare_intrinsic(f"llvm.{name}", [self._double])
        else:
            kind = self._ir.FunctionType(self._double, [self._double] * len(arguments))
            known = self._module.globals
            function = known.get(name) or self._ir.Function(self._module, kind, name)
        return self._builder.call(function, arguments)

    def compare(self, sign: str, a: Value, b: Value) -> Value:
        if sign == "!=":  # true for NaN, as in Python
            return self._builder.fcmp_unordered(sign, a, b)
        return self._builder.fcmp_ordered(sign, a, b)


def wrapped(
    name: str, function: Any, dimension: int, parameters: int, angles: tuple[int, ...] = ()
) -> Code:
    """Return code that calls a function of ``numba.njit`` with coordinates and parameters.

    The results at the indices `angles` are taken modulo 2 pi.

    Raises
    ------
    ValueError
        When the function does not return a tuple of numbers, one for each coordinate.
    """
    import numba as module
    import numpy as np
    from numba.core import types
    from numba.np.unsafe import ndarray

    numba: Any = module
    fixed_tuple: Any = ndarray.to_fixed_tuple
    turn, places = 2.0 * np.pi, np.array(angles, dtype=np.intp)
    if INTERPRETED:

        def plain(state: Array, given: Array, out: Array) -> None:
            out[:] = _returned(name, function(*state, *given), dimension)
            out[places] %= turn

        return Code(plain, plain)
    arguments = (types.float64,) * (dimension + parameters)
    function.get_call_template(arguments, {})  # compiles the function for these arguments
    returned = function.overloads[arguments].signature.return_type
    _returned(name, returned if isinstance(returned, types.BaseTuple) else None, dimension)
    number: Any = types.float64
    pointer = types.CPointer(number)  # type: ignore[no-untyped-call]

    @numba.cfunc(types.void(pointer, pointer, pointer), error_model="numpy")  # type: ignore[untyped-decorator]
    def call(state: Any, given: Any, out: Any) -> None:
        numbers = fixed_tuple(numba.carray(state, (dimension,)), dimension)
        more = fixed_tuple(numba.carray(given, (parameters,)), parameters)
        i = 0
        for value in numba.literal_unroll(function(*(numbers + more))):
            out[i] = value
            i += 1  # noqa: SIM113  Numba unrolls tuples only
        for k in places:
            out[k] %= turn

    return Code(call.address, call)


def _returned(name: str, found: Any, count: int) -> Any:
    if not isinstance(found, Sized) or len(found) != count:
        raise ValueError(f"{name} must return a tuple of {count} numbers; got {found}")
    return found
