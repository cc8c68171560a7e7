"""Eigen-coordinates of a mode: each evolves as a single exponential."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.modes.mode import Mode


@final
@dataclass(frozen=True, eq=False)
class EigenCoordinates:
    """Complex coordinates c_a' = rates_a c_a of a mode's states; the last one is the number 1.

    Attributes
    ----------
    rates : (m,) complex, one of each conjugate pair, with imaginary part >= 0
    forward : (m - 1, 2 slots) complex, from flat states to all coordinates but the last
    back : (N + 1, m) complex, Re(back c) are the positions and the number 1
    condition : float
        Condition number of the eigenvectors, in units in which a mode of constant energy rotates
        uniformly; infinite where the state matrix is defective.
    fastest : (m,) absolute errors of the rates, in units of 2^-52
    """

    rates: Any
    forward: Any
    back: Any
    condition: float
    fastest: Array

    @staticmethod
    def of(mode: Mode) -> EigenCoordinates:
        """The eigen-coordinates of a mode."""
        layout, pairs = mode.layout, mode.pairs
        used = layout.modes
        for slot in (layout.table, layout.constant):
            used = np.append(used, slot) if slot >= 0 else used
        if pairs.links.size:
            rates, to, fro, condition = _linked(_generator(mode), pairs.scale, used)
            error = np.full(len(rates), condition * abs(rates).max(initial=0.0))
        else:
            rates, to, fro, condition = _alone(pairs.generator, used)
            error = abs(rates)
        kept = rates.imag >= 0.0
        rates, to, fro, error = rates[kept], to[kept], fro[:, kept], error[kept]
        # A complex coordinate also represents its conjugate.
        fro = fro * np.where(rates.imag > 0.0, 2.0, 1.0)
        n = mode.bodies
        back = np.zeros((n + 1, len(rates) + 1), dtype=complex)
        back[:n, :-1] = mode.units()[0].T[:n] @ fro
        back[:n, -1] = mode.forced.rest[:n]
        back[n, -1] = 1.0
        return EigenCoordinates(np.append(rates, 0.0), to, back, condition, np.append(error, 0.0))


def _alone(generator: Array, used: Any) -> tuple[Any, Any, Any, float]:
    """Rates (m,) of unlinked pairs, matrices from states and to states, condition number.

    The matrices are (m, 2 slots) and (2 slots, m).
    """
    count = generator.shape[1]
    a, b, c, d = (entries[used].astype(complex) for entries in generator)
    diagonal = (b == 0.0) & (c == 0.0)
    middle, half = 0.5 * (a + d), 0.5 * (a - d)
    root = np.sqrt(half * half + b * c)
    first, second = middle + root, middle - root
    # The smaller of two real rates follows from their product, without cancellation.
    real = (root.imag == 0.0) & (first != 0.0) & (second != 0.0)
    swap = real & (abs(first) < abs(second))
    slow = (a * d - b * c) / np.where(swap, second, np.where(real, first, 1.0))
    first = np.where(swap, slow, first)
    second = np.where(real & ~swap, slow, second)
    first, second = np.where(diagonal, a, first), np.where(diagonal, d, second)
    apart = first - second
    with np.errstate(divide="ignore", invalid="ignore"):
        condition = np.where(diagonal, 1.0, (abs(first) + abs(second)) / abs(apart))
        condition = np.where(np.isnan(condition), np.inf, condition)
        apart = np.where(diagonal | (apart == 0.0), 1.0, apart)
        # Eigenvectors are (b, rate - a); a pair with b = 0 and c other than 0 counts as defective.
        upper = np.where(diagonal, 1.0, b)
    n = len(used)
    to = np.zeros((2, n, 2, count), dtype=complex)
    fro = np.zeros((2, count, 2, n), dtype=complex)
    k = np.arange(n)
    lower = [np.where(diagonal, 0.0, first - a), np.where(diagonal, 1.0, second - a)]
    fro[0, used, 0, k], fro[0, used, 1, k] = upper, np.where(diagonal, 0.0, upper)
    fro[1, used, 0, k], fro[1, used, 1, k] = lower
    determinant = np.where(diagonal, 1.0, -upper * apart)
    determinant = np.where(determinant == 0.0, 1.0, determinant)
    to[0, k, 0, used], to[0, k, 1, used] = lower[1] / determinant, -fro[0, used, 1, k] / determinant
    to[1, k, 0, used], to[1, k, 1, used] = -lower[0] / determinant, upper / determinant
    worst = float(condition.max(initial=1.0))
    if (~diagonal & (b == 0.0)).any():
        worst = np.inf
    rates = np.concatenate([first, second])
    return rates, to.reshape(2 * n, 2 * count), fro.reshape(2 * count, 2 * n), worst


def _linked(generator: Array, scale: Array, used: Any) -> tuple[Any, Any, Any, float]:
    """As `_alone`, for pairs with links."""
    count = len(scale)
    unit = np.concatenate([np.ones(count), np.where(scale > 0.0, scale, 1.0)])
    place = np.concatenate([used, used + count])
    scaled = (generator * unit[:, None] / unit)[np.ix_(place, place)]
    rates, vectors = np.linalg.eig(scaled)
    condition = float(np.linalg.cond(vectors))
    if not condition < 1.0 / np.finfo(float).eps:
        return rates, np.zeros((len(rates), 2 * count)), np.zeros((2 * count, len(rates))), np.inf
    to = np.zeros((len(rates), 2 * count), dtype=complex)
    fro = np.zeros((2 * count, len(rates)), dtype=complex)
    to[:, place] = np.linalg.inv(vectors) * unit[place]
    fro[place] = vectors / unit[place, None]
    return rates, to, fro, condition


def _generator(mode: Mode) -> Array:
    """State matrix (2 slots, 2 slots) of the flat states."""
    pairs = mode.pairs
    count = pairs.count
    out = np.zeros((2, count, 2, count))
    k = np.arange(count)
    target, source = pairs.links
    for i in range(2):
        for j in range(2):
            out[i, k, j, k] = pairs.generator[2 * i + j]
            np.add.at(out, (i, target, j, source), pairs.coupling[2 * i + j])
    return out.reshape(2 * count, 2 * count)
