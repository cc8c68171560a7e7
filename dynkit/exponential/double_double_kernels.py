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
def _multiply(a: Array, a_low: Array, b: Array, b_low: Array, out: Array, out_low: Array) -> None:
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
def fill_steps(
    generator: Array,
    generator_low: Array,
    smallest: float,
    orders: int,
    first: int,
    last: int,
    step: Array,
    work: Array,
) -> None:
    """Compute propagators of the systems `first` to `last` - 1 over every rung, in double-double.

    The method is a Taylor series over the smallest step, then repeated squaring. Generators are
    (n, n, systems). `step` (rungs, 2, n, n, systems), high and low parts, and the scratch array
    `work` (8, n, n) are modified in place.
    """
    n = generator.shape[0]
    scaled, scaled_low, term, term_low = work[0], work[1], work[2], work[3]
    total, total_low, product, product_low = work[4], work[5], work[6], work[7]
    for k in range(first, last):
        for i in range(n):
            for j in range(n):
                # the product with the smallest step, a power of two, is exact
                scaled[i, j] = generator[i, j, k] * smallest
                scaled_low[i, j] = generator_low[i, j, k] * smallest
                term[i, j] = total[i, j] = 1.0 if i == j else 0.0
                term_low[i, j] = total_low[i, j] = 0.0
        for order in range(1, orders):
            _multiply(term, term_low, scaled, scaled_low, product, product_low)
            for i in range(n):
                for j in range(n):
                    # division by a small integer: the quotient, then the quotient of the remainder
                    quotient = product[i, j] / order
                    p, e = two_product(quotient, float(order))
                    rest = ((product[i, j] - p) - e + product_low[i, j]) / order
                    term[i, j] = quotient + rest
                    term_low[i, j] = rest - (term[i, j] - quotient)
                    total[i, j], total_low[i, j] = dd_add(
                        total[i, j], total_low[i, j], term[i, j], term_low[i, j]
                    )
        for rung in range(step.shape[0]):
            for i in range(n):
                for j in range(n):
                    step[rung, 0, i, j, k] = total[i, j]
                    step[rung, 1, i, j, k] = total_low[i, j]
            _multiply(total, total_low, total, total_low, product, product_low)
            total, total_low, product, product_low = product, product_low, total, total_low
