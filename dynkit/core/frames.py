"""Growth of a frame of directions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynkit.core.validation import Array


def stretched(steps: Sequence[Sequence[Any]], frame: Array) -> tuple[Array, Array]:
    """Carry a frame (d, k) by n steps, in place; return the logs (n, k) of its growth and errors.

    A step has factors (m, d, d) and errors (m,) of their entries. It may also have the number of
    directions that are known to be lost in each factor: see `stretching_kernels.carry`.
    """
    from dynkit.core.stretching_kernels import decompose

    factors, off = (np.concatenate([step[i] for step in steps]) for i in range(2))
    counts = [len(step[0]) for step in steps]
    lost = np.repeat([step[2] if len(step) > 2 else 0 for step in steps], counts)
    logs, errors = np.empty((2, len(factors), frame.shape[1]))
    decompose(np.ascontiguousarray(factors), off, lost, frame, logs, errors)
    first = np.cumsum([0, *counts[:-1]])
    logs, errors = (np.add.reduceat(each, first, axis=0) for each in (logs, errors))
    # a length of zero is exact
    errors[np.isneginf(logs)] = 0.0
    return logs, errors
