"""Preparation of exponential sums for the kernels: bounds and the propagation ladder."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, localcontext
from math import factorial
from typing import Any

import numpy as np

from dynkit.validation import Array

LANES = 8
"""Slots are padded to a multiple of this, for vector instructions throughout."""

MAXIMUM_RUNGS = 61

LARGEST = 1e60
"""No entry of a generator may exceed this, lest the bounds of derivatives overflow."""

SEPARATE = 1.1
"""Beyond this damping ratio the two real exponentials of an oscillator are kept apart."""


def padded(count: int) -> int:
    """Number of slots for `count` terms."""
    return -(-count // LANES) * LANES


@dataclass(frozen=True)
class Pairs:
    """The terms of exponential sums over one set of exponents: y_k' = G_k y_k, two numbers each.

    Attributes
    ----------
    generator, generator_low
        (4, n) entries 11, 12, 21, 22 of G and their low parts (double-double).
    scale
        (n,) factor s_k such that the norm of (y_1, s_k y_2) never grows; 0 marks two separate real
        exponentials (G diagonal).
    """

    generator: Array
    generator_low: Array
    scale: Array

    @property
    def count(self) -> int:
        """Number of pairs."""
        return self.scale.size

    @staticmethod
    def join(*parts: Pairs) -> Pairs:
        """All pairs of the parts, one after the other."""
        return Pairs(
            np.concatenate([p.generator for p in parts], axis=1),
            np.concatenate([p.generator_low for p in parts], axis=1),
            np.concatenate([p.scale for p in parts]),
        )

    @staticmethod
    def oscillators(
        frequency: Array, frequency_low: Array, decay: Array, decay_low: Array
    ) -> tuple[Pairs, Array | None]:
        """Pairs of q'' + 2 decay q' + frequency^2 q = 0, both given as double-double.

        Returns
        -------
        pairs
            (q, q') through critical damping, two real exponentials beyond it.
        mixing
            (2, 2, n) matrices that give (q, q') from the pairs; None when all of them are 1.
        """
        n = frequency.size
        generator, low = np.zeros((4, n)), np.zeros((4, n))
        scale = np.zeros(n)
        mixing = np.zeros((2, 2, n))
        mixing[0, 0] = mixing[1, 1] = 1.0
        separate = decay > SEPARATE * frequency
        with localcontext() as context:
            context.prec = 50
            for k in range(n):
                w = Decimal(float(frequency[k])) + Decimal(float(frequency_low[k]))
                sigma = Decimal(float(decay[k])) + Decimal(float(decay_low[k]))
                if separate[k]:
                    fast = sigma + (sigma * sigma - w * w).sqrt()
                    slow = w * w / fast
                    entries = {0: -slow, 3: -fast}
                    mixing[:, :, k] = [[1.0, 1.0], [-float(slow), -float(fast)]]
                else:
                    entries = {1: Decimal(1), 2: -w * w, 3: -2 * sigma}
                    scale[k] = 1.0 / float(w)
                for i, entry in entries.items():
                    generator[i, k] = float(entry)
                    low[i, k] = float(entry - Decimal(float(entry)))
        return Pairs(generator, low, scale), mixing if separate.any() else None

    @staticmethod
    def rotation(frequency: float) -> Pairs:
        """One pair (sine, cosine) of the angular frequency `frequency`."""
        return Pairs(
            np.array([[0.0], [frequency], [-frequency], [0.0]]), np.zeros((4, 1)), np.ones(1)
        )

    def derivative_rows(self, row: Array, order: int) -> Array:
        """Row (2, n) of the derivative of that order, from the row (2, n) of the value."""
        g = self.generator
        for _ in range(order):
            row = np.stack([row[0] * g[0] + row[1] * g[2], row[0] * g[1] + row[1] * g[3]])
        return row

    def bound(self, row: Array, order: int) -> Array:
        """Weights (2, n) of abs(y) that bound the derivative of that order at all later times."""
        row = self.derivative_rows(row, order)
        together = self.scale > 0.0
        scale = np.where(together, self.scale, 1.0)
        norm = np.hypot(row[0], row[1] / scale)
        return np.stack(
            [np.where(together, norm, abs(row[0])), np.where(together, norm * scale, abs(row[1]))]
        )

    def rates(self) -> tuple[Array, Array]:
        """Largest and smallest absolute eigenvalue of each G, (n,) each.

        Raises
        ------
        ValueError
            When the fourth powers of the rates would overflow.
        """
        g = self.generator
        largest = float(np.abs(g).max(initial=0.0))
        if not largest <= LARGEST:
            raise ValueError(
                f"squared frequencies and damping rates must not exceed {LARGEST:g}; got {largest}"
            )
        half_trace = 0.5 * (g[0] + g[3])
        determinant = g[0] * g[3] - g[1] * g[2]
        discriminant = half_trace * half_trace - determinant
        root = np.sqrt(np.abs(discriminant))
        real = discriminant >= 0.0
        fast = np.where(real, np.abs(half_trace) + root, np.sqrt(np.abs(determinant)))
        slow = np.where(real, np.abs(determinant) / np.where(fast > 0.0, fast, 1.0), fast)
        return fast, slow


def rung_sizes(pairs: Pairs) -> tuple[float, int]:
    """Smallest step (a power of two with every abs(lambda) h <= REACH) and number of rungs."""
    from dynkit.exponential.evaluation_kernels import REACH

    fast, slow = pairs.rates()
    fastest = max(float(fast.max(initial=0.0)), 1e-300)
    slowest = float(slow[slow > 0.0].min(initial=fastest))
    smallest = 2.0 ** np.floor(np.log2(REACH / fastest))
    rungs = int(np.ceil(np.log2(8.0 * np.pi / slowest / smallest))) + 1
    return float(smallest), min(max(rungs, 2), MAXIMUM_RUNGS)


def _pad(rows: Array, slots: int) -> Array:
    out = np.zeros((*rows.shape[:-1], slots))
    out[..., : rows.shape[-1]] = rows
    return out


def cell_bounds(pairs: Pairs, row: Array, smallest: float, rungs: int) -> tuple[Array, int]:
    """Weights (rungs, 2, n) of the quintic Hermite error, and the last rung with h^6 throughout.

    The error of a term is at most h^6/46080 sup |f^(6)|, and at most 2 sup |f| + 2/5 h sup |f'| +
    h^2/20 sup |f''| (the Bernstein coefficients of the polynomial).
    """
    h = smallest * 2.0 ** np.arange(rungs)[:, None, None]
    with np.errstate(over="ignore", invalid="ignore"):
        smooth = pairs.bound(row, 6) * h**6 / 46080.0
    cap = (
        2.0 * pairs.bound(row, 0)
        + 0.4 * h * pairs.bound(row, 1)
        + 0.05 * h * h * pairs.bound(row, 2)
    )
    return np.fmin(smooth, cap), int(np.sum(np.all(smooth <= cap, axis=(1, 2)))) - 1


def steps(pairs: Pairs, smallest: float, rungs: int) -> Array:
    """(rungs, 8, slots) propagators over ``smallest * 2**j``."""
    from dynkit.exponential.double_double_kernels import fill_steps

    slots = padded(pairs.count)
    step = np.zeros((rungs, 8, slots))
    fill_steps(
        _pad(pairs.generator, slots),
        _pad(pairs.generator_low, slots),
        smallest,
        0,
        pairs.count,
        step,
        np.empty((4, 8)),
    )
    return step


def ladder(
    pairs: Pairs, row: Array, offset: float, smallest: float, step: Array, steady: int, swing: float
) -> Any:
    """The exponential sum ``offset + row . y`` as the kernels take it."""
    from dynkit.exponential.evaluation_kernels import DEGREE, Ladder

    rungs, _, slots = step.shape
    rows = _pad(np.concatenate([pairs.derivative_rows(row, order) for order in range(4)]), slots)
    with np.errstate(over="ignore", invalid="ignore"):
        last = pairs.bound(row, DEGREE + 1) / factorial(DEGREE + 1)
    bounds = np.concatenate([pairs.bound(row, 0), pairs.bound(row, 4), last])
    weights, smooth = cell_bounds(pairs, row, smallest, rungs)
    cell = np.empty((rungs, 8, slots))
    for k in range(0, 6, 2):
        cell[:, k] = rows[k] * step[:, 0] + rows[k + 1] * step[:, 2]
        cell[:, k + 1] = rows[k] * step[:, 1] + rows[k + 1] * step[:, 3]
    cell[:, 6:] = _pad(weights, slots)
    g = _pad(pairs.generator, slots)
    return Ladder(
        step,
        cell,
        rows,
        _pad(bounds, slots),
        g,
        np.stack([g[0] + g[3], g[0] * g[3] - g[1] * g[2]]),
        float(offset),
        float(smallest),
        smooth,
        bool(np.any(pairs.scale == 0.0)),
        steady,
        float(swing),
    )
