"""QR decompositions along a motion: growth of a frame of directions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.stretching import CLEAR
from dynkit.core.validation import Array


@kernel(entry=True)
def decompose(
    matrices: Array, off: Array, lost: NDArray[np.intp], frame: Array, logs: Array, errors: Array
) -> None:
    """Carry a frame (d, k) by matrices (n, d, d), one after the other, by `carry`.

    `off` (n,) are the errors of their entries, `lost` (n,) the numbers of lost directions. All
    other arrays are modified in place.
    """
    for i in range(len(matrices)):
        carry(matrices[i], frame, off[i], lost[i], logs[i], errors[i])


@kernel()
def carry(matrix: Array, frame: Array, error: float, lost: int, logs: Array, errors: Array) -> None:
    """Multiply a frame (d, k) by a matrix (d, d), and write the logarithms (k,) of the lengths.

    The columns of the frame are made orthonormal. The length of a direction is that of its part
    orthogonal to the directions before it. Its log is minus infinity where the length is zero, and
    NaN where the length is less than a thousand times `error`, the error of the matrix' entries.
    The `lost` shortest lengths are set to zero, because they are rounding errors. `errors` (k,) are
    those of the logs. All arrays are modified in place.
    """
    k = frame.shape[1]
    for row in matrix:
        _row_times(row, frame, logs)
    _decompose(matrix, frame, logs)
    for _ in range(min(lost, k)):
        shortest = -1
        for j in range(k):
            if logs[j] >= 0.0 and (shortest < 0 or logs[j] < logs[shortest]):
                shortest = j
        logs[shortest] = -1.0
    for j in range(k):
        length = max(logs[j], 0.0)
        logs[j] = np.log(length) if length != 0.0 else -np.inf
        errors[j] = error / length if length != 0.0 else 0.0
        if 0.0 < length <= CLEAR * error:
            logs[j] = np.nan


@kernel()
def _row_times(row: Array, frame: Array, room: Array) -> None:
    """Replace the first k numbers of a row (d,) by its product with a frame (d, k); in place.

    `room` (k,) is scratch.
    """
    d, count = frame.shape
    for k in range(count):
        total = 0.0
        for j in range(d):
            total += row[j] * frame[j, k]
        room[k] = total
    for k in range(count):
        row[k] = room[k]


@kernel()
def _decompose(matrix: Array, frame: Array, lengths: Array) -> None:
    """QR decomposition of k columns of a matrix (d, d): the frame is Q, the lengths R's diagonal.

    All arrays are modified in place. The method is Gram-Schmidt orthogonalization, repeated for a
    column of which less than half of the length remains: W. Hoffmann, Iterative algorithms for
    Gram-Schmidt orthogonalization, Computing 41 (1989) 335-348.
    """
    d, count = frame.shape
    for k in range(count):
        before = _size(matrix, k)
        _make_orthogonal(matrix, k)
        lengths[k] = _size(matrix, k)
        if lengths[k] < 0.5 * before:
            _make_orthogonal(matrix, k)
            lengths[k] = _size(matrix, k)
        if lengths[k] == 0.0:
            _complete(matrix, k)
        else:
            for j in range(d):
                matrix[j, k] /= lengths[k]
    for j in range(d):
        for k in range(count):
            frame[j, k] = matrix[j, k]


@kernel()
def _complete(matrix: Array, k: int) -> None:
    """Replace column k, in place, by a unit vector orthogonal to the columns before it."""
    d = len(matrix)
    for place in range(d):
        for j in range(d):
            matrix[j, k] = 1.0 if j == place else 0.0
        _make_orthogonal(matrix, k)
        _make_orthogonal(matrix, k)
        size = _size(matrix, k)
        if size > 0.5 / d:  # one of the d unit vectors has so large a part orthogonal to k others
            for j in range(d):
                matrix[j, k] /= size
            return


@kernel()
def _make_orthogonal(matrix: Array, k: int) -> None:
    """Make column k of a matrix, modified in place, orthogonal to those before it."""
    d = len(matrix)
    for column in range(k):
        along = 0.0
        for j in range(d):
            along += matrix[j, column] * matrix[j, k]
        for j in range(d):
            matrix[j, k] -= along * matrix[j, column]


@kernel()
def _size(matrix: Array, k: int) -> float:
    """Return the length of column k, also where squares would underflow or overflow."""
    total = 0.0
    for j in range(len(matrix)):
        total += matrix[j, k] * matrix[j, k]
    if 1e-250 < total < 1e250:
        return float(np.sqrt(total))
    largest, total = 0.0, 0.0
    for j in range(len(matrix)):
        largest = max(largest, abs(matrix[j, k]))
    if largest == 0.0 or not np.isfinite(largest):
        return largest
    for j in range(len(matrix)):
        total += (matrix[j, k] / largest) ** 2
    return float(largest * np.sqrt(total))
