"""Starts of the runs that ask whether a motion depends on where it began."""

from __future__ import annotations

from math import pi

from dynkit.systems import ImpactChain, ImpactState

# At rest: amplitudes of the first two modes, and phase of the table over 2 pi.
_STARTS = (
    (1.0, 0.0, 0.0),
    (0.5, 0.0, 0.0),
    (0.1, 0.0, 0.0),
    (1.0, 0.0, 0.25),
    (0.7, 0.1, 0.0),
    (0.4, 0.2, 0.5),
    (0.8, -0.2, 0.6),
    (0.3, 0.0, 0.75),
    (1.5, 0.3, 0.9),
)

STARTS = len(_STARTS)
"""How many there are."""


def starts(chain: ImpactChain, count: int = STARTS) -> list[ImpactState]:
    """Return the first of the starts, of which the first is the paper's."""
    modes = chain.modal_matrix
    return [
        chain.state(first * modes[:, 0] + second * modes[:, 1], phase=2.0 * pi * turn)
        for first, second, turn in _STARTS[:count]
    ]


def named(number: int) -> str:
    """Return what a start is."""
    first, second, turn = _STARTS[number]
    parts = f"{first:g}" if not second else f"{first:g} and {second:g}"
    return f"mode amplitude {parts}, phase {turn:g} of a turn"
