"""Real Schur forms to 30 digits, with their blocks in any order.

With Schur forms in doubles, the errors of a motion would exceed their estimates for stiffness
ratios above 1e4, see docs/mathematics/errors.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from dynkit.systems.impact.modes.schur_forms.refinement import refined_schur
from dynkit.systems.structure.double_double import DoubleDouble
from dynkit.systems.structure.symmetric import product

_LARGE = 50
"""Order of a matrix from which refinement is faster than the QR iteration in double-double
arithmetic."""


@final
class SchurForm:
    """A matrix A = Q T Q', T with 1x1 blocks (real eigenvalues) and 2x2 blocks on its diagonal.

    Parameters
    ----------
    matrix : DoubleDouble, shape (n, n)
    start : int
        Rows and columns before this one are triangular already; their eigenvalues come first.

    Attributes
    ----------
    order : list
        Numbers of the blocks along the diagonal.
    size : list
        Size of each block, 1 or 2, by its number.
    """

    def __init__(self, matrix: DoubleDouble, start: int) -> None:
        from dynkit.systems.impact.modes.schur_forms.schur_kernels import Scratch, real_schur

        n = len(matrix.high)
        self._t = np.stack(matrix)
        self._q = np.stack([np.eye(n), np.zeros((n, n))])
        if n >= _LARGE:
            self._refine(matrix, start)
        room = max(n, 5)
        self._scratch = Scratch(
            np.zeros((2, room)),
            np.zeros((2, room)),
            np.zeros((2, 4, 5)),
            np.zeros(4, dtype=np.int64),
            np.zeros((2, 4)),
        )
        if real_schur(self._t, self._q, start, self._scratch):
            raise np.linalg.LinAlgError("the QR iteration did not converge")
        self.size: list[int] = []
        k = 0
        while k < n:
            self.size.append(2 if k + 1 < n and self._t[0, k + 1, k] != 0.0 else 1)
            k += self.size[-1]
        self.order = list(range(len(self.size)))

    def _refine(self, matrix: DoubleDouble, start: int) -> None:
        """Start from LAPACK's form, refined if this converges: few blocks are left to split."""
        rest = np.s_[start:, start:]
        refined = refined_schur(DoubleDouble(*(part[rest] for part in matrix)))
        if refined is None:
            return
        beside = product(DoubleDouble(*(part[:start, start:] for part in matrix)), refined[1])
        for part, form, vectors, above in zip((0, 1), *refined, beside, strict=True):
            self._t[part][rest], self._t[part, :start, start:] = form, above
            self._q[part][rest] = vectors.T

    def lead(self, numbers: Sequence[int]) -> tuple[DoubleDouble, DoubleDouble]:
        """Put blocks first, in the order given.

        Returns
        -------
        vectors : DoubleDouble, shape (n, m)
            Orthonormal basis V of their invariant subspace.
        matrix : DoubleDouble, shape (m, m)
            Restriction of A to this subspace, A V = V matrix.
        """
        from dynkit.systems.impact.modes.schur_forms.schur_kernels import swap

        for place, number in enumerate(numbers):
            for i in range(self.order.index(number), place, -1):
                first, second = self.order[i - 1 : i + 1]
                k = sum(self.size[other] for other in self.order[: i - 1])
                swap(self._t, self._q, k, self.size[first], self.size[second], self._scratch)
                self.order[i - 1 : i + 1] = second, first
        m = sum(self.size[number] for number in numbers)
        return (
            DoubleDouble(*self._q[:, :m].transpose(0, 2, 1).copy()),
            DoubleDouble(*self._t[:, :m, :m].copy()),
        )
