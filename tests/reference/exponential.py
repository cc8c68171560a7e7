"""Matrix exponentials of many digits: those of flint are some twenty times faster than mpmath's."""

from __future__ import annotations

from typing import Any, Final

import flint
from mpmath import mp

MORE: Final = 64
"""Bits beyond those of mpmath."""


def expm(matrix: Any) -> Any:
    """Exponential of an mpmath matrix, to the precision of mpmath.

    Raises
    ------
    ValueError
        When the radius of an entry is not below that precision, over the largest entry.
    """
    n = matrix.rows
    before, flint.ctx.prec = flint.ctx.prec, mp.prec + MORE
    try:
        numbers = [flint.arb(_exact(mp.mpf(number))) for number in matrix]
        found = flint.arb_mat(n, n, numbers).exp()
        entries = [found[i, k] for i in range(n) for k in range(n)]
        largest = max(abs(float(entry.mid())) for entry in entries)
        if not max(float(entry.rad()) for entry in entries) <= largest * 2.0**-mp.prec:
            raise ValueError("matrix must have an exponential that flint resolves")
        middles = [+mp.ldexp(*map(int, entry.mid().man_exp())) for entry in entries]
        return mp.matrix([middles[i * n : (i + 1) * n] for i in range(n)])
    finally:
        flint.ctx.prec = before


def _exact(number: Any) -> tuple[int, int]:
    """Mantissa and exponent."""
    mantissa, exponent = number.man_exp
    return (-mantissa if number < 0 else mantissa), exponent
