"""The terms of exponential sums, two numbers each, and bounds of what becomes of them."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, field
from decimal import Decimal, localcontext
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array

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
    cluster
        (n,) one of the pairs together with which the norm of a pair never grows; itself by default.
    """

    generator: Array
    generator_low: Array
    scale: Array
    links: NDArray[np.intp] = field(default_factory=lambda: np.empty((2, 0), dtype=np.intp))
    coupling: Array = field(default_factory=lambda: np.empty((4, 0)))
    cluster: NDArray[np.intp] | None = None

    @property
    def count(self) -> int:
        """Number of pairs."""
        return self.scale.size

    @cached_property
    def _clusters(self) -> NDArray[np.intp]:
        return np.arange(self.count) if self.cluster is None else self.cluster

    @cached_property
    def _shared(self) -> bool:
        """Whether a cluster holds more than one pair."""
        return bool((self._clusters != np.arange(self.count)).any())

    @cached_property
    def independent(self) -> bool:
        """Whether no pair feeds another or shares its norm, and none is a rigid body."""
        still = (self.scale == 0.0) & (self.generator[0] == 0.0)
        return not (self.links.size or self._shared or still.any()) and self._parts is None

    @cached_property
    def grows(self) -> bool:
        """Whether a term may grow beyond all bounds."""
        parts = self._parts
        return parts is not None and not np.isfinite(_majorant(*parts[1:], math.inf)).all()

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
            np.concatenate([p._clusters + b for p, b in zip(parts, before, strict=False)]),
        )

    def linked(self, links: Any, coupling: Array) -> Pairs:
        """The same pairs with more links, (2, L) and (4, L)."""
        return Pairs(
            self.generator,
            self.generator_low,
            self.scale,
            np.concatenate([self.links, np.asarray(links, dtype=np.intp)], axis=1),
            np.concatenate([self.coupling, coupling], axis=1),
            self.cluster,
        )

    def placed(self, slots: NDArray[np.intp], count: int) -> Pairs:
        """The pairs in the given slots (n,) of `count`, constants that are not used elsewhere."""
        generator, low, scale = np.zeros((4, count)), np.zeros((4, count)), np.ones(count)
        generator[:, slots], low[:, slots] = self.generator, self.generator_low
        scale[slots] = self.scale
        cluster = np.arange(count)
        cluster[slots] = slots[self._clusters]
        return Pairs(generator, low, scale, slots[self.links], self.coupling, cluster)

    def turning(self, slot: int, frequency: float) -> Pairs:
        """The same with another rotation in the slot of one that feeds nothing."""
        found = copy(self)  # what is known of the others stays true
        vars(found)["generator"] = generator = self.generator.copy()
        vars(found)["rates"] = fast, slow = tuple(part.copy() for part in self.rates)
        generator[1:3, slot] = frequency, -frequency
        fast[slot] = slow[slot] = math.sqrt(frequency * frequency)  # as rounded as the others
        if not frequency <= LARGEST:
            del vars(found)["rates"]  # which refuses it
        return found

    @staticmethod
    def oscillators(
        frequency: Array, frequency_low: Array, decay: Array, decay_low: Array
    ) -> tuple[Pairs, Array | None]:
        """Pairs of q'' + 2 decay q' + frequency^2 q = 0, both given as double-double.

        Returns
        -------
        pairs
            (q, q') through critical damping and of rigid bodies, two real exponentials beyond it.
            With both of a rigid body under drag its place would be a difference of large numbers.
        mixing
            (2, 2, n) matrices that give (q, q') from the pairs; None when all of them are 1.
        """
        n = frequency.size
        generator, low = np.zeros((4, n)), np.zeros((4, n))
        scale = np.zeros(n)
        mixing = np.zeros((2, 2, n))
        mixing[0, 0] = mixing[1, 1] = 1.0
        separate = (decay > SEPARATE * frequency) & (frequency > 0.0)
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

    def derivatives(self, row: Array, count: int) -> Array:
        """Rows (count, 2, n) of the value and its derivatives, from the row (2, n) of the value."""
        g, b = self.generator, self.coupling
        target, source = self.links
        rows = np.empty((count, *row.shape))
        rows[0] = row
        for here, there in pairwise(rows):
            there[0] = here[0] * g[0] + here[1] * g[2]
            there[1] = here[0] * g[1] + here[1] * g[3]
            if target.size:
                np.add.at(there[0], source, here[0, target] * b[0] + here[1, target] * b[2])
                np.add.at(there[1], source, here[0, target] * b[1] + here[1, target] * b[3])
        return rows

    def derivative_rows(self, row: Array, order: int) -> Array:
        """Row (2, n) of the derivative of that order, from the row (2, n) of the value."""
        return np.asarray(self.derivatives(row, order + 1)[order])

    def bound(self, row: Array, order: int, window: float = math.inf) -> Array:
        """Weights (2, n) of abs(y) that bound the derivative of that order for a time `window`.

        Infinite where it may grow beyond all bounds.
        """
        return np.asarray(self.bounds(self.derivative_rows(row, order)[None], window)[0])

    def bounds(self, rows: Array, window: float | Array = math.inf) -> Array:
        """Weights (k, 2, n) of abs(y) that bound what rows (k, 2, n) give, for a time `window`.

        Of each of several finite windows (w,): (w, k, 2, n).
        """
        together = self.scale > 0.0
        scale = np.where(together, self.scale, 1.0)
        norm = np.hypot(rows[:, 0], rows[:, 1] / scale)
        if self._shared:
            for part in norm:
                part[:] = self._together(np.where(together, part, 0.0))
        weights = np.where(together, norm[:, None], abs(rows))
        if self._parts is None:
            if np.ndim(window):
                weights = np.repeat(weights[None], np.size(window), axis=0)
        else:
            number, growth, decay = self._parts
            involved = number >= 0
            own = np.zeros((len(rows), len(growth), 1))
            own[:, number[involved], 0] = weights[:, involved]  # the same for all of a part
            larger = _majorant(growth, decay, window)[..., None, :, :]
            total = (own * np.where(own > 0.0, larger, 0.0)).sum(axis=-2)
            weights = np.where(involved, total[..., number], weights)
        weights[..., 1, :] *= scale
        return weights

    def _together(self, norm: Array) -> Array:
        """Norms (n,) of the clusters of pairs, from those of the pairs; squares may underflow."""
        largest = np.zeros(self.count)
        np.maximum.at(largest, self._clusters, norm)
        unit = np.where(largest > 0.0, largest, 1.0)
        squares = (norm / unit[self._clusters]) ** 2
        total = unit * np.sqrt(np.bincount(self._clusters, squares, self.count))
        return np.asarray(total[self._clusters])

    @cached_property
    def _parts(self) -> tuple[NDArray[np.intp], Array, Array] | None:
        """Parts of the state that feed one another: numbers (2, n), growth matrix and decays.

        A part is the norm of a cluster, or one of two separate numbers. Its size n obeys
        n_i' <= -decay_i n_i + sum_j growth_ij n_j. What feeds nothing has the number -1.
        """
        apart = self.scale == 0.0
        rigid = apart & (self.generator[1] != 0.0)
        cluster = self._clusters
        outer = np.flatnonzero(cluster[self.links[0]] != cluster[self.links[1]])
        involved = np.zeros(self.count, dtype=bool)
        involved[cluster[self.links[:, outer]]] = True
        involved = involved[cluster] | rigid
        if not involved.any():
            return None
        # Both numbers of a pair that is not apart share a part, and so do the pairs of a cluster.
        key = np.stack([2 * cluster, np.where(apart, 2 * cluster + 1, 2 * cluster)])
        names, number = np.unique(np.where(involved, key, -1), return_inverse=True)
        number = number.reshape(2, -1) - int(names[0] < 0)
        count = int(number.max()) + 1
        growth, decay = np.zeros((count, count)), np.full(count, np.inf)
        for slot in np.flatnonzero(involved).tolist():
            for i in range(2):
                at = number[i, slot]
                decay[at] = min(decay[at], self._contraction(slot, i))
            if rigid[slot]:
                growth[number[0, slot], number[1, slot]] += abs(self.generator[1, slot])
        for k in outer.tolist():
            t, source = self.links[:, k].tolist()
            b = abs(self.coupling[:, k].reshape(2, 2))
            b = b * np.array([[1.0], [self.scale[t] or 1.0]]) / [1.0, self.scale[source] or 1.0]
            # Sums over entries bound every norm of them.
            for i in range(2):
                for j in range(2):
                    growth[number[i, t], number[j, source]] += b[i, j]
        return number, growth, decay

    def _contraction(self, slot: int, row: int) -> float:
        """Rate at which a number, or the norm of a pair that turns evenly, decays by itself."""
        g, scale = self.generator[:, slot], self.scale[slot]
        if scale == 0.0:
            return max(0.0, -float(g[3 * row]))
        even = g[0] == g[3] and g[1] == -g[2] * scale**2 and self._clusters[slot] == slot
        return max(0.0, -float(g[0])) if even else 0.0

    @cached_property
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


def _majorant(growth: Array, decay: Array, window: float | Array) -> Array:
    """Bound of each part by the parts at the start, for a time or for ever; for each of times."""
    n = len(growth)
    total = power = np.eye(n)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k in range(1, n + 1):
            if np.isinf(window).all():
                # A target that decays takes in no more than its source's largest value.
                scaled = np.where(growth > 0.0, growth / decay[:, None], 0.0)
            else:
                scaled = growth * (np.asarray(window) / k)[..., None, None]
            factor, power = scaled[..., None], power[..., None, :, :]
            power = np.where(factor * (power > 0.0) > 0.0, factor * power, 0.0).sum(axis=-2)
            if not power.any():
                break
            total = total + power
    return total
