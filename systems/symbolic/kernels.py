"""Loops over iterates of maps; the machine code of a map is called by its address."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynkit.core.jit import kernel
from dynkit.core.stretching_kernels import carry
from dynkit.core.validation import Array
from dynkit.systems.symbolic.call_kernels import call


@kernel(entry=True)
def apply(code: Any, state: Array, parameters: Array, out: Array) -> None:
    """Fill `out`, modified in place, by one call of the code."""
    call(code, state, parameters, out)


@kernel(entry=True)
def apply_all(code: Any, states: Array, parameters: Array, out: Array) -> None:
    """Fill each row of `out` (n, m), modified in place, by a call for the row of states (n, d)."""
    for i in range(len(states)):
        call(code, states[i], parameters, out[i])


@kernel(entry=True)
def iterate(code: Any, parameters: Array, states: Array) -> int:
    """Fill rows 1, 2, ... of states (n + 1, d), modified in place, by iterates of row 0.

    Returns
    -------
    int
        Number of the first row that is not finite, where the loop stops; zero if all are finite.
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
    """Carry a frame along iterates, see `dynkit.core.stretching_kernels.carry`.

    Parameters
    ----------
    code
        Fills `room` with the next state, (d,), and below it the Jacobian, (d, d).
    parameters : (m,) array
    state : (d,) array
        Modified in place: the last state.
    frame : (d, k) array
        Modified in place: its columns are orthonormal.
    accuracy : float
        Error of an entry of the Jacobian, relative to its norm.
    room : (d + 1, d) array
        Modified in place.
    logs, errors : (n, k) arrays
        Modified in place: logarithms of lengths, and their errors.

    Returns
    -------
    int
        Number of the first iterate that is not finite, where the loop stops; zero if there is none.
    """
    d = len(state)
    moved = room[1:]
    for i in range(len(logs)):
        call(code, state, parameters, room)
        for k in range(d):
            state[k] = room[0, k]
        if not _finite(state):
            return i + 1
        size = 0.0
        for j in range(d):
            for k in range(d):
                size += moved[j, k] * moved[j, k]
        carry(moved, frame, accuracy * np.sqrt(size), 0, logs[i], errors[i])
    return 0


@kernel()
def _finite(state: Array) -> bool:
    found = True
    for x in state:
        found = found and np.isfinite(x)
    return found
