"""Averages over a motion, and how far they may be from those over an endless one."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np

from dynkit.validation import Array

BLOCKS, LEAST = 32, 128
"""Blocks of a series, and the fewest values it must have."""

_QUARTERS, _CLEAR, _FLOOR, _CORRELATED = 4, 0.01, 1e-9, 0.6


@final
class BlockAverages:
    """Time averages (k,) of a series (n, k), and functions of them, with errors.

    The series is cut into 32 blocks, and the scatter of their means gives the standard error, with
    a correction for what one block tells of the next. Where it tells much, the motion remembers
    for longer than a block, and is not `resolved`.

    A periodic or quasi-periodic motion is better averaged with a smooth weight that vanishes at
    both ends: the error then falls faster than any power of n. It is told from chaos by the
    weighted averages over the four quarters: they agree a hundred times better than the means of
    blocks do. Their largest distance from that of the whole is the error then.

    References
    ----------
    H. Flyvbjerg, H. G. Petersen, Error estimates on averages of correlated data, J. Chem. Phys. 91
    (1989) 461-466. S. Das, Y. Saiki, E. Sander, J. A. Yorke, Quantitative quasiperiodicity,
    Nonlinearity 30 (2017) 4111-4140 (the weight).
    """

    def __init__(self, series: Array) -> None:
        length = len(series) // BLOCKS
        tail = series[len(series) - BLOCKS * length :]
        self._blocks = tail.reshape(BLOCKS, length, -1).mean(axis=1)
        self._mean = self._blocks.mean(axis=0)
        scatter = self._blocks.std(axis=0, ddof=1)
        self._whole = _weighted(series)
        self._quarters = np.array([_weighted(q) for q in np.array_split(series, _QUARTERS)])
        floor = _FLOOR * abs(series).max(axis=0)
        spread = abs(self._quarters - self._whole).max(axis=0)
        self.regular = bool((spread <= np.maximum(_CLEAR * scatter, floor)).all())
        """Whether weighted averages converge as those of periodic motions and of tori do."""
        moving = scatter > floor
        correlation = _correlation(self._blocks[:, moving])
        self.resolved = self.regular or bool((correlation <= _CORRELATED).all())
        """Whether a block tells little enough of the next one, so that the errors hold."""

    def estimate(self, function: Callable[[Array], Array]) -> tuple[Array, Array]:
        """Return a function (m,) of the averages (k,), and its errors (m,).

        The standard error is that of the jackknife: from what is left when one block is left out.
        It is the larger, the more each block is like the one before.
        """
        if self.regular:
            value = function(self._whole)
            others = np.array([function(quarter) for quarter in self._quarters])
            return value, np.asarray(abs(others - value).max(axis=0))
        without = (BLOCKS * self._mean - self._blocks) / (BLOCKS - 1)
        parts = np.array([function(mean) for mean in without])
        error = np.sqrt((BLOCKS - 1) * parts.var(axis=0))
        # of a series that keeps this share of its last value
        share = np.clip(_correlation(parts), 0.0, _CORRELATED)
        return function(self._mean), np.asarray(error * np.sqrt((1.0 + share) / (1.0 - share)))


def _correlation(blocks: Array) -> Array:
    """Correlation (k,) of each block (b, k) with the one before; zero of what is constant."""
    gaps = blocks - blocks.mean(axis=0)
    square = (gaps * gaps).sum(axis=0)
    square[square == 0.0] = 1.0
    return np.asarray((gaps[1:] * gaps[:-1]).sum(axis=0) / square)


def _weighted(series: Array) -> Array:
    """Average (k,) with the weight exp(-1 / (t (1 - t))), 0 < t < 1."""
    t = (np.arange(len(series)) + 0.5) / len(series)
    weight = np.exp(-1.0 / (t * (1.0 - t)))
    return np.asarray((weight / weight.sum()) @ series)
