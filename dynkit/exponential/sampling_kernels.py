"""States of pairs at given times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.evaluation_kernels import (
    FOUND,
    START,
    Ladder,
    Workspace,
    propagate_steps,
    shift,
    shift_linked,
)

Indices = NDArray[np.intp]


@kernel()
def fly(ladder: Ladder, n: int, e: float, states: Array) -> None:
    """Write the start state after n smallest steps and a time e into the found state."""
    last = states.shape[2]
    k = propagate_steps(ladder.step, ladder.links, ladder.link_step, n, states, 0, 0, last)
    shift(ladder.generator, e, states, k, FOUND, 0, last)
    if ladder.links.shape[0] > 0:
        shift_linked(ladder, e, states, k, FOUND)


@kernel(entry=True)
def sample(
    ladder: Ladder, starts: Array, which: Indices, durations: Array, work: Workspace, out: Array
) -> None:
    """Compute states after durations from starts; `out` and `work` are modified in place.

    Parameters
    ----------
    starts
        (k, 2, slots)
    which, durations
        (m,) index of the start, and duration, of each sample.
    out
        (m, 2, slots)
    """
    states = work.states
    for m in range(which.shape[0]):
        for i in range(starts.shape[2]):
            states[START, 0, i] = starts[which[m], 0, i]
            states[START, 1, i] = starts[which[m], 1, i]
        n = int(durations[m] / ladder.smallest)
        fly(ladder, n, durations[m] - n * ladder.smallest, states)
        for i in range(starts.shape[2]):
            out[m, 0, i] = states[FOUND, 0, i]
            out[m, 1, i] = states[FOUND, 1, i]
