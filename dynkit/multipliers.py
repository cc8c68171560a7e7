"""Floquet multipliers: eigenvalues of long products of matrices."""

from typing import Any

import numpy as np

from dynkit.validation import Array


def product_eigenvalues(factors: Array) -> Any:
    """Eigenvalues, (d,) complex, of a product A_n ... A_1 of matrices (n, d, d)."""
    product = np.eye(factors.shape[1])
    for factor in factors:
        product = factor @ product
    found = np.linalg.eigvals(product).astype(complex)
    return found[np.lexsort((-found.imag, -abs(found)))]
