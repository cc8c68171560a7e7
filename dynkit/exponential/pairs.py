"""The terms of exponential sums, two numbers each, and bounds of what becomes of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from decimal import Decimal, localcontext
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynkit.validation import Array

LARGEST = 1e60
"""No entry of a generator may exceed this, lest the bounds of derivatives overflow."""

SEPARATE = 1.1
"""Beyond this damping ratio the two real exponentials of an oscillator are kept apart."""


@dataclass(frozen=True)
class Pairs:
    """Terms y_k of two numbers each, y_k' = G_k y_k + sum over links B y_source.

    Attributes
    ----------
    generator, generator_low
        (4, n) entries 11, 12, 21, 22 of G and their low parts (double-double).
    scale
        (n,) factor s_k such that the norm of (y_1, s_k y_2) never grows by itself; 0 marks two
        separate numbers: G diagonal, or (position, velocity) of a rigid body.
    links
        (2, L) targets and sources; no chain of links leads back to where it began.
    coupling
        (4, L) entries 11, 12, 21, 22 of their B.
    """

    generator: Array
    generator_low: Array
    scale: Array
    links: NDArray[np.intp] = field(default_factory=lambda: np.empty((2, 0), dtype=np.intp))
    coupling: Array = field(default_factory=lambda: np.empty((4, 0)))

    @property
    def count(self) -> int:
        """Number of pairs."""
        return self.scale.size

    @cached_property
    def grows(self) -> bool:
        """Whether a term may grow beyond all bounds."""
        parts = self._growing_parts
        return parts is not None and not np.isfinite(_majorant(*parts[2:], math.inf)).all()

    @staticmethod
    def join(*parts: Pairs) -> Pairs:
        """All pairs of the parts, one after the other."""
        before = np.cumsum([0, *(p.count for p in parts)])
        return Pairs(
            np.concatenate([p.generator for p in parts], axis=1),
            np.concatenate([p.generator_low for p in parts], axis=1),
            np.concatenate([p.scale for p in parts]),
            np.concatenate([p.links + b for p, b in zip(parts, before, strict=False)], axis=1),
            np.concatenate([p.coupling for p in parts], axis=1),
        )

    def linked(self, links: Any, coupling: Array) -> Pairs:
        """The same pairs with more links, (2, L) and (4, L)."""
        return Pairs(
            self.generator,
            self.generator_low,
            self.scale,
            np.concatenate([self.links, np.asarray(links, dtype=np.intp)], axis=1),
            np.concatenate([self.coupling, coupling], axis=1),
        )

    def placed(self, slots: NDArray[np.intp], count: int) -> Pairs:
        """The pairs in the given slots (n,) of `count`, constants that are not used elsewhere."""
        generator, low, scale = np.zeros((4, count)), np.zeros((4, count)), np.ones(count)
        generator[:, slots], low[:, slots] = self.generator, self.generator_low
        scale[slots] = self.scale
        return Pairs(generator, low, scale, slots[self.links], self.coupling)

    @staticmethod
    def oscillators(
        frequency: Array, frequency_low: Array, decay: Array, decay_low: Array
    ) -> tuple[Pairs, Array | None]:
        """Pairs of q'' + 2 decay q' + frequency^2 q = 0, both given as double-double.

        Returns
        -------
        pairs
            (q, q') through critical damping and of rigid bodies, two real exponentials beyond it.
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
                    scale[k] = 1.0 / float(w) if w else 0.0
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

    @staticmethod
    def empty() -> Pairs:
        """No pair."""
        return Pairs(np.empty((4, 0)), np.empty((4, 0)), np.empty(0))

    @staticmethod
    def constant() -> Pairs:
        """One pair that stays what it is."""
        return Pairs(np.zeros((4, 1)), np.zeros((4, 1)), np.ones(1))

    def derivative_rows(self, row: Array, order: int) -> Array:
        """Row (2, n) of the derivative of that order, from the row (2, n) of the value."""
        g, b = self.generator, self.coupling
        target, source = self.links
        for _ in range(order):
            changed = np.stack([row[0] * g[0] + row[1] * g[2], row[0] * g[1] + row[1] * g[3]])
            np.add.at(changed[0], source, row[0, target] * b[0] + row[1, target] * b[2])
            np.add.at(changed[1], source, row[0, target] * b[1] + row[1, target] * b[3])
            row = changed
        return row

    def bound(self, row: Array, order: int, window: float = math.inf) -> Array:
        """Weights (2, n) of abs(y) that bound the derivative of that order for a time `window`.

        Infinite where it may grow beyond all bounds.
        """
        row = self.derivative_rows(row, order)
        together = self.scale > 0.0
        scale = np.where(together, self.scale, 1.0)
        norm = np.hypot(row[0], row[1] / scale)
        weights = np.stack(
            [np.where(together, norm, abs(row[0])), np.where(together, norm, abs(row[1]))]
        )
        parts = self._growing_parts
        if parts is not None:
            slots, which, growth, decay = parts
            larger = _majorant(growth, decay, window)
            own = weights[which, slots]
            reached = own[:, None] * np.where(own[:, None] > 0.0, larger, 0.0)
            total = reached.sum(axis=0)
            weights[which, slots] = total
            alone = together[slots]
            weights[1, slots[alone]] = total[alone]
        weights[1] *= scale
        return weights

    @cached_property
    def _growing_parts(self) -> tuple[Any, Any, Array, Array] | None:
        """Parts of the state that feed one another: slots, rows, growth matrix and decays.

        A part is the norm of a pair, or one of two separate numbers. Its size n obeys
        n_i' <= -decay_i n_i + sum_j growth_ij n_j.
        """
        rigid = (self.scale == 0.0) & (self.generator[1] != 0.0)
        involved = np.unique(np.concatenate([self.links.ravel(), np.flatnonzero(rigid)]))
        if not involved.size:
            return None
        together = self.scale[involved] > 0.0
        slots = np.concatenate([involved, involved[~together]])
        which = np.concatenate([np.zeros(involved.size, int), np.ones((~together).sum(), int)])
        place = {(int(s), int(w)): i for i, (s, w) in enumerate(zip(slots, which, strict=True))}
        g = self.generator
        decay = np.where(which == 0, -g[0, slots], -g[3, slots])
        # Of a pair that does not rotate and shrink evenly no more is known than that it shrinks.
        uneven = (self.scale[slots] > 0.0) & (
            (g[0, slots] != g[3, slots]) | (g[1, slots] != -g[2, slots] * self.scale[slots] ** 2)
        )
        decay = np.where(uneven, 0.0, np.maximum(decay, 0.0))
        growth = np.zeros((slots.size, slots.size))
        for slot in np.flatnonzero(rigid).tolist():
            growth[place[slot, 0], place[slot, 1]] += abs(g[1, slot])
        for k, (t, s) in enumerate(self.links.T.tolist()):
            b = abs(self.coupling[:, k].reshape(2, 2))
            b = (
                np.diag([1.0, self.scale[t] or 1.0])
                @ b
                @ np.diag([1.0, 1.0 / (self.scale[s] or 1.0)])
            )
            rows = [b] if self.scale[t] == 0.0 else [np.linalg.norm(b, axis=0)[None]]
            b = np.concatenate(rows)
            b = b if self.scale[s] == 0.0 else np.linalg.norm(b, axis=1)[:, None]
            for i in range(len(b)):
                for j in range(b.shape[1]):
                    growth[place[t, i], place[s, j]] += b[i, j]
        return slots, which, growth, decay

    def polynomial_row(self, row: Array) -> Array | None:
        """The part (2, n) of a row that sees rigid bodies; None where all terms stay bounded."""
        still = np.zeros_like(row, dtype=bool)
        g = self.generator
        apart = self.scale == 0.0
        still[0] = apart & (g[0] == 0.0)
        still[1] = apart & (g[3] == 0.0)
        out = np.where(still, row, 0.0)
        return out if out.any() else None

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


def _majorant(growth: Array, decay: Array, window: float) -> Array:
    """Bound of each part by the parts at the start, for a time `window` or for ever."""
    n = len(growth)
    total = power = np.eye(n)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k in range(1, n + 1):
            if math.isinf(window):
                # A target that decays takes in no more than its source's largest value.
                scaled = np.where(growth > 0.0, growth / decay[:, None], 0.0)
            else:
                scaled = growth * (window / k)
            power = np.where(
                scaled[:, :, None] * (power > 0.0)[None] > 0.0,
                scaled[:, :, None] * power[None],
                0.0,
            ).sum(axis=1)
            if not power.any():
                break
            total = total + power
    return total
