"""Floquet multipliers: eigenvalues of long products of matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg.lapack import dgeev, dgeqrf, dorgqr

from dynkit.core.validation import Array, finite_array

PROBES = 4
"""Number of random disturbances of factors for the errors of eigenvalues of their product."""

MARGIN = 4.0
"""Safety factor of these errors: a few random disturbances seldom reach the worst case."""

# Number of rounds of orthogonal iteration before the periodic QR algorithm: they order the
# eigenvalues by descending modulus.
_ROUNDS = 2


def product_eigenvalues(factors: Any) -> Any:
    """Return the eigenvalues of a product A_n ... A_1 of real matrices, which is never formed.

    They are exact for factors that differ by rounding relative to the norm of each. Where the
    factors are well conditioned, small and large eigenvalues have the same relative accuracy,
    whatever their ratio and the number of factors. For a single factor LAPACK's `dgeev` is used.

    Parameters
    ----------
    factors : (n, d, d) array_like
        The factors in the order of time, A_1 first.

    Returns
    -------
    (d,) complex array
        The largest modulus first. Complex ones form exact conjugate pairs, the positive imaginary
        part first. Beyond the range of floats they are infinite or zero.

    Raises
    ------
    ValueError
        When the factors are not finite or not square matrices, or there are none.

    References
    ----------
    A. Bojanczyk, G. H. Golub, P. Van Dooren, The periodic Schur decomposition, Proc. SPIE 1770
    (1992) 31-42. K. Lust, Improved numerical Floquet multipliers, Int. J. Bifurcation and Chaos 11
    (2001) 2389-2410.

    Examples
    --------
    >>> turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    >>> product_eigenvalues([turn, np.diag([4.0, 1.0])])
    array([0.+2.j, 0.-2.j])
    >>> product_eigenvalues([np.diag([1e20, 1e-20])] * 3)
    array([1.e+60+0.j, 1.e-60+0.j])
    """
    a = finite_array("factors", factors, (None, None, None))
    n, d, width = a.shape
    if n == 0 or d == 0 or d != width:
        raise ValueError(f"factors must be square matrices, one at least; got shape {a.shape}")
    if n == 1:
        values = _of_one(a[0])
        return values[np.lexsort((-values.imag, -values.real, -abs(values)))]
    _, sizes = np.frexp(abs(a).max(axis=(1, 2)))
    a = np.ldexp(a, -sizes[:, None, None])
    mantissas, exponents = _of_numbers(a[:, 0, 0]) if d == 1 else _by_periodic_qr(a)
    exponents = exponents + int(sizes.sum())
    with np.errstate(divide="ignore"):
        order = np.log2(abs(mantissas)) + exponents
    order = np.lexsort((-mantissas.imag, -mantissas.real, -order))
    mantissas, exponents = mantissas[order], exponents[order]
    with np.errstate(over="ignore", under="ignore"):
        return np.ldexp(mantissas.real, exponents) + 1j * np.ldexp(mantissas.imag, exponents)


def disturbed_eigenvalues(factors: Array, errors: Array, random: np.random.Generator) -> Any:
    """Return the `product_eigenvalues` of factors whose entries are disturbed at random.

    The disturbances are uniform within the errors, (n,), of the factors.
    """
    changes = random.uniform(-1.0, 1.0, factors.shape)
    return product_eigenvalues(factors + errors[:, None, None] * changes)


def _of_one(factor: Array) -> Any:
    """Return the eigenvalues of one matrix, in the order of LAPACK."""
    real, imaginary, _, _, failed = dgeev(factor, compute_vl=0, compute_vr=0)
    if failed:
        raise ArithmeticError("the QR algorithm must converge; it did not")
    return real + 1j * imaginary


def _of_numbers(numbers: Array) -> tuple[Any, Any]:
    """Return the mantissa, (1,) complex, and the exponent of two, (1,), of a product of numbers."""
    mantissa, exponent = 1.0, 0
    for number in numbers.tolist():
        mantissa, more = np.frexp(mantissa * number)
        exponent += int(more)
    return np.array([mantissa], dtype=complex), np.array([exponent])


def _by_periodic_qr(a: Array) -> tuple[Any, Any]:
    """Return mantissas, (d,) complex, and exponents of two, (d,)."""
    from dynkit.orbits.multiplier_kernels import eigenvalues

    n, d, _ = a.shape
    basis = np.eye(d)
    for _ in range(_ROUNDS):
        for factor in a:
            basis, _ = _qr(factor @ basis)
    t = np.zeros((n, d, d))
    turned, upper = basis, np.triu(np.ones((d, d)))
    for k in range(n - 1):
        turned, triangle = _qr(a[k] @ turned)
        np.multiply(triangle, upper, out=t[k])
    t[n - 1] = basis.T @ (a[n - 1] @ turned)
    mantissas, exponents = np.empty(d, dtype=complex), np.empty(d, dtype=np.int64)
    buffers = np.empty((3, 3)), np.empty(d), np.empty(d)
    if eigenvalues(t, mantissas, exponents, *buffers):
        raise ArithmeticError("the periodic QR algorithm must converge; it did not")
    return mantissas, exponents


def _qr(matrix: Array) -> tuple[Array, Array]:
    """Return Q and, on and above the diagonal, R; numpy's function takes twice as long."""
    found, scales, _, _ = dgeqrf(matrix)
    basis, _, _ = dorgqr(found, scales)
    return basis, found
