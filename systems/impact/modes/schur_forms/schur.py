"""Real Schur forms to 30 digits, with their blocks in any order.

With Schur forms in doubles, the errors of a motion would exceed their estimates for stiffness
ratios above 1e4, see docs/mathematics/errors.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from dynkit.systems.impact.modes.schur_forms.refinement import refined_schur
from dynkit.systems.structure.double_double import (
    DoubleDouble,
    add,
    column_sums,
    divide,
    multiply,
    negative,
    square_root,
)
from dynkit.systems.structure.symmetric import product

LARGE = 50
"""Order of a matrix from which refinement is faster than the QR iteration in double-double
arithmetic, and one substitution for all blocks is faster than exchanges for each block."""

# Largest element of a basis (X, 1): its orthonormalisation amplifies errors by this factor.
_STEEPEST = 2.0**20


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
        if n >= LARGE:
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

    def alone(self) -> dict[int, tuple[DoubleDouble, DoubleDouble]]:
        """The results of `lead` for single blocks, by number, without a change of their order.

        Blocks with nearly the eigenvalues of an earlier block are left out.
        """
        from dynkit.systems.impact.modes.schur_forms.schur_kernels import fill_subspaces

        w = np.zeros_like(self._t)
        fill_subspaces(self._t, w, self._scratch)
        sizes = [self.size[number] for number in self.order]
        starts = np.cumsum([0, *sizes[:-1]])
        steep = ~(np.maximum.reduceat(np.abs(w[0]).max(axis=0), starts) <= _STEEPEST)
        w[:, :, np.repeat(steep, sizes)] = 0.0
        vectors = product(DoubleDouble(*self._q.transpose(0, 2, 1).copy()), DoubleDouble(*w))
        found = {}
        for size in (1, 2):
            chosen = np.flatnonzero((np.array(sizes) == size) & ~steep)
            place = starts[chosen] + np.arange(size)[:, None]
            basis = DoubleDouble(*(part[:, place] for part in vectors))
            blocks = DoubleDouble(*(part[place[:, None], place] for part in self._t))
            own, matrices = _orthonormal(basis, blocks)
            for k, i in enumerate(chosen.tolist()):
                found[self.order[i]] = (
                    DoubleDouble(*(part[..., k].copy() for part in own)),
                    DoubleDouble(*(part[..., k].copy() for part in matrices)),
                )
        return found


def _orthonormal(basis: DoubleDouble, matrix: DoubleDouble) -> tuple[DoubleDouble, DoubleDouble]:
    """Orthonormal V = basis R^-1, and R matrix R^-1, R upper triangular.

    Shapes (n, m, count) and (m, m, count), m = 1 or 2.
    """
    first, *others = (DoubleDouble(*(x[:, j] for x in basis)) for j in range(basis.high.shape[1]))
    a = square_root(column_sums(multiply(first, first)))
    first = divide(first, _row(a))
    if not others:
        return _stacked([first], 1), matrix
    b = column_sums(multiply(first, others[0]))
    second = add(others[0], negative(multiply(first, _row(b))))
    c = square_root(column_sums(multiply(second, second)))
    second = divide(second, _row(c))
    p, q, r, t = (DoubleDouble(*(x[i, j] for x in matrix)) for i in (0, 1) for j in (0, 1))
    change = multiply(r, divide(b, a))
    p, apart = add(p, change), add(add(t, negative(p)), negative(change))
    q = divide(add(multiply(a, q), multiply(b, apart)), c)
    r, t = multiply(r, divide(c, a)), add(t, negative(change))
    turned = _stacked([_stacked([p, q], 0), _stacked([r, t], 0)], 0)
    return _stacked([first, second], 1), turned


def _row(x: DoubleDouble) -> DoubleDouble:
    return DoubleDouble(x.high[None], x.low[None])


def _stacked(parts: list[DoubleDouble], axis: int) -> DoubleDouble:
    return DoubleDouble(*(np.stack(part, axis=axis) for part in zip(*parts, strict=True)))
