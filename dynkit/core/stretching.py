"""Stretching of a frame of directions along a motion, for Lyapunov exponents."""

from dataclasses import dataclass
from typing import Any, final

from dynkit.core.validation import Array

CLEAR = 1e3
"""A direction shorter than this many times its error has no logarithm (NaN): the logarithm would be
less accurate than 1e-3."""


@final
@dataclass(frozen=True, eq=False)
class Stretching:
    """Growth of a frame of d directions, made orthonormal again after each iterate or interval.

    Attributes
    ----------
    logs : (n, d) array
        Logarithms of the diagonal of R in the QR decomposition after each step. Minus infinity
        where the length is zero; NaN where the length is at most `CLEAR` times its error.
    errors : (n, d) array
        Estimates of the errors of the logarithms, to first order.
    times : (n,) array or None
        Duration of each step; None for a map without a time.
    state : (d,) array
        The state after the last step.
    frame : (d, k) array
        The frame after the last step, in the coordinates of the system that made it.
    final : start
        The start from which the motion, with this frame, continues: by default the state.
    """

    logs: Array
    errors: Array
    times: Array | None
    state: Array
    frame: Array
    final: Any = None

    def __post_init__(self) -> None:
        if self.final is None:
            object.__setattr__(self, "final", self.state)
