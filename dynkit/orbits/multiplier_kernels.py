"""The periodic QR algorithm: eigenvalues of a product of matrices that is never formed."""

import math
from typing import Any

import numpy as np

from dynkit.core.jit import kernel

_EPSILON = 2.0**-52
# An entry below the diagonal is negligible relative to the smaller neighbour on the diagonal; after
# _STRICT steps without such an entry relative to their sum, after _NEIGHBOURS relative to the norm.
_STRICT, _NEIGHBOURS, _MOST = 12, 30, 200


@kernel(inline=True)
def rotation(a: complex, b: complex) -> tuple[float, complex]:
    """Return c, s with [[c, s], [-conj(s), c]] (a, b) = (r, 0), unitary, c real."""
    if b == 0.0:
        return 1.0, 0.0j
    x, y = abs(a), abs(b)
    if x == 0.0:
        return 0.0, np.conj(b) / y
    h = math.hypot(x, y)
    return x / h, (a / x) * (np.conj(b) / h)


@kernel(inline=True)
def turn_rows(m: Any, i: int, c: float, s: complex, first: int, last: int) -> None:
    """Multiply rows i, i + 1 by the rotation, in columns first to last; in place."""
    for j in range(first, last + 1):
        above, below = m[i, j], m[i + 1, j]
        m[i, j] = c * above + s * below
        m[i + 1, j] = c * below - np.conj(s) * above


@kernel(inline=True)
def turn_columns(m: Any, i: int, c: float, s: complex, first: int, last: int) -> None:
    """Multiply columns i, i + 1 by the rotation's inverse, in rows first to last; in place."""
    for j in range(first, last + 1):
        left, right = m[j, i], m[j, i + 1]
        m[j, i] = c * left + np.conj(s) * right
        m[j, i + 1] = c * right - s * left


@kernel()
def pass_on(t: Any, i: int, c: float, s: complex, low: int, high: int, reach: int) -> None:
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
def pass_back(t: Any, i: int, c: float, s: complex, low: int, high: int) -> None:
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

    Rotations end at the zero: a step without shift from the top clears the entry below the diagonal
    before it, and a step from the bottom that after it.
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


@kernel(inline=True)
def scaled(z: complex) -> tuple[complex, int]:
    """Return z divided by a power of two near its modulus, and the exponent."""
    size = abs(z)
    if size == 0.0 or not size < math.inf:
        return z, 0
    _, e = math.frexp(size)
    # in two steps, as the power itself may overflow
    half = e // 2
    return z * math.ldexp(1.0, -half) * math.ldexp(1.0, half - e), e


@kernel()
def shift(t: Any, high: int, low: int, w: Any, exceptional: bool) -> tuple[complex, int]:
    """Return an eigenvalue of the product's last two rows and columns, over 2^e, and e.

    `w`, (3, 3), is overwritten.
    """
    last = t.shape[0] - 1
    base = max(low, high - 2)
    size = high - base + 1
    for r in range(size):
        for q in range(size):
            w[r, q] = 1.0 if r == q else 0.0
    e = 0
    for k in range(last):
        largest = 0.0
        for r in range(size):
            for q in range(r, size):
                entry = 0.0j
                for p in range(r, q + 1):
                    entry += t[k, base + r, base + p] * w[p, q]
                w[r, q] = entry
                largest = max(largest, abs(entry))
        if largest == 0.0:
            return 0.0j, 0
        _, more = math.frexp(largest)
        e += more
        for r in range(size):
            for q in range(r, size):
                w[r, q] *= math.ldexp(1.0, -more)
    h = t[last]
    a = b = c = d = 0.0j
    for p in range(size):
        a += h[high - 1, base + p] * w[p, size - 2]
        b += h[high - 1, base + p] * w[p, size - 1]
        c += h[high, base + p] * w[p, size - 2]
        d += h[high, base + p] * w[p, size - 1]
    if exceptional:
        return d + 0.75 * abs(c) * (1.0 + 0.5j), e
    half = 0.5 * (a - d)
    root = np.sqrt(half * half + b * c)
    large = half + root if abs(half + root) >= abs(half - root) else half - root
    if large == 0.0:
        return d, e
    value = d - b * c / large
    # without shift a large eigenvalue moves above a small one: in this order both remain accurate
    if abs(a + d - value) < 1e-4 * abs(value):
        return 0.0j, e
    return value, e


@kernel()
def sweep(t: Any, low: int, high: int, w: Any, exceptional: bool) -> None:
    """Take one step of the algorithm in rows and columns low to high; in place."""
    last = t.shape[0] - 1
    h = t[last]
    product, e = 1.0 + 0.0j, 0
    for k in range(last):
        product, more = scaled(product * t[k, low, low])
        e += more
    value, its = shift(t, high, low, w, exceptional)
    largest = max(e, its)
    product *= math.ldexp(1.0, max(e - largest, -2000))
    value *= math.ldexp(1.0, max(its - largest, -2000))
    x, y = h[low, low] * product, h[low + 1, low] * product
    # a shift that is much larger than the product's first column would remove all its digits
    if abs(value) < 1e8 * (abs(x) + abs(y)):
        x -= value
    else:
        x, y = h[low, low], h[low + 1, low]
    c, s = rotation(x, y)
    turn_rows(h, low, c, s, low, high)
    pass_on(t, low, c, s, low, high, min(low + 2, high))
    for i in range(low + 1, high):
        c, s = rotation(h[i, i - 1], h[i + 1, i - 1])
        turn_rows(h, i, c, s, i - 1, high)
        h[i + 1, i - 1] = 0.0
        pass_on(t, i, c, s, low, high, min(i + 2, high))


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
    (1992) 31-42; here in complex arithmetic with single shifts.

    Parameters
    ----------
    t : (n, d, d) complex
        Overwritten.
    mantissas, exponents : (d,) complex and int64
        Overwritten: the eigenvalues are mantissas 2^exponents.
    w : (3, 3) complex
    cosines, sines : (d,) float and complex
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
    while high > 0:
        low = high
        while low > 0 and not negligible(h, low, steps, norm):
            low -= 1
        if low > 0:
            h[low, low - 1] = 0.0
        if low == high:
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
        if steps == _MOST:
            return 1
        steps += 1
        sweep(t, low, high, w, steps % 10 == 0)
    for j in range(d):
        z, e = scaled(h[j, j])
        for k in range(last):
            z, more = scaled(z * t[k, j, j])
            e += more
        mantissas[j], exponents[j] = z, e
    return 0


@kernel(entry=True)
def pair_conjugates(order: Any, mantissas: Any, exponents: Any) -> None:
    """Round eigenvalues to real numbers and exact conjugate pairs, in place.

    Each, in the given order (d,), is paired with the nearest one left that is its conjugate within
    the change that makes both of them real. The order is overwritten: -1 for each that is done.
    """
    for first in range(order.shape[0]):
        i = order[first]
        if i < 0:
            continue
        here, other, least = mantissas[i], -1, math.inf
        for later in range(first + 1, order.shape[0]):
            j = order[later]
            if j < 0 or not mantissas[j].imag * here.imag < 0.0:
                continue
            apart = exponents[j] - exponents[i]
            if abs(apart) <= 1:
                there = np.conj(mantissas[j]) * 2.0**apart
                distance = abs(there - here)
                if distance < min(least, abs(here.imag) + abs(there.imag)):
                    other, least = later, distance
        if other < 0:
            mantissas[i] = complex(math.copysign(abs(here), here.real), 0.0)
            continue
        j = order[other]
        order[other] = -1
        there = np.conj(mantissas[j]) * 2.0 ** (exponents[j] - exponents[i])
        mantissas[i] = 0.5 * (here + there)
        mantissas[j] = np.conj(mantissas[i])
        exponents[j] = exponents[i]
