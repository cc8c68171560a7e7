"""The periodic QR algorithm: eigenvalues of a product of matrices that is never formed."""

import math
from typing import Any

from dynkit.core.jit import kernel

_EPSILON = 2.0**-52
# An entry below the diagonal is negligible if it is below _EPSILON times a reference: the smaller
# of its two neighbours on the diagonal; their sum after _STRICT steps without a negligible entry;
# the norm of the factor after _NEIGHBOURS steps. After _MOST steps the algorithm fails.
_STRICT, _NEIGHBOURS, _MOST = 12, 30, 200


@kernel(inline=True)
def rotation(a: float, b: float) -> tuple[float, float]:
    """Return c, s with [[c, s], [-s, c]] (a, b) = (r, 0)."""
    if b == 0.0:
        return 1.0, 0.0
    h = math.hypot(a, b)
    return a / h, b / h


@kernel(inline=True)
def turn_rows(m: Any, i: int, c: float, s: float, first: int, last: int) -> None:
    """Multiply rows i, i + 1 by the rotation, in columns first to last; in place."""
    for j in range(first, last + 1):
        above, below = m[i, j], m[i + 1, j]
        m[i, j] = c * above + s * below
        m[i + 1, j] = c * below - s * above


@kernel(inline=True)
def turn_columns(m: Any, i: int, c: float, s: float, first: int, last: int) -> None:
    """Multiply columns i, i + 1 by the rotation's inverse, in rows first to last; in place."""
    for j in range(first, last + 1):
        left, right = m[j, i], m[j, i + 1]
        m[j, i] = c * left + s * right
        m[j, i + 1] = c * right - s * left


@kernel()
def pass_on(t: Any, i: int, c: float, s: float, low: int, high: int, reach: int) -> None:
    """Carry a rotation of the last factor's rows i, i + 1 through all factors to its columns.

    All other factors remain triangular. The last factor's columns are rotated in rows low to reach.
    """
    last = t.shape[0] - 1
    for k in range(last):
        m = t[k]
        turn_columns(m, i, c, s, low, i + 1)
        c, s = rotation(m[i, i], m[i + 1, i])
        turn_rows(m, i, c, s, i, high)
        m[i + 1, i] = 0.0
    turn_columns(t[last], i, c, s, low, reach)


@kernel()
def pass_back(t: Any, i: int, c: float, s: float, low: int, high: int) -> None:
    """Carry a rotation of the last factor's columns i, i + 1 back through all to its rows."""
    last = t.shape[0] - 1
    for k in range(last - 1, -1, -1):
        m = t[k]
        turn_rows(m, i, c, s, i, high)
        c, s = rotation(m[i + 1, i + 1], m[i + 1, i])
        s = -s
        turn_columns(m, i, c, s, low, i + 1)
        m[i + 1, i] = 0.0
    turn_rows(t[last], i, c, s, i, high)


@kernel()
def to_hessenberg(t: Any) -> None:
    """Transform the last factor to a Hessenberg matrix; others remain triangular; in place."""
    last, d = t.shape[0] - 1, t.shape[1]
    h = t[last]
    for j in range(d - 2):
        for i in range(d - 2, j, -1):
            c, s = rotation(h[i, j], h[i + 1, j])
            turn_rows(h, i, c, s, j, d - 1)
            h[i + 1, j] = 0.0
            pass_on(t, i, c, s, 0, d - 1, d - 1)


@kernel()
def split_at_zero(t: Any, j: int, low: int, high: int, cosines: Any, sines: Any) -> None:
    """Split off a zero on the diagonal of a triangular factor, at j; in place.

    Rotations end at the zero. A step without shift from the top clears the last factor's entry left
    of the zero's place; for a zero at `low`, a step from the bottom clears the entry below it.
    """
    h = t[t.shape[0] - 1]
    if j > low:
        for i in range(low, j):
            c, s = rotation(h[i, i], h[i + 1, i])
            turn_rows(h, i, c, s, i, high)
            h[i + 1, i] = 0.0
            cosines[i], sines[i] = c, s
        for i in range(low, j):
            pass_on(t, i, cosines[i], sines[i], low, high, i + 1)
        h[j, j - 1] = 0.0
    else:
        for i in range(high - 1, low - 1, -1):
            c, s = rotation(h[i + 1, i + 1], h[i + 1, i])
            turn_columns(h, i, c, -s, low, i + 1)
            h[i + 1, i] = 0.0
            cosines[i], sines[i] = c, -s
        for i in range(high - 1, low - 1, -1):
            pass_back(t, i, cosines[i], sines[i], low, high)
        h[low + 1, low] = 0.0


@kernel()
def product_of_corners(t: Any, first: int, size: int, w: Any) -> int:
    """Write into w the product of the same diagonal blocks of the triangular factors, over 2^e.

    The blocks have `size` rows and columns from `first` on; the last factor is left out.

    Returns
    -------
    int
        The exponent e.
    """
    for r in range(size):
        for q in range(size):
            w[r, q] = 1.0 if r == q else 0.0
    e = 0
    for k in range(t.shape[0] - 1):
        largest = 0.0
        for r in range(size):
            for q in range(r, size):
                entry = 0.0
                for p in range(r, q + 1):
                    entry += t[k, first + r, first + p] * w[p, q]
                w[r, q] = entry
                largest = max(largest, abs(entry))
        _, more = math.frexp(largest)
        e += more
        for r in range(size):
            for q in range(r, size):
                w[r, q] *= math.ldexp(1.0, -more)
    return e


@kernel()
def shift(t: Any, high: int, low: int, w: Any, exceptional: bool) -> tuple[float, float, int]:
    """Return an eigenvalue of the product's last two rows and columns, over 2^e.

    It is x + iy, where y is zero or there is another one, x - iy. `w`, (3, 3), is overwritten.

    Returns
    -------
    x, y : float
    e : int
    """
    h = t[t.shape[0] - 1]
    base = max(low, high - 2)
    size = high - base + 1
    e = product_of_corners(t, base, size, w)
    a = b = c = d = 0.0
    for p in range(size):
        a += h[high - 1, base + p] * w[p, size - 2]
        b += h[high - 1, base + p] * w[p, size - 1]
        c += h[high, base + p] * w[p, size - 2]
        d += h[high, base + p] * w[p, size - 1]
    if exceptional:
        return d + 0.75 * abs(c), 0.375 * abs(c), e
    half = 0.5 * (a - d)
    square = half * half + b * c
    if square < 0.0:
        return 0.5 * (a + d), math.sqrt(-square), e
    large = half + math.copysign(math.sqrt(square), half)
    if large == 0.0:
        return d, 0.0, e
    value = d - b * c / large
    # without a shift a large eigenvalue moves above a small one; then both remain accurate
    if abs(a + d - value) < 1e-4 * abs(value):
        return 0.0, 0.0, e
    return value, 0.0, e


@kernel()
def sweep(t: Any, low: int, high: int, w: Any, exceptional: bool) -> None:
    """Take one step of the algorithm in rows and columns low to high; in place.

    A shift that is not real is taken together with its conjugate: the first column is that of
    (P - x)^2 + y^2, with three entries.
    """
    h = t[t.shape[0] - 1]
    re, im, its = shift(t, high, low, w, exceptional)
    e = product_of_corners(t, low, 2, w)
    largest = max(e, its)
    own = math.ldexp(1.0, max(e - largest, -2000))
    others = math.ldexp(1.0, max(its - largest, -2000))
    re, im = re * others, im * others
    x, y, z = h[low, low] * w[0, 0] * own, h[low + 1, low] * w[0, 0] * own, 0.0
    width = 1
    # a shift that is much larger than the product's first column would remove all its digits
    if not math.hypot(re, im) < 1e8 * (abs(x) + abs(y)):
        x, y = h[low, low], h[low + 1, low]
    elif im == 0.0:
        x -= re
    else:
        width = 2
        right = (h[low, low] * w[0, 1] + h[low, low + 1] * w[1, 1]) * own
        below = (h[low + 1, low] * w[0, 1] + h[low + 1, low + 1] * w[1, 1]) * own
        if low + 2 <= high:
            z = y * (h[low + 2, low + 1] * w[1, 1] * own)
        x, y = (x - re) ** 2 + im**2 + right * y, y * (x + below - 2.0 * re)
    for j in range(low - 1, high - 1):
        for i in range(min(j + width, high - 1), j, -1):
            if j >= low:
                c, s = rotation(h[i, j], h[i + 1, j])
            elif i > low:
                c, s = rotation(y, z)
                y = c * y + s * z
            else:
                c, s = rotation(x, y)
            turn_rows(h, i, c, s, max(j, low), high)
            if j >= low:
                h[i + 1, j] = 0.0
            pass_on(t, i, c, s, low, high, min(i + 1 + width, high))


@kernel(inline=True)
def negligible(h: Any, i: int, steps: int, norm: float) -> bool:
    """Return whether the entry below the diagonal in row i is negligible."""
    size, before, behind = abs(h[i, i - 1]), abs(h[i - 1, i - 1]), abs(h[i, i])
    if size == 0.0:
        return True
    if steps < _STRICT:
        return bool(size <= _EPSILON * min(before, behind))
    if steps < _NEIGHBOURS:
        return bool(size <= _EPSILON * (before + behind))
    return bool(size <= _EPSILON * norm)


@kernel(entry=True)
def eigenvalues(t: Any, mantissas: Any, exponents: Any, w: Any, cosines: Any, sines: Any) -> int:
    """Find the eigenvalues of t[n - 1] ... t[0]; all factors but the last are triangular.

    C. F. Van Loan, A general matrix eigenvalue algorithm, SIAM J. Numer. Anal. 12 (1975) 819-834;
    A. Bojanczyk, G. H. Golub, P. Van Dooren, The periodic Schur decomposition, Proc. SPIE 1770
    (1992) 31-42; here by rotations, with one shift for real and two for other eigenvalues.

    Parameters
    ----------
    t : (n, d, d) float
        Overwritten.
    mantissas, exponents : (d,) complex and int64
        Overwritten: the eigenvalues are mantissas 2^exponents.
    w : (3, 3) float
    cosines, sines : (d,) float
        Buffers.

    Returns
    -------
    int
        Zero; one where the algorithm did not converge.
    """
    last, d = t.shape[0] - 1, t.shape[1]
    to_hessenberg(t)
    h = t[last]
    norm = 0.0
    for i in range(d):
        for j in range(d):
            norm = max(norm, abs(h[i, j]))
    high, steps = d - 1, 0
    while high >= 0:
        low = high
        while low > 0 and not negligible(h, low, steps, norm):
            low -= 1
        if low > 0:
            h[low, low - 1] = 0.0
        if low == high:
            z, e = math.frexp(h[high, high])
            for k in range(last):
                z, more = math.frexp(z * t[k, high, high])
                e += more
            mantissas[high], exponents[high] = z, e
            high, steps = high - 1, 0
            continue
        zero = -1
        for k in range(last):
            for j in range(low, high + 1):
                if t[k, j, j] == 0.0:
                    zero = j
        if zero >= 0:
            split_at_zero(t, zero, low, high, cosines, sines)
            continue
        if low == high - 1:
            x, y, e = shift(t, high, low, w, False)
            if y > 0.0:
                mantissas[low], mantissas[high] = complex(x, y), complex(x, -y)
                exponents[low] = exponents[high] = e
                high, steps = high - 2, 0
                continue
        if steps == _MOST:
            return 1
        steps += 1
        sweep(t, low, high, w, steps % 10 == 0)
    return 0
