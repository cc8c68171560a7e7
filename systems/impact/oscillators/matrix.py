"""Impact oscillators given by their matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import finite_array
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.structure.modes import Derivation
from dynkit.systems.structure.symmetric import SymmetricMatrix, check_definite, check_semidefinite

if TYPE_CHECKING:
    import sympy


class _Mass(tuple[tuple[float, ...], ...]):
    """A mass matrix that was checked."""


class _Stiffness(tuple[tuple[float, ...], ...]):
    """A damping or stiffness matrix that was checked."""


@dataclass(frozen=True, kw_only=True)
class MatrixOscillator(ImpactOscillator):
    """An impact oscillator M x'' + C x' + K x = forces, given by its matrices.

    Parameters
    ----------
    M, C, K : (N, N) array_like
        Mass matrix, positive definite; damping and stiffness matrices, positive semidefinite. Each
        must be symmetric to N 2^-52 of its largest element, as products such as ``B.T @ K @ B``
        are; its symmetric part is used. A natural frequency that is zero to within the rounding of
        the elements of K is set to exactly zero (a rigid-body mode).
    frequency, ... : as for `ImpactOscillator`

    A subclass may add terms to the energies, such as ``super().potential(x) + x[0] ** 4``, for
    nonlinear springs.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    Examples
    --------
    Two masses tied to each other and to nothing else, the second one above a stop:

    >>> free = MatrixOscillator(
    ...     M=[[1, 0], [0, 1]], C=[[0, 0], [0, 0]], K=[[1, -1], [-1, 1]],
    ...     constant_forces=(-1, -1), amplitude=0, frequency=1,
    ... )
    >>> free.natural_frequencies
    array([0.        , 1.41421356])
    >>> record = free.simulate(impacts=100, start=free.state([2, 1]))
    >>> float(record.relative_velocity[0].round(6))
    1.492067
    """

    # Anything that can be converted to an array; stored as tuples of tuples.
    M: Any
    C: Any
    K: Any

    def __post_init__(self) -> None:
        size = None
        for name, checked in (("M", _Mass), ("C", _Stiffness), ("K", _Stiffness)):
            given = getattr(self, name)
            # the matrices of an oscillator that is made anew with another number
            if isinstance(given, checked) and size in (None, len(given)):
                size = len(given)
                continue
            matrix = finite_array(name, given, (size, size))
            size = len(matrix)
            if matrix.shape != (size, size) or not size:
                raise ValueError(f"{name} must be a square matrix; got shape {matrix.shape}")
            # elements [i, j] and [j, i] of a product are sums of N terms in different orders
            rounding = size * 2.0**-52 * float(abs(matrix).max())
            for i, j in np.argwhere(abs(matrix - matrix.T) > rounding)[:1].tolist():
                raise ValueError(
                    f"{name} must be symmetric; got {matrix[i, j]} at [{i}, {j}] and "
                    f"{matrix[j, i]} across; ({name} + {name}.T) / 2 is symmetric"
                )
            # Halves are taken only where the matrix is not symmetric: half of the smallest double
            # is rounded to zero.
            half = 0.5 * matrix + 0.5 * matrix.T
            matrix = np.where(matrix == matrix.T, matrix, half)
            (check_definite if name == "M" else check_semidefinite)(name, matrix)
            self._set(name, checked(map(tuple, matrix.tolist())))
        super().__post_init__()

    @property
    def degrees_of_freedom(self) -> int:
        return len(self.M)

    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return _form(self.M, v)

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return _form(self.K, x)

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return _form(self.C, v)

    def _derive(self) -> Derivation:
        if not self._has_energies(*_OWN):
            return super()._derive()
        m, c, k = (SymmetricMatrix.from_dense(np.array(a)) for a in (self.M, self.C, self.K))
        return Derivation(m, c, k, exact=False)


_OWN = MatrixOscillator.kinetic, MatrixOscillator.potential, MatrixOscillator.dissipation


def _form(matrix: tuple[tuple[float, ...], ...], z: tuple[sympy.Symbol, ...]) -> sympy.Expr:
    from sympy import Add

    rows = enumerate(matrix)
    return Add(*(e * z[i] * z[j] / 2 for i, row in rows for j, e in enumerate(row) if e))
