"""Double-double arithmetic, which must not be reordered, and propagators computed with it."""

from __future__ import annotations

from dynkit.core.jit import kernel
from dynkit.core.validation import Array


@kernel()
def two_product(a: float, b: float) -> tuple[float, float]:
    """Return a product and its rounding error (Dekker's algorithm)."""
    product = a * b
    t = 134217729.0 * a
    a_high = t - (t - a)
    a_low = a - a_high
    t = 134217729.0 * b
    b_high = t - (t - b)
    b_low = b - b_high
    return product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low


@kernel()
def dd_add(a: float, a_low: float, b: float, b_low: float) -> tuple[float, float]:
    """Return the sum of two double-double numbers."""
    s = a + b
    t = s - a
    e = (a - (s - t)) + (b - t) + a_low + b_low
    high = s + e
    return high, e - (high - s)


@kernel()
def dd_multiply(a: float, a_low: float, b: float, b_low: float) -> tuple[float, float]:
    """Return the product of two double-double numbers."""
    p, e = two_product(a, b)
    e += a * b_low + a_low * b
    high = p + e
    return high, e - (high - p)


@kernel()
def _dd_matmul(a: Array, b: Array, out: Array) -> None:
    """Multiply two 2x2 double-double matrices of 8 numbers each; `out` is modified in place."""
    for i in range(2):
        for j in range(2):
            p, p_low = dd_multiply(a[2 * i], a[4 + 2 * i], b[j], b[4 + j])
            q, q_low = dd_multiply(a[2 * i + 1], a[5 + 2 * i], b[2 + j], b[6 + j])
            out[2 * i + j], out[4 + 2 * i + j] = dd_add(p, p_low, q, q_low)


@kernel(entry=True)
def fill_steps(
    generator: Array,
    generator_low: Array,
    smallest: float,
    first: int,
    last: int,
    step: Array,
    work: Array,
) -> None:
    """Compute propagators of the slots `first` to `last` - 1 over every rung, in double-double.

    The method is a Taylor series over the smallest step, then repeated squaring. `step` and the
    scratch (4, 8) array `work` are modified in place.
    """
    scaled = work[0]
    term = work[1]
    total = work[2]
    product = work[3]
    for k in range(first, last):
        for i in range(4):
            scaled[i] = generator[i, k] * smallest
            scaled[4 + i] = generator_low[i, k] * smallest
            term[i] = 1.0 if i == 0 or i == 3 else 0.0
            term[4 + i] = 0.0
            total[i] = term[i]
            total[4 + i] = 0.0
        for order in range(1, 26):
            _dd_matmul(term, scaled, product)
            for i in range(4):
                # division by a small integer: the quotient, then the quotient of the remainder
                quotient = product[i] / order
                p, e = two_product(quotient, float(order))
                rest = ((product[i] - p) - e + product[4 + i]) / order
                term[i] = quotient + rest
                term[4 + i] = rest - (term[i] - quotient)
                total[i], total[4 + i] = dd_add(total[i], total[4 + i], term[i], term[4 + i])
        for j in range(step.shape[0]):
            for i in range(8):
                step[j, i, k] = total[i]
            _dd_matmul(total, total, product)
            for i in range(8):
                total[i] = product[i]


@kernel()
def _dense_product(
    a: Array, a_low: Array, b: Array, b_low: Array, out: Array, out_low: Array
) -> None:
    """Multiply two square double-double matrices; `out` and `out_low` are modified in place."""
    n = a.shape[0]
    for i in range(n):
        for j in range(n):
            total = 0.0
            low = 0.0
            for k in range(n):
                p, p_low = dd_multiply(a[i, k], a_low[i, k], b[k, j], b_low[k, j])
                total, low = dd_add(total, low, p, p_low)
            out[i, j] = total
            out_low[i, j] = low


@kernel(entry=True)
def fill_coupled_steps(
    generator: Array, generator_low: Array, smallest: float, step: Array, work: Array
) -> None:
    """Compute propagators (rungs, n, n) of coupled pairs over every rung, in double-double.

    The method is a Taylor series over the smallest step, then repeated squaring. `step` and the
    scratch (6, n, n) array `work` are modified in place.
    """
    n = generator.shape[0]
    term = work[0]
    term_low = work[1]
    total = work[2]
    total_low = work[3]
    for i in range(n):
        for j in range(n):
            term[i, j] = 1.0 if i == j else 0.0
            term_low[i, j] = 0.0
            total[i, j] = term[i, j]
            total_low[i, j] = 0.0
    for order in range(1, 40):
        _dense_product(term, term_low, generator, generator_low, work[4], work[5])
        for i in range(n):
            for j in range(n):
                # the product with the smallest step, a power of two, is exact
                value = work[4, i, j] * smallest
                quotient = value / order
                p, e = two_product(quotient, float(order))
                rest = ((value - p) - e + work[5, i, j] * smallest) / order
                term[i, j] = quotient + rest
                term_low[i, j] = rest - (term[i, j] - quotient)
                total[i, j], total_low[i, j] = dd_add(
                    total[i, j], total_low[i, j], term[i, j], term_low[i, j]
                )
    for rung in range(step.shape[0]):
        for i in range(n):
            for j in range(n):
                step[rung, i, j] = total[i, j]
        _dense_product(total, total_low, total, total_low, work[4], work[5])
        for i in range(n):
            for j in range(n):
                total[i, j] = work[4, i, j]
                total_low[i, j] = work[5, i, j]
