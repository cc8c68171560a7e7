"""Terms of exponential sums as pairs of numbers, and bounds of the pairs at later times."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from decimal import Decimal, localcontext
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import cached_property, copied, kept
from dynkit.core.validation import Array

LARGEST = 1e60
"""Largest entry of a generator: beyond it the bounds of derivatives would overflow."""

SEPARATE = 1.1
"""Beyond this damping ratio an oscillator is represented by its two real exponentials."""


@dataclass(frozen=True)
class Pairs:
    """Pairs y_k of numbers with y_k' = G_k y_k + sum over links B y_source.

    Attributes
    ----------
    generator, generator_low
        (4, n) entries 11, 12, 21, 22 of G and their low parts (double-double).
    scale
        (n,) factor s_k such that the norm of (y_1, s_k y_2) of an undriven pair never grows; 0
        marks two separate numbers: G diagonal, or (position, velocity) of a rigid body.
    links
        (2, L) targets and sources; the links have no cycles.
    coupling
        (4, L) entries 11, 12, 21, 22 of their B.
    cluster
        (n,) number of the cluster of a pair: pairs whose common norm never grows; by default each
        pair is a cluster.
    growth
        (n,) largest growth rate of the norm, or of the numbers, of a pair; by default zero.
    """

    generator: Array
    generator_low: Array
    scale: Array
    links: NDArray[np.intp] = field(default_factory=lambda: np.empty((2, 0), dtype=np.intp))
    coupling: Array = field(default_factory=lambda: np.empty((4, 0)))
    cluster: NDArray[np.intp] | None = None
    growth: Array | None = None

    @property
    def count(self) -> int:
        """Number of pairs."""
        return self.scale.size

    @cached_property
    def _growths(self) -> Array:
        return np.zeros(self.count) if self.growth is None else self.growth

    @property
    def steadily(self) -> float:
        """Longest time in which no number grows by more than a factor e."""
        largest = float(self._growths.max(initial=0.0))
        return 1.0 / largest if largest > 0.0 else math.inf

    @cached_property
    def _clusters(self) -> NDArray[np.intp]:
        return np.arange(self.count) if self.cluster is None else self.cluster

    @cached_property
    def _shared(self) -> bool:
        """Whether a cluster holds more than one pair."""
        return bool((self._clusters != np.arange(self.count)).any())

    @cached_property
    def independent(self) -> bool:
        """Whether no pair drives another or shares its norm, and none is a rigid body."""
        still = (self.scale == 0.0) & (self.generator[0] == 0.0)
        alone = not (self.links.size or self._shared or still.any() or self._growths.any())
        return alone and self._parts is None

    @cached_property
    def grows(self) -> bool:
        """Whether a term may grow without bound."""
        parts = self._parts
        if self._growths.any():
            return True
        return parts is not None and not np.isfinite(self._larger(math.inf)).all()

    @staticmethod
    def join(*parts: Pairs) -> Pairs:
        """Return the pairs of all parts, in their order."""
        before = np.cumsum([0, *(p.count for p in parts)])
        return Pairs(
            np.concatenate([p.generator for p in parts], axis=1),
            np.concatenate([p.generator_low for p in parts], axis=1),
            np.concatenate([p.scale for p in parts]),
            np.concatenate([p.links + b for p, b in zip(parts, before, strict=False)], axis=1),
            np.concatenate([p.coupling for p in parts], axis=1),
            np.concatenate([p._clusters + b for p, b in zip(parts, before, strict=False)]),
            np.concatenate([p._growths for p in parts]),
        )

    def linked(self, links: Any, coupling: Array) -> Pairs:
        """Return the pairs with additional links, (2, L) and (4, L)."""
        return replace(
            self,
            links=np.concatenate([self.links, np.asarray(links, dtype=np.intp)], axis=1),
            coupling=np.concatenate([self.coupling, coupling], axis=1),
        )

    def placed(self, slots: NDArray[np.intp], count: int) -> Pairs:
        """Return `count` pairs: these in the given slots (n,), unused constants elsewhere."""
        generator, low, scale = np.zeros((4, count)), np.zeros((4, count)), np.ones(count)
        generator[:, slots], low[:, slots] = self.generator, self.generator_low
        scale[slots] = self.scale
        cluster = np.arange(count)
        cluster[slots] = slots[self._clusters]
        growth = None
        if self.growth is not None:
            growth = np.zeros(count)
            growth[slots] = self.growth
        return Pairs(generator, low, scale, slots[self.links], self.coupling, cluster, growth)

    def turning(self, slot: int, frequency: float) -> Pairs:
        """Return the pairs with another frequency of a rotation that drives no other pair."""
        found = copied(self)  # cached properties of the other pairs remain valid
        vars(found)["generator"] = generator = self.generator.copy()
        vars(found)["rates"] = fast, slow = tuple(part.copy() for part in self.rates)
        generator[1:3, slot] = frequency, -frequency
        fast[slot] = slow[slot] = math.sqrt(frequency * frequency)  # the rounding of `rates`
        self._span(slot)
        others = vars(self)["_kept"].items()  # only spans of other slots depend on the frequency
        vars(found)["_kept"] = {k: one for k, one in others if k[0] != "_span" or k[1] == slot}
        if not frequency <= LARGEST:
            del vars(found)["rates"]  # computed again, it raises an error
        return found

    def spans(self, slot: int, *frequencies: float) -> bool:
        """Return whether other pairs have both slower and faster rates than these frequencies."""
        low, high = self._span(slot)
        return low <= min(frequencies) and max(frequencies) <= high

    @kept
    def _span(self, slot: int) -> tuple[float, float]:
        fast, slow = (np.delete(part, slot) for part in self.rates)
        return float(slow[slow > 0.0].min(initial=math.inf)), float(fast.max(initial=0.0))

    @staticmethod
    def oscillators(
        frequency: Array, frequency_low: Array, decay: Array, decay_low: Array
    ) -> tuple[Pairs, Array | None]:
        """Return pairs of q'' + 2 decay q' + frequency^2 q = 0 for double-double coefficients.

        Returns
        -------
        pairs
            (q, q') up to damping ratio `SEPARATE` and for rigid bodies, whose position under drag
            would be a difference of large exponentials; two real exponentials otherwise.
        mixing
            (2, 2, n) matrices from the pairs to (q, q'); None when all are the identity.
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
        """Return one pair (sine, cosine) of the angular frequency `frequency`."""
        return Pairs(
            np.array([[0.0], [frequency], [-frequency], [0.0]]), np.zeros((4, 1)), np.ones(1)
        )

    @staticmethod
    def empty() -> Pairs:
        """Return pairs without any pair."""
        return Pairs(np.empty((4, 0)), np.empty((4, 0)), np.empty(0))

    @staticmethod
    def constant() -> Pairs:
        """Return one constant pair."""
        return Pairs(np.zeros((4, 1)), np.zeros((4, 1)), np.ones(1))

    def derivatives(self, row: Array, count: int) -> Array:
        """Return rows (count, 2, n) of a value and its derivatives, from its row (2, n)."""
        g, b = self.generator, self.coupling
        target, source = self.links
        rows = np.empty((count, *row.shape))
        rows[0] = row
        for here, there in pairwise(rows):
            there[:] = here[0] * g[:2] + here[1] * g[2:]
            if target.size:
                np.add.at(there[0], source, here[0, target] * b[0] + here[1, target] * b[2])
                np.add.at(there[1], source, here[0, target] * b[1] + here[1, target] * b[3])
        return rows

    def derivative_rows(self, row: Array, order: int) -> Array:
        """Return the row (2, n) of the derivative of an order, from the row (2, n) of the value."""
        return np.asarray(self.derivatives(row, order + 1)[order])

    def bound(self, row: Array, order: int, window: float = math.inf) -> Array:
        """Return weights (2, n) of abs(y) that bound a derivative of an order for a time `window`.

        They are infinite where the derivative may grow without bound.
        """
        return np.asarray(self.bounds(self.derivative_rows(row, order)[None], window)[0])

    def bounds(self, rows: Array, window: float | Array = math.inf) -> Array:
        """Return weights (k, 2, n) of abs(y) that bound the values of rows (k, 2, n).

        They hold for a time `window`; for several finite windows (w,) they are (w, k, 2, n).
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
            number, growth, _ = self._parts
            involved = number >= 0
            own = np.zeros((len(rows), len(growth), 1))
            own[:, number[involved], 0] = weights[:, involved]  # equal for all numbers of a part
            larger = self._larger(window)[..., None, :, :]
            total = (own * np.where(own > 0.0, larger, 0.0)).sum(axis=-2)
            weights = np.where(involved, total[..., number], weights)
        weights[..., 1, :] *= scale
        return self._grown(weights, window) if self._growths.any() else weights

    def _grown(self, weights: Array, window: float | Array) -> Array:
        """Return weights (..., n) that include the growth of numbers during the window.

        `weights` are those without growth.
        """
        rate = self._growths
        if self._parts is not None:
            # Multiplied by exp(-rate t), with the largest rate of all coupled numbers, none grows.
            involved = self._parts[0].max(axis=0) >= 0
            rate = np.where(involved, rate[involved].max(initial=0.0), rate)
        with np.errstate(over="ignore", invalid="ignore"):
            factor = np.exp(np.multiply.outer(window, rate))[..., None, None, :]
            return np.where((weights > 0.0) & (rate > 0.0), weights * factor, weights)

    def _together(self, norm: Array) -> Array:
        """Return the norm (n,) of each pair's cluster from the norms of pairs."""
        largest = np.zeros(self.count)  # scale of each cluster: squares may underflow
        np.maximum.at(largest, self._clusters, norm)
        unit = np.where(largest > 0.0, largest, 1.0)
        squares = (norm / unit[self._clusters]) ** 2
        total = unit * np.sqrt(np.bincount(self._clusters, squares, self.count))
        return np.asarray(total[self._clusters])

    @cached_property
    def _parts(self) -> tuple[NDArray[np.intp], Array, Array] | None:
        """Coupled parts of the state: their numbers (2, n), growth matrix and decays.

        A part is the norm of a cluster, or one of two separate numbers. Its size n satisfies
        n_i' <= -decay_i n_i + sum_j growth_ij n_j. Uncoupled numbers have -1.
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
        # the two numbers of a coupled pair, and all pairs of a cluster, belong to one part
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
            # the sum of the entries bounds every norm
            for i in range(2):
                for j in range(2):
                    growth[number[i, t], number[j, source]] += b[i, j]
        return number, growth, decay

    @kept
    def _larger(self, window: float | Array) -> Array:
        """Return bounds of coupled parts by their initial sizes, for one or several windows."""
        assert self._parts is not None
        return _majorant(*self._parts[1:], window)

    def _contraction(self, slot: int, row: int) -> float:
        """Return the decay rate of an undriven number, or of the norm of a damped rotation."""
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
    """Return bounds (n, n) of the size of each part by those at the start, for each window."""
    n = len(growth)
    total = power = np.eye(n)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k in range(1, n + 1):
            if np.isinf(window).all():
                # a target with a decay remains below growth / decay times its source's maximum
                scaled = np.where(growth > 0.0, growth / decay[:, None], 0.0)
            else:
                scaled = growth * (np.asarray(window) / k)[..., None, None]
            factor, power = scaled[..., None], power[..., None, :, :]
            power = np.where(factor * (power > 0.0) > 0.0, factor * power, 0.0).sum(axis=-2)
            if not power.any():
                break
            total = total + power
    return total
