"""Sums of products in a fixed order, so that every kernel gets the same bits.

A compiler that may reorder a sum does so differently in each function that inlines it.
"""

from __future__ import annotations

from typing import Any

import numba

from dynkit.core.validation import Array

_LANES = 4
"""Number of partial sums."""


def _multiply_add(builder: Any, kind: Any, *values: Any) -> Any:
    """Emit the call of LLVM's fused multiply-add for numbers or vectors of numbers."""
    from llvmlite import ir
    from numba.core import cgutils

    name = "llvm.fmuladd.f64" if kind == ir.DoubleType() else f"llvm.fmuladd.v{kind.count}f64"
    function_type = ir.FunctionType(kind, [kind] * 3)
    insert: Any = cgutils.get_or_insert_function
    return builder.call(insert(builder.module, function_type, name), values)


def _fused() -> Any:
    settings: Any = numba.config
    if settings.DISABLE_JIT:
        return lambda a, b, c: a * b + c

    from numba.core import types

    def code(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return _multiply_add(builder, values[0].type, *values)

    @numba.extending.intrinsic
    def fused(_context: Any, _a: Any, _b: Any, _c: Any) -> Any:
        return types.float64(types.float64, types.float64, types.float64), code

    return fused


fused = _fused()
"""a b + c, with one rounding if the processor has a fused multiply-add."""


def pair_sums(signed: int, absolute: int) -> Any:
    """Return a function of kernels: (rows, i, states, k) -> several sums over the slots.

    The sums are sum(row[2i] a + row[2i + 1] b), sum(row[2i + 2] a + row[2i + 3] b), and so on,
    where (a, b) is the pair of a slot in state k, and rows are counted through all leading axes.
    The first `signed` sums are followed by `absolute` ones, of |a| and |b|.

    The terms of a and those of b have four partial sums each, in the order of the slots, and one
    more for the last slots, whose number is below four. The arrays are C-contiguous.
    """
    count = signed + absolute
    settings: Any = numba.config
    if settings.DISABLE_JIT:

        def plain(rows: Array, i: int, states: Array, k: int) -> tuple[float, ...]:
            n = rows.shape[-1]
            weights = rows.reshape(-1, n)[2 * i : 2 * (i + count)].reshape(count, 2, n)
            y = states[k, :, :n]
            return tuple(
                float((each * (y if m < signed else abs(y))).sum())
                for m, each in enumerate(weights)
            )

        return plain

    from llvmlite import ir
    from numba.core import cgutils, types

    tools: Any = cgutils
    tuple_of: Any = types.UniTuple
    number, whole = ir.DoubleType(), ir.IntType(64)

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        arrays = [
            context.make_array(signature.args[m])(context, builder, values[m]) for m in (0, 2)
        ]
        n, slots = (tools.unpack_tuple(builder, each.shape)[-1] for each in arrays)
        row = builder.mul(builder.mul(values[1], whole(2)), n)
        first = builder.mul(builder.mul(values[3], whole(2)), slots)
        begins = [builder.add(row, builder.mul(whole(m), n)) for m in range(2 * count)]
        weights = [builder.gep(arrays[0].data, [each]) for each in begins]
        pair = [builder.gep(arrays[1].data, [builder.add(first, m)]) for m in (whole(0), slots)]

        def partial(kind: Any, begin: Any, end: Any, by: int) -> list[Any]:
            function_type = ir.FunctionType(kind, [kind])
            name = "llvm.fabs.f64" if kind == number else f"llvm.fabs.v{_LANES}f64"
            size = tools.get_or_insert_function(builder.module, function_type, name)
            sums = [
                tools.alloca_once_value(builder, ir.Constant(kind, [0.0] * by if by > 1 else 0.0))
                for _ in range(2 * count)
            ]
            with tools.for_range_slice(builder, begin, end, whole(by), whole) as (at, _):

                def load(base: Any) -> Any:
                    place = builder.bitcast(builder.gep(base, [at]), kind.as_pointer())
                    return builder.load(place, align=8)

                numbers = [load(each) for each in pair]
                sizes = [builder.call(size, [each]) for each in numbers]
                for m, (weight, total) in enumerate(zip(weights, sums, strict=True)):
                    value = (numbers if m < 2 * signed else sizes)[m % 2]
                    now = _multiply_add(builder, kind, load(weight), value, builder.load(total))
                    builder.store(now, total)
            found = [builder.load(each) for each in sums]
            return [builder.fadd(*found[m : m + 2]) for m in range(0, 2 * count, 2)]

        even = builder.and_(n, whole(-_LANES))
        vectors = partial(ir.VectorType(number, _LANES), whole(0), even, _LANES)
        rests = partial(number, even, n, 1)
        totals = []
        for vector, rest in zip(vectors, rests, strict=True):
            a, b, c, d = (builder.extract_element(vector, whole(m)) for m in range(_LANES))
            total = builder.fadd(builder.fadd(a, c), builder.fadd(b, d))
            totals.append(builder.fadd(total, rest))
        return context.make_tuple(builder, signature.return_type, totals)

    @numba.extending.intrinsic
    def sums(_context: Any, rows: Any, _i: Any, states: Any, _k: Any) -> Any:
        if not rows.layout == states.layout == "C":
            return None
        return tuple_of(types.float64, count)(rows, types.intp, states, types.intp), code

    return sums
