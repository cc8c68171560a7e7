"""Slow, obvious modes in many digits, straight from a chain's masses and springs."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import mpmath
import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.structure.chain import Chain
from dynkit.systems.structure.modes import Modes

DIGITS = 60


def value(high: float, low: float) -> Any:
    """A double-double number in many digits."""
    return mpmath.mpf(float(high)) + mpmath.mpf(float(low))


def links_matrix(strengths: Sequence[float]) -> Any:
    """The matrix of the sum of k_i (x_i - x_{i-1})^2 / 2, assembled link by link."""
    size = len(strengths)
    matrix = mpmath.zeros(size)
    for i, strength in enumerate(strengths):
        k = mpmath.mpf(strength)
        matrix[i, i] += k
        if i > 0:
            matrix[i - 1, i - 1] += k
            matrix[i - 1, i] -= k
            matrix[i, i - 1] -= k
    return matrix


def chain_modes(chain: Chain) -> tuple[list[Any], Any]:
    """Natural frequencies, ascending, and the mass-normalised modal matrix (tip outwards)."""
    return _modes_of(tuple(chain.masses), tuple(chain.springs))


@cache
def _modes_of(masses: tuple[float, ...], springs: tuple[float, ...]) -> tuple[list[Any], Any]:
    size = len(masses)
    with mpmath.workdps(DIGITS):
        roots = [mpmath.sqrt(mpmath.mpf(mass)) for mass in masses]
        matrix = links_matrix(springs)
        for i in range(size):
            for j in range(size):
                matrix[i, j] /= roots[i] * roots[j]
        squared, vectors = mpmath.eigsy(matrix)
        for k in range(size):
            sign = 1 if vectors[size - 1, k] >= 0 else -1
            for i in range(size):
                vectors[i, k] *= sign / roots[i]
        # A rigid-body mode is zero up to the working precision.
        floor = mpmath.mpf(10) ** (10 - DIGITS) * squared[size - 1]
        return [mpmath.sqrt(s) if s > floor else mpmath.mpf(0) for s in squared], vectors


def chain_decay(chain: Chain, vectors: Any) -> list[Any]:
    """Half of the diagonal of the modal damping matrix."""
    with mpmath.workdps(DIGITS):
        modal = vectors.T * links_matrix(chain.dashpots) * vectors
        return [modal[k, k] / 2 for k in range(len(chain.masses))]


def uniform_frequencies(size: int) -> list[Any]:
    """Natural frequencies of N equal masses and springs: 2 sin((2i-1) pi / (2 (2N+1)))."""
    with mpmath.workdps(DIGITS):
        step = mpmath.pi / (2 * (2 * size + 1))
        return [2 * mpmath.sin((2 * i - 1) * step) for i in range(1, size + 1)]


def uniform_mode(size: int, number: int) -> list[Any]:
    """Mode `number` (from 1) of that chain: entries 2/sqrt(2N+1) sin((2i-1) j pi / (2N+1))."""
    with mpmath.workdps(DIGITS):
        factor = 2 / mpmath.sqrt(2 * size + 1)
        step = (2 * number - 1) * mpmath.pi / (2 * size + 1)
        entries = [factor * mpmath.sin(j * step) for j in range(1, size + 1)]
        return [entry * mpmath.sign(entries[-1]) for entry in entries]


def relative_errors(modes: Modes, exact: list[Any]) -> Array:
    """Errors of the double-double frequencies relative to them; 0 where both are 0."""
    with mpmath.workdps(DIGITS):
        pairs = zip(modes.frequencies, modes.frequencies_low, exact, strict=True)
        return np.array(
            [float(abs(value(high, low) - w) / w) if w else float(high) for high, low, w in pairs]
        )


def column_error(column: Array, exact: Sequence[Any]) -> float:
    """Largest error of a mode's entries relative to its largest entry, where signs are compared."""
    with mpmath.workdps(DIGITS):
        place = max(range(len(exact)), key=lambda i: abs(exact[i]))
        same = 1 if (exact[place] > 0) == (column[place] > 0) else -1
        pairs = zip(column, exact, strict=True)
        errors = (abs(value(found, 0.0) - same * entry) for found, entry in pairs)
        return float(max(errors) / abs(exact[place]))


def matrix_error(modes: Modes, vectors: Any) -> float:
    """Largest error of all modes' entries relative to the largest entry of each."""
    size = len(modes.frequencies)
    columns = ([vectors[i, k] for i in range(size)] for k in range(size))
    return max(column_error(modes.matrix[:, k], column) for k, column in enumerate(columns))
