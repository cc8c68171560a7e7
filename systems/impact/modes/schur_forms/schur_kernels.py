"""Real Schur form of a matrix, and exchange of its blocks, in double-double arithmetic.

A = Q T Q': T is upper triangular except for 2x2 blocks on its diagonal, Q is orthogonal. Every
matrix is stored as (2, n, n), high and low parts. Q is stored transposed, one Schur vector per row.

References
----------
J. G. F. Francis, The QR transformation II, Comput. J. 4 (1962) 332-345. Z. Bai, J. W. Demmel, On
swapping diagonal blocks in real Schur form, Linear Algebra Appl. 186 (1993) 73-95.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.double_double_kernels import dd_add, dd_multiply

ROUNDING = 2.0**-104
_MOST_STEPS = 90


class Scratch(NamedTuple):
    """Work arrays of the kernels: a vector, sums along rows, and a small linear system."""

    v: Array  # (2, n), n at least 5
    sums: Array  # (2, n)
    system: Array  # (2, 4, 5)
    order: Array  # (4,)
    solution: Array  # (2, 4)


@kernel()
def _divide(a: float, a_low: float, b: float, b_low: float) -> tuple[float, float]:
    first = a / b
    p, e = dd_multiply(first, 0.0, b, b_low)
    rest, rest_low = dd_add(a, a_low, -p, -e)
    return dd_add(first, 0.0, (rest + rest_low) / b, 0.0)


@kernel()
def _square_root(a: float, a_low: float) -> tuple[float, float]:
    if not a > 0.0:
        return 0.0, 0.0
    first = math.sqrt(a)
    p, e = dd_multiply(first, 0.0, first, 0.0)
    rest, rest_low = dd_add(a, a_low, -p, -e)
    return dd_add(first, 0.0, (rest + rest_low) / (2.0 * first), 0.0)


@kernel()
def _reflector(v: Array, m: int) -> tuple[float, float]:
    """Return b such that 1 - b v v' maps the first m numbers of `v` to (x, 0, ..).

    `v` is modified in place. b is 0 if the numbers have this form already.
    """
    largest = 0.0
    for i in range(1, m):
        largest = max(largest, abs(v[0, i]))
    if largest == 0.0:
        return 0.0, 0.0
    exponent = -math.frexp(max(largest, abs(v[0, 0])))[1]
    square, square_low = 0.0, 0.0
    for i in range(m):
        x = math.ldexp(v[0, i], exponent)
        x_low = math.ldexp(v[1, i], exponent)
        v[0, i], v[1, i] = x, x_low
        p, e = dd_multiply(x, x_low, x, x_low)
        square, square_low = dd_add(square, square_low, p, e)
    norm, norm_low = _square_root(square, square_low)
    if v[0, 0] < 0.0:
        v[0, 0], v[1, 0] = dd_add(v[0, 0], v[1, 0], -norm, -norm_low)
    else:
        v[0, 0], v[1, 0] = dd_add(v[0, 0], v[1, 0], norm, norm_low)
    p, e = dd_multiply(norm, norm_low, v[0, 0], v[1, 0])
    if p < 0.0:
        p, e = -p, -e
    return _divide(1.0, 0.0, p, e)


@kernel()
def _from_left(
    a: Array, v: Array, b: float, b_low: float, k: int, m: int, first: int, sums: Array
) -> None:
    """Reflect the rows k to k + m - 1 of `a`, columns from `first` on, in place."""
    n = a.shape[2]
    for j in range(first, n):
        sums[0, j] = 0.0
        sums[1, j] = 0.0
    for i in range(m):
        x, x_low = v[0, i], v[1, i]
        for j in range(first, n):
            p, e = dd_multiply(x, x_low, a[0, k + i, j], a[1, k + i, j])
            sums[0, j], sums[1, j] = dd_add(sums[0, j], sums[1, j], p, e)
    for i in range(m):
        x, x_low = dd_multiply(-b, -b_low, v[0, i], v[1, i])
        for j in range(first, n):
            p, e = dd_multiply(x, x_low, sums[0, j], sums[1, j])
            a[0, k + i, j], a[1, k + i, j] = dd_add(a[0, k + i, j], a[1, k + i, j], p, e)


@kernel()
def _from_right(a: Array, v: Array, b: float, b_low: float, k: int, m: int, last: int) -> None:
    """Reflect the columns k to k + m - 1 of `a`, rows before `last`, in place."""
    for i in range(last):
        s, s_low = 0.0, 0.0
        for j in range(m):
            p, e = dd_multiply(a[0, i, k + j], a[1, i, k + j], v[0, j], v[1, j])
            s, s_low = dd_add(s, s_low, p, e)
        s, s_low = dd_multiply(-b, -b_low, s, s_low)
        for j in range(m):
            p, e = dd_multiply(s, s_low, v[0, j], v[1, j])
            a[0, i, k + j], a[1, i, k + j] = dd_add(a[0, i, k + j], a[1, i, k + j], p, e)


@kernel()
def _reflect(t: Array, q: Array, scratch: Any, k: int, m: int, first: int, last: int) -> None:
    """Apply to `t` and `q`, in place, the reflection of m numbers in `scratch.v` to (x, 0, ..).

    The rows concerned of `t` are zero before column `first`, the columns from row `last` on.
    """
    v = scratch.v
    b, b_low = _reflector(v, m)
    if b != 0.0:
        _from_left(t, v, b, b_low, k, m, first, scratch.sums)
        _from_left(q, v, b, b_low, k, m, 0, scratch.sums)
        _from_right(t, v, b, b_low, k, m, last)


@kernel()
def _clear(t: Array, row: int, count: int, column: int) -> None:
    for i in range(row, row + count):
        t[0, i, column] = 0.0
        t[1, i, column] = 0.0


@kernel()
def _hessenberg(t: Array, q: Array, start: int, scratch: Any) -> None:
    n, v = t.shape[1], scratch.v
    for k in range(start, n - 2):
        m = n - k - 1
        for i in range(m):
            v[0, i], v[1, i] = t[0, k + 1 + i, k], t[1, k + 1 + i, k]
        _reflect(t, q, scratch, k + 1, m, k, n)
        _clear(t, k + 2, m - 1, k)


@kernel()
def _split(t: Array, q: Array, k: int, scratch: Any) -> None:
    """Make the 2x2 block at k triangular, in place, if its eigenvalues are real."""
    v = scratch.v
    half, half_low = dd_add(t[0, k, k], t[1, k, k], -t[0, k + 1, k + 1], -t[1, k + 1, k + 1])
    half, half_low = 0.5 * half, 0.5 * half_low
    p, e = dd_multiply(half, half_low, half, half_low)
    r, r_low = dd_multiply(t[0, k, k + 1], t[1, k, k + 1], t[0, k + 1, k], t[1, k + 1, k])
    p, e = dd_add(p, e, r, r_low)
    if p < 0.0:
        return
    root, root_low = _square_root(p, e)
    if half < 0.0:
        root, root_low = -root, -root_low
    v[0, 0], v[1, 0] = dd_add(half, half_low, root, root_low)
    v[0, 1], v[1, 1] = t[0, k + 1, k], t[1, k + 1, k]
    _reflect(t, q, scratch, k, 2, k, k + 2)
    _clear(t, k + 1, 1, k)


@kernel()
def _first_column(t: Array, low: int, high: int, exceptional: bool, v: Array) -> None:
    """First column of (T - s)(T - s') in rows and columns `low` to `high`, s and s' the shifts."""
    a, a_low = t[0, high - 1, high - 1], t[1, high - 1, high - 1]
    d, d_low = t[0, high, high], t[1, high, high]
    trace, trace_low = dd_add(a, a_low, d, d_low)
    p, e = dd_multiply(a, a_low, d, d_low)
    r, r_low = dd_multiply(
        t[0, high - 1, high], t[1, high - 1, high], t[0, high, high - 1], t[1, high, high - 1]
    )
    determinant, determinant_low = dd_add(p, e, -r, -r_low)
    if exceptional:
        size = abs(t[0, high, high - 1]) + abs(t[0, high - 1, high - 2])
        trace, trace_low = 1.5 * size, 0.0
        determinant, determinant_low = size * size, 0.0
    x, x_low = t[0, low, low], t[1, low, low]
    p, e = dd_add(x, x_low, -trace, -trace_low)
    y, y_low = dd_add(p, e, t[0, low + 1, low + 1], t[1, low + 1, low + 1])
    p, e = dd_multiply(x, x_low, p, e)
    p, e = dd_add(p, e, determinant, determinant_low)
    p, e = _divide(p, e, t[0, low + 1, low], t[1, low + 1, low])
    v[0, 0], v[1, 0] = dd_add(p, e, t[0, low, low + 1], t[1, low, low + 1])
    v[0, 1], v[1, 1] = y, y_low
    v[0, 2], v[1, 2] = t[0, low + 2, low + 1], t[1, low + 2, low + 1]


@kernel(entry=True)
def real_schur(t: Array, q: Array, start: int, scratch: Any) -> int:
    """Bring `t` to real Schur form and transform the rows of `q` with it, both in place.

    Rows and columns before `start` are triangular already. 2x2 blocks have complex eigenvalues.
    Returns 0, or the number of the row where the iteration stalled.
    """
    n, v = t.shape[1], scratch.v
    _hessenberg(t, q, start, scratch)
    norm = 0.0
    for i in range(n):
        for j in range(n):
            norm = max(norm, abs(t[0, i, j]))
    high: int = n - 1
    steps = 0
    while high > start:
        low = high
        while low > start:
            size = abs(t[0, low - 1, low - 1]) + abs(t[0, low, low])
            if size == 0.0:
                size = norm
            if abs(t[0, low, low - 1]) <= ROUNDING * size:
                _clear(t, low, 1, low - 1)
                break
            low -= 1
        if low >= high - 1:
            if low == high - 1:
                _split(t, q, low, scratch)
            high = low - 1
            steps = 0
            continue
        steps += 1
        if steps > _MOST_STEPS:
            return high
        _first_column(t, low, high, steps % 10 == 0, v)
        for k in range(low, high):
            m = min(3, high - k + 1)
            if k > low:
                for i in range(m):
                    v[0, i], v[1, i] = t[0, k + i, k - 1], t[1, k + i, k - 1]
            _reflect(t, q, scratch, k, m, max(k - 1, low), min(k + 4, high + 1))
            if k > low:
                _clear(t, k + 1, m - 1, k - 1)
    return 0


@kernel()
def _sylvester(t: Array, k: int, p: int, after: int, m: int, system: Array) -> float:
    """Equations A X - X B = C for the blocks A (p, p) at k and B (m, m) at `after` of `t`.

    C is the block of `t` right of A and above B. `system` is modified in place: the coefficients of
    X, row by row, are in its first columns, and C is in column 4. Returns the largest absolute
    element of the blocks.
    """
    size = 0.0
    for i in range(p):
        for j in range(p):
            size = max(size, abs(t[0, k + i, k + j]))
        for j in range(m):
            size = max(size, abs(t[0, k + i, after + j]))
    for i in range(m):
        for j in range(m):
            size = max(size, abs(t[0, after + i, after + j]))
    for part in range(2):
        for row in range(4):
            for column in range(5):
                system[part, row, column] = 0.0
    for i in range(p):
        for j in range(m):
            row = i * m + j
            for other in range(p):
                system[0, row, other * m + j] = t[0, k + i, k + other]
                system[1, row, other * m + j] = t[1, k + i, k + other]
            for other in range(m):
                x, x_low = t[0, after + other, after + j], t[1, after + other, after + j]
                column = i * m + other
                system[0, row, column], system[1, row, column] = dd_add(
                    system[0, row, column], system[1, row, column], -x, -x_low
                )
            system[0, row, 4], system[1, row, 4] = t[0, k + i, after + j], t[1, k + i, after + j]
    return size


@kernel()
def _solve(system: Array, count: int, least: float, order: Array, solution: Array) -> None:
    """Solve `count` equations by elimination with complete pivoting, in place.

    Pivots below `least` are replaced by it: if both blocks have equal eigenvalues, any solution
    with a small residual serves.
    """
    for k in range(count):
        order[k] = k
    for k in range(count):
        row, column, largest = k, k, -1.0
        for i in range(k, count):
            for j in range(k, count):
                if abs(system[0, i, j]) > largest:
                    row, column, largest = i, j, abs(system[0, i, j])
        for part in range(2):
            for j in range(5):
                other = system[part, row, j]
                system[part, row, j] = system[part, k, j]
                system[part, k, j] = other
            for i in range(count):
                other = system[part, i, column]
                system[part, i, column] = system[part, i, k]
                system[part, i, k] = other
        unknown = order[column]
        order[column] = order[k]
        order[k] = unknown
        if largest < least:
            system[0, k, k], system[1, k, k] = least, 0.0
        for i in range(k + 1, count):
            f, f_low = _divide(system[0, i, k], system[1, i, k], system[0, k, k], system[1, k, k])
            for j in range(k + 1, 5):
                p, e = dd_multiply(-f, -f_low, system[0, k, j], system[1, k, j])
                system[0, i, j], system[1, i, j] = dd_add(system[0, i, j], system[1, i, j], p, e)
    for k in range(count - 1, -1, -1):
        s, s_low = system[0, k, 4], system[1, k, 4]
        for j in range(k + 1, count):
            p, e = dd_multiply(system[0, k, j], system[1, k, j], system[0, j, 4], system[1, j, 4])
            s, s_low = dd_add(s, s_low, -p, -e)
        s, s_low = _divide(s, s_low, system[0, k, k], system[1, k, k])
        system[0, k, 4], system[1, k, 4] = s, s_low
        solution[0, order[k]], solution[1, order[k]] = s, s_low


@kernel(entry=True)
def swap(t: Array, q: Array, k: int, p: int, m: int, scratch: Any) -> None:
    """Exchange the blocks (p, p) at k and (m, m) after it of a Schur form, in place."""
    v, x, basis = scratch.v, scratch.solution, scratch.system
    size = _sylvester(t, k, p, k + p, m, scratch.system)
    _solve(scratch.system, p * m, max(ROUNDING * size, 1e-300), scratch.order, x)
    # The columns of (-X; 1) span the invariant subspace of the second block.
    for j in range(m):
        for i in range(p):
            basis[0, i, j], basis[1, i, j] = -x[0, i * m + j], -x[1, i * m + j]
        for i in range(m):
            basis[0, p + i, j], basis[1, p + i, j] = 1.0 if i == j else 0.0, 0.0
    for j in range(m):
        rows = p + m - j
        for i in range(rows):
            v[0, i], v[1, i] = basis[0, j + i, j], basis[1, j + i, j]
        b, b_low = _reflector(v, rows)
        if b != 0.0:
            _from_left(basis, v, b, b_low, j, rows, j + 1, scratch.sums)
            _from_left(t, v, b, b_low, k + j, rows, k, scratch.sums)
            _from_left(q, v, b, b_low, k + j, rows, 0, scratch.sums)
            _from_right(t, v, b, b_low, k + j, rows, k + p + m)
    for j in range(m):
        _clear(t, k + m, p, k + j)
