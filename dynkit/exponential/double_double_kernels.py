"""Double-double arithmetic, never re-ordered, and the propagators made with it."""

from __future__ import annotations

from dynkit.compiled import kernel
from dynkit.validation import Array


@kernel()
def two_product(a: float, b: float) -> tuple[float, float]:
    """Product and its rounding error (Dekker)."""
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
    """Sum of two double-double numbers."""
    s = a + b
    t = s - a
    e = (a - (s - t)) + (b - t) + a_low + b_low
    high = s + e
    return high, e - (high - s)


@kernel()
def dd_multiply(a: float, a_low: float, b: float, b_low: float) -> tuple[float, float]:
    """Product of two double-double numbers."""
    p, e = two_product(a, b)
    e += a * b_low + a_low * b
    high = p + e
    return high, e - (high - p)


@kernel()
def _dd_matmul(a: Array, b: Array, out: Array) -> None:
    """Product of two 2x2 double-double matrices given as 8 numbers; `out` is modified in place."""
    for i in range(2):
        for j in range(2):
            p, p_low = dd_multiply(a[2 * i], a[4 + 2 * i], b[j], b[4 + j])
            q, q_low = dd_multiply(a[2 * i + 1], a[5 + 2 * i], b[2 + j], b[6 + j])
            out[2 * i + j], out[4 + 2 * i + j] = dd_add(p, p_low, q, q_low)


@kernel()
def fill_steps(
    generator: Array,
    generator_low: Array,
    smallest: float,
    first: int,
    last: int,
    step: Array,
    work: Array,
) -> None:
    """Propagators of the slots `first` to `last` - 1 over every rung, in double-double.

    Taylor series over the smallest step, then repeated squaring. `step` and the scratch (4, 8)
    array `work` are modified in place.
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
                # Division by a small integer: quotient, then the remainder's quotient.
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
