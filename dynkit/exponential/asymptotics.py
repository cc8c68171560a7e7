"""What of an exponential sum does not decay: steady responses, and the drift of rigid bodies."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.exponential.modes import Pairs

RESIDUAL = 1e-10
"""Of the equation of a steady response, relative to its terms; where it is larger there is none."""


@final
@dataclass(frozen=True, eq=False)
class Responses:
    """Steady responses of pairs to the pairs that drive them for ever.

    Attributes
    ----------
    pairs
        How the pairs evolve less their steady responses: those that have one are not driven.
    slots
        (R, 2) pairs that respond, and what drives them: turning evenly, or constant.
    matrices
        (R, 2, 2) S: the response is S times the two numbers of what drives.
    """

    pairs: Pairs
    slots: NDArray[np.intp]
    matrices: Array

    @staticmethod
    def of(pairs: Pairs) -> Responses:
        """All that there are: none where a mode is driven at its own rate, or a body pushed."""
        if not pairs.links.size:
            return Responses(pairs, np.empty((0, 2), dtype=np.intp), np.empty((0, 2, 2)))
        g, links = pairs.generator, pairs.links.T.tolist()
        coupling = pairs.coupling.T.reshape(-1, 2, 2)
        targets = {t for t, _ in links}
        drivers = [
            s
            for s in dict.fromkeys(s for _, s in links)
            if s not in targets and g[0, s] == g[3, s] == 0.0 == g[1, s] + g[2, s]
        ]
        known: dict[tuple[int, int], Array] = {}
        kept = [(t, s, b) for (t, s), b in zip(links, coupling, strict=True) if s not in drivers]
        waiting = sorted(targets)
        while waiting:
            # No chain of links leads back: one of them is driven by none of the others.
            t = next(t for t in waiting if not any(to == t and s in waiting for to, s in links))
            waiting.remove(t)
            for d in drivers:
                push = np.zeros((2, 2))
                for (to, s), b in zip(links, coupling, strict=True):
                    if to == t and s == d:
                        push += b
                    elif to == t and (s, d) in known:
                        push += b @ known[s, d]
                if not push.any():
                    continue
                response = _steady(g[:, t].reshape(2, 2), g[:, d].reshape(2, 2), push)
                if response is None:
                    kept.append((t, d, push))
                else:
                    known[t, d] = response
        left = replace(
            pairs,
            links=np.array([[t, s] for t, s, _ in kept], dtype=np.intp).reshape(-1, 2).T,
            coupling=np.array([b.ravel() for _, _, b in kept]).reshape(-1, 4).T,
        )
        return Responses(
            left,
            np.array(list(known), dtype=np.intp).reshape(-1, 2),
            np.array(list(known.values())).reshape(-1, 2, 2),
        )

    def seen(self, row: Array) -> tuple[Array, Array]:
        """Row (2, n) of what drives and of what is left of the others; rounding (2, n) of it."""
        row, lost = row.copy(), np.zeros_like(row)
        for (t, d), matrix in zip(self.slots.tolist(), self.matrices, strict=True):
            row[:, d] += row[:, t] @ matrix
            lost[:, d] += 2.0**-48 * abs(row[:, t]) @ abs(matrix)
        return row, lost


def _steady(own: Array, drive: Array, push: Array) -> Array | None:
    """S with S Omega = G S + push; None where there is none."""
    unit = np.eye(2)
    try:
        system = np.kron(unit, drive.T) - np.kron(own, unit)
        response = np.linalg.solve(system, push.ravel()).reshape(2, 2)
    except np.linalg.LinAlgError:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        off = abs(response @ drive - own @ response - push).max()
        terms = abs(push).max() + abs(response).max() * (abs(own).max() + abs(drive).max())
    return np.asarray(response) if off <= RESIDUAL * terms else None


@final
@dataclass(frozen=True, eq=False)
class Drift:
    """Motion of the rigid bodies that a sum sees.

    Attributes
    ----------
    rows
        (6, n) rows, two each, of value, rate and acceleration at first, and later without what
        decays; the place that drag lets a body reach is a part of the value by itself.
    rest
        (2, n) row of what does not drift.
    lost
        (2, n) weights of what the drift may fall short by.
    """

    rows: Array
    rest: Array
    lost: Array

    @staticmethod
    def of(pairs: Pairs, row: Array) -> Drift | None:
        """The drift of a row (2, n); None where it is not known."""
        g = pairs.generator
        rigid = (pairs.scale == 0.0) & (g[0] == 0.0) & row.any(axis=0)
        if not rigid.any():
            return Drift(np.zeros((6, pairs.count)), row, np.zeros_like(row))
        dragged = rigid & (g[3] < 0.0)
        value, rest = np.where(rigid, row, 0.0), row.copy()
        rest[0, rigid] = 0.0
        rest[1, rigid & ~dragged] = 0.0
        value[1, dragged] = value[0, dragged] * g[1, dragged] / -g[3, dragged]
        # Where drag takes a body does not change: written as zero, which rounding would not be.
        own = g.copy()
        own[:, dragged] = 0.0
        rate = replace(pairs, generator=own).derivative_rows(value, 1)
        second = pairs.derivative_rows(rate, 1)
        lost = np.zeros_like(row)
        if dragged.any():
            constant = ~g.any(axis=0)
            if rate[:, ~constant].any():
                return None
            for t, s, b in zip(*pairs.links, pairs.coupling.T.tolist(), strict=True):
                # After a push of the velocity the place lags behind the drift.
                if dragged[t] and value[0, t] * b[0] < 0.0:
                    lost[0, s] += max(0.0, value[1, t] * b[2]) / -g[3, t]
        if pairs.derivative_rows(second, 1).any():
            return None
        return Drift(np.concatenate([value, rate, second]), rest, lost)


def tail_rows(responses: Responses, row: Array, steady: int) -> tuple[Array, Array, float]:
    """Weights and rows by which a ladder bounds what becomes of a sum.

    Returns
    -------
    weights : (2, n) of what neither drifts nor is steady
    drift : (6, n) as in `Drift`, with the values of constants
    swing : bound of all that comes from the pair `steady`
    """
    pairs = responses.pairs
    with np.errstate(over="ignore", invalid="ignore"):
        seen, rounding = responses.seen(row)
    drift = Drift.of(pairs, seen)
    rest = seen if drift is None else drift.rest
    rows = np.zeros((6, pairs.count)) if drift is None else drift.rows.copy()
    rest = rest.copy()
    still = ~pairs.generator.any(axis=0) & (pairs.scale > 0.0)
    rows[0, still] += rest[0, still]
    rest[:, still] = 0.0
    # Responses at resonance, hardly damped, may overflow: then there is no bound.
    with np.errstate(over="ignore", invalid="ignore"):
        weights = pairs.bound(rest, 0) + rounding
    if drift is not None:
        weights = weights + drift.lost
    return weights, rows, float(weights[0, steady]) if steady >= 0 else 0.0
