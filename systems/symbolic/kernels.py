"""Loops over iterates of maps whose machine code is called by its address."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynkit.core.jit import kernel
from dynkit.core.stretching import CLEAR
from dynkit.core.validation import Array
from dynkit.systems.symbolic.call_kernels import call


@kernel(entry=True)
def apply(code: Any, state: Array, parameters: Array, out: Array) -> None:
    """Fill out, modified in place, by one call."""
    call(code, state, parameters, out)


@kernel(entry=True)
def apply_all(code: Any, states: Array, parameters: Array, out: Array) -> None:
    """Fill each row of out (n, m), modified in place, by a call for that row of states (n, d)."""
    for i in range(len(states)):
        call(code, states[i], parameters, out[i])


@kernel(entry=True)
def iterate(code: Any, parameters: Array, states: Array) -> int:
    """Fill rows 1, 2, ... of states (n + 1, d), modified in place, by iterates of row 0.

    Returns
    -------
    int
        The first row that is not finite, at which it stops; zero where all are.
    """
    for i in range(1, len(states)):
        call(code, states[i - 1], parameters, states[i])
        if not _finite(states[i]):
            return i
    return 0


@kernel(entry=True)
def stretch(
    code: Any,
    parameters: Array,
    state: Array,
    frame: Array,
    accuracy: float,
    room: Array,
    logs: Array,
    errors: Array,
) -> int:
    """Carry a frame along iterates, as `dynkit.core.stretching.stretched` does.

    Parameters
    ----------
    code
        Fills the room with the next state, (d,), and below it the jacobian, (d, d).
    parameters : (m,) array
    state : (d,) array
        Modified in place: the last state.
    frame : (d, d) array
        Modified in place: its columns are orthonormal.
    accuracy : float
        Error of an entry of the jacobian, relative to its norm.
    room : (d + 1, d) array
        Modified in place.
    logs, errors : (n, d) arrays
        Modified in place: logarithms of lengths, and their errors.

    Returns
    -------
    int
        The first iterate that is not finite, at which it stops; zero where all are.
    """
    d = len(state)
    moved = room[1:]
    for i in range(len(logs)):
        call(code, state, parameters, room)
        for k in range(d):
            state[k] = room[0, k]
        if not _finite(state):
            return i + 1
        _stretch(moved, frame, accuracy, logs[i], errors[i])
    return 0


@kernel(entry=True)
def decompose(matrices: Array, accuracy: float, frame: Array, logs: Array, errors: Array) -> None:
    """Carry a frame (d, d) by matrices (n, d, d), as `stretch` does by jacobians.

    All but the accuracy are modified in place.
    """
    for i in range(len(matrices)):
        _stretch(matrices[i], frame, accuracy, logs[i], errors[i])


@kernel()
def _stretch(moved: Array, frame: Array, accuracy: float, logs: Array, errors: Array) -> None:
    """Carry a frame by a matrix; all but the accuracy are modified in place."""
    d = len(moved)
    error = 0.0
    for j in range(d):
        for k in range(d):
            error += moved[j, k] * moved[j, k]
    error = accuracy * np.sqrt(error)
    for j in range(d):
        _row_times(moved[j], frame, errors)
    _decompose(moved, frame, logs)
    for k in range(d):
        length = logs[k]
        logs[k] = np.log(length)
        errors[k] = error / length if length != 0.0 else 0.0
        if 0.0 < length <= CLEAR * error:
            logs[k] = np.nan


@kernel()
def _finite(state: Array) -> bool:
    found = True
    for x in state:
        found = found and np.isfinite(x)
    return found


@kernel()
def _row_times(row: Array, frame: Array, room: Array) -> None:
    """Multiply a row, modified in place, by a frame."""
    d = len(row)
    for k in range(d):
        total = 0.0
        for j in range(d):
            total += row[j] * frame[j, k]
        room[k] = total
    for k in range(d):
        row[k] = room[k]


@kernel()
def _decompose(matrix: Array, frame: Array, lengths: Array) -> None:
    """QR of a matrix (d, d): the frame is Q, the lengths are R's diagonal; all are modified.

    By Gram and Schmidt, each column twice where the first time leaves less than half of it: W.
    Hoffmann, Iterative algorithms for Gram-Schmidt orthogonalization, Computing 41 (1989) 335-348.
    """
    d = len(matrix)
    for k in range(d):
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
        for k in range(d):
            frame[j, k] = matrix[j, k]


@kernel()
def _complete(matrix: Array, k: int) -> None:
    """Make column k, modified in place, any direction orthogonal to those before it."""
    d = len(matrix)
    for place in range(d):
        for j in range(d):
            matrix[j, k] = 1.0 if j == place else 0.0
        _make_orthogonal(matrix, k)
        _make_orthogonal(matrix, k)
        size = _size(matrix, k)
        if size > 0.5 / d:  # one of the d unit vectors is as far from k others
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
    """The length of column k; where squares would vanish or overflow, too."""
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
