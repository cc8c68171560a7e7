"""Eigen-coordinates of a mode: each evolves as a single exponential."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.exponential.modes import Pairs
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
        driven = [slot for slot in (layout.table, layout.constant) if slot >= 0]
        used = np.append(layout.modes, np.array(driven, dtype=np.intp))
        rates, to, fro, condition, error = (_linked if pairs.links.size else _alone)(mode, used)
        kept = rates.imag >= 0.0
        rates, to, fro, error = rates[kept].astype(complex), to[kept], fro[:, kept], error[kept]
        # A complex coordinate also represents its conjugate.
        fro = fro * np.where(rates.imag > 0.0, 2.0, 1.0)
        n = mode.bodies
        back = np.zeros((n + 1, len(rates) + 1), dtype=complex)
        back[:n, :-1] = mode.units()[0].T[:n] @ fro
        back[:n, -1] = mode.forced.rest[:n]
        back[n, -1] = 1.0
        return EigenCoordinates(np.append(rates, 0.0), to, back, condition, np.append(error, 0.0))


def _alone(mode: Mode, used: Any) -> tuple[Any, Any, Any, float, Array]:
    """Rates (m,) of unlinked pairs, matrices from and to states, condition number, errors (m,).

    The matrices are (m, 2 slots) and (2 slots, m); the errors are those of the rates, in units of
    2^-52.
    """
    pairs, size = mode.pairs, len(used)
    unit = np.stack([np.ones(size), _units(pairs)[used]], axis=1)
    blocks = pairs.generator[:, used].T.reshape(-1, 2, 2)
    rates, vectors, inverse, condition = _eigen(blocks * unit[..., None] / unit[:, None])
    to = np.zeros((size, 2, 2, pairs.count), dtype=complex)
    fro = np.zeros((2, pairs.count, size, 2), dtype=complex)
    each = np.arange(size)
    to[each, ..., used] = inverse * unit[:, None]
    fro[:, used, each] = (vectors / unit[..., None]).swapaxes(0, 1)
    m, rates = 2 * size, rates.ravel()
    return rates, to.reshape(m, -1), fro.reshape(-1, m), condition, abs(rates)


def _linked(mode: Mode, used: Any) -> tuple[Any, Any, Any, float, Array]:
    """As `_alone`, for pairs with links."""
    count, size = mode.pairs.count, 2 * mode.pairs.count
    unit = np.append(np.ones(count), _units(mode.pairs))
    generator = mode.rate(np.eye(size).reshape(size, 2, count)).reshape(size, size).T
    place = np.append(used, used + count)
    scaled = (generator * unit[:, None] / unit)[np.ix_(place, place)]
    rates, vectors, inverse, condition = _eigen(scaled)
    to = np.zeros((len(rates), size), dtype=complex)
    fro = np.zeros((size, len(rates)), dtype=complex)
    to[:, place], fro[place] = inverse * unit[place], vectors / unit[place, None]
    return rates, to, fro, condition, np.full(len(rates), condition * abs(rates).max(initial=0.0))


def _units(pairs: Pairs) -> Array:
    """Units of second numbers in which a pair of constant energy rotates uniformly."""
    return np.where(pairs.scale > 0.0, pairs.scale, 1.0)


def _eigen(matrices: Array) -> tuple[Any, Any, Any, float]:
    """Eigenvalues (..., n), eigenvectors (..., n, n), their inverse, largest condition number.

    The inverse is zero, and the condition number infinite, for a defective matrix.
    """
    rates, vectors = np.linalg.eig(matrices)
    condition = float(np.linalg.cond(vectors).max(initial=1.0))
    if not condition < 2.0**52:
        return rates, vectors, 0.0 * vectors, np.inf
    return rates, vectors, np.linalg.inv(vectors), condition
