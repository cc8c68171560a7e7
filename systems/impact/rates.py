"""Coupled modes to the last bit of their shapes, and their rates beyond it."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from dynkit.systems.structure.double_double import (
    DoubleDouble,
    add,
    multiply,
    negative,
    two_product,
)
from dynkit.validation import Array

_Complex: TypeAlias = tuple[DoubleDouble, DoubleDouble]

_ITERATIONS = 3


def refined_modes(
    rates: Any, shapes: Any, mass: Array, damping: Array, stiffness: Array
) -> tuple[Any, Any, Any]:
    """Refine modes of M x'' + C x' + K x = 0 by Newton's iteration with exact residuals.

    Parameters
    ----------
    rates : (m,) complex array
        Computed eigenvalues.
    shapes : (N, m) complex array
        Positions of the modes, one column each.

    Returns
    -------
    rates, low : (m,) complex arrays
        The double nearest to each rate, and what it lacks.
    shapes : (N, m) complex array

    References
    ----------
    J. J. Dongarra, C. B. Moler, J. H. Wilkinson, Improving the accuracy of computed eigenvalues and
    eigenvectors, SIAM J. Numer. Anal. 20 (1983) 23-45.
    """
    n, count = shapes.shape
    rates, shapes = np.array(rates, dtype=complex), np.array(shapes, dtype=complex)
    low, shapes_low = np.zeros_like(rates), np.zeros_like(shapes)
    for _ in range(_ITERATIONS):
        residual = _residual((rates, low), (shapes, shapes_low), (mass, damping, stiffness))
        system = np.zeros((count, n + 1, n + 1), dtype=complex)
        each = rates[:, None, None]
        system[:, :n, :n] = each * each * mass + each * damping + stiffness
        slope = 2.0 * rates * (mass @ shapes) + damping @ shapes
        system[:, :n, n] = slope.T
        system[:, n, :n] = shapes.T.conj()
        right = np.concatenate([-residual, np.zeros((1, count))]).T[..., None]
        try:
            step = np.linalg.solve(system, right)[..., 0]
        except np.linalg.LinAlgError:  # modes agree: told by the condition number of all of them
            return rates, low, shapes
        rates, low = _sum(rates, low, step[:, n])
        shapes, shapes_low = _sum(shapes, shapes_low, step[:, :n].T)
    return rates, low, shapes


def _sum(high: Any, low: Any, step: Any) -> tuple[Any, Any]:
    """High and low parts of ``high + low + step``."""
    parts = [
        add(DoubleDouble(h, e), DoubleDouble(s, np.zeros_like(s)))
        for h, e, s in ((high.real, low.real, step.real), (high.imag, low.imag, step.imag))
    ]
    return parts[0].high + 1j * parts[1].high, parts[0].low + 1j * parts[1].low


def _residual(rates: Any, shapes: Any, matrices: tuple[Array, Array, Array]) -> Any:
    """The (N, m) residuals (rate^2 M + rate C + K) shape, summed in double-double."""
    rate, shape = _parts(*rates), _parts(*shapes)
    mass, damping, stiffness = (_matmul(matrix, shape) for matrix in matrices)
    inner = _product(rate, mass)
    inner = add(inner[0], damping[0]), add(inner[1], damping[1])
    outer = _product(rate, inner)
    return add(outer[0], stiffness[0]).high + 1j * add(outer[1], stiffness[1]).high


def _parts(high: Any, low: Any) -> _Complex:
    """Real and imaginary part of a complex array given as high and low parts."""
    return DoubleDouble(high.real, low.real), DoubleDouble(high.imag, low.imag)


def _product(x: _Complex, y: _Complex) -> _Complex:
    return (
        add(multiply(x[0], y[0]), negative(multiply(x[1], y[1]))),
        add(multiply(x[0], y[1]), multiply(x[1], y[0])),
    )


def _matmul(matrix: Array, columns: _Complex) -> _Complex:
    """Product of a matrix of doubles with complex columns."""
    out = []
    for part in columns:
        total = DoubleDouble(np.zeros_like(part.high), np.zeros_like(part.low))
        for j in range(matrix.shape[1]):
            rows = np.flatnonzero(matrix[:, j])
            product = two_product(matrix[rows, j, None], part.high[j])
            product = DoubleDouble(product.high, product.low + matrix[rows, j, None] * part.low[j])
            added = add(DoubleDouble(total.high[rows], total.low[rows]), product)
            total.high[rows], total.low[rows] = added
        out.append(total)
    return out[0], out[1]
