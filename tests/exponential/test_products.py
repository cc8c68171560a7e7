"""Sums of products: those of all digits, in one order."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.product_kernels import pair_sums

_sums = pair_sums(1, 1)


@kernel(entry=True)
def _two(rows: Array, i: int, states: Array, k: int) -> tuple[float, float]:
    signed, absolute = _sums(rows, i, states, k)
    return signed, absolute


def in_order(terms: Array) -> float:
    """Sum of terms (2, n) in the order that the kernels promise."""
    even = terms.shape[1] // 4 * 4
    a, b = terms[:, :even].reshape(2, -1, 4).cumsum(axis=1)[:, -1] if even else np.zeros((2, 4))
    rest = sum(np.append(terms[:, even:], np.zeros((2, 1)), axis=1).cumsum(axis=1)[:, -1])
    lanes = a + b
    return float(((lanes[0] + lanes[2]) + (lanes[1] + lanes[3])) + rest)


@pytest.mark.plain
@pytest.mark.parametrize("slots", [1, 4, 7, 11, 40])
def test_sums_have_one_order(slots: int) -> None:
    rng = np.random.default_rng(slots)
    states = rng.standard_normal((3, 2, slots + 2))
    # powers of two: the products are exact, with and without fused operations
    rows = rng.choice([-2.0, -0.5, 1.0, 4.0], (2, 6, slots))
    found = _two(rows, 4, states, 1)
    y = states[1, :, :slots]
    exact = in_order(rows[1, 2:4] * y), in_order(rows[1, 4:] * abs(y))
    assert found == pytest.approx(exact, rel=1e-14, abs=1e-14)
    settings: Any = numba.config
    if not settings.DISABLE_JIT:
        assert found == exact
